"""Long CSV tables: one row a sample, a spike or a rate, in and out.

``traces``  ``time_ms,afferent,node,von_mises_pa``; afferent may be empty
``spikes``  ``stimulus,afferent,repeat,spike_time_ms``; a silent train has no row
``rates``   ``stimulus,afferent,rate_ips``

Columns may stand in any order, and others beside them; blanks around a cell and rows
without any text do not count. Numbers are written with as many digits as bring them
back exactly; lines end in LF. Every cell is read as text and converted by column, so
that an error names the line and what was found there.
"""

import csv
import io
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fembridge.errors import TableError, TraceError
from fembridge.store import write_text
from fembridge.trace import STEP_TOLERANCE, StressTrace
from fembridge.typing import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    import pandas as pd

AFFERENTS = ("SA", "RA", "PC")

TRACE_COLUMNS = ("time_ms", "afferent", "node", "von_mises_pa")
SPIKE_COLUMNS = ("stimulus", "afferent", "repeat", "spike_time_ms")
RATE_COLUMNS = ("stimulus", "afferent", "rate_ips")

_SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars"}
_BINARY = {
    b"\xff\xfe": "the text is UTF-16, expected UTF-8",
    b"\xfe\xff": "the text is UTF-16, expected UTF-8",
    b"PK\x03\x04": "a spreadsheet or another ZIP archive, expected a CSV table",
}


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


def read_traces(path: Path) -> list[StressTrace]:
    """Traces of a table, in the order in which their nodes first appear.

    Raises
    ------
    TableError
        Not a table of traces: names the line, what was found, what was expected.
    """
    import pandas as pd

    table = read_table(path, TRACE_COLUMNS)
    if not table.size:
        raise TableError("a header and no rows, expected samples", path)
    samples = pd.DataFrame(
        {
            "afferent": table.choices("afferent", AFFERENTS, optional=True),
            "node": table.whole("node", least=1),
            "time_ms": table.numbers("time_ms"),
            "stress_pa": table.numbers("von_mises_pa"),
        }
    )
    return [_trace(table, part) for _, part in samples.groupby(["afferent", "node"], sort=False)]


def write_traces(path: Path, traces: Iterable[StressTrace]) -> None:
    """Write a table of traces, one after the other."""
    rows = (
        (time_ms, trace.afferent or "", trace.node, stress_pa)
        for trace in traces
        for time_ms, stress_pa in np.stack([trace.times_ms, trace.stress_pa], 1).tolist()
    )
    write_table(path, TRACE_COLUMNS, rows)


