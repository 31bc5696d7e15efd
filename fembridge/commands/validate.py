"""Make the paper's figures and tables again, as one page to read and to check.

The page is DIR/index.html and needs nothing beside it; its numbers lie there as CSV,
its figures as SVG. Works on the stored response, so without a solver. With observed
rates the page tells how good the model is; without, only how like TouchSim it is.
"""

import argparse
import shlex
import sys
from typing import TYPE_CHECKING, Any

from fembridge.commands.model_options import add_output_option

if TYPE_CHECKING:
    from fembridge.validation.study import Study

EXAMPLE = "fembridge validate -o report"

_FOLDER = "report"
_FINGER = "quick"
_PARAMETERS = "fitted"  # neural.sets.DEFAULT_SET, which takes NumPy to import


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    add_output_option(parser, default=_FOLDER)
    parser.add_argument(
        "--observed",
        metavar="RATES.csv",
        help="rates to judge by: a table stimulus,afferent,rate_ips with any of the 82 "
        "stimuli and of SA, RA, PC",
    )
    parser.add_argument(
        "--finger",
        choices=("quick", "paper"),
        default=_FINGER,
        help=f"3 100 or 17 702 elements (default: {_FINGER})",
    )
    parser.add_argument(
        "--parameters",
        default=_PARAMETERS,
        metavar="NAME|FILE.toml",
        help="the model to judge: published, fitted or a file; the published one is "
        f"shown beside it (default: {_PARAMETERS})",
    )


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Compute and write; the summary holds the agreement of all families."""
    from pathlib import Path

    from decks.finger_file import read_finger
    from fembridge.observed import read_observed
    from fembridge.validation.judged_model import judged_models
    from fembridge.validation.report import PAGE, write_report
    from fembridge.validation.study import validate

    notes: list[str] = []

    def tell(line: str) -> None:
        notes.append(line)
        print(line, file=sys.stderr)

    observed = None
    if args.observed is not None:
        observed = read_observed(Path(args.observed), complete=False)
    models = judged_models(args.parameters)
    study = validate(read_finger(args.finger), models, observed, tell)
    output = Path(args.output)
    files = write_report(output, study, command_line(args))
    rows = _rows(study)
    if not args.json:
        _print_rows(study, rows)
        print(f"{output / PAGE}, and {len(files) - 1} files beside it")
    return {
        "output": args.output,
        "page": str(output / PAGE),
        "finger": study.finger,
        "judged": study.judged.name,
        "models": [model.name for model in study.models],
        "reference": study.reference,
        "notes": notes,
        "agreement": rows,
        "files": list(files),
    }


def command_line(args: argparse.Namespace) -> str:
    """Give the line that does the same again."""
    words = ["fembridge", "validate", "-o", str(args.output)]
    if args.observed is not None:
        words += ["--observed", _without_machine(args.observed)]
    if args.finger != _FINGER:
        words += ["--finger", args.finger]
    if args.parameters != _PARAMETERS:
        words += ["--parameters", args.parameters]
    return shlex.join(words)


def _without_machine(word: str) -> str:
    """Give the name alone of a file whose whole path was typed."""
    from pathlib import Path

    return Path(word).name if Path(word).is_absolute() else word


def _rows(study: "Study") -> list[dict[str, Any]]:
    """Give the agreement of every source over whole families."""
    from fembridge.validation.agreement_cell import EVERY_SET

    return [
        {
            "reference": cell.reference,
            "source": cell.source,
            "family": cell.family,
            "afferent": cell.afferent,
            "meets_paper": cell.meets_paper,
            **({"count": 0} if cell.agreement is None else cell.agreement.to_row()),
        }
        for cell in study.cells
        if cell.set == EVERY_SET
    ]


def _print_rows(study: "Study", rows: list[dict[str, Any]]) -> None:
    told = "observed rates" if study.observed is not None else "TouchSim, a model"
    print(f"{study.judged.name} against {told}: R² (RMSE in impulses/s)")
    print(f"{'':<8}{'SA':>16}{'RA':>16}{'PC':>16}")
    mine = [
        row
        for row in rows
        if (row["reference"], row["source"]) == (study.reference, study.judged.name)
    ]
    for family in dict.fromkeys(row["family"] for row in mine):
        cells = [_cell(row) for row in mine if row["family"] == family]
        print(f"{family:<8}{''.join(f'{cell:>16}' for cell in cells)}")


def _cell(row: dict[str, Any]) -> str:
    if not row["count"]:
        return "no rates"
    share = row["r_squared"]
    told = "-" if share != share else f"{share:.2f}"
    return f"{told} ({row['rmse_ips']:.1f})"
