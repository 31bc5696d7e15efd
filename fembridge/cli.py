"""The command line: one verb for each arrow of the pipeline, one verb for all.

A verb is a module of ``fembridge.commands`` with a docstring, an ``EXAMPLE`` and
two functions: ``add_arguments(parser)`` and ``run(args) -> summary``. Only the
verb that was asked for is imported, so ``fembridge --help`` costs next to nothing.

A summary is a dict; ``--json`` prints it as strict JSON, where a number that is
not finite becomes null. Its ``exit_code``, if it has one, is the exit code: for
a verb that did its work and found that not all is well.
"""

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from errno import ENOSPC
from importlib import import_module
from io import TextIOWrapper
from types import ModuleType
from typing import TextIO

from fembridge import __version__
from fembridge.errors import FembridgeError

VERBS = {
    "stimuli": "list the stimuli of the catalogue, or export one",
    "build-deck": "write a solver deck for each stimulus",
    "run": "run CalculiX in run folders",
    "ingest": "take stress traces from a solver's results",
    "marc-export-script": "print a script that takes traces inside Marc's Mentat",
    "encode": "turn stress traces into spikes and rates",
    "simulate": "from a stimulus to spikes: all of the above",
    "sweep": "many stimuli on many fingers: each solved once, one table",
    "fit": "find the parameters whose rates come closest to observed ones",
    "study": "compare models of the afferents, on what they were not fitted to",
    "validate": "the paper's figures and tables as one page: is the model any good",
    "verify": "hold the finite-element model against closed forms, with bounds",
    "deflect": "how far the skin goes down around a thin probe",
    "plot": "draw the mesh, a response, a raster",
    "cache": "list or clear what was solved before",
    "doctor": "list what is installed and what is missing",
}

INTERRUPTED = 130  # 128 + SIGINT, as shells have it


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb; give the exit code.

    0 is success, 1 our error, 2 misuse, 130 Ctrl-C. Anything that is not one of
    our errors is a bug of ours and keeps its traceback.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # a path may be more than ASCII
            stream.reconfigure(errors="backslashreplace")
    try:
        code = _run(list(sys.argv[1:] if argv is None else argv))
        sys.stdout.flush()
    except KeyboardInterrupt:
        print("fembridge: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        if not _reader_has_left():
            raise
        return 0
    except OSError as error:
        if error.errno != ENOSPC:  # of a file of ours it is an OutputError
            raise
        print(f"fembridge: cannot print: {error.strerror}", file=sys.stderr)
        _to_nowhere(sys.stdout)
        return 1
    return code


def _run(words: list[str]) -> int:
    try:
        parser, command = _parser(words)
        args = parser.parse_args(words)
    except SystemExit as stop:  # argparse: help, version, misuse
        return stop.code if isinstance(stop.code, int) else 0
    if command is None:
        parser.print_help()
        return 0
    try:
        summary = command.run(args)
    except FembridgeError as error:
        print("fembridge:", " ".join(str(error).splitlines()), file=sys.stderr)
        return error.exit_code
    except MemoryError:
        print("fembridge: the memory is too small for this file or request", file=sys.stderr)
        return 1
    if args.json:
        import json

        print(json.dumps(_strict(summary), indent=2, allow_nan=False))
    return int(summary.get("exit_code", 0))


def _parser(words: Sequence[str]) -> tuple[argparse.ArgumentParser, ModuleType | None]:
    width = max(map(len, VERBS))
    listed = "\n".join(f"  {verb:<{width}}  {line}" for verb, line in VERBS.items())
    parser = argparse.ArgumentParser(
        prog="fembridge",
        description="From a probe on a fingertip to the spikes of its afferents."
        f"\n\nverbs:\n{listed}",
        epilog="example: fembridge stimuli\nfembridge VERB --help says more about a verb",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"fembridge {__version__}")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", help="one of the above")
    asked = next((word for word in words if not word.startswith("-")), None)
    if asked is None:
        return parser, None
    if asked not in VERBS:
        from difflib import get_close_matches

        near = " or ".join(get_close_matches(asked, VERBS, n=2, cutoff=0.5))
        hint = f"did you mean {near}?" if near else f"choose {', '.join(VERBS)}"
        parser.error(f"no verb {asked!r}; {hint}")
    command = import_module(f"fembridge.commands.{asked.replace('-', '_')}")
    child = verbs.add_parser(
        asked,
        description=command.__doc__,
        epilog=f"example: {command.EXAMPLE}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    command.add_arguments(child)
    child.add_argument("--json", action="store_true", help="print a summary a program can read")
    return parser, command


def _strict(value: object) -> object:
    """Turn a summary into what JSON has: no NaN, no array, no path, no tuple."""
    if hasattr(value, "tolist"):  # NumPy's numbers and arrays, unimported
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _strict(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_strict(item) for item in value]
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    return None if isinstance(value, float) and value - value != 0 else value


def _reader_has_left() -> bool:
    """Whether it is our own output that nobody reads, as after ``| head -1``.

    Then what is still in the buffer is sent to nowhere, so that the interpreter
    does not complain about it at exit.
    """
    import select

    left = False
    for stream in (sys.stdout, sys.stderr):
        poll = select.poll()
        poll.register(stream.fileno(), 0)
        if any(event & (select.POLLERR | select.POLLHUP) for _, event in poll.poll(0)):
            left = True
            _to_nowhere(stream)
    return left


def _to_nowhere(stream: TextIO) -> None:
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


if __name__ == "__main__":
    sys.exit(main())
