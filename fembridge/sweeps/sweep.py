"""Run a study and write its table; finished work is kept, the rest is computed.

The folder of a sweep::

    study.toml    the study, with versions and checksum
    runs/KEY/     an item: answers.csv, spikes.csv, item.toml
    solves/KEY/   a response or a transient: deck and output of the solver
    results.csv   all points, written at the end

Each response is solved once; items read responses. Both are tasks that a worker on any
machine can run. The key of a task is the digest of all its inputs, so the same task has the
same folder, and `run_task` may be called anywhere and repeatedly: one process at a time holds
the folder, the others find the task finished. The folder of a finished item::

    answers.csv  rate, spikes and peak stress by stimulus and afferent
    spikes.csv   all spikes, as in the other commands
    item.toml    inputs and method, with the checksums of the two

The record is written last and has its own checksum: an item is finished if all checksums
agree.
"""

import hashlib
import sys
import threading
import time
import traceback
from collections import Counter, deque
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor, Future
from contextlib import AbstractContextManager, ExitStack, suppress
from dataclasses import asdict, dataclass, replace
from datetime import timedelta
from functools import cache, cached_property
from itertools import chain, product
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np

from decks.contact_analysis import Contact, Model
from decks.finger import Finger
from decks.mesh import Mesh, read_mesh, write_mesh
from decks.presets import finger_table, mesh_of
from decks.probe import Probe
from decks.stimuli import Entry
from decks.synthesis import at_step, make_stimulus
from fembridge.errors import (
    FembridgeError,
    FingerError,
    LockedError,
    MissingError,
    OutputError,
    ResponseError,
    UsageError,
)
from fembridge.host.cache import check_cache
from fembridge.host.executor import LocalExecutor, WorkerDiedError, dask_executor, finished, send
from fembridge.host.machine import SOLVER_INSTALL_LINE, find_ccx, version_of
from fembridge.host.process import signals_as_exits
from fembridge.host.progress import Progress
from fembridge.host.store import (
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
from fembridge.host.terminal import Bars, how_far
from fembridge.io.spike_table import write_spikes
from fembridge.io.text_table import read_table, write_table
from fembridge.plots.shown import Shown
from fembridge.response.indentation import depth_for, solve_response
from fembridge.response.response_map import MAP_FILE, ResponseMap, read_map, stored_response
from fembridge.simulation.folder import SPIKES_FILE
from fembridge.simulation.simulation import Simulation, encode_all
from fembridge.simulation.transients import solve_transients
from fembridge.solver.build import stimulus_inputs
from fembridge.solver.mechanics import check_mechanics, fit_mismatch
from fembridge.solver.settings import Solver
from fembridge.stimulus import Stimulus
from fembridge.sweeps.fingers import Variant, located_errors
from fembridge.sweeps.own_decks import DeckModel, solve_map
from fembridge.sweeps.study_file import (
    ContactOptions,
    Study,
    contact_ladder,
    read_study,
    study_from,
    study_from_frame,
)
from fembridge.trace import finger_id, model_id
from fembridge.typing import Table
from fembridge.version import __version__
from neural import Parameters
from neural.parameter_sets import parameters_to_table
from neural.parameters import finest_step_ms
from neural.rates import spikes_inside

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from fembridge.plots.style import Panels

EXECUTORS = ("local", "dask")
_CLUSTER_TASKS = 1000  # tasks submitted to a cluster at a time: more than its workers
RESULTS_FILE = "results.csv"

FORMAT = 1
"""Version of the inputs of a key; another number invalidates all finished tasks."""

STORED = "stored"
"""Solver name of the shipped responses."""

STUDY_FILE = "study.toml"
ANSWERS_FILE = "answers.csv"
RECORD_FILE = "item.toml"
MESH_FILE = "mesh.npz"

ANSWER_COLUMNS = ("stimulus", "afferent", "rate_ips", "spikes", "peak_stress_pa")
"""`spikes` counts the spikes of all cells inside the counting window;
`peak_stress_pa` is the largest stress in the afferent's drive."""

BUG_FILE = "failed.txt"

_SOLVES, _RUNS, _LOCK = "solves", "runs", ".lock"
_FILES = (ANSWERS_FILE, SPIKES_FILE)
# Part of a transient's key, which older methods lack: see decision 0014.
_TRANSIENT_METHOD = {"drive": "spring", "section": "half"}

# gmsh has one global state per process.
_mesher_lock = threading.Lock()


class _Keyed:
    """A task with a key and a folder, both from the digest of its inputs."""

    parent: ClassVar[str]

    def inputs(self) -> Table:
        """All inputs of the task."""
        raise NotImplementedError

    @cached_property
    def key(self) -> str:
        """Digest of all inputs."""
        return digest(self.inputs())

    @property
    def run_folder(self) -> Path:
        """Folder of the task, relative to that of the sweep."""
        return Path(self.parent, self.key[:SHORT])


@dataclass(frozen=True, eq=False)
class Response(_Keyed):
    """The indentation of one finger with one probe, solved once.

    `solver` is a name and version, or ``stored`` for a shipped response.
    """

    finger: Finger
    probe: Probe
    contact: ContactOptions
    element: str
    depth_um: float
    solver: str
    label: str = ""
    parent: ClassVar[str] = _SOLVES

    def inputs(self) -> Table:
        """All inputs of the task."""
        return {
            "format": FORMAT,
            "fembridge": __version__,
            "solver": self.solver,
            "element": self.element,
            "depth_um": self.depth_um,
            "contact": dict(self.contact),
            "probe": asdict(self.probe),
            "finger": finger_table(self.finger),
        }

    @property
    def mechanics(self) -> dict[str, str]:
        """Name and digest of the finger."""
        return finger_id(finger_table(self.finger))

    def read(self, folder: Path) -> ResponseMap:
        """Response map from the sweep's `folder`, or the stored response."""
        if self.solver == STORED:
            return stored_response(self.finger, self.probe, self.element, depth_um=self.depth_um)
        return read_map(folder / self.run_folder / MAP_FILE)

    def is_finished(self, folder: Path) -> bool:
        """Whether the sweep's `folder` has the response map, or it is stored."""
        with suppress(ResponseError):
            return self.solver == STORED or bool(self.read(folder))
        return False


@dataclass(frozen=True, eq=False)
class DeckTask(_Keyed):
    """The response map of a user's deck: one that exists, or one that is solved once.

    `made_from` are the inputs of the map, `options` the arguments of `fembridge.map_deck`, `units`
    class and unit of each afferent.
    """

    deck: DeckModel
    made_from: Table
    options: Mapping[str, Any]
    units: tuple[tuple[str, str], ...]
    solver: str
    label: str = ""
    parent: ClassVar[str] = _SOLVES

    def inputs(self) -> Table:
        """All inputs of the task."""
        solver = {} if self.deck.is_map else {"solver": self.solver, "fembridge": __version__}
        return {"format": FORMAT, **solver, **self.made_from}

    @property
    def mechanics(self) -> dict[str, str]:
        """Name and checksum of the deck."""
        if self.deck.is_map:
            return model_id(self.deck.read_map().origin)
        return {"name": self.deck.path.name, "sha256": str(self.made_from["deck_sha256"])}

    def read(self, folder: Path) -> ResponseMap:
        """The map of the entry, or that in the sweep's `folder`."""
        if self.deck.is_map:
            return self.deck.read_map()
        return read_map(folder / self.run_folder)

    def is_finished(self, folder: Path) -> bool:
        """Whether the map exists."""
        with suppress(ResponseError):
            return bool(self.read(folder))
        return False


@dataclass(frozen=True, eq=False)
class Item(_Keyed):
    """Stimuli `entries` on a response, by one method, with one parameter set.

    By map, an item has all stimuli of the study; as a transient, one. Its key depends on the
    numbers in `parameters`, not on `parameters_name`.
    """

    response: Response | DeckTask
    method: str
    entries: tuple[Entry, ...]
    preindent_um: float
    seed: int | None
    parameters: Parameters
    parameters_name: str = ""
    label: str = ""
    parent: ClassVar[str] = _RUNS

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", dict(self.parameters))  # a dict can be pickled

    @property
    def solve_folder(self) -> Path:
        """Folder of a transient, which depends on the motion, not on the parameter set."""
        waves = [stimulus_inputs(stimulus) for stimulus in self.stimuli()]
        key = digest({"response": self.response.key, "transient": waves})
        return Path(_SOLVES, key[:SHORT])

    def stimuli(self) -> list[Stimulus]:
        """Waveforms of the item."""
        return [
            make_stimulus(entry, preindent_um=self.preindent_um, seed=self.seed)
            for entry in self.entries
        ]

    def inputs(self) -> Table:
        """All inputs of the item, its response by key."""
        # A seed may exceed the exact integers of a float.
        seed = {} if self.seed is None else {"seed": str(self.seed)}
        return {
            "format": FORMAT,
            "method": self.method,
            "stimuli": [
                {"id": entry.id, "preindent_um": self.preindent_um, **entry.numbers(), **seed}
                for entry in sorted(self.entries, key=lambda item: item.id)
            ],
            **(_TRANSIENT_METHOD if self.method == "transient" else {}),
            "parameters": parameters_to_table(self.parameters),
            "response": self.response.key,
        }

    def is_finished(self, folder: Path) -> bool:
        """Whether the sweep's `folder` has all files of the item, with their checksums."""
        item_folder = folder / self.run_folder
        try:
            record = read_sealed(item_folder / RECORD_FILE, "record of an item", FORMAT)
            return record["key"] == self.key and all(
                sha256_of(item_folder / name) == record["files"][name] for name in _FILES
            )
        except (FembridgeError, OSError, KeyError, TypeError):
            return False

    def __str__(self) -> str:
        return self.label


Task = Response | DeckTask | Item


@dataclass(frozen=True, slots=True)
class TaskResult:
    """Outcome of a task: `cause` of its failure, "" if it is finished.

    `before`: it was finished earlier. `busy`: another process is running it.
    """

    cause: str = ""
    before: bool = False
    busy: bool = False
    wall_s: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Tasks of a study: `items` by their keys, and the first columns of its table.

    `rows` has one row per point and afferent: the varied parameters, and the ``key`` of the
    point's item.
    """

    rows: "pd.DataFrame"
    items: Mapping[str, Item]


@dataclass(frozen=True, slots=True)
class FailedTask:
    """An item that failed: its label, its folder relative to that of the sweep, and the cause."""

    item: str
    run: str
    cause: str


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Sweep(Shown):
    """Result of `sweep`.

    Parameters
    ----------
    folder
        Folder of the sweep.
    results
        One row per point and afferent: the varied parameters, ``stimulus, afferent,
        rate_ips, spikes, peak_stress_pa`` (impulses/s, spikes of all cells in the counting
        window, Pa), ``status`` (``done`` or ``failed``), ``cause`` and ``run`` (folder of the
        item).
    failed
        Items that failed, in the order of the study. Default: none.
    finished_before
        Number of items that were finished when the sweep began. Default: 0.

    Examples
    --------
    >>> import fembridge as fb
    >>> sweep = fb.sweep({"stimuli": ["sine_20_250"], "stored": True}, "sweep")
    >>> sweep.results["status"].tolist()
    ['done', 'done', 'done']
    """

    folder: Path
    results: "pd.DataFrame"
    failed: tuple[FailedTask, ...] = ()
    finished_before: int = 0

    @property
    def items(self) -> int:
        """Number of items: stimuli on one response by one method."""
        return int(self.results["run"].nunique())

    @property
    def provenance(self) -> Table:
        """Version, solver, fingers and checksum of the study, from ``study.toml``."""
        lines = (self.folder / STUDY_FILE).read_text(encoding="utf-8").splitlines()
        header = [line.removeprefix("# ") for line in lines[: lines.index("")]]
        return {"study": header[0], "versions": header[1], "inputs": header[2:]}

    def _lines(self) -> list[str]:
        done = self.items - len(self.failed)
        lines = [f"Sweep of {len(self.results)} rows, {done} of {self.items} items done"]
        lines += [f"  failed: {failure.item}: {failure.cause}" for failure in self.failed[:3]]
        return [*lines, f"  {self.folder}"]

    def plot(self, kind: str | None = None, ax: "Panels | None" = None) -> "Figure":
        """Effect of each varied parameter of the finger on rates and stress.

        Parameters
        ----------
        kind
            ``sensitivity``, the only kind. Default: ``sensitivity``.
        ax
            Axes to draw into: one per class, for one-at-a-time designs first those of rates,
            then those of stress. Default: a new figure.

        Raises
        ------
        UsageError
            Another kind, another number of axes, or fewer than two fingers.
        """
        from fembridge.plots.sensitivity_charts import effects_figure, regressions_figure
        from fembridge.sensitivity import effects

        if kind not in (None, "sensitivity"):
            raise UsageError(argument="kind", found=kind, expected="sensitivity")
        swept = effects.read_swept(self.folder / RESULTS_FILE)
        if effects.is_one_at_a_time(swept):
            return effects_figure(effects.single_effects(swept), ax)
        return regressions_figure(effects.rank_regressions(swept), len(swept.parameters), ax)

    def write(self, folder: Path | str) -> None:
        """Copy ``results.csv`` and ``study.toml`` into `folder`, without the runs.

        Parameters
        ----------
        folder
            Folder of the files, which is made.

        Raises
        ------
        OutputError
            The folder cannot be written.
        """
        with filling(Path(folder), last=RESULTS_FILE) as draft:
            for name in (STUDY_FILE, RESULTS_FILE):
                write_text(draft / name, (self.folder / name).read_text(encoding="utf-8"))

    @classmethod
    def read(cls, folder: Path | str) -> "Sweep":
        """Sweep from its folder, or from one that `write` wrote.

        Parameters
        ----------
        folder
            Folder with ``results.csv`` and ``study.toml``.

        Raises
        ------
        TableError
            No ``results.csv``, or not one of a sweep.
        """
        import pandas as pd

        path = Path(folder) / RESULTS_FILE
        read_table(path).check_header((*ANSWER_COLUMNS, "status", "run"))
        results = pd.read_csv(path)
        rows = results[results["status"] == "failed"].drop_duplicates("run")
        failed = tuple(
            FailedTask(str(run), str(run), str(cause))
            for run, cause in zip(rows["run"], rows["cause"], strict=True)
        )
        return cls(Path(folder), results, failed)


def sweep(
    study: "Study | Path | str | Mapping[str, Any] | pd.DataFrame",
    output: Path | str = "sweep",
    *,
    jobs: int = 1,
    executor: str = "local",
    scheduler: str | None = None,
    threads: int | None = None,
    show_progress: bool = False,
) -> Sweep:
    """Table of rates and stresses for all combinations in a study; each response is solved once.

    A sweep resumes an earlier one in `output`. A failed item raises no error: ``failed`` lists
    it with its cause.

    Parameters
    ----------
    study
        The path of a TOML file, a dict with the same keys (file names relative to the current
        folder), a `Study`, or a DataFrame with one row per point. Keys: ``stimuli``, ids or
        sets; ``fingers``, names, or tables of a ``base`` and one of ``grid`` (every combination
        of the listed values, as in the example), ``rows`` or ``ranges``; ``probes`` and
        ``contacts``, tables of the arguments of `fembridge.Probe` and `fembridge.Contact`,
        with lists for every combination; ``methods``; ``preindent_um``; ``parameters``;
        ``seed``; ``element``; ``stored``; ``name``. Columns of the DataFrame:
        ``stimulus``, and optionally ``finger``, ``method``, ``preindent_um``, ``probe_shape``,
        ``probe_diameter_mm``, ``probe_fillet_mm``, ``probe_x_mm`` and dotted names of
        changes to the finger, as ``skin.epidermis_mm`` (empty: unchanged); or, of decks of yours
        (``base_decks``), ``map``, a folder of `fembridge.map_response`, or ``deck``,
        ``afferents`` (nodes by class) and further arguments of `fembridge.map_deck`.
    output
        Folder of the sweep. Default: ``sweep``.
    jobs
        Processes on this machine, 1 or more. Default: 1.
    executor
        ``local``, processes on this machine, or ``dask``. Default: ``local``.
    scheduler
        Address of a dask cluster, as ``tcp://HOST:PORT``. All its workers need `output` under
        the same path. Default: None, a cluster of `jobs` processes on this machine.
    threads
        Threads of each solver. Default: None, the cores divided by `jobs`, 1 with `scheduler`.
    show_progress
        Show progress on stderr. Default: False.

    Returns
    -------
    Sweep
        ``results`` is a DataFrame with one row per point and afferent.

    Raises
    ------
    UsageError, OutputError
        An invalid study or argument; `output` cannot be written.
    MissingError
        No solver is installed and the study is not ``stored``; or dask is not installed.

    Examples
    --------
    >>> import fembridge as fb
    >>> sweep = fb.sweep({"stimuli": ["sine_20_250"], "stored": True}, "sweep")
    >>> sweep.failed
    ()
    >>> sweep.results["afferent"].tolist()
    ['SA', 'RA', 'PC']

    Two thicknesses of the epidermis:

    >>> skins = {"base": "quick", "grid": {"skin.epidermis_mm": [0.3, 0.5]}}
    >>> study = {"stimuli": ["sine_20_250"], "fingers": [skins]}
    >>> sweep = fb.sweep(study, "skins")  # doctest: +SKIP
    """
    if jobs < 1:
        raise UsageError(argument="jobs", found=jobs, expected="1 or more")
    if executor not in EXECUTORS:
        raise UsageError(argument="executor", found=executor, expected=" or ".join(EXECUTORS))
    if scheduler is not None and executor != "dask":
        raise UsageError("requires the executor dask", argument="scheduler")
    if isinstance(study, str | Path):
        study = read_study(Path(study))
    elif isinstance(study, Mapping):
        study = study_from(study, Path.cwd())
    elif not isinstance(study, Study):
        if not hasattr(study, "columns"):
            expected = "a Study, the path of a TOML file, a dict or a DataFrame"
            raise UsageError(argument="study", found=study, expected=expected)
        study = study_from_frame(study)
    if study.stored and threads is not None:
        raise UsageError("is for a solver, the study has stored = true", argument="threads")
    folder = make_folder(Path(output)).resolve()
    local_threads = Solver(threads=threads, jobs=jobs).shared_by(jobs).threads
    threads = local_threads if scheduler is None else threads or 1
    causes: dict[str, str] = {}
    with ExitStack() as stack:
        cluster = None
        if executor == "dask":
            cluster = stack.enter_context(dask_executor(scheduler, jobs))
        solver = STORED
        if not study.stored and not (study.decks and all(deck.is_map for deck in study.decks)):
            solver = _cluster_solver(cluster) if cluster else solver_version()
        plan = make_plan(study, solver)
        _check_mechanics(study, plan)
        unfinished = {key: item for key, item in plan.items.items() if not item.is_finished(folder)}
        finished_before = len(plan.items) - len(unfinished)
        remove_file(folder / RESULTS_FILE)  # from an earlier study; incomplete until the end
        write_text(folder / STUDY_FILE, _provenance(study, solver, plan) + study.text)
        if unfinished:
            stack.enter_context(signals_as_exits())
            display = stack.enter_context(
                _ProgressDisplay(len(plan.items), finished_before, shows=show_progress)
            )
            pool = cluster or stack.enter_context(LocalExecutor(jobs, display.follow))
            try:
                causes = _run_tasks(
                    unfinished, folder, threads, pool, _CLUSTER_TASKS if cluster else jobs, display
                )
            except KeyboardInterrupt:
                display.print_interruption()
                raise
    _write_results(folder, plan, causes)
    failed = tuple(
        FailedTask(str(item), str(item.run_folder), causes[key])
        for key, item in plan.items.items()
        if key in causes
    )
    return replace(Sweep.read(folder), failed=failed, finished_before=finished_before)


def _check_mechanics(study: Study, plan: Plan) -> None:
    """Warn once of each difference between the mechanics of the fit and those of an item."""
    uses: dict[str, tuple[dict[str, str], set[float]]] = {}
    for item in plan.items.values():
        use = item.response.mechanics, {item.preindent_um}
        uses.setdefault(fit_mismatch(study.parameters, *use), use)
    for use in uses.values():
        check_mechanics(study.parameters, *use)


def make_plan(study: Study, solver: str) -> Plan:
    """Items of `study`, to be solved by `solver`, a name and version."""
    import pandas as pd

    with located_errors("stimuli"):
        deepest_um = {
            (entry.id, depth_um): float(
                make_stimulus(entry, depth_um, study.seed).displacement_um.max()
            )
            for entry in study.stimuli
            for depth_um in study.preindents_um
        }
    rows: list[dict[str, Any]] = []
    items: dict[str, Item] = {}
    for variant, probe, shared_contact in product(study.variants, study.probes, study.contacts):
        finger, contact = variant.finger, {**shared_contact, **variant.contact}
        label = _label(study, variant, probe, shared_contact)
        responses: dict[float, Response] = {}  # by depth
        columns = _columns(study, variant, probe, shared_contact)
        for preindent_um, study_method in product(study.preindents_um, study.methods):
            # Relaxing skin has no response map: each waveform is solved.
            method = "transient" if finger.relaxing_s else study_method
            by_map = method == "map"  # all stimuli are one item
            for entries in [study.stimuli] if by_map else [(entry,) for entry in study.stimuli]:
                depth_um = depth_for(max(deepest_um[entry.id, preindent_um] for entry in entries))
                response = responses.setdefault(
                    depth_um,
                    Response(finger, probe, contact, study.element, depth_um, solver, label),
                )
                label_parts = [label, method if by_map else f"{method} {entries[0].id}"]
                if len(study.preindents_um) > 1:
                    label_parts.append(f"pre-indented by {preindent_um:g} um")
                item = Item(
                    response,
                    method,
                    entries,
                    preindent_um,
                    study.seed,
                    study.parameters.parameters,
                    study.parameters.name,
                    ", ".join(label_parts),
                )
                items.setdefault(item.key, item)
                point = {**columns, "preindent_um": preindent_um, "method": method}
                rows += [
                    {**point, "stimulus": entry.id, "afferent": name, "key": item.key}
                    for entry in entries
                    for name in finger.afferents
                ]
    if study.decks:
        rows, items = _deck_rows(study, solver, max(deepest_um.values()))
    table = pd.DataFrame(rows, dtype=object)
    names = ["finger", "key", "stimulus", "afferent", *["unit"] * ("unit" in table)]
    return Plan(table.drop_duplicates(names), items)


def _deck_rows(
    study: Study, solver: str, deepest_um: float
) -> tuple[list[dict[str, Any]], dict[str, Item]]:
    """Rows and items of the own decks of a study."""
    rows: list[dict[str, Any]] = []
    items: dict[str, Item] = {}
    tasks: list[DeckTask] = []
    for number, deck in enumerate(study.decks, start=1):
        with located_errors(f"base_decks {number}"):
            made_from, units, options = deck.plan(deepest_um)
        tasks.append(DeckTask(deck, made_from, options, units, solver, deck.label))
    has_units = any(unit for task in tasks for _, unit in task.units)
    for task, preindent_um in product(tasks, study.preindents_um):
        item = Item(
            task,
            "map",
            study.stimuli,
            preindent_um,
            study.seed,
            study.parameters.parameters,
            study.parameters.name,
            f"{task.label}, map, pre-indented by {preindent_um:g} um",
        )
        items.setdefault(item.key, item)
        rows += [
            {
                "finger": task.label,
                "preindent_um": preindent_um,
                "method": "map",
                "stimulus": entry.id,
                "afferent": afferent,
                **({"unit": unit} if has_units else {}),
                "key": item.key,
            }
            for entry in study.stimuli
            for afferent, unit in task.units
        ]
    return rows, items


def _columns(
    study: Study, variant: Variant, probe: Probe, contact: ContactOptions
) -> dict[str, Any]:
    """Columns of the table: varied parameters, and the probe."""
    names = dict.fromkeys(name for item in study.variants for name in item.changes)
    contact_names = dict.fromkeys(name for item in study.contacts for name in item)
    flat = any(item.shape == "flat" for item in study.probes)
    return {
        "finger": variant.label,
        **{name: variant.value(name) for name in names},
        "probe_shape": probe.shape,
        "probe_diameter_mm": probe.diameter_mm,
        **({"probe_fillet_mm": probe.fillet_mm} if flat else {}),
        "probe_x_mm": probe.x_mm,
        **{f"contact_{name}": contact.get(name) for name in contact_names},
    }


def _label(study: Study, variant: Variant, probe: Probe, contact: ContactOptions) -> str:
    """Label of a response, of the parameters that vary in the study."""
    parts = [str(variant)]
    if len(study.probes) > 1:
        parts.append(f"{probe.shape} {probe.diameter_mm:g} mm at x = {probe.x_mm:g} mm")
    parts += [f"{name}={value}" for name, value in contact.items()]
    return ", ".join(parts)


def _run_tasks(
    unfinished: Mapping[str, Item],
    folder: Path,
    threads: int | None,
    executor: Executor,
    jobs: int,
    display: "_ProgressDisplay",
) -> dict[str, str]:
    """Run all `unfinished` items, each after its response; causes of failed items by key."""
    waiting: dict[str, list[Item]] = {}
    for item in unfinished.values():
        waiting.setdefault(item.response.key, []).append(item)
    # Items precede waiting responses, so that the first rates and the time estimate come early.
    responses = [items[0].response for items in waiting.values()]
    solved = [response for response in responses if response.is_finished(folder)]
    ready: deque[Task] = deque(item for response in solved for item in waiting.pop(response.key))
    ready.extend(response for response in responses if response.key in waiting)
    busy: set[str] = set()
    causes: dict[str, str] = {}

    def submit(task: Task) -> "Future[TaskResult]":
        return executor.submit(run_task, task, folder, threads, wait=task.key in busy)

    for task, future in finished(submit, ready, jobs):
        result = _task_result(future)
        if result.busy:  # another sweep runs it: retry at the end, then wait
            busy.add(task.key)
            ready.append(task)
        elif isinstance(task, Response | DeckTask) and not result.cause:
            ready.extendleft(reversed(waiting.pop(task.key)))
        else:
            for item in [task] if isinstance(task, Item) else waiting.pop(task.key):
                display.count_item(item, result)
                if result.cause:
                    causes[item.key] = result.cause
    return causes


def _task_result(future: "Future[TaskResult]") -> TaskResult:
    try:
        return future.result()
    except WorkerDiedError as error:
        return TaskResult(str(error))
    except Exception as error:  # from dask: a worker died too often, a cancelled task
        return TaskResult("failed: " + " ".join(f"{type(error).__name__}: {error}".splitlines()))


def _cluster_solver(executor: Executor) -> str:
    """Solver of a cluster worker; waits for the first worker."""
    try:
        version = executor.submit(_solver_version_or_error).result()
    except Exception as error:
        raise MissingError(f"a dask worker cannot start: {error}") from error
    if isinstance(version, FembridgeError):
        raise version
    return version


def _solver_version_or_error() -> str | FembridgeError:
    try:
        return solver_version()
    except FembridgeError as error:
        return error  # if raised, dask would print a traceback


def run_task(
    task: Task, folder: Path, threads: int | None = None, *, wait: bool = True
) -> TaskResult:
    """Outcome of `task`, run in the sweep's `folder`; an error becomes the result's cause.

    If another process runs it, wait (`wait`, the default) or return a result that is `busy`. A
    response has to be finished before its items. The solver's progress is sent to the process
    that submitted the task, with the task's label.
    """
    begin_s = time.monotonic()
    cause, finished_before = "", False

    def on_progress(progress: Progress) -> None:
        send((task.label, progress))

    try:
        if not (folder / STUDY_FILE).is_file():
            raise OutputError("not found on this machine: all workers need the same folder", folder)
        finished_before = task.is_finished(folder)
        if not finished_before:
            with _lock_task(folder / task.run_folder, wait):
                finished_before = task.is_finished(folder)
                if not finished_before:
                    settings = Solver(threads, on_progress=on_progress)
                    if isinstance(task, Item):
                        _run_item(task, folder, settings)
                    elif isinstance(task, DeckTask):
                        _check_solver(task.solver)
                        output = folder / task.run_folder
                        solve_map(task.deck.path, task.options, output, settings)
                    else:
                        _run_response(task, folder, settings)
    except LockedError as error:
        return TaskResult(str(error), busy=True)
    except FembridgeError as error:
        cause = " ".join(str(error).replace(f"{folder}/", "").splitlines())
    except OSError as error:
        cause = f"{error.filename or 'cannot read or write'}: {error.strerror or error}"
    except Exception as error:  # a bug in one item does not stop the others
        with suppress(OutputError):
            write_text(folder / task.run_folder / BUG_FILE, traceback.format_exc())
        problem = " ".join(f"{type(error).__name__}: {error}".splitlines())
        cause = f"a bug in fembridge, see {BUG_FILE} in its folder: {problem}"
    return TaskResult(cause, finished_before, wall_s=round(time.monotonic() - begin_s, 3))


def read_answers(folder: Path) -> "pd.DataFrame":
    """Rate, spikes and peak stress of a finished item by stimulus and afferent."""
    import pandas as pd

    converters = {"unit": str, "rate_ips": float, "spikes": int, "peak_stress_pa": float}
    return pd.read_csv(folder / ANSWERS_FILE, converters=converters)


@cache
def solver_version() -> str:
    """Name and version of the solver on this machine, as ``calculix 2.20``."""
    check_cache()
    program = find_ccx()
    if program is None:
        raise MissingError(
            f"no ccx on the PATH; install it: {SOLVER_INSTALL_LINE}; or set "
            "'stored = true' in the study for the stored responses of the presets"
        )
    return f"calculix {version_of(program)[0] or 'of no known version'}"


def _run_response(task: Response, folder: Path, settings: Solver) -> None:
    _check_solver(task.solver)
    response_folder = folder / task.run_folder
    solve_response(
        response_folder,
        Model(task.finger, _response_mesh(task, response_folder), task.probe, element=task.element),
        task.depth_um,
        settings,
        ladder=contact_ladder(task.contact),
    )


def _run_item(item: Item, folder: Path, settings: Solver) -> None:
    """Simulate an item and write its three files, the record last."""
    item_folder, begin_s = folder / item.run_folder, time.monotonic()
    response = item.response.read(folder)
    simulation = _simulate(item, response, folder, settings)
    method = {
        "solver": item.response.solver,
        "wall_s": round(time.monotonic() - begin_s, 3),
        "closure_percent": response.closure_percent,
        "contact": response.origin.get("contact", {}),
        "response": str(item.response.run_folder),
    }
    with filling(item_folder, last=RECORD_FILE) as draft:
        has_units = any(rate.unit for rate in simulation.mean_rates)
        columns = [*ANSWER_COLUMNS[:2], *["unit"] * has_units, *ANSWER_COLUMNS[2:]]
        answers = _answer_rows(simulation)
        write_table(draft / ANSWERS_FILE, columns, answers if has_units else map(_unnamed, answers))
        write_spikes(draft / SPIKES_FILE, simulation.trains)
        record = {
            "format": FORMAT,
            "key": item.key,
            "parameter_set": item.parameters_name,
            "how": method,
            "files": {name: sha256_of(draft / name) for name in _FILES},
            "inputs": {**item.inputs(), "response": item.response.inputs()},
        }
        write_sealed(draft / RECORD_FILE, record)
    with suppress(OSError):
        (item_folder / BUG_FILE).unlink(missing_ok=True)


def _simulate(item: Item, response: ResponseMap, folder: Path, settings: Solver) -> Simulation:
    """Spikes of all stimuli of an item, by the response map or by transients."""
    task, stimuli = item.response, item.stimuli()
    if isinstance(task, DeckTask) or item.method == "map":
        stimuli = [at_step(wave, finest_step_ms(item.parameters)) for wave in stimuli]
        traces = [response.traces(wave, item.parameters) for wave in stimuli]
    else:
        accepted = Contact(**cast("dict[str, Any]", response.origin["contact"]))
        mesh = _response_mesh(task, folder / task.run_folder)
        model = Model(task.finger, mesh, task.probe, accepted, task.element)
        motion_folder, ladder = folder / item.solve_folder, contact_ladder(task.contact)
        with _lock_task(motion_folder):
            _check_solver(task.solver)
            traces, _ = solve_transients(stimuli, model, motion_folder, settings, ladder)
    return encode_all(stimuli, traces, item.parameters, {})


def _unnamed(row: tuple[Any, ...]) -> tuple[Any, ...]:
    """A row of answers without its unit."""
    return (*row[:2], *row[3:])


def _answer_rows(simulation: Simulation) -> Iterator[tuple[str, str, str, float, int, float]]:
    """Rows of `ANSWER_COLUMNS`, one per stimulus and afferent, with the unit after the class."""
    spikes: Counter[tuple[str, str, str]] = Counter()
    windows = {stimulus.id: stimulus.window_ms for stimulus in simulation.stimuli}
    for train in simulation.trains:
        count = spikes_inside(train.times_ms, windows[train.stimulus])
        spikes[train.stimulus, train.afferent, train.unit] += count
    traces = chain.from_iterable(simulation.traces)
    for rate, trace in zip(simulation.mean_rates, traces, strict=True):
        key = rate.stimulus, rate.afferent, rate.unit
        yield (*key, rate.rate_ips, spikes[key], float(trace.stress_pa.max()))


def _response_mesh(task: Response, folder: Path) -> Mesh:
    """Mesh in the response's folder, made if missing; transients share it."""
    with suppress(FingerError):
        return read_mesh(folder / MESH_FILE)
    with _mesher_lock:
        mesh = mesh_of(task.finger)
    write_mesh(folder / MESH_FILE, mesh)
    return mesh


def _lock_task(folder: Path, wait: bool = True) -> AbstractContextManager[None]:
    return folder_lock(make_folder(folder), _LOCK, wait=wait)


def _check_solver(planned: str) -> None:
    """Check that the installed solver is the planned one, which is part of the key."""
    if (installed := solver_version()) != planned:
        raise MissingError(f"found {installed}, the sweep was planned for {planned}")


def _provenance(study: Study, solver: str, plan: Plan) -> str:
    """Comment lines above the study's text: versions, fingers, checksum."""
    digest = hashlib.sha256(study.text.encode()).hexdigest()
    labels = [*(variant.label for variant in study.variants), *(deck.label for deck in study.decks)]
    files = dict.fromkeys(labels)
    lines = [
        f"sweep of the study {study.name!r}, {study.points} points, {len(plan.items)} items",
        f"fembridge {__version__}, solver {solver}, "
        f"Python {sys.version.split()[0]}, NumPy {np.__version__}",
        f"fingers {', '.join(files)}; parameters {study.parameters.name}",
        f"sha256 of the text below: {digest}" if study.text else "made in Python",
        "file names are relative to the folder of the original",
    ]
    return "".join(f"# {line}\n" for line in lines) + "\n"


def _write_results(folder: Path, plan: Plan, causes: dict[str, str]) -> None:
    """Write one row per point and afferent; add items whose answers are missing to `causes`."""
    import pandas as pd

    answers = [pd.DataFrame(columns=["key", *ANSWER_COLUMNS], dtype=object)]
    for key, item in plan.items.items():
        if key not in causes:
            try:
                answers.append(read_answers(folder / item.run_folder).assign(key=key))
            except FembridgeError:
                raise
            except (OSError, ValueError) as error:  # deleted since
                causes[key] = str(error)
    combined = pd.concat([answer.astype(object) for answer in answers])
    on = ["key", "stimulus", "afferent", *["unit"] * ("unit" in plan.rows)]
    if "unit" in on:
        combined["unit"] = combined["unit"].fillna("") if "unit" in combined else ""
    table = plan.rows.merge(combined, how="left", on=on)
    table["cause"] = table["key"].map(causes)
    table["status"] = np.where(table["cause"].isna(), "done", "failed")
    table["run"] = table["key"].map({key: str(item.run_folder) for key, item in plan.items.items()})
    table = table[[*plan.rows.columns.drop("key"), *ANSWER_COLUMNS[2:], "status", "cause", "run"]]
    write_text(folder / RESULTS_FILE, table.to_csv(index=False, lineterminator="\n"))


class _ProgressDisplay(Bars):
    """Progress of a sweep on stderr: bars on a terminal, otherwise one line per item.

    `finished_before` of `total` items were finished when the sweep began.
    """

    def __init__(self, total: int, finished_before: int, *, shows: bool) -> None:
        super().__init__(0.0, shows=shows)
        self._total, self._before, self._done, self._failed = (
            total,
            finished_before,
            finished_before,
            0,
        )
        if shows and finished_before and not self.on_terminal:
            self.print(f"{finished_before} of {total} items are already finished")
        self._update()

    def follow(self, message: tuple[str, Progress]) -> None:
        """Update the bar of a task's solver run; remove it when the run ends."""
        name, progress = message
        if progress.has_ended:
            self.remove(name)
        else:
            self.show(name, progress.fraction, how_far(progress))
        self._update()

    def count_item(self, item: Item, result: TaskResult) -> None:
        """Count a finished or failed item."""
        self._done += not result.cause
        self._failed += bool(result.cause)
        if self._shows and result.cause:
            self.print(f"failed: {item}: {result.cause}")
        elif self._shows and not self.on_terminal:
            detail = "finished elsewhere" if result.before else f"{result.wall_s:.1f} s"
            self.print(f"{self._done + self._failed}/{self._total} {item}: {detail}")
        self._update()

    def print_interruption(self) -> None:
        """Print the number of finished items after an interruption."""
        if self._shows:
            text = f"{self._done} of {self._total} items are kept"
            self.print(f"{text}; run the same command to resume")

    def _update(self) -> None:
        completed = self._done + self._failed
        text = f"{self._done} done, {self._failed} failed"
        completed_here = completed - self._before
        if completed_here and completed < self._total:
            left_s = (perf_counter() - self._begin_s) * (self._total - completed) / completed_here
            text += f", {timedelta(seconds=round(left_s))} left"
        self.show("sweep", completed / self._total, text)
