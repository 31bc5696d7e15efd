"""Press a 50 um probe 1 mm into the finger: how far the skin around goes down.

The paper's check of its finger, Fig. 2c. What was solved once on several meshes is
stored and drawn by default; --solver run solves it here, which takes ccx and one to
ten minutes. Profiles are written to the output folder as a table and a picture.
"""

import argparse
import sys
from typing import TYPE_CHECKING, Any

from fembridge.commands.options import add_output_option

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from decks.finger import Finger
    from fembridge.deflection.profile import Deflection

EXAMPLE = "fembridge deflect -o deflection"

TABLE_FILE = "deflection.csv"
PICTURE_FILE = "deflection.png"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    parser.add_argument(
        "--finger",
        metavar="NAME|FILE.toml",
        help="quick, medium, paper, fine or, to be solved, a file (default: all that "
        "are stored; quick with --solver run)",
    )
    source = parser.add_mutually_exclusive_group()
    source.add_argument(
        "--solver", choices=("run",), help="solve it here, and compare with the stored"
    )
    source.add_argument("--stored", action="store_true", help="take what is stored (the default)")
    parser.add_argument(
        "--depth-mm", type=float, metavar="D", help="how deep, where it is solved (default: 1)"
    )
    parser.add_argument(
        "--threads",
        type=int,
        metavar="N",
        help="threads of the run (default: OMP_NUM_THREADS, or all cores)",
    )
    parser.add_argument(
        "--time-limit", type=float, metavar="S", help="give up the run after so long"
    )
    add_output_option(parser, default="deflection")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Take or solve the profiles, write them; the summary holds them."""
    from pathlib import Path

    from fembridge.errors import UsageError
    from fembridge.plots.deflection import deflection_figure
    from fembridge.plots.style import save_figure
    from fembridge.store import filling, write_text

    output = Path(args.output)
    if args.solver is None:
        for option in ("depth_mm", "threads", "time_limit"):
            if getattr(args, option) is not None:
                word = option.replace("_", "-")
                raise UsageError(f"--{word} is for --solver run")
    shown = _stored(args.finger) if args.solver is None else _solved(args, output)
    with filling(output, last=TABLE_FILE) as draft:
        write_text(draft / TABLE_FILE, table_text(shown))
        save_figure(deflection_figure(shown), draft / PICTURE_FILE)
    rows = _rows(shown)
    if not args.json:
        _print_table(shown, rows)
        print(f"{TABLE_FILE}, {PICTURE_FILE}: {output}")
    return {
        "output": str(output),
        "source": "stored" if args.solver is None else "solved",
        "depth_mm": shown[0].depth_mm,
        "meshes": [
            {
                "mesh": mesh.name,
                "elements": mesh.elements,
                "force_n_per_mm": mesh.force_n_per_mm,
                "sha256": mesh.origin.get("mesh_sha256"),
            }
            for mesh in shown
        ],
        "convergence": rows,
    }


def table_text(deflections: "Sequence[Deflection]") -> str:
    """Long table ``mesh,distance_mm,deflection_mm``, one row a node."""
    lines = ["mesh,distance_mm,deflection_mm"]
    for mesh in deflections:
        pairs = zip(mesh.distance_mm.tolist(), mesh.deflection_mm.tolist(), strict=True)
        lines += [f"{mesh.name},{x_mm!r},{down_mm!r}" for x_mm, down_mm in pairs]
    return "\n".join(lines) + "\n"


def _stored(name: str | None) -> "list[Deflection]":
    from fembridge.deflection.profile import stored_deflection, stored_deflections

    return list(stored_deflections()) if name is None else [stored_deflection(name)]


def _solved(args: argparse.Namespace, output: "Path") -> "list[Deflection]":
    from fembridge.deflection.press import DEPTH_MM, press_of, solve_deflection
    from fembridge.deflection.profile import stored_deflections
    from fembridge.progress import SolverBars
    from fembridge.solver.ccx import SolverSettings

    depth_mm = DEPTH_MM if args.depth_mm is None else args.depth_mm
    press = press_of(_finger(args.finger or "quick"), depth_mm)
    with SolverBars() as bars:
        settings = SolverSettings(
            threads=args.threads, time_limit_s=args.time_limit, on_progress=bars
        )
        solved = solve_deflection(output / "run", press, settings)
    for stored in stored_deflections():
        if stored.origin.get("mesh_sha256") == solved.origin["mesh_sha256"]:
            _compare(solved, stored)
    return [solved]


def _finger(word: str) -> "Finger":
    from decks.finger_file import read_finger
    from fembridge.deflection.press import FINGERS

    return FINGERS[word] if word in FINGERS else read_finger(word)


def _compare(solved: "Deflection", stored: "Deflection") -> None:
    """Print how far what was solved here is from what is stored of the same mesh."""
    if solved.depth_mm != stored.depth_mm:
        return
    differ_um = 1000.0 * abs(solved.deflection_mm - stored.deflection_mm).max()
    print(f"solved here and stored differ by {differ_um:.2g} um at most", file=sys.stderr)


def _rows(shown: "Sequence[Deflection]") -> list[dict[str, Any]]:
    from dataclasses import asdict

    from fembridge.deflection.profile import convergence

    return [asdict(row) for row in convergence(shown)] if len(shown) > 1 else []


def _print_table(shown: "Sequence[Deflection]", rows: list[dict[str, Any]]) -> None:
    from fembridge.deflection.profile import COMPARED_MM

    lines = [
        (f"deflection at {x_mm:g} mm", [float(mesh.at(x_mm)) for mesh in shown], "mm")
        for x_mm in COMPARED_MM
    ]
    lines.append(("force", [mesh.force_n_per_mm for mesh in shown], "N/mm"))
    ends = [_end(row) for row in rows] or [""] * len(lines)
    names = "".join(f"{mesh.name:>10}" for mesh in shown)
    heads = f"{'change':>10}{'limit':>10}" if rows else ""
    print(f"{'mesh':<22}{names}{heads}")
    counts = "".join(f"{mesh.elements:>10}" for mesh in shown)
    print(f"{'elements':<22}{counts}")
    for (quantity, values, unit), end in zip(lines, ends, strict=True):
        cells = "".join(f"{value:>10.5f}" for value in values)
        print(f"{quantity:<22}{cells}{end} {unit}")


def _end(row: dict[str, Any]) -> str:
    """The last step between meshes and the limit, if there is one."""
    limit = row["limit"]
    shown = f"{limit:>10.5f}" if limit == limit else f"{'-':>10}"
    return f"{row['change_percent']:>8.2f} %{shown}"
