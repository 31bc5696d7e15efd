"""Settings of a solver run; imports nothing heavy."""

import os
from dataclasses import dataclass, replace
from numbers import Integral, Real
from pathlib import Path

from fembridge.errors import UsageError
from fembridge.host.machine import cores
from fembridge.host.process import THREAD_VARIABLE
from fembridge.host.progress import OnProgress

STALL_LIMIT_S = 600.0
"""Longest time without a growing file; an iteration of the finest finger takes 1 s."""
ITERATION_LIMIT = 200
"""Iterations of one attempt at an increment; 3 to 15 are usual, 50 have converged.

``SURFACE TO SURFACE`` contact with ``DIRECT`` increments has no limit of its own.
"""


@dataclass(frozen=True, slots=True)
class Solver:
    """How the solver is run: threads, simultaneous runs, limits, cache, folder and progress.

    Parameters
    ----------
    threads
        Threads of each run. Default: None, the value of ``OMP_NUM_THREADS``, else all cores
        shared by the simultaneous runs.
    jobs
        Number of runs at the same time. Default: 1.
    time_limit_s
        Longest run in s. Default: None, no limit.
    stall_limit_s
        Longest time in s without a growing file. Default: 600; None: no limit.
    iteration_limit
        Largest number of iterations of one attempt at an increment. Default: 200; None: no
        limit.
    cache
        Whether to reuse results of the same deck from the cache of this machine.
        Default: True.
    runs_folder
        Folder in which the run folders are kept. Default: None, a temporary folder, which is
        removed at the end. `fembridge.run` ignores it: its run folders exist.
    on_progress
        Function that is called with a `fembridge.host.progress.Progress` at least every
        second and at the end of each run. Default: None.

    Raises
    ------
    UsageError
        A number of threads or jobs, or a limit, that is not more than 0.

    Examples
    --------
    >>> import fembridge as fb
    >>> fb.Solver(jobs=2, time_limit_s=3600).iteration_limit
    200
    """

    threads: int | None = None
    jobs: int = 1
    time_limit_s: float | None = None
    stall_limit_s: float | None = STALL_LIMIT_S
    iteration_limit: int | None = ITERATION_LIMIT
    cache: bool = True
    runs_folder: str | os.PathLike[str] | None = None
    on_progress: OnProgress | None = None

    def __post_init__(self) -> None:
        for name in ("threads", "jobs", "time_limit_s", "stall_limit_s", "iteration_limit"):
            limit = getattr(self, name)
            kind, kind_name = (
                (Real, "a number") if name.endswith("_s") else (Integral, "a whole number")
            )
            if limit is not None and (not isinstance(limit, kind) or not float(limit) > 0):
                raise UsageError(argument=name, found=limit, expected=f"{kind_name}, more than 0")
        if self.runs_folder is not None:
            object.__setattr__(self, "runs_folder", Path(self.runs_folder))

    def shared_by(self, runs: int) -> "Solver":
        """Settings for simultaneous runs, which share the cores unless threads are set.

        Parameters
        ----------
        runs
            Number of simultaneous runs.
        """
        if self.threads is not None or os.environ.get(THREAD_VARIABLE):
            return self
        return replace(self, threads=max(1, cores() // runs))


DEFAULTS = Solver()
