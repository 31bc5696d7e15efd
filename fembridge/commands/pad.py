"""Compute the pad of a finger or of your own mesh with CalculiX: what `fembridge touch` superposes.

A section of a finger is swept along it; unit forces on one slice of the skin, in four runs for
the mirror images about x = 0 and z = 0, give its Green's functions (two minutes and 0.3 GB at
0.25 mm; the cost grows with about the fifth power of 1 / spacing).

With --base-deck it is the pad of your own solid model: unit forces on all nodes of --skin, stress
at the --afferents. --runs DIR keeps what was solved, and the same command goes on there.
"""

import argparse
from pathlib import Path
from typing import Any

from fembridge.commands.options import NODE, Number, Use, add_from, words_of
from fembridge.ranges import Range
from fembridge.solver.settings import Solver

EXAMPLE = "fembridge pad --base-deck mine.inp --skin SKIN --afferents EPIDERMIS:0.6 -o pad.npz"

_FINGER_OPTIONS = "--finger --spacing-mm --ridges --plane --jobs"
_MESH_OPTIONS = "--skin --afferents --after-step --apex --outward --along"

USES = (
    Use(_FINGER_OPTIONS, "a finger, not for --base-deck", lambda args: args.base_deck is None),
    Use(_MESH_OPTIONS, "--base-deck", lambda args: args.base_deck is not None),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    from fembridge.touching.make_pad import make_pad

    add_from(
        parser,
        make_pad,
        "finger",
        spacing_mm=(
            "MM",
            "distance of two nodes that may touch (default: 0.25, of a plane pad 0.0625)",
        ),
        reach_mm=(
            "MM",
            "distance from the apex up to which skin may be touched (default: 4.5; own model: all)",
        ),
        ridges="model the ridges and papillae of the finger, along its axis (default: smooth)",
        plane="the section alone, in plane strain: shapes are endless along the finger",
    )
    own = parser.add_argument_group("your own model")
    own.add_argument("--base-deck", type=Path, metavar="FILE.inp", help="deck of a solid model")
    own.add_argument("--skin", metavar="SURF", help="surface or node set that may be touched")
    own.add_argument(
        "--afferents",
        action="append",
        metavar="[CLASS=]SET[:MM]",
        help="where stress is computed: SA=EPIDERMIS:0.6 is 0.6 mm below the skin in this element "
        "set, 0.6 in the material at that depth, NODES at the nodes of this set; repeatable "
        "(default: SA=0.5875, RA=0.52, PC=2)",
    )
    own.add_argument(
        "--after-step",
        type=Number.within(Range(0, 1000, is_whole=True)),
        default=0,
        metavar="N",
        help="linearise after this step of the deck, such as a preload (default: 0, undeformed)",
    )
    own.add_argument("--apex", type=NODE, metavar="NODE", help="node at the middle of the map")
    for option, meaning in (
        ("outward", "direction out of the skin at the middle (default: mean normal of the skin)"),
        ("along", "direction along the finger, to its tip (default: longest of the skin)"),
    ):
        own.add_argument(
            f"--{option}",
            type=Number.within(Range()),
            nargs=3,
            metavar=("X", "Y", "Z"),
            help=meaning,
        )
    add_from(parser, Solver, "threads", "jobs", "time_limit_s")
    parser.add_argument(
        "--runs",
        type=Path,
        metavar="DIR",
        help="keep the solver's runs in DIR (default: they are removed at the end)",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("pad.npz"),
        metavar="FILE.npz",
        help="default: pad.npz",
    )


def _words(args: argparse.Namespace) -> dict[str, Any]:
    """Arguments of `make_pad`."""
    from fembridge.touching.make_pad import make_pad

    words = words_of(args, make_pad)
    if args.base_deck is None:
        return words
    from fembridge.errors import UsageError
    from fembridge.touching.pad_request import SkinMap

    outward, along = (value and tuple(value) for value in (args.outward, args.along))
    words["skin_map"] = SkinMap(args.apex, outward, along)
    by_class: dict[str, str] = {}
    for text in args.afferents or ():
        name, equals, place = text.rpartition("=")
        if not equals and len(args.afferents) > 1:
            expected = "CLASS=SET:MM where there are several"
            raise UsageError(argument="afferents", found=text, expected=expected)
        by_class[name] = place
    words["afferents"] = by_class.get("", by_class) or None
    return words


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Make the pad; the summary has its size."""
    from contextlib import ExitStack
    from dataclasses import replace

    from fembridge.errors import OutputError, SolverError, UsageError
    from fembridge.host.store import check_output, working_folder
    from fembridge.touching.make_pad import make_pad

    output: Path = args.output
    if output.suffix != ".npz":
        raise UsageError(argument="output", found=str(output), expected="a name in .npz")
    check_output(output.parent, output.name)
    with ExitStack() as stack:
        folder = args.runs or stack.enter_context(working_folder(output.parent))
        solver = replace(Solver(**words_of(args, Solver)), runs_folder=folder)
        try:
            pad = make_pad(**_words(args), solver=solver)
        except SolverError as error:
            if args.runs:
                raise
            problem = f"{error.problem}; --runs DIR keeps the files of the solver"
            raise SolverError(problem, Path(error.path.name)) from error
        except OutputError as error:
            if args.runs or not error.path.is_relative_to(folder):
                raise
            raise OutputError(error.problem, output) from error
    pad.write(output)
    size = output.stat().st_size
    print(f"{output}: {pad.skin_text}, {pad.origin['elements']} elements, {size / 1e6:.1f} MB")
    return {"pad": output, "bytes": size, **pad.origin}
