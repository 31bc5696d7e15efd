"""Print a script that takes stress traces inside Marc's Mentat or inside Abaqus.

Mentat's own Python has py_post, which opens any .t16 or .t19 that Mentat opens; that of
Abaqus has odbAccess, and nothing else opens an .odb. The script needs nothing more, runs in
Python 2.7 and 3.6 and later without a window, and writes the table that encode reads.
fembridge ingest reads .t16 and .t19 without Mentat; there this is the way for a file that it
refuses, and for comparing the two.
"""

import argparse
from pathlib import Path
from typing import Any

EXAMPLE = "fembridge export-script > export.py"

PRINTS_ITS_RESULT = True  # a text, which --quiet leaves


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the verb understands."""
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FILE",
        help="write the script here instead of printing it",
    )


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Print or write the script; the summary holds where it is, or the script."""
    from fembridge.host.store import write_text

    script = script_text()
    output: Path | None = args.output
    if output is not None:
        write_text(output, script)
        if not args.json:
            print(f"{output}: run it with the Python of Mentat or Abaqus; --help says how")
        return {"output": str(output)}
    if not args.json:
        print(script, end="")
    return {"output": None, "script": script}


def script_text() -> str:
    """The script as it is shipped."""
    from importlib.resources import files

    script = files("fembridge") / "results" / "export_script.py"
    return script.read_text(encoding="utf-8")
