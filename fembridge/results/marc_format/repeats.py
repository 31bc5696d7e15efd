"""Increments that look like one before: found without walking through them.

Between the values of an increment stand names, counts and lengths of records. If
the bytes of all these are those of an increment that was walked through, at the
same distances, the increment is built alike: its records are where that one's
are. So a file of 100 000 small increments is opened by comparing arrays, and a
large increment by looking at a few places of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fembridge.results.byte_file import ByteFile
from fembridge.results.marc_format.increment import Layout
from fembridge.results.marc_format.numbers import Flow, Grid, Numbers
from fembridge.typing import FloatArray, IntArray

_CHUNK_BYTES = 1 << 22  # of increments compared at once
_SMALL_BYTES = 1 << 18  # an increment up to so many is read as a whole
_GAP_BYTES = 1 << 12  # nearer places are looked at together
_MOST_BYTES = 1 << 20  # compared in one increment; more is walked through
_KEPT = 4  # layouts: with and without element values, say


@dataclass(frozen=True, slots=True, eq=False)
class Alike:
    """Increments of one layout, one after the other, `length` bytes each.

    `integers` ``(K, 12)`` and `reals` ``(K, 2)`` are the beginnings of their
    verification data, `titles` their raw titles.
    """

    layout: Layout
    length: int
    integers: IntArray
    reals: FloatArray
    titles: Sequence[bytes]


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """`length` bytes at `offset`, of which those at `places` are `expected`."""

    offset: int
    length: int
    places: NDArray[np.intp]
    expected: NDArray[np.uint8]

    def alike(self, raw: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Tell which of the rows of `raw` ``(K, length)`` are as expected."""
        same: NDArray[np.bool_] = (raw[:, self.places] == self.expected).all(axis=1)
        return same


@dataclass(frozen=True, slots=True, eq=False)
class _Template:
    layout: Layout
    length: int
    parts: tuple[_Part, ...]
    integers: Grid
    reals: Grid
    title: tuple[int, int]


class Repeats:
    """The layouts met so far in `file`."""

    def __init__(self, file: ByteFile) -> None:
        self._file = file
        self._known: list[_Template] = []
        self._at_once = 1

    def add(self, layout: Layout, end: int, free: Sequence[tuple[int, int]]) -> None:
        """Take an increment that ends before byte `end`, its values at `free`."""
        template = _template(self._file, layout, end, free)
        if template is not None:
            self._known.insert(0, template)
            del self._known[_KEPT:]

    def forget(self) -> None:
        """Take no layout any more for granted: the model is another one."""
        self._known.clear()

    def find(self, at: int) -> Alike | None:
        """Give the increments from byte `at` that look like one before."""
        for place, template in enumerate(self._known):
            found = self._match(template, at)
            if found is not None:
                self._known.insert(0, self._known.pop(place))
                self._at_once = min(2 * self._at_once, _CHUNK_BYTES)
                return found
        self._at_once = 1
        return None

    def _match(self, template: _Template, at: int) -> Alike | None:
        whole = (self._file.size - at) // template.length
        count = max(1, min(self._at_once, _CHUNK_BYTES // template.length))
        if whole == 0:
            return None
        if len(template.parts) > 1:
            count = 1
        count = min(count, whole)
        first = self._rows(template.parts[0], at, count)
        alike = template.parts[0].alike(first)
        count = count if alike.all() else int(np.argmin(alike))
        if count == 0:
            return None
        for part in template.parts[1:]:
            if not part.alike(self._rows(part, at, 1)).all():
                return None
        first = first[:count]
        try:
            integers = template.integers.decode(_cut(first, template.integers))
            reals = template.reals.decode(_cut(first, template.reals))
        except ValueError:
            return None  # the walk will say what is wrong
        title = first[:, slice(*template.title)]
        return Alike(
            template.layout,
            template.length,
            integers,
            reals[:, :2],
            [row.tobytes() for row in title],
        )

    def _rows(self, part: _Part, at: int, count: int) -> NDArray[np.uint8]:
        raw = self._file.take(at + part.offset, part.length * count)
        return np.frombuffer(raw, dtype=np.uint8).reshape(count, part.length)


def _template(
    file: ByteFile, layout: Layout, end: int, free: Sequence[tuple[int, int]]
) -> _Template | None:
    start, length = layout.start, end - layout.start
    spans = _between(free, start, end)
    integers, reals = _first_row(layout.integers), _first_row(layout.reals)
    if sum(last - first for first, last in spans) > _MOST_BYTES:
        return None
    if integers is None or reals is None or layout.title is None:
        return None
    groups = [spans] if length <= _SMALL_BYTES else _near(spans)
    parts = []
    for group in groups:
        first, last = group[0][0], group[-1][1]
        if len(groups) == 1:
            first, last = start, end
        places = np.concatenate([np.arange(*span) for span in group]) - first
        raw = np.frombuffer(file.take(first, last - first), dtype=np.uint8)
        parts.append(_Part(first - start, last - first, places, raw[places]))
    head = start + parts[0].length
    for stop in (layout.title[1], *(grid.start + grid.stride for grid in (integers, reals))):
        if stop > head:
            return None
    title = layout.title[0] - start, layout.title[1] - start
    return _Template(
        layout, length, tuple(parts), integers.shifted(-start), reals.shifted(-start), title
    )


def _between(free: Sequence[tuple[int, int]], start: int, end: int) -> list[tuple[int, int]]:
    """Give what of `start` to `end` is not in `free`."""
    spans, at = [], start
    for first, last in sorted(free):
        if first > at:
            spans.append((at, first))
        at = max(at, last)
    return [*spans, (at, end)]


def _near(spans: Sequence[tuple[int, int]]) -> list[list[tuple[int, int]]]:
    """Group spans that are near each other."""
    groups = [[spans[0]]]
    for span in spans[1:]:
        if span[0] - groups[-1][-1][1] <= _GAP_BYTES:
            groups[-1].append(span)
        else:
            groups.append([span])
    return groups


def _first_row(numbers: Numbers | None) -> Grid | None:
    if isinstance(numbers, Flow):
        return numbers.lines if numbers.lines.rows else None
    return numbers if isinstance(numbers, Grid) else None


def _cut(raw: NDArray[np.uint8], grid: Grid) -> NDArray[np.uint8]:
    return raw[:, grid.start : grid.start + grid.stride]
