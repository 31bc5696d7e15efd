"""A sweep from its study to its table: what is finished stays, the rest is done.

Below the folder of a sweep::

    study.toml    the study, and what it was done with
    runs/KEY/     an item: answers.csv, spikes.csv, item.toml
    solves/KEY/   a response or a transient: what the solver read and wrote
    results.csv   all points, written when nothing is left to do
"""

import hashlib
import sys
from collections import deque
from collections.abc import Mapping
from concurrent.futures import Executor, Future
from contextlib import nullcontext
from dataclasses import dataclass
from datetime import timedelta
from itertools import product
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from decks.probe import Probe
from decks.waveform import make_stimulus
from fembridge.errors import FembridgeError, MissingError, UsageError
from fembridge.executor import LocalExecutor, WorkerDiedError, dask_executor, finished
from fembridge.response.indentation import depth_for
from fembridge.solver.process import signals_as_exits
from fembridge.solver.settings import Progress, SolverSettings
from fembridge.store import make_folder, remove_file, write_text
from fembridge.sweeps.fingers import Variant, place
from fembridge.sweeps.study import Asked, Study, read_study
from fembridge.sweeps.work import (
    ANSWER_COLUMNS,
    STORED,
    STUDY_FILE,
    Ended,
    Item,
    Response,
    Task,
    read_answers,
    solver_version,
    work,
)
from fembridge.terminal import Bars, how_far
from fembridge.version import __version__

if TYPE_CHECKING:
    import pandas as pd

EXECUTORS = ("local", "dask")
_AT_ONCE = 1000  # tasks given to a cluster: more than it has workers
RESULTS_FILE = "results.csv"


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Work of a study: `items` by their keys, and how its table begins.

    `rows` has one for each point and afferent: what is different from point to point,
    and the ``key`` of the item that answers it.
    """

    rows: "pd.DataFrame"
    items: Mapping[str, Item]


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """What became of a study: `causes` by the key of an item that failed.

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
        """The table as a file."""
        return self.folder / RESULTS_FILE

    @property
    def table(self) -> "pd.DataFrame":
        """The table: a row for each point and afferent."""
        import pandas as pd

        return pd.read_csv(self.results)

    @property
    def failed(self) -> tuple[Item, ...]:
        """Items that failed, in the order of the study."""
        return tuple(item for key, item in self.plan.items.items() if key in self.causes)


def sweep(
    study: Study | Path | str,
    output: Path | str = "sweep",
    *,
    jobs: int = 1,
    executor: str = "local",
    scheduler: str | None = None,
    threads: int | None = None,
    shows: bool = False,
) -> Sweep:
    """Solve many stimuli on many fingers, each once, as the TOML file `study` says.

    Goes on where an earlier sweep into `output` ended. Its ``results`` is the path of the
    table, ``failed`` lists items without an answer, ``causes`` why: nothing of a single item
    is raised.

    Parameters
    ----------
    jobs, threads
        Processes on this machine, and threads of each solver.
    executor, scheduler
        ``local``, or ``dask`` with the address of a cluster, without one of one made here;
        all its workers see `output` under the same path.
    shows
        Show on stderr how far it is.

    Raises
    ------
    UsageError, OutputError
        A study or numbers that mean nothing; `output` cannot be written.
    MissingError
        No solver, and the study does not say ``stored``; or no dask.

    Examples
    --------
    >>> import fembridge as fb
    >>> with open("study.toml", "w") as file:
    ...     print('stimuli = ["sine_20_250"]', "stored = true", sep=chr(10), file=file)
    >>> fb.sweep("study.toml", "sweep").failed
    ()
    """
    if jobs < 1:
        raise UsageError(f"jobs is {jobs}, expected 1 or more")
    if executor not in EXECUTORS:
        raise UsageError(f"executor {executor!r}, expected {' or '.join(EXECUTORS)}")
    if scheduler is not None and executor != "dask":
        raise UsageError("scheduler is for the executor dask")
    if not isinstance(study, Study):
        study = read_study(Path(study))
    folder = make_folder(Path(output)).resolve()
    here = SolverSettings(threads=threads, jobs=jobs).shared_by(jobs).threads
    threads = here if scheduler is None else threads or 1
    if executor == "local":
        solver = STORED if study.stored else solver_version()
        return _run(study, folder, solver, threads, shows, jobs)
    with dask_executor(scheduler, jobs) as cluster:
        solver = STORED if study.stored else _solver_there(cluster)
        return _run(study, folder, solver, threads, shows, _AT_ONCE, cluster)


