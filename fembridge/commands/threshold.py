"""How faint a vibration each afferent answers, against frequency.

For every frequency: the amplitude (zero-to-peak) of the first impulse, and that of one
impulse a cycle, of the median cell of a class, by a stored response in seconds.
Written are thresholds.csv and a picture, with published thresholds in it.
"""

import argparse
from typing import TYPE_CHECKING, Any

from fembridge.commands import Content, write_files, written
from fembridge.commands.options import (
    STORED_FINGER,
    Several,
    add_from,
    add_output_option,
    words_of,
)

if TYPE_CHECKING:
    import pandas

EXAMPLE = "fembridge threshold --afferent PC --hz 5:800 -o threshold"

TABLE_FILE, PICTURE_FILE = "thresholds.csv", "thresholds.png"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    from fembridge import api

    add = parser.add_argument
    add(
        "--afferent",
        action=Several,
        choices=("SA", "RA", "PC"),
        default=["SA", "RA", "PC"],
        help="default: all",
    )
    add(
        "--hz",
        action=Several,
        default=["2:800"],
        metavar="LOW:HIGH|F,F,...",
        help="third octaves of a range, or frequencies, from 2 to 800 (default: 2:800)",
    )
    depth = "depth of the probe before time 0 (default: that of the parameters' fit)"
    add_from(parser, api.thresholds, "parameters", preindent_um=("DEPTH", depth))
    stress = parser.add_mutually_exclusive_group()
    add_from(stress, api.thresholds, "response", finger=STORED_FINGER)
    add(
        "--thresholds",
        metavar="NAME|FILE.csv",
        default="thresholds_freeman_johnson_1982",
        help="observed ones to show beside them: a table "
        "afferent,criterion,frequency_hz,amplitude_um (default: %(default)s)",
    )
    add_output_option(parser, default="threshold")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Compute, print and write; the summary holds the table."""
    from fembridge import api
    from fembridge.evidence import THRESHOLDS, read_evidence
    from fembridge.plots.rates import thresholds_figure
    from fembridge.tables import write_table

    observed = read_evidence(args.thresholds, THRESHOLDS).table
    args.hz = ",".join(args.hz)
    found = api.thresholds(args.afferent, **words_of(args, api.thresholds))
    rows = found.to_numpy().tolist()
    files: dict[str, Content] = {
        PICTURE_FILE: thresholds_figure(found, observed),
        TABLE_FILE: lambda path: write_table(path, list(found.columns), rows),
    }
    write_files(args.output, files)
    _print(found)
    return {
        **written(args.output, list(files)),
        "parameters": args.parameters,
        "thresholds": found.to_dict("records"),
    }


def _print(found: "pandas.DataFrame") -> None:
    words = {"absolute": "first", "one_impulse_a_cycle": "1/cycle"}
    found = found.assign(
        Hz=found["frequency_hz"], of=found["afferent"] + " " + found["criterion"].map(words)
    )
    table = found.pivot_table("amplitude_um", "Hz", "of", sort=False, dropna=False)
    print("amplitudes in um, zero-to-peak")
    print(table.reset_index().to_string(index=False, na_rep="-", float_format="{:.3g}".format))
