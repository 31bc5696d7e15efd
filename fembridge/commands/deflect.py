"""Deflection of the skin around a 50 um probe that is pressed 1 mm deep.

The paper's check of its finger, Fig. 2c. The default draws the stored profiles of several
meshes; --solver run solves a profile, which requires ccx and one to ten minutes. Files:
profiles as a table, a picture, and a record.
"""

import argparse
from typing import TYPE_CHECKING, Any

from fembridge.commands import written
from fembridge.commands.options import NUMBERS, Use, add_from, add_output_option, words_of
from fembridge.host.terminal import SolverBars, print_table
from fembridge.solver.settings import Solver

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fembridge.response.deflection import Deflection

EXAMPLE = "fembridge deflect -o deflection"

USES = (
    Use(
        "--depth-mm --threads --time-limit --no-cache",
        "--solver run",
        lambda args: args.solver == "run",
    ),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    parser.add_argument(
        "--finger",
        metavar="NAME|FILE.toml",
        help="quick, medium, paper, fine, or a file with --solver run (default: all stored "
        "profiles; quick with --solver run)",
    )
    source = parser.add_mutually_exclusive_group()
    source.add_argument(
        "--solver", choices=("run",), help="solve it, and compare with the stored profile"
    )
    source.add_argument("--stored", action="store_true", help="use the stored profiles (default)")
    parser.add_argument(
        "--depth-mm",
        type=NUMBERS["depth_mm"],
        metavar="D",
        help="depth of the probe, with --solver run (default: 1)",
    )
    add_from(parser, Solver, "threads", "time_limit_s", "cache")
    add_output_option(parser, default="deflection")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Read or solve the profiles, write them; the summary holds them."""
    from fembridge.reporting.deflect import PICTURE_FILE, RECORD_FILE, TABLE_FILE, deflect

    options = {} if args.depth_mm is None else {"depth_mm": args.depth_mm}
    with SolverBars() as bars:
        result = deflect(
            args.finger,
            stored=args.solver is None,
            solver=Solver(**words_of(args, Solver), on_progress=bars),
            output=args.output,
            **options,
        )
    meshes = list(result.meshes.values())
    _print_table(meshes, result.convergence)
    return {
        **written(args.output, [PICTURE_FILE, RECORD_FILE, TABLE_FILE]),
        "source": "stored" if args.solver is None else "solved",
        "depth_mm": meshes[0].depth_mm,
        "meshes": [
            {
                "mesh": mesh.name,
                "elements": mesh.elements,
                "force_n_per_mm": mesh.force_n_per_mm,
                "sha256": mesh.origin.get("mesh_sha256"),
            }
            for mesh in meshes
        ],
        "convergence": result.convergence,
    }


def _print_table(shown: "Sequence[Deflection]", rows: list[dict[str, Any]]) -> None:
    """Print a column per mesh; for several also the last change, and the limit if any."""
    from fembridge.response.deflection import COMPARED_MM

    ends: list[list[str]] = [[] for _ in range(len(COMPARED_MM) + 3)]
    if rows:
        ends = [["change", "limit"], ["", ""]]
        for row in rows:
            limit = "-" if row["limit"] != row["limit"] else f"{row['limit']:.5f}"
            ends.append([f"{row['change_percent']:.2f} %", limit])
    lines = [
        ["mesh", *(mesh.name for mesh in shown), ""],
        ["elements", *(str(mesh.elements) for mesh in shown), ""],
        *(
            [f"deflection at {x_mm:g} mm", *(f"{float(mesh.at(x_mm)):.5f}" for mesh in shown), "mm"]
            for x_mm in COMPARED_MM
        ),
        ["force", *(f"{mesh.force_n_per_mm:.5f}" for mesh in shown), "N/mm"],
    ]
    head, *body = ([*line[:-1], *end, line[-1]] for line, end in zip(lines, ends, strict=True))
    print_table(head, body)
