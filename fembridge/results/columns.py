"""A table or a VTK series of any program, with columns or arrays that the user names.

``--columns time=t,value=S_Mises`` assigns columns to quantities:

``time``, ``time_ms``  time in s or in ms; a unit in the column name takes precedence: t_ms
``value``              von Mises stress, or an array of tensors
``xx`` ... ``zx``      the components of a tensor
``node``, ``afferent`` node and afferent class of a row; columns of a table with these names are
                       used without assignment; without them all rows are of node 1

Only these arrays are read, after their sizes are known from a header.

Stress is in `ReadOptions.stress_unit` unless the column name has a unit, for each of six
components separately: ``S_pa``, ``Mises [kPa]``. In a CSV, blank lines and lines that begin with
``%`` or ``#`` may precede the header, as COMSOL and code_aster write it. An NPZ has arrays
``(T,)``, ``(T, node)`` or, for tensors, ``(T, node, 6)``.

A series is a PVD of VTU files, one VTU, or XDMF. Its time is that of the PVD or XDMF, with any
name in ``--columns``; a PVD written by fembridge is in ms. Nodes are the points, numbered from 1,
or the array ``node``.

Tensors have VTK's order, xx yy zz xy yz zx; nine numbers are a full tensor; XDMF's Tensor6 is
xx xy xz yy yz zz (xdmf.org, "XDMF Model and Format", Attribute).
"""

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fembridge.errors import ResultError, TableError, UsageError, warn
from fembridge.host.memory import check_memory, check_unpacked
from fembridge.host.store import near_hint
from fembridge.io.column_units import check_stress_unit, ms_per, pa_per
from fembridge.io.npz import COPIES, NpzFile, shapes_text
from fembridge.io.text_table import header_in
from fembridge.io.trace_table import samples_in
from fembridge.results.byte_file import ByteFile, suffix_of
from fembridge.results.fields import TIMES_IN_MS, rows_of
from fembridge.results.history import History
from fembridge.results.read_options import PA_PER_UNIT, ReadOptions, in_pa
from fembridge.results.series import Frame, Series
from fembridge.results.source import Source
from fembridge.results.von_mises import TENSOR
from fembridge.results.vtk_xml import VtuSeries
from fembridge.results.xdmf import XdmfSeries
from fembridge.trace import AFFERENTS
from fembridge.typing import BoolArray, FloatArray, IntArray, Table

VALUES = ("value", *TENSOR)
KEYS = ("time", "time_ms", *VALUES, "node", "afferent")

_MAX_FILE_BYTES = 1 << 28  # of a file
_HEADER_BYTES = 1 << 20  # of a table, with lines above its header
_START_BYTES = 1 << 10
_FIRST_INEXACT = 2.0**53  # a float does not represent all whole numbers from here on
_NINE_ORDER = [0, 4, 8, 1, 5, 2]  # of nine, row by row
_XDMF_ORDER = [0, 3, 5, 1, 4, 2]


def check_units(columns: Mapping[str, str]) -> None:
    """Raise a `UsageError` for stress columns whose names have an unknown unit."""
    for key in VALUES:
        check_stress_unit(columns.get(key, ""))


def stress_units_in(columns: Mapping[str, str], unit: str) -> tuple[str, bool]:
    """Units of the stress columns (`unit` for names without one), and whether one has none."""
    factors = [pa_per(columns[key]) for key in VALUES if key in columns] or [None]
    units = {pa: name for name, pa in (PA_PER_UNIT | {"GPa": 1e9}).items()}
    names = dict.fromkeys(unit if pa is None else units[pa] for pa in factors)
    return ", ".join(names), None in factors


