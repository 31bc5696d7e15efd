"""Many touches in one data set: rows that share a contact, parts, attempts, cost, and checks.

Rows with the same pad, shape and motion are a group, whose contact is solved once. Whole groups,
in the order of the table, fill a part up to a number of touches; a larger group takes several
parts. Workers return what came of the rows, and this process alone writes: first the spikes of
a part, last its ``touches``. A row whose worker dies, or whose files cannot be reached, runs
again on its own, three times at most.
"""

import hashlib
import json
import logging
import math
import os
import time
import tomllib
from collections import Counter, deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from datetime import timedelta
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge.errors import FembridgeError, OutputError, UsageError, warn
from fembridge.host.executor import (
    HereExecutor,
    LocalExecutor,
    WorkerDiedError,
    dask_executor,
    finished,
)
from fembridge.host.process import signals_as_exits
from fembridge.host.progress import advance
from fembridge.host.store import digest, folder_lock, make_folder, sha256_of
from fembridge.host.terminal import Bars
from fembridge.ranges import check_range
from fembridge.sweeps.dataset import (
    ABOUT_FILE,
    COLUMNS,
    DONE,
    FAILED,
    FORMAT,
    PROGRESS_FILE,
    TABLES,
    LocalStore,
    MemoryStore,
    Store,
    Touches,
    arrow,
    damaged_files,
    digest_of_rows,
    finished_parts,
    is_dataset,
    part_name,
    read_about,
    read_part,
    read_rows,
    schema_of,
    settings_text,
    store_of,
    write_part,
    write_rows,
)
from fembridge.sweeps.touch_study import CONTACT, SETTINGS, TouchTable, read_touches
from fembridge.sweeps.touch_work import (
    Batch,
    Outcome,
    Settings,
    check_setting,
    located,
    run_batch,
    run_trial,
    units_of,
)
from fembridge.touching.large_strain import SMALL_UM
from fembridge.touching.pad import Pad
from fembridge.touching.population import Population
from fembridge.touching.shape import Shape
from fembridge.touching.trajectory import Trajectory
from fembridge.typing import Table
from fembridge.version import __version__
from neural.parameter_sets import ParameterSet, parameters_to_table

if TYPE_CHECKING:
    import pandas
    from numpy.typing import NDArray

_LOGGER = logging.getLogger(__name__)

ATTEMPTS = 3
"""Times that a row is started at most."""

LONG_S = 600.0
"""Work that takes longer needs a confirmation."""

FORCES_STEP_MS = 10.0
EXECUTORS = ("local", "dask")

# Touches of a part: so few that little is lost, so many that there are few files.
_PART_TOUCHES, _MOST_PART_TOUCHES, _PARTS = 64, 256, 400
_LOCK = ".lock"
_CLUSTER_BATCHES = 2000  # submitted to a cluster at a time
_TRIALS_FROM = 10  # touches, from which on their cost is estimated
_MOST_KINDS, _TOUCHES_OF_A_KIND = 10, 5  # that are tried at most; touches for each trial
_LEAST_N = 1e-3  # forces below are alike
_PROGRESS_S = 5.0
_SILENT_S = 60.0  # after the last report a run is taken to have ended
_MOST_WARNINGS = 5
# Settings that are checked before anything runs, each with those that it depends on.
_CHECKED = (
    ("shape", "pixel_mm", "relief_mm", "tile"),
    ("population", "population_seed"),
    *((name,) for name in ("stimulus", "path", "pins", "map", "pad", "finger", "parameters")),
)
_OF_POPULATION = ("pad", "map", "population", "population_seed", "endings_mm", "sa_von_mises")
# Settings that do not change how long a touch takes by much.
_ALIKE = (
    *("x_mm", "z_mm", "angle_deg", "seed", "population_seed", "noise_mv", "press_um", "press_n"),
    *("friction", "relief_mm", "parameters", "preindent_um", "tilt_across_deg", "tilt_along_deg"),
)


# ---- Plan


