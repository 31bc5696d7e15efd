"""The node and element blocks of a ``.frd``: where they end, which materials meet.

A stress at a node of a ``.frd`` is the mean over all elements there, whatever
their material: on a layer boundary it belongs to neither layer. The element
block tells the material of each element, so the reader can see the boundary.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.byte_file import ByteFile
from fembridge.results.frd_format.element import (
    NODES_OF_TYPE,
    UNKNOWN_MATERIAL,
    ElementRows,
    packed_elements,
    printed_elements,
)

__all__ = [
    "NODES_OF_TYPE",
    "UNKNOWN_MATERIAL",
    "MeshBlock",
    "element_rows",
    "materials_at",
    "read_mesh_block",
]

_LEAST_ELEMENT_BYTES = 24  # packed: four words, and two nodes of a beam


@dataclass(frozen=True, slots=True)
class MeshBlock:
    """Where a node or element block begins and ends.

    `records` is None where the header leaves the count blank.
    """

    records: int | None
    flag: int
    offset: int
    end: int

    @property
    def binary(self) -> bool:
        """Whether the records are packed numbers."""
        return self.flag >= 2

    @property
    def id_width(self) -> int:
        """Characters of a number of a node or element in an ASCII record."""
        return 5 if self.flag == 0 else 10


def read_mesh_block(file: ByteFile, header: bytes, offset: int) -> MeshBlock:
    """Find the end of the block whose `header` line ends at `offset`.

    Raises
    ------
    ResultError
        The block is cut, or is not as long as its header says.
    """
    count, flag_text = header[24:36].strip(), header[73:75].strip()
    if not flag_text.isdigit() or not (count.isdigit() or not count):
        raise ResultError(f"header {header!r} cannot be read", file.path)
    records, flag = int(count) if count else None, int(flag_text)
    if flag < 2:
        end = _text_end(file, offset, records)
        return MeshBlock(records, flag, offset, end)
    if records is None:
        raise ResultError("binary, and without a count", file.path)
    if header.startswith(b"    2C"):
        end = offset + records * (28 if flag == 3 else 16)
        if end > file.size:
            raise ResultError(f"cut: {records} nodes announced", file.path)
        return MeshBlock(records, flag, offset, end)
    if offset + _LEAST_ELEMENT_BYTES * records > file.size:
        raise ResultError(f"cut: {records} elements announced", file.path)
    end = offset
    for _, end in packed_elements(file, offset, records):  # noqa: B007 - the last
        pass
    return MeshBlock(records, flag, offset, end)


def element_rows(file: ByteFile, elements: MeshBlock) -> Iterator[ElementRows]:
    """Yield the elements, in file order, in tables of one type.

    Raises
    ------
    ResultError
        A record is no element.
    """
    if elements.binary:
        found = packed_elements(file, elements.offset, elements.records or 0)
        return (rows for rows, _ in found)
    return printed_elements(file, elements.offset, elements.end, elements.id_width)


def materials_at(
    file: ByteFile, elements: MeshBlock, nodes: Collection[int]
) -> dict[int, set[int]]:
    """Give the material numbers of the elements at each of `nodes`."""
    wanted = np.unique(np.fromiter(nodes, dtype=np.int64))
    materials: dict[int, set[int]] = {int(node): set() for node in wanted}
    for rows in element_rows(file, elements):
        corners = rows.corners.ravel()
        material = np.repeat(rows.material, rows.corners.shape[1])
        place = np.minimum(np.searchsorted(wanted, corners), wanted.size - 1)
        hits = wanted[place] == corners
        pairs = np.stack([corners[hits], material[hits]])
        for node, number in np.unique(pairs, axis=1).T:
            materials[int(node)].add(int(number))
    return materials


def _text_end(file: ByteFile, offset: int, records: int | None) -> int:
    found = file.find((b"\n -3",), offset - 1)
    last = None if found is None else file.line(found[0] + 1)
    if found is None or last is None or last[0].strip() != b"-3":
        raise ResultError("cut: its end line -3 is missing", file.path)
    present = file.count(b"\n -1", offset - 1, found[0])
    if records is not None and present != records:
        raise ResultError(f"{records} records announced, {present} present", file.path)
    return last[1]
