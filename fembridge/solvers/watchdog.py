"""A run while it goes on: how far it is, and whether it still gets anywhere.

CalculiX flushes its ``.sta`` and ``.cvg`` line by line; both are read again
when they have grown. ``SURFACE TO SURFACE`` contact with ``DIRECT`` increments
has no limit of iterations of its own, so it gets one here.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from decks.dialects import JOB
from fembridge.errors import OutputError, ResultError, UsageError
from fembridge.results.printed.cvg import CvgRow, read_cvg
from fembridge.results.printed.sta import StaRow, read_sta
from fembridge.run_folder import RunFolder
from fembridge.solvers.outcome import Cause, Failure

STALL_LIMIT_S = 600.0
"""No file has grown for so long; an iteration of the finest finger takes 1 s."""

ITERATION_LIMIT = 200
"""Of one attempt at an increment; 3 to 15 are usual, 50 were seen to end well."""


@dataclass(frozen=True, slots=True)
class Limits:
    """When to give up; None is never."""

    time_limit_s: float | None = None
    stall_limit_s: float | None = STALL_LIMIT_S
    iteration_limit: int | None = ITERATION_LIMIT

    def __post_init__(self) -> None:
        for name in ("time_limit_s", "stall_limit_s", "iteration_limit"):
            limit = getattr(self, name)
            if limit is not None and not limit > 0:
                raise UsageError(f"{name} is {limit}, expected more than 0")


@dataclass(frozen=True, slots=True)
class Progress:
    """How far the run of `folder` is.

    `increment` of `increments` have converged, up to `time_ms` of `end_ms`;
    `iterations` were made in all, `iterations_here` in the attempt under way.
    `ended` marks the last word about a run, good or not.
    """

    folder: Path
    increment: int
    increments: int
    time_ms: float
    end_ms: float
    iterations: int
    iterations_here: int
    elapsed_s: float
    ended: bool = False

    @property
    def fraction(self) -> float:
        """The part of the solver's time that is done, 0 to 1."""
        return min(1.0, max(0.0, self.time_ms / self.end_ms)) if self.end_ms else 0.0

    @property
    def left_s(self) -> float | None:
        """How long the rest takes at the pace so far; None before an increment."""
        done = self.fraction
        return self.elapsed_s * (1.0 - done) / done if done > 0 else None


class OnProgress(Protocol):
    """Who is told how far a run is; called from the thread that runs it."""

    def __call__(self, progress: Progress, /) -> None:
        """Take note."""


class Watchdog:
    """Watches the files that the solver of `run` writes in the folder `work`.

    The caller brings the time: seconds since the start, from its own clock.
    """

    def __init__(self, work: Path, run: RunFolder, limits: Limits) -> None:
        self._work, self._run, self._limits = work, run, limits
        self._sizes: dict[str, int] = {}
        self._grown_at_s = 0.0
        self._sta: list[StaRow] = []
        self._cvg: list[CvgRow] = []

    def look(self, elapsed_s: float) -> Progress:
        """Look at the files; tell how far the run is.

        Raises
        ------
        OutputError
            Somebody has removed the folder.
        """
        sizes = _sizes(self._work)
        if sizes != self._sizes:
            self._grown_at_s = elapsed_s
        before, self._sizes = self._sizes, sizes
        for name, read in ((f"{JOB}.sta", self._see_sta), (f"{JOB}.cvg", self._see_cvg)):
            if sizes.get(name) != before.get(name):
                read(self._work / name)
        good = [row for row in self._sta if not row.failed]
        return Progress(
            folder=self._run.folder,
            increment=len(good),
            increments=self._run.increments_in_all,
            time_ms=good[-1].total_time_ms if good else 0.0,
            end_ms=self._run.end_ms,
            iterations=len(self._cvg),
            iterations_here=_of_last_attempt(self._cvg),
            elapsed_s=elapsed_s,
        )

    def complaint(self, progress: Progress) -> Failure | None:
        """Give the reason to stop the run, if what `look` has seen is one."""
        limits, elapsed_s = self._limits, progress.elapsed_s
        place = (
            f"after {progress.increment} of {progress.increments} increments, "
            f"{progress.time_ms:g} of {progress.end_ms:g} ms"
        )
        most = limits.iteration_limit
        if most is not None and progress.iterations_here > most:
            return Failure(
                Cause.ENDLESS_ITERATION,
                f"{progress.iterations_here} iterations, limit {most}, {place}",
                "change the contact's stiffness or type, or make increments smaller",
            )
        if limits.time_limit_s is not None and elapsed_s > limits.time_limit_s:
            return Failure(Cause.TIME_LIMIT, f"{limits.time_limit_s:g} s were over {place}")
        still_s = elapsed_s - self._grown_at_s
        if limits.stall_limit_s is not None and still_s > limits.stall_limit_s:
            return Failure(Cause.STALLED, f"no file has grown for {still_s:.0f} s {place}")
        return None

    def _see_sta(self, path: Path) -> None:
        try:
            self._sta = read_sta(path)
        except ResultError:  # a line we cannot read: the verdict will say so
            return

    def _see_cvg(self, path: Path) -> None:
        try:
            self._cvg = read_cvg(path)
        except ResultError:
            return


def _sizes(folder: Path) -> dict[str, int]:
    sizes = {}
    try:
        entries = os.scandir(folder)
    except OSError as error:
        raise OutputError(f"gone during the run: {error.strerror}", folder) from error
    with entries:
        for entry in entries:
            try:
                sizes[entry.name] = entry.stat().st_size
            except FileNotFoundError:  # a scratch file of the solver
                continue
    return sizes


def _of_last_attempt(rows: list[CvgRow]) -> int:
    count = 0
    for row in reversed(rows):
        last = rows[-1]
        if (row.step, row.increment, row.attempt) != (last.step, last.increment, last.attempt):
            break
        count += 1
    return count
