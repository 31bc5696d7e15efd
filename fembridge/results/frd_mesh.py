"""The node and element blocks of a ``.frd``: where they end, which materials meet.

A stress at a node of a ``.frd`` is the mean over all elements there, whatever
their material: on a layer boundary it belongs to neither layer. The element
block tells the material of each element, so the reader can see the boundary.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.byte_file import CHUNK_BYTES, ByteFile
from fembridge.results.fixed_text import integers
from fembridge.typing import IntArray

# Nodes of each element type: he8 pe6 te4 he20 pe15 te10 tr3 tr6 qu4 qu8 be2 be3.
NODES_OF_TYPE = {
    1: 8, 2: 6, 3: 4, 4: 20, 5: 15, 6: 10, 7: 3, 8: 6, 9: 4, 10: 8, 11: 2, 12: 3,
}  # fmt: skip
UNKNOWN_MATERIAL = -1
_IDS_A_LINE = 10
_HEAD = 4  # id, type, 0, material
_CHUNK_BYTES = 4 * CHUNK_BYTES


@dataclass(frozen=True, slots=True)
class MeshBlock:
    """Where a node or element block begins and ends.

    `records` is None where the header leaves the count blank. `type` is the
    element type when all elements of a binary block share it.
    """

    records: int | None
    flag: int
    offset: int
    end: int
    type: int | None = None

    @property
    def binary(self) -> bool:
        """Whether the records are packed numbers."""
        return self.flag >= 2


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
    end, only_type = _binary_elements_end(file, offset, records)
    return MeshBlock(records, flag, offset, end, only_type)


def materials_at(
    file: ByteFile, elements: MeshBlock, nodes: Collection[int]
) -> dict[int, set[int]]:
    """Give the material numbers of the elements at each of `nodes`."""
    wanted = np.unique(np.fromiter(nodes, dtype=np.int64))
    materials: dict[int, set[int]] = {int(node): set() for node in wanted}
    parts = _binary_parts if elements.binary else _text_parts
    for corners, material in parts(file, elements):
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


def _binary_elements_end(
    file: ByteFile, offset: int, records: int
) -> tuple[int, int | None]:
    """Give the end, and the type if it is the same throughout."""
    if records == 0:
        return offset, None
    if offset + 4 * (_HEAD + 2) * records > file.size:
        raise ResultError(f"cut: {records} elements announced", file.path)
    first = _element_type(file, offset)
    width = 4 * (_HEAD + NODES_OF_TYPE[first])
    done, rows = 0, _CHUNK_BYTES // width
    while done < records and offset + width * records <= file.size:
        some = min(rows, records - done)
        words = np.frombuffer(file.take(offset + done * width, some * width), "<i4")
        if (words.reshape(some, -1)[:, 1] != first).any():
            break
        done += some
    if done == records:
        return offset + width * records, first
    starts = _element_starts(file, offset, records)
    return offset + 4 * starts[-1], None


def _element_starts(file: ByteFile, offset: int, records: int) -> list[int]:
    """Word at which each element starts, and where the last one ends."""
    room = min(records * 4 * (_HEAD + 20), (file.size - offset) // 4 * 4)
    words = memoryview(file.take(offset, room)).cast("i")
    starts = [0]
    for _ in range(records):
        at = starts[-1]
        nodes = NODES_OF_TYPE.get(words[at + 1]) if at + _HEAD < len(words) else 0
        if nodes is None:
            raise ResultError(
                f"element type {words[at + 1]} at byte {offset + 4 * at} is unknown",
                file.path,
            )
        if nodes == 0 or at + _HEAD + nodes > len(words):
            raise ResultError(f"cut: {records} elements announced", file.path)
        starts.append(at + _HEAD + nodes)
    return starts


def _element_type(file: ByteFile, at: int) -> int:
    word = int.from_bytes(file.peek(at + 4, 4), "little")
    if word not in NODES_OF_TYPE:
        raise ResultError(f"element type {word} at byte {at} is unknown", file.path)
    return word


def _binary_parts(
    file: ByteFile, elements: MeshBlock
) -> Iterator[tuple[IntArray, IntArray]]:
    """Yield nodes and, beside each, the material of its element."""
    if elements.type is not None:
        nodes = NODES_OF_TYPE[elements.type]
        width = 4 * (_HEAD + nodes)
        step = max(1, _CHUNK_BYTES // width) * width
        for at in range(elements.offset, elements.end, step):
            raw = file.take(at, min(step, elements.end - at))
            words = np.frombuffer(raw, "<i4").reshape(-1, _HEAD + nodes)
            corners = words[:, _HEAD:].astype(np.int64).ravel()
            yield corners, np.repeat(words[:, 3].astype(np.int64), nodes)
        return
    starts = np.array(
        _element_starts(file, elements.offset, elements.records or 0), dtype=np.int64
    )
    words = np.frombuffer(file.take(elements.offset, 4 * int(starts[-1])), "<i4")
    for nodes in np.unique(np.diff(starts)) - _HEAD:
        at = starts[:-1][np.diff(starts) == _HEAD + nodes]
        corners = words[at[:, None] + np.arange(_HEAD, _HEAD + nodes)]
        material = np.repeat(words[at + 3].astype(np.int64), nodes)
        yield corners.astype(np.int64).ravel(), material


def _text_parts(
    file: ByteFile, elements: MeshBlock
) -> Iterator[tuple[IntArray, IntArray]]:
    at = elements.offset
    while at < elements.end:
        text = file.peek(at, min(_CHUNK_BYTES, elements.end - at))
        if at + len(text) < elements.end:
            text = text[: text.rfind(b"\n -1") + 1]  # whole elements only
            if not text:
                raise ResultError(f"element without end at byte {at}", file.path)
        yield from _text_columns(text, 5 if elements.flag == 0 else 10)
        at += len(text)


def _text_columns(text: bytes, width: int) -> Iterator[tuple[IntArray, IntArray]]:
    """Read `text` column by column, so that any mix of types is one speed."""
    characters = np.frombuffer(text + b" " * 128, dtype=np.uint8)
    ends = np.flatnonzero(characters == ord("\n"))
    starts = np.concatenate([[0], ends[:-1] + 1])
    heads = characters[starts + 2] == ord("1")
    tails = characters[starts + 2] == ord("2")
    at_material = starts[heads] + 3 + width + 10  # id, type, 0, then I5
    material, fine = integers(characters[at_material[:, None] + np.arange(5)])
    material[~fine] = UNKNOWN_MATERIAL  # an old file has a word there
    element_of_line = np.cumsum(heads) - 1
    tail_starts, tail_ends = starts[tails], ends[tails]
    tail_material = material[np.maximum(element_of_line[tails], 0)]
    for column in range(_IDS_A_LINE if width == 10 else 15):
        at = tail_starts + 3 + column * width
        full = at + width <= tail_ends
        ids, fine = integers(characters[at[full, None] + np.arange(width)])
        yield ids[fine], tail_material[full][fine]
