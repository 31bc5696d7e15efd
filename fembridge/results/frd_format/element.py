"""The elements of a ``.frd``, as arrays: runs of one type and one layout.

 -1         1    9    0    1
 -2         1         2         9         8

Elements of one type stand together, and then their records have one length: the
first of a run is measured, the rest is taken as a table as far as it fits. So any
mix of types is read, the usual one fast. Nodes are in the order of the file:
corners, then mid-sides; he20 and pe15 have the mid-sides of the bottom, the ones
between, and then those of the top (deck nodes 1-12, 17-20, 13-16; 1-9, 13-15, 10-12).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.byte_file import CHUNK_BYTES, ByteFile
from fembridge.results.frd_format.decimals import ID_WIDTH, whole_numbers
from fembridge.results.frd_format.fixed_text import integers
from fembridge.typing import BoolArray, IntArray

# Nodes of each element type: he8 pe6 te4 he20 pe15 te10 tr3 tr6 qu4 qu8 be2 be3.
NODES_OF_TYPE = {
    1: 8, 2: 6, 3: 4, 4: 20, 5: 15, 6: 10, 7: 3, 8: 6, 9: 4, 10: 8, 11: 2, 12: 3,
}  # fmt: skip
UNKNOWN_MATERIAL = -1  # an old file has a word in place of the number
_HEAD_WORDS = 4  # id, type, 0, material
_TYPE_WIDTH = 5
_MARK = 3
_FIRST_LOOK = 16  # rows; the next look is at four times as many
_LONGEST = 4096  # bytes of one element's lines


@dataclass(frozen=True, slots=True, eq=False)
class ElementRows:
    """Elements of one type: `ids` and `material` ``(M,)``, `corners` ``(M, k)``."""

    type: int
    ids: IntArray
    material: IntArray
    corners: IntArray


def packed_elements(file: ByteFile, offset: int, records: int) -> Iterator[tuple[ElementRows, int]]:
    """Yield packed elements, and the offset behind them.

    Raises
    ------
    ResultError
        A type is unknown, or the file ends before all `records`.
    """
    at, done = offset, 0
    while done < records:
        kind = int.from_bytes(file.peek(at + 4, 4), "little")
        if len(file.peek(at, 8)) < 8:
            raise ResultError(f"cut: {records} elements announced", file.path)
        if kind not in NODES_OF_TYPE:
            raise ResultError(f"element type {kind} at byte {at} is unknown", file.path)
        width = 4 * (_HEAD_WORDS + NODES_OF_TYPE[kind])
        if at + width > file.size:
            raise ResultError(f"cut: {records} elements announced", file.path)
        look = _FIRST_LOOK
        while done < records and at + width <= file.size:
            some = min(look, records - done, max(1, CHUNK_BYTES // width))
            some = min(some, (file.size - at) // width)
            words = np.frombuffer(file.take(at, some * width), "<i4").reshape(some, -1)
            same = _leading(words[:, 1] == kind)
            if same:
                rows = words[:same].astype(np.int64)
                at, done = at + same * width, done + same
                yield ElementRows(kind, rows[:, 0], rows[:, 3], rows[:, 4:]), at
            if same < some:
                break
            look *= 4


def printed_elements(file: ByteFile, offset: int, end: int, id_width: int) -> Iterator[ElementRows]:
    """Yield the elements whose lines stand from `offset` to the line `` -3``.

    Raises
    ------
    ResultError
        A line is none of an element, or a number is none.
    """
    at = offset
    while at < end:
        text = file.take(at, min(CHUNK_BYTES, end - at))
        last = at + len(text) == end
        place = 0
        while not text.startswith(b" -3", place):
            layout = _layout(text, place, id_width, last)
            if layout is None:
                break
            run = _run(text, place, layout, id_width)
            yield _rows(text, place, run, layout, id_width, file)
            place += run * layout[-1]
        else:
            return
        if place == 0 or last:
            raise ResultError(
                f"element block: {text[place : place + 24]!r} at byte {at + place} is no element",
                file.path,
            )
        at += place


def _layout(text: bytes, place: int, id_width: int, last: bool) -> list[int] | None:
    """Give where each line of the element at `place` ends, from its beginning.

    None when they are not all in `text`, or are no lines of an element.
    """
    if not text.startswith(b" -1", place):
        return None
    ends = [text.find(b"\n", place, place + _LONGEST) + 1 - place]
    if ends[0] < _MARK + id_width + 2 * _TYPE_WIDTH:
        return None
    while text.startswith(b" -2", place + ends[-1]):
        end = text.find(b"\n", place + ends[-1], place + _LONGEST) + 1 - place
        if end <= 0:
            return None
        ends.append(end)
    if len(text) - (place + ends[-1]) < _MARK and not last:
        return None
    return ends if len(ends) > 1 else None


def _run(text: bytes, place: int, ends: list[int], id_width: int) -> int:
    """Count the elements from `place` that are laid out as the first one is."""
    width, at_type = ends[-1], _MARK + id_width
    room = (len(text) - place) // width
    starts = [0, *ends[:-1]]
    marks = [(start, b" -2" if start else b" -1") for start in starts]
    marks += [(end - 1, b"\n") for end in ends]
    first = place + at_type
    marks.append((at_type, text[first : first + _TYPE_WIDTH]))
    done, look = 1, _FIRST_LOOK
    while done < room:
        some = min(look, room - done)
        fine = np.ones(some, dtype=np.bool_)
        for start, mark in marks:
            at = place + done * width + start
            for step, character in enumerate(mark):
                column = np.ndarray((some,), np.uint8, text, at + step, (width,))
                fine &= column == character
        same = _leading(fine)
        done += same
        if same < some:
            break
        look *= 4
    # What follows may hold one more line than the layout: then it is another one.
    behind = place + done * width
    if done > 1 and text.startswith(b" -2", behind):
        done -= 1
    return done


def _rows(
    text: bytes, place: int, rows: int, ends: list[int], id_width: int, file: ByteFile
) -> ElementRows:
    width, columns = ends[-1], []
    at_type = place + _MARK + id_width
    kind = text[at_type : at_type + _TYPE_WIDTH].strip()
    ids, fine = _numbers(text, rows, width, place + _MARK, id_width)
    for start, end in pairwise(ends):
        line = text[place + start : place + end].rstrip()
        for column in range((len(line) - _MARK) // id_width):
            at = place + start + _MARK + column * id_width
            found, good = _numbers(text, rows, width, at, id_width)
            columns.append(found)
            fine &= good
    if not kind.isdigit() or not columns or not fine.all():
        row = 0 if fine.all() else int(np.flatnonzero(~fine)[0])
        found_text = text[place + row * width :][:width]
        raise ResultError(f"element block: {found_text!r} is no element", file.path)
    at_material = at_type + 2 * _TYPE_WIDTH
    shape = (rows, min(_TYPE_WIDTH, ends[0] - (at_material - place)))
    material = np.full(rows, UNKNOWN_MATERIAL, dtype=np.int64)
    if shape[1] == _TYPE_WIDTH:
        field = np.ndarray(shape, np.uint8, text, at_material, (width, 1))
        value, good = integers(field)
        material[good] = value[good]
    return ElementRows(int(kind), ids, material, np.stack(columns, axis=1))


def _numbers(
    text: bytes, rows: int, width: int, at: int, id_width: int
) -> tuple[IntArray, BoolArray]:
    if id_width == ID_WIDTH:
        return whole_numbers(text, rows, width, at)
    return integers(np.ndarray((rows, id_width), np.uint8, text, at, (width, 1)))


def _leading(fine: BoolArray) -> int:
    """Count the true values before the first that is not."""
    return fine.size if fine.all() else int(np.argmin(fine))
