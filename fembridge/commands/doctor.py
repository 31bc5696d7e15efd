"""List what is installed, what is missing, and the line that installs it.

"ok" is as it should be. "note" is absent or odd, and only some verbs care: the
stored response needs neither CalculiX nor gmsh. "missing" keeps even that from
working; with one of those the exit code is 1.
"""

import argparse
from typing import Any

EXAMPLE = "fembridge doctor"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare nothing: the doctor looks at everything there is."""


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Examine the machine; `exit_code` is 1 when something needed is missing."""
    from fembridge.host.machine import examine
    from fembridge.version import __version__

    checks = examine(__version__)
    missing = [check.name for check in checks if check.state == "missing"]
    for check in checks:
        print(f"{check.state:<8} {check.name:<11} {check.finding}")
        if check.remedy:
            print(f"{'':<20} -> {check.remedy}")
    return {
        "ok": not missing,
        "missing": missing,
        "checks": [check._asdict() for check in checks],
        "exit_code": 1 if missing else 0,
    }
