"""How the solver is run, by whoever runs it several times."""

import os
from dataclasses import dataclass

from fembridge.errors import UsageError
from fembridge.solvers.process import THREAD_VARIABLE
from fembridge.solvers.watchdog import Limits, OnProgress


@dataclass(frozen=True, slots=True)
class SolverSettings:
    """How the solver is run: its threads, how many runs at once, when to give up.

    Without `threads` the environment says (``OMP_NUM_THREADS``), or else the cores
    are shared by the runs that are made at once.

    Raises
    ------
    UsageError
        `threads` or `jobs` below 1.
    """

    threads: int | None = None
    jobs: int = 1
    limits: Limits | None = None
    on_progress: OnProgress | None = None

    def __post_init__(self) -> None:
        for name in ("threads", "jobs"):
            number = getattr(self, name)
            if number is not None and number < 1:
                raise UsageError(f"{name} is {number}, expected 1 or more")

    def threads_each(self, runs: int) -> int | None:
        """Threads of each of `runs` that are made at once; None: the environment's."""
        if self.threads is not None or os.environ.get(THREAD_VARIABLE):
            return self.threads
        return max(1, _cores() // runs)


def _cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
