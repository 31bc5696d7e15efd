"""How a run ended: accepted, or the one cause why it was not."""

from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from fembridge.errors import SolverError


class Cause(Enum):
    """Why a run is not accepted; the value is the sentence a user reads."""

    NO_SOLVER = "the solver cannot be started"
    BAD_FOLDER = "not a run folder that can be run"
    BUSY = "another run is at work in this folder"
    BAD_DECK = "CalculiX refused the deck"
    CARD_DROPPED = "CalculiX left a part of the deck out"
    SOLVER_NOT_BUILT_IN = "this CalculiX has not the equation solver the deck wants"
    NEGATIVE_JACOBIAN = "an element of the mesh is turned inside out"
    INCREMENTS_EXHAUSTED = "the deck allows too few increments"
    DIVERGED = "an increment did not converge"
    ENDLESS_ITERATION = "an increment iterated on and on"
    STALLED = "the solver stopped making progress"
    TIME_LIMIT = "the time limit was reached"
    INTERRUPTED = "the run was interrupted"
    DISK_FULL = "the results could not be written to the end"
    OUT_OF_MEMORY = "the solver got no more memory"
    KILLED = "the solver was killed from outside"
    CRASHED = "the solver crashed"
    WRONG_END = "the solver ended at another time than the run should"
    MISSING_OUTPUT = "the results are not whole"
    UNKNOWN = "the solver failed without a reason we know"


@dataclass(frozen=True, slots=True)
class Failure:
    """Why a run failed: the `cause`, what was found, and the next step if one is.

    `deck_line` is the line of the deck that the solver complained about.
    """

    cause: Cause
    found: str
    remedy: str = ""
    deck_line: int | None = None

    def __str__(self) -> str:
        where = "" if self.deck_line is None else f" (job.inp:{self.deck_line})"
        told = f"{self.cause.value}: {self.found}{where}"
        return f"{told}; {self.remedy}" if self.remedy else told


@dataclass(frozen=True, slots=True)
class Outcome:
    """One run of `folder`: accepted when `failure` is None.

    `exit_code` is negative for a signal and None when nothing was started.
    `increments` counts those that converged, `iterations` all that were made.
    `skipped` says that results of the same deck stood there already, and
    `as_built` that the deck is the one that ``run.toml`` speaks of.
    """

    folder: Path
    failure: Failure | None = None
    skipped: bool = False
    version: str | None = None
    exit_code: int | None = None
    wall_s: float = 0.0
    increments: int = 0
    iterations: int = 0
    threads: int | None = None
    as_built: bool = True

    @property
    def accepted(self) -> bool:
        """Whether the results are there and whole."""
        return self.failure is None

    def __str__(self) -> str:
        if self.failure is not None:
            return f"{self.folder}: {self.failure}"
        cost = f"{self.increments} increments, {self.iterations} iterations"
        if self.skipped:
            return f"{self.folder}: has the results of this deck, {cost}"
        return f"{self.folder}: {cost}, {self.wall_s:.1f} s"

    def to_error(self) -> SolverError:
        """Turn a failure into the error that names folder, cause and next step."""
        if self.failure is None:
            raise ValueError(f"{self.folder}: accepted, there is no error")
        return SolverError(str(self.failure), self.folder)

    def to_record(self) -> dict[str, object]:
        """Turn into the row of a summary."""
        failure = self.failure
        return {
            "folder": str(self.folder),
            "ok": self.accepted,
            "skipped": self.skipped,
            "cause": failure and failure.cause.name.lower(),
            "problem": failure and str(failure),
            "deck_line": failure and failure.deck_line,
            "version": self.version,
            "exit_code": self.exit_code,
            "wall_s": round(self.wall_s, 3),
            "increments": self.increments,
            "iterations": self.iterations,
            "threads": self.threads,
            "deck_as_built": self.as_built,
        }
