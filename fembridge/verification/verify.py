"""Make the studies: each once, several at a time, what is finished kept."""

import ctypes
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path

from fembridge import __version__
from fembridge.errors import MissingError, ResponseError, SolverError
from fembridge.machine import SOLVER_INSTALL_LINE, check_ccx, find_ccx
from fembridge.solvers.guard import PR_SET_PDEATHSIG
from fembridge.solvers.process import signals_as_exits
from fembridge.solvers.watchdog import OnProgress
from fembridge.store import make_folder
from fembridge.verification.bench import Bench
from fembridge.verification.finding import Finding
from fembridge.verification.finding_file import (
    finding_path,
    inputs_of_study,
    read_finding,
    write_finding,
)
from fembridge.verification.skfem_plane import skfem_version
from fembridge.verification.studies import Study, studies_named

Tell = Callable[[str], None]

# The longest first, so that none of the cores waits at the end.
_LONGEST = ("map", "mesh", "contact", "incompressible", "hertz")


@dataclass(frozen=True, slots=True)
class _Task:
    name: str
    folder: Path
    quick: bool
    versions: dict[str, str]


def verify(
    folder: Path,
    names: Sequence[str] | None = None,
    *,
    quick: bool = False,
    jobs: int = 1,
    on_progress: OnProgress | None = None,
    tell: Tell = lambda line: None,
) -> tuple[Finding, ...]:
    """Make the studies `names`, or all; give their findings in the order of the page.

    A finding that stands in `folder` is taken if it was made from the same; of one
    that was not finished the runs of the solver that are whole are taken.

    Parameters
    ----------
    jobs
        Studies at the same time, each in a process of its own.
    tell
        Hears in a line each what is being done.

    Raises
    ------
    MissingError
        No solver; the message names the line that installs one.
    SolverError, ResponseError
        A run of the solver failed.
    OutputError
        `folder` cannot be written.
    """
    studies = studies_named(list(names) if names else None)
    versions = versions_here()
    make_folder(folder)
    tasks = [_Task(study.name, folder, quick, versions) for study in studies]
    found = {}
    for task in tasks:
        kept = _kept(task, tell)
        if kept is not None:
            tell(f"{task.name}: finished before")
            found[task.name] = kept
    waiting = [task for task in tasks if task.name not in found]
    if jobs == 1 or len(waiting) <= 1:
        for task in waiting:
            found[task.name] = _make(task, on_progress, tell)
    elif waiting:
        found.update(_make_at_once(waiting, jobs, tell))
    return tuple(found[study.name] for study in studies)


def versions_here() -> dict[str, str]:
    """Versions that the numbers depend on.

    Raises
    ------
    MissingError
        There is no solver.
    """
    if find_ccx() is None:
        raise MissingError(
            "verify takes a solver, and there is no ccx on the PATH; "
            f"install it: {SOLVER_INSTALL_LINE}"
        )
    versions = {"fembridge": __version__, "CalculiX": check_ccx().found.split(",")[0]}
    other = skfem_version()
    return versions if other is None else {**versions, "scikit-fem": other}


def cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _study(task: _Task) -> Study:
    return studies_named([task.name])[0]


def _kept(task: _Task, tell: Tell) -> Finding | None:
    """Give the finding that stands there; a damaged one is told of and made again."""
    path = finding_path(task.folder, task.name)
    inputs = inputs_of_study(_study(task).module, quick=task.quick, versions=task.versions)
    try:
        return read_finding(path, inputs)
    except ResponseError as error:
        tell(f"{task.name}: made again: {error}")
        return None


def _make(task: _Task, on_progress: OnProgress | None, tell: Tell) -> Finding:
    study = _study(task)
    bench = Bench(task.folder, quick=task.quick, on_progress=on_progress, tell=tell)
    finding = study.make(bench)
    inputs = inputs_of_study(study.module, quick=task.quick, versions=task.versions)
    write_finding(finding_path(task.folder, task.name), finding, inputs)
    return finding


def _make_here(task: _Task) -> Finding:
    """Do it in a process of its own, whose lines go to stderr."""
    return _make(task, None, lambda line: print(line, file=sys.stderr, flush=True))


def _end_with(parent: int) -> None:
    """Have the system end this process when its parent dies, be it by ``kill -9``.

    Ctrl-C in a terminal reaches both; what it means is for the parent to say.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:  # it died before the wish was made
        sys.exit(1)


def _make_at_once(tasks: Sequence[_Task], jobs: int, tell: Tell) -> dict[str, Finding]:
    """Make several; the first that fails ends the others, whose runs are kept."""
    order = sorted(
        tasks, key=lambda task: _LONGEST.index(task.name) if task.name in _LONGEST else 99
    )
    context = multiprocessing.get_context("spawn")
    found = {}
    with (
        signals_as_exits(),
        ProcessPoolExecutor(
            min(jobs, len(tasks)), context, initializer=_end_with, initargs=(os.getpid(),)
        ) as pool,
    ):
        futures = {pool.submit(_make_here, task): task for task in order}
        try:
            left = set(futures)
            while left:
                done, left = wait(left, return_when=FIRST_COMPLETED)
                for future in done:
                    name = futures[future].name
                    found[name] = future.result()
                    tell(f"{name}: done, {len(found)} of {len(tasks)}")
        except BrokenProcessPool as error:
            raise SolverError(
                "the process of a study was killed; what is finished is kept: run this again",
                tasks[0].folder,
            ) from error
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for child in multiprocessing.active_children():
                child.terminate()
            raise
    return found
