"""A data set of touches: a folder of Parquet files, in parts that are whole or absent.

::

    dataset.toml                 rows, parts, version and digest of the table
    rows.parquet                 the table, and a digest of each row
    touches/part-00000.parquet   a row a touch: settings, digests, state, warnings
    spikes/part-00000.parquet    touch, afferent, unit, trial, spike_time_ms
    units/part-00000.parquet     positions of the units of each population
    forces/part-00000.parquet    depth and force over time, at a coarse step

A part is finished when its file in ``touches`` is there: that is written last, and has the
checksums of the others. Parts depend on the table alone, so neither the number of workers nor
an interruption changes a byte. The folder is a local path or an address of fsspec, as
``s3://bucket/set``.
"""

import hashlib
import io
import json
import re
import time
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from fembridge.errors import FembridgeError, MissingError, OutputError, ResultError, UsageError
from fembridge.host.memory import check_memory
from fembridge.host.store import make_folder, remove_abandoned_drafts, replacing
from fembridge.plots.shown import Shown
from fembridge.ranges import check_range
from fembridge.sweeps.touch_study import SETTINGS
from fembridge.typing import FloatArray, IntArray, SingleArray, Table

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from fembridge.plots.style import Panels

FORMAT = 1
ABOUT_FILE, ROWS_FILE, PROGRESS_FILE = "dataset.toml", "rows.parquet", "progress.toml"
TABLES = ("spikes", "forces", "units", "touches")
"""Folders of a data set, in the order in which the files of a part are written."""
DONE, FAILED = "done", "failed"

_WRITES = 3  # attempts
_PAUSE_S = 1.0
_MS_PER_S = 1.0e3
_PART = re.compile(r"part-(\d{5,})\.parquet")
_INSTALL_LINE = "pip install 'fembridge[datasets]'"
_META = b"fembridge"
_COUNT_MAX = np.iinfo(np.uint16).max
_CACHED_PARTS = 4
_ROW_DIGEST_BYTES = 16

RESULTS: Mapping[str, str] = {
    "status": "string",
    "cause": "string",
    "warnings": "strings",
    "population_id": "int64",
    "units": "int64",
    "spikes": "int64",
    "end_ms": "float64",
    "window_start_ms": "float64",
    "window_end_ms": "float64",
    "depth_max_um": "float64",
    "force_max": "float64",
    "force_unit": "string",
    "contact_key": "string",
    "key": "string",
    "settings": "string",
    "pad_sha256": "string",
    "shape_sha256": "string",
    "trajectory_sha256": "string",
    "population_sha256": "string",
    "parameters_sha256": "string",
    "fembridge": "string",
}
"""Columns of ``touches`` after the settings and the user's own, and their types."""

COLUMNS: Mapping[str, Mapping[str, str]] = {
    "spikes": {
        "touch": "int64",
        "afferent": "string",
        "unit": "string",
        "trial": "int32",
        "spike_time_ms": "float64",
    },
    "forces": {
        "touch": "int64",
        "time_ms": "float64",
        "x_mm": "float64",
        "z_mm": "float64",
        "depth_um": "float64",
        "force": "float64",
    },
    "units": {
        "population_id": "int64",
        "unit": "string",
        "afferent": "string",
        "x_mm": "float64",
        "z_mm": "float64",
        "depth_mm": "float64",
        "deviate": "float64",
        "endings_seed": "int64",
    },
}
"""Columns of the tables and their types."""


def arrow() -> Any:  # noqa: ANN401 - a module
    """The module pyarrow, or a MissingError."""
    try:
        import pyarrow
    except ImportError as error:
        raise MissingError(f"a data set of touches needs pyarrow: {_INSTALL_LINE}") from error
    return pyarrow


# ---- Where files are


class Store(Protocol):
    """Files of a data set by their names in it; a file is whole or absent."""

    def read(self, name: str) -> bytes:
        """Content of a file; ``FileNotFoundError`` if it is absent."""

    def write(self, name: str, content: bytes) -> None:
        """Write a file; an OutputError or OSError."""

    def remove(self, name: str) -> None:
        """Remove a file, if it is there."""

    def names(self, folder: str) -> list[str]:
        """Names of the files in a folder of the data set."""


