"""The command line: one verb for each arrow of the pipeline, one verb for all.

A verb is a module of ``fembridge.commands`` with a docstring, an ``EXAMPLE`` and
two functions: ``add_arguments(parser)`` and ``run(args) -> summary``; ``USES`` lists options
that only some ways of the verb use. Only the verb that was asked for is imported, so
``fembridge --help`` costs next to nothing.

What a verb prints is for people. A summary is a dict; ``--json`` prints it alone, as
strict JSON, where a number that is not finite becomes null, with its ``warnings`` and its
``exit_code``. A
verb that did its work and found that not all is well says so by an ``exit_code`` of its
own. An error is a line on stderr, and with ``--json`` also ``{"error": {"kind",
"message"}, "exit_code"}``.

What each verb writes, its files and every column of a table, has one place: ``outputs.md``
of the verbs, a page for people, which is read here for ``--help``. A name in angle brackets
there stands for columns that differ from case to case.
"""

import argparse
import errno
import os
import re
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, redirect_stderr, redirect_stdout
from importlib import import_module
from io import StringIO, TextIOWrapper
from pathlib import Path
from types import ModuleType
from typing import Any, NoReturn

from fembridge import interrupt
from fembridge.commands.options import Words, check_uses, invalid_choice
from fembridge.errors import FembridgeError, FembridgeWarning, UsageError
from fembridge.interrupt import INTERRUPTED
from fembridge.terminal import PlainStream, PrintError, error_line, log
from fembridge.version import __version__

VERBS = {
    "stimuli": "list the stimuli of the catalogue, or export one",
    "build-deck": "write a solver deck for each stimulus",
    "run": "run CalculiX in run folders",
    "ingest": "take stress traces from a solver's results",
    "export-script": "print a script that takes traces inside Mentat or Abaqus",
    "encode": "turn stress traces into spikes and rates",
    "simulate": "from a stimulus to spikes: all of the above",
    "touch": "any shape on a whole fingertip: every afferent's spikes",
    "receptive-field": "where on the skin a probe makes an afferent fire",
    "pad": "have CalculiX make the pad of a finger, for the two above",
    "sweep": "many stimuli on many fingers: each solved once, one table",
    "fit": "find the parameters whose rates come closest to observed ones",
    "study": "compare models of the afferents, on what they were not fitted to",
    "threshold": "how faint a vibration each afferent answers, against frequency",
    "validate": "the paper's figures and tables as one page: is the model any good",
    "verify": "hold the finite-element model against closed forms, with bounds",
    "deflect": "how far the skin goes down around a thin probe",
    "plot": "draw the mesh, a response, a raster",
    "cache": "list or clear what was solved before",
    "doctor": "list what is installed and what is missing",
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb; give the exit code.

    0 is success, 1 our error, 2 misuse: a word, number or name of a file that stands for
    nothing here. 130 is Ctrl-C. What is neither one of our errors nor one of the system
    is a bug of ours and keeps its traceback.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    _open_standard_streams()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # a path may be more than ASCII
            stream.reconfigure(errors="backslashreplace")
    try:
        with (
            redirect_stdout(PlainStream(sys.stdout)),
            redirect_stderr(PlainStream(sys.stderr)),
        ):
            try:
                code = _run(arguments)
            except KeyboardInterrupt as error:
                interrupt.ignore_from_now_on()
                code = _report_error(error, INTERRUPTED, "--json" in arguments, "interrupted")
            interrupt.ignore_from_now_on()
            sys.stdout.flush()
    except PrintError as error:
        os.dup2(os.open(os.devnull, os.O_RDWR), error.number)  # else what is left fails at exit
        if error.errno == errno.EPIPE:  # nobody reads it, as after ``| head -1``
            return 0
        print(error_line(f"cannot print: {error.strerror}"), file=sys.stderr)
        return 1
    except BrokenPipeError:
        raise
    except OSError as error:  # of a file it is an error of ours, or has its name
        print(error_line(f"cannot read or write: {error.strerror}"), file=sys.stderr)
        return 1
    return code


def _run(arguments: list[str]) -> int:
    as_json = "--json" in arguments
    parser = None
    try:
        parser, command = _parser(arguments)
        args = parser.parse_args(arguments)
        if command is None:
            parser.print_help()
            return 0
        args.explicit = _explicit_options(arguments, parser)
        check_uses(args, getattr(command, "USES", ()))
    except SystemExit as stop:  # argparse: help, version
        return stop.code if isinstance(stop.code, int) else 0
    except FembridgeError as error:
        return _report_error(error, error.exit_code, as_json)
    try:
        Path.cwd()
    except OSError as error:
        problem = "the folder in which this was started is gone: go to another one (cd)"
        return _report_error(error, 1, as_json, problem)
    try:
        with (
            redirect_stdout(StringIO()) if args.json else nullcontext(),
            _printed_warnings() as warned,
        ):
            interrupt.raise_from_now_on()
            summary = command.run(args)
            interrupt.ignore_from_now_on()
    except MemoryError as error:
        problem = "the memory is too small for this file or request"
        return _report_error(error, 1, as_json, problem)
    except (FembridgeError, OSError) as error:
        if isinstance(error, OSError) and not error.filename:
            raise
        return _report_error(
            error, _code_of(error, arguments), as_json, _option_message(error, parser)
        )
    code = int(summary.get("exit_code", 0))
    if args.json:
        _print_json({**summary, "warnings": warned, "exit_code": code})
    return code


@contextmanager
def _printed_warnings() -> Iterator[list[str]]:
    """Print each different `FembridgeWarning` as one line on stderr; the texts so far."""
    texts: list[str] = []
    with warnings.catch_warnings():
        warnings.simplefilter("always", FembridgeWarning)
        show_other = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *location: Any) -> None:  # noqa: ANN401
            if not issubclass(category, FembridgeWarning):
                show_other(message, category, *location)
            elif (text := str(message)) not in texts:
                texts.append(text)
                log(f"warning: {text}")

        warnings.showwarning = show  # type: ignore[assignment] # catch_warnings puts it back
        yield texts


