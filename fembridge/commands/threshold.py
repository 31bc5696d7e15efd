"""Threshold amplitudes of each afferent class against vibration frequency.

For each frequency: the smallest zero-to-peak amplitude with an impulse, and that of one
impulse per cycle, of the median cell of a class; of a probe on a pad also the force of the
probe. Uses a stored response or a pad and takes seconds. Files: thresholds.csv,
thresholds.toml, and a picture with observed thresholds.
"""

import argparse
from typing import TYPE_CHECKING, Any

from fembridge.commands import written
from fembridge.commands.options import (
    STORED_FINGER,
    Several,
    add_from,
    add_output_option,
    add_pad_probe_options,
    pad_probe_from,
    pad_probe_use,
    words_of,
)

if TYPE_CHECKING:
    import pandas

EXAMPLE = "fembridge threshold --afferent PC --frequencies-hz 5:800 -o threshold"

USES = (pad_probe_use(),)


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
    parameters = "set's name or a TOML file (default: fitted; with --pad fitted_pad)"
    add_from(parser, threshold, parameters=("NAME", parameters), preindent_um=("DEPTH", depth))
    stress = parser.add_mutually_exclusive_group()
    add_from(stress, threshold, "response", finger=STORED_FINGER)
    add_pad_probe_options(parser, stress)
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
    result = threshold(args.afferent, **{**words_of(args, threshold), "pad": pad_probe_from(args)})
    _print_table(result.table)
    return {
        **written(args.output, [PICTURE_FILE, RECORD_FILE, TABLE_FILE]),
        "parameters": result.provenance["parameters"]["name"],
        "thresholds": result.table.to_dict("records"),
    }


def _print_table(table: "pandas.DataFrame") -> None:
    labels = {"absolute": "first", "one_impulse_a_cycle": "1/cycle"}
    columns = table["afferent"] + " " + table["criterion"].map(labels)
    labelled = table.assign(Hz=table["frequency_hz"], column=columns)
    quantities = {
        "amplitude_um": "amplitudes in um, zero-to-peak",
        "force_mn": "force of the probe at its deepest, in mN",
        "force_amplitude_mn": "by how much that is above the force of the pre-indentation, in mN",
    }
    for name, title in quantities.items():
        if name in table:
            wide = labelled.pivot_table(name, "Hz", "column", sort=False, dropna=False)
            text = wide.reset_index()
            print(title)
            print(text.to_string(index=False, na_rep="-", float_format="{:.3g}".format))
