"""The command line: a verb for each step from a stimulus to spikes, and verbs for all steps.

A verb is a module of ``fembridge.commands`` with a docstring, an ``EXAMPLE`` and two functions,
``add_arguments(parser)`` and ``run(args) -> summary``; its ``USES`` list options that take effect
in some cases only. Only the requested verb is imported, so ``fembridge --help`` starts fast.

A verb prints text for people, and last the command that follows (`commands.next_steps`);
``--quiet`` prints warnings and errors only. ``--json`` prints its summary instead, a dict, as
strict JSON: a number that is not finite becomes null, and ``warnings``, ``next`` and
``exit_code`` are added. A verb whose work is only partly successful sets ``exit_code`` in the
summary. An error is one line on stderr, and with ``--json`` also ``{"error": {"kind", "message",
"path", "line", "argument", "found", "expected"}, "exit_code"}`` with the fields that the error
has; an argument of a public function is named as the option of the verb.

``outputs.md`` beside the verbs describes the files of each verb and the columns of each table;
``--help-outputs`` prints the section of a verb. A name in angle brackets is a placeholder for
column names that depend on the case.
"""

import argparse
import errno
import os
import re
import shlex
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, redirect_stderr, redirect_stdout
from importlib import import_module
from io import StringIO, TextIOWrapper
from pathlib import Path
from types import ModuleType
from typing import Any, NoReturn

from fembridge.commands.next_steps import next_commands
from fembridge.commands.options import (
    RepeatedOption,
    check_uses,
    choice_error,
    option,
    option_name,
)
from fembridge.errors import FembridgeError, FembridgeWarning, UsageError
from fembridge.host import interrupt
from fembridge.host.interrupt import INTERRUPTED
from fembridge.host.progress import showing
from fembridge.host.terminal import (
    Bars,
    PlainStream,
    PrintError,
    TaskBars,
    error_line,
    log,
    logged_lines,
    quiet_terminal,
    text_width,
    wrapped,
)
from fembridge.version import __version__

_GROUPS: Mapping[str, Mapping[str, str]] = {
    "from a stimulus to spikes": {
        "simulate": "from a stimulus to spikes of the median afferent of each class",
        "touch": "press, slide or vibrate a shape on a fingertip: spikes of every afferent",
        "receptive-field": "map where on the skin a probe makes an afferent fire",
        "threshold": "compute vibration thresholds of each class against frequency",
    },
    "the same step by step": {
        "stimuli": "list the stimuli of the catalogue, or export waveforms",
        "check": "check your own deck before anything is solved",
        "map": "solve one load and unload of your own deck: then every stimulus",
        "build-deck": "write a solver deck for each stimulus",
        "fingertip": "write the deck of a round fingertip in three dimensions",
        "run": "run CalculiX in run folders",
        "ingest": "read stress traces from the results of a solver",
        "export-script": "print a script that exports traces inside Mentat or Abaqus",
        "encode": "turn stress traces into spikes and firing rates",
        "calibrate": "find the gain of a robot's sensor from one press",
        "export-c": "write the encoder as one C header, for microcontrollers",
    },
    "parameters and evidence": {
        "sweep": "run many stimuli on many fingers, and collect one table",
        "fit": "fit neural parameters to observed rates",
        "study": "compare afferent models by rates that they were not fitted to",
        "validate": "write a page that compares the model with the paper and recordings",
        "verify": "check the finite-element model against closed-form solutions",
        "deflect": "compute the deflection of the skin around a thin probe",
    },
    "pictures, files and the machine": {
        "plot": "draw a mesh, a response, a raster and other pictures",
        "sample": "write sample results, a deck, a signal or rates: a first try without a solver",
        "report": "write a page on a run, a simulation, a touch, a map or a pad",
        "explore": "write a page that plays a touch, a simulation or a solved run",
        "pad": "make the pad file of your own finger, for touch and receptive-field",
        "cache": "list or clear the results of earlier solver runs",
        "doctor": "list what is installed and what is missing",
        "completion": "print the completion of a shell: bash, zsh, fish or tcsh",
    },
}
# What a newcomer of each kind runs first, without data of his own: purpose and command.
FIRST_HOUR: Mapping[str, Sequence[tuple[str, str]]] = {
    "You study touch": (
        (
            "spikes, rates and a raster under band-pass noise",
            "fembridge simulate --stimulus noise_25_250 -o out",
        ),
        (
            "every afferent of a fingertip that reads the letter b",
            "fembridge touch --shape braille:text=b --press-n 0.25 -o touch_b",
        ),
    ),
    "You own a finger model": (
        ("results of CalculiX, to read and encode without a solver", "fembridge sample frd"),
        ("a deck, to check and to drive as your own", "fembridge sample deck"),
    ),
    "You build robot skin": (
        ("a pressure signal, to turn into spikes", "fembridge sample pressure"),
    ),
}
VERBS = {verb: line for group in _GROUPS.values() for verb, line in group.items()}


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb; the exit code.

    0 is success, 1 an error, 2 misuse (an unknown name, a value out of range, a file that does
    not exist), 130 Ctrl-C. Any exception except a `FembridgeError` or an ``OSError`` is a bug and
    keeps its traceback.
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
        os.dup2(os.open(os.devnull, os.O_RDWR), error.number)  # else flushing fails at exit
        if error.errno == errno.EPIPE:  # the reader has ended, as after ``| head -1``
            return 0
        print(error_line(f"cannot print: {error.strerror}"), file=sys.stderr)
        return 1
    except BrokenPipeError:
        raise
    except OSError as error:  # of a standard stream: errors of files name the file
        print(error_line(f"cannot read or write: {error.strerror}"), file=sys.stderr)
        return 1
    return code


