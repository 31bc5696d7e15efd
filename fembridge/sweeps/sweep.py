"""A sweep from its study to its table: what is finished stays, the rest is done.

Below the folder of a sweep::

    study.toml    the study, and what it was done with
    runs/KEY/     an item: answers.csv, spikes.csv, item.toml
    solves/KEY/   a response or a transient: what the solver read and wrote
    results.csv   all points, written when nothing is left to do

There are responses to be solved once, and items that read them. Both are values that a
worker on any machine can do. Their key is the digest of all that goes into them, so the
same work has the same folder, and `work` may be begun anywhere any number of times: one
process at a time has the folder, the others find it finished. The folder of a finished
item::

    answers.csv  rate, spikes and peak stress by stimulus and afferent
    spikes.csv   every spike, as in the other verbs
    item.toml    what it was made of and how, with the checksums of the two

The record is written last and carries a checksum of its own: where all agree, the
item is finished and whole.
"""

import hashlib
import sys
import threading
import time
import traceback
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, Future
from contextlib import AbstractContextManager, ExitStack, suppress
from dataclasses import asdict, dataclass
from datetime import timedelta
from functools import cache, cached_property
from itertools import chain, product
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np

from decks.analysis import Contact, Model
from decks.finger import Finger
from decks.mesh import Mesh, read_mesh, write_mesh
from decks.presets import finger_table, mesh_of
from decks.probe import Probe
from decks.stimuli import Entry
from decks.waveform import make_stimulus
from fembridge.build import stimulus_inputs
from fembridge.cache import check_cache
from fembridge.errors import (
    FembridgeError,
    FingerError,
    LockedError,
    MissingError,
    OutputError,
    ResponseError,
    UsageError,
)
from fembridge.executor import LocalExecutor, WorkerDiedError, dask_executor, finished, send
from fembridge.machine import SOLVER_INSTALL_LINE, find_ccx, version_of
from fembridge.response.indentation import depth_for, solve_response
from fembridge.response.response_map import MAP_FILE, ResponseMap, read_map, stored_response
from fembridge.simulation import SPIKES_FILE, Simulation, encode_all, solve_transients
from fembridge.solver.process import signals_as_exits
from fembridge.solver.settings import Progress, SolverSettings
from fembridge.stimulus import Stimulus
from fembridge.store import (
    SHORT,
    digest,
    filling,
    folder_lock,
    make_folder,
    read_sealed,
    remove_file,
    sha256_of,
    write_sealed,
    write_text,
)
from fembridge.sweeps.fingers import Variant, naming
from fembridge.sweeps.study import Asked, Study, ladder_of, read_study
from fembridge.tables import write_spikes, write_table
from fembridge.terminal import Bars, how_far
from fembridge.typing import Table
from fembridge.version import __version__
from neural import Parameters
from neural.parameter_sets import parameters_to_table
from neural.rates import spikes_inside

if TYPE_CHECKING:
    import pandas as pd

EXECUTORS = ("local", "dask")
_AT_ONCE = 1000  # tasks given to a cluster: more than it has workers
RESULTS_FILE = "results.csv"

FORMAT = 1
"""Of what a key is made of; another number, and all is done again."""

STORED = "stored"
"""In the place of a solver: the responses that are shipped."""

STUDY_FILE = "study.toml"
ANSWERS_FILE = "answers.csv"
RECORD_FILE = "item.toml"
MESH_FILE = "mesh.npz"

ANSWER_COLUMNS = ("stimulus", "afferent", "rate_ips", "spikes", "peak_stress_pa")
"""`spikes` are those inside the counting window, of all cells of a population;
`peak_stress_pa` is the largest stress that the afferent's drive reads."""

BUG_FILE = "failed.txt"

_SOLVES, _RUNS, _LOCK = "solves", "runs", ".lock"
_FILES = (ANSWERS_FILE, SPIKES_FILE)
# What makes a transient another one than those before: see decision 0014.
_HOW_SOLVED = {"drive": "spring", "section": "half"}