@dataclass(frozen=True, slots=True)
class LocalStore:
    """Files in a local folder."""

    folder: Path

    def read(self, name: str) -> bytes:
        """Content of a file."""
        return (self.folder / name).read_bytes()

    def write(self, name: str, content: bytes) -> None:
        """Write a file under a temporary name and rename it."""
        with replacing(self.folder / name) as draft:
            draft.write_bytes(content)

    def remove(self, name: str) -> None:
        """Remove a file."""
        (self.folder / name).unlink(missing_ok=True)

    def names(self, folder: str) -> list[str]:
        """Names in a folder; drafts of processes that were killed are removed."""
        if not (self.folder / folder).is_dir():
            return []
        remove_abandoned_drafts(self.folder / folder)
        return sorted(path.name for path in (self.folder / folder).iterdir() if path.is_file())

    def __str__(self) -> str:
        return str(self.folder)


@dataclass(frozen=True, slots=True)
class RemoteStore:
    """Files under an address of fsspec; object stores write a file whole or not at all."""

    address: str

    def read(self, name: str) -> bytes:
        """Content of a file."""
        system, path = self._system()
        content: bytes = system.cat_file(f"{path}/{name}")
        return content

    def write(self, name: str, content: bytes) -> None:
        """Put a file."""
        try:
            system, path = self._system()
            parent = f"{path}/{name}".rpartition("/")[0]
            system.makedirs(parent, exist_ok=True)
            system.pipe_file(f"{path}/{name}", content)
        except FembridgeError:
            raise
        except Exception as error:  # each file system has its own errors
            problem = " ".join(f"cannot write: {type(error).__name__}: {error}".splitlines())
            raise OutputError(f"{self.address}/{name}: {problem}") from error

    def remove(self, name: str) -> None:
        """Remove a file."""
        system, path = self._system()
        if system.exists(f"{path}/{name}"):
            system.rm_file(f"{path}/{name}")

    def names(self, folder: str) -> list[str]:
        """Names in a folder."""
        system, path = self._system()
        system.invalidate_cache()
        try:
            listed = system.ls(f"{path}/{folder}", detail=False)
        except FileNotFoundError:
            return []
        return sorted(str(name).rpartition("/")[2] for name in listed)

    def _system(self) -> tuple[Any, str]:
        try:
            import fsspec
        except ImportError as error:
            raise MissingError(f"{self.address} needs fsspec: {_INSTALL_LINE}") from error
        try:
            system, path = fsspec.core.url_to_fs(self.address)
        except ImportError as error:
            raise MissingError(f"{self.address}: {error}") from error
        except ValueError as error:  # an unknown protocol
            raise UsageError(f"is {self.address}: {error}", argument="output") from error
        return system, str(path).rstrip("/")

    def __str__(self) -> str:
        return self.address


@dataclass(frozen=True, slots=True)
class MemoryStore:
    """Files in memory, of a data set that is written nowhere."""

    files: dict[str, bytes] = field(default_factory=dict)

    def read(self, name: str) -> bytes:
        """Content of a file."""
        try:
            return self.files[name]
        except KeyError as error:
            raise FileNotFoundError(name) from error

    def write(self, name: str, content: bytes) -> None:
        """Keep a file."""
        self.files[name] = content

    def remove(self, name: str) -> None:
        """Remove a file."""
        self.files.pop(name, None)

    def names(self, folder: str) -> list[str]:
        """Names in a folder."""
        return sorted(
            name.rpartition("/")[2] for name in self.files if name.rpartition("/")[0] == folder
        )

    def __str__(self) -> str:
        return "in memory"


def store_of(folder: "str | Path") -> Store:
    """Files of a local path, or of an address such as ``s3://bucket/set``."""
    text = str(folder)
    if isinstance(folder, Path) or "://" not in text:
        return LocalStore(Path(text))
    return RemoteStore(text.rstrip("/"))


