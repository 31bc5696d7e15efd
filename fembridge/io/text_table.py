"""A CSV table as text: encoding, separator, header, size, and cells that name their line.

Rows and columns are counted before cells are parsed, so that a small file cannot fill the
memory. Every cell is read as text and converted by column, so that a `TableError` names the
line and the cell. An unknown column is refused if it may be a misspelt one and listed
otherwise. A last line without its end may be cut in its last number, which is a
`FembridgeWarning`. Columns may have any order; blanks around a cell and rows without text are
skipped.
"""

import codecs
import csv
import io
import itertools
import math
import os
import re
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fembridge.errors import FembridgeError, TableError, warn
from fembridge.host.memory import check_memory, size_text
from fembridge.host.store import (
    near_hint,
    read_bytes,
    replacing,
)
from fembridge.io.number import parse_number
from fembridge.typing import BoolArray, IntArray

if TYPE_CHECKING:
    import pandas as pd


MAX_TABLE_BYTES = 1 << 28  # whose cells are read as text
MAX_COLUMNS = 1 << 14
"""As many as a spreadsheet has. pandas takes 9 kB a column, and seconds for 100 000."""

MAX_GROUPS = 1 << 18
"""Traces or spike trains of a table: more take minutes, and no hand has as many afferents."""

NOTE_COLUMNS = ("note", "notes", "comment", "comments", "remark", "remarks", "source")
"""Columns for people, which are never misspelt ones of ours."""

# Peak of resident memory, measured in processes of their own with files of 20 MB of numbers,
# of words that are all different and of empty cells, in ASCII and not: of text at most this
# much a byte of the file and a cell, of numbers that are parsed as such this much a cell.
_TEXT_BYTES_PER_BYTE, _TEXT_BYTES_PER_CELL = 17, 12
_MOST_CELLS_PER_BYTE = 1  # each has a separator or a line end behind it
_SMALL_CELLS = 1 << 20
_BLOCK_BYTES = 1 << 20

FRAME = Path("DataFrame")
"""Path of a table that is a DataFrame."""
HEADER_BYTES = 1 << 20
_START_BYTES = 4 * HEADER_BYTES
_MOST_LINES_ABOVE = 10_000  # of a header
_LONGEST_SHOWN = 60
_NO_WHOLE = 2.0**53  # from here on a float is not every whole number
_SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars"}
_TOO_MANY_CELLS = re.compile(r"Expected (\d+) fields in line (\d+), saw (\d+)")  # pandas
_COMMENT_SIGNS = ("%", "#")
_COMMENT = re.compile(rb"^#[^\r\n]*", re.MULTILINE)
_NO_NAME = re.compile(r"Unnamed: \d+")  # pandas' of a column without
_MOST_COMPARED = 1000  # names of a header with which a missing one is compared
_IN_QUOTES = re.compile(r"EOF inside string starting at row (\d+)")


def row_groups(frame: "pd.DataFrame", keys: Sequence[Any], path: Path) -> list[IntArray]:
    """Rows of each group of equal `keys`, groups in the order in which they first appear."""
    if not keys or frame.empty:
        return [np.arange(len(frame))] if len(frame) else []
    number = frame.groupby(list(keys), sort=False, observed=True).ngroup().to_numpy()
    if number.max() >= MAX_GROUPS:
        raise TableError(
            f"{number.max() + 1} different {', '.join(map(str, keys))}, expected at most "
            f"{MAX_GROUPS}",
            path,
        )
    order = np.argsort(number, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(number[order])) + 1)