# gmsh has one state a process.
_meshing = threading.Lock()


class _Keyed:
    """What is known, and has its folder, by the digest of all that goes into it."""

    below: ClassVar[str]

    def inputs(self) -> Table:
        """What it is made of."""
        raise NotImplementedError

    @cached_property
    def key(self) -> str:
        """Digest of all that goes into it."""
        return digest(self.inputs())

    @property
    def place(self) -> Path:
        """Its folder, below that of the sweep."""
        return Path(self.below, self.key[:SHORT])


@dataclass(frozen=True, eq=False)
class Response(_Keyed):
    """The indentation of one finger with one probe, to be solved once.

    `solver` is its name and version; ``stored`` takes a shipped response.
    """

    finger: Finger
    probe: Probe
    asked: Asked
    element: str
    depth_um: float
    solver: str
    label: str = ""
    below: ClassVar[str] = _SOLVES

    def inputs(self) -> Table:
        """What it is made of."""
        return {
            "format": FORMAT,
            "fembridge": __version__,
            "solver": self.solver,
            "element": self.element,
            "depth_um": self.depth_um,
            "contact": dict(self.asked),
            "probe": asdict(self.probe),
            "finger": finger_table(self.finger),
        }

    def read(self, folder: Path) -> ResponseMap:
        """What it came to in the sweep's `folder`, or what is stored for it."""
        if self.solver == STORED:
            return stored_response(self.finger, self.probe, self.element, depth_um=self.depth_um)
        return read_map(folder / self.place / MAP_FILE)

    def is_finished(self, folder: Path) -> bool:
        """Whether nothing has to be solved for it in the sweep's `folder`."""
        with suppress(ResponseError):
            return self.solver == STORED or bool(self.read(folder))
        return False


@dataclass(frozen=True, eq=False)
class Item(_Keyed):
    """One row of work: `entries` on a response, by one method, with one set of cells.

    By map it holds all stimuli of the study, as a transient one. `parameters_name`
    is no part of its key: the numbers are.
    """

    response: Response
    method: str
    entries: tuple[Entry, ...]
    preindent_um: float
    seed: int | None
    parameters: Parameters
    parameters_name: str = ""
    label: str = ""
    below: ClassVar[str] = _RUNS

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", dict(self.parameters))  # it pickles

    @property
    def solve_place(self) -> Path:
        """Where a transient is solved: the folder of its motion, whatever the cells."""
        waves = [stimulus_inputs(each) for each in self.stimuli()]
        key = digest({"response": self.response.key, "transient": waves})
        return Path(_SOLVES, key[:SHORT])

    def stimuli(self) -> list[Stimulus]:
        """Samples of its stimuli."""
        return [
            make_stimulus(entry, preindent_um=self.preindent_um, seed=self.seed)
            for entry in self.entries
        ]

    def inputs(self) -> Table:
        """What it is made of, its response by key."""
        # Seeds may be longer than any float is exact for.
        seed = {} if self.seed is None else {"seed": str(self.seed)}
        return {
            "format": FORMAT,
            "method": self.method,
            "stimuli": [
                {"id": one.id, "preindent_um": self.preindent_um, **one.numbers(), **seed}
                for one in sorted(self.entries, key=lambda entry: entry.id)
            ],
            **(_HOW_SOLVED if self.method == "transient" else {}),
            "parameters": parameters_to_table(self.parameters),
            "response": self.response.key,
        }

    def is_finished(self, folder: Path) -> bool:
        """Whether the sweep's `folder` has all of it, as it was written."""
        place = folder / self.place
        try:
            record = read_sealed(place / RECORD_FILE, "record of an item", FORMAT)
            return record["key"] == self.key and all(
                sha256_of(place / name) == record["files"][name] for name in _FILES
            )
        except (FembridgeError, OSError, KeyError, TypeError):
            return False

    def __str__(self) -> str:
        return self.label


