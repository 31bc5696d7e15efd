"""The mesh of a ``.frd`` as a value: nodes, their coordinates, elements by type.

Lengths are taken as mm. Plane elements (tr3, tr6, qu4, qu8) lie at z = 0. The
nodes of an element stand in the order of the file; `frd_element` tells it.
"""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from fembridge.errors import ResultError
from fembridge.results import result_file
from fembridge.results.byte_file import ByteFile
from fembridge.results.frd_format.block import FrdBlock
from fembridge.results.frd_format.element import NODES_OF_TYPE, ElementRows
from fembridge.results.frd_format.index import FrdIndex, index_frd
from fembridge.results.frd_format.mesh import MeshBlock, element_rows
from fembridge.results.frd_format.table import read_table
from fembridge.typing import FloatArray, IntArray

_Array = TypeVar("_Array", bound="np.ndarray[Any, Any]")

KIND_OF_TYPE = {
    1: "he8", 2: "pe6", 3: "te4", 4: "he20", 5: "pe15", 6: "te10",
    7: "tr3", 8: "tr6", 9: "qu4", 10: "qu8", 11: "be2", 12: "be3",
}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """Elements of one `kind`, in file order.

    `ids` and `material` are ``(M,)``, `corners` ``(M, k)`` numbers of nodes.
    Material -1 is an unknown one.
    """

    kind: str
    ids: IntArray
    material: IntArray
    corners: IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """A mesh: `nodes` ``(N,)``, `coordinates_mm` ``(N, 3)``, `cells` by kind.

    `materials` names material numbers, as far as the file does.
    """

    nodes: IntArray
    coordinates_mm: FloatArray
    cells: tuple[Cells, ...]
    materials: dict[int, str] = field(default_factory=dict)

    def rows_of(self, nodes: IntArray) -> IntArray:
        """Row in `nodes` of each number, any shape; -1 where the mesh has no such."""
        order = np.argsort(self.nodes, kind="stable")
        if not order.size:
            return np.full(nodes.shape, -1, dtype=np.int64)
        place = np.searchsorted(self.nodes, nodes, sorter=order)
        rows: IntArray = order[np.minimum(place, order.size - 1)]
        return np.where(self.nodes[rows] == nodes, rows, -1)

    def materials_met(self) -> IntArray:
        """How many materials meet at each node, ``(N,)``: stress is a mean over them.

        1 inside a layer, 2 on its boundary, 0 at a node of no element.
        """
        met = np.zeros(self.nodes.size, dtype=np.int64)
        kinds = np.unique(np.concatenate([[0], *(c.material for c in self.cells)]))
        for number in kinds:
            touched = np.zeros(self.nodes.size, dtype=np.bool_)
            for cells in self.cells:
                touched[self.rows_of(cells.corners[cells.material == number])] = True
            met += touched
        return met

    def materials_of(self, node: int) -> tuple[int, ...]:
        """Materials of the elements at `node`, ascending."""
        met = [cells.material[(cells.corners == node).any(axis=1)] for cells in self.cells]
        return tuple(np.unique(np.concatenate(met)).tolist()) if met else ()


def read_grid(path: Path | str) -> Grid:
    """Read the mesh of a ``.frd``, or of a run folder's.

    Raises
    ------
    ResultError
        The file is absent, foreign, has no mesh, or its mesh is damaged.
    """
    with ByteFile(result_file(path)) as file:
        return read_grid_of(file, index_frd(file))


def read_grid_of(file: ByteFile, index: FrdIndex) -> Grid:
    """Read the mesh of an open file, as `read_grid` does."""
    if index.nodes is None or index.elements is None:
        kind = "nodes" if index.nodes is None else "elements"
        words = "; ".join(harm.problem for harm in index.damage)
        raise ResultError(f"no whole block of {kind}{words and ': '}{words}", file.path)
    nodes, coordinates_mm = _nodes(file, index.nodes)
    if np.unique(nodes).size != nodes.size:
        raise ResultError("node block: a node is there twice", file.path)
    parts: dict[int, list[ElementRows]] = {}
    for rows in element_rows(file, index.elements):
        expected = NODES_OF_TYPE.get(rows.type)
        if expected != rows.corners.shape[1]:
            raise ResultError(
                f"element {rows.ids[0]} of type {rows.type} has "
                f"{rows.corners.shape[1]} nodes, expected {expected or 'another type'}",
                file.path,
            )
        parts.setdefault(rows.type, []).append(rows)
    cells = tuple(_together(kind, parts[kind]) for kind in sorted(parts))
    grid = Grid(_fixed(nodes), _fixed(coordinates_mm), cells, dict(index.materials))
    for some in cells:
        absent = some.corners[grid.rows_of(some.corners) < 0]
        if absent.size:
            raise ResultError(
                f"an element of kind {some.kind} has node {absent[0]}, which the mesh has not",
                file.path,
            )
    return grid


def _nodes(file: ByteFile, block: MeshBlock) -> tuple[IntArray, FloatArray]:
    """Read the node block as what it is: records of three numbers."""
    windows = file.peek(block.end - 2, 2) == b"\r\n"
    records = block.records
    if records is None:  # a fluid file leaves the count blank
        records = file.count(b"\n -1", block.offset - 1, block.end)
    if records == 0:
        raise ResultError("node block: no nodes", file.path)
    table = FrdBlock(
        name="node block",
        step=0,
        increment=0,
        time_ms=0.0,
        records=records,
        components=("x", "y", "z"),
        flag=block.flag,
        offset=block.offset,
        line_end=2 if windows and not block.binary else 1,
    )
    regular = block.binary or table.end + len(b" -3") + table.line_end == block.end
    if not regular:
        table = replace(table, free=True)
    try:
        return next(read_table(file, table, (1.0, 1.0, 1.0), records))
    except ResultError as error:
        problem = error.problem.replace(str(table), table.name)
        raise ResultError(problem.replace(" at 0 ms", ""), file.path) from error


def _together(kind: int, parts: list[ElementRows]) -> Cells:
    return Cells(
        KIND_OF_TYPE[kind],
        _fixed(np.concatenate([rows.ids for rows in parts])),
        _fixed(np.concatenate([rows.material for rows in parts])),
        _fixed(np.concatenate([rows.corners for rows in parts])),
    )


def _fixed(array: _Array) -> _Array:
    array.flags.writeable = False
    return array