def _report_error(error: BaseException, code: int, as_json: bool, text: str = "") -> int:
    """Print `error`, as `text` if there is one: a line, and for ``--json`` a table too."""
    text = text or str(error)
    print(error_line(text), file=sys.stderr)
    if as_json:
        details = {"kind": type(error).__name__, "message": text}
        for name in ("path", "line"):
            if getattr(error, name, None) is not None:
                details[name] = getattr(error, name)
        _print_json({"error": details, "exit_code": code})
    return code


def _code_of(error: Exception, arguments: Sequence[str]) -> int:
    """Exit code of `error`: 2 also where a file that was named in `arguments` is absent."""
    absent = error if isinstance(error, OSError) else error.__cause__
    if isinstance(absent, FileNotFoundError) and absent.filename is not None:
        named_paths = {os.path.normpath(argument.rpartition("=")[2]) for argument in arguments}
        if os.path.normpath(absent.filename) in named_paths:
            return 2
    return error.exit_code if isinstance(error, FembridgeError) else 1


def _option_message(error: Exception, parser: argparse.ArgumentParser) -> str:
    """What `error` says, an argument of the API called by its option."""
    if isinstance(error, OSError):
        return f"{error.filename}: {error.strerror}"
    text = str(error)
    for option in _options_of(parser):
        name = option.removeprefix("--").replace("-", "_")
        begins = text.startswith((f"{name} ", f"{name}_s "))  # else the key of a file
        if isinstance(error, UsageError) or begins:
            text = re.sub(rf"(?<![\w-]){name}(_s)?(?= (is|must be) )", option, text)
    return text


