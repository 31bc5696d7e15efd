"""Settings and progress of a solver run; imports nothing heavy."""

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from fembridge.errors import UsageError
from fembridge.machine import cores
from fembridge.solver.process import THREAD_VARIABLE

STALL_LIMIT_S = 600.0
"""Longest time without a growing file; an iteration of the finest finger takes 1 s."""
ITERATION_LIMIT = 200
"""Iterations of one attempt at an increment; 3 to 15 are usual, 50 have converged.

``SURFACE TO SURFACE`` contact with ``DIRECT`` increments has no limit of its own.
"""


@dataclass(frozen=True, slots=True)
class Progress:
    """Progress of the run in `folder`.

    `increment` of `increments` have converged, up to `time_ms` of `end_ms`;
    `iterations` counts all iterations, `iterations_here` those of the current attempt.
    `ended` marks the last report of a run, accepted or not.
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
        """Share of the simulated time that is solved, 0 to 1."""
        return min(1.0, max(0.0, self.time_ms / self.end_ms)) if self.end_ms else 0.0

    @property
    def left_s(self) -> float | None:
        """Estimated seconds to the end at the pace so far; None before the first increment."""
        done = self.fraction
        return self.elapsed_s * (1.0 - done) / done if done > 0 else None


OnProgress = Callable[[Progress], None]
"""Called with the progress of a run, from the thread that runs it."""


@dataclass(frozen=True, slots=True)
class SolverSettings:
    """How the solver is run: threads, simultaneous runs, limits, progress and cache.

    Parameters
    ----------
    threads
        Threads of each run. None (default): as in the environment.
    jobs
        Runs at the same time. Default: 1.
    time_limit_s
        Longest run in s. None (default): no limit.
    stall_limit_s
        Longest time in s without a growing file. Default: 600; None: no limit.
    iteration_limit
        Most iterations of one attempt at an increment. Default: 200; None: no limit.
    on_progress
        Called at least every second and at the end of a run. Default: None.
    cache
        Reuse results of the same deck from this machine's cache. Default: True.
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
        """Settings for simultaneous `runs`, which share the cores unless threads are set."""
        if self.threads is not None or os.environ.get(THREAD_VARIABLE):
            return self
        return replace(self, threads=max(1, cores() // runs))


DEFAULTS = SolverSettings()
