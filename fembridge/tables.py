"""Long CSV tables: one row a sample, a spike or a rate, in and out.

``traces``  ``time_ms,afferent,node,von_mises_pa``; afferent may be empty
``spikes``  ``stimulus,afferent,repeat,spike_time_ms``; a silent train has no row
``rates``   ``stimulus,afferent,rate_ips``

Columns may stand in any order, and others beside them; blanks around a cell and rows
without any text do not count. Numbers are written with as many digits as bring them
back exactly; lines end in LF. Every cell is read as text and converted by column, so
that a `TableError` names the line and what was found there.
"""

import csv
import io
import math
import os
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fembridge.errors import TableError, TraceError
from fembridge.store import (
    read_bytes,
    read_toml,
    remove_file,
    replacing,
    sha256_of,
    structure,
    unstructure,
    write_text,
)
from fembridge.trace import Origin, StressTrace, Traces, mean_step
from fembridge.typing import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    import pandas as pd

AFFERENTS = ("SA", "RA", "PC")

TRACE_COLUMNS = ("time_ms", "afferent", "node", "von_mises_pa")
SPIKE_COLUMNS = ("stimulus", "afferent", "repeat", "spike_time_ms")
RATE_COLUMNS = ("stimulus", "afferent", "rate_ips")

MAX_TABLE_BYTES = 1 << 28  # whose cells are read as text
_LOOK_BYTES, _LONGEST_HEADER, _ROWS_AT_ONCE = 1 << 22, 1 << 16, 1 << 18
_SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars"}
_TOO_MANY_CELLS = re.compile(r"Expected (\d+) fields in line (\d+), saw (\d+)")  # pandas
_COMMENTS = re.compile("(?:#.*\\n)*")
_IN_QUOTES = re.compile(r"EOF inside string starting at row (\d+)")


@dataclass(frozen=True, slots=True, eq=False)
class SpikeTrain:
    """Spikes of one afferent under one stimulus: `times_ms` ``(spikes,)``, rising."""

    stimulus: str
    afferent: str
    times_ms: FloatArray
    repeat: int = 0

    def __post_init__(self) -> None:
        times = np.array(self.times_ms, dtype=np.float64)
        if times.ndim != 1 or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
            raise TraceError(
                f"{self.stimulus}, {self.afferent}, repeat {self.repeat}: spike times must "
                "be (spikes,), finite and rising"
            )
        times.flags.writeable = False
        object.__setattr__(self, "times_ms", times)


@dataclass(frozen=True, slots=True)
class Rate:
    """Firing rate of one afferent under one stimulus."""

    stimulus: str
    afferent: str
    rate_ips: float


def read_traces(path: Path, log: Callable[[str], None] | None = None) -> Traces:
    """Traces of a table, in the order in which their nodes first appear, and their run.

    `log` gets a remark where the table does not end in a line end: its last number may be
    cut.
    """
    samples, error = _plain_samples(path) or _samples(path)
    if log is not None and path.is_file():
        with path.open("rb") as file:
            file.seek(-1, os.SEEK_END)
            if file.read(1) not in b"\r\n":
                log(f"{path}: no line end behind the last number, which may be cut")
    traces = Traces(origin=_origin_of(path, log))
    for _, part in samples.groupby(["afferent", "node"], sort=False, observed=True):
        afferent, node = part["afferent"].iloc[0], part["node"].iloc[0]
        who, rows = f"{afferent} node {node}".strip(), part.index.to_numpy()
        if len(rows) < 2:
            raise error(rows[0], f"{who}: one sample, expected more")
        times_ms, stress_pa = part["time_ms"].to_numpy(), part["stress_pa"].to_numpy()
        dt_ms, odd = mean_step(times_ms)
        if odd is not None:
            before_ms, after_ms = times_ms[odd : odd + 2]
            raise error(
                rows[odd + 1],
                f"{who}: time goes from {before_ms:g} to {after_ms:g} ms, expected an even step: "
                "--resample-ms 0.5 of fembridge ingest makes one",
            )
        start_ms = float(times_ms[0])
        traces.append(StressTrace(stress_pa, dt_ms, int(node), afferent or None, start_ms))
    return traces