def is_dataset(path: object) -> bool:
    """Whether `path` is the folder of a data set, or an address."""
    if isinstance(path, str) and "://" in path:
        return True
    return isinstance(path, str | Path) and (Path(path) / ABOUT_FILE).is_file()


def read_about(store: Store) -> Table:
    """Content of ``dataset.toml``.

    Raises
    ------
    ResultError
        It is absent, or of another format.
    """
    path = Path(f"{store}/{ABOUT_FILE}")
    try:
        about = tomllib.loads(store.read(ABOUT_FILE).decode())
    except FileNotFoundError as error:
        raise ResultError("not found: not a data set of touches", path) from error
    except (ValueError, OSError) as error:
        raise ResultError(f"cannot be read: {error}", path) from error
    if about.get("format") != FORMAT:
        raise ResultError(f"format {about.get('format')!r}, expected {FORMAT}", path)
    return about


def write_rows(
    store: Store, digests: Sequence[bytes], settings: Sequence[Mapping[str, Any]]
) -> None:
    """Write ``rows.parquet``: digest and settings of each row, in the order of the touches."""
    arrow_module = arrow()
    columns = {
        "digest": arrow_module.array(digests, arrow_module.binary(_ROW_DIGEST_BYTES)),
        "settings": arrow_module.array(map(settings_text, settings), arrow_module.string()),
    }
    store.write(ROWS_FILE, _parquet(arrow_module.table(columns)))


def settings_text(row: Mapping[str, Any]) -> str | None:
    """Settings of a row as JSON, of which it can be run again; None with Python objects."""
    if not all(isinstance(value, bool | int | float | str) for value in row.values()):
        return None
    return json.dumps(dict(row), sort_keys=True)


def digest_of_rows(digests: Sequence[bytes]) -> str:
    """SHA-256 of the digests of all rows, which is in ``dataset.toml``."""
    return hashlib.sha256(b"".join(digests)).hexdigest()


def read_rows(store: Store) -> tuple[list[bytes], list[str | None]]:
    """Digest of each row of the table, and its settings as JSON, in the order of the touches.

    A file of a longer table, whose process was killed before it wrote ``dataset.toml``, begins
    with the same rows.

    Raises
    ------
    ResultError
        The file is absent, or has fewer rows.
    """
    import pyarrow.parquet as parquet

    path, rows = Path(f"{store}/{ROWS_FILE}"), int(read_about(store)["rows"])
    try:
        table = parquet.read_table(io.BytesIO(store.read(ROWS_FILE)))
        digests, settings = (table[name].to_pylist() for name in ("digest", "settings"))
    except (OSError, ValueError, KeyError) as error:
        raise ResultError(f"cannot be read: {error}", path) from error
    if len(digests) < rows:
        raise ResultError(f"has {len(digests)} rows, expected {rows}", path)
    return digests[:rows], settings[:rows]


# ---- Parts


def part_name(table: str, part: int) -> str:
    """Name of the file of a table and a part."""
    return f"{table}/part-{part:05d}.parquet"


def finished_parts(store: Store) -> list[int]:
    """Numbers of the parts that are finished: all their files are there."""
    return sorted(set.intersection(*(_parts_of(store, table) for table in TABLES)))


def _parts_of(store: Store, table: str) -> set[int]:
    """Numbers of the parts that have a file of a table."""
    matches = (_PART.fullmatch(name) for name in store.names(table))
    return {int(match[1]) for match in matches if match}


def schema_of(table: str, labels: Mapping[str, str] | None = None) -> Any:  # noqa: ANN401 - Arrow's
    """Schema of a table; `labels` are types of the user's own columns of ``touches``."""
    arrow_module = arrow()
    types = {
        "string": arrow_module.string(),
        "strings": arrow_module.list_(arrow_module.string()),
        "int64": arrow_module.int64(),
        "int32": arrow_module.int32(),
        "float64": arrow_module.float64(),
        "bool": arrow_module.bool_(),
    }
    columns = COLUMNS.get(table)
    if columns is None:
        kinds = {str: "string", float: "float64", int: "int64", bool: "bool"}
        settings = {name: kinds[kind] for name, kind in SETTINGS.items()}
        columns = {"touch": "int64", **(labels or {}), **settings, "trajectory": "string"}
        columns = {**columns, **RESULTS}
    return arrow_module.schema([(name, types[kind]) for name, kind in columns.items()])


