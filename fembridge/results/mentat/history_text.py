"""A history plot or a path plot of Mentat, saved as text or copied out of a table.

    Time Node 2 <tab> Equivalent Von Mises Stress Node 2
    0       <tab> 0
    0.0005  <tab> 205.897

Mentat describes none of its layouts. Known from real files is the one above, as it
was copied from Mentat 2014 (there over strain); from programs that read them, nine
lines and two columns, and two lines, an index and tabs. So a table is found, not
parsed: the longest run of lines with the same count of numbers, and every other run
as wide. Names come from the line above that has one cell, between tabs or wide gaps,
for each column. What has no name stays ``column_3``, and is not guessed at.
"""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.mentat.number_table import NumberRun, number, number_runs
from fembridge.store import replacing
from fembridge.typing import FloatArray

INDEX = "index"
_LEAST_OTHER_ROWS = 3
_NODE = re.compile(r"\b(?:node|n:) *:? *(\d+)\b", re.IGNORECASE)
_TIME = re.compile(r"\btime\b", re.IGNORECASE)
_UNNAMED = re.compile(r"column_\d+")


@dataclass(frozen=True, slots=True, eq=False)
class HistoryText:
    """A table in the text: `labels` of its columns, `values` ``(R, C)``.

    Numbers are as they stand there. `header` is the text above, `line` that of the
    first row. A column that counts the rows is called "index".
    """

    labels: tuple[str, ...]
    values: FloatArray
    header: tuple[str, ...]
    line: int

    @property
    def x(self) -> int:
        """Column of the abscissa: the first that is no index."""
        return 1 if self.labels[0] == INDEX else 0

    @property
    def is_named(self) -> bool:
        """Whether the columns have names in the text."""
        return not _UNNAMED.fullmatch(self.labels[self.x])

    @property
    def is_over_time(self) -> bool:
        """Whether the abscissa is called time."""
        return _TIME.search(self.labels[self.x]) is not None

    def node(self, column: int) -> int | None:
        """Give the node that a column belongs to, if the text says it."""
        found = _NODE.findall(self.labels[column])
        if not found and len(self.labels) - self.x == 2:
            found = [n for line in self.header for n in _NODE.findall(line)]
        return int(found[0]) if len(set(found)) == 1 else None


def read_history_text(path: Path) -> HistoryText:
    """Read the one table of a text.

    Raises
    ------
    ResultError
        There is none, or there are several of the same width.
    """
    tables = read_history_tables(path)
    if len(tables) > 1:
        lines = ", ".join(str(table.line) for table in tables)
        raise ResultError(
            f"{len(tables)} tables of {tables[0].values.shape[1]} columns, from lines "
            f"{lines}: keep one",
            path,
        )
    return tables[0]


def read_history_tables(path: Path) -> list[HistoryText]:
    """Read the longest table of a text, and the others as wide, in file order.

    Raises
    ------
    ResultError
        There is no such file, no table of two columns and rows in it, or its numbers
        cannot be told apart.
    """
    runs = number_runs(path)
    if not runs:
        raise ResultError("no table: no two lines with as many numbers each", path)
    longest = max(runs, key=lambda run: len(run.rows))
    least = min(_LEAST_OTHER_ROWS, len(longest.rows))
    return [
        _table(run) for run in runs if run.columns == longest.columns and len(run.rows) >= least
    ]


def write_history_table(path: Path, output: Path) -> int:
    """Write what `path` holds as CSV, number by number; give the count of rows.

    Of several tables the first column, ``table``, tells which.

    Raises
    ------
    ResultError
        There is no table in it, or its tables have different columns.
    """
    tables = read_history_tables(path)
    columns = _distinct(tables[0].labels)
    for table in tables[1:]:
        if _without_nodes(table.labels) != _without_nodes(tables[0].labels):
            raise ResultError(
                f"columns {', '.join(table.labels)}, those of the first table are "
                f"{', '.join(tables[0].labels)}",
                path,
                table.line,
            )
        if table.labels != tables[0].labels:
            columns = _distinct(_without_nodes(tables[0].labels))
    several = len(tables) > 1
    with replacing(output) as draft, draft.open("w", newline="") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow([*(["table"] if several else []), *columns])
        for count, table in enumerate(tables, start=1):
            which = [count] if several else []
            writer.writerows([*which, *row] for row in table.values.tolist())
    return sum(len(table.values) for table in tables)


def _table(run: NumberRun) -> HistoryText:
    values = np.array(run.rows, dtype=np.float64)
    values.flags.writeable = False
    labels = _labels(run, values)
    return HistoryText(labels, values, tuple(filter(str.strip, run.before)), run.line)


def _labels(run: NumberRun, values: FloatArray) -> tuple[str, ...]:
    counts = bool((np.diff(values[:, 0]) == 1).all()) and values[0, 0] in (0, 1)
    for line in reversed(run.before):
        for pattern in (r"\t", r"\t| {2,}"):
            cells = [cell.strip() for cell in re.split(pattern, line.strip())]
            cells = [cell for cell in cells if cell]
            if any(number(cell) is not None for cell in cells):
                continue
            if len(cells) == run.columns:
                return tuple(cells)
            if len(cells) == run.columns - 1 >= 2 and counts:
                return (INDEX, *cells)
    return tuple(f"column_{count}" for count in range(1, run.columns + 1))


def _without_nodes(labels: Sequence[str]) -> tuple[str, ...]:
    return tuple(_NODE.sub("", label).strip() for label in labels)


def _distinct(labels: Sequence[str]) -> list[str]:
    """Make names differ: a second "a" becomes "a (2)"."""
    return [
        f"{label} ({labels[:at].count(label) + 1})" if label in labels[:at] else label
        for at, label in enumerate(labels)
    ]
