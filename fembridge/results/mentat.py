"""History and path plots of Mentat, saved as text or copied from a table.

Example::

    Time Node 2 <tab> Equivalent Von Mises Stress Node 2
    0       <tab> 0
    0.0005  <tab> 205.897

Mentat does not document its layouts. The layout above is from a real file, copied from Mentat
2014 (over strain); programs that read other layouts describe a header of some lines above two
columns, and an index column. Therefore a table is a run of lines with the same count of numbers:
the longest run, and all others of the same width. Column names come from the line above with a
cell between tabs for each column. A column without a name is ``column_3``.

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
from fembridge.results.history import History, history_of_samples
from fembridge.results.read_options import ReadOptions, in_pa
from fembridge.results.source import Source
from fembridge.trace import MS_PER_S, seconds_to_ms
from fembridge.typing import FloatArray, Table

INDEX = "index"

_MIN_ROWS, _MIN_COLUMNS = 2, 2
_MAX_LINES_ABOVE, _MAX_TABLES, _MAX_LINES = 200, 100_000, 2_000_000
_NODE = re.compile(r"\b(?:node|n:) *:? *([0-9]{1,18})\b", re.IGNORECASE)
_TIME = re.compile(r"\btime\b", re.IGNORECASE)
_VON_MISES = re.compile(r"\bmises\b|\bequivalent cauchy stress\b", re.IGNORECASE)


@dataclass(frozen=True, slots=True, eq=False)
class PlotTable:
    """A table in a text: `labels` of its columns, `values` ``(R, C)`` as in the file.

    `header` is the text above it, `line` the line of its first row. A column that counts the
    rows has the label "index".
    """

    labels: tuple[str, ...]
    values: FloatArray
    header: tuple[str, ...]
    line: int

    @property
    def x(self) -> int:
        """Column of the abscissa: the first that is not the index."""
        return 1 if self.labels[0] == INDEX else 0

    @property
    def is_named(self) -> bool:
        """Whether the text names the columns."""
        return self.labels[0] != "column_1"

    @property
    def is_over_time(self) -> bool:
        """Whether the abscissa is time."""
        return _TIME.search(self.labels[self.x]) is not None

    def node(self, column: int) -> int | None:
        """Node of a column; None if the text names none."""
        numbers = _NODE.findall(self.labels[column])
        if not numbers and len(self.labels) - self.x == 2:
            numbers = [n for line in self.header for n in _NODE.findall(line)]
        return int(numbers[0]) if len(set(numbers)) == 1 else None


class PlotSource(Source):
    """A history plot: curves of nodes over time."""

    @cached_property
    def _read(self) -> tuple[list[PlotTable], str]:
        return read_plot_tables(self.path)

    def _tables(self) -> list[PlotTable]:
        tables, doubt = self._read
        if doubt:
            self.options.note(doubt)
        return tables

    def stress(self, nodes: Sequence[int] | None) -> History:
        """Von Mises stress over time at `nodes`, in that order; None: of all curves.

        A table with column names must name time and von Mises stress; two columns without names
        are taken as these, with a remark. If the text names no nodes, `nodes` has one number for
        each curve.
        """
        path, options = self.path, self.options
        node_curves: list[tuple[int | None, FloatArray]] = []
        for table in self._tables():
            times_ms = self._times_ms(table)
            for column in _find_stress_columns(table, path, options):
                stress_pa = in_pa(table.values[:, column], options, path)
                node_curves.append((table.node(column), np.stack([times_ms, stress_pa], -1)))
        numbers = [node for node, _ in node_curves if node is not None]
        requested = numbers if nodes is None else list(nodes)
        if not numbers:
            if len(requested) != len(node_curves):
                raise ResultError(
                    f"has {len(requested)} numbers for {len(node_curves)} curves without node "
                    "names, expected one for each (--node N)",
                    path,
                    argument="nodes",
                )
            numbers = requested
        elif len(set(numbers)) < len(node_curves):
            duplicates = [node for node in numbers if numbers.count(node) > 1]
            message = f"node {min(duplicates)} has two" if duplicates else "one has no node name"
            raise ResultError(f"of {len(node_curves)} curves {message}", path)
        curves = dict(zip(numbers, (curve for _, curve in node_curves), strict=True))
        for node in requested:
            if node not in curves:
                available = ", ".join(map(str, curves))
                raise ResultError(f"no curve of node {node}; the file has {available}", path)
        return history_of_samples([(node, curves[node]) for node in requested], path)

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
        """Nodes of all curves that the text names."""
        nodes = [
            table.node(column)
            for table in self._read[0]
            for column in range(table.x + 1, len(table.labels))
        ]
        return tuple(dict.fromkeys(node for node in nodes if node is not None))

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
        """The plot as a table; with several tables the first column, ``table``, counts them."""
        first, *others = tables = self._tables()
        columns = list(first.labels)
        if not first.is_over_time and any(map(_VON_MISES.search, columns)):
            self.options.note(f"abscissa {columns[first.x]!r} is not Time: a table, no traces")
        if any(table.labels != first.labels for table in others):
            columns = _remove_nodes(columns)
        for table in others:
            if _remove_nodes(table.labels) != _remove_nodes(columns):
                labels, expected = ", ".join(table.labels), ", ".join(first.labels)
                raise ResultError(
                    f"columns {labels}, expected {expected} as in the first table",
                    self.path,
                    table.line,
                )
        columns = [
            f"{name} ({columns[:index].count(name) + 1})" if name in columns[:index] else name
            for index, name in enumerate(columns)
        ]
        yield ["table", *columns] if others else columns
        for count, table in enumerate(tables, start=1):
            for row in table.values.tolist():
                yield [count, *row] if others else row


@dataclass(slots=True)
class _Group:
    """Consecutive lines with `columns` numbers each; `texts` are the last of them.

    `line` is the number of the first line. A number that Mentat does not write, such as
    ``1_000``, is NaN.
    """

    columns: int
    line: int
    texts: deque[str]
    numbers: "array[float]"
    rows: int = 0

    @property
    def is_table(self) -> bool:
        """Whether it has enough rows and columns."""
        return self.columns >= _MIN_COLUMNS and self.rows >= _MIN_ROWS


def _read_groups(path: Path) -> Iterator[tuple[_Group, str]]:
    """Groups of lines; with the last group the text of an incomplete last line, else ""."""
    group: _Group | None = None
    number, cut = 0, ""
    for number, line, closed in text_lines(path):
        if number > _MAX_LINES:
            raise ResultError(f"more than {_MAX_LINES} lines, too many for a plot", path, number)
        text = _decode_utf8(line)
        numbers = _parse_numbers(text)
        if group is None or len(numbers) != group.columns:
            if group is not None:
                yield group, ""
            group = _Group(len(numbers), number, deque(maxlen=_MAX_LINES_ABOVE), array("d"))
        group.texts.append(text)
        group.numbers.extend(numbers)
        group.rows += 1
        cut = "" if closed else text
    if group is not None:
        yield group, cut
    yield _Group(0, number + 1, deque([""]), array("d"), 1), cut


def read_plot_tables(path: Path) -> tuple[list[PlotTable], str]:
    """Longest table of a text and others of its width, in file order; and a warning, or ""."""
    candidates: list[tuple[list[str], _Group, _Group]] = []  # texts above, rows, and what follows
    lines_above: deque[str] = deque(maxlen=_MAX_LINES_ABOVE)
    previous: _Group | None = None
    cut = ""
    for group, text in _read_groups(path):
        cut = text
        if previous is not None and previous.is_table:
            candidates.append((list(lines_above), previous, group))
            lines_above.clear()
            if len(candidates) > _MAX_TABLES:
                raise ResultError(f"more than {_MAX_TABLES} tables", path)
        elif previous is not None:
            lines_above += previous.texts
        previous = group
    if not candidates:
        raise ResultError("no table: expected two lines with the same count of numbers", path)
    width = max(candidates, key=lambda candidate: candidate[1].rows)[1].columns
    tables = []
    for texts, group, next_group in candidates:
        if group.columns != width:
            continue
        values = np.frombuffer(group.numbers).reshape(group.rows, width)
        labels = _find_labels(texts, values)
        # A damaged row splits a table or looks like its heading.
        end = group.line + group.rows
        if next_group.columns or _resembles_row(next_group.texts[0], width):
            raise ResultError(f"no row of {width} numbers, at a table of such", path, end)
        if labels[0] != "column_1" and texts and _resembles_row(texts[-1], width):
            raise ResultError(
                f"no row of {width} numbers, at a table of such", path, group.line - 1
            )
        if (not_finite := np.argwhere(~np.isfinite(values))).size:
            problem = "number is not finite or not in ASCII digits"
            raise ResultError(problem, path, group.line + int(not_finite[0][0]))
        header = tuple(filter(str.strip, texts))
        tables.append(PlotTable(labels, values, header, group.line))
    doubts = []
    if rows_above := [line for line in tables[0].header if len(_parse_numbers(line)) == width]:
        doubts.append(
            f"a row above the names of the columns is left out: {rows_above[-1].strip()!r}"
        )
    if cut.strip():
        doubts.append(f"the last line has no end and may be cut: {cut.strip()[-40:]!r}")
    return tables, "; ".join(doubts)


def _resembles_row(line: str, columns: int) -> bool:
    """Whether a line may be a damaged row of `columns` numbers."""
    fields = line.split()
    if not fields or len(fields) > columns + 1 or not any(map(str.isdecimal, fields[0])):
        return False
    return len(fields) == 1 or any(_parse_numbers(field) for field in fields)


def _decode_utf8(line: str) -> str:
    """A line that was decoded as Latin-1, decoded as UTF-8 if it is valid UTF-8."""
    if line.isascii():
        return line
    try:
        return line.encode("latin-1").decode("utf-8-sig")
    except UnicodeDecodeError:
        return line


def _parse_numbers(line: str) -> list[float]:
    """Numbers of a line that has only numbers; empty for any other line.

    Numbers that only Python accepts (``1_000``, ``inf``, digits of other scripts) become NaN.
    """
    try:
        numbers = [float(field) for field in line.split()]
    except ValueError:
        return []
    if "_" in line or not line.isascii() or not all(map(math.isfinite, numbers)):
        return [math.nan] * len(numbers)
    return numbers


def _find_labels(lines_above: Sequence[str], values: FloatArray) -> tuple[str, ...]:
    columns = values.shape[1]
    is_index = bool((np.diff(values[:, 0]) == 1).all()) and values[0, 0] in (0, 1)
    for line in reversed(lines_above):
        cells = [cell.strip() for cell in line.split("\t") if cell.strip()]
        if _resembles_row(line, columns):
            continue
        if len(cells) == columns:
            return tuple(cells)
        if len(cells) == columns - 1 >= 2 and is_index:
            return (INDEX, *cells)
    return tuple(f"column_{count}" for count in range(1, columns + 1))


def _find_stress_columns(table: PlotTable, path: Path, options: ReadOptions) -> list[int]:
    others, line = range(table.x + 1, len(table.labels)), table.line
    if not table.is_named:
        if len(others) > 1:
            message = f"{len(table.labels)} columns without names: which is time, and which von"
            raise ResultError(f"{message} Mises stress, is not said", path, line)
        header_text = f"; above them: {' / '.join(table.header)[:200]!r}" * bool(table.header)
        options.note(f"columns without names, taken as time in s and von Mises stress{header_text}")
        return list(others)
    if not table.is_over_time:
        raise ResultError(f"over {table.labels[table.x]!r}, a trace needs Time there", path, line)
    columns = [k for k in others if _VON_MISES.search(table.labels[k])]
    left_out_text = ", ".join(repr(table.labels[k]) for k in others if k not in columns)
    if not columns:
        raise ResultError(f"no von Mises stress in it, but {left_out_text}", path, line)
    if left_out_text:
        options.note(f"no von Mises stress, left out: {left_out_text}")
    return columns


def _remove_nodes(labels: Sequence[str]) -> list[str]:
    return [_NODE.sub("", label).strip() for label in labels]