Task = Response | Item


@dataclass(frozen=True, slots=True)
class Ended:
    """How a task ended: `cause` is "" when it is finished.

    `before` says that it was finished before, `busy` that another process is at it.
    """

    cause: str = ""
    before: bool = False
    busy: bool = False
    wall_s: float = 0.0


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
    causes: dict[str, str] = {}
    with ExitStack() as stack:
        cluster = None
        if executor == "dask":
            cluster = stack.enter_context(dask_executor(scheduler, jobs))
        solver = STORED
        if not study.stored:
            solver = _solver_there(cluster) if cluster else solver_version()
        plan = plan_of(study, solver)
        left = {key: item for key, item in plan.items.items() if not item.is_finished(folder)}
        before = len(plan.items) - len(left)
        remove_file(folder / RESULTS_FILE)  # it may be of another study, and is not whole now
        write_text(folder / STUDY_FILE, _provenance(study, solver, plan) + study.text)
        if left:
            stack.enter_context(signals_as_exits())
            shown = stack.enter_context(_Shown(len(plan.items), before, shows=shows))
            pool = cluster or stack.enter_context(LocalExecutor(jobs, shown.follow))
            try:
                causes = _do(left, folder, threads, pool, _AT_ONCE if cluster else jobs, shown)
            except KeyboardInterrupt:
                shown.interrupted()
                raise
    rows = _write_results(folder, plan, causes)
    return Sweep(folder, plan, causes, before, rows)


def plan_of(study: Study, solver: str) -> Plan:
    """Work of `study`, to be done with `solver`, a name and a version."""
    import pandas as pd

    with naming("stimuli"):
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


def work(task: Task, folder: Path, threads: int | None = None, *, waits: bool = True) -> Ended:
    """Do `task` in the sweep's `folder`; what is wrong with it is its cause.

    Where another process is at it, wait if it `waits`, or else say so. A response has
    to be finished before an item that reads it. How far the solver is, is sent to who
    began the task, with the task's label.
    """
    begin_s = time.monotonic()
    cause, before = "", False

    def on_progress(progress: Progress) -> None:
        send((task.label, progress))

    try:
        if not (folder / STUDY_FILE).is_file():
            raise OutputError("not there on this machine: all need to share it", folder)
        before = task.is_finished(folder)
        if not before:
            with _alone(folder / task.place, waits):
                before = task.is_finished(folder)
                if not before:
                    do: Callable[..., None] = _solve if isinstance(task, Response) else _answer
                    do(task, folder, SolverSettings(threads, on_progress=on_progress))
    except LockedError as error:
        return Ended(str(error), busy=True)
    except FembridgeError as error:
        cause = " ".join(str(error).replace(f"{folder}/", "").splitlines())
    except OSError as error:
        cause = f"{error.filename or 'cannot read or write'}: {error.strerror or error}"
    except Exception as error:  # a bug of ours in one item is no end of the others
        with suppress(OutputError):
            write_text(folder / task.place / BUG_FILE, traceback.format_exc())
        found = " ".join(f"{type(error).__name__}: {error}".splitlines())
        cause = f"a bug of fembridge, {BUG_FILE} in its folder has it all: {found}"
    return Ended(cause, before, wall_s=round(time.monotonic() - begin_s, 3))


def read_answers(place: Path) -> "pd.DataFrame":
    """Answers of a finished item: rate, spikes and peak stress by stimulus and afferent."""
    import pandas as pd

    exact = {"rate_ips": float, "spikes": int, "peak_stress_pa": float}
    return pd.read_csv(place / ANSWERS_FILE, converters=exact)


@cache
def solver_version() -> str:
    """Name and version of the solver on this machine, as ``calculix 2.20``."""
    check_cache()
    program = find_ccx()
    if program is None:
        raise MissingError(
            f"no ccx on the PATH; install it: {SOLVER_INSTALL_LINE}; or say "
            "'stored = true' in the study: the reference fingers have stored responses"
        )
    return f"calculix {version_of(program)[0] or 'of no known version'}"


