"""Fields of any result format: a quantity at all nodes, and the mesh of the nodes."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fembridge.errors import UsageError
from fembridge.results import history
from fembridge.results.von_mises import DERIVED, TENSOR
from fembridge.trace import MS_PER_S
from fembridge.typing import BoolArray, FloatArray, IntArray

Key = tuple[int, int]  # step and increment, or mode

VERTEX = "vertex"  # kind of a cell of one node
TIMES_IN_MS = "<!-- fembridge: times in ms -->"  # in a PVD of fembridge; others are in s
_LARGEST_NODE = 1 << 62
FIELD_SUFFIXES = (".npz", ".csv")


@dataclass(slots=True)
class FieldBlock:
    """A quantity at one output of a file.

    All blocks of an output have the same `key`. `axis` names the quantity of `value`, which is
    in the unit of the file: time in s (`history.TIME`); for a mode its frequency or buckling
    factor. `units` has one unit for each component, as in a `Field`.
    """

    name: str
    key: Key
    axis: str
    value: float
    components: tuple[str, ...]
    units: tuple[str, ...]

    @property
    def axis_value(self) -> float:
        """Time in ms, or the frequency or factor of a mode."""
        return self.value * MS_PER_S if self.axis == history.TIME else self.value


@dataclass(frozen=True, slots=True, eq=False)
class Field:
    """A quantity at all its nodes, in one increment or mode; arrays are read-only.

    Parameters
    ----------
    name
        Name of the quantity in the file.
    step, increment
        Numbers of the step and increment; `increment` is the number of a mode.
    time_ms
        Time in ms; NaN for a mode.
    components, units
        Name and unit of each component. A unit "" is unknown: values are as in the file.
    nodes
        Node numbers ``(N,)`` in file order: not always sorted, and with duplicates if the deck
        restricts the output to a set.
    values
        Values ``(N, component)``.
    axis
        Quantity of `axis_value`. Default: "total time".
    axis_value
        Frequency or buckling factor of a mode. Default: NaN.
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
            available = ", ".join(self.components)
            raise UsageError(
                f"is {name!r}, expected a component of {self.name}: {available}", argument="name"
            )
        column: FloatArray = self.values[:, self.components.index(name)]
        return column

    def values_at(self, nodes: Sequence[int]) -> FloatArray:
        """Values at `nodes`, ``(node, component)``; the first of duplicates."""
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
    `frd.ElementRows`. Material -1 is unknown.
    """

    kind: str
    ids: IntArray
    material: IntArray
    rows: IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A mesh: `points_mm` ``(P, 3)`` with the numbers `nodes` ``(P,)``, `cells` by kind.

    In a Marc file a node has one point for each material. `material_count` ``(P,)`` is the
    number of materials at a node, over which stress is averaged; `materials` are their names.
    """

    points_mm: FloatArray
    nodes: IntArray
    cells: tuple[SceneCells, ...]
    material_count: IntArray
    materials: Mapping[int, str]


Frames = tuple[Scene, bool, Iterator[tuple[float, Mapping[str, FloatArray]]]]
"""A mesh, whether its increments have times, and for each increment its time in ms (or the
frequency or factor of a mode) and arrays at the points by name, ``(P,)`` or ``(P, component)``,
NaN where a point has no value; `named_arrays` makes the names."""


def write_field(path: Path, field: Field) -> None:
    """Write `field` as ``.npz`` or ``.csv``, depending on the suffix.

    A CSV has a row for each node and units in its column names. An NPZ
    has ``nodes``, ``values``, ``components``, ``units``, ``quantity``, ``step``,
    ``increment``, ``axis``, ``axis_value`` and ``time_ms``.
    """
    suffix = path.suffix.lower()
    if suffix not in FIELD_SUFFIXES:
        suffixes = " or ".join(FIELD_SUFFIXES)
        raise UsageError(f"is {path}, expected a name in {suffixes}", argument="output")
    if suffix == ".csv":
        from fembridge.io.text_table import write_table

        rows = zip(field.nodes.tolist(), field.values, strict=True)
        header = ("node", *history.column_names(field.components, field.units))
        write_table(path, header, ((node, *values.tolist()) for node, values in rows))
        return
    from fembridge.host.store import replacing

    attributes = ("step", "increment", "time_ms", "axis", "axis_value", "components", "units")
    arrays: dict[str, Any] = {name: np.array(getattr(field, name)) for name in attributes}
    with replacing(path) as draft, draft.open("wb") as out:
        np.savez_compressed(
            out, quantity=np.array(field.name), nodes=field.nodes, values=field.values, **arrays
        )