def write_part(store: Store, part: int, tables: Mapping[str, Any]) -> None:
    """Write the Arrow `tables` of a part, ``touches`` last; tried three times.

    Raises
    ------
    OutputError, OSError
        It cannot be written, even at the third attempt.
    """
    digests: dict[str, str] = {}
    for name in TABLES:
        table = tables[name]
        if name == "touches":
            metadata = {_META: json.dumps({"part": part, "sha256": digests}, sort_keys=True)}
            table = table.replace_schema_metadata(metadata)
        content = _parquet(table)
        digests[name] = hashlib.sha256(content).hexdigest()
        for attempt in range(_WRITES):
            try:
                store.write(part_name(name, part), content)
                break
            except (FembridgeError, OSError):
                if attempt == _WRITES - 1:
                    raise
                time.sleep(_PAUSE_S)


def _parquet(table: Any) -> bytes:  # noqa: ANN401 - an Arrow table
    import pyarrow.parquet as parquet

    sink = io.BytesIO()
    parquet.write_table(table, sink, compression="zstd")
    return sink.getvalue()


def read_part(store: Store, table: str, part: int) -> Any:  # noqa: ANN401 - an Arrow table
    """Arrow table of a part."""
    arrow()
    import pyarrow.parquet as parquet

    name = part_name(table, part)
    try:
        return parquet.read_table(io.BytesIO(store.read(name)))
    except (OSError, ValueError) as error:
        raise ResultError(f"cannot be read: {error}", Path(f"{store}/{name}")) from error


def damaged_files(store: Store) -> list[str]:
    """Files whose content is not that of which their part has the checksum, or that are absent."""
    damaged = [] if _rows_are_sound(store) else [ROWS_FILE]
    for part in sorted(_parts_of(store, "touches")):
        about = json.loads((read_part(store, "touches", part).schema.metadata or {})[_META])
        for table, sha256 in about["sha256"].items():
            name = part_name(table, part)
            try:
                is_sound = hashlib.sha256(store.read(name)).hexdigest() == sha256
            except FileNotFoundError:
                is_sound = False
            if not is_sound:
                damaged.append(name)
    return damaged


def _rows_are_sound(store: Store) -> bool:
    try:
        return digest_of_rows(read_rows(store)[0]) == str(read_about(store)["sha256"])
    except ResultError:
        return False


# ---- The result