@dataclass(frozen=True, eq=False)
class Plan:
    """Rows of a table, and what follows from them alone.

    Parameters
    ----------
    table
        Rows of settings.
    forces_step_ms
        Step of the forces in ms; 0: none.
    extents
        Numbers of rows of the shorter tables that the data set had before; their parts stay as
        they are.
    """

    table: TouchTable
    forces_step_ms: float = FORCES_STEP_MS
    extents: tuple[int, ...] = ()

    @cached_property
    def keys(self) -> list[str]:
        """Digest of each row: version, settings, and the content of its files and objects."""
        return [digest({"fembridge": __version__, **self._content(row)}) for row in self.rows]

    @cached_property
    def row_digests(self) -> list[bytes]:
        """16 bytes by which a row is found in a longer table: its key and the user's columns."""
        digests = []
        for key, row in zip(self.keys, self.table.rows, strict=True):
            labels = {name: row[name] for name in self.table.labels if name in row}
            digests.append(bytes.fromhex(digest([key, labels])[:32]))
        return digests

    @cached_property
    def contact_keys(self) -> list[str]:
        """Digest of all that the contact of each row depends on."""
        return [
            digest(self._content({name: row[name] for name in CONTACT if name in row}))
            for row in self.rows
        ]

    @cached_property
    def population_ids(self) -> list[int]:
        """Number of the population of each row, by first occurrence."""
        numbers: dict[str, int] = {}
        ids = []
        for row in self.rows:
            names = ("map", "parameters") if "map" in row else _OF_POPULATION
            key = digest(self._content({name: row[name] for name in names if name in row}))
            ids.append(numbers.setdefault(key, len(numbers)))
        return ids

    @property
    def rows(self) -> tuple[Settings, ...]:
        """Settings of each row, without the user's own columns."""
        return self._rows

    @cached_property
    def _rows(self) -> tuple[Settings, ...]:
        labels = set(self.table.labels)
        return tuple(
            {name: value for name, value in row.items() if name not in labels}
            for row in self.table.rows
        )

    @cached_property
    def parts(self) -> list[list[list[int]]]:
        """Groups of touches of each part; a longer table has further parts for its new rows."""
        ends = (0, *self.extents, len(self.rows))
        return [part for first, end in pairwise(ends) for part in self._parts_of(first, end)]

    def _parts_of(self, first: int, end: int) -> list[list[list[int]]]:
        groups: dict[str, list[int]] = {}
        for touch in range(first, end):
            groups.setdefault(self.contact_keys[touch], []).append(touch)
        size = min(max(_PART_TOUCHES, (end - first) // _PARTS), _MOST_PART_TOUCHES)
        parts: list[list[list[int]]] = [[]]
        for group in groups.values():
            for begin in range(0, len(group), size):
                piece = group[begin : begin + size]
                if parts[-1] and sum(map(len, parts[-1])) + len(piece) > size:
                    parts.append([])
                parts[-1].append(piece)
        return parts

    @cached_property
    def introduced(self) -> list[dict[int, int]]:
        """Populations that a part is the first to use, each with its first touch."""
        seen: set[int] = set()
        introduced = []
        for part in self.parts:
            first: dict[int, int] = {}
            for touch in sorted(touch for group in part for touch in group):
                if (population := self.population_ids[touch]) not in seen:
                    seen.add(population)
                    first[population] = touch
            introduced.append(first)
        return introduced

    @cached_property
    def label_types(self) -> dict[str, str]:
        """Arrow type of each of the user's own columns, in the rows of the first table."""
        return self._label_types(self.extents[0] if self.extents else len(self.rows))

    def _label_types(self, count: int) -> dict[str, str]:
        types = {}
        for label in sorted(self.table.labels):  # not by the table, whose order may change
            kinds = {type(row[label]) for row in self.table.rows[:count] if label in row}
            if kinds:
                types[label] = (
                    "bool"
                    if kinds == {bool}
                    else "string"
                    if str in kinds
                    else "float64"
                    if float in kinds
                    else "int64"
                )
        return types

    def positions_of(self, row_digests: Sequence[bytes]) -> tuple[list[int | None], list[int]]:
        """Rows of this table that have these digests, None where it has none; all other rows."""
        rows_of: dict[bytes, deque[int]] = {}
        for row, row_digest in enumerate(self.row_digests):
            rows_of.setdefault(row_digest, deque()).append(row)
        positions = [rows_of[key].popleft() if rows_of.get(key) else None for key in row_digests]
        return positions, sorted(row for rows in rows_of.values() for row in rows)

    def ordered(self, order: Sequence[int], extents: Sequence[int]) -> "Plan":
        """Plan of the rows in another order.

        Raises
        ------
        UsageError
            Rows after those of the first table have a column of the user's own that these have
            not, or of another type.
        """
        rows = tuple(self.table.rows[row] for row in order)
        plan = Plan(replace(self.table, rows=rows), self.forces_step_ms, tuple(extents))
        types = plan.label_types
        for label, kind in plan._label_types(len(rows)).items():
            if kind != (expected := types.get(label, "no such column")):
                problem = f"is {kind} in further rows, and {expected} in the data set"
                raise UsageError(problem, argument=label, found=kind, expected=expected)
        return plan

    def check(self) -> None:
        """Refuse what can be refused before anything runs: names, files and sizes.

        Raises
        ------
        UsageError
            The first row with an unknown shape, population, stimulus or parameter set, or a file
            that is absent.
        """
        checked: set[tuple[object, ...]] = set()
        for number, row in enumerate(self.rows, start=1):
            for names in _CHECKED:
                values = tuple(row.get(name) for name in names)
                if values[0] is None or not isinstance(values[0], str) or values in checked:
                    continue
                checked.add(values)
                try:
                    check_setting(names[0], row, self.table.folder)
                except FembridgeError as error:
                    raise UsageError(
                        f"of row {number} {error.problem}",
                        error.path or self.table.path,
                        error.line,
                        argument=error.argument or names[0],
                        found=error.found,
                        expected=error.expected,
                    ) from error

    def about(self) -> Table:
        """Content of ``dataset.toml``."""
        return {
            "format": FORMAT,
            "name": self.table.name,
            "fembridge": __version__,
            "rows": len(self.rows),
            "parts": len(self.parts),
            "extents": list(self.extents),
            "forces_step_ms": float(self.forces_step_ms),
            "sha256": digest_of_rows(self.row_digests),
            "files_from": str(self.table.folder),
            "study": self.table.text,
        }

    def batch(self, touches: Sequence[int]) -> Batch:
        """Work of some touches of a group."""
        rows = {touch: self.rows[touch] for touch in touches}
        return Batch(rows, self.table.folder, self.forces_step_ms)

    def _content(self, row: Settings) -> dict[str, Any]:
        return {name: self._digest_of(name, value) for name, value in row.items()}

    def _digest_of(self, name: str, value: object) -> object:
        """A setting as a value that has a digest: a file by its name and content."""
        if isinstance(value, bool | int | float):
            return value
        if isinstance(value, str):
            path = located(name, value, self.table.folder)
            if path is None:
                return value
            if path not in self._files:
                self._files[path] = _digest_of_path(path)
            return {"file": value, "sha256": self._files[path]}
        if id(value) not in self._objects:  # the table keeps it alive
            self._objects[id(value)] = _digest_of_object(value)
        return self._objects[id(value)]

    @cached_property
    def _files(self) -> dict[Path, str]:
        return {}

    @cached_property
    def _objects(self) -> dict[int, object]:
        return {}


def _digest_of_path(path: Path) -> str:
    """Digest of a file, or of the files of the folder of a map."""
    try:
        if path.is_dir():
            from fembridge.response.response_map import map_file

            path = map_file(path)
        return sha256_of(path)
    except OSError as error:
        raise UsageError(f"cannot be read: {error.strerror}", path) from error


def _digest_of_object(value: Any) -> object:  # noqa: ANN401 - any argument of a touch
    """Content of a Python object of a row, as far as a touch depends on it."""
    if isinstance(value, Pad):
        return {"pad": value.sha256, "origin": repr(sorted(value.origin.items()))}
    if isinstance(value, Population | Trajectory):
        return {name: repr(item) for name, item in value.to_table().items()}
    if isinstance(value, ParameterSet):
        return {
            "parameters": parameters_to_table(value.parameters),
            "preindent_um": value.preindent_um,
        }
    import pickle

    if isinstance(value, np.ndarray):
        return _digest_of_array(value)
    if hasattr(value, "columns"):  # a pickle also depends on how the table was made
        return {str(name): _digest_of_array(np.asarray(value[name])) for name in value.columns}
    if isinstance(value, Shape):
        return {**{name: repr(item) for name, item in value.to_table().items()}, "height": (
            hashlib.sha256(pickle.dumps(value.height)).hexdigest()
        )}  # fmt: skip
    return hashlib.sha256(pickle.dumps(value)).hexdigest()


def _digest_of_array(values: "NDArray[Any]") -> list[str]:
    """Type, shape and content of an array; of one of texts and objects their representations."""
    if values.dtype.kind in "biuf":
        content = np.ascontiguousarray(values).tobytes()
    else:
        content = repr([str(value) for value in values.ravel()]).encode()
    return [str(values.dtype), str(values.shape), hashlib.sha256(content).hexdigest()]


# ---- Parts


@dataclass(slots=True)
class _PartWork:
    """A part that is not finished: touches that are missing, and what came of the others."""

    missing: set[int]
    outcomes: dict[int, Outcome] = field(default_factory=dict)
    kept: Mapping[str, Any] | None = None  # Arrow tables of an earlier run


def _unfinished(plan: Plan, store: Store) -> tuple[dict[int, _PartWork], int]:
    """Parts with touches that are not done, and the number of touches that are."""
    import pyarrow.compute as compute

    available = set(finished_parts(store))
    works: dict[int, _PartWork] = {}
    done = 0
    for number, part in enumerate(plan.parts):
        touches = {touch for group in part for touch in group}
        if number not in available:
            works[number] = _PartWork(touches)
            continue
        table = read_part(store, "touches", number)
        is_done = compute.equal(table["status"], DONE)
        kept = set(table.filter(is_done)["touch"].to_pylist())
        done += len(kept)
        if touches - kept:
            tables = {
                name: read_part(store, name, number) for name in ("spikes", "forces", "units")
            }
            works[number] = _PartWork(
                touches - kept, kept={**tables, "touches": table.filter(is_done)}
            )
    return works, done


def _part_tables(plan: Plan, number: int, work: _PartWork) -> dict[str, Any]:
    """Arrow tables of a part, in the order of the touches."""
    arrow_module = arrow()
    outcomes = [work.outcomes[touch] for touch in sorted(work.outcomes)]
    passed = [outcome for outcome in outcomes if not outcome.cause]
    spikes = {
        "touch": np.repeat(
            [outcome.touch for outcome in passed], [outcome.time_ms.size for outcome in passed]
        ),
        "afferent": _joined(np.array(o.afferent, dtype=object)[o.spike_unit] for o in passed),
        "unit": _joined(np.array(o.unit, dtype=object)[o.spike_unit] for o in passed),
        "trial": _joined(outcome.trial for outcome in passed),
        "spike_time_ms": _joined(outcome.time_ms for outcome in passed),
    }
    sizes = [len(outcome.forces.get("time_ms", ())) for outcome in passed]
    forces: dict[str, Any] = {"touch": np.repeat([outcome.touch for outcome in passed], sizes)}
    for name in list(COLUMNS["forces"])[1:]:
        columns = (
            outcome.forces.get(name, np.full(size, np.nan))
            for outcome, size in zip(passed, sizes, strict=True)
        )
        forces[name] = _joined(columns)
    tables = {
        "spikes": _table("spikes", spikes),
        "forces": _table("forces", forces),
        "units": _units_table(plan, number),
        "touches": arrow_module.Table.from_pylist(
            [_record(plan, outcome) for outcome in outcomes],
            schema=schema_of("touches", plan.label_types),
        ),
    }
    if work.kept is not None:
        for name in ("spikes", "forces", "touches"):
            kept = work.kept[name].replace_schema_metadata(None)
            joined = arrow_module.concat_tables([kept.cast(tables[name].schema), tables[name]])
            order = np.argsort(joined["touch"].to_numpy(), kind="stable")
            tables[name] = joined.take(arrow_module.array(order)).combine_chunks()
    return tables


def _joined(columns: Iterator[Any]) -> Any:  # noqa: ANN401 - arrays of any kind
    arrays = list(columns)
    return np.concatenate(arrays) if arrays else np.zeros(0)


def _table(name: str, columns: Mapping[str, Any]) -> Any:  # noqa: ANN401 - an Arrow table
    arrow_module = arrow()
    schema = schema_of(name)
    arrays = []
    for column in schema:
        values = columns[column.name]
        is_text = arrow_module.types.is_string(column.type)
        if not is_text and not isinstance(values, list):
            values = np.asarray(values).astype(column.type.to_pandas_dtype())
        elif is_text:
            values = list(values)
        is_number = arrow_module.types.is_floating(column.type)
        arrays.append(arrow_module.array(values, column.type, from_pandas=is_number))
    return arrow_module.Table.from_arrays(arrays, schema=schema)


def _units_table(plan: Plan, number: int) -> Any:  # noqa: ANN401 - an Arrow table
    """Units of the populations that a part is the first to use."""
    arrow_module = arrow()
    tables = [schema_of("units").empty_table()]
    for population, touch in plan.introduced[number].items():
        with suppress(FembridgeError, OSError):  # the rows with it have failed, with this cause
            units = units_of(plan.rows[touch], plan.table.folder)
            ids = np.full(len(units["unit"]), population)
            tables.append(_table("units", {"population_id": ids, **units}))
    return arrow_module.concat_tables(tables).combine_chunks()


def _record(plan: Plan, outcome: Outcome) -> dict[str, Any]:
    """Row of ``touches``."""
    touch = outcome.touch
    row, labels = plan.rows[touch], plan.table.rows[touch]
    shown = {name: _shown(value) for name, value in row.items()}
    defaults = {
        name: value for name, value in outcome.record.items() if name not in plan.table.labels
    }
    return {
        **dict.fromkeys((*SETTINGS, "trajectory")),
        **{label: labels.get(label) for label in plan.table.labels},
        **defaults,
        **{
            name: SETTINGS[name](value)
            if name in SETTINGS and not isinstance(value, str)
            else value
            for name, value in shown.items()
        },
        "touch": touch,
        "status": FAILED if outcome.cause else DONE,
        "cause": outcome.cause or None,
        "warnings": list(outcome.record.get("warnings", [])),
        "population_id": plan.population_ids[touch],
        "contact_key": plan.contact_keys[touch],
        "key": plan.keys[touch],
        "settings": settings_text(row),
    }


def _shown(value: object) -> object:
    """A setting as it is in ``touches``: of a Python object a text."""
    if isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.ndarray):
        return f"array {' x '.join(map(str, value.shape))}"
    if hasattr(value, "columns"):
        return f"table {','.join(map(str, value.columns))}, {len(value)} rows"  # type: ignore[arg-type] # a DataFrame
    return repr(value)


# ---- Running


class _Progress(Bars):
    """Bar, rate and remaining time of the touches, and the file that ``sweep status`` reads."""

    def __init__(self, store: Store, rows: int, done: int, *, shows: bool) -> None:
        super().__init__(0.0, shows=shows)
        self._store, self._total, self._before, self._done = store, rows, done, done
        self._failed, self._begin_unix_s, self._written_s = 0, time.time(), -math.inf

    def count(self, outcome: Outcome) -> None:
        """Count a touch that is done or has failed."""
        self._failed += bool(outcome.cause)
        self._done += not outcome.cause
        now_s = time.monotonic()
        if now_s >= self._written_s + _PROGRESS_S:
            self._written_s = now_s
            self.write()
        self.show("touches", (self._done + self._failed) / self._total, self._text())

    def _text(self) -> str:
        finished_here = self._done + self._failed - self._before
        elapsed_s = max(time.time() - self._begin_unix_s, 1e-3)
        left_s = elapsed_s * (self._total - self._done - self._failed) / max(finished_here, 1)
        text = f"{self._done} of {self._total}, {self._failed} failed, "
        return text + f"{finished_here / elapsed_s:.3g}/s, {timedelta(seconds=round(left_s))} left"

    def write(self) -> None:
        """Write the state for other terminals; not being able to is no reason to stop."""
        if isinstance(self._store, MemoryStore):
            return
        import tomli_w

        state = {
            "rows": self._total,
            "done": self._done,
            "failed": self._failed,
            "before": self._before,
            "begin_unix_s": self._begin_unix_s,
            "now_unix_s": time.time(),
        }
        with suppress(FembridgeError, OSError):
            self._store.write(PROGRESS_FILE, tomli_w.dumps(state).encode())


@dataclass(frozen=True, slots=True)
class _Task:
    """A batch of touches of a part, started for the `attempt`-th time."""

    part: int
    touches: tuple[int, ...]
    attempt: int = 1


def _run(
    plan: Plan,
    store: Store,
    works: dict[int, _PartWork],
    executor: Executor,
    limit: int,
    progress: _Progress,
) -> dict[int, str]:
    """Run what is missing and write each part as it is complete; causes of unwritten touches."""
    ready: deque[_Task] = deque()
    for number, work in works.items():
        for group in plan.parts[number]:
            if touches := tuple(t for t in group if t in work.missing and t not in work.outcomes):
                ready.append(_Task(number, touches))
    unwritten: dict[int, str] = {}
    for number in [number for number, work in works.items() if set(work.outcomes) >= work.missing]:
        unwritten |= _write(plan, store, number, works.pop(number))

    def submit(task: _Task) -> "Future[list[Outcome]]":
        try:
            return executor.submit(run_batch, plan.batch(task.touches))
        except Exception as error:  # the cluster is gone, or a setting cannot be pickled
            future: Future[list[Outcome]] = Future()
            future.set_exception(error)
            return future

    for task, future in finished(submit, ready, limit):
        for outcome in _outcomes(task, future):
            may_run_again = outcome.may_pass and task.attempt < ATTEMPTS
            if may_run_again:
                ready.appendleft(_Task(task.part, (outcome.touch,), task.attempt + 1))
                continue
            works[task.part].outcomes[outcome.touch] = outcome
            progress.count(outcome)
        work = works[task.part]
        if set(work.outcomes) >= work.missing:
            unwritten |= _write(plan, store, task.part, works.pop(task.part))
    return unwritten


def _outcomes(task: _Task, future: "Future[list[Outcome]]") -> list[Outcome]:
    """Outcomes of a task; of one whose worker died or that was lost, failures."""
    may_pass = True
    try:
        return future.result()
    except WorkerDiedError as error:
        cause = f"attempt {task.attempt}: {error}"
    except Exception as error:  # from dask, whose scheduler has tried several workers
        cause = " ".join(f"{type(error).__name__}: {error}".splitlines())
        may_pass = len(task.touches) > 1
    return [Outcome(touch, cause=cause, may_pass=may_pass) for touch in task.touches]


def _write(plan: Plan, store: Store, number: int, work: _PartWork) -> dict[int, str]:
    """Write a part; of one that cannot be written the causes by touch."""
    try:
        write_part(store, number, _part_tables(plan, number, work))
    except (FembridgeError, OSError) as error:
        cause = " ".join(str(error).splitlines())
        return dict.fromkeys(work.outcomes, f"not written: {cause}")
    return {}


# ---- Cost


@dataclass(frozen=True, slots=True)
class TouchCost:
    """Expected cost of touches.

    Parameters
    ----------
    touches
        Number of touches that are not done.
    duration_s
        Time in s.
    disk_bytes
        Size of their files.
    kinds
        Number of kinds of touches that were tried.
    """

    touches: int
    duration_s: float
    disk_bytes: float
    kinds: int

    def __str__(self) -> str:
        duration = timedelta(seconds=round(self.duration_s))
        return (
            f"{self.touches} touches: about {duration} and {self.disk_bytes / 1e6:.3g} MB, by a "
            f"trial of {self.kinds} kind{'s' * (self.kinds != 1)}"
        )


def _estimate(
    plan: Plan, works: Mapping[int, _PartWork], executor: Executor, workers: int
) -> TouchCost | None:
    """Cost of what is missing, by one touch of each kind, whose outcomes are kept in `works`."""
    part_of_touch = {
        touch: number for number, work in works.items() for touch in sorted(work.missing)
    }
    if len(part_of_touch) < _TRIALS_FROM:
        return None
    kinds: dict[str, list[int]] = {}
    for touch in part_of_touch:
        kinds.setdefault(_kind(plan.rows[touch]), []).append(touch)
    trials = min(_MOST_KINDS, max(len(part_of_touch) // _TOUCHES_OF_A_KIND, 1))
    tried = sorted(kinds.values(), key=len, reverse=True)[:trials]
    costs: list[tuple[list[int], Outcome]] = []
    for touches in tried:
        with suppress(Exception):  # it fails again in the run, with its cause
            [outcome] = executor.submit(run_trial, plan.batch(touches[:1])).result()
            if not outcome.cause:
                costs.append((touches, outcome))
                works[part_of_touch[touches[0]]].outcomes[outcome.touch] = outcome
    if not costs:
        return None
    duration_s, disk_bytes, covered = 0.0, 0.0, 0
    for touches, outcome in costs:
        contacts = len({(part_of_touch[touch], plan.contact_keys[touch]) for touch in touches})
        duration_s += contacts * outcome.contact_s + len(touches) * outcome.encode_s
        disk_bytes += len(touches) * _bytes_of(plan, outcome)
        covered += len(touches)
    scale = len(part_of_touch) / covered
    return TouchCost(
        len(part_of_touch), scale * duration_s / workers, scale * disk_bytes, len(costs)
    )


def _kind(row: Settings) -> str:
    """Settings by which rows differ in their cost."""
    names = {name: repr(value) for name, value in row.items() if name not in _ALIKE}
    for name in ("shape", "population"):
        if isinstance(value := row.get(name), str):
            names[name] = value.partition(":")[0]
    if "press_n" in row:  # twice the force may take twice as long
        names["level"] = f"{math.floor(math.log2(max(row['press_n'], _LEAST_N)))} N"
    elif (depth_um := row.get("press_um", 0.0)) > SMALL_UM:  # large strain takes ten times as long
        names["level"] = f"{math.floor(depth_um / SMALL_UM)} um"
    return repr(sorted(names.items()))


def _bytes_of(plan: Plan, outcome: Outcome) -> float:
    """Compressed size of the spikes and forces of a touch."""
    spikes, samples = outcome.time_ms.size, len(outcome.forces.get("time_ms", ()))
    return 500 + 8.0 * spikes + 20.0 * samples


# ---- Public functions


def touch_many(
    table: "str | Path | pandas.DataFrame | Sequence[Mapping[str, Any]] | Mapping[str, Any]",
    output: "str | Path | None" = None,
    *,
    jobs: int = 2,
    executor: str = "local",
    scheduler: str | None = None,
    forces_step_ms: float = FORCES_STEP_MS,
    yes: bool = True,
    show_progress: bool = False,
) -> Touches:
    """Many touches, a row each: spikes of all of them in one data set.

    Rows with the same pad, shape and motion share their contact. The result does not depend on
    the number of workers. A row that fails raises no error: ``failed`` lists it with its cause,
    and the next call with the same `output` runs it again, and whatever is missing.

    Parameters
    ----------
    table
        A DataFrame, a list of dicts, or the path of a .csv or .parquet file, with one row per
        touch: arguments of `fembridge.touch` and the words of ``fembridge touch``, such as
        ``shape, press_um, press_n, slide_mm_per_s, duration_ms, stimulus, x_mm, z_mm,
        angle_deg, population, population_seed, pad, parameters, trials, noise_mv, seed``;
        ``map`` with ``stimulus`` is a response map of a deck of yours instead of a pad. Columns
        ``label`` and ``label_...`` are your own. Or the path of a study file, or a dict with its
        keys, with ``[touches]``, ``[touches.product]`` and ``[touches.draw]``. Or the folder or
        address of a data set, whose missing and failed touches are run.
    output
        Folder of the data set, or an address of fsspec such as ``"s3://bucket/set"``; a data set
        with some of the touches gets the others. Default: None, it is kept in memory.
    jobs
        Processes on this machine, 1 or more. Default: 2.
    executor
        ``local``, processes on this machine, or ``dask``. Default: ``local``.
    scheduler
        Address of a dask cluster, as ``tcp://HOST:PORT``. Its workers need the files that the
        table names under the same paths, and not `output`. Default: None, a cluster of `jobs`
        processes on this machine.
    forces_step_ms
        Step in ms at which depth and force are kept, 0: not at all. Default: 10.
    yes
        Whether to run touches that take more than ten minutes. Default: True.
    show_progress
        Show progress on stderr. Default: False.

    Returns
    -------
    Touches
        ``touches``, ``spikes``, ``rates``, ``units`` and ``forces`` are DataFrames,
        ``counts(bin_ms)`` an array; ``plot()`` draws mean rates.

    Raises
    ------
    UsageError, TableError
        An invalid table or argument, or more than ten minutes of work without `yes`.
    OutputError
        `output` cannot be written, or has another data set.
    MissingError
        pyarrow, fsspec or dask is not installed.

    Warns
    -----
    FembridgeWarning
        Warnings of touches, each text once; the column ``warnings`` has those of each touch.

    Examples
    --------
    >>> import fembridge as fb
    >>> rows = [{"press_um": 200, "population": "one_each", "label": text} for text in "ab"]
    >>> data = fb.touch_many(rows, jobs=1)
    >>> data.touches["label"].tolist(), data.counts(bin_ms=100).shape
    (['a', 'b'], (2, 1, 3, 7))
    """
    check_range("jobs", jobs)
    if executor not in EXECUTORS:
        raise UsageError(argument="executor", found=executor, expected=" or ".join(EXECUTORS))
    if scheduler is not None and executor != "dask":
        raise UsageError("requires the executor dask", argument="scheduler")
    check_range("forces_step_ms", forces_step_ms)
    arrow()
    if isinstance(table, str | Path) and is_dataset(table):
        if output is not None:
            raise UsageError("is for a table, not for a data set", argument="output", found=output)
        output, forces_step_ms = table, read_about(store_of(table))["forces_step_ms"]
        plan = Plan(stored_table(store_of(table)), float(forces_step_ms))
    else:
        plan = Plan(read_touches(table), float(forces_step_ms))
    plan.check()
    store: Store = MemoryStore() if output is None else store_of(output)
    with ExitStack() as stack:
        if isinstance(store, LocalStore):
            make_folder(store.folder)
            stack.enter_context(folder_lock(store.folder, _LOCK, wait=False))
        plan = _begin(plan, store)
        works, done = _unfinished(plan, store)
        unwritten: dict[int, str] = {}
        if works:
            stack.enter_context(signals_as_exits())
            batches = sum(len(plan.parts[number]) for number in works)
            workers = min(jobs, batches)
            limit = workers
            pool: Executor
            if executor == "dask":
                pool = stack.enter_context(dask_executor(scheduler, jobs))
                limit = _CLUSTER_BATCHES
            elif workers == 1 and jobs == 1:
                pool = stack.enter_context(HereExecutor())
            else:
                pool = stack.enter_context(LocalExecutor(workers, attempts=1))
            workers = min(workers, os.cpu_count() or 1) if scheduler is None else jobs
            _check_cost(_estimate(plan, works, pool, workers), yes=yes)
            done += sum(len(work.outcomes) for work in works.values())  # of the trials
            progress = _Progress(store, len(plan.rows), done, shows=show_progress)
            stack.enter_context(progress)
            progress.write()
            unwritten = _run(plan, store, works, pool, limit, progress)
        if not isinstance(store, MemoryStore):
            with suppress(FembridgeError, OSError):
                store.remove(PROGRESS_FILE)
    result = Touches(store, unwritten)
    _warn_once(result)
    return result


def stored_table(store: Store) -> TouchTable:
    """Table of a data set, by which it is resumed.

    Raises
    ------
    UsageError
        Rows with Python objects, which are not stored.
    """
    about, (_, texts) = read_about(store), read_rows(store)
    rows = [json.loads(text) for text in texts if text is not None]
    if len(rows) < len(texts):
        problem = f"has {len(texts) - len(rows)} touches of Python objects: give the table again"
        raise UsageError(problem, Path(str(store)), argument="table")
    labels = dict.fromkeys(name for row in rows for name in row if name not in SETTINGS)
    folder = Path(about["files_from"])
    return TouchTable(tuple(rows), tuple(labels), folder, about["name"], about["study"])


def _begin(plan: Plan, store: Store) -> Plan:
    """The plan of the data set, of which ``dataset.toml`` is written.

    Rows that the data set has keep their numbers; further rows of a longer table follow.

    Raises
    ------
    OutputError
        A data set of another version or step of the forces, or with touches that are not in the
        table.
    """
    if ABOUT_FILE not in store.names("") or not finished_parts(store):
        return _described(plan, store)
    earlier = read_about(store)
    rows, extents = earlier["rows"], earlier["extents"]
    positions, further = plan.positions_of(read_rows(store)[0])
    missing = positions.count(None)
    if earlier["fembridge"] != __version__:
        problem = f"by version {earlier['fembridge']} of fembridge, use that"
    elif earlier["forces_step_ms"] != plan.forces_step_ms:
        problem = f"with forces every {earlier['forces_step_ms']:g} ms, use that step"
    elif missing:
        problem = f"of which {missing} of {rows} touches are not in this table, only add rows"
    else:
        order = [row for row in positions if row is not None] + further
        if not further:
            return plan.ordered(order, extents)
        _LOGGER.info(f"{len(further)} touches are added to {rows}")
        return _described(plan.ordered(order, (*extents, rows)), store)
    if not _is_of_failures(store):
        raise OutputError(f"has a data set {problem}, or choose another folder", Path(str(store)))
    for part in finished_parts(store):  # "touches" first: it marks the others as complete
        for name in reversed(TABLES):
            store.remove(part_name(name, part))
    return _described(plan, store)


def _described(plan: Plan, store: Store) -> Plan:
    """`plan`, after its rows and ``dataset.toml`` were written."""
    import tomli_w

    write_rows(
        store, plan.row_digests, plan.table.rows
    )  # first: they begin with those that were there
    store.write(ABOUT_FILE, tomli_w.dumps(plan.about()).encode())
    return plan


def _is_of_failures(store: Store) -> bool:
    """Whether no touch of a data set is done, so that nothing is lost with it."""
    return all(
        DONE not in read_part(store, "touches", part)["status"].to_pylist()
        for part in finished_parts(store)
    )


def _check_cost(cost: TouchCost | None, *, yes: bool) -> None:
    if cost is None:
        return
    if cost.duration_s > LONG_S and not yes:
        raise UsageError(
            f"{cost}: confirm with --yes; less work are fewer rows, --jobs, or a smaller "
            "population",
            found=cost.duration_s,
            expected=f"at most {LONG_S:g} s",
        )
    _LOGGER.info(str(cost))


def _warn_once(result: Touches) -> None:
    """Issue each different warning of the touches once."""
    touches = result.touches
    counts = Counter(text for texts in touches["warnings"] for text in texts)
    for text, count in counts.most_common(_MOST_WARNINGS):
        warn(f"{count} of {len(touches)} touches: {text}")
    if len(counts) > _MOST_WARNINGS:
        warn(f"{len(counts) - _MOST_WARNINGS} other warnings, see the column warnings of touches")


@dataclass(frozen=True, slots=True)
class TouchCheck:
    """What `verify_touches` found.

    Parameters
    ----------
    checked
        Numbers of the touches that ran again.
    different
        What differs, by the number of the touch.
    damaged
        Files whose checksum is not that of their part.
    skipped
        Number of selected touches that Python objects describe, which cannot run again.
    """

    checked: tuple[int, ...]
    different: Mapping[int, str]
    damaged: tuple[str, ...]
    skipped: int


def verify_touches(
    folder: "str | Path", percent: float = 1.0, *, jobs: int = 1, seed: int | None = None
) -> TouchCheck:
    """Run a random part of a data set again and compare; check the files of all of it.

    Spikes and forces have to be equal to the last bit, which another version of NumPy or another
    kind of processor need not give.

    Parameters
    ----------
    folder
        Folder or address of the data set.
    percent
        Share of the touches in percent; one at least.
    jobs
        Processes on this machine.
    seed
        Seed of the selection. Default: None, another one each time.

    Raises
    ------
    ResultError
        No data set, or a part that cannot be read.
    UsageError
        A share out of range.
    """
    check_range("percent", percent)
    check_range("jobs", jobs)
    result = Touches.read(folder)
    touches = result.touches[result.touches["status"] == DONE].set_index("touch")
    count = min(len(touches), max(1, round(len(touches) * percent / 100)))
    rng = np.random.default_rng(seed)
    selected = sorted(rng.choice(touches.index.to_numpy(), count, replace=False).tolist())
    texts = touches["settings"].to_dict()
    rows = {touch: json.loads(texts[touch]) for touch in selected if isinstance(texts[touch], str)}
    files_from, step_ms = Path(result.about["files_from"]), result.about["forces_step_ms"]
    batches = deque(Batch({touch: row}, files_from, step_ms) for touch, row in rows.items())
    different: dict[int, str] = {}
    examples = {touch: result.places[touch][0] for touch in rows}
    with ExitStack() as stack:
        stack.enter_context(signals_as_exits())
        pool: Executor = HereExecutor() if jobs == 1 else LocalExecutor(jobs)
        stack.enter_context(pool)

        def submit(batch: Batch) -> "Future[list[Outcome]]":
            return pool.submit(run_batch, batch)

        for number, (_, future) in enumerate(finished(submit, batches, jobs), start=1):
            advance("touches run again", number / len(rows))
            for outcome in future.result():
                touch = outcome.touch
                if problem := _difference(result, touches.loc[touch], examples[touch], outcome):
                    different[touch] = problem
    damaged = tuple(damaged_files(result.store))
    return TouchCheck(tuple(rows), dict(sorted(different.items())), damaged, count - len(rows))


def _difference(result: Touches, row: Any, part: int, outcome: Outcome) -> str:  # noqa: ANN401
    """What differs between a touch of the data set and its `outcome` now; "" if nothing does."""
    if outcome.cause:
        return f"fails now: {outcome.cause}"
    changed = [
        name.removesuffix("_sha256")
        for name in ("pad_sha256", "shape_sha256", "trajectory_sha256", "population_sha256",
                     "parameters_sha256")
        if (row[name] if isinstance(row[name], str) else None) != outcome.record.get(name)
    ]  # fmt: skip
    if changed:
        return f"another {', another '.join(changed)}"
    spikes = result.part("spikes", part)
    spikes = spikes[spikes["touch"] == outcome.touch]
    forces = result.part("forces", part)
    forces = forces[forces["touch"] == outcome.touch]
    is_same = (
        spikes["unit"].tolist() == [outcome.unit[unit] for unit in outcome.spike_unit]
        and np.array_equal(spikes["trial"], outcome.trial)
        and np.array_equal(spikes["spike_time_ms"], outcome.time_ms)
    )
    if not is_same:
        version = "" if row["fembridge"] == __version__ else f", by fembridge {row['fembridge']}"
        return f"{outcome.time_ms.size} spikes, {len(spikes)} in the data set{version}"
    for name, values in outcome.forces.items():
        if not np.array_equal(forces[name], values, equal_nan=True):
            return f"another {name}"
    return ""


@dataclass(frozen=True, slots=True)
class TouchStatus:
    """How far a data set is.

    Parameters
    ----------
    rows, done, failed
        Numbers of touches.
    parts, parts_done
        Numbers of parts.
    is_running
        Whether a process has reported progress in the last minute.
    per_s
        Touches per second of the last run, None without a report.
    left_s
        Remaining time in s at this rate, None without a report.
    """

    rows: int
    done: int
    failed: int
    parts: int
    parts_done: int
    is_running: bool
    per_s: float | None
    left_s: float | None


def touches_status(folder: "str | Path") -> TouchStatus:
    """State of a data set that a process may be writing.

    Parameters
    ----------
    folder
        Folder or address of the data set.

    Raises
    ------
    ResultError
        No data set.
    """
    store = store_of(folder)
    about = read_about(store)
    parts = finished_parts(store)
    states = Counter(
        state for part in parts for state in read_part(store, "touches", part)["status"].to_pylist()
    )
    done, failed, rows = states[DONE], states[FAILED], int(about["rows"])
    is_running, per_s, left_s = False, None, None
    try:
        report = tomllib.loads(store.read(PROGRESS_FILE).decode())
        age_s = time.time() - report["now_unix_s"]
        elapsed_s = report["now_unix_s"] - report["begin_unix_s"]
        finished_here = report["done"] + report["failed"] - report["before"]
        is_running = age_s < _SILENT_S
        if is_running:
            done, failed = max(done, report["done"]), max(failed, report["failed"])
        if finished_here > 0 and elapsed_s > 0:
            per_s = finished_here / elapsed_s
            left_s = max(rows - done - failed, 0) / per_s
    except (OSError, ValueError, KeyError, TypeError):  # no run, or a file that is being replaced
        pass
    return TouchStatus(
        rows, done, failed, int(about["parts"]), len(parts), is_running, per_s, left_s
    )
