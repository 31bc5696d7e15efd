"""Solve one load and unload of your own deck: then every stimulus is an interpolation.

The displacement or load of the deck goes in, out, to the other side and back. If
stress returns to the loading curve at every afferent, within 0.5 %, the folder is a
map that simulate, sweep, fit and threshold read (--response DIR). If it does not
(skin that yields, slips or relaxes, inertia), the message says why, and each waveform
is solved by build-deck --base-deck and run.

Of a deck for Marc or Abaqus the deck of this run is written. Run it with your solver,
then `fembridge map DIR --results FILE` makes the map.
"""

import argparse
from pathlib import Path
from typing import Any

from fembridge.commands import written
from fembridge.commands.build_deck import add_own_deck_options, own_deck_options
from fembridge.commands.options import Use, add_from, words_of
from fembridge.errors import UsageError
from fembridge.host.terminal import SolverBars, print_table
from fembridge.solver.settings import Solver

EXAMPLE = "fembridge map --base-deck mine.inp --afferent SA=12,15,19 -o map"

_OF_A_DECK = (
    "--afferent --afferents --depth-um --retract-um --steps --newton-per-um --mpa-per-um "
    "--amplitude --move --step --solver --length-unit --increments --shell-face"
)

USES = (
    Use(_OF_A_DECK, "--base-deck", lambda args: args.base_deck),
    Use("--results", "the folder of a map, not for --base-deck", lambda args: args.folder),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    from fembridge.simulation.deck_response import map_response

    parser.add_argument(
        "folder",
        nargs="?",
        type=Path,
        metavar="DIR",
        help="folder of a map whose run was solved elsewhere",
    )
    parser.add_argument(
        "--base-deck", metavar="FILE", help="a .inp of CalculiX or Abaqus, or a .dat of Marc"
    )
    add_from(
        parser,
        map_response,
        results=("FILE", "results of the run: .t16, .t19, .frd, .dat or a table (default: in DIR)"),
        depth_um=("UM", "largest depth of a stimulus"),
        retract_um=(
            "UM",
            "how far a stimulus may go up from the position of the deck; 0: not at all (default: "
            "--depth-um)",
        ),
        steps=("N", "loading steps"),
    )
    parser.add_argument(
        "--solver",
        dest="target",
        choices=("calculix", "abaqus"),
        help="solver of a .inp (default: as the deck shows)",
    )
    add_own_deck_options(parser, map_response)
    add_from(parser, Solver, "threads", "time_limit_s", "cache")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="DIR", help="folder of the map (default: map)"
    )
    parser.add_argument("--no-plot", action="store_true", help="draw no picture")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Make the map; the summary has its closure, or how the deck is run."""
    from fembridge.io.run_folder import RUN_FILE, read_run_folder
    from fembridge.simulation.deck_response import (
        PICTURE_FILE,
        RUN_FOLDER,
        TABLE_FILE,
        finish_map,
        how_to_solve,
        map_deck,
    )

    if (args.folder is None) == (args.base_deck is None):
        raise UsageError("needs a deck, or the folder of a map", argument="base_deck")
    if args.base_deck is not None:
        output = args.output or Path("map")
        options = {**words_of(args, map_deck), **own_deck_options(args), "output": output}
        built = map_deck(**options)
        how = how_to_solve(built)
        if how is not None:
            print(f"{built.folder}  {built.increments} increments of {built.dt_ms:g} ms")
            print(f"{how}; then: fembridge map {output} --results FILE")
            return {"run": built.folder, "solver": built.solver, "increments": built.increments}
    else:
        in_run = (args.folder / RUN_FILE).is_file()
        built = read_run_folder(args.folder if in_run else args.folder / RUN_FOLDER)
        output = args.output or (args.folder.parent if in_run else args.folder)
    with SolverBars() as bars:
        settings = Solver(**words_of(args, Solver), on_progress=bars)
        mapped = finish_map(built, output, args.results, settings)
    if not args.no_plot:
        mapped.write(output, plot=True)
    response, peaks_pa = mapped.response, mapped.peaks_pa
    print_table(
        ["afferent", "unit", "  node", "  peak kPa"],
        [
            [site.afferent, site.unit, f"{site.node:>6}", f"{peak_pa / 1e3:.3g}"]
            for site, peak_pa in zip(response.places, peaks_pa, strict=True)
        ],
        text_columns=2,
        rest=TABLE_FILE,
    )
    files = [TABLE_FILE, *[PICTURE_FILE] * (not args.no_plot)]
    return {
        **written(output, files),
        "map": output,
        "solver": built.solver,
        "depth_um": [float(response.depth_um[0]), response.deepest_um],
        "load": None if response.load is None else response.load.quantity,
        "closure_percent": response.closure_percent,
        "interpolation_percent": response.origin["interpolation_percent"],
        "afferents": [
            {
                "afferent": site.afferent,
                "unit": site.unit,
                "node": site.node,
                "peak_pa": float(peak_pa),
            }
            for site, peak_pa in zip(response.places, peaks_pa, strict=True)
        ],
    }