def _run(arguments: list[str]) -> int:
    as_json = "--json" in arguments
    parser = None
    try:
        parser, command = _parser(arguments)
        rewrite = getattr(command, "spelled_out", list)
        args = parser.parse_args(rewrite(arguments))
        if command is None:
            print(wrapped(_first_hour_text(), text_width()))
            return 0
        args.explicit = _explicit_options(arguments, parser)
        args.command_line = shlex.join(["fembridge", *arguments])
        args.complete_parser = complete_parser
        check_uses(args, getattr(command, "USES", ()))
    except SystemExit as stop:  # argparse: help, version
        return stop.code if isinstance(stop.code, int) else 0
    except FembridgeError as error:
        return _report_error(error, error.exit_code, as_json, parser=parser)
    try:
        Path.cwd()
    except OSError as error:
        problem = "the current folder does not exist any more: change to another one (cd)"
        return _report_error(error, 1, as_json, problem)
    try:
        hides = args.json or (args.quiet and not getattr(command, "PRINTS_ITS_RESULT", False))
        with (
            redirect_stdout(StringIO()) if hides else nullcontext(),
            quiet_terminal() if args.quiet else nullcontext(),
            _printed_warnings() as warned,
            logged_lines(shows=not args.quiet) as logged,
            _task_bars(command),
        ):
            interrupt.raise_keyboard_interrupt()
            summary = command.run(args)
            interrupt.ignore_from_now_on()
    except MemoryError as error:
        problem = "not enough memory for this file or request"
        return _report_error(error, 1, as_json, problem)
    except (FembridgeError, OSError) as error:
        if isinstance(error, OSError) and not error.filename:
            raise
        return _report_error(error, _code_of(error, arguments), as_json, parser=parser)
    code = int(summary.get("exit_code", 0))
    following = next_commands(args.verb, args, summary)
    if args.json:
        notes = [*summary.get("notes", ()), *logged]
        more = {"notes": notes, "warnings": warned, "next": following, "exit_code": code}
        _print_json({**summary, **more})
    elif following and not args.quiet:
        print("next:", *(f"  {line}" for line in following), sep="\n")
    return code


