"""Whole fields, places and pictures of a ``.frd``."""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.byte_file import ByteFile
from fembridge.results.derived import DERIVED, derived_of
from fembridge.results.field_source import Frame, Key, Scene, SceneCells, spread
from fembridge.results.frd_format.block import FrdBlock
from fembridge.results.frd_format.field import Field, FieldReader
from fembridge.results.frd_format.grid import Grid, read_grid_of
from fembridge.results.frd_format.index import FrdIndex, index_frd
from fembridge.results.frd_format.output import Output, having, outputs_of
from fembridge.results.frd_format.records import node_ids
from fembridge.results.frd_format.table import NotFiniteError, read_table
from fembridge.results.read_options import ReadOptions
from fembridge.typing import BoolArray, FloatArray, IntArray

STRESS = "STRESS"
_ROWS_AT_ONCE = 1 << 15
_AXES = ("X", "Y", "Z")


class FrdSource:
    """An open ``.frd``, see `fembridge.results.field_source.FieldSource`."""

    def __init__(self, path: Path, options: ReadOptions) -> None:
        self.path, self._options = path, options
        self._file = ByteFile(path)
        self._known: FrdIndex | None = None

    def __enter__(self) -> "FrdSource":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.__exit__(kind, error, trace)

    def keys(self, quantity: str) -> list[Key]:
        """Give step and increment of each output of `quantity`, in file order."""
        return list(self._blocks(quantity))

    def field(self, quantity: str, key: Key) -> Field:
        """Read `quantity` at one of its `keys`."""
        block = self._blocks(quantity)[key]
        return FieldReader(self._file, self._options).read(block)

    def places(self) -> Iterator[tuple[IntArray, FloatArray, BoolArray]]:
        """Yield nodes, coordinates ``(n, 3)`` in mm, and which have stress.

        Raises
        ------
        ResultError
            No nodes, or no stress in the file; a coordinate is no number.
        """
        file, index = self._file, self._index
        blocks = [block for block in index.named(STRESS) if block.records]
        if not blocks:
            held = ", ".join(index.names) or "nothing"
            raise ResultError(f"no {STRESS} in it, it holds {held}", self.path)
        held_by = np.unique(node_ids(file, blocks[0]))
        block, scales = _node_block(file, index), (1.0,) * len(_AXES)
        for nodes, at_mm in read_table(file, block, scales, _ROWS_AT_ONCE):
            yield nodes, at_mm, np.isin(nodes, held_by)

    def frames(self, quantities: Sequence[str] | None, derived: Sequence[str]) -> Iterator[Frame]:
        """Look through the file now; yield its increments when they are asked for."""
        file, index, options = self._file, self._index, self._options
        outputs: Sequence[Output] = outputs_of(file, index, options)
        if quantities is not None:
            outputs = having(file, outputs, quantities, options)
        grid = read_grid_of(file, index)
        scene = _scene(grid)
        between = int((scene.met > 1).sum())
        if between:
            options.note(
                f"{between} nodes lie between materials ('materials' is 2 or "
                "more there): nodal stress and strain are a mean over them and belong "
                "to none"
            )
        return self._frames(outputs, grid, scene, derived)

    def _frames(
        self, outputs: Sequence[Output], grid: Grid, scene: Scene, derived: Sequence[str]
    ) -> Iterator[Frame]:
        reader = FieldReader(self._file, self._options)
        for fields in _fields(reader, outputs, self._options):
            first = next(iter(fields.values()))
            time = first.axis_value if math.isnan(first.time_ms) else first.time_ms
            values = _point_data(fields, grid, derived, self._options)
            yield Frame(time, scene, values)

    @property
    def _index(self) -> FrdIndex:
        if self._known is None:
            self._known = index_frd(self._file)
        return self._known

    def _blocks(self, quantity: str) -> dict[Key, FrdBlock]:
        outputs = outputs_of(self._file, self._index, self._options)
        held = having(self._file, outputs, (quantity,), self._options)
        return {output[quantity].key: output[quantity] for output in held}


def _scene(grid: Grid) -> Scene:
    return Scene(
        points_mm=grid.coordinates_mm,
        nodes=grid.nodes,
        cells=tuple(
            SceneCells(one.kind, one.ids, one.material, grid.rows_of(one.corners))
            for one in grid.cells
        ),
        met=grid.materials_met(),
        materials=grid.materials,
    )


def _fields(
    reader: FieldReader, outputs: Sequence[Output], options: ReadOptions
) -> Iterator[dict[str, Field]]:
    """Yield the fields of each output; blocks without a record are told of."""
    for output in outputs:
        empty = [block for block in output.values() if block.records == 0]
        for block in empty:
            options.note(f"left out: {block} has 0 records")
        full = {n: block for n, block in output.items() if block.records}
        if not full:
            continue
        try:
            yield {name: reader.read(block) for name, block in full.items()}
        except NotFiniteError as error:
            if not options.partial:
                raise
            step, increment = next(iter(full.values())).key
            options.note(f"dropped step {step}, increment {increment}: {error.problem}")


def _point_data(
    fields: Mapping[str, Field], grid: Grid, derived: Sequence[str], options: ReadOptions
) -> dict[str, FloatArray]:
    """Give all values of an increment at the nodes of the mesh."""
    points, size = {}, grid.nodes.size
    for name, field in fields.items():
        rows = _rows_of(grid, field.nodes)
        points[name] = spread(field.values, rows, size)
        held = np.unique(rows[rows >= 0]).size
        where = f"{name} of step {field.step}, increment {field.increment}"
        if held < size:
            options.note(f"{where} has {held} of {size} nodes; the others are NaN")
        strange = field.nodes[rows < 0]
        if strange.size:
            options.note(
                f"left out: {where} has {strange.size} nodes that the mesh has not, "
                f"{strange[0]} among them"
            )
    for name in derived:
        takes = DERIVED[name][0]
        if all(quantity in fields for quantity in takes):
            with np.errstate(over="ignore", invalid="ignore"):  # of 1e200, no warning
                values = derived_of(name, fields)
            rows = _rows_of(grid, fields[takes[0]].nodes)
            points[name] = spread(values, rows, size)
    return points


def _rows_of(grid: Grid, nodes: IntArray) -> IntArray:
    if np.array_equal(nodes, grid.nodes):
        return np.arange(nodes.size)
    return grid.rows_of(nodes)


def _node_block(file: ByteFile, index: FrdIndex) -> FrdBlock:
    """Give the node block as one of three components: its records are the same."""
    nodes = index.nodes
    if nodes is None:
        raise ResultError("no node block, so no coordinates", file.path)
    records = nodes.records
    if records is None:
        records = file.count(b"\n -1", nodes.offset - 1, nodes.end)
    line_end = 2 if file.peek(nodes.offset - 2, 1) == b"\r" else 1
    block = FrdBlock("node block", 0, 0, 0.0, records, _AXES, nodes.flag, nodes.offset, line_end)
    if nodes.binary or file.holds(block.end, b" -3"):
        return block
    return FrdBlock(
        "node block", 0, 0, 0.0, records, _AXES, nodes.flag, nodes.offset, line_end, True
    )
