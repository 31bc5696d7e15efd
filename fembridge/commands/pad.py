"""Have CalculiX make the pad of a finger: what `fembridge touch` superposes.

The section is swept along the finger; unit forces on one slice of the skin, in four
decks for the mirror images about x = 0 and z = 0, give its Green's functions (two
minutes and 0.3 GB at 0.25 mm; cost grows with about the fifth power of 1 / spacing).
"""

import argparse
from pathlib import Path
from typing import Any

from fembridge.commands.options import NUMBERS, add_from, words_of
from fembridge.solver.settings import SolverSettings
from fembridge.terminal import log

EXAMPLE = "fembridge pad --finger finger.toml -o pad.npz"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    from fembridge.api import simulate

    add_from(parser, simulate, "finger")
    parser.add_argument(
        "--spacing-mm",
        type=NUMBERS["spacing_mm"],
        metavar="MM",
        help="between nodes that may touch (default: 0.25, of a plane pad 0.0625)",
    )
    parser.add_argument(
        "--reach-mm",
        type=NUMBERS["reach_mm"],
        default=4.5,
        metavar="MM",
        help="they lie so far to both sides of the apex, along the skin (default: 4.5)",
    )
    parser.add_argument(
        "--ridges",
        action="store_true",
        help="with the finger's ridges and papillae, along its axis (default: smooth)",
    )
    parser.add_argument(
        "--plane",
        action="store_true",
        help="the section alone, in plane strain: what touches it is endless along the finger",
    )
    add_from(parser, SolverSettings, "threads", "jobs", "time_limit_s")
    parser.add_argument(
        "--runs",
        type=Path,
        metavar="DIR",
        help="where the solver's runs are kept (default: nowhere, they are removed at the end)",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("pad.npz"),
        metavar="FILE.npz",
        help="default: pad.npz",
    )


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Make the pad; the summary says how large it is."""
    from contextlib import ExitStack

    from decks.green import PLANE_ROWS, PadMesh, smooth
    from decks.presets import read_finger
    from fembridge.errors import FingerError, OutputError, SolverError, UsageError
    from fembridge.store import check_output, working_folder
    from fembridge.touching.green import solve_pad
    from fembridge.touching.pad_file import write_pad

    if args.output.suffix != ".npz":
        raise UsageError(f"{args.output}: expected a name in .npz")
    finger = read_finger(args.finger)
    spacing_mm = args.spacing_mm
    if spacing_mm is None:
        spacing_mm = 0.0625 if args.plane else 0.25
    rows = PLANE_ROWS if args.plane else 1
    try:
        mesh = PadMesh(spacing_mm, args.reach_mm, plane=args.plane, rows=rows)
    except FingerError as error:  # of a number of ours, not of a file
        raise UsageError(str(error)) from error
    check_output(args.output.parent, args.output.name)
    with ExitStack() as stack:
        folder = args.runs or stack.enter_context(working_folder(args.output.parent))
        try:
            pad = solve_pad(
                folder,
                finger if args.ridges else smooth(finger),
                mesh,
                SolverSettings(**words_of(args, SolverSettings)),
                log=log,
            )
        except SolverError as error:
            if args.runs:
                raise
            problem = f"{error.problem}; --runs DIR keeps what the solver wrote"
            raise SolverError(problem, Path(error.path.name)) from error
        except OutputError as error:
            if args.runs or not error.path.is_relative_to(folder):
                raise
            raise OutputError(error.problem, args.output) from error
    write_pad(args.output, pad)
    size = args.output.stat().st_size
    print(
        f"{args.output}: {pad.x_mm.size} columns of skin {spacing_mm:g} mm apart, "
        f"{pad.origin['elements']} elements, {size / 1e6:.1f} MB"
    )
    return {"pad": args.output, "bytes": size, **pad.origin}
