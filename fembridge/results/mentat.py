"""Plots that Mentat saved as text.

A history or path plot, saved as text or copied out of a table::

    Time Node 2 <tab> Equivalent Von Mises Stress Node 2
    0       <tab> 0
    0.0005  <tab> 205.897

Mentat describes none of its layouts. Known from real files is the one above, as it was
copied from Mentat 2014 (there over strain); programs that read others report a header of
some lines over two columns, and of an index before the columns. So a table is consecutive
lines with the same count of numbers: the longest, and all others as wide. Names come from
the line above that has one cell between tabs for each column. What has no name stays
``column_3``, and is not guessed at.

Time is taken as s and stress in `ReadOptions.stress_unit`.
"""

import math
import re
from array import array
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.byte_file import text_lines
from fembridge.results.history import History, of_samples
from fembridge.results.read_options import ReadOptions, in_pa
from fembridge.results.source import Source
from fembridge.trace import MS_PER_S, seconds_to_ms
from fembridge.typing import FloatArray, Table

INDEX = "index"

_LEAST_ROWS, _LEAST_COLUMNS = 2, 2
_MOST_LINES_ABOVE, _MOST_TABLES, _MOST_LINES = 200, 100_000, 2_000_000
_NODE = re.compile(r"\b(?:node|n:) *:? *([0-9]{1,18})\b", re.IGNORECASE)
_TIME = re.compile(r"\btime\b", re.IGNORECASE)
_VON_MISES = re.compile(r"\bmises\b|\bequivalent cauchy stress\b", re.IGNORECASE)


