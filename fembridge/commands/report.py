"""Write a report of a run: one HTML page without scripts.

Takes a run folder (of build-deck, solved or not, also of your own deck), the folder of simulate or
touch, a response map, or the file of a pad. The page has the model, its mesh with the
afferents, what drives it, closure, stress, spikes, checks, and the commands that repeat it.
The exit code is 1 when a check failed.
"""

import argparse
from pathlib import Path
from typing import Any

EXAMPLE = "fembridge report runs/sine_20_250"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    parser.add_argument(
        "folder", type=Path, metavar="DIR|FILE", help="run folder, simulation, touch, map or pad"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FILE.html",
        help="the page (default: report.html in the folder)",
    )


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Write the page; the summary has the checks."""
    from fembridge.reporting.folder_report import report

    result = report(args.folder)
    page = result.write(args.output)
    checks = result.checks.to_dict("records")
    for row in checks:
        print(f"{row['verdict']:6} {row['check']}: {row['finding']}")
    print(page)
    return {
        "page": page,
        "kind": result.kind,
        "checks": checks,
        "exit_code": int(not result.passed),
    }
