"""Von Mises stress over time from a history plot that Mentat saved as text.

Time is taken as s, stress in `ReadOptions.stress_unit`. What Mentat copies has six
digits. A table whose columns have names must name time and von Mises stress; one of
two columns without names is taken as that, and whoever listens is told.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.mentat.history_text import HistoryText, read_history_tables
from fembridge.results.read_options import ReadOptions, in_pa
from fembridge.trace import MS_PER_S, StressTrace
from fembridge.typing import FloatArray, Table

_VON_MISES = re.compile(r"\bmises\b|\bequivalent cauchy stress\b", re.IGNORECASE)
_DEFAULTS = ReadOptions()


@dataclass(frozen=True, slots=True, eq=False)
class _Curve:
    """Von Mises stress over time: the node that the text names, ``(T,)`` both."""

    node: int | None
    times_ms: FloatArray
    stress_pa: FloatArray


def read(path: Path, nodes: Sequence[int], options: ReadOptions = _DEFAULTS) -> list[StressTrace]:
    """Read von Mises stress over time at `nodes`, in that order.

    Where the text names no node, `nodes` say whose its curves are, one for each.
    With no `nodes` all curves are read.

    Raises
    ------
    ResultError
        The abscissa is not called time, no column von Mises stress, or a node is
        missing, twice, or not said; times that are not one even grid.
    """
    return [
        StressTrace.on_grid(node, np.stack([curve.times_ms, curve.stress_pa], -1), path)
        for node, curve in _chosen(_curves(path, options), nodes, path)
    ]


def nodes_in(path: Path) -> tuple[int, ...]:
    """Give the nodes that the text names, of all curves; none if it names none."""
    found = [
        table.node(column)
        for table in read_history_tables(path)
        for column in range(table.x + 1, len(table.labels))
    ]
    return tuple(dict.fromkeys(node for node in found if node is not None))


def is_over_time(path: Path) -> bool:
    """Whether the abscissa of every table of a text is called time."""
    return all(table.is_over_time for table in read_history_tables(path))


def describe(path: Path) -> Table:
    """Tell what `path` holds."""
    tables = read_history_tables(path)
    first = tables[0]
    return {
        "format": "mentat-plot",
        "bytes": path.stat().st_size,
        "tables": len(tables),
        "rows": sum(len(table.values) for table in tables),
        "columns": list(first.labels),
        "over_time": is_over_time(path),
        "nodes": list(nodes_in(path)),
        "problem": None if first.is_named else "its columns have no names",
    }


def _chosen(curves: Sequence[_Curve], nodes: Sequence[int], path: Path) -> list[tuple[int, _Curve]]:
    named = [curve.node for curve in curves if curve.node is not None]
    if not named:
        if len(nodes) != len(curves):
            raise ResultError(
                f"the text does not say of which node its curves are: name one node "
                f"for each of the {len(curves)}, {len(nodes)} were named",
                path,
            )
        return list(zip(nodes, curves, strict=True))
    twice = {node for node in named if named.count(node) > 1}
    if twice or len(named) < len(curves):
        words = f"node {min(twice)} has two" if twice else "one has no node"
        raise ResultError(f"of {len(curves)} curves {words}", path)
    by_node = dict(zip(named, curves, strict=True))
    missing = [node for node in nodes if node not in by_node]
    if missing:
        there = ", ".join(map(str, by_node))
        raise ResultError(f"no curve of node {missing[0]}, there is {there}", path)
    return [(node, by_node[node]) for node in nodes or by_node]


def _curves(path: Path, options: ReadOptions) -> list[_Curve]:
    curves = []
    for table in read_history_tables(path):
        columns = _stress_columns(table, path, options)
        times_ms = table.values[:, table.x] * MS_PER_S
        curves += [
            _Curve(table.node(column), times_ms, in_pa(table.values[:, column], options, path))
            for column in columns
        ]
    return curves


def _stress_columns(table: HistoryText, path: Path, options: ReadOptions) -> list[int]:
    others = range(table.x + 1, len(table.labels))
    if not table.is_named:
        if len(others) > 1:
            raise ResultError(
                f"{len(table.labels)} columns without names: which is time, and which "
                "von Mises stress, is not said",
                path,
                table.line,
            )
        above = f"; above them: {' / '.join(table.header)[:200]!r}" * bool(table.header)
        options.note(f"columns without names, taken as time in s and von Mises stress{above}")
        return list(others)
    if not table.is_over_time:
        raise ResultError(
            f"over {table.labels[table.x]!r}, a trace needs Time there", path, table.line
        )
    columns = [k for k in others if _VON_MISES.search(table.labels[k])]
    left = ", ".join(repr(table.labels[k]) for k in others if k not in columns)
    if not columns:
        raise ResultError(f"no von Mises stress in it, but {left}", path, table.line)
    if left:
        options.note(f"no von Mises stress, left out: {left}")
    return columns