@contextmanager
def _task_bars(command: ModuleType) -> Iterator[None]:
    """Show the progress of computations, unless the verb has bars of its own."""
    if any(isinstance(item, type) and issubclass(item, Bars) for item in vars(command).values()):
        yield
        return
    with TaskBars() as bars, showing(bars):
        yield


@contextmanager
def _printed_warnings() -> Iterator[list[str]]:
    """Print each different `FembridgeWarning` as one line on stderr; a list of their texts."""
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


def _report_error(
    error: BaseException,
    code: int,
    as_json: bool,
    text: str = "",
    parser: argparse.ArgumentParser | None = None,
) -> int:
    """Print `error`, or `text` instead, as a line on stderr and with ``--json`` as a table."""
    details: dict[str, object] = {"kind": type(error).__name__}
    if isinstance(error, FembridgeError):
        name = error.argument
        if name is not None and parser is not None:
            name = _option_of(name, parser)
        text = text or error.message(name)
        details |= {
            "path": error.path,
            "line": error.line,
            "argument": name,
            "key": error.key,
            "found": error.found,
            "expected": error.expected,
        }
    elif isinstance(error, OSError) and error.filename and not text:
        text = f"{error.filename}: {error.strerror}"
    text = text or str(error)
    print(error_line(text), file=sys.stderr)
    if as_json:
        details = {name: value for name, value in details.items() if value is not None}
        _print_json({"error": {**details, "message": text}, "exit_code": code})
    return code


def _code_of(error: Exception, arguments: Sequence[str]) -> int:
    """Exit code of `error`: 2 also for a missing file that `arguments` name."""
    absent = error if isinstance(error, OSError) else error.__cause__
    if isinstance(absent, FileNotFoundError) and absent.filename is not None:
        named_paths = {os.path.normpath(argument.rpartition("=")[2]) for argument in arguments}
        if os.path.normpath(absent.filename) in named_paths:
            return 2
    return error.exit_code if isinstance(error, FembridgeError) else 1


def _option_of(argument: str, parser: argparse.ArgumentParser) -> str:
    """Option of an `argument` of a public function, else the argument itself."""
    options = _options_of(parser)
    for name in (option(argument), option(argument.removesuffix("s"))):
        if name in options:
            return name
    by_name = {action.dest: option_name(action) for action in options.values()}
    return by_name.get(argument, argument)