@dataclass(frozen=True, eq=False, repr=False)
class Touches(Shown):
    """A data set of touches: the result of `fembridge.touch_many`, and of `fembridge.read`.

    Tables are DataFrames; that of a large set is read part by part with `part`, or by pandas,
    Polars or DuckDB from the folder.

    Parameters
    ----------
    store
        Files of the data set.
    unwritten
        Causes of touches that could not be written, by number. Default: none.

    Examples
    --------
    >>> import fembridge as fb
    >>> rows = [{"press_um": 200, "population": "one_each", "label": text} for text in "ab"]
    >>> data = fb.touch_many(rows, jobs=1)
    >>> data.counts(bin_ms=100).shape
    (2, 1, 3, 7)
    """

    store: Store
    unwritten: Mapping[int, str] = field(default_factory=dict)

    @cached_property
    def about(self) -> Table:
        """Content of ``dataset.toml``."""
        return read_about(self.store)

    def _lines(self) -> list[str]:
        rows, done = int(self.about["rows"]), int((self.touches["status"] == DONE).sum())
        lines = [f"Touches: {done} of {rows} done, {self.spikes_count} spikes, {self.store}"]
        if self.failed:
            touch, cause = next(iter(self.failed.items()))
            lines.append(f"  {len(self.failed)} failed, first {touch}: {cause}")
        warned = int(sum(len(texts) > 0 for texts in self.touches["warnings"]))
        if warned:
            lines.append(f"  {warned} with warnings, see .touches")
        return [
            *lines,
            "  .touches, .spikes, .rates, .units, .forces, .counts(bin_ms), .examples(bin_ms), "
            ".plot(), .write(folder)",
        ]

    @cached_property
    def parts(self) -> list[int]:
        """Numbers of the finished parts."""
        return finished_parts(self.store)

    def part(self, table: str, part: int) -> "pandas.DataFrame":
        """A part of a table.

        Parameters
        ----------
        table
            ``touches``, ``spikes``, ``units`` or ``forces``.
        part
            Number of the part, one of `parts`.

        Raises
        ------
        UsageError, ResultError
            No such table; a part that cannot be read.
        """
        if table not in TABLES:
            raise UsageError(argument="table", found=table, expected=", ".join(TABLES))
        return _frame(read_part(self.store, table, part))

    def _joined(self, table: str) -> "pandas.DataFrame":
        tables = [read_part(self.store, table, part) for part in self.parts]
        arrow_module = arrow()
        if not tables:
            return _frame(schema_of(table).empty_table())
        joined = arrow_module.concat_tables(tables)
        check_memory(4 * joined.nbytes, f"{table} of {len(self.parts)} parts", UsageError)
        order = {"units": "population_id"}.get(table, "touch")
        frame = _frame(joined).sort_values(order, kind="stable")
        return frame.reset_index(drop=True)

    @cached_property
    def touches(self) -> "pandas.DataFrame":
        """One row per touch: number, own columns, settings, state, warnings and digests."""
        return self._joined("touches")

    @cached_property
    def spikes(self) -> "pandas.DataFrame":
        """Spikes, one row each: ``touch, afferent, unit, trial, spike_time_ms``."""
        return self._joined("spikes")

    @cached_property
    def units(self) -> "pandas.DataFrame":
        """Units of each population: ``population_id, unit, afferent``, positions in mm."""
        return self._joined("units")

    @cached_property
    def forces(self) -> "pandas.DataFrame":
        """``touch, time_ms, x_mm, z_mm, depth_um, force`` at the step of ``dataset.toml``."""
        return self._joined("forces")

    @property
    def spikes_count(self) -> int:
        """Number of spikes in all touches."""
        return int(self.touches["spikes"].sum())

    @property
    def failed(self) -> dict[int, str]:
        """Causes of the touches that failed, by number."""
        rows = self.touches[self.touches["status"] == FAILED]
        causes = dict(zip(rows["touch"].tolist(), rows["cause"].tolist(), strict=True))
        return dict(sorted({**causes, **self.unwritten}.items()))

    @cached_property
    def rates(self) -> "pandas.DataFrame":
        """Mean rates in impulses/s over all trials: ``touch, afferent, unit, rate_ips``.

        Each unit of a touch has a row, also a silent one. Spikes count in the window of the
        stimulus, as in a single touch.
        """
        import pandas

        touches = self.touches[self.touches["status"] == DONE]
        units = self.units.set_index("population_id")
        sizes = touches["units"].to_numpy(dtype=np.int64)
        check_memory(100 * int(sizes.sum()), f"rates of {sizes.sum()} units", UsageError)
        rows = {touch: row for row, touch in enumerate(touches["touch"])}
        spikes = self.spikes
        row = spikes["touch"].map(rows).to_numpy(dtype=np.int64)
        window = touches[["window_start_ms", "window_end_ms"]].to_numpy(dtype=np.float64)
        time_ms = spikes["spike_time_ms"].to_numpy()
        inside = (time_ms > window[row, 0]) & (time_ms <= window[row, 1])
        counts = spikes[inside].groupby(["touch", "unit"], sort=False).size()
        frames = [
            units.loc[[population], ["afferent", "unit"]] for population in touches["population_id"]
        ]
        if not frames:
            return pandas.DataFrame(columns=["touch", "afferent", "unit", "rate_ips"])
        table = pandas.concat(frames, ignore_index=True)
        table.insert(0, "touch", np.repeat(touches["touch"].to_numpy(), sizes))
        index = pandas.MultiIndex.from_arrays([table["touch"], table["unit"]])
        number = counts.reindex(index, fill_value=0).to_numpy(dtype=np.float64)
        duration_ms = np.repeat((window[:, 1] - window[:, 0]) * touches["trials"], sizes)
        table["rate_ips"] = number * _MS_PER_S / np.asarray(duration_ms)
        return table

    def units_of(self, touch: int) -> "pandas.DataFrame":
        """Units of a touch: ``unit, afferent``, positions in mm, a row a unit.

        Parameters
        ----------
        touch
            Number of the touch.

        Raises
        ------
        UsageError
            No such touch, or one that failed.
        """
        row = self._row(touch)
        units = self.units[self.units["population_id"] == row["population_id"]]
        columns = list(COLUMNS["units"])[1:]
        table: pandas.DataFrame = units[columns].reset_index(drop=True)
        return table

    @cached_property
    def places(self) -> "dict[int, tuple[int, int]]":
        """Part and number of the population of each touch that is done."""
        places: dict[int, tuple[int, int]] = {}
        for part in self.parts:
            rows = self.part("touches", part)
            rows = rows[rows["status"] == DONE]
            populations = rows["population_id"].astype(int).tolist()
            places |= {
                touch: (part, population)
                for touch, population in zip(rows["touch"].tolist(), populations, strict=True)
            }
        return places

    def unit_rows(self, population: int) -> "pandas.Index[Any]":
        """Names of the units of a population, in their order.

        Parameters
        ----------
        population
            Number of the population, ``population_id``.
        """
        if population not in self._unit_rows:
            import pandas

            units = self.units.loc[self.units["population_id"] == population, "unit"]
            self._unit_rows[population] = pandas.Index(units)
        return self._unit_rows[population]

    @cached_property
    def _unit_rows(self) -> "dict[int, pandas.Index[Any]]":
        return {}

    def _row(self, touch: int) -> "pandas.Series[Any]":
        rows = self.touches[(self.touches["touch"] == touch) & (self.touches["status"] == DONE)]
        if rows.empty:
            expected = f"a touch that is done, of 0 to {int(self.about['rows']) - 1}"
            raise UsageError(argument="touch", found=touch, expected=expected)
        return rows.iloc[0]

    # ---- For decoders

    def counts(self, bin_ms: float, end_ms: float | None = None) -> "NDArray[np.uint16]":
        """Binned spike counts of all touches that are done, in their order.

        Parameters
        ----------
        bin_ms
            Width of a bin in ms. Bin k has the spikes after ``k bin_ms`` up to ``(k + 1) bin_ms``.
        end_ms
            End of the last bin in ms. Default: None, the end of the longest touch; shorter
            ones are followed by zeros.

        Returns
        -------
        ndarray
            ``(touch, trial, unit, bin)``; units in the order of `units_of`.

        Raises
        ------
        UsageError
            Touches with different numbers of units or trials, or more memory than is available.
        """
        examples = self.examples(bin_ms, end_ms)
        units, bins = examples.shape
        subject = f"counts of {len(examples)} trials, {units} units and {bins} bins"
        check_memory(2 * len(examples) * units * bins, subject, UsageError)
        counts = np.zeros((len(examples), units, bins), dtype=np.uint16)
        for row in range(len(examples)):
            counts[row] = np.minimum(examples.counts_of(row), _COUNT_MAX)
        trials = examples.trials
        return counts.reshape(-1, trials, *examples.shape)

    def examples(
        self, bin_ms: float, end_ms: float | None = None, target: str | None = None
    ) -> "Examples":
        """Binned counts, one trial of a touch after the other: a data set for PyTorch.

        A sequence of pairs ``(counts, target)``, counts ``(unit, bin)`` in single precision. It
        has a length and items, so that ``torch.utils.data.DataLoader`` takes it as it is, and is
        read part by part, so that it may be larger than the memory.

        Parameters
        ----------
        bin_ms
            Width of a bin in ms.
        end_ms
            End of the last bin in ms. Default: None, the end of the longest touch.
        target
            Column of `touches` that comes with the counts, such as ``label``. Default: None,
            the number of the touch.

        Raises
        ------
        UsageError
            No such column, or touches with different numbers of units or trials.
        """
        check_range("bin_ms", bin_ms)
        touches = self.touches[self.touches["status"] == DONE]
        if touches.empty:
            raise UsageError("has no touch that is done", argument="touches", found=0)
        for column in ("units", "trials"):
            if len(touches[column].unique()) > 1:
                numbers = ", ".join(map(str, sorted(touches[column].unique().tolist())[:5]))
                raise UsageError(
                    f"have different numbers of {column}: {numbers}", argument="touches"
                )
        if target is not None and target not in touches.columns:
            expected = f"a column of touches: {', '.join(touches.columns)}"
            raise UsageError(argument="target", found=target, expected=expected)
        if end_ms is None:
            end_ms = float(touches["end_ms"].max())
        bins = int(np.ceil(end_ms / bin_ms - 1e-9))
        if not 1 <= bins <= 10_000_000:
            raise UsageError(argument="end_ms", found=end_ms, expected="1 bin or more, 1e7 at most")
        units, trials = int(touches["units"].iloc[0]), int(touches["trials"].iloc[0])
        targets = touches["touch" if target is None else target].tolist()
        return Examples(self, touches["touch"].tolist(), targets, trials, (units, bins), bin_ms)

    # ---- Pictures and files

    @property
    def provenance(self) -> Table:
        """Versions, table, and digests of pads, shapes, trajectories, populations, parameters."""
        touches = self.touches
        digests = {
            column: sorted(touches[column].dropna().unique().tolist())
            for column in RESULTS
            if column.endswith("_sha256")
        }
        versions = sorted(touches["fembridge"].dropna().unique().tolist())
        return {**self.about, "versions": versions, **digests}

    def plot(self, kind: str | None = None, ax: "Panels | None" = None) -> "Figure":
        """Mean rate of each class, of every touch.

        Parameters
        ----------
        kind
            Column of `touches` against which rates are drawn: numbers, such as ``press_n``, or
            names, such as ``label``. Default: ``touch``, the number of the touch.
        ax
            Axes to draw into, one per class. Default: a new figure.

        Raises
        ------
        UsageError
            No such column, no touch that is done, or another number of axes than classes.
        """
        from fembridge.plots.touches_view import touches_figure

        column = kind or "touch"
        if column not in self.touches.columns or column == "warnings":
            expected = f"a column of touches: {', '.join(self.touches.columns)}"
            raise UsageError(argument="kind", found=kind, expected=expected)
        rates = self.rates.groupby(["touch", "afferent"], sort=False)["rate_ips"].mean()
        if rates.empty:
            raise UsageError("has no touch that is done", argument="touches", found=0)
        values = self.touches.set_index("touch")[column] if column != "touch" else None
        table = rates.reset_index()
        at = table["touch"] if values is None else table["touch"].map(values)
        return touches_figure(table.assign(at=at), column, ax)

    def write(self, folder: "str | Path") -> None:
        """Write all files into another folder.

        Parameters
        ----------
        folder
            Local folder, which is made, or an address of fsspec.

        Raises
        ------
        OutputError
            The folder cannot be written, or has another data set.
        """
        target = store_of(folder)
        if isinstance(target, LocalStore):
            make_folder(target.folder)
        if is_dataset(folder) and finished_parts(target) and read_about(target) != self.about:
            raise OutputError("has another data set of touches", Path(str(folder)))
        for name in (ROWS_FILE, ABOUT_FILE):
            target.write(name, self.store.read(name))
        for part in self.parts:
            for table in TABLES:
                name = part_name(table, part)
                target.write(name, self.store.read(name))

    @classmethod
    def read(cls, folder: "str | Path") -> "Touches":
        """The data set in a folder, also one that is not complete yet.

        Parameters
        ----------
        folder
            Local folder or an address of fsspec.

        Raises
        ------
        ResultError
            No data set.
        """
        store = store_of(folder)
        read_about(store)
        return cls(store)