def _samples(path: Path) -> "tuple[pd.DataFrame, Callable[[int, str], TableError]]":
    """Samples of a table of traces, cell by cell, and what makes an error of a row."""
    import pandas as pd

    table = read_table(path, TRACE_COLUMNS)
    if not table.size:
        raise TableError("a header and no rows, expected samples", path)
    samples = pd.DataFrame(
        {
            "afferent": table.choices("afferent", ("", *AFFERENTS)),
            "node": table.numbers("node", 1, int),
            "time_ms": table.numbers("time_ms"),
            "stress_pa": table.numbers("von_mises_pa"),
        }
    )
    return samples, table.error


def _plain_samples(
    path: Path,
) -> "tuple[pd.DataFrame, Callable[[int, str], TableError]] | None":
    """The same of a table as we write it, number by number; None of any other.

    Of ten million samples the cells as text would take gigabytes.
    """
    import pandas as pd

    parts, names = [], ["", *AFFERENTS]
    try:
        if not path.is_file():
            return None
        with path.open("rb") as file:
            header = file.readline(_LONGEST_HEADER).decode("ascii").rstrip("\r\n").split(",")
            if any(header.count(name) != 1 for name in TRACE_COLUMNS):
                return None
            while content := file.read(_LOOK_BYTES):
                if any(odd in content for odd in (b"\0", b'"', b"_")):
                    return None
        with pd.read_csv(
            path,
            header=None,
            skiprows=1,
            dtype=object,
            na_filter=False,
            skip_blank_lines=False,
            chunksize=_ROWS_AT_ONCE,
        ) as table:
            for part in table:
                if part.shape[1] != len(header):
                    return None
                part.columns = pd.Index(header)
                codes = pd.Categorical(part["afferent"], names).codes
                nodes = part["node"].to_numpy(dtype=object).astype(np.int64)
                times_ms, stress_pa = (
                    part[name].to_numpy(dtype=object).astype(np.float64)
                    for name in ("time_ms", "von_mises_pa")
                )
                if codes.min() < 0 or nodes.min() < 1:
                    return None
                if not (np.isfinite(times_ms).all() and np.isfinite(stress_pa).all()):
                    return None
                parts.append((codes, nodes, times_ms, stress_pa))
    except (OSError, ValueError, OverflowError):  # the other way says what is wrong, and where
        return None
    if not parts:
        return None
    codes, nodes, times_ms, stress_pa = map(np.concatenate, zip(*parts, strict=True))
    samples = pd.DataFrame({"node": nodes, "time_ms": times_ms, "stress_pa": stress_pa})
    samples["afferent"] = pd.Categorical(names, names).take(codes)
    return samples, lambda row, problem: TableError(problem, path, int(row) + 2)


def origin_file(path: Path) -> Path:
    """Where it is kept which run the traces of the table `path` are of."""
    return path.with_name(f"{path.name}.toml")


def _origin_of(path: Path, log: Callable[[str], None] | None) -> Origin | None:
    """The run that the traces of the table `path` are of, if that is known."""
    record = origin_file(path)
    if not record.is_file():
        return None

    def failed(problem: str) -> TableError:
        return TableError(problem.removeprefix(f"{record}: "), record)

    table = read_toml(record, failed)
    if table.pop("traces_sha256", None) == sha256_of(path):
        return structure(table, Origin, failed)
    if log is not None:
        log(f"{record}: of another table than {path.name}, not used")
    return None


def write_traces(path: Path, traces: Iterable[StressTrace]) -> None:
    """Write a table of traces, one after the other; of which run they are goes beside it."""
    import tomli_w

    rows = (
        (time_ms, trace.afferent or "", trace.node, stress_pa)
        for trace in traces
        for time_ms, stress_pa in np.stack([trace.times_ms, trace.stress_pa], 1).tolist()
    )
    write_table(path, TRACE_COLUMNS, rows)
    if isinstance(traces, Traces) and traces.origin is not None:
        table = {"traces_sha256": sha256_of(path), **unstructure(traces.origin)}
        write_text(origin_file(path), tomli_w.dumps(table))
    else:
        remove_file(origin_file(path))  # of an earlier table


def read_spikes(path: Path) -> list[SpikeTrain]:
    """Spike trains of a table; each train's spikes come back in rising order."""
    import pandas as pd

    table = read_table(path, SPIKE_COLUMNS)
    spikes = pd.DataFrame(
        {
            "stimulus": table.words("stimulus"),
            "afferent": table.choices("afferent", AFFERENTS),
            "repeat": table.numbers("repeat", 0, int),
            "time_ms": table.numbers("spike_time_ms"),
        }
    )
    table.refuse_duplicates(spikes)
    trains = []
    for _, part in spikes.groupby(["stimulus", "afferent", "repeat"], sort=False):
        stimulus, afferent, repeat, _ = part.iloc[0]
        trains.append(SpikeTrain(stimulus, afferent, np.sort(part["time_ms"]), int(repeat)))
    return trains