class ColumnSource(Source):
    """An open table or series."""

    def __init__(self, file: ByteFile, options: ReadOptions) -> None:
        super().__init__(file, options)
        suffix = suffix_of(self.path)
        self.kind = {".csv": "table", ".npz": "npz"}.get(suffix, "vtk-series")
        if self.kind != "table" and self.path.suffix.lower() == ".gz":
            raise ResultError(f"a packed {suffix} is not supported: gunzip it first", self.path)
        if file.size > _MAX_FILE_BYTES:
            raise ResultError(f"larger than the limit of {_MAX_FILE_BYTES} bytes", self.path)

    def describe(self) -> Table:
        """Names of columns, or arrays with their shapes, for ``--columns``."""
        return {"format": self.kind, "bytes": self.file.size} | self._contents

    @cached_property
    def _contents(self) -> Table:
        if self.kind == "table":
            text = self.file.peek(0, _HEADER_BYTES).decode("utf-8-sig", errors="replace")
            return {"columns": header_in(text, self.path)[0]}
        if self.kind == "npz":
            with self._open_npz() as archive:
                return {"arrays": shapes_text(archive.headers)}
        with self._open_series() as series, series.frame(0) as first:
            arrays = [f"{name} {shape[1:] or ''}".strip() for name, shape in first.shapes.items()]
            return {
                "points": series.count(),
                "outputs": len(series.times),
                "first at": series.times[0],
                "arrays": arrays,
            }

    def named_nodes(self) -> Sequence[int]:
        """Nodes of a table with assigned columns."""
        named = self.options.columns and self.kind != "vtk-series"
        return self._samples.nodes.tolist() if named else ()

    def stress(self, nodes: Sequence[int] | None) -> History:
        """Stress of the assigned columns at `nodes`, or at all nodes."""
        if self.kind == "vtk-series":
            times, numbers, values, afferents = self._read_series(self._names, nodes)
        else:
            times, numbers, values, afferents = self._samples
            if nodes is not None:
                rows = self._rows(nodes, numbers)
                numbers, values = numbers[rows], values[:, rows]
                afferents = tuple(afferents[row] for row in rows) if afferents else ()
        is_fembridge_pvd = self.kind == "vtk-series" and TIMES_IN_MS.encode() in self.file.peek(
            0, _START_BYTES
        )
        in_ms = "time_ms" in self.options.columns
        to_ms = 1.0 if is_fembridge_pvd else ms_per(self._time_name, in_ms, self.options.note)
        with np.errstate(over="ignore"):
            times_ms = times * to_ms
        if not np.isfinite(times_ms).all():
            row = int(np.argmin(np.isfinite(times_ms)))
            raise ResultError(
                f"the time of sample {row + 1} is {times[row]:g}, expected a finite time in ms",
                self.path,
            )
        stress_pa = self._stress_pa(values)
        if stress_pa.shape[2] == 1 and stress_pa.size and (lowest_pa := stress_pa.min()) < 0:
            warn(f"negative von Mises stress of {lowest_pa:g} Pa", self.path)
        history = History.from_stress(numbers, times_ms, stress_pa, self.path)
        return replace(history, afferents=afferents)

    def _rows(self, nodes: Sequence[int], number: IntArray) -> IntArray:
        """Rows of `nodes` in the numbers of a file; a missing or duplicate node raises."""
        requested = np.array(nodes, dtype=np.int64)
        rows = rows_of(requested, number)
        if (rows < 0).any():
            raise ResultError(
                f"no node {requested[int(np.argmin(rows))]}; the file has {number.min()} to "
                f"{number.max()}",
                self.path,
            )
        numbers, counts = np.unique(number[np.isin(number, requested)], return_counts=True)
        if (counts > 1).any():
            raise ResultError(
                f"node {numbers[int(counts.argmax())]} occurs {counts.max()} times; without "
                "node=NAME in --columns, points are numbered from 1",
                self.path,
            )
        return rows

    def node_positions(self) -> tuple[IntArray, FloatArray, BoolArray]:
        """Numbers and coordinates ``(n, 3)`` in mm of the points of a series; all have stress."""
        if self.kind != "vtk-series":
            return super().node_positions()
        with self._open_series() as series, series.frame(0) as first:
            points = series.points()
            number = self._frame_nodes(first, len(points), self.options.columns)
        points_mm = np.zeros((len(points), 3))
        points_mm[:, : points.shape[1]] = points * self.options.length_mm
        return number, points_mm, np.ones(len(points), dtype=np.bool_)

    @cached_property
    def _samples(self) -> "_Samples":
        return (self._read_table if self.kind == "table" else self._read_npz)(self._names)

    @property
    def _time_name(self) -> str:
        """Name of the time column."""
        return self._names.get("time", self._names.get("time_ms", "time"))

    @cached_property
    def _names(self) -> Mapping[str, str]:
        names, contents = self.options.columns, self._contents
        available = ", ".join(contents.get("columns") or contents["arrays"])
        if not names:
            raise ResultError(
                f"is missing: name columns as time=NAME,value=NAME; the file has {available}",
                self.path,
                argument="columns",
            )
        is_series, columns = self.kind == "vtk-series", contents.get("columns", [])
        automatic = [key for key in ("node", "afferent") if columns.count(key) == 1]
        names = {key: key for key in automatic if key not in names.values()} | dict(names)
        if unknown := [key for key in names if key not in KEYS]:
            raise UsageError(f"has {unknown[0]!r}, expected {', '.join(KEYS)}", argument="columns")
        tensor = [key for key in TENSOR if key in names]
        if ("value" in names) == bool(tensor) or len(tensor) not in (0, len(TENSOR)):
            raise UsageError(f"needs value, or all of {', '.join(TENSOR)}", argument="columns")
        if not is_series and ("time" in names) == ("time_ms" in names):
            raise UsageError("needs one of time (in s) and time_ms", argument="columns")
        arrays = [
            entry.partition(" ")[0] if is_series else entry for entry in available.split(", ")
        ]
        for key, name in names.items():
            is_time = is_series and key in ("time", "time_ms")
            if not is_time and name not in arrays and name not in available.split(", "):
                hint = near_hint(name, arrays)
                raise ResultError(
                    f"no column {name!r} ({key}); the file has {available}{hint}", self.path
                )
        return names

    def _stress_pa(self, values: FloatArray) -> FloatArray:
        if not np.isfinite(values).all():
            row, column, _ = np.argwhere(~np.isfinite(values))[0].tolist()
            raise ResultError(
                f"sample {row + 1} of series {column + 1} is not a finite number", self.path
            )
        columns, unit = self.options.columns, self.options.stress_unit
        factors = [pa_per(columns[key]) for key in VALUES if key in columns]
        if not any(factors):
            return in_pa(values, self.options, self.path)
        with np.errstate(over="ignore"):
            values = values * np.array([factor or PA_PER_UNIT[unit] for factor in factors])
        return in_pa(values, replace(self.options, stress_unit="Pa"), self.path)

    # --- CSV

    def _read_table(self, names: Mapping[str, str]) -> "_Samples":
        requested = {key: [names[key]] for key in ("node", "afferent") if key in names}
        values = [names[key] for key in VALUES if key in names]
        requested |= {"time": [self._time_name], "value": values}
        try:
            samples, error_of = samples_in(self.file.data_path, requested, named=True)
        except TableError as error:
            failure = ResultError.from_error(error)
            failure.path = self.path
            raise failure from error
        if "node" not in samples:
            samples["node"] = 1
        samples = samples.sort_values("node", kind="stable")
        nodes, counts = np.unique(samples["node"], return_counts=True)
        if (counts != counts[0]).any():
            fewest = f"node {nodes[counts.argmin()]} has fewest"
            raise ResultError(f"nodes have {counts.min()} rows and more: {fewest}", self.path)
        times = samples["time"].to_numpy().reshape(nodes.size, -1)
        if (times != times[0]).any():
            row, sample = np.argwhere(times != times[0])[0]
            message = f"node {nodes[row]} has other times than {nodes[0]}"
            line = error_of(samples.index[row * counts[0] + sample], message).line
            raise ResultError(message, self.path, line)
        classes: tuple[str, ...] = ()
        if "afferent" in samples:
            classes = tuple(map(str, samples["afferent"].iloc[:: counts[0]]))
        stress = samples[list(range(len(values)))].to_numpy().reshape(nodes.size, counts[0], -1)
        return _Samples(times[0], nodes, stress.transpose(1, 0, 2), classes)

    # --- NPZ

    def _open_npz(self) -> NpzFile:
        return NpzFile(self.path, ResultError.at(self.path))

    def _read_npz(self, names: Mapping[str, str]) -> "_Samples":
        with self._open_npz() as archive:
            reals = {
                key: archive.read_reals(name) for key, name in names.items() if key != "afferent"
            }
            afferents = archive.read_texts(names["afferent"]) if "afferent" in names else []
        time = reals["time" if "time" in reals else "time_ms"]
        if time.size != max(time.shape, default=1):
            raise self._shape_error(f"{self._time_name} has shape {time.shape}, expected (T,)")
        time = time.reshape(-1)
        if not time.size:
            raise ResultError("no time in it", self.path)
        parts = []
        for key in VALUES:
            if key not in reals:
                continue
            part = reals[key]
            if part.shape[:1] != time.shape or (key != "value" and part.ndim > 2):
                raise self._shape_error(f"{names[key]} of shape {part.shape} for {time.size} times")
            parts.append(part[:, None] if part.ndim == 1 else part)
        if len({part.shape for part in parts}) > 1:
            raise self._shape_error(
                f"components of a tensor {sorted({part.shape for part in parts})}"
            )
        values = parts[0] if parts[0].ndim > 2 else np.stack(parts, -1)
        values = _to_tensors(values, self.path)
        number = _node_numbers(reals.get("node", np.arange(values.shape[1]) + 1), self.path)
        if number.shape != values.shape[1:2]:
            raise self._shape_error(f"nodes {number.shape} for values {values.shape}")
        if afferents and len(afferents) != number.size:
            raise self._shape_error(f"{len(afferents)} afferents for {number.size} nodes")
        for name in afferents:
            if name not in ("", *AFFERENTS):
                expected = ", ".join(AFFERENTS)
                raise ResultError(f"afferent {name[:40]!r}, expected {expected}", self.path)
        return _Samples(time, number, values, tuple(afferents))

    def _shape_error(self, problem: str) -> ResultError:
        return ResultError(f"inconsistent shapes: {problem}", self.path)

    # --- VTU, PVD, XDMF

    def _open_series(self) -> Series:
        series = (XdmfSeries if self.path.suffix.lower() == ".xdmf" else VtuSeries)(self.path)
        if not series.times:
            series.__exit__()
            raise ResultError("no time in it", self.path)
        return series

    def _read_series(self, names: Mapping[str, str], nodes: Sequence[int] | None) -> "_Samples":
        """Values at `nodes`, or at all points, at each output."""
        with self._open_series() as series:
            arrays = [names[key] for key in VALUES if key in names]
            counts = [names["node"]] if "node" in names else []
            outputs: dict[Hashable, int] = {}
            keys = [series.key(output, arrays) for output in range(len(series.times))]
            node_keys = [series.key(output, counts) for output in range(len(series.times))]
            for output, key in enumerate(keys):
                outputs.setdefault(key, output)
            point_count = series.count()
            doubts = series.doubts(arrays)
            with series.frame(0) as first:
                size = point_count if nodes is None else len(nodes)
                self._check_sizes(series, first, arrays, len(outputs), size)
                number = self._frame_nodes(first, point_count, names)
                rows = None if nodes is None else self._rows(nodes, number)
            values = np.empty((len(series.times), size, 0))
            for output, time in enumerate(series.times):
                if (earlier := outputs[keys[output]]) < output:
                    values[output] = values[earlier]
                    continue
                with series.frame(output) as frame:
                    stress = self._frame_values(frame, arrays, point_count, time)
                    if node_keys[output] != node_keys[0] and not np.array_equal(
                        self._frame_nodes(frame, point_count, names), number
                    ):
                        raise ResultError(f"other nodes at time {time:g} than before", self.path)
                stress = stress if rows is None else stress[rows]
                if not output:
                    values = np.empty((len(series.times), *stress.shape))
                if stress.shape != values.shape[1:]:
                    raise ResultError(
                        f"{stress.shape[1]} components at {time:g}, before {values.shape[2]}",
                        self.path,
                    )
                values[output] = stress
        if len(outputs) < len(keys):
            second = next(output for output, key in enumerate(keys) if outputs[key] < output)
            first_time, time = series.times[outputs[keys[second]]], series.times[second]
            doubts.append(f"outputs at {first_time:g} and {time:g} are the same data")
        for doubt in doubts:
            warn(doubt, self.path)
        selected = number if rows is None else number[rows]
        return _Samples(np.array(series.times), selected, values)

    def _check_sizes(
        self, series: Series, first: Frame, arrays: Sequence[str], outputs: int, nodes: int
    ) -> None:
        """Raise a `ResultError` if the arrays of a series unpack to more than the limits."""
        error = ResultError.at(self.path)
        for name in arrays:
            if name not in first.shapes:
                raise error(f"no {name} at {series.times[0]:g}")
        shapes = [first.shapes[name] for name in arrays]
        frame_bytes = 8 * (series.count() + sum(map(math.prod, shapes)))
        check_unpacked(series.packed_bytes(), outputs * frame_bytes, "the series", error, copies=0)
        node_values = sum(math.prod(shape[1:]) for shape in shapes)
        history_bytes = 8 * len(series.times) * nodes * node_values
        check_memory(COPIES * (frame_bytes + history_bytes), "the series", error)

    def _frame_values(
        self, frame: Frame, arrays: Sequence[str], points: int, time: float
    ) -> FloatArray:
        """Stress at an output, ``(point, component)``."""
        columns = []
        for name in arrays:
            if name not in frame.shapes:
                raise ResultError(f"no {name} at {time:g}", self.path)
            if frame.shapes[name][:1] != (points,):
                shape = frame.shapes[name]
                raise ResultError(
                    f"{name} at {time:g} has shape {shape}, expected {points} points", self.path
                )
            columns.append(frame.read(name).reshape(points, -1))
        if len(columns) > 1 and any(column.shape[1] != 1 for column in columns):
            raise ResultError(f"components of a tensor at {time:g} are not scalars", self.path)
        is_xdmf = self.path.suffix.lower() == ".xdmf" and len(columns) == 1
        return _to_tensors(np.hstack(columns), self.path, not is_xdmf)

    def _frame_nodes(self, frame: Frame, count: int, names: Mapping[str, str]) -> IntArray:
        if not count:
            raise ResultError("no points in it", self.path)
        if "node" not in names:
            return np.arange(1, count + 1)
        name = names["node"]
        if math.prod(frame.shapes.get(name, ())) != count or name not in frame.shapes:
            raise ResultError(f"no array {name} of {count} points", self.path)
        return _node_numbers(np.reshape(frame.read(name), -1), self.path)


