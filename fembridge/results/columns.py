"""A table or a VTK series of any program, its columns or arrays named by the user.

``--columns time=t,value=S_Mises`` says which column is what:

``time``, ``time_ms``  in s, as solvers have it, or in ms; the ending of a name goes before: t_ms
``value``              von Mises stress; or an array with a tensor
``xx`` ... ``zx``      or a tensor, component by component
``node``, ``afferent`` whose it is; a table's columns of these names are taken unasked;
                       without them it is of one place, node 1

Only these arrays are read, each after its size is known from a header.

Stress is in `ReadOptions.stress_unit`, unless the name of the column says it, each of six its
own: ``S_pa``, ``Mises [kPa]``. Of CSV, lines of ``%``, ``#`` or nothing come before the header,
as COMSOL and code_aster write it. An NPZ has arrays ``(T,)``, ``(T, node)`` or of tensors
``(T, node, 6)``.
A series is a PVD of VTU files, one VTU, or XDMF; its time is that of the PVD or XDMF, under
any name, in ms of a PVD that we wrote; nodes are the points, from 1, or what the array ``node``
says.

Tensors are xx yy zz xy yz zx, VTK's order; nine numbers are a whole one; XDMF's Tensor6 is
xx xy xz yy yz zz (xdmf.org, "XDMF Model and Format", Attribute).
"""

import math
import warnings
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fembridge.errors import FembridgeWarning, ResultError, TableError, UsageError
from fembridge.memory import check_memory, check_unpacked
from fembridge.npz import COPIES, NpzFile, shapes_text
from fembridge.results.byte_file import ByteFile, suffix_of
from fembridge.results.fields import TIMES_IN_MS, rows_of
from fembridge.results.history import History
from fembridge.results.read_options import PA_PER_UNIT, ReadOptions, in_pa
from fembridge.results.series import Frame, Series
from fembridge.results.source import Source
from fembridge.results.stress import TENSOR
from fembridge.results.vtk_xml import VtuSeries
from fembridge.results.xdmf import XdmfSeries
from fembridge.store import near_hint
from fembridge.tables import AFFERENTS, check_stress_unit, header_in, ms_per, pa_per, samples_in
from fembridge.typing import BoolArray, FloatArray, IntArray, Table

VALUES = ("value", *TENSOR)
KEYS = ("time", "time_ms", *VALUES, "node", "afferent")

_MOST_BYTES = 1 << 28  # of a file
_HEADER_BYTES = 1 << 20  # of a table, lines above its header included
_START_BYTES = 1 << 10
_NO_WHOLE = 2.0**53  # from here on a float is not every whole number
_FULL = [0, 4, 8, 1, 5, 2]  # of nine, row by row
_XDMF_ORDER = [0, 3, 5, 1, 4, 2]


def check_units(columns: Mapping[str, str]) -> None:
    """Refuse columns of stress that say a unit which is none."""
    for key in VALUES:
        check_stress_unit(columns.get(key, ""))


def stress_units_in(columns: Mapping[str, str], unit: str) -> tuple[str, bool]:
    """The units of columns of stress, `unit` where a name has none, and whether one has none."""
    said = [pa_per(columns[key]) for key in VALUES if key in columns] or [None]
    units = {pa: name for name, pa in (PA_PER_UNIT | {"GPa": 1e9}).items()}
    words = dict.fromkeys(unit if pa is None else units[pa] for pa in said)
    return ", ".join(words), None in said


