"""Formatted post files: lines of text, six numbers of 13 characters each.

Every record begins on a new line, and a program writes all records of a table
alike: their first one tells how long they are, line end and trailing blanks
included. Where that does not lead to where the table ends the lines are counted.
"""

from collections.abc import Sequence

import numpy as np

from fembridge.results.byte_file import CHUNK_BYTES, ByteFile
from fembridge.results.marc_format.irregular_numbers import Ragged
from fembridge.results.marc_format.number_format import (
    FIELD_CHARACTERS,
    FIELDS_A_LINE,
    INTEGER_TEXT,
    REAL_TEXT,
    NumberFormat,
)
from fembridge.results.marc_format.numbers import Flow, Grid, Numbers, Run
from fembridge.results.marc_format.records import BEGIN, END, MARKS, PostDamageError

_LINE_END = b"\n"


class FormattedRecords:
    """The records of a formatted file."""

    kind = "t19"
    byte_order = "little"  # it has none
    real_bytes = 4

    def __init__(self, file: ByteFile) -> None:
        self.file = file
        self.at = 0
        self.free: list[tuple[int, int]] = []

    def word(self) -> str:
        """Give the word that stands here; "" if none does, or the file ends."""
        found = self.file.line(self.at)
        while found is not None and not found[0].strip():
            self.at = found[1]
            found = self.file.line(self.at)
        line = found[0] if found else self.file.peek(self.at, 80)
        text = line.decode("latin-1").rstrip()
        known = text in MARKS or text == END or text.startswith(BEGIN)
        return text if known else ""

    def pass_word(self) -> None:
        """Go behind the word that stands here."""
        found = self.file.line(self.at)
        self.at = found[1] if found else self.file.size  # no end behind the last word

    def text(self, free: bool = False) -> str:
        """Read a record of text, without blanks at its ends."""
        start = self.at
        line = self._line()
        if free:
            self.free.append((start, start + len(line)))
        return line.decode("latin-1").strip()

    def text_of(self, raw: bytes) -> str:
        """Give the text of a whole record that is in memory."""
        return raw.decode("latin-1").strip()

    def label(self) -> tuple[list[int], str]:
        """Read a record of integers and a text: an element post code."""
        start, line = self.at, self._line()
        numbers = [self._integer(line[:FIELD_CHARACTERS], start)]
        rest = line[FIELD_CHARACTERS:]
        second = rest[:FIELD_CHARACTERS]
        if len(second) == FIELD_CHARACTERS and second.strip().isdigit():
            numbers.append(int(second))
            rest = rest[FIELD_CHARACTERS:]
        return numbers, rest.decode("latin-1").strip()

    def integers(self, count: int | None = None, free: bool = False) -> list[int]:
        """Read a record of `count` integers; None takes what is there."""
        if count is not None:
            self._must_hold(count)
        numbers: list[int] = []
        while len(numbers) != count and not (count is None and self.word()):
            start, line = self.at, self._line()
            if free:
                self.free.append((start, start + len(line)))
            line = line.rstrip()
            fields = len(line) // FIELD_CHARACTERS
            if count is not None:
                fields = min(FIELDS_A_LINE, count - len(numbers))
            if len(line) != fields * FIELD_CHARACTERS:
                raise PostDamageError(f"{line[:80]!r} where {fields} integers are expected", start)
            for first in range(0, len(line), FIELD_CHARACTERS):
                field = line[first : first + FIELD_CHARACTERS]
                numbers.append(self._integer(field, start))
        return numbers

    def verification(self, first: int, second: int) -> list[int]:
        """Read `first` and `second` integers; text does not part them."""
        return self.integers(first + second)

    def table(self, rows: int, integers: int, reals: int) -> tuple[Numbers | None, Numbers | None]:
        """Pass `rows` records alike: `integers`, then `reals`; None for none."""
        fields = integers + reals
        if rows == 0 or fields == 0:
            return None, None
        start = self.at
        self._must_hold(rows * fields)
        lines = self._one_record(fields)
        stride = lines[-1] - start
        fixed = tuple((after - 1 - start, _LINE_END) for after in lines)
        self.at = start + rows * stride
        last = self.at - stride
        regular = self.at <= self.file.size and all(
            self.file.holds(last + offset, text) for offset, text in fixed
        )
        regular = regular and (rows == 1 or self.word() == END)
        if not regular:
            self.at = self._behind_lines(start, rows * len(lines))
        self.free.append((start, self.at - 1))

        def part(first: int, count: int, form: NumberFormat) -> Numbers | None:
            if not count:
                return None
            if not regular:
                return Ragged(start, rows, fields, first, count, form, rows)
            runs = _runs(first, count, [0, *(after - start for after in lines)])
            return Grid(start, rows, stride, runs, form, fixed)

        return part(0, integers, INTEGER_TEXT), part(integers, reals, REAL_TEXT)

    def flow(self, rows: int, columns: int) -> Numbers:
        """Pass one record of `rows` times `columns` reals."""
        start, count = self.at, rows * columns
        self._must_hold(count)
        if count == 0:
            self.empty()
            return Flow(rows, columns, _lines(start, 0, 1, 0), None)
        full, rest = divmod(count, FIELDS_A_LINE)
        stride = self._one_record(min(count, FIELDS_A_LINE))[-1] - start
        grid = _lines(start, full, stride, FIELDS_A_LINE)
        last, tail = start + full * stride, None
        regular = last <= self.file.size and (full == 0 or self.file.holds(last - 1, _LINE_END))
        self.at = last
        if regular and rest:
            self.at = self._one_record(rest)[-1]
            tail = _lines(last, 1, self.at - last, rest)
        if not regular:
            self.at = self._behind_lines(start, full + (rest > 0))
        self.free.append((start, self.at - 1))
        if regular:
            return Flow(rows, columns, grid, tail)
        return Ragged(start, 1, count, 0, count, REAL_TEXT, rows)

    def empty(self) -> None:
        """Pass a record of nothing, if one stands here."""
        found = self.file.line(self.at)
        if found is not None and not found[0].strip():
            self.at = found[1]

    def pass_block(self) -> None:
        """Go to the ``=end=`` of the block that we are in."""
        start = self.at
        if self.word() == END:
            return
        found = self.file.find((b"\n" + END.encode(), b"\n" + BEGIN.encode()), self.at)
        if found is None:
            raise PostDamageError("cut: no =end= follows", self.file.size)
        self.at = found[0] + 1
        if self.word() != END:
            raise PostDamageError(f"{self.word()!r} before the block's =end=", self.at)
        self.free.append((start, self.at - 1))

    def _line(self) -> bytes:
        found = self.file.line(self.at)
        if found is None:
            raise PostDamageError(self.file.why_no_line(self.at), self.at)
        line, self.at = found
        return line

    def _integer(self, field: bytes, at: int) -> int:
        text = field.strip()
        if not (text.removeprefix(b"-").isdigit()):
            raise PostDamageError(f"{field!r} where an integer is expected", at)
        return int(text)

    def _must_hold(self, fields: int) -> None:
        if fields * FIELD_CHARACTERS > self.file.size - self.at:
            raise PostDamageError(
                f"cut: {fields} numbers expected from byte {self.at} and the file ends "
                f"at byte {self.file.size}",
                self.file.size,
            )

    def _one_record(self, fields: int) -> list[int]:
        """Pass one record of `fields`; give where each of its lines ends."""
        ends = []
        for first in range(0, fields, FIELDS_A_LINE):
            start, line = self.at, self._line()
            wanted = min(FIELDS_A_LINE, fields - first) * FIELD_CHARACTERS
            if len(line) < wanted or line[wanted:].strip():
                raise PostDamageError(
                    f"{line[:80]!r} where {wanted // FIELD_CHARACTERS} numbers of "
                    f"{FIELD_CHARACTERS} characters are expected",
                    start,
                )
            ends.append(self.at)
        return ends

    def _behind_lines(self, start: int, lines: int) -> int:
        """Give the byte after `lines` lines, within the block."""
        found = self.file.find((b"\n" + END.encode(),), start)
        end = self.file.size if found is None else found[0] + 1
        present, at = 0, start
        while at < end:
            chunk = self.file.peek(at, min(CHUNK_BYTES, end - at))
            places = np.flatnonzero(np.frombuffer(chunk, dtype=np.uint8) == ord("\n"))
            if present + places.size >= lines:
                return at + int(places[lines - present - 1]) + 1
            present += places.size
            at += len(chunk)
        word = "cut" if found is None else "the block ends"
        raise PostDamageError(f"{word} after {present} of {lines} lines", end)


def _lines(start: int, rows: int, stride: int, fields: int) -> Grid:
    fixed = ((stride - 1, _LINE_END),)
    return Grid(start, rows, stride, (Run(0, fields),), REAL_TEXT, fixed)


def _runs(first: int, count: int, starts: Sequence[int]) -> tuple[Run, ...]:
    """Give the stretches of fields `first` to `first + count`, line by line."""
    runs = []
    while count:
        line, column = divmod(first, FIELDS_A_LINE)
        here = min(count, FIELDS_A_LINE - column)
        runs.append(Run(starts[line] + column * FIELD_CHARACTERS, here))
        first, count = first + here, count - here
    return tuple(runs)
