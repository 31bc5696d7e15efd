"""The rows of a CSV table: cells by column, each with the line it stands on.

A header comes first. Columns may stand in any order and others beside them; blanks
around a cell are cut off, rows without any text are left out.
"""

import csv
import io
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from fembridge.errors import TableError

_UTF_16 = (b"\xff\xfe", b"\xfe\xff")
_ZIP = b"PK\x03\x04"

_Value = TypeVar("_Value")


@dataclass(frozen=True, slots=True)
class Row:
    """One line of a table, its cells by column."""

    path: Path
    line: int
    cells: Mapping[str, str]

    def error(self, problem: str) -> TableError:
        """Make the error that names this line."""
        return TableError(problem, self.path, self.line)

    def text(self, column: str) -> str:
        """Give a cell that must not be empty."""
        if not self.cells[column]:
            raise self.error(f"{column} is empty")
        return self.cells[column]

    def choice(self, column: str, choices: Sequence[str]) -> str:
        """Give a cell that must be one of `choices`."""
        word = self.cells[column]
        if word not in choices:
            raise self.error(f"{column} is {word!r}, expected one of {', '.join(choices)}")
        return word

    def number(self, column: str, least: float = -math.inf) -> float:
        """Give a finite number, `least` or more."""
        number = self._converted(column, float, "a number")
        if not math.isfinite(number):
            raise self.error(f"{column} is {number}, expected a finite number")
        if number < least:
            raise self.error(f"{column} is {number:g}, expected >= {least:g}")
        return number

    def whole(self, column: str, least: int) -> int:
        """Give a whole number, `least` or more."""
        number = self._converted(column, int, "a whole number")
        if number < least:
            raise self.error(f"{column} is {number}, expected {least} or more")
        return number

    def _converted(self, column: str, convert: Callable[[str], _Value], kind: str) -> _Value:
        cell = self.cells[column]
        try:
            if "_" in cell:  # Python's digit groups, nobody else's
                raise ValueError
            return convert(cell)
        except ValueError:
            raise self.error(f"{column} is {cell!r}, expected {kind}") from None


def read_rows(path: Path, columns: Sequence[str]) -> Iterator[Row]:
    """Give the rows of the file `path`, which must have `columns`.

    Raises
    ------
    TableError
        No CSV table in UTF-8, a column that is missing or stands there twice, or a
        row of another length than the header.
    """
    return rows_of(decoded(read_content(path), path), path, columns)


def read_content(path: Path) -> bytes:
    """Read the bytes of a table.

    Raises
    ------
    TableError
        The file is not there or cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise TableError(f"cannot read: {error.strerror}", path) from error


def decoded(content: bytes, path: Path) -> str:
    """Decode the bytes of a table, with or without a byte order mark.

    Raises
    ------
    TableError
        They are not UTF-8.
    """
    if content.startswith(_UTF_16):
        raise TableError("the text is UTF-16, expected UTF-8", path)
    if content.startswith(_ZIP):
        raise TableError("a spreadsheet or another ZIP archive, expected a CSV table", path)
    if b"\0" in content:
        raise TableError("a binary file, expected a CSV table", path)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        found = f"byte 0x{content[error.start]:02x}"
        raise TableError(f"{found} is not UTF-8", path, line) from error


def header_of(text: str, path: Path, columns: Sequence[str]) -> list[str]:
    """Give the names on the first line of a table that should have `columns`.

    Raises
    ------
    TableError
        There is none, or it is not CSV.
    """
    table = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        header = [name.strip() for name in next(table, [])]
    except csv.Error as error:
        raise TableError(f"not CSV: {error}", path, table.line_num) from error
    if not header:
        raise TableError(f"empty, {_expected(columns)}", path)
    return header


def rows_of(text: str, path: Path, columns: Sequence[str]) -> Iterator[Row]:
    """Give the rows of a table that has been read: see :func:`read_rows`."""
    header = header_of(text, path, columns)
    missing = [name for name in columns if name not in header]
    if missing:
        raise TableError(
            f"no column {', '.join(missing)} in {','.join(header)!r}, {_expected(columns)}", path, 1
        )
    twice = [name for name in columns if header.count(name) > 1]
    if twice:
        raise TableError(f"column {twice[0]} stands there twice", path, 1)
    table = csv.reader(io.StringIO(text, newline=""), strict=True)
    next(table)
    try:
        for cells in table:
            if not any(cell.strip() for cell in cells):
                continue
            if len(cells) != len(header):
                raise TableError(
                    f"{len(cells)} cells, expected {len(header)} as in the header"
                    f"{_comma_note(cells, len(header))}",
                    path,
                    table.line_num,
                )
            stripped = (cell.strip() for cell in cells)
            yield Row(path, table.line_num, dict(zip(header, stripped, strict=True)))
    except csv.Error as error:
        raise TableError(f"not CSV: {error}", path, table.line_num) from error


def _expected(columns: Sequence[str]) -> str:
    return f"expected a header with {','.join(columns)}"


def _comma_note(cells: Sequence[str], expected: int) -> str:
    """Tell where one cell too many looks like the decimals of the one before."""
    whole, decimals = cells[-2:] if len(cells) == expected + 1 else ("", "")
    if not (whole.strip().isdecimal() and decimals.strip().isdecimal()):
        return ""
    return f"; '{whole},{decimals}' looks like a decimal comma, expected a point"
