"""How a solver is run and how far it is; imports nothing heavy."""

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from fembridge.errors import UsageError
from fembridge.machine import cores
from fembridge.solver.process import THREAD_VARIABLE

STALL_LIMIT_S = 600.0
"""No file has grown for so long; an iteration of the finest finger takes 1 s."""
ITERATION_LIMIT = 200
"""Of one attempt at an increment; 3 to 15 are usual, 50 were seen to end well.

``SURFACE TO SURFACE`` contact with ``DIRECT`` increments has no limit of its own.
"""


@dataclass(frozen=True, slots=True)
class Progress:
    """How far the run of `folder` is.

    `increment` of `increments` have converged, up to `time_ms` of `end_ms`;
    `iterations` were made in all, `iterations_here` in the attempt under way.
    `ended` marks the last report of a run, good or not.
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


OnProgress = Callable[[Progress], None]
"""Called with the progress of a run, from the thread that runs it."""


@dataclass(frozen=True, slots=True)
class SolverSettings:
    """How the solver is run: threads of each run, runs at once, when to give up.

    `threads` None leaves the solver's threads to the environment. A run ends after
    `time_limit_s` in all, `stall_limit_s` without a file that grows, or when one
    attempt at an increment takes more than `iteration_limit` iterations; None is never.
    `on_progress` is called at the latest every second, and when a run ends. Without
    `cache` a deck is solved that was solved before on this machine.
    """

    threads: int | None = None
    jobs: int = 1
    time_limit_s: float | None = None
    stall_limit_s: float | None = STALL_LIMIT_S
    iteration_limit: int | None = ITERATION_LIMIT
    on_progress: OnProgress | None = None
    cache: bool = True

    def __post_init__(self) -> None:
        for name in ("threads", "jobs", "time_limit_s", "stall_limit_s", "iteration_limit"):
            limit = getattr(self, name)
            if limit is not None and not limit > 0:
                raise UsageError(f"{name} is {limit}, expected more than 0")

    def shared_by(self, runs: int) -> "SolverSettings":
        """These settings for `runs` at once, which share the cores where nothing else is set."""
        if self.threads is not None or os.environ.get(THREAD_VARIABLE):
            return self
        return replace(self, threads=max(1, cores() // runs))


DEFAULTS = SolverSettings()
