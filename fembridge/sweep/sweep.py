"""A sweep from its study to its table: what is finished stays, the rest is done.

Below the folder of a sweep::

    study.toml    the study, and what it was done with
    runs/KEY/     an item: answers.csv, spikes.csv, item.toml
    solves/KEY/   a response or a transient: what the solver read and wrote
    results.csv   all points, written when nothing is left to do
"""

import hashlib
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fembridge import __version__
from fembridge.errors import OutputError, UsageError
from fembridge.solver.ccx import SolverSettings, signals_as_exits
from fembridge.store import make_folder, write_text
from fembridge.sweep.answers import is_finished
from fembridge.sweep.board import Board
from fembridge.sweep.crew import Crew, Ended
from fembridge.sweep.dask_crew import DaskCrew
from fembridge.sweep.local_crew import LocalCrew
from fembridge.sweep.plan import Plan, plan_of
from fembridge.sweep.solver_version import solver_version
from fembridge.sweep.study import Study
from fembridge.sweep.study_file import read_study
from fembridge.sweep.table import RESULTS_FILE, write_results
from fembridge.sweep.task import STORED, Item, Response
from fembridge.sweep.work import STUDY_FILE, Finding, known_response

EXECUTORS = ("local", "dask")


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """What became of a study: `causes` tells why, by the key of an item that failed.

    `before` items were finished when it began; `rows` are those of the table
    `results`.
    """

    folder: Path
    plan: Plan
    causes: Mapping[str, str]
    before: int
    rows: int

    @property
    def results(self) -> Path:
        """The table."""
        return self.folder / RESULTS_FILE

    @property
    def failed(self) -> tuple[Item, ...]:
        """Items that failed, in the order of the study."""
        return tuple(item for key, item in self.plan.items.items() if key in self.causes)


def run_sweep(
    study: Study | Path | str,
    folder: Path,
    *,
    jobs: int = 1,
    executor: str = "local",
    scheduler: str | None = None,
    threads: int | None = None,
    shows: bool = False,
) -> Sweep:
    """Do what is not done of `study` in `folder`; write the table of all of it.

    Parameters
    ----------
    jobs
        Processes on this machine; a cluster has its own.
    executor, scheduler
        ``local``, or ``dask`` with the address of a scheduler, ``tcp://…``; without
        an address a cluster of `jobs` processes is made here. All workers see
        `folder` under the same path.
    threads
        Of each solver; by default the cores are shared, and 1 on a cluster.
    shows
        Tell on stderr how far it is.

    Returns
    -------
    Sweep
        Items that failed are in it; nothing of a single item is raised.

    Raises
    ------
    UsageError
        The study is not to be understood, or the numbers are.
    MissingError
        No solver, and the study does not say ``stored``; or no dask.
    OutputError
        `folder` cannot be written.
    """
    if jobs < 1:
        raise UsageError(f"jobs is {jobs}, expected 1 or more")
    if executor not in EXECUTORS:
        raise UsageError(f"executor {executor!r}, expected {' or '.join(EXECUTORS)}")
    if scheduler is not None and executor != "dask":
        raise UsageError("a scheduler is for the executor dask")
    if not isinstance(study, Study):
        study = read_study(Path(study))
    folder = make_folder(folder).resolve()
    settings = SolverSettings(threads=threads, jobs=jobs)
    if executor == "local":
        solver = STORED if study.stored else solver_version()
        each = settings.shared_by(jobs).threads
        return _run(study, folder, solver, shows, lambda: LocalCrew(folder, jobs, each))
    each = threads or (1 if scheduler else settings.shared_by(jobs).threads)
    crew = DaskCrew(folder, scheduler, jobs, each)
    try:
        solver = STORED if study.stored else crew.solver()
        return _run(study, folder, solver, shows, lambda: crew)
    finally:
        crew.close()


def _run(study: Study, folder: Path, solver: str, shows: bool, hire: Callable[[], Crew]) -> Sweep:
    plan = plan_of(study, solver)
    left = {
        key: item for key, item in plan.items.items() if not is_finished(folder / item.place, item)
    }
    before = len(plan.items) - len(left)
    _forget(folder / RESULTS_FILE)
    write_text(folder / STUDY_FILE, _provenance(study, solver, plan) + study.text)
    causes: dict[str, str] = {}
    if left:
        with signals_as_exits(), Board(len(plan.items), before, shows=shows) as board:
            crew = hire()
            try:
                causes = _do(left, folder, crew, board)
            finally:
                crew.close()
    rows = write_results(folder, plan, causes)
    return Sweep(folder, plan, causes, before, rows)


def _do(left: Mapping[str, Item], folder: Path, crew: Crew, board: Board) -> dict[str, str]:
    """Have all items of `left` done, each after its response; give why some failed."""
    behind: dict[str, list[Item]] = {}
    responses: dict[str, Response] = {}
    for item in left.values():
        behind.setdefault(item.response.key, []).append(item)
        responses[item.response.key] = item.response
    for key, response in responses.items():
        if response.solver == STORED or known_response(response, folder) is not None:
            for item in behind.pop(key):
                crew.submit(item)
        else:
            crew.submit(response)
    causes: dict[str, str] = {}
    waiting = len(left)
    while waiting:
        event = crew.next_event()
        board(event)
        if not isinstance(event, Ended):
            continue
        finding = event.finding
        if isinstance(event.task, Item):
            waiting -= 1
            if not finding.finished:
                causes[finding.key] = finding.cause
            continue
        for item in behind.pop(finding.key):
            if finding.finished:
                crew.submit(item)
            else:
                waiting -= 1
                causes[item.key] = finding.cause
                board.over(item, Finding(item.key, finding.cause))
    return causes


def _forget(results: Path) -> None:
    """Take the old table away: it may be of another study, and it is not whole now."""
    try:
        results.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"cannot be replaced: {error.strerror}", results) from error


def _provenance(study: Study, solver: str, plan: Plan) -> str:
    """Give comments to stand over the study's own text."""
    digest = hashlib.sha256(study.text.encode()).hexdigest()
    files = dict.fromkeys(each.label for each in study.variants)
    lines = [
        f"sweep of the study {study.name!r}, {study.points} points, {len(plan.items)} items",
        f"fembridge {__version__}, solver {solver}, "
        f"Python {sys.version.split()[0]}, NumPy {np.__version__}",
        f"fingers {', '.join(files)}; parameters {study.parameters.name}",
        f"sha256 of what follows: {digest}" if study.text else "made in Python",
        "file names count from the folder of the original",
    ]
    return "".join(f"# {line}\n" for line in lines) + "\n"