class Examples:
    """Binned counts of each trial of each touch: pairs ``(counts, target)``.

    Parameters
    ----------
    data
        Data set.
    touches, targets
        Numbers of the touches, and the target of each.
    trials
        Trials of a touch.
    shape
        Numbers of units and bins.
    bin_ms
        Width of a bin in ms.
    """

    def __init__(
        self,
        data: Touches,
        touches: Sequence[int],
        targets: Sequence[Any],
        trials: int,
        shape: tuple[int, int],
        bin_ms: float,
    ) -> None:
        self.data, self.touches, self.targets = data, touches, targets
        self.trials, self.shape, self.bin_ms = trials, shape, bin_ms
        self._spikes: dict[int, dict[int, _SpikesOfTouch]] = {}  # by part and touch

    def __len__(self) -> int:
        return len(self.touches) * self.trials

    def __getitem__(self, number: int) -> tuple[SingleArray, Any]:
        """Counts ``(unit, bin)`` in single precision, and the target."""
        if not -len(self) <= number < len(self):
            raise IndexError(number)
        number %= len(self)
        counts = self.counts_of(number).astype(np.float32)
        return counts, self.targets[number // self.trials]

    def __iter__(self) -> Iterator[tuple[SingleArray, Any]]:
        return (self[number] for number in range(len(self)))

    def counts_of(self, number: int) -> IntArray:
        """Counts ``(unit, bin)`` of an example.

        Parameters
        ----------
        number
            Number of the example, from 0.
        """
        touch, trial = self.touches[number // self.trials], number % self.trials + 1
        spikes = self._spikes_of(touch)
        spike_bin = np.ceil(spikes.time_ms / self.bin_ms - 1e-9).astype(np.int64) - 1
        counted = (spikes.trial == trial) & (spike_bin >= 0) & (spike_bin < self.shape[1])
        cell = spikes.unit[counted] * self.shape[1] + spike_bin[counted]
        counts = np.bincount(cell, minlength=self.shape[0] * self.shape[1])
        return counts.reshape(self.shape)

    def _spikes_of(self, touch: int) -> "_SpikesOfTouch":
        part, _ = self.data.places[touch]
        if part not in self._spikes:
            if len(self._spikes) >= _CACHED_PARTS:
                del self._spikes[next(iter(self._spikes))]
            self._spikes[part] = self._read(part)
        return self._spikes[part].get(touch, _NO_SPIKES)

    def _read(self, part: int) -> "dict[int, _SpikesOfTouch]":
        import pandas

        frame = self.data.part("spikes", part)
        spikes: dict[int, _SpikesOfTouch] = {}
        touches = frame["touch"].to_numpy()
        starts = np.flatnonzero(np.diff(touches, prepend=-1))
        for first, last in zip(starts, np.append(starts[1:], touches.size), strict=True):
            rows, touch = frame.iloc[first:last], int(touches[first])
            _, population = self.data.places[touch]
            unit = self.data.unit_rows(population).get_indexer(pandas.Index(rows["unit"]))
            spikes[touch] = _SpikesOfTouch(
                unit, rows["trial"].to_numpy(), rows["spike_time_ms"].to_numpy()
            )
        return spikes


class _SpikesOfTouch(NamedTuple):
    """Row of the unit, number of the trial and time of each spike, ``(spike,)``."""

    unit: IntArray
    trial: IntArray
    time_ms: FloatArray


_NO_SPIKES = _SpikesOfTouch(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))


def _frame(table: Any) -> "pandas.DataFrame":  # noqa: ANN401 - an Arrow table
    frame: pandas.DataFrame = table.to_pandas()
    return frame