def write_table(path: Path, header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a CSV table; a float as the shortest text that brings it back."""
    with replacing(path) as draft, draft.open("w", encoding="utf-8", newline="") as out:
        table = csv.writer(out, lineterminator="\n")
        table.writerow(header)
        table.writerows(rows)


@dataclass(frozen=True, slots=True, eq=False)
class TextTable:
    """The cells of a CSV table as text; every method names the line of a bad cell.

    `header` has the names of the columns and is on line `header_line`, `cells` their text by
    number of column, or numbers and categories where they came as such, and `lines` ``(row,)``
    the line of the file on which each row ends.
    """

    path: Path
    header: tuple[str, ...]
    cells: "pd.DataFrame"
    lines: IntArray
    header_line: int = 1

    @property
    def size(self) -> int:
        """Number of rows."""
        return self.lines.size

    def where(self, mask: BoolArray) -> "TextTable":
        """The rows of `mask` ``(row,)`` alone."""
        return replace(self, cells=self.cells[mask], lines=self.lines[mask])

    def column(self, name: str) -> NDArray[Any]:
        """Text of the cells of a column ``(row,)`` without blanks around it, or its categories."""
        return self._texts(self.header.index(name))

    def _texts(self, position: int) -> NDArray[Any]:
        cells = self.cells[position]
        if cells.dtype == "category":
            return cells.array  # type: ignore[no-any-return] # as good as an array
        if cells.dtype != object:
            cells = cells.astype(object).where(cells.notna(), "").map(str)
        return cells.str.strip().to_numpy(dtype=object)

    def words(self, name: str) -> NDArray[Any]:
        """Column of cells that must not be empty."""
        cells = self.column(name)
        self._refuse_cells(cells == "", name, cells, "a text", "is empty")
        return cells

    def choices(self, name: str, choices: Sequence[str]) -> NDArray[Any]:
        """Column of cells that must be one of `choices`."""
        import pandas as pd

        cells = self.column(name)
        expected = f"one of {', '.join(filter(None, choices))}"
        self._refuse_cells(~pd.Series(cells).isin(choices).to_numpy(), name, cells, expected)
        return cells

    def numbers(
        self,
        name: str,
        least: float = -math.inf,
        kind: type[float] = float,
        factor: float = 1.0,
    ) -> NDArray[Any]:
        """Column of finite numbers of a `kind`, `least` or more, multiplied by `factor`."""
        column = self.cells[self.header.index(name)]
        typed = column.dtype.kind in "iuf"
        cells = column.to_numpy() if typed else self.column(name)
        numbers = np.asarray(cells if typed else [*map(_number, cells)], dtype=np.float64)
        good = np.isfinite(numbers) & (numbers >= least)
        if kind is int:
            good &= (numbers % 1 == 0) & (numbers < _NO_WHOLE)
        expected = "a whole number" if kind is int else "a number"
        expected += f", {least:g} or more" if least > -math.inf else ""
        self._refuse_cells(~good, name, cells, expected)
        if factor != 1.0:
            with np.errstate(over="ignore"):
                numbers = numbers * factor
            remark = f"too large by a factor of {factor:g}"
            self._refuse_cells(~np.isfinite(numbers), name, cells, expected, remark=remark)
        return numbers.astype(kind, copy=False)

    def refuse_duplicates(self, keys: "pd.DataFrame") -> None:
        """Refuse two rows of the same `keys`, a row of them for each row here."""

        def problem(row: int) -> str:
            first = int((keys == keys.iloc[row]).all(axis=1).to_numpy().argmax())
            same = cut_text(", ".join(filter(None, map(str, keys.iloc[row]))))
            return f"duplicate of line {self.lines[first]}: {same}"

        self.refuse(keys.duplicated().to_numpy(), problem)

    def refuse(self, bad: BoolArray, problem: Callable[[int], str]) -> None:
        """Refuse the table for the first row that is `bad` ``(row,)``."""
        if bad.any():
            row = int(bad.argmax())
            raise self.error(row, problem(row))

    def _refuse_cells(
        self,
        bad: BoolArray,
        name: str,
        cells: NDArray[Any],
        expected: str,
        problem: str = "",
        *,
        remark: str = "",
    ) -> None:
        """Refuse the table for the first of `cells` ``(row,)`` of a column that is `bad`."""
        if bad.any():
            row = int(bad.argmax())
            cell = cells[row]
            problem = problem or f"is {_shown(cell)}, {remark or f'expected {expected}'}"
            shown = cut_text(cell) if isinstance(cell, str) else cell
            raise self.error(row, problem, key=name, found=shown, expected=expected)

    def error(self, row: int, problem: str, **fields: Any) -> TableError:  # noqa: ANN401 - of errors
        """The error that names the line of `row`; `fields` are those of a `TableError`."""
        return TableError(problem, self.path, int(self.lines[row]), **fields)

    def unnamed(self) -> list[int]:
        """Positions of columns with content and no name; row numbers in front are none.

        Spreadsheets write empty columns at the end, pandas its index in front.
        """
        positions = []
        for position in unnamed_columns(self.header):
            cells = self._texts(position)
            texts = {str(cell) for cell in cells}
            is_index = len(texts) == len(cells) and all(map(_is_whole, texts))
            if texts - {""} and not (position == 0 and is_index):
                positions.append(position)
        return positions

    def check_header(self, columns: Sequence[str]) -> None:
        """Refuse a table that lacks one of `columns`, or has it twice; a TableError."""
        check_header(self.header, columns, self.path, self.header_line)

    def check_columns(
        self,
        columns: Sequence[str],
        optional: Sequence[str],
        unused: Callable[[str], None] | None = None,
        *,
        refuse: bool = True,
    ) -> None:
        """Refuse or name columns that are neither in `columns` nor `optional`.

        `unused` gets the names of those that may be there; None: none may. One that may be a
        misspelt one of `optional` is refused, or, if not `refuse`, warned of.

        Raises
        ------
        TableError
            A column that is unknown, without a name, or a duplicate of one of `optional`.
        """
        for name in optional:
            if self.header.count(name) > 1:
                raise TableError(f"duplicate column {name}", self.path, self.header_line)
        expected = [*columns, *optional]
        absent = [name for name in optional if name not in self.header]
        others: dict[str, None] = {}
        for name in self.header:
            if name in expected or not name or _NO_NAME.fullmatch(name):
                continue
            is_note = unused is not None and name.casefold() in NOTE_COLUMNS
            near = (
                "" if is_note else near_hint(cut_text(name), expected if unused is None else absent)
            )
            problem = f"unknown column {cut_text(name)!r}{near}"
            if unused is None:
                problem += f"; expected {','.join(expected)}"
                raise TableError(problem, self.path, self.header_line)
            if near and refuse:
                problem += " If not, rename or remove it"
                raise TableError(problem, self.path, self.header_line)
            if near:
                warn(f"{problem} It is not used: --columns says which is", self.path)
            else:
                others[cut_text(name)] = None
        if unnamed := self.unnamed():
            problem = f"column {unnamed[0] + 1} has no name"
            if unused is None:
                problem += f"; expected {','.join(expected)}"
                raise TableError(problem, self.path, self.header_line)
            if refuse:
                warn(f"{problem}: not used", self.path)
        if others and unused is not None:
            names = cut_text(", ".join(others))
            unused(f"columns not used: {names}")


def read_table(
    source: "str | os.PathLike[str] | pd.DataFrame",
    columns: Sequence[str] = (),
    optional: Sequence[str] | None = None,
    *,
    unused: Callable[[str], None] | None = None,
) -> TextTable:
    """A CSV table, which must have `columns`, as text; of a DataFrame a line is a row, from 1.

    Lines that begin with # are no rows. A last line without its end, a row with fewer cells than
    the header and a row behind a # are named in a `FembridgeWarning`.

    Parameters
    ----------
    optional
        Other columns that are read. A column that is none of them is refused, with the nearest
        name. None: other columns are ignored.
    unused
        Of a table that may have other columns: gets a line with their names. Refused are those
        that may be a misspelt one of `optional`.

    Raises
    ------
    TableError
        Absent, not UTF-8, not CSV, too large, a row longer than the header, a column that is
        missing, duplicate or unknown.
    """
    import pandas as pd

    if isinstance(source, pd.DataFrame):
        header = tuple(map(str, source.columns))
        check_header(header, columns, FRAME)
        cells = source.set_axis(range(len(header)), axis=1)
        texts = cells.select_dtypes(exclude="number")
        cells[texts.columns] = texts.astype(object).where(texts.notna(), "").map(str)
        table = TextTable(FRAME, header, cells, np.arange(len(cells)) + 1)
    else:
        path = Path(source)
        table = parse_text_table(read_content(path), path, columns)
    if optional is not None:
        table.check_columns(columns, optional, unused)
    return table


def read_content(path: Path) -> bytes:
    """The bytes of a table."""
    content = read_bytes(path, MAX_TABLE_BYTES, TableError.at(path))
    if b"\0" in content:
        raise TableError(
            "a binary file, expected a CSV table in UTF-8; of results `fembridge ingest` makes one",
            path,
        )
    warn_if_cut(path, content[-1:])
    return content


def warn_if_cut(path: Path, last_byte: bytes) -> None:
    """Warn of a text whose `last_byte` is no line end: its last value may be cut."""
    if last_byte and last_byte not in b"\r\n":
        warn("no line end behind the last row, whose last value may be cut", path)


def parse_text_table(content: bytes, path: Path, columns: Sequence[str] = ()) -> TextTable:
    """The table of a file in UTF-8, cells as text."""
    import pandas as pd

    content = content.removeprefix(codecs.BOM_UTF8)
    _check_utf8(content, path)
    begin, header_line = _behind_comments(content, path)
    try:
        stream = io.StringIO(content[begin : begin + HEADER_BYTES].decode(errors="ignore"), "")
        header = tuple(name.strip() for name in next(csv.reader(stream), ()))
        if not header:
            raise TableError(f"empty, expected a header {','.join(columns)}".strip(), path)
        if len(content) - begin > HEADER_BYTES and not stream.read(1):
            raise TableError(f"a header of more than {HEADER_BYTES} bytes", path)
        check_header(header, columns, path, header_line)
        _check_size(_counts_in(content), len(header), path)
        content = _without_comments(content[begin:], len(header), path, header_line)
        cells = pd.read_csv(
            io.BytesIO(content),
            header=None,
            dtype=object,
            na_filter=False,
            skip_blank_lines=False,
            encoding="utf-8",
        )
    except (csv.Error, pd.errors.ParserError) as error:
        raise _not_csv(content, path, error, header_line) from error
    if cells.shape[1] != len(header):
        raise TableError(f"{cells.shape[1]} columns, {len(header)} in the header", path)
    lines = np.arange(len(cells)) + header_line
    if b'"' in content:
        lines += _line_ends_in(cells, _counts_in(content).rows)
    empty = _is_blank(cells[0])
    for position in range(1, len(header)):
        rows = np.flatnonzero(empty)
        empty[rows] = _is_blank(cells[position].iloc[rows])
    empty[0] = True  # the header
    cells = cells[1:] if empty.sum() == 1 else cells[~empty]
    table = TextTable(path, header, cells, lines[~empty], header_line)
    _warn_of_short_rows(table, content, header_line)
    return table


def _is_utf8(content: bytes) -> bool:
    try:
        content.decode()
    except UnicodeDecodeError:
        return False
    return True


def _check_utf8(content: bytes, path: Path) -> None:
    try:
        content.decode()
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        byte = f"byte 0x{content[error.start]:02x}"
        raise TableError(f"{byte} is not UTF-8", path, line) from error


def _is_blank(cells: "pd.Series[Any]") -> BoolArray:
    """Whether each cell has no text; of millions that are equal one is stripped."""
    blank = [text for text in cells.unique() if not text.strip()]
    return np.array(cells.isin(blank) if blank else np.zeros(len(cells)), dtype=np.bool_)


class _Counts(NamedTuple):
    """What a table has before it is parsed; commas in quotes count, too."""

    rows: int
    separators: int
    size_bytes: int
    last_byte: bytes = b""

    @property
    def cells(self) -> int:
        return self.rows + self.separators


def _counts_in(content: bytes, separator: bytes = b",") -> _Counts:
    """Lines and separators of a text, whatever its lines end in."""
    ends = content.count(b"\n")
    if returns := content.count(b"\r"):
        ends += returns - content.count(b"\r\n")
    ends += content[-1:] not in (b"\n", b"\r", b"")
    return _Counts(ends, content.count(separator), len(content), content[-1:])


def count_cells(path: Path) -> _Counts:
    """Lines that end in LF, and separators, of a file, block by block."""
    rows = separators = size_bytes = 0
    last_byte = b""
    with path.open("rb") as file:
        while block := file.read(_BLOCK_BYTES):
            codes = np.frombuffer(block, np.uint8)  # faster than bytes.count of a frequent one
            rows += int(np.count_nonzero(codes == ord("\n")))
            separators += int(np.count_nonzero(codes == ord(",")))
            size_bytes += len(block)
            last_byte = block[-1:]
    return _Counts(rows + (last_byte != b"\n"), separators, size_bytes, last_byte)


def _check_size(counts: _Counts, columns: int, path: Path) -> None:
    """Refuse a table whose cells would take too much memory, before any is parsed.

    Rows that lack cells are filled with empty ones: a file of line ends under a long header
    would take far more memory than its size.
    """
    if columns > MAX_COLUMNS:
        raise TableError(f"{columns} columns, expected at most {MAX_COLUMNS}", path)
    cells = counts.rows * columns
    if cells > max(_SMALL_CELLS, _MOST_CELLS_PER_BYTE * counts.size_bytes):
        raise TableError(
            f"{counts.rows} lines under a header of {columns} columns, but the file has "
            f"{size_text(counts.size_bytes)}: most cells are absent",
            path,
        )
    size_bytes = counts.size_bytes * _TEXT_BYTES_PER_BYTE + cells * _TEXT_BYTES_PER_CELL
    check_memory(size_bytes, f"a table of {counts.rows} x {columns} cells", TableError.at(path))


def _behind_comments(content: bytes, path: Path) -> tuple[int, int]:
    """Where the first line that is no comment begins, and its number."""
    at, line = 0, 1
    while content.startswith(b"#", at) and (end := content.find(b"\n", at)) >= 0:
        at, line = end + 1, line + 1
        if line > _MOST_LINES_ABOVE:
            raise TableError(f"no header in the first {_MOST_LINES_ABOVE} lines", path)
    return at, line


def _without_comments(content: bytes, columns: int, path: Path, header_line: int) -> bytes:
    """`content` with an empty line for each comment; a comment with as many cells is named."""
    if b"\n#" not in content:
        return content
    rows = [match for match in _COMMENT.finditer(content) if match[0].count(b",") == columns - 1]
    if rows and columns > 1:
        line = header_line + content.count(b"\n", 0, rows[0].start())
        more = f", as do {len(rows) - 1} more rows" if len(rows) > 1 else ""
        warn(f"a row begins with #{more}: not read", path, line)
    return _COMMENT.sub(b"", content)


def _line_ends_in(cells: "pd.DataFrame", lines: int) -> IntArray:
    """Line ends in quoted cells ``(row,)``, up to each row; `lines` are those of the text."""
    ends = np.zeros(len(cells), dtype=np.int64)
    if lines != len(cells):
        for position in cells:
            ends += cells[position].str.count(r"\r\n|\r|\n").to_numpy(dtype=np.int64)
    return np.cumsum(ends)


def _warn_of_short_rows(table: TextTable, content: bytes, line: int, separator: str = ",") -> None:
    """Name the first row that has fewer cells than the header has names.

    `content` begins with `line`.
    """
    columns = max((at for at, name in enumerate(table.header, start=1) if name), default=0)
    last = table.cells[columns - 1] if columns > 1 else None
    if last is None or last.dtype.kind in "iuf" or not (last == "").any():
        return
    stream = io.TextIOWrapper(io.BytesIO(content), "utf-8", "replace", newline="")
    if b'"' in content and separator != " ":
        reader = csv.reader(stream, delimiter=separator)
        rows = ((reader.line_num, len(row)) for row in reader if any(map(str.strip, row)))
    else:
        rows = (
            (number, len(row.split(None if separator == " " else separator)))
            for number, row in enumerate(stream, start=1)
            if row.strip(f"{separator} \t\r\n")
        )
    with suppress(csv.Error):
        for number, count in rows:
            if count < columns:
                problem = f"{count} of the {columns} cells in the header"
                warn(f"{problem}: the others are taken as empty", table.path, line + number - 1)
                return


def discard_line(line: str) -> None:
    """A log of nothing."""


def cut_text(text: str) -> str:
    """`text` at a length that fits into a message."""
    return text if len(text) <= _LONGEST_SHOWN else f"{text[: _LONGEST_SHOWN - 3]}..."


def _shown(cell: object) -> str:
    """A cell in a message: text in quotes."""
    return repr(cut_text(cell)) if isinstance(cell, str) else str(cell)


def unnamed_columns(header: Sequence[str]) -> list[int]:
    """Positions of columns without a name."""
    return [at for at, name in enumerate(header) if not name or _NO_NAME.fullmatch(name)]


def _is_whole(text: str) -> bool:
    return text.isascii() and text.isdigit()


def header_in(text: str, path: Path) -> tuple[list[str], int, str]:
    """Columns of any program's table, where the rows below them begin, and what separates cells.

    `text` is the table, or its beginning.

    Raises
    ------
    TableError
        More columns than `MAX_COLUMNS`, or no header in the first lines.
    """
    line, at = "", 0
    for number in itertools.count(1):
        if at >= len(text):
            break
        if number > _MOST_LINES_ABOVE:
            raise TableError(f"no header in the first {_MOST_LINES_ABOVE} lines", path)
        end = text.find("\n", at) + 1 or len(text)
        if end - at > HEADER_BYTES:
            raise TableError(f"a header of more than {HEADER_BYTES} bytes", path, number)
        now, begin, at = text[at:end].strip(), at, end
        if not now:
            continue
        comment = now.startswith(_COMMENT_SIGNS)
        if line.startswith(_COMMENT_SIGNS) and not comment and _numbers_in(now):
            at = begin  # the comment before it was the header
            break
        line = now
        if not comment:
            break
    line = line.lstrip("".join(_COMMENT_SIGNS)).strip()
    separator = next((sign for sign in (";", "\t", ",") if sign in line), " ")
    if separator == " ":
        names = line.split()
    else:
        try:
            names = [cell.strip() for cell in next(csv.reader([line], delimiter=separator))]
        except csv.Error as error:
            raise TableError(f"not CSV: {error}", path) from error
    if len(names) > MAX_COLUMNS:
        raise TableError(f"{len(names)} columns, expected at most {MAX_COLUMNS}", path)
    return names, at, separator


def _cells_in(rows: bytes, width: int, separator: str) -> "pd.DataFrame":
    """Cells behind a header of `width`; or a ValueError."""
    import pandas as pd

    start = rows[: 2 * HEADER_BYTES].decode(errors="replace").lstrip("\r\n")
    first = next((line for line in start[:HEADER_BYTES].split("\n") if line.strip()), "")
    if len(first) >= HEADER_BYTES or (not first and len(rows) > HEADER_BYTES):
        raise ValueError(f"no whole row in the first {HEADER_BYTES} bytes below the header")
    blank = separator == " "
    cells = (
        first.split() if blank else next(csv.reader([first.strip("\r")], delimiter=separator), [])
    )
    if cells and len(cells) != width:
        raise ValueError(f"{len(cells)} cells under a header of {width}: {first[:60]!r}")
    return pd.read_csv(
        io.BytesIO(rows),
        sep=r"\s+" if blank else separator,
        decimal="," if separator == ";" and not re.search(r"\d\.\d", start[:4096]) else ".",
        header=None,
        names=range(width),
        skipinitialspace=True,
        index_col=False,
        na_filter=False,
        low_memory=False,
        encoding="utf-8",
        encoding_errors="replace",
    )


def _numbers_in(line: str) -> bool:
    """Whether a line begins with a number."""
    return re.match(r"[+-]?\.?\d", line) is not None


def parse_foreign_table(content: bytes, path: Path) -> TextTable | None:
    """A table as other programs write it, with lines of %, or no commas; None of any other."""
    content = content.removeprefix(codecs.BOM_UTF8)
    start = content[:_START_BYTES].decode(errors="replace")
    header, begin, separator = header_in(start, path)
    if separator == "," and not start.lstrip().startswith("%"):
        at, _ = _behind_comments(content, path)
        row = content[at : at + _LONGEST_SHOWN].decode(errors="replace").lstrip()
        if not (at and _numbers_in(row)) and _is_utf8(content):
            return None
    _check_size(_counts_in(content, separator.encode()), len(header), path)
    above = start.count("\n", 0, begin)
    at = 0
    for _ in range(above):
        at = content.index(b"\n", at) + 1
    rows = content[at:] if begin < len(start) else b""
    try:
        table = read_table(_cells_in(rows, len(header), separator).set_axis(header, axis=1))
    except FembridgeError:
        raise
    except (ValueError, csv.Error) as error:
        raise TableError(f"no table: {cut_text(str(error))}", path) from error
    table = replace(table, path=path, lines=table.lines + above, header_line=max(above, 1))
    _warn_of_short_rows(table, rows, above + 1, separator)
    return table


def check_header(header: Sequence[str], columns: Sequence[str], path: Path, line: int = 1) -> None:
    """Refuse a header that lacks one of `columns` or has one of them twice."""
    for separator, name in _SEPARATORS.items():
        if len(header) == 1 and separator in header[0]:
            raise TableError(
                f"{cut_text(header[0])!r} is separated by {name}, expected commas", path, line
            )
    for name in columns:
        if header.count(name) != 1:
            problem = "duplicate" if name in header else "no"
            others = [other for other in header if other not in columns]
            near = "" if name in header else near_hint(name, map(cut_text, others[:_MOST_COMPARED]))
            raise TableError(
                f"{problem} column {name} in {cut_text(','.join(header))!r}, "
                f"expected a header with {','.join(columns)}{near}",
                path,
                line,
            )


def _not_csv(
    content: bytes, path: Path, problem: ValueError | csv.Error, header_line: int = 1
) -> TableError:
    """What pandas says of `content`, with the line, in our words."""
    if cut := _IN_QUOTES.search(str(problem)):
        return TableError("not CSV: a quote is not closed", path, int(cut[1]) + header_line)
    if not (cells := _TOO_MANY_CELLS.search(str(problem))):
        return TableError(f"not CSV: {problem}", path)
    expected, line, count = map(int, cells.groups())
    stream = io.TextIOWrapper(io.BytesIO(content), "utf-8", newline="")
    row = next(itertools.islice(stream, line - 1, line), "").rstrip("\r\n")
    rest, _, decimals = row.rpartition(",")
    integer = rest.rpartition(",")[2]
    hint = ""
    if count == expected + 1 and integer.isdecimal() and decimals.isdecimal():
        hint = (
            f"; '{cut_text(f'{integer},{decimals}')}' looks like a decimal comma, expected a point"
        )
    line += header_line - 1
    return TableError(f"{count} cells, expected {expected} as in the header{hint}", path, line)


def _number(cell: str) -> float:
    """The number in a cell; NaN where it is none."""
    try:
        return parse_number(cell)
    except ValueError:
        return math.nan