class _Parser(argparse.ArgumentParser):
    """A parser whose misuse is an error of ours, in one line, with the near words."""

    def __init__(self, *args: Any, **options: Any) -> None:  # noqa: ANN401 - as argparse has it
        super().__init__(*args, **options)
        # Python before 3.14 takes -1e-3 for an option.
        self._negative_number_matcher = _NEGATIVE_NUMBER

    def error(self, message: str) -> NoReturn:
        hint = "" if message.endswith("?") else f"; see {self.prog} --help"
        raise UsageError(f"{message}{hint}")

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:  # noqa: ANN401
        """Parse; before what is missing, an option that does not exist is named."""
        options = _options_of(self)
        for argument in args[: args.index("--")] if "--" in args else args:
            name = argument.partition("=")[0]
            if re.match(r"--?[A-Za-z]\S*$", name) and not {name, argument[:2]} & set(options):
                from fembridge.store import near_hint

                verb = next((argument for argument in args if not argument.startswith("-")), "")
                hint = near_hint(f"--{name.lstrip('-')}", options)
                hint = hint or "; see " + f"{self.prog} {verb} --help".replace("  ", " ")
                raise UsageError(f"no option {name}{hint}")
        return super().parse_args(args, namespace)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:  # noqa: ANN401
        """Parse `args` with ``--stimulus=a --stimulus=b`` for ``--stimulus a b``.

        A list ends at an option or at what is no item of it; and where the verb wants a word
        of its own, as a file, and there is none, at that.
        """
        joined: list[str] = []
        list_ends: list[tuple[Words, str]] = []  # lists, and the word that is no item
        last_open_list = None  # place of the last word of a list of anything
        position = 0
        while position < len(args):
            argument, position = args[position], position + 1
            if argument == "--":
                joined += args[position - 1 :]
                break
            action, end, item_names = self._option_string_actions.get(argument), position, ()
            if isinstance(action, Words):
                item_names = action.known
                while end < len(args) and not _is_option(args[end]):
                    if end > position and not action.takes(args[end]):
                        list_ends.append((action, args[end]))
                        break
                    end += 1
            joined += [f"{argument}={item}" for item in args[position:end]] or [argument]
            last_open_list = last_open_list if end - position < 2 or item_names else len(joined) - 1
            position = end
        try:
            namespace, remaining = super().parse_known_args(joined, namespace)
        except UsageError as error:
            if last_open_list is None:
                raise
            joined[last_open_list] = joined[last_open_list].partition("=")[2]
            try:
                return super().parse_known_args(joined, namespace)
            except UsageError:
                raise error from None
        if remaining and list_ends:
            action, argument = list_ends[0]
            try:
                action.items(argument)
            except argparse.ArgumentError as error:
                self.error(str(error))
        return namespace, remaining

    def _get_values(self, action: argparse.Action, arg_strings: list[str]) -> Any:  # noqa: ANN401
        """Values of `action`: an empty text is none, such as a variable that a script left empty.

        Nor is ``--``, which Python before 3.13 takes out of ``--output=--``.
        """
        if action.nargs not in (argparse.PARSER, argparse.REMAINDER):
            separator = ["--"] if action.option_strings else []
            for text in ("", *separator):
                if text in arg_strings:
                    raise argparse.ArgumentError(action, f"expected a value, got {text!r}")
        return super()._get_values(action, arg_strings)

    def _check_value(self, action: argparse.Action, value: Any) -> None:  # noqa: ANN401
        choices = list(map(str, action.choices or ()))
        if choices and value not in (action.choices or ()):
            raise argparse.ArgumentError(action, invalid_choice(str(value), choices))


_NEGATIVE_NUMBER = re.compile(r"-(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$")


def _is_option(argument: str) -> bool:
    """Whether `argument` is an option, not a value, which may be a negative number."""
    return re.match(r"-\.?\d", argument) is None and argument.startswith("-") and len(argument) > 1


def _options_of(parser: argparse.ArgumentParser) -> dict[str, argparse.Action]:
    """Options of `parser` and of those below it, as they are written."""
    options = dict(parser._option_string_actions)
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for child in action.choices.values():
                options |= _options_of(child)
    return options


def _explicit_options(arguments: Sequence[str], parser: argparse.ArgumentParser) -> frozenset[str]:
    """Options that `arguments` hold, each by its first name in full, as ``--output`` of ``-o``."""
    options = _options_of(parser)
    names = set()
    for argument in arguments[: arguments.index("--")] if "--" in arguments else arguments:
        name = argument.partition("=")[0]
        if action := options.get(name) or (
            None if argument[:2] == "--" else options.get(argument[:2])
        ):
            names.add(next(flag for flag in action.option_strings if flag.startswith("--")))
    return frozenset(names)