class ColumnSource(Source):
    """An open table or series."""

    def __init__(self, file: ByteFile, options: ReadOptions) -> None:
        super().__init__(file, options)
        suffix = suffix_of(self.path)
        self.kind = {".csv": "table", ".npz": "npz"}.get(suffix, "vtk-series")
        if self.kind != "table" and self.path.suffix.lower() == ".gz":
            raise ResultError(f"a packed {suffix} is not read: gunzip it first", self.path)
        if file.size > _MOST_BYTES:
            raise ResultError(f"more than {_MOST_BYTES} bytes, which no table has", self.path)

    def describe(self) -> Table:
        """Names of columns, or arrays with their shapes: what ``--columns`` can name."""
        return {"format": self.kind, "bytes": self.file.size} | self._held

    @cached_property
    def _held(self) -> Table:
        if self.kind == "table":
            text = self.file.peek(0, _HEADER_BYTES).decode("utf-8-sig", errors="replace")
            return {"columns": header_in(text, self.path)[0]}
        if self.kind == "npz":
            with self._npz() as archive:
                return {"arrays": shapes_text(archive.headers)}
        with self._series() as series, series.frame(0) as first:
            arrays = [f"{name} {shape[1:] or ''}".strip() for name, shape in first.shapes.items()]
            return {
                "points": series.count(),
                "outputs": len(series.times),
                "first at": series.times[0],
                "arrays": arrays,
            }

    def named_nodes(self) -> Sequence[int]:
        """The nodes of a table whose columns are named."""
        named = self.options.columns and self.kind != "vtk-series"
        return self._parts.nodes.tolist() if named else ()

    def stress(self, nodes: Sequence[int] | None) -> History:
        """Stress as the columns say, at `nodes` or all."""
        if self.kind == "vtk-series":
            at, number, values, afferents = self._of_series(self._names, nodes)
        else:
            at, number, values, afferents = self._parts
            if nodes is not None:
                rows = self._rows(nodes, number)
                number, values = number[rows], values[:, rows]
                afferents = tuple(afferents[row] for row in rows) if afferents else ()
        ours = self.kind == "vtk-series" and TIMES_IN_MS.encode() in self.file.peek(0, _START_BYTES)
        in_ms = "time_ms" in self.options.columns
        to_ms = 1.0 if ours else ms_per(self._time, in_ms, self.options.note)
        with np.errstate(over="ignore"):
            at_ms = at * to_ms
        if not np.isfinite(at_ms).all():
            row = int(np.argmin(np.isfinite(at_ms)))
            raise ResultError(
                f"the time of sample {row + 1} is {at[row]:g}, expected a finite time in ms",
                self.path,
            )
        stress_pa = self._stress_pa(values)
        if stress_pa.shape[2] == 1 and stress_pa.size and (least_pa := stress_pa.min()) < 0:
            doubt = f"{self.path}: a von Mises stress of {least_pa:g} Pa, which is never negative"
            warnings.warn(doubt, FembridgeWarning, stacklevel=2)
        history = History.of_stress(number, at_ms, stress_pa, self.path)
        return replace(history, afferents=afferents)

    def _rows(self, nodes: Sequence[int], number: IntArray) -> IntArray:
        """Rows of `nodes` in the numbers of a file, where each of them must be once."""
        requested = np.array(nodes, dtype=np.int64)
        rows = rows_of(requested, number)
        if (rows < 0).any():
            raise ResultError(
                f"no node {requested[int(np.argmin(rows))]} in it, it has {number.min()} to "
                f"{number.max()}",
                self.path,
            )
        numbers, counts = np.unique(number[np.isin(number, requested)], return_counts=True)
        if (counts > 1).any():
            raise ResultError(
                f"node {numbers[int(counts.argmax())]} is in it {counts.max()} times; without "
                "node=NAME in --columns, nodes are numbered from 1 as they come",
                self.path,
            )
        return rows

    def places(self) -> tuple[IntArray, FloatArray, BoolArray]:
        """Numbers and coordinates ``(n, 3)`` of the points of a series, in mm; all have stress."""
        if self.kind != "vtk-series":
            return super().places()
        with self._series() as series, series.frame(0) as first:
            points = series.points()
            number = self._numbers(first, len(points), self.options.columns)
        points_mm = np.zeros((len(points), 3))
        points_mm[:, : points.shape[1]] = points * self.options.length_mm
        return number, points_mm, np.ones(len(points), dtype=np.bool_)

    @cached_property
    def _parts(self) -> "_Parts":
        return (self._of_table if self.kind == "table" else self._of_npz)(self._names)

    @property
    def _time(self) -> str:
        """The name of the time."""
        return self._names.get("time", self._names.get("time_ms", "time"))

    @cached_property
    def _names(self) -> Mapping[str, str]:
        names, held = self.options.columns, self._held
        words = ", ".join(held.get("columns") or held["arrays"])
        if not names:
            raise ResultError(
                f"which column is what? --columns time=NAME,value=NAME; it holds {words}", self.path
            )
        of_series, columns = self.kind == "vtk-series", held.get("columns", [])
        there = [key for key in ("node", "afferent") if columns.count(key) == 1]
        names = {key: key for key in there if key not in names.values()} | dict(names)
        if unknown := [key for key in names if key not in KEYS]:
            raise UsageError(f"column {unknown[0]!r}, expected one of {', '.join(KEYS)}")
        tensor = [key for key in TENSOR if key in names]
        if ("value" in names) == bool(tensor) or len(tensor) not in (0, len(TENSOR)):
            raise UsageError(f"name value, or all of {', '.join(TENSOR)}")
        if not of_series and ("time" in names) == ("time_ms" in names):
            raise UsageError("name one of time (in s) and time_ms")
        arrays = [one.partition(" ")[0] if of_series else one for one in words.split(", ")]
        for key, name in names.items():
            timed = of_series and key in ("time", "time_ms")
            if not timed and name not in arrays and name not in words.split(", "):
                hint = near_hint(name, arrays)
                raise ResultError(f"no column {name!r} ({key}); it holds {words}{hint}", self.path)
        return names

    def _stress_pa(self, values: FloatArray) -> FloatArray:
        if not np.isfinite(values).all():
            row, place, _ = np.argwhere(~np.isfinite(values))[0].tolist()
            raise ResultError(f"sample {row + 1} of place {place + 1} is no number", self.path)
        columns, unit = self.options.columns, self.options.stress_unit
        named = [pa_per(columns[key]) for key in VALUES if key in columns]
        if not any(named):
            return in_pa(values, self.options, self.path)
        with np.errstate(over="ignore"):
            values = values * np.array([each or PA_PER_UNIT[unit] for each in named])
        return in_pa(values, replace(self.options, stress_unit="Pa"), self.path)

    # --- CSV

    def _of_table(self, names: Mapping[str, str]) -> "_Parts":
        asked = {key: [names[key]] for key in ("node", "afferent") if key in names}
        values = [names[key] for key in VALUES if key in names]
        asked |= {"time": [self._time], "value": values}
        try:
            samples, error_of = samples_in(self.file.place, asked, named=True)
        except TableError as error:
            raise ResultError(error.problem, self.path, error.line) from error
        if "node" not in samples:
            samples["node"] = 1
        samples = samples.sort_values("node", kind="stable")
        nodes, counts = np.unique(samples["node"], return_counts=True)
        if (counts != counts[0]).any():
            few = f"node {nodes[counts.argmin()]} has fewest"
            raise ResultError(f"nodes have {counts.min()} rows and more: {few}", self.path)
        times = samples["time"].to_numpy().reshape(nodes.size, -1)
        if (times != times[0]).any():
            row, at = np.argwhere(times != times[0])[0]
            words = f"node {nodes[row]} has other times than {nodes[0]}"
            line = error_of(samples.index[row * counts[0] + at], words).line
            raise ResultError(words, self.path, line)
        classes: tuple[str, ...] = ()
        if "afferent" in samples:
            classes = tuple(map(str, samples["afferent"].iloc[:: counts[0]]))
        held = samples[list(range(len(values)))].to_numpy().reshape(nodes.size, counts[0], -1)
        return _Parts(times[0], nodes, held.transpose(1, 0, 2), classes)

    # --- NPZ

    def _npz(self) -> NpzFile:
        return NpzFile(self.path, ResultError.at(self.path))

    def _of_npz(self, names: Mapping[str, str]) -> "_Parts":
        with self._npz() as archive:
            reals = {
                key: archive.read_reals(name) for key, name in names.items() if key != "afferent"
            }
            afferents = archive.read_texts(names["afferent"]) if "afferent" in names else []
        time = reals["time" if "time" in reals else "time_ms"]
        if time.size != max(time.shape, default=1):
            raise self._no_fit(f"{self._time} of shape {time.shape}, expected (T,)")
        time = time.reshape(-1)
        if not time.size:
            raise ResultError("no time in it", self.path)
        parts = []
        for key in VALUES:
            if key not in reals:
                continue
            part = reals[key]
            if part.shape[:1] != time.shape or (key != "value" and part.ndim > 2):
                raise self._no_fit(f"{names[key]} of shape {part.shape} for {time.size} times")
            parts.append(part[:, None] if part.ndim == 1 else part)
        if len({part.shape for part in parts}) > 1:
            raise self._no_fit(f"components of a tensor {sorted({part.shape for part in parts})}")
        values = parts[0] if parts[0].ndim > 2 else np.stack(parts, -1)
        values = _tensors(values, self.path)
        number = _whole(reals.get("node", np.arange(values.shape[1]) + 1), self.path)
        if number.shape != values.shape[1:2]:
            raise self._no_fit(f"{number.shape} nodes for values {values.shape}")
        if afferents and len(afferents) != number.size:
            raise self._no_fit(f"{len(afferents)} afferents for {number.size} nodes")
        for name in afferents:
            if name not in ("", *AFFERENTS):
                expected = ", ".join(AFFERENTS)
                raise ResultError(f"afferent {name[:40]!r}, expected {expected}", self.path)
        return _Parts(time, number, values, tuple(afferents))

    def _no_fit(self, problem: str) -> ResultError:
        return ResultError(f"shapes do not fit: {problem}", self.path)

    # --- VTU, PVD, XDMF

    def _series(self) -> Series:
        series = (XdmfSeries if self.path.suffix.lower() == ".xdmf" else VtuSeries)(self.path)
        if not series.times:
            series.__exit__()
            raise ResultError("no time in it", self.path)
        return series

    def _of_series(self, names: Mapping[str, str], nodes: Sequence[int] | None) -> "_Parts":
        """Values at `nodes`, or at all points, of each output."""
        with self._series() as series:
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
                number = self._numbers(first, point_count, names)
                rows = None if nodes is None else self._rows(nodes, number)
            values = np.empty((len(series.times), size, 0))
            for output, time in enumerate(series.times):
                if (earlier := outputs[keys[output]]) < output:
                    values[output] = values[earlier]
                    continue
                with series.frame(output) as frame:
                    stress = self._frame_values(frame, arrays, point_count, time)
                    if node_keys[output] != node_keys[0] and not np.array_equal(
                        self._numbers(frame, point_count, names), number
                    ):
                        raise ResultError(f"other nodes at {time:g} than before", self.path)
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
            warnings.warn(f"{self.path}: {doubt}", FembridgeWarning, stacklevel=2)
        selected = number if rows is None else number[rows]
        return _Parts(np.array(series.times), selected, values)

    def _check_sizes(
        self, series: Series, first: Frame, arrays: Sequence[str], outputs: int, nodes: int
    ) -> None:
        """Refuse a series whose arrays unpack to more than the limits."""
        error = ResultError.at(self.path)
        for name in arrays:
            if name not in first.shapes:
                raise error(f"no {name} at {series.times[0]:g}")
        shapes = [first.shapes[name] for name in arrays]
        frame_bytes = 8 * (series.count() + sum(map(math.prod, shapes)))
        check_unpacked(series.packed_bytes(), outputs * frame_bytes, "the series", error, copies=0)
        at_node = sum(math.prod(shape[1:]) for shape in shapes)
        history_bytes = 8 * len(series.times) * nodes * at_node
        check_memory(COPIES * (frame_bytes + history_bytes), "the series", error)

    def _frame_values(
        self, frame: Frame, arrays: Sequence[str], points: int, time: float
    ) -> FloatArray:
        """Stress of an output, ``(point, component)``."""
        columns = []
        for name in arrays:
            if name not in frame.shapes:
                raise ResultError(f"no {name} at {time:g}", self.path)
            if frame.shapes[name][:1] != (points,):
                shape = frame.shapes[name]
                raise ResultError(f"{name} at {time:g} has shape {shape}, not {points}", self.path)
            columns.append(frame.read(name).reshape(points, -1))
        if len(columns) > 1 and any(column.shape[1] != 1 for column in columns):
            raise ResultError(f"components of a tensor at {time:g} are no scalars", self.path)
        is_xdmf = self.path.suffix.lower() == ".xdmf" and len(columns) == 1
        return _tensors(np.hstack(columns), self.path, not is_xdmf)

    def _numbers(self, frame: Frame, count: int, names: Mapping[str, str]) -> IntArray:
        if not count:
            raise ResultError("no points in it", self.path)
        if "node" not in names:
            return np.arange(1, count + 1)
        name = names["node"]
        if math.prod(frame.shapes.get(name, ())) != count or name not in frame.shapes:
            raise ResultError(f"no {name} of {count} points in it", self.path)
        return _whole(np.reshape(frame.read(name), -1), self.path)


