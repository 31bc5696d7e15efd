"""The records of wanted nodes in one result block of a ``.frd``.

Nodes stand in the order of the deck's set: not sorted, some twice. The rows of
the wanted nodes are found once and tried on the next block of that name; the id
in front of each record says whether they still hold, and if not they are sought
again in that block. Only the wanted records are read, unless they lie dense.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.byte_file import CHUNK_BYTES, ByteFile
from fembridge.results.frd_format.block import VALUES_A_LINE, FrdBlock
from fembridge.results.frd_format.fixed_text import FIELD, floats, integers, to_characters
from fembridge.results.frd_format.free_records import free_ids, free_values
from fembridge.results.frd_format.record import read_record
from fembridge.typing import BoolArray, FloatArray, IntArray

_FEW = 64  # below so many nodes, record by record is faster than arrays
_SEEK_BYTES = 1 << 16  # records within so few bytes are read in one go


class NodeRecords:
    """Reads the same nodes from one block after another."""

    def __init__(self, file: ByteFile, nodes: Sequence[int]) -> None:
        self._file = file
        self._nodes = np.asarray(nodes, dtype=np.int64)
        self._rows: dict[str, IntArray] = {}

    def read(self, block: FrdBlock) -> FloatArray:
        """Values at the nodes, ``(node, component)``, as the file has them.

        Raises
        ------
        ResultError
            A node has no record in this block, or a record is not one.
        """
        if block.free:
            return self._free(block)
        rows = self._rows.get(block.name)
        values = None
        if rows is not None:
            values = self._few(block, rows)
            values = self._at(block, rows) if values is None else values
        if values is None:
            rows = _find_rows(self._file, block, self._nodes)
            self._rows[block.name] = rows
            values = self._at(block, rows)
        if values is None:
            raise ResultError(f"{block}: records changed while read", self._file.path)
        return values

    def _free(self, block: FrdBlock) -> FloatArray:
        try:
            return free_values(self._file, block, self._nodes)
        except KeyError as error:
            ids = free_ids(self._file, block)
            words = _absent(block, error.args[0], ids)
            raise ResultError(words, self._file.path) from error

    def _few(self, block: FrdBlock, rows: IntArray) -> FloatArray | None:
        if rows.size > _FEW:
            return None
        values = []
        for row, node in zip(rows.tolist(), self._nodes.tolist(), strict=True):
            record = read_record(self._file, block, row, node)
            if record is None:
                return None
            values.append(record)
        return np.array(values, dtype=np.float64)

    def _at(self, block: FrdBlock, rows: IntArray) -> FloatArray | None:
        if rows.size and rows.max() >= block.records:
            return None
        raw = _gather(self._file, block, rows)
        ids, fine = _ids(block, raw)
        if not fine.all() or (ids != self._nodes).any():
            return None
        return _values(self._file, block, raw)


def node_ids(file: ByteFile, block: FrdBlock) -> IntArray:
    """Numbers of the nodes of `block`, in its order, ``(record,)``.

    Raises
    ------
    ResultError
        A record does not begin like one.
    """
    if block.free:
        return free_ids(file, block)
    step = max(1, 4 * CHUNK_BYTES // block.record_bytes)
    parts = [np.empty(0, dtype=np.int64)]
    for first in range(0, block.records, step):
        some = min(step, block.records - first)
        at = block.offset + first * block.record_bytes
        ids, fine = _ids(block, file.take(at, some * block.record_bytes))
        if not fine.all():
            row = first + int(np.flatnonzero(~fine)[0])
            start = file.peek(block.offset + row * block.record_bytes, 14)
            raise ResultError(
                f"{block}: record {row + 1} of {block.records} begins with {start!r}", file.path
            )
        parts.append(ids)
    return np.concatenate(parts)


def node_at(file: ByteFile, block: FrdBlock, row: int) -> int | None:
    """Give the number of the node of record `row`; None if that is no record."""
    raw = file.take(block.offset + row * block.record_bytes, block.record_bytes)
    ids, fine = _ids(block, raw)
    return int(ids[0]) if fine[0] else None


def _find_rows(file: ByteFile, block: FrdBlock, nodes: IntArray) -> IntArray:
    ids = node_ids(file, block)
    if ids.size == 0:
        raise ResultError(
            f"{block} has 0 records: with OUTPUT=3D CalculiX writes none for an "
            "NSET of a plane model; use OUTPUT=2D",
            file.path,
        )
    order = np.argsort(ids, kind="stable")  # stable: of duplicates the first
    place = np.minimum(np.searchsorted(ids[order], nodes), ids.size - 1)
    rows: IntArray = order[place]
    absent = nodes[ids[rows] != nodes]
    if absent.size:
        raise ResultError(_absent(block, int(absent[0]), ids), file.path)
    return rows


def _absent(block: FrdBlock, node: int, ids: IntArray) -> str:
    held = np.unique(ids)
    if not held.size:
        return f"node {node} has no record in {block}, which has none at all"
    near = held[np.argsort(np.abs(held - node), kind="stable")[:3]]
    return (
        f"node {node} has no record in {block}: {held.size} nodes, "
        f"{held[0]} to {held[-1]}; nearest {', '.join(map(str, np.sort(near)))}"
    )


def _gather(file: ByteFile, block: FrdBlock, rows: IntArray) -> bytes:
    """Read the records at `rows`, one after the other in that order."""
    if rows.size == 0:
        return b""
    length, first, last = block.record_bytes, int(rows.min()), int(rows.max())
    span = (last - first + 1) * length
    if span <= _SEEK_BYTES or span <= 4 * rows.size * length:
        raw = file.take(block.offset + first * length, span)
        table = np.frombuffer(raw, dtype=np.uint8).reshape(-1, length)
        return table[rows - first].tobytes()
    take, offset = file.take, block.offset
    return b"".join(take(offset + row * length, length) for row in rows.tolist())


def _ids(block: FrdBlock, raw: bytes) -> tuple[IntArray, BoolArray]:
    """Give the id of each record, and which records look like one."""
    if block.binary:
        ids = np.frombuffer(raw, dtype=_packed(block))["node"].astype(np.int64)
        return ids, ids > 0
    table = to_characters(raw, block.record_bytes)
    ids, fine = integers(table[:, 3 : 3 + block.id_width])
    mark = b" -1"
    for start, _, line_feed in _lines(block):
        head = table[:, start - block.id_width - 3 : start - block.id_width]
        fine &= (head == np.frombuffer(mark, np.uint8)).all(axis=1)
        fine &= table[:, line_feed] == ord("\n")
        mark = b" -2"  # on every line but the first
    return ids, fine


def _values(file: ByteFile, block: FrdBlock, raw: bytes) -> FloatArray:
    if block.binary:
        table = np.frombuffer(raw, dtype=_packed(block))
        packed: FloatArray = table["values"].astype(np.float64)
        return packed
    characters = to_characters(raw, block.record_bytes)
    fields = [
        characters[:, start:end].reshape(len(characters), -1, FIELD)
        for start, end, _ in _lines(block)
    ]
    try:
        return floats(np.concatenate(fields, axis=1))
    except ValueError as error:
        raise ResultError(f"{block}: {error}", file.path) from error


def _packed(block: FrdBlock) -> np.dtype[np.void]:
    number_type = "<f4" if block.flag == 2 else "<f8"
    return np.dtype([("node", "<i4"), ("values", number_type, (len(block.components),))])


def _lines(block: FrdBlock) -> Iterator[tuple[int, int, int]]:
    """Yield, for each line of a record, where values start, end, and its LF is."""
    at = 0
    for first in range(0, len(block.components), VALUES_A_LINE):
        start = at + 3 + block.id_width
        end = start + FIELD * min(VALUES_A_LINE, len(block.components) - first)
        at = end + block.line_end
        yield start, end, at - 1