class _Samples(NamedTuple):
    """Times ``(T,)``, nodes, values ``(T, node, component)`` and afferent classes."""

    times: FloatArray
    nodes: IntArray
    values: FloatArray
    afferents: tuple[str, ...] = ()


def _node_numbers(numbers: FloatArray | IntArray, path: Path) -> IntArray:
    """Node numbers as integers; some programs write them as reals."""
    reals = np.asarray(numbers, dtype=np.float64)
    with np.errstate(invalid="ignore"):
        is_whole = (reals % 1 == 0) & (np.abs(reals) < _FIRST_INEXACT)
    if not is_whole.all():
        raise ResultError(f"node {reals.flat[np.argmin(is_whole)]:g}, expected whole numbers", path)
    if reals.size and reals.min() < 0:
        raise ResultError(f"node {reals.min():g}, expected 0 or more", path)
    return reals.astype(np.int64)


def _to_tensors(values: FloatArray, path: Path, vtk: bool = True) -> FloatArray:
    """Values ``(..., 1)`` or ``(..., 6)`` from 1, 6, 9 or three by three components."""
    if values.shape[-2:] == (3, 3):
        values = values.reshape(*values.shape[:-2], 9)
    count = values.shape[-1]
    if count not in (1, 6, 9):
        raise ResultError(f"{count} components, expected 1, or 6 or 9 of a tensor", path)
    if count == 9:
        return values[..., _NINE_ORDER]
    return values if vtk or count == 1 else values[..., _XDMF_ORDER]
