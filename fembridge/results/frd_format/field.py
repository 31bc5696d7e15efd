"""Whole fields of a ``.frd``: every node of a quantity, one increment at a time.

>>> for field in read_fields("job.frd", "STRESS"):  # doctest: +SKIP
...     print(field.time_ms, field.component("SXX").max())

What is held in memory is the increment that is read and, as long as the caller
keeps it, the one before, whatever the size of the file; with `nodes_at_once` a part
of one. Times are the solver's, over all steps.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fembridge.errors import ResultError, UsageError
from fembridge.results import result_file
from fembridge.results.byte_file import ByteFile
from fembridge.results.frd_format.block import FrdBlock
from fembridge.results.frd_format.index import index_frd
from fembridge.results.frd_format.output import Output, having, outputs_of
from fembridge.results.frd_format.table import NotFiniteError, read_table
from fembridge.results.frd_format.unit import scales_of, units_of
from fembridge.results.read_options import ReadOptions
from fembridge.typing import FloatArray, IntArray

STRESS = "STRESS"


# An array of this size is made and dropped, untouched, before fields are read: glibc
# then keeps memory of up to that size for the next field, instead of handing its
# pages back and faulting them in again at each increment (benchmarks: half the time
# of a float64 file, a quarter of an ASCII one). Elsewhere it does nothing.
_KEPT_BYTES = 1 << 23


@dataclass(frozen=True, slots=True, eq=False)
class Field:
    """A quantity at all its nodes: `values` ``(N, component)`` at `nodes` ``(N,)``.

    Nodes stand as in the file: not always sorted, and some twice, where the deck
    restricts the output to a set. `units` has one word a component, "" where the
    quantity names none (values then are the file's). A mode of a frequency or
    buckling analysis has no time: its `time_ms` is NaN, `increment` the number of
    the mode, `axis_value` its frequency or factor, and `axis` says which.
    A field that comes in parts begins at record `first_row`. Arrays are read-only.
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
    first_row: int = 0

    def __post_init__(self) -> None:
        nodes = np.asarray(self.nodes, dtype=np.int64).view()
        values = np.asarray(self.values, dtype=np.float64).view()
        expected = (len(nodes), len(self.components))
        if nodes.ndim != 1 or values.shape != expected:
            raise ValueError(f"{self.name}: expected {expected}, got {values.shape}")
        if len(self.units) != len(self.components):
            raise ValueError(f"{self.name}: {len(self.units)} units")
        nodes.flags.writeable = values.flags.writeable = False
        object.__setattr__(self, "nodes", nodes)
        object.__setattr__(self, "values", values)

    @property
    def key(self) -> tuple[int, int]:
        """Step and increment: what joins the fields of one output."""
        return self.step, self.increment

    def component(self, name: str) -> FloatArray:
        """Values of one component, ``(N,)``.

        Raises
        ------
        UsageError
            There is no such component.
        """
        if name not in self.components:
            raise UsageError(
                f"{self.name} has no component {name!r}, it has {', '.join(self.components)}"
            )
        column: FloatArray = self.values[:, self.components.index(name)]
        return column

    def at(self, nodes: Sequence[int]) -> FloatArray:
        """Values at `nodes`, ``(node, component)``; of duplicates the first.

        Raises
        ------
        UsageError
            A node has no value here.
        """
        wanted = np.asarray(nodes, dtype=np.int64)
        order = np.argsort(self.nodes, kind="stable")
        place = np.searchsorted(self.nodes, wanted, sorter=order)
        rows = order[np.minimum(place, order.size - 1)] if order.size else place
        fine = self.nodes[rows] == wanted if order.size else np.zeros(wanted.shape, "?")
        if not fine.all():
            raise UsageError(
                f"{self.name} of step {self.step}, increment {self.increment} has no "
                f"node {wanted[~fine][0]}; it has {self.nodes.size} nodes"
            )
        values: FloatArray = self.values[rows]
        return values


def read_fields(
    path: Path | str,
    quantity: str = STRESS,
    *,
    partial: bool = False,
    stress_unit: str = "MPa",
    tell: Callable[[str], None] | None = None,
    nodes_at_once: int | None = None,
) -> Iterator[Field]:
    """Read one quantity, an increment at a time, in file order.

    Stress comes in Pa; it is CalculiX's nodal stress, which at the boundary of two
    materials is a mean over both: `one_sided.one_sided_stress` gives each side's.

    Parameters
    ----------
    path
        A ``.frd`` file, or a run folder.
    quantity
        Its name in the file: "STRESS", "DISP", "TOSTRAIN", "FORC", ...
    partial
        Take what is whole of a run that did not end well; `tell` hears what was
        left out.
    stress_unit
        Unit of the file: "MPa" (N and mm), "kPa" or "Pa".
    nodes_at_once
        Give an increment in fields of so many records at most. With `partial` one
        that turns out not to be finite has then been given as far as it is.

    Raises
    ------
    ResultError
        At once: the file is absent, foreign, cut, or has no such quantity. While
        it is read: a record or a number is none, or is not finite.
    """
    options = ReadOptions(partial=partial, stress_unit=stress_unit, tell=tell)
    fields = _fields(result_file(path), (quantity,), options, nodes_at_once)
    return (output.pop(quantity) for output in fields)  # kept by the caller alone


def read_joined_fields(
    path: Path | str,
    quantities: Sequence[str] = (STRESS, "DISP"),
    *,
    partial: bool = False,
    stress_unit: str = "MPa",
    tell: Callable[[str], None] | None = None,
) -> Iterator[dict[str, Field]]:
    """Read several quantities, joined by step and increment: one dict for each.

    Raises
    ------
    ResultError
        As for `read_fields`; also an increment that has some of them and not all
        (`partial` leaves it out).
    """
    options = ReadOptions(partial=partial, stress_unit=stress_unit, tell=tell)
    return _fields(result_file(path), tuple(quantities), options, None)


class FieldReader:
    """Reads the blocks of an open file; node numbers that repeat are kept once."""

    def __init__(self, file: ByteFile, options: ReadOptions) -> None:
        self._file = file
        self._options = options
        self._nodes: IntArray = np.empty(0, dtype=np.int64)

    def read(self, block: FrdBlock) -> Field:
        """Read all of `block`.

        Raises
        ------
        ResultError
            It holds no records, one is none, or a number is none or not finite.
        """
        return next(self.parts(block, max(1, block.records)))

    def parts(self, block: FrdBlock, most_rows: int) -> Iterator[Field]:
        """Read `block` in fields of `most_rows` records at most."""
        if block.records == 0:
            raise ResultError(
                f"{block} has 0 records: with OUTPUT=3D CalculiX writes none for an "
                "NSET of a plane model; use OUTPUT=2D",
                self._file.path,
            )
        first_row, scales = 0, scales_of(block, self._options)
        for nodes, values in read_table(self._file, block, scales, most_rows):
            if np.array_equal(nodes, self._nodes):
                nodes = self._nodes  # the same, kept once
            self._nodes = nodes
            yield Field(
                name=block.name,
                step=block.step,
                increment=block.increment,
                time_ms=float("nan") if block.modal else block.time_ms,
                components=block.components,
                units=units_of(block),
                nodes=nodes,
                values=values,
                axis=block.output.axis,
                axis_value=block.output.value,
                first_row=first_row,
            )
            first_row += len(nodes)


def _fields(
    path: Path, names: tuple[str, ...], options: ReadOptions, at_once: int | None
) -> Iterator[dict[str, Field]]:
    """Look through the file now, and read it when the fields are asked for."""
    if not names:
        raise UsageError("no quantity to read")
    if at_once is not None and at_once < 1:
        raise UsageError(f"nodes_at_once is {at_once}, expected 1 or more")
    with ByteFile(path) as file:
        outputs = outputs_of(file, index_frd(file), options)
        wanted = having(file, outputs, names, options)
        size = file.size
    return _read(path, size, wanted, options, at_once)


def _read(
    path: Path, size: int, wanted: Sequence[Output], options: ReadOptions, at_once: int | None
) -> Iterator[dict[str, Field]]:
    with ByteFile(path) as file:
        if file.size != size:
            raise ResultError(f"had {size} bytes, now {file.size}: it changes", path)
        reader = FieldReader(file, options)
        np.empty(_KEPT_BYTES, dtype=np.uint8)
        for output in wanted:
            try:
                if at_once is None:
                    yield {name: reader.read(block) for name, block in output.items()}
                else:
                    ((name, block),) = output.items()
                    for part in reader.parts(block, at_once):
                        yield {name: part}
            except NotFiniteError as error:
                if not options.partial:
                    raise
                step, increment = next(iter(output.values())).key
                options.note(f"dropped step {step}, increment {increment}: {error.problem}")
        if file.change is not None and not options.partial:
            raise ResultError(f"{file.change}; read it again when the run has ended", path)
        if file.change is not None:
            options.note(file.change)
