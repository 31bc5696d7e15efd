"""Many run folders, several at once; one that fails does not stop the others.

Another package adds a solver under the entry point group ``fembridge.solvers``: the
entry's name is the one in ``run.toml``, its object a function as `run_ccx` is.
"""

import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import entry_points
from pathlib import Path
from typing import TypeAlias

from decks.dialects import DIALECTS
from fembridge.errors import FembridgeError, MissingError
from fembridge.run_folder import RunFolder, read_run_folder
from fembridge.solver.ccx import finished_outcome, run_ccx, signals_as_exits
from fembridge.solver.settings import DEFAULTS, SolverSettings
from fembridge.solver.verdict import Cause, Failure, Outcome

Solver: TypeAlias = Callable[[RunFolder, SolverSettings, threading.Event | None], Outcome]
"""Solve one run; a run that is not accepted is an outcome, not an exception."""

ENTRY_POINTS = "fembridge.solvers"


def load_solver(name: str) -> Solver:
    """The function that runs the solver `name`."""
    if name == "calculix":
        return run_ccx
    rows = entry_points(group=ENTRY_POINTS)
    for row in rows.select(name=name):
        loaded: Solver = row.load()
        return loaded
    if name in DIALECTS:
        raise MissingError(
            f"{name.capitalize()} is run with your own solver, in the run folder: "
            f"{DIALECTS[name].how_to_run}"
        )
    known = ", ".join(sorted({"calculix", *rows.names}))
    raise MissingError(f"no solver {name!r} here; there is {known}")


def run_folders(
    folders: Iterable[Path | RunFolder], settings: SolverSettings = DEFAULTS, *, force: bool = False
) -> list[Outcome]:
    """Outcomes, one a folder, in the order given; a duplicate is run once.

    Each is run with the solver that its ``run.toml`` names, ``settings.jobs`` at the
    same time; with `force` also where whole results of the same deck are. All that is
    wrong with one folder is the failure in its outcome; nothing of it is raised.
    """
    halt = threading.Event()

    def solve(one: Path | RunFolder) -> Outcome:
        folder = _folder_of(one)
        if halt.is_set():
            return Outcome(folder, Failure(Cause.INTERRUPTED, "before it began"))
        try:
            run = read_run_folder(one) if isinstance(one, Path) else one
            solver = load_solver(run.solver)
            finished = None if force else finished_outcome(run)
            return finished or solver(run, settings, halt)
        except FembridgeError as error:
            problem = str(error).removeprefix(f"{folder}: ")
            return Outcome(folder, Failure(Cause.BAD_FOLDER, problem))
        except BaseException:
            halt.set()  # before this thread takes the next folder
            raise

    unique: dict[Path, Path | RunFolder] = {}
    for each in folders:
        unique.setdefault(_folder_of(each).resolve(), each)
    with signals_as_exits(), ThreadPoolExecutor(settings.jobs) as pool:
        try:
            return list(pool.map(solve, unique.values()))
        finally:  # after Ctrl-C the pool waits until each solver is stopped
            halt.set()


def _folder_of(one: Path | RunFolder) -> Path:
    return one if isinstance(one, Path) else one.folder