def read_spikes(path: Path) -> list[SpikeTrain]:
    """Spike trains of a table; each train's spikes come back in rising order.

    Raises
    ------
    TableError
        Not a table of spikes, or a duplicate spike.
    """
    import pandas as pd

    table = read_table(path, SPIKE_COLUMNS)
    spikes = pd.DataFrame(
        {
            "stimulus": table.words("stimulus"),
            "afferent": table.choices("afferent", AFFERENTS),
            "repeat": table.whole("repeat", least=0),
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
    """Rates of a table in its order, to the last digit.

    Raises
    ------
    TableError
        Not a table of rates, a negative rate, or a duplicate.
    """
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
    out = io.StringIO(newline="")
    table = csv.writer(out, lineterminator="\n")
    table.writerow(header)
    table.writerows(rows)
    write_text(path, out.getvalue())


@dataclass(frozen=True, slots=True, eq=False)
class TextTable:
    """The cells of a CSV table as text; every method names the line of a bad cell.

    `header` has the names of the columns, `cells` their text by number of column, and
    `records` ``(row,)`` which record of `text` each row is; the header is record 0.
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
        """Text of the cells of a column ``(row,)``, without blanks around it."""
        found: NDArray[Any] = self.cells[self.header.index(name)].str.strip().to_numpy(dtype=object)
        return found

    def words(self, name: str) -> NDArray[Any]:
        """Column of cells that must not be empty."""
        cells = self.column(name)
        self.refuse(cells == "", lambda row: f"{name} is empty")
        return cells

    def choices(self, name: str, choices: Sequence[str], *, optional: bool = False) -> NDArray[Any]:
        """Column of cells that must be one of `choices`, or if `optional` empty."""
        cells = self.column(name)
        allowed = {*choices, ""} if optional else {*choices}
        odd = set(cells.tolist()) - allowed
        if odd:
            self.refuse(
                np.isin(cells, list(odd)),
                lambda row: f"{name} is {cells[row]!r}, expected one of {', '.join(choices)}",
            )
        return cells

    def numbers(self, name: str, least: float = -math.inf) -> FloatArray:
        """Column of finite numbers, `least` or more."""
        numbers: FloatArray = self._converted(name, float, least)
        return numbers

    def whole(self, name: str, least: int) -> IntArray:
        """Column of whole numbers, `least` or more."""
        numbers: IntArray = self._converted(name, int, least)
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

    def _converted(self, name: str, kind: type[float], least: float) -> NDArray[Any]:
        cells = self.column(name)
        try:
            if any("_" in cell for cell in cells):  # Python's digit groups, nobody else's
                raise ValueError
            numbers = cells.astype(kind)
        except (ValueError, OverflowError):
            words = "a whole number" if kind is int else "a number"
            bad = np.array([not _is(kind, cell) for cell in cells])
            self.refuse(bad, lambda row: f"{name} is {cells[row]!r}, expected {words}")
            raise
        self.refuse(
            ~np.isfinite(numbers),
            lambda row: f"{name} is {numbers[row]}, expected a finite number",
        )
        self.refuse(
            numbers < least, lambda row: f"{name} is {numbers[row]:g}, expected >= {least:g}"
        )
        return numbers


def read_table(path: Path, columns: Sequence[str] = ()) -> TextTable:
    """The CSV table `path`, which must have `columns`, as text.

    Raises
    ------
    TableError
        Absent, not UTF-8, not CSV, a row longer than the header, a column that is
        missing or duplicate.
    """
    import pandas as pd

    text = _decoded(path)
    try:
        cells = pd.read_csv(
            io.StringIO(text, newline=""),
            header=None,
            dtype=object,
            na_filter=False,
            skip_blank_lines=False,
        )
    except pd.errors.EmptyDataError:
        expected = f" with {','.join(columns)}" if columns else ""
        raise TableError(f"empty, expected a header{expected}", path) from None
    except pd.errors.ParserError as error:
        raise _not_csv(text, columns, path, error) from error
    header = tuple(name.strip() for name in cells.iloc[0])
    _check_header(header, columns, path)
    blank = np.ones(len(cells), dtype=bool)
    blank[0] = False
    for column in cells:
        blank &= (cells[column].str.strip() == "").to_numpy(dtype=bool)
        if not blank.any():
            break
    records = np.flatnonzero(~blank)[1:]
    return TextTable(path, text, header, cells.iloc[records], records)


def _decoded(path: Path) -> str:
    try:
        content = path.read_bytes()
    except OSError as error:
        raise TableError(f"cannot read: {error.strerror}", path) from error
    for begin, problem in _BINARY.items():
        if content.startswith(begin):
            raise TableError(problem, path)
    if b"\0" in content:
        raise TableError("a binary file, expected a CSV table", path)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        found = f"byte 0x{content[error.start]:02x}"
        raise TableError(f"{found} is not UTF-8", path, line) from error


def _check_header(header: Sequence[str], columns: Sequence[str], path: Path) -> None:
    expected = ",".join(columns)
    for separator, name in _SEPARATORS.items():
        if len(header) == 1 and separator in header[0]:
            raise TableError(f"{header[0]!r} is separated by {name}, expected commas", path, 1)
    missing = [name for name in columns if name not in header]
    if missing:
        raise TableError(
            f"no column {', '.join(missing)} in {','.join(header)!r}, "
            f"expected a header with {expected}",
            path,
            1,
        )
    for name in columns:
        if header.count(name) > 1:
            raise TableError(f"duplicate column {name}", path, 1)


def _not_csv(text: str, columns: Sequence[str], path: Path, problem: ValueError) -> TableError:
    """What is wrong with `text`, which pandas refused for a `problem`, and on which line."""
    rows = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        header = next(rows)
        _check_header([name.strip() for name in header], columns, path)
        cells = next((row for row in rows if len(row) > len(header)), None)
    except csv.Error as error:
        return TableError(f"not CSV: {error}", path, rows.line_num)
    if cells is None:
        return TableError(f"not CSV: {problem}", path)
    found = f"{len(cells)} cells, expected {len(header)} as in the header"
    whole, decimals = cells[-2:]
    if len(cells) == len(header) + 1 and whole.isdecimal() and decimals.isdecimal():
        found += f"; '{whole},{decimals}' looks like a decimal comma, expected a point"
    return TableError(found, path, rows.line_num)


def _is(kind: type[float], cell: str) -> bool:
    try:
        np.array([cell], dtype=object).astype(kind)
    except (ValueError, OverflowError):
        return False
    return "_" not in cell


def _trace(table: TextTable, part: "pd.DataFrame") -> StressTrace:
    """The trace of one node; its times must be one even, rising grid."""
    afferent, node = part["afferent"].iloc[0] or None, int(part["node"].iloc[0])
    who = f"{afferent} node {node}" if afferent else f"node {node}"
    times_ms, stress_pa = part["time_ms"].to_numpy(), part["stress_pa"].to_numpy()
    rows = part.index.to_numpy()
    if times_ms.size < 2:
        raise table.error(rows[0], f"{who}: one sample, expected more")
    steps_ms = np.diff(times_ms)
    usual_ms = float(np.median(steps_ms))
    even = np.abs(steps_ms - usual_ms) <= STEP_TOLERANCE * abs(usual_ms)
    off = np.flatnonzero(~even | (steps_ms <= 0))
    if off.size:
        k = off[0]
        raise table.error(
            rows[k + 1],
            f"{who}: time goes from {times_ms[k]:g} to {times_ms[k + 1]:g} ms, "
            f"expected an even step (most are {usual_ms:g} ms)",
        )
    dt_ms = float((times_ms[-1] - times_ms[0]) / steps_ms.size)
    return StressTrace(stress_pa, dt_ms, node, afferent, start_ms=float(times_ms[0]))
