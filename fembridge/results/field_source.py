"""What whole-field views ask of a result format: fields, places, sets, pictures.

`field_file`, `near_node` and `vtu` know no format. A `Reader` names the class that
answers for its own, under `source`; it is opened with a path and `ReadOptions`.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import TracebackType
from typing import Protocol

import numpy as np

from fembridge.errors import UsageError
from fembridge.results import reader_of, result_file
from fembridge.results.frd_format.field import Field
from fembridge.results.read_options import ReadOptions
from fembridge.typing import BoolArray, FloatArray, IntArray

Key = tuple[int, int]  # step and increment


@dataclass(frozen=True, slots=True, eq=False)
class SceneCells:
    """Elements of one `kind` (``qu4``, see `frd_format.grid`) as rows of points.

    `ids` and `material` are ``(M,)``, `rows` ``(M, k)`` in the order of a ``.frd``.
    """

    kind: str
    ids: IntArray
    material: IntArray
    rows: IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A mesh for pictures: `points_mm` ``(P, 3)`` with the numbers `nodes` ``(P,)``.

    A node may be a point of each material there. `met` ``(P,)`` counts them;
    `materials` names them.
    """

    points_mm: FloatArray
    nodes: IntArray
    cells: tuple[SceneCells, ...]
    met: IntArray
    materials: Mapping[int, str]


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One increment: `time_ms`, or the value of its axis, and values at the points.

    Each of `values` is ``(P,)`` or ``(P, component)``, NaN where there is none.
    """

    time_ms: float
    scene: Scene
    values: Mapping[str, FloatArray]


class FieldSource(Protocol):
    """An open result file; a context manager that closes it."""

    path: Path

    def __enter__(self) -> "FieldSource":
        """Give itself."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the file."""

    def keys(self, quantity: str) -> Sequence[Key]:
        """Give step and increment of each output of `quantity`, in file order."""

    def field(self, quantity: str, key: Key) -> Field:
        """Read `quantity` at one of its `keys`."""

    def places(self) -> Iterator[tuple[IntArray, FloatArray, BoolArray]]:
        """Yield nodes, coordinates ``(n, 3)`` in mm, and which have stress."""

    def frames(self, quantities: Sequence[str] | None, derived: Sequence[str]) -> Iterator[Frame]:
        """Look through the file now; yield its increments when they are asked for."""


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
    if not reader.source:
        raise UsageError(f"{path}: {reader.name} gives traces, no whole fields")
    if options.extrapolate and not reader.points:
        raise UsageError(
            f"{path}: {reader.name} holds values at nodes; how they are extrapolated "
            "there is asked of a Marc post file"
        )
    module, _, name = reader.source.partition(":")
    found: FieldSource = getattr(import_module(module), name)(path, options)
    return found


def spread(values: FloatArray, rows: IntArray, size: int) -> FloatArray:
    """Put each value in its row, NaN in the others; one component as ``(size,)``."""
    flat = values[:, 0] if values.ndim == 2 and values.shape[1] == 1 else values
    there = np.full((size, *flat.shape[1:]), np.nan)
    fine = rows >= 0
    there[rows[fine]] = flat[fine]
    return there