def _parser(arguments: Sequence[str]) -> tuple[argparse.ArgumentParser, ModuleType | None]:
    width = max(map(len, VERBS))
    listed = "\n".join(f"  {verb:<{width}}  {line}" for verb, line in VERBS.items())
    parser = _Parser(
        prog="fembridge",
        description="From a probe on a fingertip to the spikes of its afferents."
        f"\n\nverbs:\n{listed}",
        epilog="example: fembridge stimuli\nfembridge VERB --help says more about a verb",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"fembridge {__version__}")
    verbs = parser.add_subparsers(dest="verb", metavar="VERB", help="one of the above")
    verb = next((argument for argument in arguments if not argument.startswith("-")), None)
    if verb is None:
        return parser, None
    if verb not in VERBS:
        from difflib import get_close_matches

        similar = " or ".join(get_close_matches(verb, VERBS, n=2, cutoff=0.5))
        hint = f"did you mean {similar}?" if similar else f"choose {', '.join(VERBS)}"
        raise UsageError(f"no verb {verb!r}; {hint}")
    command = import_module(f"fembridge.commands.{verb.replace('-', '_')}")
    epilog = [f"example: {command.EXAMPLE}"]
    if {"--help", "-h"} & set(arguments):
        epilog.insert(0, f"{_outputs_text(verb)}\n\n")
    child = verbs.add_parser(
        verb,
        description=command.__doc__,
        epilog="".join(epilog).lstrip(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    command.add_arguments(child)
    child.add_argument("--json", action="store_true", help="print a summary a program can read")
    return parser, command


_FILE = re.compile(r"^\*\*`(.*)`\*\*: (.*)$", re.MULTILINE)
_COLUMN = re.compile(r"^\| `(.*?)` \| (.*?) ?\| (.*) \|$", re.MULTILINE)


def outputs_of(verb: str) -> dict[str, tuple[str, list[tuple[str, str, str]]]]:
    """By file that `verb` writes what it is, and of a table name, unit and meaning of columns."""
    from importlib.resources import files

    page = files("fembridge.commands").joinpath("outputs.md").read_text(encoding="utf-8")
    section = page.partition(f"\n## {verb}\n")[2].partition("\n## ")[0]
    pieces = iter(_FILE.split(section)[1:])
    return {
        file: (description, _COLUMN.findall(table))
        for file, description, table in zip(pieces, pieces, pieces, strict=True)
    }


def _outputs_text(verb: str) -> str:
    """The outputs of `verb` for its ``--help``; "" where it writes nothing."""
    import textwrap

    outputs = outputs_of(verb)
    lines = ["outputs:"] if outputs else []
    for file, (description, columns) in outputs.items():
        lines.append(f"  {file}: {description}")
        for name, unit, meaning in columns:
            text = f"{name}{f' ({unit})' if unit else ''}: {meaning}".replace("`", "")
            lines += textwrap.wrap(text, 88, initial_indent=" " * 4, subsequent_indent=" " * 6)
    return "\n".join(lines)


def _print_json(table: Mapping[str, object]) -> None:
    import json

    print(json.dumps(_json_value(table), indent=2, allow_nan=False))


def _json_value(value: object) -> object:
    """Turn a summary into what JSON has: no NaN, no array, no path, no tuple."""
    if hasattr(value, "tolist"):  # NumPy's numbers and arrays, unimported
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _json_value(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_json_value(item) for item in value]
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    return None if isinstance(value, float) and value - value != 0 else value


def _open_standard_streams() -> None:
    """Send closed standard streams to nowhere: else the next file would take their place."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # the lowest free number
    if sys.stdout is None:
        sys.stdout = os.fdopen(1, "w")
    if sys.stderr is None:
        sys.stderr = os.fdopen(2, "w")


if __name__ == "__main__":
    sys.exit(main())
