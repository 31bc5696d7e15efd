"""Write a sample of the package: results, a deck, a signal, a waveform, rates or a study.

Without a NAME the samples are listed. Each needs neither a solver nor data of yours; the
lines printed at the end read it.
"""

import argparse
from pathlib import Path
from typing import Any

from fembridge.host.terminal import print_table

EXAMPLE = "fembridge sample frd"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the verb."""
    from fembridge.simulation.sample import FOLDER, SAMPLES

    parser.add_argument(
        "name", nargs="?", choices=tuple(SAMPLES), metavar="NAME", help=", ".join(SAMPLES)
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path(FOLDER),
        metavar="DIR",
        help=f"default: {FOLDER}",
    )


def run(args: argparse.Namespace) -> dict[str, Any]:
    """List the samples, or write one; the summary has the commands that read it."""
    import shlex

    from fembridge.simulation.sample import SAMPLES, sample

    if args.name is None:
        rows = [(name, item.contents) for name, item in SAMPLES.items()]
        print_table(("name", "contents"), rows, text_columns=2)
        return {"samples": dict(rows), "next": [EXAMPLE]}
    file = sample(args.name, args.output)
    names = {"file": shlex.quote(str(file)), "folder": shlex.quote(str(file.parent))}
    commands = [line.format(**names) for line in SAMPLES[args.name].commands]
    print(f"{file}: {SAMPLES[args.name].contents}")
    return {"output": args.output, "file": file, "next": commands}
