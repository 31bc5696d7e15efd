"""Press a 50 um probe 1 mm into the finger: how far the skin around goes down.

The paper's check of its finger, Fig. 2c. What was solved once on several meshes is
stored and drawn by default; --solver run solves it here, which takes ccx and one to
ten minutes. Profiles are written to the output folder as a table and a picture.
"""

import argparse
from typing import TYPE_CHECKING, Any

from fembridge.commands import Content, write_files, written
from fembridge.commands.options import NUMBERS, Use, add_from, add_output_option, words_of
from fembridge.solver.settings import SolverSettings
from fembridge.terminal import SolverBars, log, print_table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fembridge.response.deflection import Deflection

EXAMPLE = "fembridge deflect -o deflection"

TABLE_FILE = "deflection.csv"
PICTURE_FILE = "deflection.png"

USES = (
    Use(
        "--depth-mm --threads --time-limit --no-cache",
        "--solver run",
        lambda args: args.solver == "run",
    ),
)


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
        "--depth-mm",
        type=NUMBERS["depth_mm"],
        metavar="D",
        help="how deep, where it is solved (default: 1)",
    )
    add_from(parser, SolverSettings, "threads", "time_limit_s", "cache")
    add_output_option(parser, default="deflection")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Read or solve the profiles, write them; the summary holds them."""
    import numpy as np

    from fembridge.plots.response import deflection_figure
    from fembridge.response.deflection import convergence, stored_deflection, stored_deflections
    from fembridge.store import check_output
    from fembridge.tables import write_table

    if args.solver is not None:
        check_output(args.output, TABLE_FILE, PICTURE_FILE)
        shown = [_solved(args)]
    else:
        shown = [stored_deflection(args.finger)] if args.finger else list(stored_deflections())
    profile = [
        (mesh.name, *row)
        for mesh in shown
        for row in np.stack([mesh.distance_mm, mesh.deflection_mm], axis=1).tolist()
    ]
    columns = ("mesh", "distance_mm", "deflection_mm")
    rows = convergence(shown) if len(shown) > 1 else []
    files: dict[str, Content] = {
        PICTURE_FILE: deflection_figure(shown),
        TABLE_FILE: lambda path: write_table(path, columns, profile),
    }
    write_files(args.output, files)
    _print_table(shown, rows)
    return {
        **written(args.output, list(files)),
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


def _solved(args: argparse.Namespace) -> "Deflection":
    from decks.presets import read_finger
    from fembridge.response.deflection import (
        DEPTH_MM,
        FINGERS,
        press_of,
        solve_deflection,
        stored_deflections,
    )

    depth_mm = DEPTH_MM if args.depth_mm is None else args.depth_mm
    finger = FINGERS.get(args.finger or "quick") or read_finger(args.finger)
    with SolverBars() as bars:
        settings = SolverSettings(**words_of(args, SolverSettings), on_progress=bars)
        solved = solve_deflection(args.output / "run", press_of(finger), depth_mm, settings)
    for stored in stored_deflections():
        same_mesh = stored.origin.get("mesh_sha256") == solved.origin["mesh_sha256"]
        if same_mesh and stored.depth_mm == solved.depth_mm:
            differ_um = 1000.0 * abs(solved.deflection_mm - stored.deflection_mm).max()
            log(f"solved here and stored differ by {differ_um:.2g} um at most")
    return solved


def _print_table(shown: "Sequence[Deflection]", rows: list[dict[str, Any]]) -> None:
    """A column a mesh; of several also the last step between two, and the limit if there is one."""
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
