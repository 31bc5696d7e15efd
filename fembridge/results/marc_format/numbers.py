"""Where numbers lie in a post file, and how to read some of them.

A block is not read when it is passed: what is kept is where its numbers are. All
rows of a `Grid` are of one length, so that a row is found by multiplication;
`Ragged` text and `Split` records, which no file seen so far has, are read from
their beginning.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from fembridge.errors import ResultError
from fembridge.results.byte_file import ByteFile
from fembridge.results.marc_format.number_format import FIELDS_A_LINE, NumberFormat
from fembridge.typing import IntArray

_READ_BYTES = 1 << 22  # at once
_GAP_BYTES = 1 << 12  # rows nearer than that are read together


class Numbers(Protocol):
    """Rows of numbers in a file: ``(rows, columns)``."""

    @property
    def rows(self) -> int:
        """How many rows there are."""

    def values(
        self, file: ByteFile, rows: IntArray | None = None, further: int = 0
    ) -> NDArray[Any]:
        """Read `rows` in their order, or all, `further` bytes on in the file.

        Returns
        -------
        ndarray
            int64 or float64, ``(K, columns)``.

        Raises
        ------
        ResultError
            A number cannot be read, or the file has not so many bytes.
        """


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """`columns` fields side by side, from byte `offset` of a row."""

    offset: int
    columns: int


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """`rows` of `stride` bytes from byte `start`; every row holds all of `fixed`."""

    start: int
    rows: int
    stride: int
    runs: tuple[Run, ...]
    form: NumberFormat
    fixed: tuple[tuple[int, bytes], ...] = ()

    @property
    def columns(self) -> int:
        """Numbers in a row."""
        return sum(run.columns for run in self.runs)

    def shifted(self, bytes_on: int) -> "Grid":
        """Give the same grid `bytes_on` bytes further into the file."""
        return replace(self, start=self.start + bytes_on)

    def values(
        self, file: ByteFile, rows: IntArray | None = None, further: int = 0
    ) -> NDArray[Any]:
        """Read `rows` in their order, or all, `further` bytes on in the file."""
        if rows is None:
            found = np.empty((self.rows, self.columns), dtype=self._dtype)
            for first, last in self._stretches(0, self.rows):
                found[first:last] = self._take(file, first, last, further, None)
            return found
        if not rows.size:
            return np.empty((0, self.columns), dtype=self._dtype)
        lowest, highest = int(rows.min()), int(rows.max())
        if lowest < 0 or highest >= self.rows:
            raise IndexError(f"rows {lowest} to {highest} of {self.rows}")
        if (highest - lowest) * self.stride <= _GAP_BYTES:
            return self._take(file, lowest, highest + 1, further, rows)
        wanted, back = np.unique(rows, return_inverse=True)
        found = np.empty((wanted.size, self.columns), dtype=self._dtype)
        breaks = np.flatnonzero(np.diff(wanted) * self.stride > _GAP_BYTES) + 1
        for near in np.split(np.arange(wanted.size), breaks):
            of = wanted[near]
            for first, last in self._stretches(int(of[0]), int(of[-1]) + 1):
                inside = near[(of >= first) & (of < last)]
                if inside.size:
                    some = wanted[inside]
                    found[inside] = self._take(file, first, last, further, some)
        return found[back]

    def decode(self, raw: NDArray[np.uint8]) -> NDArray[Any]:
        """Read rows that are in memory, ``(K, stride)``.

        Raises
        ------
        ValueError
            A row is not of this layout, or a field is no number.
        """
        for offset, expected in self.fixed:
            found = raw[:, offset : offset + len(expected)]
            odd = (found != np.frombuffer(expected, dtype=np.uint8)).any(axis=1)
            if odd.any():
                raise ValueError(f"{found[odd][0].tobytes()!r} where {expected!r} is expected")
        parts = [
            self.form.decode(raw[:, run.offset : run.offset + run.columns * self.form.width])
            for run in self.runs
            if run.columns
        ]
        if len(parts) == 1:
            return parts[0]
        if not parts:
            return np.empty((len(raw), 0), dtype=self._dtype)
        return np.concatenate(parts, axis=1)

    @property
    def _dtype(self) -> type[np.int64] | type[np.float64]:
        return np.int64 if self.form.integer else np.float64

    def _stretches(self, first: int, last: int) -> Iterator[tuple[int, int]]:
        step = max(1, _READ_BYTES // max(1, self.stride))
        for row in range(first, last, step):
            yield row, min(last, row + step)

    def _take(
        self, file: ByteFile, first: int, last: int, further: int, some: IntArray | None
    ) -> NDArray[Any]:
        """Read from row `first` to `last`; give `some` of them, or all."""
        at = self.start + further + first * self.stride
        raw = file.take(at, (last - first) * self.stride)
        rows = np.frombuffer(raw, dtype=np.uint8).reshape(last - first, self.stride)
        try:
            return self.decode(rows if some is None else rows[some - first])
        except ValueError as error:
            raise ResultError(
                f"bytes {at} to {at + len(raw)} cannot be read: {error}", file.path
            ) from error


@dataclass(frozen=True, slots=True, eq=False)
class Flow:
    """Rows of `columns` that fill lines of six without regard to rows.

    `lines` are the full ones, `last` is the one that is not, if there is one.
    """

    rows: int
    columns: int
    lines: Grid
    last: Grid | None

    def values(
        self, file: ByteFile, rows: IntArray | None = None, further: int = 0
    ) -> NDArray[Any]:
        """Read `rows` in their order, or all, `further` bytes on in the file."""
        if rows is None:
            full = self.lines.values(file, None, further).ravel()
            rest = [] if self.last is None else [self.last.values(file, None, further).ravel()]
            return np.concatenate([full, *rest]).reshape(self.rows, self.columns)
        if rows.size and (rows.min() < 0 or rows.max() >= self.rows):
            raise IndexError(f"row {rows.min()} or {rows.max()} of {self.rows}")
        place = rows[:, None] * self.columns + np.arange(self.columns)
        lines, back = np.unique(place // FIELDS_A_LINE, return_inverse=True)
        full = lines[lines < self.lines.rows]
        held = np.zeros((lines.size, FIELDS_A_LINE))
        held[: full.size] = self.lines.values(file, full, further)
        if self.last is not None and full.size < lines.size:
            held[-1, : self.last.columns] = self.last.values(file, None, further)[0]
        found: NDArray[Any] = held[back.reshape(place.shape), place % FIELDS_A_LINE]
        return found