class _Parser(argparse.ArgumentParser):
    """A parser that raises a `UsageError`, which suggests similar names."""

    def __init__(self, *args: Any, **settings: Any) -> None:  # noqa: ANN401 - as argparse has it
        super().__init__(*args, **{"exit_on_error": False, **settings})
        # Python before 3.14 reads -1e-3 as an option.
        self._negative_number_matcher = _NEGATIVE_NUMBER

    def error(self, message: str) -> NoReturn:
        """Raise `message` of argparse."""
        raise UsageError(f"{message}; see {self.prog} --help")

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:  # noqa: ANN401
        """Parse `args`; an unknown option is reported before a missing argument."""
        parser: argparse.ArgumentParser = self
        for argument in args[: args.index("--")] if "--" in args else args:
            if not argument.startswith("-"):
                parser = _subparsers_of(parser).get(argument, parser)
                continue
            name = argument.partition("=")[0]
            options = parser._option_string_actions
            if re.match(r"--?[A-Za-z]\S*$", name) and not {name, argument[:2]} & set(options):
                raise _unknown_option(name, parser, self)
        parsed, extra = self.parse_known_args(args, namespace)
        if extra:
            named = [
                str(action.metavar or action.dest) for action in parser._get_positional_actions()
            ]
            expected = " ".join([parser.prog, *named, "[options]"])
            raise UsageError(
                f"{extra[0]!r} is one argument too many; expected {expected}",
                found=extra[0],
                expected=expected,
            )
        return parsed

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:  # noqa: ANN401
        """Parse `args` with ``--stimulus=a --stimulus=b`` for ``--stimulus a b``.

        A list ends at an option or at a word that is no item. If a positional argument is then
        missing, the last item of the last list is taken for it.
        """
        joined: list[str] = []
        list_ends: list[tuple[RepeatedOption, str]] = []  # and the word that is no item
        last_open_list = None  # index of the last word of a list that accepts any text
        position = 0
        while position < len(args):
            argument, position = args[position], position + 1
            if argument == "--":
                joined += args[position - 1 :]
                break
            action, end, item_choices = self._option_string_actions.get(argument), position, ()
            if isinstance(action, RepeatedOption):
                item_choices = action.item_choices
                while end < len(args) and not _is_option(args[end]):
                    if end > position and not action.accepts(args[end]):
                        list_ends.append((action, args[end]))
                        break
                    end += 1
            joined += [f"{argument}={item}" for item in args[position:end]] or [argument]
            if end - position >= 2 and not item_choices:
                last_open_list = len(joined) - 1
            position = end
        try:
            namespace, remaining = self._parse_joined(joined, namespace)
        except UsageError as error:
            if last_open_list is None:
                raise
            joined[last_open_list] = joined[last_open_list].partition("=")[2]
            try:
                return self._parse_joined(joined, namespace)
            except UsageError:
                raise error from None
        if remaining and list_ends:
            action, argument = list_ends[0]
            action.items(argument)
        return namespace, remaining

    def _parse_joined(self, args: list[str], namespace: Any) -> Any:  # noqa: ANN401
        """Parse `args` as argparse does; its errors become a `UsageError`."""
        try:
            return super().parse_known_args(args, namespace)
        except argparse.ArgumentError as error:
            if error.argument_name is None:
                self.error(error.message)
            name = error.argument_name.rpartition("/")[2]
            problem = f"is refused: {error.message}; see {self.prog} --help"
            raise UsageError(problem, argument=name) from error

    def _get_values(self, action: argparse.Action, arg_strings: list[str]) -> Any:  # noqa: ANN401
        """Values of `action`; an empty text is refused, such as an empty variable of a script.

        So is ``--``, which Python before 3.13 drops from ``--output=--``.
        """
        if action.nargs not in (argparse.PARSER, argparse.REMAINDER):
            separator = ["--"] if action.option_strings else []
            for text in ("", *separator):
                if text in arg_strings:
                    raise UsageError(argument=option_name(action), found=text, expected="a value")
        return super()._get_values(action, arg_strings)

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:  # noqa: ANN401
        """Value of one argument; argparse itself would replace a `UsageError`, a ``ValueError``."""
        try:
            return self._registry_get("type", action.type, action.type)(arg_string)
        except UsageError as error:
            error.argument = option_name(action)
            raise

    def _check_value(self, action: argparse.Action, value: Any) -> None:  # noqa: ANN401
        choices = list(map(str, action.choices or ()))
        if choices and value not in (action.choices or ()):
            raise choice_error(action, str(value), choices)


_NEGATIVE_NUMBER = re.compile(r"-(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$")


def _is_option(argument: str) -> bool:
    """Whether `argument` is an option, not a value, which may be a negative number."""
    return re.match(r"-\.?\d", argument) is None and argument.startswith("-") and len(argument) > 1


