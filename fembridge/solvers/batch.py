"""Many run folders, several at once; one that fails does not stop the others."""

import threading
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from fembridge.errors import FembridgeError, UsageError
from fembridge.run_folder import read_run_folder
from fembridge.solvers import load_solver
from fembridge.solvers.outcome import Cause, Failure, Outcome
from fembridge.solvers.process import signals_as_exits
from fembridge.solvers.record import finished_outcome
from fembridge.solvers.watchdog import Limits, OnProgress


def run_folders(
    folders: Iterable[Path],
    *,
    jobs: int = 1,
    threads: int | None = None,
    limits: Limits | None = None,
    force: bool = False,
    on_progress: OnProgress | None = None,
) -> list[Outcome]:
    """Run each of `folders` with the solver that its ``run.toml`` names.

    Parameters
    ----------
    folders
        Run folders; one that is named twice is run once.
    jobs
        How many to run at the same time, each with its `threads`.
    force
        Run also where whole results of the same deck are.
    on_progress
        Told how far each run is, from the thread that runs it.

    Returns
    -------
    list of Outcome
        One a folder, in the order given. All that is wrong with one folder is
        the failure in its outcome; nothing of it is raised.

    Raises
    ------
    UsageError
        `jobs` or `threads` below 1.
    """
    for name, number in (("jobs", jobs), ("threads", threads)):
        if number is not None and number < 1:
            raise UsageError(f"{name} is {number}, expected 1 or more")
    halt = threading.Event()

    def run(folder: Path) -> Outcome:
        if halt.is_set():
            return Outcome(folder, Failure(Cause.INTERRUPTED, "before it began"))
        try:
            return _run(folder, threads, limits, force, on_progress, halt)
        except FembridgeError as error:
            problem = str(error).removeprefix(f"{folder}: ")
            return Outcome(folder, Failure(Cause.BAD_FOLDER, problem))
        except BaseException:
            halt.set()  # before this thread takes the next folder
            raise

    unique = {folder.resolve(): folder for folder in reversed(list(folders))}
    with signals_as_exits(), ThreadPoolExecutor(jobs) as pool:
        try:
            return list(pool.map(run, reversed(unique.values())))
        finally:  # after Ctrl-C the pool waits until each solver is stopped
            halt.set()


def _run(
    folder: Path,
    threads: int | None,
    limits: Limits | None,
    force: bool,
    on_progress: OnProgress | None,
    halt: threading.Event,
) -> Outcome:
    run = read_run_folder(folder)
    attempt = load_solver(run.solver)
    finished = None if force else finished_outcome(run)
    return finished or attempt(
        folder, threads=threads, limits=limits, on_progress=on_progress, halt=halt
    )