class _Parts(NamedTuple):
    """Times ``(T,)`` and nodes; values ``(T, node, component)``; classes."""

    at: FloatArray
    nodes: IntArray
    values: FloatArray
    afferents: tuple[str, ...] = ()


def _whole(numbers: FloatArray | IntArray, path: Path) -> IntArray:
    """Numbers of nodes, which some programs write as reals."""
    reals = np.asarray(numbers, dtype=np.float64)
    with np.errstate(invalid="ignore"):
        whole = (reals % 1 == 0) & (np.abs(reals) < _NO_WHOLE)
    if not whole.all():
        raise ResultError(f"node {reals.flat[np.argmin(whole)]:g}, expected whole numbers", path)
    if reals.size and reals.min() < 0:
        raise ResultError(f"node {reals.min():g}, expected 0 or more", path)
    return reals.astype(np.int64)


def _tensors(values: FloatArray, path: Path, vtk: bool = True) -> FloatArray:
    """``(..., 1)`` or ``(..., 6)`` of one, six or nine components, or three by three."""
    if values.shape[-2:] == (3, 3):
        values = values.reshape(*values.shape[:-2], 9)
    count = values.shape[-1]
    if count not in (1, 6, 9):
        raise ResultError(f"{count} components, expected 1, or 6 or 9 of a tensor", path)
    if count == 9:
        return values[..., _FULL]
    return values if vtk or count == 1 else values[..., _XDMF_ORDER]