def named_arrays(field: Field) -> dict[str, FloatArray]:
    """`field` as arrays by name with unit; a field of several units has one array a component."""
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
        A number is not whole, or beyond 2⁶², the limit here.
    """
    if not isinstance(nodes, Iterable):
        raise UsageError(argument="nodes", found=nodes, expected="a list of node numbers")
    numbers = []
    for node in nodes:
        try:
            number = int(node)
        except (TypeError, ValueError, OverflowError):
            number = _LARGEST_NODE + 1
        if number != node or abs(number) > _LARGEST_NODE:
            raise UsageError(
                f"contains {node}, expected a whole number up to {_LARGEST_NODE}", argument="nodes"
            )
        numbers.append(number)
    return numbers


def rows_of(requested: IntArray, available: IntArray) -> IntArray:
    """Row in `available` of each of `requested`, same shape; -1 if absent, first of duplicates."""
    if not available.size:
        return np.full(requested.shape, -1, dtype=np.int64)
    order = np.argsort(available, kind="stable")
    index = np.searchsorted(available, requested, sorter=order)
    rows: IntArray = order[np.minimum(index, order.size - 1)]
    return np.where(available[rows] == requested, rows, -1)


def is_in_sorted(numbers: IntArray, sorted_numbers: IntArray) -> BoolArray:
    """Whether each of `numbers` is in `sorted_numbers`."""
    if not sorted_numbers.size:
        return np.zeros(numbers.shape, dtype=np.bool_)
    indices = np.minimum(np.searchsorted(sorted_numbers, numbers), sorted_numbers.size - 1)
    inside: BoolArray = sorted_numbers[indices] == numbers
    return inside


def distinct(numbers: IntArray, axis: int | None = None) -> IntArray:
    """Sorted distinct numbers, or rows with `axis` 0.

    Without an index `numpy.unique` imports `numpy.ma`, half as much as NumPy itself.
    """
    values: IntArray = np.unique(numbers, return_index=True, axis=axis)[0]
    return values


def numbers_near(available: IntArray, number: int) -> str:
    """Text of the three `available` numbers that are nearest to `number`."""
    near = available[np.argsort(np.abs(available - number), kind="stable")[:3]]
    return ", ".join(map(str, np.sort(near).tolist()))


def scatter_rows(values: FloatArray, rows: IntArray, size: int) -> FloatArray:
    """Values placed at `rows`, NaN elsewhere: ``(size, component)``, one component ``(size,)``."""
    flat = values[:, 0] if values.ndim == 2 and values.shape[1] == 1 else values
    filled = np.full((size, *flat.shape[1:]), np.nan)
    is_used = rows >= 0
    filled[rows[is_used]] = flat[is_used]
    return filled


def derive_values(name: str, fields: Mapping[str, Field]) -> FloatArray:
    """The quantity `name` of `DERIVED` from fields of one increment."""
    sources, function = DERIVED[name]
    first = fields[sources[0]]
    for quantity in sources[1:]:
        if not np.array_equal(fields[quantity].nodes, first.nodes):
            raise UsageError(f"{name} needs {sources[0]} and {quantity} at the same nodes")
    return function(*(tensor_values(fields[quantity]) for quantity in sources))


def tensor_values(field: Field) -> FloatArray:
    """Values ``(N, 6)`` of a stress or strain field in the order of `von_mises.TENSOR`."""
    letter = field.components[0][:1]
    components = tuple(f"{letter}{component.upper()}" for component in TENSOR)
    if field.components == components:
        return field.values
    absent = [name for name in components if name not in field.components]
    if absent:
        raise UsageError(
            f"{field.name} is not a tensor: component {absent[0]} is missing from "
            f"{', '.join(field.components)}"
        )
    tensor: FloatArray = field.values[:, [field.components.index(name) for name in components]]
    return tensor