@dataclass(frozen=True, slots=True, eq=False)
class PlotTable:
    """A table in a text: `labels` of its columns, `values` ``(R, C)`` as they are there.

    `header` is the text above, `line` that of the first row. A column that counts the rows is
    called "index".
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
        return self.labels[0] != "column_1"

    @property
    def is_over_time(self) -> bool:
        """Whether the abscissa is called time."""
        return _TIME.search(self.labels[self.x]) is not None

    def node(self, column: int) -> int | None:
        """The node that a column belongs to, if the text names it."""
        found = _NODE.findall(self.labels[column])
        if not found and len(self.labels) - self.x == 2:
            found = [n for line in self.header for n in _NODE.findall(line)]
        return int(found[0]) if len(set(found)) == 1 else None


class PlotSource(Source):
    """A history plot: curves over time of nodes."""

    @cached_property
    def _read(self) -> tuple[list[PlotTable], str]:
        return read_plot_tables(self.path)

    def _tables(self) -> list[PlotTable]:
        tables, doubt = self._read
        if doubt:
            self.options.note(doubt)
        return tables

    def stress(self, nodes: Sequence[int] | None) -> History:
        """Von Mises stress over time at `nodes`, in that order; of None of all curves.

        A table whose columns have names must name time and von Mises stress; one of two columns
        without names is taken as that, with a note. Where the text names no node, `nodes` say
        whose its curves are, one for each.
        """
        path, options = self.path, self.options
        found: list[tuple[int | None, FloatArray]] = []
        for table in self._tables():
            times_ms = self._times_ms(table)
            for column in _stress_columns(table, path, options):
                stress_pa = in_pa(table.values[:, column], options, path)
                found.append((table.node(column), np.stack([times_ms, stress_pa], -1)))
        named = [node for node, _ in found if node is not None]
        wanted = named if nodes is None else list(nodes)
        if not named:
            if len(wanted) != len(found):
                words = "the text does not say of which node its curves are: name (--node N) one"
                raise ResultError(f"{words} for each of the {len(found)}, {len(wanted)} were", path)
            named = wanted
        elif len(set(named)) < len(found):
            twice = [node for node in named if named.count(node) > 1]
            words = f"node {min(twice)} has two" if twice else "one has no node"
            raise ResultError(f"of {len(found)} curves {words}", path)
        curves = dict(zip(named, (curve for _, curve in found), strict=True))
        for node in wanted:
            if node not in curves:
                there = ", ".join(map(str, curves))
                raise ResultError(f"no curve of node {node}, there is {there}", path)
        return of_samples([(node, curves[node]) for node in wanted], path)

    def _times_ms(self, table: PlotTable) -> FloatArray:
        times_s = table.values[:, table.x]
        try:
            seconds_to_ms(float(np.abs(times_s).max()))
        except ValueError as error:
            line = table.line + int(np.abs(times_s).argmax())
            raise ResultError(str(error), self.path, line) from error
        times_ms: FloatArray = times_s * MS_PER_S
        return times_ms

    def named_nodes(self) -> tuple[int, ...]:
        """The nodes that the text names, of all curves; none if it names none."""
        found = [
            table.node(column)
            for table in self._read[0]
            for column in range(table.x + 1, len(table.labels))
        ]
        return tuple(dict.fromkeys(node for node in found if node is not None))

    def describe(self) -> Table:
        """Tables, columns and nodes of a plot."""
        tables, doubt = self._read
        unnamed = "" if tables[0].is_named else "its columns have no names"
        return super().describe() | {
            "tables": len(tables),
            "rows": sum(len(table.values) for table in tables),
            "columns": list(tables[0].labels),
            "over_time": all(table.is_over_time for table in tables),
            "nodes": list(self.named_nodes()),
            "problem": "; ".join(filter(None, (doubt, unnamed))) or None,
        }

    def table(self, quantity: str | None = None) -> Iterator[Sequence[object]]:
        """What the plot holds, number by number.

        Of several tables the first column, ``table``, counts them.
        """
        first, *others = tables = self._tables()
        columns = list(first.labels)
        if not first.is_over_time and any(map(_VON_MISES.search, columns)):
            self.options.note(f"over {columns[first.x]!r} and not over Time: a table, no traces")
        if any(table.labels != first.labels for table in others):
            columns = _without_nodes(columns)
        for table in others:
            if _without_nodes(table.labels) != _without_nodes(columns):
                words = f"columns {', '.join(table.labels)}, those of the first table are "
                raise ResultError(words + ", ".join(first.labels), self.path, table.line)
        columns = [
            f"{name} ({columns[:at].count(name) + 1})" if name in columns[:at] else name
            for at, name in enumerate(columns)
        ]
        yield ["table", *columns] if others else columns
        for count, table in enumerate(tables, start=1):
            for row in table.values.tolist():
                yield [count, *row] if others else row


@dataclass(slots=True)
class _Group:
    """Consecutive lines with as many numbers each, `columns`; the last of them as `texts`.

    `line` is the number of the first. What Python takes for a number and Mentat does not write,
    such as ``1_000``, is NaN.
    """

    columns: int
    line: int
    texts: deque[str]
    numbers: "array[float]"
    rows: int = 0

    @property
    def is_table(self) -> bool:
        """Whether it has rows and columns enough."""
        return self.columns >= _LEAST_COLUMNS and self.rows >= _LEAST_ROWS


def _groups(path: Path) -> Iterator[tuple[_Group, str]]:
    """The groups of lines, and in the last one the text of a line without an end, else ""."""
    group: _Group | None = None
    number, cut = 0, ""
    for number, line, ended in text_lines(path):
        if number > _MOST_LINES:
            raise ResultError(f"more than {_MOST_LINES} lines: no plot", path, number)
        text = _in_utf8(line)
        numbers = _numbers(text)
        if group is None or len(numbers) != group.columns:
            if group is not None:
                yield group, ""
            group = _Group(len(numbers), number, deque(maxlen=_MOST_LINES_ABOVE), array("d"))
        group.texts.append(text)
        group.numbers.extend(numbers)
        group.rows += 1
        cut = "" if ended else text
    if group is not None:
        yield group, cut
    yield _Group(0, number + 1, deque([""]), array("d"), 1), cut


def read_plot_tables(path: Path) -> tuple[list[PlotTable], str]:
    """The longest table of a text and the others as wide, in file order; and a doubt, or ""."""
    places: list[tuple[list[str], _Group, _Group]] = []  # texts above, rows, and what follows
    above: deque[str] = deque(maxlen=_MOST_LINES_ABOVE)
    before: _Group | None = None
    cut = ""
    for group, text in _groups(path):
        cut = text
        if before is not None and before.is_table:
            places.append((list(above), before, group))
            above.clear()
            if len(places) > _MOST_TABLES:
                raise ResultError(f"more than {_MOST_TABLES} tables", path)
        elif before is not None:
            above += before.texts
        before = group
    if not places:
        raise ResultError("no table: no two lines with as many numbers each", path)
    width = max(places, key=lambda place: place[1].rows)[1].columns
    tables = []
    for texts, group, after in places:
        if group.columns != width:
            continue
        values = np.frombuffer(group.numbers).reshape(group.rows, width)
        labels = _labels(texts, values)
        # A row that is damaged parts a table, or is taken for its heading.
        end = group.line + group.rows
        if after.columns or _like_row(after.texts[0], width):
            raise ResultError(f"no row of {width} numbers, at a table of such", path, end)
        if labels[0] != "column_1" and texts and _like_row(texts[-1], width):
            raise ResultError(
                f"no row of {width} numbers, at a table of such", path, group.line - 1
            )
        if (bad := np.argwhere(~np.isfinite(values))).size:
            problem = "a number that is not finite, or not in ASCII digits"
            raise ResultError(problem, path, group.line + int(bad[0][0]))
        header = tuple(filter(str.strip, texts))
        tables.append(PlotTable(labels, values, header, group.line))
    doubts = []
    if lost := [line for line in tables[0].header if len(_numbers(line)) == width]:
        doubts.append(f"a row above the names of the columns is left out: {lost[-1].strip()!r}")
    if cut.strip():
        doubts.append(f"the last line has no end and may be cut: {cut.strip()[-40:]!r}")
    return tables, "; ".join(doubts)


def _like_row(line: str, columns: int) -> bool:
    """Whether a line that is no row of `columns` numbers may have been one."""
    words = line.split()
    if not words or len(words) > columns + 1 or not any(map(str.isdecimal, words[0])):
        return False
    return len(words) == 1 or any(_numbers(word) for word in words)


def _in_utf8(line: str) -> str:
    """A line that was read as Latin-1, which it stays where it is no UTF-8."""
    if line.isascii():
        return line
    try:
        return line.encode("latin-1").decode("utf-8-sig")
    except UnicodeDecodeError:
        return line


def _numbers(line: str) -> list[float]:
    """The numbers of a line of numbers alone; none of any other line.

    NaN stands for what is a number of Python alone: ``1_000``, ``inf``, other scripts' digits.
    """
    try:
        numbers = [float(word) for word in line.split()]
    except ValueError:
        return []
    if "_" in line or not line.isascii() or not all(map(math.isfinite, numbers)):
        return [math.nan] * len(numbers)
    return numbers


def _labels(before: Sequence[str], values: FloatArray) -> tuple[str, ...]:
    columns = values.shape[1]
    counts = bool((np.diff(values[:, 0]) == 1).all()) and values[0, 0] in (0, 1)
    for line in reversed(before):
        cells = [cell.strip() for cell in line.split("\t") if cell.strip()]
        if _like_row(line, columns):
            continue
        if len(cells) == columns:
            return tuple(cells)
        if len(cells) == columns - 1 >= 2 and counts:
            return (INDEX, *cells)
    return tuple(f"column_{count}" for count in range(1, columns + 1))


def _stress_columns(table: PlotTable, path: Path, options: ReadOptions) -> list[int]:
    others, line = range(table.x + 1, len(table.labels)), table.line
    if not table.is_named:
        if len(others) > 1:
            words = f"{len(table.labels)} columns without names: which is time, and which von"
            raise ResultError(f"{words} Mises stress, is not said", path, line)
        above = f"; above them: {' / '.join(table.header)[:200]!r}" * bool(table.header)
        options.note(f"columns without names, taken as time in s and von Mises stress{above}")
        return list(others)
    if not table.is_over_time:
        raise ResultError(f"over {table.labels[table.x]!r}, a trace needs Time there", path, line)
    columns = [k for k in others if _VON_MISES.search(table.labels[k])]
    left = ", ".join(repr(table.labels[k]) for k in others if k not in columns)
    if not columns:
        raise ResultError(f"no von Mises stress in it, but {left}", path, line)
    if left:
        options.note(f"no von Mises stress, left out: {left}")
    return columns


def _without_nodes(labels: Sequence[str]) -> list[str]:
    return [_NODE.sub("", label).strip() for label in labels]
