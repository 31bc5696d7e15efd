"""Everything fembridge raises on purpose.

FembridgeError
├── UsageError       a word or number on the command line that means nothing here
│   └── StimulusError    an id, amplitude or frequency that is no stimulus
├── FingerError      a finger, layer or mesh that cannot be
├── DeckError        a stimulus or a model that no solver deck can express
├── TraceError       samples that are not a stress history
├── ParameterError   a neural parameter outside its meaning
├── TableError       a CSV table with a row that is not what its header says
├── ResultError      a result file that is absent, cut short or of another kind
├── ResponseError    a response map that was not accepted, is altered, or too short
├── SolverError      the solver did not reach the end of the step
├── MissingError     a program or library that is not on this machine
└── OutputError      a place where results cannot be written
    └── LockedError      a folder in which another process is at work

FembridgeWarning     a result that is doubtful, by Python's ``warnings``

A message says what was found, what was expected and where. Errors pickle, so
that a worker can raise them and its parent report them.
"""

import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Self

_LONGEST_VALUE = 160  # characters of a value in a message
_PACKAGES = tuple(
    str(Path(__file__).parent.parent / name) for name in ("fembridge", "decks", "neural")
)


class FembridgeError(Exception):
    """Base of every error that fembridge raises on purpose.

    Parameters
    ----------
    problem
        What is wrong, as a sentence; with `argument` or `key`, the sentence without its subject,
        as in ``is 3, expected 0 to 2``. Default: made from `found` and `expected`.
    path, line
        File at fault and its line, from 1. Default: None.
    argument
        Argument of the public function at fault; a command names its option instead.
        Default: None.
    key
        Key of a table or of a file at fault, as ``skin.epidermis_mm``. Default: None.
    found, expected
        The value at fault, and a text of what is accepted. Default: None.

    Examples
    --------
    >>> import fembridge as fb
    >>> try:
    ...     fb.simulate("sine_20_25O", stored=True)
    ... except fb.FembridgeError as error:
    ...     error.found
    'sine_20_25O'
    """

    exit_code = 1

    def __init__(
        self,
        problem: str = "",
        path: Path | None = None,
        line: int | None = None,
        *,
        argument: str | None = None,
        key: str | None = None,
        found: object = None,
        expected: str | None = None,
    ) -> None:
        if type(found).__module__ == "numpy" and getattr(found, "ndim", None) == 0:
            found = found.item()  # type: ignore[attr-defined] # shown as a plain number
        problem = problem or f"is {_one_line(found)}, expected {expected}"
        location = () if path is None else (path, line)
        super().__init__(problem, *location)  # arguments and attributes rebuild it after pickling
        self.problem, self.path, self.line = problem, path, line
        self.argument, self.key, self.found, self.expected = argument, key, found, expected

    @classmethod
    def at(cls, path: Path) -> Callable[..., Self]:
        """A function that makes an error at `path` from a problem, or at another path and line.

        Parameters
        ----------
        path
            File at fault.
        """
        return lambda problem="", other=path, line=None, **fields: cls(
            problem, other, line, **fields
        )

    @classmethod
    def from_error(
        cls, error: "FembridgeError", path: Path | None = None, section: str | None = None
    ) -> Self:
        """`error` as an error of this class, with its fields.

        Parameters
        ----------
        error
            An error that names a file keeps it; `path` and `section` then have no effect.
        path
            File at fault. Default: none.
        section
            Section of a table: the argument or key of `error` becomes a key below it; "" is the
            table itself. Default: not of a table.
        """
        problem, argument, key = error.problem, error.argument, error.key
        if error.path is None and section is not None:
            name = key or argument
            key = ".".join(filter(None, (section, name))) if name else None
            argument = None
            if section and not name:
                problem = f"{section}: {problem}"
        return cls(
            problem,
            path if error.path is None else error.path,
            error.line,
            argument=argument,
            key=key,
            found=error.found,
            expected=error.expected,
        )

    def message(self, argument: str | None = None) -> str:
        """The whole line.

        Parameters
        ----------
        argument
            Name that replaces the argument or key, such as an option. Default: None.
        """
        subject = argument or self.argument or self.key
        sentence = self.problem if subject is None else f"{subject} {self.problem}"
        if self.path is None:
            return sentence
        location = self.path if self.line is None else f"{self.path}:{self.line}"
        return f"{location}: {sentence}"

    def __str__(self) -> str:
        return self.message()


class FembridgeWarning(UserWarning):
    """A result that is doubtful; a command prints it as a line on stderr.

    Examples
    --------
    >>> import warnings
    >>> import fembridge as fb
    >>> warnings.simplefilter("error", fb.FembridgeWarning)  # a doubt ends the program
    >>> warnings.simplefilter("default", fb.FembridgeWarning)
    """


def check_type(argument: str, value: object, kind: type) -> None:
    """Refuse a `value` of the `argument` of a public function that is no `kind`; a UsageError."""
    if not isinstance(value, kind):
        raise UsageError(argument=argument, found=value, expected=f"an object of {kind.__name__}")


def _one_line(value: object) -> str:
    """`value` as a message shows it; the end of a long one is left out."""
    text = " ".join(repr(value).split())
    return text if len(text) <= _LONGEST_VALUE else f"{text[: _LONGEST_VALUE - 3]}..."


def warn(message: str, path: Path | str | None = None, line: int | None = None) -> None:
    """Issue a `FembridgeWarning` at the line outside this package that called it.

    `path` and `line` locate the doubtful input; the message begins with them.
    """
    if path is not None:
        message = f"{path}: {message}" if line is None else f"{path}:{line}: {message}"
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_PACKAGES):
        frame, level = frame.f_back, level + 1
    warnings.warn(message, FembridgeWarning, stacklevel=level)


class UsageError(FembridgeError, ValueError):
    """A word or number on the command line that means nothing here."""

    exit_code = 2


class StimulusError(UsageError):
    """An id, amplitude or frequency that is no stimulus."""


class FingerError(FembridgeError, ValueError):
    """A finger, layer or mesh that cannot be."""


class DeckError(FembridgeError, ValueError):
    """A stimulus or a model that no solver deck can express."""


class TraceError(FembridgeError, ValueError):
    """Samples that are not a stress history."""


class ParameterError(FembridgeError, ValueError):
    """A neural parameter outside its meaning."""


class MissingError(FembridgeError):
    """A program or library that is not on this machine."""


class ResponseError(FembridgeError):
    """A response map that was not accepted, is altered, or does not reach."""


class TableError(FembridgeError, ValueError):
    """A CSV table with a row that is not what its header says."""

    path: Path


class ResultError(FembridgeError, ValueError):
    """A result file that is absent, cut short or of another kind."""

    path: Path


class SolverError(FembridgeError):
    """The solver did not reach the end of the step; the path is its run folder."""

    path: Path


class OutputError(FembridgeError):
    """A place where results cannot be written."""

    path: Path


class LockedError(OutputError):
    """A folder in which another process is at work."""