def write_spikes(path: Path, trains: Iterable[SpikeTrain]) -> None:
    """Write a table of spikes, one train after the other."""
    rows = (
        (train.stimulus, train.afferent, train.repeat, time_ms)
        for train in trains
        for time_ms in train.times_ms.tolist()
    )
    write_table(path, SPIKE_COLUMNS, rows)


def read_rates(path: Path) -> list[Rate]:
    """Rates of a table in its order, to the last digit."""
    import pandas as pd

    table = read_table(path, RATE_COLUMNS)
    stimuli, afferents = table.words("stimulus"), table.choices("afferent", AFFERENTS)
    rates_ips = table.numbers("rate_ips", least=0)
    table.refuse_duplicates(pd.DataFrame({"stimulus": stimuli, "afferent": afferents}))
    return [Rate(*row) for row in zip(stimuli, afferents, rates_ips.tolist(), strict=True)]


def write_rates(path: Path, rates: Iterable[Rate]) -> None:
    """Write a table of rates in the order given."""
    rows = ((each.stimulus, each.afferent, each.rate_ips) for each in rates)
    write_table(path, RATE_COLUMNS, rows)


def write_table(path: Path, header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a CSV table; a float as the shortest text that brings it back."""
    with replacing(path) as draft, draft.open("w", encoding="utf-8", newline="") as out:
        table = csv.writer(out, lineterminator="\n")
        table.writerow(header)
        table.writerows(rows)


@dataclass(frozen=True, slots=True, eq=False)
class TextTable:
    """The cells of a CSV table as text; every method names the line of a bad cell.

    `header` has the names of the columns, `cells` their text by number of column,
    without blanks around it, and `records` ``(row,)`` which record of `text` each row
    is; the header is record 0.
    """

    path: Path
    text: str
    header: tuple[str, ...]
    cells: "pd.DataFrame"
    records: IntArray

    @property
    def size(self) -> int:
        """Number of rows."""
        return self.records.size

    def where(self, mask: BoolArray) -> "TextTable":
        """The rows of `mask` ``(row,)`` alone."""
        return replace(self, cells=self.cells[mask], records=self.records[mask])

    def column(self, name: str) -> NDArray[Any]:
        """Text of the cells of a column ``(row,)``."""
        return self.cells[self.header.index(name)].to_numpy(dtype=object)

    def words(self, name: str) -> NDArray[Any]:
        """Column of cells that must not be empty."""
        cells = self.column(name)
        self.refuse(cells == "", lambda row: f"{name} is empty")
        return cells

    def choices(self, name: str, choices: Sequence[str]) -> NDArray[Any]:
        """Column of cells that must be one of `choices`."""
        cells = self.column(name)
        known = ", ".join(filter(None, choices))
        self.refuse(
            ~np.isin(cells.astype(str), choices),
            lambda row: f"{name} is {cells[row]!r}, expected one of {known}",
        )
        return cells

    def numbers(
        self, name: str, least: float = -math.inf, kind: type[float] = float
    ) -> NDArray[Any]:
        """Column of finite numbers of a `kind`, `least` or more."""
        cells = self.column(name)
        try:
            if any("_" in cell for cell in cells):  # Python's digit groups, nobody else's
                raise ValueError
            numbers = cells.astype(kind)
        except (ValueError, OverflowError):
            words = "a whole number" if kind is int else "a number"
            row = next(row for row, cell in enumerate(cells) if not _is(kind, cell))
            raise self.error(row, f"{name} is {cells[row]!r}, expected {words}") from None
        wanted = "a finite number" if least == -math.inf else f">= {least:g}"
        self.refuse(
            ~(np.isfinite(numbers) & (numbers >= least)),
            lambda row: f"{name} is {numbers[row]:g}, expected {wanted}",
        )
        return numbers

    def refuse_duplicates(self, keys: "pd.DataFrame") -> None:
        """Refuse two rows of the same `keys`, a row of them for each row here."""

        def problem(row: int) -> str:
            first = int((keys == keys.iloc[row]).all(axis=1).to_numpy().argmax())
            return f"duplicate of line {self.line(first)}: {', '.join(map(str, keys.iloc[row]))}"

        self.refuse(keys.duplicated().to_numpy(), problem)

    def refuse(self, bad: BoolArray, problem: Callable[[int], str]) -> None:
        """Refuse the table for the first row that is `bad` ``(row,)``."""
        if bad.any():
            row = int(bad.argmax())
            raise self.error(row, problem(row))

    def error(self, row: int, problem: str) -> TableError:
        """The error that names the line of `row`."""
        return TableError(problem, self.path, self.line(row))

    def line(self, row: int) -> int:
        """Line of the file on which `row` ends."""
        record = int(self.records[row])
        if '"' not in self.text:
            return record + 1
        reader = csv.reader(io.StringIO(self.text, newline=""))
        next(islice(reader, record, None))
        return reader.line_num


def read_table(source: "Path | pd.DataFrame", columns: Sequence[str] = ()) -> TextTable:
    """A CSV table, which must have `columns`, as text; of a DataFrame a line is a row, from 1.

    Lines that begin with # are no rows.

    Raises
    ------
    TableError
        Absent, not UTF-8, not CSV, a row longer than the header, a column that is
        missing or duplicate.
    """
    import pandas as pd

    if isinstance(source, pd.DataFrame):
        path, header = Path("DataFrame"), tuple(map(str, source.columns))
        _check_header(header, columns, path)
        cells = source.map(str).set_axis(range(len(header)), axis=1)
        return TextTable(path, "", header, cells, np.arange(len(cells)))
    path, text = source, _decoded(source)
    try:
        above = text[: len(text) - len(_COMMENTS.sub("", text, count=1))]
        rows = csv.reader(io.StringIO(text[len(above) :], newline=""))
        header = tuple(name.strip() for name in next(rows, ()))
        if not header:
            raise TableError(f"empty, expected a header {','.join(columns)}".strip(), path)
        _check_header(header, columns, path, 1 + above.count("\n"))
        if "#" in text:
            text = re.sub("^#.*", "," * (len(header) - 1), text, flags=re.MULTILINE)
        cells = pd.read_csv(
            io.StringIO(text, newline=""),
            header=None,
            dtype=object,
            na_filter=False,
            skip_blank_lines=False,
        )
    except (csv.Error, pd.errors.ParserError) as error:
        raise _not_csv(text, path, error) from error
    cells = cells.apply(lambda column: column.str.strip())
    records = np.flatnonzero((cells != "").any(axis=1))[1:]  # without blank rows
    return TextTable(path, text, header, cells.iloc[records], records)


def _decoded(path: Path) -> str:
    def error_of(words: str) -> TableError:
        return TableError(words.removeprefix(f"{path}: "), path)

    content = read_bytes(path, MAX_TABLE_BYTES, error_of)
    if b"\0" in content:
        raise TableError("a binary file, expected a CSV table in UTF-8", path)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        found = f"byte 0x{content[error.start]:02x}"
        raise TableError(f"{found} is not UTF-8", path, line) from error


def _check_header(header: Sequence[str], columns: Sequence[str], path: Path, line: int = 1) -> None:
    for separator, name in _SEPARATORS.items():
        if len(header) == 1 and separator in header[0]:
            raise TableError(f"{header[0]!r} is separated by {name}, expected commas", path, line)
    for name in columns:
        if header.count(name) != 1:
            found = "duplicate" if name in header else "no"
            raise TableError(
                f"{found} column {name} in {','.join(header)!r}, "
                f"expected a header with {','.join(columns)}",
                path,
                line,
            )


def _not_csv(text: str, path: Path, problem: ValueError | csv.Error) -> TableError:
    """What pandas says of `text`, with the line, in our words."""
    if cut := _IN_QUOTES.search(str(problem)):
        return TableError("not CSV: a quote is not closed", path, int(cut[1]) + 1)
    if not (cells := _TOO_MANY_CELLS.search(str(problem))):
        return TableError(f"not CSV: {problem}", path)
    expected, line, found = map(int, cells.groups())
    whole, _, decimals = text.splitlines()[line - 1].rpartition(",")
    whole = whole.rpartition(",")[2]
    hint = ""
    if found == expected + 1 and whole.isdecimal() and decimals.isdecimal():
        hint = f"; '{whole},{decimals}' looks like a decimal comma, expected a point"
    return TableError(f"{found} cells, expected {expected} as in the header{hint}", path, line)


def _is(kind: type[float], cell: str) -> bool:
    try:
        np.array([cell], dtype=object).astype(kind)
    except (ValueError, OverflowError):
        return False
    return "_" not in cell
