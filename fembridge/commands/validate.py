"""Compare a model with the paper's figures and tables, on one page.

The page is DIR/index.html; its numbers are beside it as CSV, its figures as SVG. It uses
the stored response, so no solver is required. With observed rates the page shows how good
the model is; without, only how similar to TouchSim it is.
"""

import argparse
import shlex
from typing import TYPE_CHECKING, Any

from fembridge.commands.options import (
    add_from,
    add_output_option,
    add_pad_probe_options,
    option,
    pad_probe_from,
    pad_probe_use,
    words_of,
)
from fembridge.host.terminal import print_table

if TYPE_CHECKING:
    from fembridge.reporting.validation import Validation
    from fembridge.reporting.validation_data import ValidationData

EXAMPLE = "fembridge validate -o report"

_FOLDER = "report"
_FILES = (
    *("response", "pad", "shape", "ridges", "observed", "recorded", "thresholds", "spikes"),
    *("impulses", "distance", "finger", "parameters"),
)
_NUMBERS = ("positions", "deepest_um")
_DEFAULTS = {"finger": "quick", "shape": "punch", "positions": 3, "deepest_um": 600.0}
USES = (pad_probe_use(),)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    from fembridge.reporting.validation import validate

    add_output_option(parser, default=_FOLDER)
    parser.add_argument(
        "--observed",
        metavar="RATES.csv",
        help="observed rates: a table stimulus,afferent,rate_ips with any of the 82 stimuli and "
        "of SA, RA, PC",
    )
    parser.add_argument(
        "--recorded",
        metavar="FOLDER",
        help="recorded responses: tables of rates, ramps, textures, bars and fields, recognised by "
        "their columns (docs/science/validation.md)",
    )
    skin = parser.add_mutually_exclusive_group()
    skin.add_argument(
        "--finger",
        default=_DEFAULTS["finger"],
        metavar="quick|paper|FILE.toml",
        help="3 100 or 17 702 elements, or a file, whose response is solved (default: %(default)s)",
    )
    add_from(skin, validate, "response")
    add_pad_probe_options(parser, skin)
    parser.add_argument(
        "--parameters",
        metavar="NAME|FILE.toml",
        help="model to judge: published, fitted, fitted_pad or a file; the page also shows the "
        "published model (default: fitted; with --pad fitted_pad)",
    )
    parser.add_argument(
        "--thresholds",
        metavar="FILE.csv",
        help="thresholds instead of the published ones: a table "
        "afferent,criterion,frequency_hz,amplitude_um",
    )
    parser.add_argument(
        "--spikes",
        metavar="FILE.csv",
        help="recorded spikes under sinusoids, for timing, instead of the published: a "
        "table stimulus,afferent,trial,spike_time_ms",
    )
    for name, columns in (
        ("impulses", "afferent,frequency_hz,amplitude_um,impulses_per_cycle"),
        ("distance", "distance_mm,amplitude_um"),
    ):
        description = f"{name} instead of the published: a table {columns}; # lines: its source"
        parser.add_argument(f"--{name}", metavar="FILE.csv", help=description)


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Compute and write; the summary holds the agreement of all families."""
    from fembridge.host.store import check_output
    from fembridge.reporting.validation import EVIDENCE_SETS, validate
    from fembridge.reporting.validation_page import PAGE

    check_output(args.output, PAGE)
    tables = {name: getattr(args, name) for name in (*EVIDENCE_SETS, "spikes")}
    evidence = {name: path for name, path in tables.items() if path is not None}
    arguments = {**words_of(args, validate), "output": None, "pad": pad_probe_from(args)}
    result = validate(**arguments, evidence=evidence)
    files = result.write(args.output, command_line(args))
    assert result.data is not None
    rows = _rows(result.data)
    _print_rows(result, rows)
    print(f"{args.output / PAGE}, and {len(files) - 1} files beside it")
    return {
        "output": args.output,
        "page": args.output / PAGE,
        "finger": result.finger,
        "judged": result.judged,
        "models": [model.name for model in result.data.models],
        "reference": result.reference,
        "agreement": rows,
        "files": list(files),
    }


def command_line(args: argparse.Namespace) -> str:
    """Command line that makes the page again; absolute paths without folders."""
    from pathlib import Path

    parts = ["fembridge", "validate", "-o", str(args.output)]
    for name in (*_FILES, *_NUMBERS):
        if (value := getattr(args, name)) != _DEFAULTS.get(name):
            parts.append(option(name))
            parts.append(Path(value).name if Path(str(value)).is_absolute() else str(value))
    if any(args.at_mm):
        parts += ["--at-mm", *(f"{value:g}" for value in args.at_mm)]
    return shlex.join(parts)


def _rows(data: "ValidationData") -> list[dict[str, Any]]:
    """Agreement of every source over whole families."""
    from fembridge.reporting.rate_tables import AGREEMENT_COLUMNS, ALL_SETS

    names = ("reference", "source", "family", "afferent", "meets_paper")
    families = data.agreement[data.agreement["set"] == ALL_SETS].to_dict("records")
    return [
        {
            str(name): row[name]
            for name in (*names, *(AGREEMENT_COLUMNS if row["count"] else AGREEMENT_COLUMNS[:1]))
        }
        for row in families
    ]


def _print_rows(result: "Validation", rows: list[dict[str, Any]]) -> None:
    """Print a row per family and a column per class: R² and RMSE of the judged model."""
    against = "TouchSim, a model" if result.reference == "TouchSim" else "observed rates"
    print(f"{result.judged} against {against}: R² (RMSE in impulses/s)")
    judged = (result.reference, result.judged)
    lines: dict[str, list[str]] = {}
    for row in rows:
        if (row["reference"], row["source"]) == judged:
            share = "-" if row.get("r_squared") != row.get("r_squared") else "{r_squared:.2f}"
            cell = f"{share} ({{rmse_ips:.1f}})" if row["count"] else "no rates"
            lines.setdefault(row["family"], [row["family"]]).append(cell.format(**row))
    print_table(["", "SA", "RA", "PC"], list(lines.values()))