def _solve(task: Response, folder: Path, settings: SolverSettings) -> None:
    _check_solver(task.solver)
    place = folder / task.place
    solve_response(
        place,
        Model(task.finger, _mesh(task, place), task.probe, element=task.element),
        task.depth_um,
        settings,
        ladder=ladder_of(task.asked),
    )


def _answer(item: Item, folder: Path, settings: SolverSettings) -> None:
    """Simulate an item and write its three files, the record last."""
    place, begin_s = folder / item.place, time.monotonic()
    response = item.response.read(folder)
    simulation = _simulate(item, response, folder, settings)
    how = {
        "solver": item.response.solver,
        "wall_s": round(time.monotonic() - begin_s, 3),
        "closure_percent": response.closure_percent,
        "contact": response.origin.get("contact", {}),
        "response": str(item.response.place),
    }
    with filling(place, last=RECORD_FILE) as draft:
        write_table(draft / ANSWERS_FILE, ANSWER_COLUMNS, _answers_of(simulation))
        write_spikes(draft / SPIKES_FILE, simulation.trains)
        record = {
            "format": FORMAT,
            "key": item.key,
            "parameter_set": item.parameters_name,
            "how": how,
            "files": {name: sha256_of(draft / name) for name in _FILES},
            "inputs": {**item.inputs(), "response": item.response.inputs()},
        }
        write_sealed(draft / RECORD_FILE, record)
    with suppress(OSError):
        (place / BUG_FILE).unlink(missing_ok=True)


def _simulate(
    item: Item, response: ResponseMap, folder: Path, settings: SolverSettings
) -> Simulation:
    """Spikes of all stimuli of an item: by the map, or each waveform solved."""
    task, stimuli = item.response, item.stimuli()
    if item.method == "map":
        traces = [response.traces(each, item.parameters) for each in stimuli]
    else:
        accepted = Contact(**cast("dict[str, Any]", response.origin["contact"]))
        mesh = _mesh(task, folder / task.place)
        model = Model(task.finger, mesh, task.probe, accepted, task.element)
        place, ladder = folder / item.solve_place, ladder_of(task.asked)
        with _alone(place):
            _check_solver(task.solver)
            traces, _ = solve_transients(stimuli, model, place, settings, lambda line: None, ladder)
    return encode_all(stimuli, traces, item.parameters, {})


def _answers_of(simulation: Simulation) -> Iterator[tuple[str, str, float, int, float]]:
    """A row for each stimulus and afferent, of `ANSWER_COLUMNS`."""
    spikes: Counter[tuple[str, str]] = Counter()
    windows = {each.id: each.window_ms for each in simulation.stimuli}
    for train in simulation.trains:
        inside = spikes_inside(train.times_ms, windows[train.stimulus])
        spikes[train.stimulus, train.afferent] += inside
    traces = chain.from_iterable(simulation.traces)
    for rate, trace in zip(simulation.mean_rates, traces, strict=True):
        key = rate.stimulus, rate.afferent
        yield (*key, rate.rate_ips, spikes[key], float(trace.stress_pa.max()))


def _mesh(task: Response, place: Path) -> Mesh:
    """Mesh beside the response, made where there is none: all that follows shares it."""
    with suppress(FingerError):
        return read_mesh(place / MESH_FILE)
    with _meshing:
        mesh = mesh_of(task.finger)
    write_mesh(place / MESH_FILE, mesh)
    return mesh


def _alone(place: Path, waits: bool = True) -> AbstractContextManager[None]:
    return folder_lock(make_folder(place), _LOCK, wait=waits)


def _check_solver(planned: str) -> None:
    """Refuse another solver than the one that the key speaks of."""
    if (here := solver_version()) != planned:
        raise MissingError(f"{here} is here, the sweep was laid out for {planned}")


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
