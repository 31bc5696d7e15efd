"""The command line: one verb for each arrow of the pipeline, one verb for all.

A verb is a module of ``fembridge.commands`` with two functions:
``add_arguments(parser)`` and ``run(args) -> Summary``. Only the verb that was
asked for is imported, so ``fembridge --help`` costs next to nothing.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from importlib import import_module
from types import ModuleType

from fembridge.errors import FembridgeError

VERBS = {
    "stimuli": "list the stimuli of the catalogue, or export one",
    "build-deck": "write a solver deck for each stimulus",
    "run": "run CalculiX in run folders",
    "ingest": "take stress traces from a solver's results",
    "encode": "turn stress traces into spikes and rates",
    "simulate": "from a stimulus to spikes: all of the above",
    "plot": "draw the mesh, a response, a raster",
    "doctor": "tell what is installed and what is missing",
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb; give the exit code: 0, 1 (our error) or 2 (misuse)."""
    words = list(sys.argv[1:] if argv is None else argv)
    parser, command = _parser(words)
    args = parser.parse_args(words)
    if command is None:
        parser.print_help()
        return 0
    try:
        summary = command.run(args)
    except FembridgeError as error:
        print(f"fembridge: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("fembridge: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        sys.stderr.close()
        return 0
    if args.json:
        print(json.dumps(summary, indent=2, allow_nan=False))
    return 0


def _parser(words: Sequence[str]) -> tuple[argparse.ArgumentParser, ModuleType | None]:
    parser = argparse.ArgumentParser(
        prog="fembridge",
        description="From a probe on a fingertip to the spikes of its afferents.",
        epilog="fembridge VERB --help tells more, with an example.",
    )
    parser.add_argument("--version", action="store_true", help="tell the version")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB")
    asked = next((word for word in words if not word.startswith("-")), None)
    command = None
    for verb, help_line in VERBS.items():
        if verb != asked:
            verbs.add_parser(verb, help=help_line)
            continue
        command = import_module(f"fembridge.commands.{verb.replace('-', '_')}")
        child = verbs.add_parser(
            verb,
            help=help_line,
            description=command.__doc__,
            epilog=f"example: {command.EXAMPLE}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        command.add_arguments(child)
        child.add_argument(
            "--json", action="store_true", help="print a summary a program can read"
        )
    return parser, command


if __name__ == "__main__":
    sys.exit(main())
