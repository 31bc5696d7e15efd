"""Make the paper's figures and tables again, as one page to read and to check.

The page is DIR/index.html and needs nothing beside it; its numbers lie there as CSV,
its figures as SVG. Works on the stored response, so without a solver. With observed
rates the page says how good the model is; without, only how similar to TouchSim it is.
"""

import argparse
import shlex
from typing import TYPE_CHECKING, Any

from fembridge.commands.options import add_from, add_output_option, words_of
from fembridge.terminal import Notes, print_table

if TYPE_CHECKING:
    from fembridge.report.validate import Validation

EXAMPLE = "fembridge validate -o report"

_FOLDER = "report"
_FILES = ("response", "observed", "thresholds", "spikes", "impulses", "distance")
# The parameters are neural.parameter_sets.DEFAULT_SET, which takes NumPy to import.
_DEFAULTS = {"finger": "quick", "parameters": "fitted"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    from fembridge import api

    add_output_option(parser, default=_FOLDER)
    parser.add_argument(
        "--observed",
        metavar="RATES.csv",
        help="rates to judge by: a table stimulus,afferent,rate_ips with any of the 82 "
        "stimuli and of SA, RA, PC",
    )
    skin = parser.add_mutually_exclusive_group()
    skin.add_argument(
        "--finger",
        default=_DEFAULTS["finger"],
        metavar="quick|paper|FILE.toml",
        help="3 100 or 17 702 elements, or a finger of your own, which is solved "
        "(default: %(default)s)",
    )
    add_from(skin, api.validate, "response")
    parser.add_argument(
        "--parameters",
        default=_DEFAULTS["parameters"],
        metavar="NAME|FILE.toml",
        help="the model to compare: published, fitted or a file; the published one is "
        "shown beside it (default: %(default)s)",
    )
    parser.add_argument(
        "--thresholds",
        metavar="FILE.csv",
        help="thresholds to show in the place of the published ones: a table "
        "afferent,criterion,frequency_hz,amplitude_um",
    )
    parser.add_argument(
        "--spikes",
        metavar="FILE.csv",
        help="recorded spikes under sinusoids, for timing, in the place of the published: a "
        "table stimulus,afferent,repeat,spike_time_ms",
    )
    for name, columns in (
        ("impulses", "afferent,frequency_hz,amplitude_um,impulses_per_cycle"),
        ("distance", "distance_mm,amplitude_um"),
    ):
        words = f"the same of {name}: a table {columns}; lines with # are its source"
        parser.add_argument(f"--{name}", metavar="FILE.csv", help=words)


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Compute and write; the summary holds the agreement of all families."""
    from fembridge import api
    from fembridge.report.validation_page import PAGE, write_report
    from fembridge.store import check_output

    notes = Notes()
    check_output(args.output, PAGE)
    study = api.validate(**{**words_of(args, api.validate), "output": None}, log=notes)
    files = write_report(args.output, study, command_line(args))
    rows = _rows(study)
    _print_rows(study, rows)
    print(f"{args.output / PAGE}, and {len(files) - 1} files beside it")
    return {
        "output": args.output,
        "page": args.output / PAGE,
        "finger": study.finger,
        "judged": study.judged.name,
        "models": [model.name for model in study.models],
        "reference": study.rates.reference(),
        "notes": notes,
        "agreement": rows,
        "files": list(files),
    }


def command_line(args: argparse.Namespace) -> str:
    """Line that does the same again; of an absolute path the name."""
    from pathlib import Path

    words = ["fembridge", "validate", "-o", str(args.output)]
    for name in (*_FILES, *_DEFAULTS):
        if (word := getattr(args, name)) != _DEFAULTS.get(name):
            words += [f"--{name}", Path(word).name if Path(word).is_absolute() else word]
    return shlex.join(words)


def _rows(study: "Validation") -> list[dict[str, Any]]:
    """Agreement of every source over whole families."""
    from fembridge.report.rates import EVERY_SET, NUMBERS

    names = ("reference", "source", "family", "afferent", "meets_paper")
    whole = study.agreement[study.agreement["set"] == EVERY_SET].to_dict("records")
    return [
        {str(name): row[name] for name in (*names, *(NUMBERS if row["count"] else NUMBERS[:1]))}
        for row in whole
    ]


def _print_rows(study: "Validation", rows: list[dict[str, Any]]) -> None:
    """Print a row a family, a column a class: R² and RMSE of the judged model."""
    against = "observed rates" if study.observed is not None else "TouchSim, a model"
    print(f"{study.judged.name} against {against}: R² (RMSE in impulses/s)")
    judged = (study.rates.reference(), study.judged.name)
    lines: dict[str, list[str]] = {}
    for row in rows:
        if (row["reference"], row["source"]) == judged:
            share = "-" if row.get("r_squared") != row.get("r_squared") else "{r_squared:.2f}"
            cell = f"{share} ({{rmse_ips:.1f}})" if row["count"] else "no rates"
            lines.setdefault(row["family"], [row["family"]]).append(cell.format(**row))
    print_table(["", "SA", "RA", "PC"], list(lines.values()))
