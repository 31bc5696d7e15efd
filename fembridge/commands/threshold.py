"""Threshold amplitudes of each afferent class against vibration frequency.

For each frequency: the smallest zero-to-peak amplitude with an impulse, and that of one
impulse per cycle, of the median cell of a class. Uses a stored response and takes
seconds. Files: thresholds.csv, thresholds.toml, and a picture with observed thresholds.
"""

import argparse
from typing import TYPE_CHECKING, Any

from fembridge.commands import written
from fembridge.commands.options import (
    STORED_FINGER,
    Several,
    add_from,
    add_output_option,
    words_of,
)

if TYPE_CHECKING:
    import pandas

EXAMPLE = "fembridge threshold --afferent PC --frequencies-hz 5:800 -o threshold"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    from fembridge.fitting.thresholds import threshold

    add = parser.add_argument
    add(
        "--afferent",
        action=Several,
        choices=("SA", "RA", "PC"),
        default=["SA", "RA", "PC"],
        help="default: all",
    )
    add(
        "--frequencies-hz",
        action=Several,
        default=["2:800"],
        metavar="LOW:HIGH|F,F,...",
        help="third octaves of a range, or frequencies, from 2 to 800 (default: 2:800)",
    )
    depth = "depth of the probe before time 0 (default: as in the fit of the parameters)"
    add_from(parser, threshold, "parameters", preindent_um=("DEPTH", depth))
    stress = parser.add_mutually_exclusive_group()
    add_from(stress, threshold, "response", finger=STORED_FINGER)
    add_from(parser, threshold, "unit")
    add(
        "--thresholds",
        metavar="NAME|FILE.csv",
        default="thresholds_freeman_johnson_1982",
        help="observed thresholds for the picture: a table "
        "afferent,criterion,frequency_hz,amplitude_um (default: %(default)s)",
    )
    add_output_option(parser, default="threshold")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Compute, print and write; the summary holds the table."""
    from fembridge.fitting.thresholds import PICTURE_FILE, RECORD_FILE, TABLE_FILE, threshold

    args.frequencies_hz = ",".join(args.frequencies_hz)
    result = threshold(args.afferent, **words_of(args, threshold))
    _print_table(result.table)
    return {
        **written(args.output, [PICTURE_FILE, RECORD_FILE, TABLE_FILE]),
        "parameters": args.parameters,
        "thresholds": result.table.to_dict("records"),
    }


def _print_table(table: "pandas.DataFrame") -> None:
    labels = {"absolute": "first", "one_impulse_a_cycle": "1/cycle"}
    columns = table["afferent"] + " " + table["criterion"].map(labels)
    labelled = table.assign(Hz=table["frequency_hz"], column=columns)
    wide = labelled.pivot_table("amplitude_um", "Hz", "column", sort=False, dropna=False)
    print("amplitudes in um, zero-to-peak")
    print(wide.reset_index().to_string(index=False, na_rep="-", float_format="{:.3g}".format))