def plan_of(study: Study, solver: str) -> Plan:
    """Work of `study`, to be done with `solver`, a name and a version."""
    import pandas as pd

    with place("stimuli"):
        deepest_um = {
            (entry.id, um): float(make_stimulus(entry, um, study.seed).displacement_um.max())
            for entry in study.stimuli
            for um in study.preindents_um
        }
    rows: list[dict[str, Any]] = []
    items: dict[str, Item] = {}
    for variant, probe, shared in product(study.variants, study.probes, study.contacts):
        finger, asked = variant.finger, {**shared, **variant.contact}
        label = _label(study, variant, probe, shared)
        responses: dict[float, Response] = {}  # by depth
        columns = _columns(study, variant, probe, shared)
        for preindent_um, asked_method in product(study.preindents_um, study.methods):
            # Of skin that relaxes there is no map: each waveform is solved.
            method = "transient" if finger.relaxing_s else asked_method
            by_map = method == "map"  # all stimuli are one item
            for entries in [study.stimuli] if by_map else [(each,) for each in study.stimuli]:
                depth_um = depth_for(max(deepest_um[entry.id, preindent_um] for entry in entries))
                response = responses.setdefault(
                    depth_um,
                    Response(finger, probe, asked, study.element, depth_um, solver, label),
                )
                words = [label, method if by_map else f"{method} {entries[0].id}"]
                if len(study.preindents_um) > 1:
                    words.append(f"pre-indented by {preindent_um:g} um")
                item = Item(
                    response,
                    method,
                    entries,
                    preindent_um,
                    study.seed,
                    study.parameters.parameters,
                    study.parameters.name,
                    ", ".join(words),
                )
                items.setdefault(item.key, item)
                point = {**columns, "preindent_um": preindent_um, "method": method}
                rows += [
                    {**point, "stimulus": entry.id, "afferent": name, "key": item.key}
                    for entry in entries
                    for name in finger.afferents
                ]
    table = pd.DataFrame(rows, dtype=object)
    return Plan(table.drop_duplicates(["finger", "key", "stimulus", "afferent"]), items)


def _columns(study: Study, variant: Variant, probe: Probe, asked: Asked) -> dict[str, Any]:
    """What is different from point to point, and the usual sizes of the probe."""
    names = dict.fromkeys(n for each in study.variants for n in each.changes)
    asked_names = dict.fromkeys(n for each in study.contacts for n in each)
    flat = any(each.shape == "flat" for each in study.probes)
    return {
        "finger": variant.label,
        **{name: variant.value(name) for name in names},
        "probe_shape": probe.shape,
        "probe_diameter_mm": probe.diameter_mm,
        **({"probe_fillet_mm": probe.fillet_mm} if flat else {}),
        "probe_x_mm": probe.x_mm,
        **{f"contact_{name}": asked.get(name) for name in asked_names},
    }


def _label(study: Study, variant: Variant, probe: Probe, asked: Asked) -> str:
    """What distinguishes a response from the others of the study, and no more."""
    words = [str(variant)]
    if len(study.probes) > 1:
        words.append(f"{probe.shape} {probe.diameter_mm:g} mm at x = {probe.x_mm:g} mm")
    words += [f"{name}={value}" for name, value in asked.items()]
    return ", ".join(words)


def _run(
    study: Study,
    folder: Path,
    solver: str,
    threads: int | None,
    shows: bool,
    jobs: int,
    cluster: Executor | None = None,
) -> Sweep:
    """Do what is not done, `jobs` tasks at a time, on a `cluster` or in processes here."""
    plan = plan_of(study, solver)
    left = {key: item for key, item in plan.items.items() if not item.is_finished(folder)}
    before = len(plan.items) - len(left)
    remove_file(folder / RESULTS_FILE)  # it may be of another study, and is not whole now
    write_text(folder / STUDY_FILE, _provenance(study, solver, plan) + study.text)
    causes: dict[str, str] = {}
    if left:
        with (
            signals_as_exits(),
            _Shown(len(plan.items), before, shows=shows) as shown,
            nullcontext(cluster) if cluster else LocalExecutor(jobs, shown.follow) as executor,
        ):
            try:
                causes = _do(left, folder, threads, executor, jobs, shown)
            except KeyboardInterrupt:
                shown.interrupted()
                raise
    rows = _write_results(folder, plan, causes)
    return Sweep(folder, plan, causes, before, rows)


