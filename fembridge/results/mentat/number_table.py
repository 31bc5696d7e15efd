"""Tables of numbers in a text that nobody described: runs of lines, column by column.

A run is consecutive lines with the same count of numbers, two or more. Numbers are
apart by blanks, tabs, semicolons or commas. A comma is a decimal comma where blanks,
tabs or semicolons hold the columns apart and no number of the run has a point.
"""

import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from fembridge.errors import ResultError
from fembridge.results.printed.text_lines import text_lines

_NUMBER = re.compile(
    r"[+-]?(?:\d+\.\d*|\.\d+|\d+)(?:[EeDd][+-]?\d+)?|[+-]?(?:\d+\.\d*|\.\d+)[+-]\d+"
)
_NO_E = re.compile(r"(?<=[\d.])(?=[+-]\d)")
_LEAST_ROWS, _LEAST_COLUMNS = 2, 2
_UTF_8_MARK = "\u00ef\u00bb\u00bf"  # its three bytes, as Latin-1 has them

_Split = Callable[[str], list[str]]


@dataclass(slots=True)
class NumberRun:
    """A run of rows; `line` is that of the first, `before` is the text above it."""

    line: int
    before: tuple[str, ...]
    rows: list[list[float]] = field(default_factory=list)

    @property
    def columns(self) -> int:
        """Count of numbers in a row."""
        return len(self.rows[0])

    def text(self, lines: Sequence[str]) -> str:
        """Give the rows as they stand in the `lines` of the file."""
        start = self.line - 1
        return "\n".join(line.strip() for line in lines[start : start + len(self.rows)])


def number_runs(path: Path) -> list[NumberRun]:
    """Find the runs of the file `path`, in its order.

    Raises
    ------
    ResultError
        No such file, it is no text in one byte a letter or UTF-8, a number is beyond
        all floats, or commas stand between the numbers and, perhaps, within them.
    """
    lines = _lines(path)
    decimal_comma = _runs(lines, _at_blanks, path)
    if decimal_comma:
        longest = max(decimal_comma, key=lambda run: len(run.rows))
        text = longest.text(lines)
        if re.search(r"\d,\d", text) and "." not in text:
            return decimal_comma
    runs = _runs(lines, _at_commas_too, path)
    for run in runs:
        text = run.text(lines)
        if run.columns > _LEAST_COLUMNS and not re.search(r"[.; \t]", text):
            raise ResultError(
                f"commas between numbers, and perhaps within: {text[:60]!r}; export "
                "with decimal points, or with tabs between the columns",
                path,
                run.line,
            )
    return runs


def number(text: str) -> float | None:
    """Read a number as Fortran or C print it; None if it is none."""
    if not (text.isascii() and _NUMBER.fullmatch(text)):
        return None
    plain = text.replace("d", "e").replace("D", "e")
    if "e" not in plain and "E" not in plain:
        plain = _NO_E.sub("e", plain)  # 1.0-3
    return float(plain)


def _lines(path: Path) -> list[str]:
    lines = []
    for count, line, _ in text_lines(path):
        if "\0" in line:
            raise ResultError("a zero byte: no text, or UTF-16, expected UTF-8", path, count)
        plain = line.removeprefix(_UTF_8_MARK) if count == 1 else line
        with suppress(UnicodeDecodeError):  # else Latin-1 it is
            plain = plain.encode("latin-1").decode("utf-8")
        lines.append(plain)
    return lines


def _runs(lines: Sequence[str], split: _Split, path: Path) -> list[NumberRun]:
    runs: list[NumberRun] = []
    run: NumberRun | None = None
    above = 0
    for count, line in enumerate(lines, start=1):
        row = _row(split(line), path, count)
        if row is None:
            run = None
        elif run is not None and run.columns == len(row):
            run.rows.append(row)
        else:
            if runs and len(runs[-1].rows) < _LEAST_ROWS:
                runs.pop()  # a line of numbers alone is part of a header
            elif runs:
                above = runs[-1].line - 1 + len(runs[-1].rows)
            run = NumberRun(count, tuple(lines[above : count - 1]), [row])
            runs.append(run)
    return [run for run in runs if len(run.rows) >= _LEAST_ROWS]


def _row(words: Sequence[str], path: Path, line: int) -> list[float] | None:
    if len(words) < _LEAST_COLUMNS:
        return None
    row: list[float] = []
    for word in words:
        value = number(word)
        if value is None:
            return None
        if value - value != 0:
            raise ResultError(f"{word} is too large to be a number", path, line)
        row.append(value)
    return row


def _at_blanks(line: str) -> list[str]:
    """Split at blanks and semicolons, and take a comma for a decimal comma."""
    words = [word for word in re.split(r"[\s;]+", line) if word]
    if any("." in word and "," in word for word in words):
        return []
    return [word.replace(",", ".") for word in words]


def _at_commas_too(line: str) -> list[str]:
    return [word for word in re.split(r"[\s;,]+", line) if word]
