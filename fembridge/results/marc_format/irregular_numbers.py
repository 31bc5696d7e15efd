"""Numbers of records that are no grid: uneven lines, and records in pieces.

No file seen so far has either. Lines are uneven when a program has cut trailing
blanks or changed line ends in places; a compiler writes a record of more than
2^31 bytes in pieces. Both are read from their beginning, row by row.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fembridge.errors import ResultError
from fembridge.results.byte_file import ByteFile
from fembridge.results.marc_format.number_format import FIELDS_A_LINE, NumberFormat
from fembridge.typing import IntArray

Pieces = tuple[tuple[int, int], ...]  # (byte, length) each


@dataclass(frozen=True, slots=True, eq=False)
class Ragged:
    """Text records of `fields` fields each, lines of any length, from byte `start`.

    Of each record `taken` fields from `first` on are read; all of them together
    make `rows`.
    """

    start: int
    records: int
    fields: int
    first: int
    taken: int
    form: NumberFormat
    rows: int

    def values(
        self, file: ByteFile, rows: IntArray | None = None, further: int = 0
    ) -> NDArray[Any]:
        """Read `rows` in their order, or all, `further` bytes on in the file."""
        dtype = np.int64 if self.form.integer else np.float64
        found, at = (np.empty((self.records, self.taken), dtype=dtype), self.start + further)
        width = self.form.width
        for record in range(self.records):
            text = b""
            for first in range(0, self.fields, FIELDS_A_LINE):
                line, at = line_at(file, at)
                text += line[: min(FIELDS_A_LINE, self.fields - first) * width]
            text = text[self.first * width : (self.first + self.taken) * width]
            try:
                if len(text) < self.taken * width:
                    raise ValueError("a line is too short")
                field = np.frombuffer(text, dtype=np.uint8)[None]
                found[record] = self.form.decode(field)[0]
            except ValueError as error:
                raise ResultError(
                    f"the record before byte {at} cannot be read: {error}", file.path
                ) from error
        table = found.reshape(self.rows, -1)
        return table if rows is None else table[rows]


@dataclass(frozen=True, slots=True, eq=False)
class Split:
    """One record in pieces, (offset, length) each: rows of `columns` reals."""

    pieces: Pieces
    rows: int
    columns: int
    form: NumberFormat

    def values(
        self, file: ByteFile, rows: IntArray | None = None, further: int = 0
    ) -> NDArray[Any]:
        """Read `rows` in their order, or all, `further` bytes on in the file."""
        stride = self.columns * self.form.width
        pieces = tuple((at + further, length) for at, length in self.pieces)
        wanted = range(self.rows) if rows is None else rows.tolist()
        found = np.empty((len(wanted), self.columns))
        for place, row in enumerate(wanted):
            raw = take_pieces(file, pieces, row * stride, stride)
            found[place] = self.form.decode(np.frombuffer(raw, dtype=np.uint8)[None])
        return found


def take_pieces(file: ByteFile, pieces: Pieces, first: int, length: int) -> bytes:
    """Read `length` bytes from byte `first` of a record that is in `pieces`."""
    parts = []
    for at, size in pieces:
        if first < size and length > 0:
            count = min(size - first, length)
            parts.append(file.take(at + first, count))
            length -= count
            first = 0
        else:
            first -= size
    return b"".join(parts)


def line_at(file: ByteFile, at: int) -> tuple[bytes, int]:
    """Give the line at byte `at`, and where the next begins."""
    found = file.line(at)
    if found is None:
        raise ResultError(f"byte {at}: {file.why_no_line(at)}", file.path)
    return found