def _do(
    left: Mapping[str, Item],
    folder: Path,
    threads: int | None,
    executor: Executor,
    jobs: int,
    shown: "_Shown",
) -> dict[str, str]:
    """Have all items of `left` done, each after its response; why some failed."""
    behind: dict[str, list[Item]] = {}
    for item in left.values():
        behind.setdefault(item.response.key, []).append(item)
    # An item goes before the responses that wait: so it is known early what comes of
    # the first fingers, and how long all take.
    responses = [items[0].response for items in behind.values()]
    known = [response for response in responses if response.is_finished(folder)]
    ready: deque[Task] = deque(item for each in known for item in behind.pop(each.key))
    ready.extend(response for response in responses if response.key in behind)
    put_off: set[str] = set()
    causes: dict[str, str] = {}

    def submit(task: Task) -> "Future[Ended]":
        return executor.submit(work, task, folder, threads, waits=task.key in put_off)

    for task, future in finished(submit, ready, jobs):
        ended = _ended(future)
        if ended.busy:  # in another sweep: looked at again later, and then waited for
            put_off.add(task.key)
            ready.append(task)
        elif isinstance(task, Response) and not ended.cause:
            ready.extendleft(reversed(behind.pop(task.key)))
        else:
            for item in [task] if isinstance(task, Item) else behind.pop(task.key):
                shown.over(item, ended)
                if ended.cause:
                    causes[item.key] = ended.cause
    return causes


def _ended(future: "Future[Ended]") -> Ended:
    try:
        return future.result()
    except WorkerDiedError as error:
        return Ended(str(error))
    except Exception as error:  # of dask: a worker that died too often, a cancelled task
        return Ended("failed: " + " ".join(f"{type(error).__name__}: {error}".splitlines()))


def _solver_there(executor: Executor) -> str:
    """Solver of a worker of a cluster; waits for the first to be there."""
    try:
        found = executor.submit(_version_or_error).result()
    except Exception as error:
        raise MissingError(f"a dask worker cannot begin: {error}") from error
    if isinstance(found, FembridgeError):
        raise found
    return found


def _version_or_error() -> str | FembridgeError:
    try:
        return solver_version()
    except FembridgeError as error:
        return error  # raised there, dask would print where


def _provenance(study: Study, solver: str, plan: Plan) -> str:
    """Comments to stand over the study's own text."""
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


def _write_results(folder: Path, plan: Plan, causes: Mapping[str, str]) -> int:
    """Write a row for each point and afferent, failed ones too; how many there are."""
    import pandas as pd

    causes = dict(causes)
    answers = [pd.DataFrame(columns=["key", *ANSWER_COLUMNS], dtype=object)]
    for key, item in plan.items.items():
        if key not in causes:
            try:
                answers.append(read_answers(folder / item.place).assign(key=key))
            except (OSError, ValueError) as error:  # it went away since
                causes[key] = str(error)
    found = pd.concat([each.astype(object) for each in answers])
    table = plan.rows.merge(found, how="left", on=["key", "stimulus", "afferent"])
    table["cause"] = table["key"].map(causes)
    table["status"] = np.where(table["cause"].isna(), "done", "failed")
    table["run"] = table["key"].map({key: str(item.place) for key, item in plan.items.items()})
    table = table[[*plan.rows.columns.drop("key"), *ANSWER_COLUMNS[2:], "status", "cause", "run"]]
    write_text(folder / RESULTS_FILE, table.to_csv(index=False, lineterminator="\n"))
    return len(table)


class _Shown(Bars):
    """How far a sweep is, on stderr: bars on a terminal, a line an item elsewhere.

    `before` of `total` items were finished when it began.
    """

    def __init__(self, total: int, before: int, *, shows: bool) -> None:
        super().__init__(0.0, shows=shows)
        self._total, self._before, self._done, self._failed = total, before, before, 0
        if shows and before and not self.on_terminal:
            self.print(f"{before} of {total} items are finished already")
        self._update()

    def follow(self, message: tuple[str, Progress]) -> None:
        """Move the bar of a task's run of the solver; take it away when the run ends."""
        name, progress = message
        if progress.ended:
            self.remove(name)
        else:
            self.show(name, progress.fraction, how_far(progress))
        self._update()

    def over(self, item: Item, ended: Ended) -> None:
        """Count an item that is finished or failed."""
        self._done += not ended.cause
        self._failed += bool(ended.cause)
        if self._shows and ended.cause:
            self.print(f"failed: {item}: {ended.cause}")
        elif self._shows and not self.on_terminal:
            how = "finished elsewhere" if ended.before else f"{ended.wall_s:.1f} s"
            self.print(f"{self._done + self._failed}/{self._total} {item}: {how}")
        self._update()

    def interrupted(self) -> None:
        """Say what is kept."""
        if self._shows:
            kept = f"{self._done} of {self._total} items are kept"
            self.print(f"{kept}; the same command goes on with them")

    def _update(self) -> None:
        over = self._done + self._failed
        words = f"{self._done} done, {self._failed} failed"
        made = over - self._before
        if made and over < self._total:
            left_s = (perf_counter() - self._begin_s) * (self._total - over) / made
            words += f", {timedelta(seconds=round(left_s))} left"
        self.show("sweep", over / self._total, words)
