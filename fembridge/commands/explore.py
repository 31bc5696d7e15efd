"""Write a page that plays a finished result: touch, simulation or solved run.

The page is one HTML file that works without a network. Of a touch it shows the fingertip in three
dimensions with stress, contact pressure and the units that fire; of a simulation, and of a run
of CalculiX on our finger, the section under the probe. Play, scrub, change the speed, and
point at a unit for its name, class and rate.
"""

import argparse
from pathlib import Path
from typing import Any

EXAMPLE = "fembridge explore out"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    parser.add_argument(
        "result", type=Path, metavar="RUN", help="folder of touch or simulate, or a solved run"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FILE.html",
        help="the page (default: explore.html in the folder)",
    )


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Write the page; the summary has its path and kind."""
    from fembridge.reporting.explorer import explore

    explorer = explore(args.result)
    page = explorer.write(args.output)
    print(explorer.lead)
    print(f"{page}: open it in a browser")
    return {"page": page, "kind": explorer.kind, **explorer.facts}
