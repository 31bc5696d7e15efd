"""Whole fields of any result format: a quantity at all nodes, and the mesh they are on."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fembridge.errors import UsageError
from fembridge.results import history
from fembridge.results.stress import DERIVED, TENSOR
from fembridge.store import replacing
from fembridge.tables import write_table
from fembridge.trace import MS_PER_S
from fembridge.typing import BoolArray, FloatArray, IntArray

Key = tuple[int, int]  # step and increment, or mode

VERTEX = "vertex"  # kind of a cell that is a node alone
TIMES_IN_MS = "<!-- fembridge: times in ms -->"  # of our PVD; others' have s
_LARGEST_NODE = 1 << 62
FIELD_SUFFIXES = (".npz", ".csv")


@dataclass(slots=True)
class Block:
    """A quantity at one output of a file.

    `key` joins the blocks of an output. `axis` says what `value` is, as the file has it: the
    time in s (`history.TIME`), or of a mode its frequency, ... `units` has one word a
    component, as those of a `Field`.
    """

    name: str
    key: Key
    axis: str
    value: float
    components: tuple[str, ...]
    units: tuple[str, ...]

    @property
    def at(self) -> float:
        """Its time in ms, or the value of a mode."""
        return self.value * MS_PER_S if self.axis == history.TIME else self.value


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

    def component(self, name: str) -> FloatArray:
        """Values of one component, ``(N,)``."""
        if name not in self.components:
            held = ", ".join(self.components)
            raise UsageError(f"{self.name} has no component {name!r}, it has {held}")
        column: FloatArray = self.values[:, self.components.index(name)]
        return column

    def at(self, nodes: Sequence[int]) -> FloatArray:
        """Values at `nodes`, ``(node, component)``; of duplicates the first."""
        rows = rows_of(np.array(node_numbers(nodes), dtype=np.int64), self.nodes)
        if (rows < 0).any():
            raise UsageError(
                f"{self.name} of step {self.step}, increment {self.increment} has no node "
                f"{nodes[int(np.argmin(rows))]}; it has {self.nodes.size} nodes"
            )
        values: FloatArray = self.values[rows]
        return values


@dataclass(frozen=True, slots=True, eq=False)
class SceneCells:
    """Elements of one `kind` (``quad4``, see `frd.KIND_OF_TYPE`) as rows of points.

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


Frames = tuple[Scene, bool, Iterator[tuple[float, Mapping[str, FloatArray]]]]
"""A mesh, whether it is over time, and of each increment its time in ms, or the value of a mode,
and what is at the points: ``(P,)`` or ``(P, component)``, NaN where there is none, by names that
carry the unit, as `arrays_of` makes them."""


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
        header = ("node", *history.column_names(field.components, field.units))
        write_table(path, header, ((node, *values.tolist()) for node, values in rows))
        return
    named = ("step", "increment", "time_ms", "axis", "axis_value", "components", "units")
    held: dict[str, Any] = {name: np.array(getattr(field, name)) for name in named}
    with replacing(path) as draft, draft.open("wb") as out:
        np.savez_compressed(
            out, quantity=np.array(field.name), nodes=field.nodes, values=field.values, **held
        )


def arrays_of(field: Field) -> dict[str, FloatArray]:
    """`field` as arrays whose names carry the unit; of several units one a component."""
    if len(set(field.units)) == 1:
        values = field.values[:, 0] if len(field.units) == 1 else field.values
        return {field.name + history.unit_ending(field.units[0]): values}
    names = history.column_names(field.components, field.units)
    columns = zip(names, field.values.T, strict=True)
    return {f"{field.name}_{name}": column for name, column in columns}


def node_numbers(nodes: Iterable[int]) -> list[int]:
    """`nodes` as whole numbers.

    Raises
    ------
    UsageError
        One is no whole number, or beyond 2⁶², which no solver has.
    """
    numbers = []
    for node in nodes:
        try:
            number = int(node)
        except (TypeError, ValueError, OverflowError):
            number = _LARGEST_NODE + 1
        if number != node or abs(number) > _LARGEST_NODE:
            raise UsageError(f"node {node}: expected a whole number up to {_LARGEST_NODE}")
        numbers.append(number)
    return numbers


def rows_of(wanted: IntArray, held: IntArray) -> IntArray:
    """Row in `held` of each of `wanted`, any shape; -1 where absent, of duplicates the first."""
    if not held.size:
        return np.full(wanted.shape, -1, dtype=np.int64)
    order = np.argsort(held, kind="stable")
    place = np.searchsorted(held, wanted, sorter=order)
    rows: IntArray = order[np.minimum(place, order.size - 1)]
    return np.where(held[rows] == wanted, rows, -1)


def is_in_sorted(numbers: IntArray, rising: IntArray) -> BoolArray:
    """Whether each of `numbers` is among those `rising`."""
    if not rising.size:
        return np.zeros(numbers.shape, dtype=np.bool_)
    places = np.minimum(np.searchsorted(rising, numbers), rising.size - 1)
    inside: BoolArray = rising[places] == numbers
    return inside


def numbers_near(held: IntArray, absent: int) -> str:
    """The three numbers among those `held` that are nearest to one that is `absent`."""
    near = held[np.argsort(np.abs(held - absent), kind="stable")[:3]]
    return ", ".join(map(str, np.sort(near).tolist()))


def spread(values: FloatArray, rows: IntArray, size: int) -> FloatArray:
    """Each value in its row, NaN in the others; one component as ``(size,)``."""
    flat = values[:, 0] if values.ndim == 2 and values.shape[1] == 1 else values
    there = np.full((size, *flat.shape[1:]), np.nan)
    fine = rows >= 0
    there[rows[fine]] = flat[fine]
    return there


def derived_of(name: str, fields: Mapping[str, Field]) -> FloatArray:
    """The quantity `name` of `DERIVED` from fields of one increment."""
    takes, function = DERIVED[name]
    first = fields[takes[0]]
    for quantity in takes[1:]:
        if not np.array_equal(fields[quantity].nodes, first.nodes):
            raise UsageError(f"{name}: {takes[0]} and {quantity} are at other nodes")
    return function(*(tensor_of(fields[quantity]) for quantity in takes))


def tensor_of(field: Field) -> FloatArray:
    """A stress or strain field as ``(N, 6)`` in the order of `stress.TENSOR`."""
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
