"""Whole fields of any result format: a quantity at all nodes, one increment at a time.

A `Reader` names under `source` the class that opens its format as a `FieldSource`; the
views on whole fields (`read_field`, `nodes.near_nodes`, `vtu`) know no format.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from fembridge.errors import ResultError, UsageError
from fembridge.results import history
from fembridge.results.read_options import ReadOptions
from fembridge.results.readers import reader_of, result_file, units_of
from fembridge.results.stress import DERIVED, TENSOR
from fembridge.store import replacing
from fembridge.tables import write_table
from fembridge.typing import BoolArray, FloatArray, IntArray

Key = tuple[int, int]  # step and increment

LAST = "last"
VERTEX = "vertex"  # kind of a cell that is a node alone
TIMES_IN_MS = "<!-- fembridge: times in ms -->"  # of our PVD; others' have s
FIELD_SUFFIXES = (".npz", ".csv")
_INCREMENT = re.compile(r"(?:(\d{1,9}):)?(\d{1,9})")


@dataclass(frozen=True, slots=True, eq=False)
class Field:
    """A quantity at all its nodes: `values` ``(N, component)`` at `nodes` ``(N,)``.

    Nodes are in file order: not always sorted, and some duplicate, where the deck
    restricts the output to a set. `units` has one word a component, "" where the
    quantity names none (values then are the file's). A mode of a frequency or
    buckling analysis has no time: its `time_ms` is NaN, `increment` the number of
    the mode, `axis_value` its frequency or factor, and `axis` says which.
    Arrays are read-only.
    """

    name: str
    step: int
    increment: int
    time_ms: float
    components: tuple[str, ...]
    units: tuple[str, ...]
    nodes: IntArray
    values: FloatArray
    axis: str = "total time"
    axis_value: float = float("nan")

    def __post_init__(self) -> None:
        nodes, values = self.nodes.view(), self.values.view()
        nodes.flags.writeable = values.flags.writeable = False
        object.__setattr__(self, "nodes", nodes)
        object.__setattr__(self, "values", values)

    @property
    def key(self) -> Key:
        """Step and increment: what joins the fields of one output."""
        return self.step, self.increment

    def component(self, name: str) -> FloatArray:
        """Values of one component, ``(N,)``."""
        if name not in self.components:
            held = ", ".join(self.components)
            raise UsageError(f"{self.name} has no component {name!r}, it has {held}")
        column: FloatArray = self.values[:, self.components.index(name)]
        return column

    def at(self, nodes: Sequence[int]) -> FloatArray:
        """Values at `nodes`, ``(node, component)``; of duplicates the first."""
        rows = rows_of(np.asarray(nodes, dtype=np.int64), self.nodes)
        if (rows < 0).any():
            raise UsageError(
                f"{self.name} of step {self.step}, increment {self.increment} has no node "
                f"{nodes[int(np.argmin(rows))]}; it has {self.nodes.size} nodes"
            )
        values: FloatArray = self.values[rows]
        return values


@dataclass(frozen=True, slots=True, eq=False)
class SceneCells:
    """Elements of one `kind` (``qu4``, see `frd_fields.KIND_OF_TYPE`) as rows of points.

    `ids` and `material` are ``(M,)``, `rows` ``(M, k)`` in the order of a ``.frd``, see
    `frd.ElementRows`. Material -1 is an unknown one.
    """

    kind: str
    ids: IntArray
    material: IntArray
    rows: IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A mesh: `points_mm` ``(P, 3)`` with the numbers `nodes` ``(P,)``, `cells` by kind.

    Of Marc's a node may be a point of each material there. `met` ``(P,)`` counts the
    materials at a node, over which stress is a mean; `materials` names them.
    """

    points_mm: FloatArray
    nodes: IntArray
    cells: tuple[SceneCells, ...]
    met: IntArray
    materials: Mapping[int, str]


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One increment: `time_ms`, or if not `over_time` a mode's value, and values at the points.

    Each of `values` is ``(P,)`` or ``(P, component)``, NaN where there is none; its name
    carries the unit, as `arrays_of` makes it.
    """

    time_ms: float
    scene: Scene
    values: Mapping[str, FloatArray]
    over_time: bool = True


class FieldSource(AbstractContextManager["FieldSource"], Protocol):
    """An open result file; a context manager that closes it."""

    path: Path

    def keys(self, quantity: str) -> Sequence[Key]:
        """Step and increment of each output of `quantity`, in file order."""

    def field(self, quantity: str, key: Key) -> Field:
        """`quantity` at one of its `keys`."""

    def fields(self, quantity: str) -> Iterator[Field]:
        """`quantity` at each of its outputs; what is absent is refused at once."""

    def places(self) -> Iterator[tuple[IntArray, FloatArray, BoolArray]]:
        """Nodes, coordinates ``(n, 3)`` in mm, and which have stress."""

    def frames(
        self, quantities: Sequence[str] | None, derived: Sequence[str], modes: bool = False
    ) -> Iterator[Frame]:
        """Increments, or `modes`, one by one, never both; the file is looked through at once."""

    def history(
        self, nodes: Sequence[int] | None, quantity: str | None, modes: bool, last: bool = False
    ) -> "history.History":
        """Each output of a quantity at `nodes`, as it is.

        `nodes` None takes all that an output has; of a stress without those between
        materials, unless the options allow them. `quantity` is a word of `history.NAMES` or
        the file's name; None takes stress, without one displacement, else the first there
        is. `modes` takes those of frequency and buckling steps where there are times, too;
        `last` the last output alone.
        """


def open_source(path: Path | str, options: ReadOptions) -> FieldSource:
    """Open a result file, or that of a run folder.

    Raises
    ------
    UsageError
        Its format gives no whole fields.
    ResultError
        No such file, or no reader takes it.
    """
    path = result_file(path)
    reader = reader_of(path)
    found: FieldSource = reader.load(reader.source, path, options)(path, options)
    return found


def read_fields(
    path: Path | str,
    quantity: str = "STRESS",
    *,
    partial: bool = False,
    across_materials: bool = False,
    stress_unit: str | None = None,
    length_unit: str | None = None,
    extrapolate: str | None = None,
    log: Callable[[str], None] | None = None,
) -> Iterator[Field]:
    """One quantity, an increment at a time, in file order.

    Stress comes in Pa; CalculiX's nodal stress is, at the boundary of two materials, a
    mean over both: `one_sided.one_sided_stress` gives each side's.

    Parameters
    ----------
    path
        A ``.frd``, ``.t16`` or ``.t19`` file, or a run folder.
    quantity
        Its name in the file: "STRESS", "DISP", "TOSTRAIN", "FORC", ...; of a Marc file
        "Displacement", "Stress", or a beginning that is one quantity's alone, case-blind.
    partial
        Take what is whole of a run that did not end well; `log` gets what was left
        out.
    across_materials, extrapolate
        As for `fembridge.read`, of a Marc file.
    stress_unit, length_unit
        Units of the file, as for `fembridge.read`: None is what its heading says, else MPa
        and mm.

    Raises
    ------
    ResultError
        At once: the file is absent, foreign, cut, or has no such quantity. While
        it is read: a record or a number is none, or is not finite.

    Examples
    --------
    >>> import fembridge as fb
    >>> field = next(fb.read_fields("runs/sine_20_250", "DISP"))
    >>> field.time_ms, field.components, field.units
    (0.5, ('D1', 'D2', 'D3'), ('mm', 'mm', 'mm'))
    """
    path = result_file(path)
    stress, length = units_of(path, stress_unit, length_unit, log=log)
    options = ReadOptions(partial, across_materials, stress, log, extrapolate, length_unit=length)
    with ExitStack() as opened:
        source = opened.enter_context(open_source(path, options))
        return _closing(source.fields(quantity), opened.pop_all())


def _closing(fields: Iterator[Field], opened: ExitStack) -> Iterator[Field]:
    with opened:
        yield from fields


def read_field(
    path: Path,
    quantity: str,
    increment: str = LAST,
    options: ReadOptions = ReadOptions(),  # noqa: B008 - frozen
) -> Field:
    """Read `quantity` at one increment, without reading those before it.

    Parameters
    ----------
    path
        A ``.frd``, ``.t16`` or ``.t19`` file.
    quantity
        Its name in the file: "STRESS", "DISP", ...; of a Marc file "Displacement",
        "Stress", or a beginning that is one quantity's alone, case-blind.
    increment
        "last", an increment's number, or ``STEP:INCREMENT`` where steps begin
        anew. Of a frequency or buckling step it is the number of the mode. Marc
        has sub-increments in the place of steps.

    Raises
    ------
    UsageError
        `increment` is no such word, or is in more than one step.
    ResultError
        As for `read_fields`; also an increment that is absent.
    """
    chosen = _INCREMENT.fullmatch(increment)
    if increment != LAST and chosen is None:
        raise UsageError(f"increment {increment!r}, expected last, N or STEP:N")
    with open_source(path, options) as source:
        held = source.keys(quantity)
        keys = list(held)
        if chosen is not None:
            number = int(chosen[2])
            step = None if chosen[1] is None else int(chosen[1])
            keys = [key for key in keys if key[1] == number and step in (None, key[0])]
            if len(keys) > 1:
                steps = ", ".join(f"{key[0]}:{key[1]}" for key in keys)
                raise UsageError(f"increment {number} is in {len(keys)} steps: {steps}")
        if not keys:
            first, last = held[0], held[-1]
            raise ResultError(
                f"no increment {increment} of {quantity}, it has {first[0]}:{first[1]} "
                f"to {last[0]}:{last[1]}",
                path,
            )
        return source.field(quantity, keys[-1])


def history_of(fields: Sequence[Field], nodes: Sequence[int] | None = None) -> history.History:
    """The history of one quantity at `nodes`, of its `fields`; None takes every node of any."""
    first = fields[0]
    if nodes is None:
        wanted = first.nodes
        for one in fields:
            if one.nodes is not first.nodes:
                wanted = np.union1d(wanted, one.nodes)
        wanted = np.unique(wanted)
    else:
        wanted = np.array(nodes, dtype=np.int64)
    values = np.full((len(fields), wanted.size, len(first.components)), np.nan)
    for row, one in enumerate(fields):
        if one.components != first.components:
            held, expected = (", ".join(each.components) for each in (one, first))
            words = f"{one.name} of step {one.step}, increment {one.increment} has {held}"
            raise UsageError(f"{words}, an output before it {expected}")
        if nodes is not None:
            one.at(nodes)  # which names a node that is absent
        rows = rows_of(wanted, one.nodes)
        values[row, rows >= 0] = one.values[rows[rows >= 0]]
    timed = first.axis == history.TIME
    return history.History(
        quantity=history.word_of(first.name),
        components=first.components,
        units=first.units,
        nodes=tuple(wanted.tolist()),
        at=np.array([one.time_ms if timed else one.axis_value for one in fields]),
        values=values,
        keys=np.array([one.key for one in fields], dtype=np.int64),
        axis=first.axis,
    )


def write_field(path: Path, field: Field) -> None:
    """Write `field` as ``.npz`` or ``.csv``, as the suffix says.

    A CSV has a row for each node, with units in the names of its columns. An NPZ
    has ``nodes``, ``values``, ``components``, ``units``, ``quantity``, ``step``,
    ``increment``, ``axis``, ``axis_value`` and ``time_ms``.
    """
    suffix = path.suffix.lower()
    if suffix not in FIELD_SUFFIXES:
        raise UsageError(f"{path}: expected a name in {' or '.join(FIELD_SUFFIXES)}")
    if suffix == ".csv":
        rows = zip(field.nodes.tolist(), field.values, strict=True)
        header = ("node", *column_names(field))
        write_table(path, header, ((node, *values.tolist()) for node, values in rows))
        return
    named = ("step", "increment", "time_ms", "axis", "axis_value", "components", "units")
    held: dict[str, Any] = {name: np.array(getattr(field, name)) for name in named}
    with replacing(path) as draft, draft.open("wb") as out:
        np.savez_compressed(
            out, quantity=np.array(field.name), nodes=field.nodes, values=field.values, **held
        )


def column_names(field: Field) -> list[str]:
    """A name for each component that carries its unit: ``sxx_pa``."""
    return history.column_names(field.components, field.units)


def arrays_of(field: Field) -> dict[str, FloatArray]:
    """`field` as arrays whose names carry the unit; of several units one a component."""
    if len(set(field.units)) == 1:
        values = field.values[:, 0] if len(field.units) == 1 else field.values
        return {field.name + history.unit_ending(field.units[0]): values}
    columns = zip(column_names(field), field.values.T, strict=True)
    return {f"{field.name}_{name}": column for name, column in columns}


def rows_of(wanted: IntArray, held: IntArray) -> IntArray:
    """Row in `held` of each of `wanted`, any shape; -1 where absent, of duplicates the first."""
    if not held.size:
        return np.full(wanted.shape, -1, dtype=np.int64)
    order = np.argsort(held, kind="stable")
    place = np.searchsorted(held, wanted, sorter=order)
    rows: IntArray = order[np.minimum(place, order.size - 1)]
    return np.where(held[rows] == wanted, rows, -1)


def spread(values: FloatArray, rows: IntArray, size: int) -> FloatArray:
    """Each value in its row, NaN in the others; one component as ``(size,)``."""
    flat = values[:, 0] if values.ndim == 2 and values.shape[1] == 1 else values
    there = np.full((size, *flat.shape[1:]), np.nan)
    fine = rows >= 0
    there[rows[fine]] = flat[fine]
    return there


def derived_of(name: str, fields: Mapping[str, Field]) -> FloatArray:
    """The quantity `name` of `DERIVED` from fields of one increment.

    Raises
    ------
    UsageError
        The fields are at other nodes, or one is no tensor.
    """
    takes, function = DERIVED[name]
    first = fields[takes[0]]
    for quantity in takes[1:]:
        if not np.array_equal(fields[quantity].nodes, first.nodes):
            raise UsageError(f"{name}: {takes[0]} and {quantity} are at other nodes")
    return function(*(tensor_of(fields[quantity]) for quantity in takes))


def tensor_of(field: Field) -> FloatArray:
    """A stress or strain field as ``(N, 6)`` in the order of `stress.TENSOR`.

    Raises
    ------
    UsageError
        The field is no tensor.
    """
    letter = field.components[0][:1]
    wanted = tuple(f"{letter}{place.upper()}" for place in TENSOR)
    if field.components == wanted:
        return field.values
    absent = [name for name in wanted if name not in field.components]
    if absent:
        raise UsageError(
            f"{field.name} has no component {absent[0]}: it is no tensor, it has "
            f"{', '.join(field.components)}"
        )
    tensor: FloatArray = field.values[:, [field.components.index(name) for name in wanted]]
    return tensor
