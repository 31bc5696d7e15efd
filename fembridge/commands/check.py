"""Check your own deck before anything is solved.

Prints a page: units, parts, materials, sets, steps, the motion of the waveform,
other loads, contact, afferents, ignored cards, and the expected cost of a run. Takes a .inp
of CalculiX or Abaqus or a .dat of Marc. build-deck --base-deck makes the same checks.
If CalculiX is installed it reads the deck, without solving it. The exit code is 1
when there is a problem. A .inp without a step is a model for a pad, and no problem
unless --stimulus is given.
"""

import argparse
from pathlib import Path
from typing import Any

from fembridge.commands.build_deck import add_own_deck_options, own_deck_options
from fembridge.commands.options import add_from

EXAMPLE = "fembridge check mine.inp --move PROBE,2 --afferent SA=1184"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    from fembridge.solver.check import check

    parser.add_argument("deck", type=Path, metavar="DECK", help="a .inp, or a .dat of Marc")
    add_from(
        parser,
        check,
        stimulus=(
            "ID|FILE",
            "waveform of the trial and of the forecast (default, with a step: sine_20_250)",
        ),
        preindent_um=("UM", "depth of the probe before time 0"),
    )
    parser.add_argument(
        "--solver",
        dest="target",
        choices=("calculix", "abaqus"),
        help="solver of a .inp (default: as the deck shows)",
    )
    add_own_deck_options(parser, check)


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Print the page; the summary holds all tables and findings."""
    from fembridge.solver.check import check, text_of

    result = check(
        args.deck,
        args.stimulus,
        target=args.target,
        preindent_um=args.preindent_um,
        **own_deck_options(args),
    )
    print(*text_of(result), sep="\n")
    return {**result.to_dict(), "exit_code": int(not result.passed)}
