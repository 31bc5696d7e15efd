"""A table or a VTK series of any program, its columns or arrays named by the user.

``--columns time=t,value=S_Mises`` says which column is what:

``time``, ``time_ms``  in s, as solvers have it, or in ms; the ending of a name goes before: t_ms
``value``              von Mises stress; or an array with a tensor
``xx`` ... ``zx``      or a tensor, component by component
``node``, ``afferent`` whose it is; a table's columns of these names are taken unasked;
                       without them it is of one place, node 1

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

import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from fembridge.errors import FembridgeError, MissingError, ResultError, TableError, UsageError
from fembridge.results.byte_file import ByteFile, suffix_of
from fembridge.results.fields import TIMES_IN_MS, rows_of
from fembridge.results.history import History
from fembridge.results.read_options import PA_PER_UNIT, ReadOptions, in_pa
from fembridge.results.source import Source
from fembridge.results.stress import TENSOR
from fembridge.store import read_bytes
from fembridge.tables import check_stress_unit, header_in, ms_per, pa_per, samples_in
from fembridge.typing import BoolArray, FloatArray, IntArray, Table

VALUES = ("value", *TENSOR)
KEYS = ("time", "time_ms", *VALUES, "node", "afferent")

_MOST_BYTES = 1 << 28  # of a file, and of what an NPZ or an HDF5 holds
_START_BYTES = 1 << 10
_FULL = [0, 4, 8, 1, 5, 2]  # of nine, row by row
_XDMF_ORDER = [0, 3, 5, 1, 4, 2]

Arrays = Mapping[str, np.ndarray[Any, Any]]
Frames = Iterator[tuple[float, Arrays]]


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
            text = self.file.peek(0, _MOST_BYTES).decode("utf-8-sig", errors="replace")
            return {"columns": header_in(text, self.path)[0]}
        if self.kind == "npz":
            return {"arrays": {name: str(one.shape) for name, one in self._npz.items()}}
        points, count, frames = self._series()
        at, arrays = next(frames)
        shapes = {name: str(one.shape[1:] or "") for name, one in arrays.items()}
        held = [f"{name} {shape}".strip() for name, shape in shapes.items()]
        return {"points": len(points), "outputs": count, "first at": at, "arrays": held}

    def named_nodes(self) -> Sequence[int]:
        """The nodes of a table whose columns are named."""
        named = self.options.columns and self.kind != "vtk-series"
        return self._parts.nodes.tolist() if named else ()

    def stress(self, nodes: Sequence[int] | None) -> History:
        """Stress as the columns say, at `nodes` or all."""
        at, number, values, afferents = self._parts
        if not np.isfinite(at).all():
            row = int(np.argmin(np.isfinite(at)))
            raise ResultError(f"the time of sample {row + 1} is no number", self.path)
        ours = self.kind == "vtk-series" and TIMES_IN_MS.encode() in self.file.peek(0, _START_BYTES)
        in_ms = "time_ms" in self.options.columns
        to_ms = 1.0 if ours else ms_per(self._time, in_ms, self.options.note)
        if nodes is not None:
            wanted = np.array(nodes, dtype=np.int64)
            rows = rows_of(wanted, number)
            if (rows < 0).any():
                raise ResultError(
                    f"no node {wanted[int(np.argmin(rows))]} in it, it has {number.min()} to "
                    f"{number.max()}",
                    self.path,
                )
            number, values = wanted, values[:, rows]
            afferents = tuple(afferents[row] for row in rows) if afferents else ()
        found = History.of_stress(number, at * to_ms, self._stress_pa(values), self.path)
        return replace(found, afferents=afferents)

    def places(self) -> tuple[IntArray, FloatArray, BoolArray]:
        """Numbers and coordinates ``(n, 3)`` of the points of a series, in mm; all have stress."""
        if self.kind != "vtk-series":
            return super().places()
        points, _, frames = self._series()
        number = self._numbers(next(frames)[1], len(points), self.options.columns)
        return number, points * self.options.length_mm, np.ones(len(points), dtype=np.bool_)

    @cached_property
    def _parts(self) -> "_Parts":
        read = {"table": self._of_table, "npz": self._of_npz}.get(self.kind, self._of_series)
        return read(self._names)

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
                raise ResultError(f"no column {name!r} ({key}); it holds {words}", self.path)
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

    @cached_property
    def _npz(self) -> dict[str, np.ndarray[Any, Any]]:
        try:
            with zipfile.ZipFile(self.path) as held:
                if sum(one.file_size for one in held.infolist()) > _MOST_BYTES:
                    raise ResultError(f"unpacks to more than {_MOST_BYTES} bytes", self.path)
            with np.load(self.path, allow_pickle=False) as arrays:
                found = dict(arrays)
        except (FembridgeError, MemoryError):
            raise
        except Exception as error:  # whatever zipfile, zlib and NumPy do of damage
            raise ResultError(f"no NPZ of numbers: {str(error)[:120]}", self.path) from error
        for name, one in found.items():
            if not isinstance(one, np.ndarray):  # NumPy gives the bytes of what is no array
                raise ResultError(f"no NPZ of numbers: {name} is no array", self.path)
        return found

    def _of_npz(self, names: Mapping[str, str]) -> "_Parts":
        arrays = self._npz
        held = {key: arrays[one] for key, one in names.items() if key != "afferent"}
        for key, one in held.items():
            if not np.can_cast(one.dtype, np.float64, "same_kind"):
                words = f"{names[key]} is of type {one.dtype}, expected real numbers"
                raise ResultError(words, self.path)
        try:
            time = np.array(arrays[self._time], dtype=np.float64).reshape(-1)
            values = _stacked(held)
            values = values[..., 0] if "value" in held else values
            values = values.reshape(time.size, -1, *values.shape[2:])
            if values.ndim == 2:
                values = values[:, :, None]
            values = _tensors(values, self.path)
            number = _whole(held.get("node", np.arange(values.shape[1]) + 1), self.path)
            if number.shape != values.shape[1:2]:
                raise ValueError(f"{number.shape} nodes for values {values.shape}")
        except ValueError as error:
            raise ResultError(f"shapes do not fit: {error}", self.path) from error
        classes = tuple(map(str, arrays[names["afferent"]])) if "afferent" in names else ()
        return _Parts(time, number, values, classes)

    # --- VTU, PVD, XDMF

    def _of_series(self, names: Mapping[str, str]) -> "_Parts":
        points, _, frames = self._series()
        times, found = [], []
        number: IntArray | None = None
        for at, arrays in frames:
            value = _stacked({key: arrays[name] for key, name in names.items() if key in VALUES})
            value = value.reshape(len(points), -1)
            now = self._numbers(arrays, len(points), names)
            if number is not None and not np.array_equal(now, number):
                raise ResultError(f"other nodes at {at:g} than before", self.path)
            number = now
            times.append(at)
            found.append(_tensors(value, self.path, self.path.suffix.lower() != ".xdmf"))
        if number is None:
            raise ResultError("no time in it", self.path)
        return _Parts(np.array(times), number, np.stack(found))

    def _numbers(self, arrays: Arrays, count: int, names: Mapping[str, str]) -> IntArray:
        if "node" not in names:
            return np.arange(1, count + 1)
        return _whole(np.reshape(arrays[names["node"]], -1), self.path)

    def _series(self) -> tuple[FloatArray, int, Frames]:
        """Points ``(P, 3)``, the count of outputs, and of each time and point arrays."""
        path = self.path
        with _meshio(path) as meshio:
            if path.suffix.lower() == ".xdmf":
                series = meshio.xdmf.TimeSeriesReader(path)
                points, _ = series.read_points_cells()
                count = series.num_steps
                outputs = map(series.read_data, range(count))
                frames: Frames = ((at, held) for at, held, _ in outputs)
            else:
                files = _files_of(path) if path.suffix.lower() == ".pvd" else [(0.0, path)]
                points, count = self._mesh(files[0][1]).points, len(files)
                frames = ((at, self._mesh(file).point_data) for at, file in files)
            there = np.zeros((len(points), 3))
            there[:, : points.shape[1]] = points
        return there, count, self._checked(frames)

    def _checked(self, frames: Frames) -> Frames:
        with _meshio(self.path):
            for at, arrays in frames:
                for key, name in self.options.columns.items():
                    if not key.startswith("time") and name not in arrays:
                        raise ResultError(f"no {name} at {at:g}", self.path)
                yield at, arrays

    def _mesh(self, path: Path) -> Any:  # noqa: ANN401 - meshio has no types
        if path.stat().st_size > _MOST_BYTES:
            raise ResultError(f"more than {_MOST_BYTES} bytes", path)
        with _meshio(self.path) as meshio:
            return meshio.read(path)


class _Parts(NamedTuple):
    """Times ``(T,)`` and nodes; values ``(T, node, component)``; classes."""

    at: FloatArray
    nodes: IntArray
    values: FloatArray
    afferents: tuple[str, ...] = ()


def _whole(numbers: Any, path: Path) -> IntArray:  # noqa: ANN401 - an array of any kind
    """Numbers of nodes, which some programs write as reals."""
    found = np.asarray(numbers, dtype=np.float64)
    if not (whole := found % 1 == 0).all():
        raise ResultError(f"node {found.flat[np.argmin(whole)]:g}, expected whole numbers", path)
    return found.astype(np.int64)


def _stacked(held: Mapping[str, Any]) -> FloatArray:
    """The value, or the components of a tensor, along a last axis."""
    parts = [np.asarray(held[key], dtype=np.float64) for key in VALUES if key in held]
    return np.stack(parts, -1)


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


def _files_of(path: Path) -> list[tuple[float, Path]]:
    """Time and file of each entry of a PVD, which may not leave its folder."""
    sets = ElementTree.fromstring(read_bytes(path, 1 << 24, UsageError)).iter("DataSet")
    found = [(float(one.get("timestep", 0)), path.parent / one.get("file", "")) for one in sets]
    for _, file in found:
        if not file.resolve().is_relative_to(path.parent.resolve()):
            raise ResultError(f"{file.name} is not in its folder", path)
    if not found:
        raise ResultError("no DataSet in it", path)
    return found


@contextmanager
def _meshio(path: Path) -> Iterator[Any]:
    """The library that reads `path`; whatever it does of damage is one refusal."""
    try:
        import meshio
    except ImportError as error:
        raise MissingError("no meshio to read VTK or XDMF with: pip install meshio") from error
    try:
        yield meshio
    except (FembridgeError, MemoryError):
        raise
    except (Exception, SystemExit) as error:
        words = f"{type(error).__name__} {error}".strip()[:120]
        raise ResultError(f"no VTK or XDMF that can be read: {words}", path) from error