def _subparsers_of(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """Parsers of the verbs of `fembridge`, or of the pictures of ``plot``, by name."""
    return {
        name: child
        for action in parser._actions
        if isinstance(action, argparse._SubParsersAction)
        for name, child in action.choices.items()
    }


def _unknown_option(
    name: str, parser: argparse.ArgumentParser, root: argparse.ArgumentParser
) -> UsageError:
    """The error of an option `name` that `parser` lacks: its options, and who has this one."""
    from fembridge.host.store import near_hint

    owners: list[str] = []
    for verb, child in _subparsers_of(root).items():
        pictures = _subparsers_of(child).items()
        owners += [f"{verb} {key}" for key, picture in pictures if name in _options_of(picture)]
    if not owners:
        owners = [
            verb
            for verb, child in _subparsers_of(complete_parser()).items()
            if name in _options_of(child) and name not in _EVERYWHERE
        ]
    options = [option_name(action) for action in parser._actions if action.option_strings]
    listed = [option for option in dict.fromkeys(options) if option not in _EVERYWHERE]
    expected = ", ".join(listed)
    problem = f"is no option of {parser.prog}"
    if owners:
        more = f" and {len(owners) - _MOST_OWNERS} more" if len(owners) > _MOST_OWNERS else ""
        problem += f", but of {', '.join(owners[:_MOST_OWNERS])}{more}"
    if listed and len(listed) <= _MOST_LISTED:
        problem += f"; expected {expected}"
    problem += f"; see {parser.prog} --help"
    problem += near_hint(f"--{name.lstrip('-')}", options)
    return UsageError(problem, argument=name, found=name, expected=expected)


# Options of every verb, and how many options and owners of an option a message lists.
_EVERYWHERE = ("--help", "--help-outputs", "--json", "--quiet")
_MOST_LISTED, _MOST_OWNERS = 8, 6


def _options_of(parser: argparse.ArgumentParser) -> dict[str, argparse.Action]:
    """Options of `parser` and of its subparsers by name."""
    options = dict(parser._option_string_actions)
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for child in action.choices.values():
                options |= _options_of(child)
    return options


def _explicit_options(arguments: Sequence[str], parser: argparse.ArgumentParser) -> frozenset[str]:
    """Options in `arguments` by their long names, such as ``--output`` for ``-o``."""
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
    parser, verbs = _parser_without_verbs()
    verb = next((argument for argument in arguments if not argument.startswith("-")), None)
    if verb is None:
        return parser, None
    if verb not in VERBS:
        from difflib import get_close_matches

        similar = " or ".join(get_close_matches(verb, VERBS, n=2, cutoff=0.5))
        hint = f"did you mean {similar}?" if similar else f"choose {', '.join(VERBS)}"
        raise UsageError(f"no verb {verb!r}; {hint}", found=verb, expected=", ".join(VERBS))
    return parser, _add_verb(verbs, verb)


def complete_parser() -> argparse.ArgumentParser:
    """Parser with all verbs, for the completion of a shell."""
    parser, verbs = _parser_without_verbs()
    for verb in VERBS:
        _add_verb(verbs, verb)
    return parser


def _parser_without_verbs() -> "tuple[_Parser, argparse._SubParsersAction[_Parser]]":
    parser = _Parser(
        prog="fembridge",
        usage="%(prog)s [--version] VERB ...",
        description="From a probe on a fingertip to the spikes of its afferents.\n\n"
        + _verbs_text(),
        epilog="example: fembridge stimuli\n\nfembridge VERB --help describes a verb",
        formatter_class=_HelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"fembridge {__version__}")
    verbs = parser.add_subparsers(
        dest="verb", metavar="VERB", help="one of the above", prog="fembridge"
    )
    return parser, verbs


def _add_verb(verbs: "argparse._SubParsersAction[_Parser]", verb: str) -> ModuleType:
    """Add the parser of `verb`; its module."""
    command = import_module(f"fembridge.commands.{verb.replace('-', '_')}")
    summary, _, details = (command.__doc__ or "").partition("\n\n")
    child = verbs.add_parser(
        verb,
        help=VERBS[verb],
        description=summary,
        epilog="\n\n".join(filter(None, [details.strip(), f"example: {command.EXAMPLE}"])),
        formatter_class=_HelpFormatter,
        allow_abbrev=False,
    )
    command.add_arguments(child)
    child.add_argument("--json", action="store_true", help="print a JSON summary for programs")
    child.add_argument("--quiet", action="store_true", help="print errors and warnings only")
    child.add_argument(
        "--help-outputs",
        action=_HelpOutputs,
        verb=verb,
        help="list the files of this verb and the columns of its tables",
    )
    return command


def _first_hour_text() -> str:
    """The commands of the first hour by kind of user, then all verbs."""
    kinds = [
        "\n".join([kind, *(f"  {text}:\n    {command}" for text, command in rows)])
        for kind, rows in FIRST_HOUR.items()
    ]
    end = "fembridge VERB --help describes a verb"
    return "\n\n".join(["The first hour", *kinds, "All verbs", _verbs_text(), end])


def _verbs_text() -> str:
    """The verbs in their groups, a line each."""
    width = max(map(len, VERBS))
    return "\n\n".join(
        "\n".join([f"{title}:", *(f"  {verb:<{width}}  {line}" for verb, line in verbs.items())])
        for title, verbs in _GROUPS.items()
    )


class _HelpFormatter(argparse.RawDescriptionHelpFormatter):
    """A help page as wide as the terminal, up to 100 characters, with a short usage."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, max_help_position=28, width=text_width())

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return wrapped(text, width)

    def _format_usage(self, usage: str | None, actions: Any, groups: Any, prefix: Any) -> str:  # noqa: ANN401
        if usage is None:
            required = [action for action in actions if action.required and action.option_strings]
            positional = [action for action in actions if not action.option_strings]
            usage = super()._format_usage(None, [*required, *positional], [], "").strip()
            usage_parts = f"{usage} [options]".split(" ")
            usage, room = usage_parts[0], self._width - len("usage: ")
            for part in usage_parts[1:]:
                is_full = len(usage.rpartition("\n")[2]) + len(part) >= room
                usage += f"\n{' ' * len('usage: ')}{part}" if is_full else f" {part}"
        return super()._format_usage(usage, actions, groups, prefix)


class _HelpOutputs(argparse.Action):
    """Print the outputs of a `verb` and exit, as ``--help`` does."""

    def __init__(
        self,
        option_strings: Sequence[str],
        dest: str,
        verb: str,
        **settings: Any,  # noqa: ANN401 - as argparse calls it
    ) -> None:
        super().__init__(option_strings, dest, nargs=0, default=argparse.SUPPRESS, **settings)
        self.verb = verb

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        """Print and exit."""
        print(_outputs_text(self.verb) or f"{self.verb} writes no files")
        parser.exit()


_FILE = re.compile(r"^\*\*`(.*)`\*\*: (.*(?:\n\S.*)*)$", re.MULTILINE)
_COLUMN = re.compile(r"^\| `(.*?)` \| (.*?) ?\| (.*) \|$", re.MULTILINE)


def outputs_of(verb: str) -> dict[str, tuple[str, list[tuple[str, str, str]]]]:
    """Files of `verb`: the description, and name, unit and meaning of each column of a table."""
    from importlib.resources import files

    page = files("fembridge.commands").joinpath("outputs.md").read_text(encoding="utf-8")
    section = page.partition(f"\n## {verb}\n")[2].partition("\n## ")[0]
    pieces = iter(_FILE.split(section)[1:])
    return {
        file: (" ".join(description.split()), _COLUMN.findall(table))
        for file, description, table in zip(pieces, pieces, pieces, strict=True)
    }


def _outputs_text(verb: str) -> str:
    """The outputs of `verb` for ``--help-outputs``; "" for a verb without files."""
    lines = []
    for file, (description, columns) in outputs_of(verb).items():
        lines.append(f"{file}: {description}")
        for name, unit, meaning in columns:
            text = f"{name}{f' ({unit})' if unit else ''}: {meaning}".replace("`", "")
            lines.append(f"  {text}")
    # A file and each of its columns is a paragraph of its own.
    return "\n".join(wrapped(line, text_width()) for line in lines)


def _print_json(table: Mapping[str, object]) -> None:
    import json

    print(json.dumps(_json_value(table), indent=2, allow_nan=False))


def _json_value(value: object) -> object:
    """The JSON form of a value: null for NaN, a list for an array, a text for any other object."""
    if hasattr(value, "tolist"):  # NumPy's numbers and arrays, unimported
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _json_value(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_json_value(item) for item in value]
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, float):
        return value if value - value == 0 else None
    return str(value)


def _open_standard_streams() -> None:
    """Open closed standard streams on the null device: else the next file gets their number."""
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
