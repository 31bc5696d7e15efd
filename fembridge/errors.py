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

from collections.abc import Callable
from pathlib import Path
from typing import Self


class FembridgeError(Exception):
    """Base of every error that fembridge raises on purpose."""

    exit_code = 1


class FembridgeWarning(UserWarning):
    """A result that is doubtful; a command prints it as a line on stderr."""


class UsageError(FembridgeError):
    """A word or number on the command line that means nothing here."""

    exit_code = 2


class StimulusError(UsageError):
    """An id, amplitude or frequency that is no stimulus."""


class FingerError(FembridgeError):
    """A finger, layer or mesh that cannot be."""


class DeckError(FembridgeError):
    """A stimulus or a model that no solver deck can express."""


class TraceError(FembridgeError):
    """Samples that are not a stress history."""


class ParameterError(FembridgeError):
    """A neural parameter outside its meaning."""


class MissingError(FembridgeError):
    """A program or library that is not on this machine."""


class ResponseError(FembridgeError):
    """A response map that was not accepted, is altered, or does not reach."""


class _PlacedError(FembridgeError):
    """An error with a file, and where it helps a line, in front of its words."""

    def __init__(self, problem: str, path: Path, line: int | None = None) -> None:
        super().__init__(problem, path, line)  # these rebuild it after pickling
        self.problem, self.path, self.line = problem, path, line

    @classmethod
    def at(cls, path: Path) -> Callable[[str], Self]:
        """What makes an error at `path` of a problem, whose words may begin with the path."""
        return lambda problem: cls(problem.removeprefix(f"{path}: "), path)

    def __str__(self) -> str:
        where = self.path if self.line is None else f"{self.path}:{self.line}"
        return f"{where}: {self.problem}"


class TableError(_PlacedError):
    """A CSV table with a row that is not what its header says."""


class ResultError(_PlacedError):
    """A result file that is absent, cut short or of another kind."""


class SolverError(_PlacedError):
    """The solver did not reach the end of the step; the path is its run folder."""


class OutputError(_PlacedError):
    """A place where results cannot be written."""


class LockedError(OutputError):
    """A folder in which another process is at work."""
