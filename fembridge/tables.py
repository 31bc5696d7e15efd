"""Long CSV tables: one row a sample, a spike or a rate, in and out.

``traces``  ``time_ms,afferent,node,von_mises_pa``; afferent may be empty, all but time and
            stress may be missing, ``unit`` and ``stimulus`` may name what differs else
``spikes``  ``stimulus,afferent,repeat,spike_time_ms``; a silent train has no row
``rates``   ``stimulus,afferent,rate_ips``

Where units have names, ``unit`` stands behind ``afferent`` in spikes and rates.

Columns may stand in any order; blanks around a cell and rows without any text do not count.
Numbers are written with as many digits as bring them back exactly; lines end in LF. Every
cell is read as text and converted by column, so that a `TableError` names the line and what
was found there.

A column that a reader does not know is refused where it may be a misspelt one, else named.
A last line without its end may be cut in its last number, which is a `FembridgeWarning`. Rows
and columns are counted before cells are parsed, so that no small file fills the memory.
"""

import codecs
import csv
import io
import itertools
import math
import re
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from decks.unit_system import UNIT_SYSTEMS
from fembridge.errors import FembridgeWarning, TableError, TraceError, UsageError
from fembridge.memory import check_memory, size_text
from fembridge.number import parse_number
from fembridge.store import (
    near_hint,
    read_bytes,
    read_toml,
    remove_file,
    replacing,
    sha256_of,
    structure,
    unstructure,
    write_toml,
)
from fembridge.trace import (
    MS_PER_S,
    Origin,
    StressTrace,
    Traces,
    check_growth,
    doubt_of_gaps,
    doubt_of_step,
    mean_step,
    resample,
)
from fembridge.typing import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    import pandas as pd

AFFERENTS = ("SA", "RA", "PC")

_WHOSE = ("stimulus", "afferent", "unit", "node")
TRACE_KEYS = ("time", "time_ms", "value", *_WHOSE)
"""What the columns of another table of traces can be."""
MS_PER_UNIT = {"us": 1e-3, "ms": 1.0, "s": MS_PER_S}
_PA_PER_UNIT = {one.stress_unit.lower(): one.stress_pa for one in UNIT_SYSTEMS.values()}
_PA_PER_UNIT |= {"gpa": 1e9, "n/m2": 1.0, "n/mm2": 1e6}
_UNIT = re.compile(r"(?:_([A-Za-z]+)|[\[(] *([^][()]*[A-Za-z][^][()]*?) *[])])$")
_OTHER_UNITS = ("n", "mn", "kn", "lbf", "mm", "um", "v", "mv", "ns", "min", "h")
_NO_UNIT = re.compile("[xyz]{2}|.*mises.*|v-m")  # in brackets
SPIKE_COLUMNS = ("stimulus", "afferent", "repeat", "spike_time_ms")
RATE_COLUMNS = ("stimulus", "afferent", "rate_ips")

MAX_TABLE_BYTES = 1 << 28  # whose cells are read as text
MAX_COLUMNS = 1 << 14
"""As many as a spreadsheet has. pandas takes 9 kB a column, and seconds for 100 000."""

MAX_GROUPS = 1 << 18
"""Traces or spike trains of a table: more take minutes, and no hand has as many afferents."""

NOTE_COLUMNS = ("note", "notes", "comment", "comments", "remark", "remarks", "source")
"""Columns for people, which are never misspelt ones of ours."""

# Peak of resident memory, measured in processes of their own with files of 20 MB of numbers,
# of words that are all different and of empty cells, in ASCII and not: of text at most this
# much a byte of the file and a cell, of numbers that are parsed as such this much a cell.
_TEXT_BYTES_PER_BYTE, _TEXT_BYTES_PER_CELL = 17, 12
_NUMBER_BYTES_PER_CELL = 28
_MOST_CELLS_PER_BYTE = 1  # each has a separator or a line end behind it
_SMALL_CELLS = 1 << 20
_BLOCK_BYTES = 1 << 20

_FRAME = Path("DataFrame")
_HEADER_BYTES = 1 << 20
_START_BYTES = 4 * _HEADER_BYTES
_MOST_LINES_ABOVE = 10_000  # of a header
_LONGEST_SHOWN = 60
_LONG_STEP_MS = 20.0  # of a history of touch: it has changes that are faster
_NO_WHOLE = 2.0**53  # from here on a float is not every whole number
_NOT_UTF8 = "\N{REPLACEMENT CHARACTER}"  # what becomes of such a byte
_SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars"}
_TOO_MANY_CELLS = re.compile(r"Expected (\d+) fields in line (\d+), saw (\d+)")  # pandas
_COMMENT_SIGNS = ("%", "#")
_COMMENT = re.compile(rb"^#[^\r\n]*", re.MULTILINE)
_NO_NAME = re.compile(r"Unnamed: \d+")  # pandas' of a column without
_MOST_COMPARED = 1000  # names of a header with which a missing one is compared
_IN_QUOTES = re.compile(r"EOF inside string starting at row (\d+)")


@dataclass(frozen=True, slots=True, eq=False)
class SpikeTrain:
    """Spikes of one afferent under one stimulus: `times_ms` ``(spikes,)``, rising."""

    stimulus: str
    afferent: str
    times_ms: FloatArray
    repeat: int = 0
    unit: str = ""

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
    unit: str = ""


def read_traces(
    source: "Path | pd.DataFrame",
    log: Callable[[str], None] | None = None,
    *,
    columns: Mapping[str, str | Sequence[str]] | None = None,
    gain_pa: float | None = None,
    resample_ms: float | None = None,
) -> Traces:
    """Traces of a table, in the order in which their units first appear, and their run.

    A doubt is a `FembridgeWarning`: a table that may be cut, a record of another table, times
    whose unit is not stated, power or samples that resampling loses.

    Parameters
    ----------
    log
        Gets a line about columns that are not used, and about intervals in which resampling
        interpolates.
    columns
        Names of columns by `TRACE_KEYS`, where they are others. Several values are a
        trace each, whose unit is the column's name. ``time`` is in s unless its name ends
        in another unit, as ``t_ms`` or ``t [us]``.
    gain_pa
        What a value of 1 is in Pa. None: as the name of its column ends, in ``_pa`` or
        ``[kPa]``.
    resample_ms
        The step of the even grid on which traces are put.

    Raises
    ------
    TableError
        A column that is missing, duplicate or misspelt, a row that is no sample.
    """
    names = {
        key: [name] if isinstance(name, str) else name for key, name in (columns or {}).items()
    }
    if unknown := [key for key in names if key not in TRACE_KEYS]:
        raise UsageError(f"column {unknown[0]!r}, expected one of {', '.join(TRACE_KEYS)}")
    in_ms = "time_ms" in names
    asked = {"value": ["von_mises_pa"], **names}
    asked["time"] = names.get("time_ms", names.get("time", ["time_ms"]))
    [time], values = asked["time"], asked["value"]
    path = source if isinstance(source, Path) else Path("traces")
    logged: set[str] = set()

    def say(line: str) -> None:
        if log is not None and line not in logged:
            log(f"{path}: {line}")
        logged.add(line)

    assumed: list[str] = []
    factors: dict[str | int, float] = {"time": ms_per(time, in_ms, assumed.append)}
    factors |= {number: _to_pa(value, gain_pa) for number, value in enumerate(values)}
    samples, error = samples_in(source, asked, named=bool(columns), factors=factors, log=say)
    traces, doubts, resampled = Traces(), [], 0
    if isinstance(source, Path):
        traces = Traces(origin=_origin_of(source))
    keys = [key for key in _WHOSE if key in samples]
    numbers = {key: samples[key].to_numpy() for key in samples if key not in _WHOSE[:3]}
    groups = _groups_in(samples, keys, path)
    firsts = samples.iloc[[rows[0] for rows in groups]]
    whose = [firsts[key].tolist() if key in samples else [""] * len(groups) for key in _WHOSE[:3]]
    for rows, stimulus, afferent, unit in zip(groups, *whose, strict=True):
        first = int(rows[0])
        node = int(numbers["node"][first]) if "node" in keys else 0
        who = " ".join(filter(None, [stimulus, afferent, unit, f"node {node}" if node else ""]))
        who = _cut(who) or "the trace"
        if len(rows) < 2:
            raise error(first, f"{who}: one sample, expected more")
        times_ms = numbers["time"][rows]
        with np.errstate(over="ignore", invalid="ignore"):  # of 1e308
            even_ms, odd = mean_step(times_ms)
        if odd is not None and resample_ms is None:
            before_ms, after_ms = times_ms[odd : odd + 2]
            raise error(
                rows[odd + 1],
                f"{who}: time goes from {before_ms:g} to {after_ms:g} ms, expected an even step: "
                "--resample-ms 0.5 (resample_ms) of encode or ingest makes one",
            )
        for number, value in enumerate(values):
            stress_pa = numbers[number][rows]
            if resample_ms is not None:
                doubt = (
                    doubt_of_step(stress_pa, even_ms, resample_ms)
                    if odd is None
                    else doubt_of_gaps(times_ms)
                )
                if doubt:
                    doubts.append(f"{who}: {doubt}")
                try:
                    length = _length_at(times_ms, resample_ms)
                    resampled += length
                    check_growth(len(samples), resampled, length)
                    _, stress_pa = resample(times_ms, stress_pa, resample_ms, say)
                except TraceError as problem:
                    raise error(first, f"{who}: {problem}") from problem
            traces.append(
                StressTrace(
                    stress_pa,
                    resample_ms or even_ms,
                    node,
                    afferent or None,
                    float(times_ms[0]),
                    f"{unit} {value}".strip() if len(values) > 1 else unit,
                    stimulus,
                )
            )
    for line in assumed:
        step_ms = min(trace.dt_ms for trace in traces)
        if step_ms > _LONG_STEP_MS:
            _warn(path, f"a sample every {step_ms:g} ms: {line}")
        else:
            say(line)
    if doubt := _doubt_of_ends(traces):
        _warn(path, doubt)
    if doubts:
        more = f" (and of {len(doubts) - 1} more)" if len(doubts) > 1 else ""
        _warn(path, f"{doubts[0]}{more}")
    return traces


def _length_at(times_ms: FloatArray, step_ms: float) -> int:
    """Samples of a history on another step; 0 where it has none, which `resample` refuses."""
    with np.errstate(all="ignore"):
        length = (times_ms[-1] - times_ms[0]) / np.float64(step_ms)
    return int(length) if 0 < length < 2**62 else 0


def _doubt_of_ends(traces: Sequence[StressTrace]) -> str | None:
    """Which trace ends before another one of its stimulus, as of a table that is cut."""
    last: dict[str, tuple[float, float]] = {}  # and the step
    for trace in traces:
        end_ms = trace.start_ms + (trace.stress_pa.size - 1) * trace.dt_ms
        other_ms, step_ms = last.setdefault(trace.stimulus, (end_ms, trace.dt_ms))
        if abs(end_ms - other_ms) > 1.5 * max(step_ms, trace.dt_ms):
            who = trace.unit or (f"node {trace.node}" if trace.node else str(trace.afferent))
            return f"{_cut(who)} ends at {end_ms:g} ms, others at {other_ms:g} ms: a cut table?"
    return None


def _warn(path: Path, doubt: str, line: int | None = None) -> None:
    """Warn of a table whose content is doubtful, at `line`."""
    place = path if line is None else f"{path}:{line}"
    warnings.warn(f"{place}: {doubt}", FembridgeWarning, stacklevel=4)


def _to_pa(value: str, gain_pa: float | None) -> float:
    """What 1 in the column `value` is in Pa."""
    if gain_pa is not None:
        if not (math.isfinite(gain_pa) and gain_pa):
            raise UsageError(f"gain_pa is {gain_pa:g}, expected how many Pa a value of 1 is")
        return gain_pa
    factor = pa_per(value)
    if factor is None:
        raise UsageError(
            f"column {value} does not say its unit (_pa, _kpa or _mpa): --gain-pa (gain_pa) is "
            "how many Pa a value of 1 is"
        )
    return factor


def pa_per(name: str) -> float | None:
    """What 1 in a column is in Pa, as its name says; None where it does not."""
    return _PA_PER_UNIT.get(_unit_in(name)[0])


def check_stress_unit(name: str) -> None:
    """Refuse a column whose name says a unit that is none of stress, or none we know."""
    unit, sure = _unit_in(name)
    if sure and unit not in _PA_PER_UNIT:
        raise UsageError(
            f"column {name} is in {unit!r}, expected Pa, kPa, MPa, GPa, psi, N/m^2 or N/mm^2: "
            "--stress-unit (stress_unit) says what its numbers are in"
        )


def ms_per(name: str, in_ms: bool, note: Callable[[str], None]) -> float:
    """What 1 in a column of times is in ms: as its name says, else as `in_ms`, else of s."""
    unit, sure = _unit_in(name)
    if unit in MS_PER_UNIT or in_ms:
        return MS_PER_UNIT.get(unit, 1.0)
    if sure:
        raise UsageError(
            f"column {name} is in {unit!r}, expected s, ms or us: rename it when its numbers "
            f"are in s, or --columns time_ms={name} takes them as ms"
        )
    note(f"time taken as s; --columns time_ms={name} takes it as ms")
    return MS_PER_S


def _unit_in(name: str) -> tuple[str, bool]:
    """What may be the unit at the end of a name, in small letters, or ""; whether it must be."""
    if not (found := _UNIT.search(name)):
        return "", False
    unit = re.sub(r"\^|\*\*|\s", "", (found[1] or found[2]).lower()).replace("²", "2")
    if found[1]:
        return unit, unit in _OTHER_UNITS
    return unit, not _NO_UNIT.fullmatch(unit)


def samples_in(
    source: "Path | pd.DataFrame",
    asked: Mapping[str, Sequence[str]],
    *,
    named: bool,
    factors: Mapping[str | int, float] | None = None,
    log: Callable[[str], None] | None = None,
) -> "tuple[pd.DataFrame, Callable[[int, str], TableError]]":
    """Samples of a table of traces, and what makes an error of a row.

    `asked` has names of columns by ``time``, ``value`` and whose they are. Columns of the
    samples are ``time``, the number of a value from 0 on, and whose they are; numbers are
    multiplied by their factor of `factors`. A table whose columns are `named` may be as other
    programs write it. `log` gets the names of columns that are not used.
    """
    import pandas as pd

    table = None
    if isinstance(source, Path):
        table = _plain_table(source, asked)
        if table is None:
            content = _content(source)
            table = _others_table(content, source) if named else None
            table = table or _text_table(content, source)
    table = table or read_table(source)
    columns = _columns_in(table.header, asked, table.path)
    known = [*columns.values()]
    table.check_columns(known, _WHOSE, log or _silent, refuse=not named)
    if not table.size:
        raise TableError("a header and no rows, expected samples", table.path)
    samples: dict[str | int, Any] = {}
    for key, name in columns.items():
        if key == "afferent":
            samples[key] = table.choices(name, ("", *AFFERENTS))
        elif key in _WHOSE[:3]:
            samples[key] = table.column(name)
        elif key == "node":
            samples[key] = table.numbers(name, 0, int)
        else:
            samples[key] = table.numbers(name, factor=(factors or {}).get(key, 1.0))
    return pd.DataFrame(samples, copy=False), table.error


def _columns_in(
    header: Sequence[str], asked: Mapping[str, Sequence[str]], path: Path
) -> dict[str | int, str]:
    """Columns of a `header`: by ``time``, by number of the value, and whose they are."""
    columns: dict[str | int, str] = {"time": asked["time"][0], **dict(enumerate(asked["value"]))}
    for key in _WHOSE:
        if key in asked or key in header:
            [columns[key]] = asked.get(key, [key])
    try:
        _check_header(header, list(columns.values()), path)
    except TableError as error:
        way_out = "; or say which: --columns time=NAME,value=NAME"
        raise TableError(error.problem + way_out, path, error.line) from None
    return columns


def _plain_table(path: Path, asked: Mapping[str, Sequence[str]]) -> "TextTable | None":
    """A table as we write it, its columns read as what they are; None of any other.

    Of ten million samples the cells as text would take gigabytes.
    """
    import pandas as pd

    always = tuple(map(int, pd.__version__.split(".")[:2])) >= (3, 1)
    exact: Any = {} if always else {"float_precision": "round_trip"}
    try:
        if not path.is_file():
            return None
        with path.open("rb") as file:
            line = file.readline(_HEADER_BYTES).decode("ascii")
            first_row = file.readline(_HEADER_BYTES)
        header = [name.strip(' "') for name in line.rstrip("\r\n").split(",")]
        if len(header) > MAX_COLUMNS or first_row.count(b",") != len(header) - 1:
            return None
        columns = _columns_in(header, asked, path)
        # The last column shows which rows are short, those without a name may be row numbers.
        kinds: dict[int, Any] = dict.fromkeys(_unnamed_in(header), object)
        kinds[len(header) - 1] = object
        for key, name in columns.items():
            kind: Any = {"node": np.int64}.get(str(key), np.float64)
            kinds[header.index(name)] = "category" if key in _WHOSE[:3] else kind
    except (OSError, ValueError, TableError):
        return None  # the other way says what is wrong, and where
    counts = _counts_of(path)
    if counts.separators != (len(header) - 1) * counts.rows:
        return None  # a row that is blank, or has other cells
    size_bytes = counts.rows * len(kinds) * _NUMBER_BYTES_PER_CELL
    check_memory(size_bytes, f"a table of {counts.rows} rows", TableError.at(path))
    try:
        with np.errstate(invalid="ignore"):  # a node past all whole numbers
            cells = pd.read_csv(
                path,
                header=None,
                skiprows=1,
                # With a selection pandas reads in one thread.
                usecols=sorted(kinds) if len(kinds) < len(header) else None,
                dtype=kinds,
                na_filter=False,
                skip_blank_lines=False,
                quoting=csv.QUOTE_NONE,
                **exact,
            )
    except (OSError, ValueError, OverflowError, TypeError):
        return None
    texts = [cells[header.index(columns[key])] for key in _WHOSE[:3] if key in columns]
    words = [str(word) for column in texts for word in column.cat.categories]
    if '"' in line or any('"' in word or word != word.strip() for word in words):
        return None
    if cells.shape[1] != len(kinds) or not len(cells):
        return None
    last = cells[len(header) - 1]
    if last.dtype == object and (last == "").any():
        return None  # perhaps a row that lacks a cell, and another with one too many
    warn_if_cut(path, counts.last_byte)
    return TextTable(path, tuple(header), cells, np.arange(len(cells)) + 2)


def _origin_file(path: Path) -> Path:
    """Where it is kept which run the traces of the table `path` are of."""
    return path.with_name(f"{path.name}.toml")


def _origin_of(path: Path) -> Origin | None:
    """The run that the traces of the table `path` are of, if that is known."""
    record = _origin_file(path)
    if not record.is_file():
        return None
    failed = TableError.at(record)
    table = read_toml(record, failed)
    if table.pop("traces_sha256", None) == sha256_of(path):
        return structure(table, Origin, failed)
    _warn(record, f"of another table than {path.name}, not used")
    return None


def write_origin(path: Path, origin: Origin | None) -> None:
    """Write of which run the traces of the table `path` are; None takes an earlier one away."""
    if origin is None:
        remove_file(_origin_file(path))
    else:
        table = {"traces_sha256": sha256_of(path), **unstructure(origin)}
        write_toml(_origin_file(path), table)


def read_spikes(path: Path) -> list[SpikeTrain]:
    """Spike trains of a table; each train's spikes come back in rising order.

    Raises
    ------
    TableError
        A column that is missing, duplicate or misspelt, or a row that is no spike. Other columns
        are named in a `FembridgeWarning`.
    """
    import pandas as pd

    table = read_table(path, SPIKE_COLUMNS, ("unit",), unused=partial(_warn, path))
    spikes = pd.DataFrame(
        {
            "stimulus": table.words("stimulus"),
            "afferent": table.choices("afferent", AFFERENTS),
            "unit": table.column("unit") if "unit" in table.header else "",
            "repeat": table.numbers("repeat", 0, int),
            "time_ms": table.numbers("spike_time_ms"),
        }
    )
    table.refuse_duplicates(spikes)
    times_ms = spikes.pop("time_ms").to_numpy()
    whose = {name: column.tolist() for name, column in spikes.items()}
    trains = []
    for rows in _groups_in(spikes, [*whose], path):
        stimulus, afferent, unit, repeat = (column[rows[0]] for column in whose.values())
        trains.append(SpikeTrain(stimulus, afferent, np.sort(times_ms[rows]), repeat, unit))
    return trains


def _groups_in(frame: "pd.DataFrame", keys: Sequence[Any], path: Path) -> list[IntArray]:
    """Rows of each group of equal `keys`, groups in the order in which they first appear."""
    if not keys or frame.empty:
        return [np.arange(len(frame))] if len(frame) else []
    number = frame.groupby(list(keys), sort=False, observed=True).ngroup().to_numpy()
    if number.max() >= MAX_GROUPS:
        raise TableError(
            f"{number.max() + 1} different {', '.join(map(str, keys))}, expected at most "
            f"{MAX_GROUPS}",
            path,
        )
    order = np.argsort(number, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(number[order])) + 1)


def spikes_frame(trains: Sequence[SpikeTrain]) -> "pd.DataFrame":
    """Table of `trains`: ``stimulus``, ``afferent``, ``repeat``, ``spike_time_ms``.

    Where units have names, ``unit`` stands behind ``afferent``.
    """
    import pandas as pd

    *whose, _ = _with_unit(SPIKE_COLUMNS, trains)
    rows = [[getattr(train, name) for name in whose] for train in trains]
    frame = pd.DataFrame(rows, columns=whose).astype({"repeat": np.int64})
    frame = frame.loc[frame.index.repeat([train.times_ms.size for train in trains])]
    times_ms = np.concatenate([np.zeros(0), *(train.times_ms for train in trains)])
    return frame.reset_index(drop=True).assign(spike_time_ms=times_ms)


def write_spikes(path: Path, trains: Iterable[SpikeTrain]) -> None:
    """Write a table of spikes, one train after the other."""
    frame = spikes_frame(list(trains))
    write_table(
        path, [*map(str, frame)], zip(*(frame[name].tolist() for name in frame), strict=True)
    )


def read_rates(source: "Path | TextTable") -> list[Rate]:
    """Rates of a table, a file or as it was read, in its order, to the last digit.

    Raises
    ------
    TableError
        A column that is missing, duplicate or misspelt, or a row that is no rate. Other columns
        of a file are named in a `FembridgeWarning`.
    """
    import pandas as pd

    table = (
        read_table(source, RATE_COLUMNS, ("unit",), unused=partial(_warn, source))
        if isinstance(source, Path)
        else source
    )
    stimuli, afferents = table.words("stimulus"), table.choices("afferent", AFFERENTS)
    rates_ips = table.numbers("rate_ips", least=0).tolist()
    units = table.column("unit") if "unit" in table.header else [""] * len(rates_ips)
    whose = {"stimulus": stimuli, "afferent": afferents, "unit": units}
    table.refuse_duplicates(pd.DataFrame(whose))
    return [Rate(*row) for row in zip(stimuli, afferents, rates_ips, units, strict=True)]


def write_rates(path: Path, rates: Iterable[Rate]) -> None:
    """Write a table of rates in the order given."""
    rates = list(rates)
    header = _with_unit(RATE_COLUMNS, rates)
    write_table(path, header, ([getattr(one, name) for name in header] for one in rates))


def _with_unit(columns: Sequence[str], rows: Sequence[SpikeTrain | Rate]) -> list[str]:
    """`columns` of a table of spikes or rates, with ``unit`` where units have names."""
    return [*columns[:2], *(["unit"] if any(one.unit for one in rows) else []), *columns[2:]]


def write_table(path: Path, header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a CSV table; a float as the shortest text that brings it back."""
    with replacing(path) as draft, draft.open("w", encoding="utf-8", newline="") as out:
        table = csv.writer(out, lineterminator="\n")
        table.writerow(header)
        table.writerows(rows)


@dataclass(frozen=True, slots=True, eq=False)
class TextTable:
    """The cells of a CSV table as text; every method names the line of a bad cell.

    `header` has the names of the columns and is on line `header_line`, `cells` their text by
    number of column, or numbers and categories where they came as such, and `lines` ``(row,)``
    the line of the file on which each row ends.
    """

    path: Path
    header: tuple[str, ...]
    cells: "pd.DataFrame"
    lines: IntArray
    header_line: int = 1

    @property
    def size(self) -> int:
        """Number of rows."""
        return self.lines.size

    def where(self, mask: BoolArray) -> "TextTable":
        """The rows of `mask` ``(row,)`` alone."""
        return replace(self, cells=self.cells[mask], lines=self.lines[mask])

    def column(self, name: str) -> NDArray[Any]:
        """Text of the cells of a column ``(row,)`` without blanks around it, or its categories."""
        return self._texts(self.header.index(name))

    def _texts(self, position: int) -> NDArray[Any]:
        cells = self.cells[position]
        if cells.dtype == "category":
            return cells.array  # type: ignore[no-any-return] # as good as an array
        if cells.dtype != object:
            cells = cells.astype(object).where(cells.notna(), "").map(str)
        return cells.str.strip().to_numpy(dtype=object)

    def words(self, name: str) -> NDArray[Any]:
        """Column of cells that must not be empty."""
        cells = self.column(name)
        self.refuse(cells == "", lambda row: f"{name} is empty")
        return cells

    def choices(self, name: str, choices: Sequence[str]) -> NDArray[Any]:
        """Column of cells that must be one of `choices`."""
        import pandas as pd

        cells = self.column(name)
        expected = ", ".join(filter(None, choices))
        self.refuse(
            ~pd.Series(cells).isin(choices).to_numpy(),
            lambda row: f"{name} is {_shown(cells[row])}, expected one of {expected}",
        )
        return cells

    def numbers(
        self,
        name: str,
        least: float = -math.inf,
        kind: type[float] = float,
        factor: float = 1.0,
    ) -> NDArray[Any]:
        """Column of finite numbers of a `kind`, `least` or more, multiplied by `factor`."""
        column = self.cells[self.header.index(name)]
        typed = column.dtype.kind in "iuf"
        cells = column.to_numpy() if typed else self.column(name)
        numbers = np.asarray(cells if typed else [*map(_number, cells)], dtype=np.float64)
        good = np.isfinite(numbers) & (numbers >= least)
        if kind is int:
            good &= (numbers % 1 == 0) & (numbers < _NO_WHOLE)
        expected = "a whole number" if kind is int else "a number"
        expected += f", {least:g} or more" if least > -math.inf else ""
        self.refuse(~good, lambda row: f"{name} is {_shown(cells[row])}, expected {expected}")
        if factor != 1.0:
            with np.errstate(over="ignore"):
                numbers = numbers * factor
            self.refuse(
                ~np.isfinite(numbers),
                lambda row: f"{name} is {_shown(cells[row])}, too large by a factor of {factor:g}",
            )
        return numbers.astype(kind, copy=False)

    def refuse_duplicates(self, keys: "pd.DataFrame") -> None:
        """Refuse two rows of the same `keys`, a row of them for each row here."""

        def problem(row: int) -> str:
            first = int((keys == keys.iloc[row]).all(axis=1).to_numpy().argmax())
            same = _cut(", ".join(filter(None, map(str, keys.iloc[row]))))
            return f"duplicate of line {self.lines[first]}: {same}"

        self.refuse(keys.duplicated().to_numpy(), problem)

    def refuse(self, bad: BoolArray, problem: Callable[[int], str]) -> None:
        """Refuse the table for the first row that is `bad` ``(row,)``."""
        if bad.any():
            row = int(bad.argmax())
            raise self.error(row, problem(row))

    def error(self, row: int, problem: str) -> TableError:
        """The error that names the line of `row`."""
        return TableError(problem, self.path, int(self.lines[row]))

    def unnamed(self) -> list[int]:
        """Positions of columns with content and no name; row numbers in front are none.

        Spreadsheets write empty columns at the end, pandas its index in front.
        """
        positions = []
        for position in _unnamed_in(self.header):
            cells = self._texts(position)
            texts = {str(cell) for cell in cells}
            is_index = len(texts) == len(cells) and all(map(_is_whole, texts))
            if texts - {""} and not (position == 0 and is_index):
                positions.append(position)
        return positions

    def check_header(self, columns: Sequence[str]) -> None:
        """Refuse a table that lacks one of `columns`, or has it twice; a TableError."""
        _check_header(self.header, columns, self.path, self.header_line)

    def check_columns(
        self,
        columns: Sequence[str],
        optional: Sequence[str],
        unused: Callable[[str], None] | None = None,
        *,
        refuse: bool = True,
    ) -> None:
        """Refuse or name columns that are neither in `columns` nor `optional`.

        `unused` gets the names of those that may be there; None: none may. One that may be a
        misspelt one of `optional` is refused, or, if not `refuse`, warned of.

        Raises
        ------
        TableError
            A column that is unknown, without a name, or a duplicate of one of `optional`.
        """
        for name in optional:
            if self.header.count(name) > 1:
                raise TableError(f"duplicate column {name}", self.path, self.header_line)
        expected = [*columns, *optional]
        absent = [name for name in optional if name not in self.header]
        others: dict[str, None] = {}
        for name in self.header:
            if name in expected or not name or _NO_NAME.fullmatch(name):
                continue
            is_note = unused is not None and name.casefold() in NOTE_COLUMNS
            near = "" if is_note else near_hint(_cut(name), expected if unused is None else absent)
            problem = f"unknown column {_cut(name)!r}{near}"
            if unused is None:
                problem += f"; expected {','.join(expected)}"
                raise TableError(problem, self.path, self.header_line)
            if near and refuse:
                problem += " If not, rename or remove it"
                raise TableError(problem, self.path, self.header_line)
            if near:
                _warn(self.path, f"{problem} It is not used: --columns says which is")
            else:
                others[_cut(name)] = None
        if unnamed := self.unnamed():
            problem = f"column {unnamed[0] + 1} has no name"
            if unused is None:
                problem += f"; expected {','.join(expected)}"
                raise TableError(problem, self.path, self.header_line)
            if refuse:
                _warn(self.path, f"{problem}: not used")
        if others and unused is not None:
            names = _cut(", ".join(others))
            unused(f"columns not used: {names}")


def read_table(
    source: "Path | pd.DataFrame",
    columns: Sequence[str] = (),
    optional: Sequence[str] | None = None,
    *,
    unused: Callable[[str], None] | None = None,
) -> TextTable:
    """A CSV table, which must have `columns`, as text; of a DataFrame a line is a row, from 1.

    Lines that begin with # are no rows. A last line without its end, a row with fewer cells than
    the header and a row behind a # are named in a `FembridgeWarning`.

    Parameters
    ----------
    optional
        Other columns that are read. A column that is none of them is refused, with the nearest
        name. None: other columns are ignored.
    unused
        Of a table that may have other columns: gets a line with their names. Refused are those
        that may be a misspelt one of `optional`.

    Raises
    ------
    TableError
        Absent, not UTF-8, not CSV, too large, a row longer than the header, a column that is
        missing, duplicate or unknown.
    """
    import pandas as pd

    if isinstance(source, pd.DataFrame):
        header = tuple(map(str, source.columns))
        _check_header(header, columns, _FRAME)
        cells = source.set_axis(range(len(header)), axis=1)
        words = cells.select_dtypes(exclude="number")
        cells[words.columns] = words.astype(object).where(words.notna(), "").map(str)
        table = TextTable(_FRAME, header, cells, np.arange(len(cells)) + 1)
    else:
        table = _text_table(_content(source), source, columns)
    if optional is not None:
        table.check_columns(columns, optional, unused)
    return table


def _content(path: Path) -> bytes:
    """The bytes of a table."""
    content = read_bytes(path, MAX_TABLE_BYTES, TableError.at(path))
    if b"\0" in content:
        raise TableError(
            "a binary file, expected a CSV table in UTF-8; of results `fembridge ingest` makes one",
            path,
        )
    warn_if_cut(path, content[-1:])
    return content


def warn_if_cut(path: Path, last_byte: bytes) -> None:
    """Warn of a text whose `last_byte` is no line end: its last value may be cut."""
    if last_byte and last_byte not in b"\r\n":
        _warn(path, "no line end behind the last row, whose last value may be cut")


def _text_table(content: bytes, path: Path, columns: Sequence[str] = ()) -> TextTable:
    """The table of a file in UTF-8, cells as text."""
    import pandas as pd

    content = content.removeprefix(codecs.BOM_UTF8)
    _check_utf8(content, path)
    begin, header_line = _behind_comments(content, path)
    try:
        stream = io.StringIO(content[begin : begin + _HEADER_BYTES].decode(errors="ignore"), "")
        header = tuple(name.strip() for name in next(csv.reader(stream), ()))
        if not header:
            raise TableError(f"empty, expected a header {','.join(columns)}".strip(), path)
        if len(content) - begin > _HEADER_BYTES and not stream.read(1):
            raise TableError(f"a header of more than {_HEADER_BYTES} bytes", path)
        _check_header(header, columns, path, header_line)
        _check_size(_counts_in(content), len(header), path)
        content = _without_comments(content[begin:], len(header), path, header_line)
        cells = pd.read_csv(
            io.BytesIO(content),
            header=None,
            dtype=object,
            na_filter=False,
            skip_blank_lines=False,
            encoding="utf-8",
        )
    except (csv.Error, pd.errors.ParserError) as error:
        raise _not_csv(content, path, error, header_line) from error
    if cells.shape[1] != len(header):
        raise TableError(f"{cells.shape[1]} columns, {len(header)} in the header", path)
    lines = np.arange(len(cells)) + header_line
    if b'"' in content:
        lines += _line_ends_in(cells, _counts_in(content).rows)
    empty = _is_blank(cells[0])
    for position in range(1, len(header)):
        rows = np.flatnonzero(empty)
        empty[rows] = _is_blank(cells[position].iloc[rows])
    empty[0] = True  # the header
    cells = cells[1:] if empty.sum() == 1 else cells[~empty]
    table = TextTable(path, header, cells, lines[~empty], header_line)
    _warn_of_short_rows(table, content, header_line)
    return table


def _is_utf8(content: bytes) -> bool:
    try:
        content.decode()
    except UnicodeDecodeError:
        return False
    return True


def _check_utf8(content: bytes, path: Path) -> None:
    try:
        content.decode()
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        byte = f"byte 0x{content[error.start]:02x}"
        raise TableError(f"{byte} is not UTF-8", path, line) from error


def _is_blank(cells: "pd.Series[Any]") -> BoolArray:
    """Whether each cell has no text; of millions that are equal one is stripped."""
    blank = [text for text in cells.unique() if not text.strip()]
    return np.array(cells.isin(blank) if blank else np.zeros(len(cells)), dtype=np.bool_)


class _Counts(NamedTuple):
    """What a table has before it is parsed; commas in quotes count, too."""

    rows: int
    separators: int
    size_bytes: int
    last_byte: bytes = b""

    @property
    def cells(self) -> int:
        return self.rows + self.separators


def _counts_in(content: bytes, separator: bytes = b",") -> _Counts:
    """Lines and separators of a text, whatever its lines end in."""
    ends = content.count(b"\n")
    if returns := content.count(b"\r"):
        ends += returns - content.count(b"\r\n")
    ends += content[-1:] not in (b"\n", b"\r", b"")
    return _Counts(ends, content.count(separator), len(content), content[-1:])


def _counts_of(path: Path) -> _Counts:
    """Lines that end in LF, and separators, of a file, block by block."""
    rows = separators = size_bytes = 0
    last_byte = b""
    with path.open("rb") as file:
        while block := file.read(_BLOCK_BYTES):
            codes = np.frombuffer(block, np.uint8)  # faster than bytes.count of a frequent one
            rows += int(np.count_nonzero(codes == ord("\n")))
            separators += int(np.count_nonzero(codes == ord(",")))
            size_bytes += len(block)
            last_byte = block[-1:]
    return _Counts(rows + (last_byte != b"\n"), separators, size_bytes, last_byte)


def _check_size(counts: _Counts, columns: int, path: Path) -> None:
    """Refuse a table whose cells would take too much memory, before any is parsed.

    Rows that lack cells are filled with empty ones: a file of line ends under a long header
    would take far more memory than its size.
    """
    if columns > MAX_COLUMNS:
        raise TableError(f"{columns} columns, expected at most {MAX_COLUMNS}", path)
    cells = counts.rows * columns
    if cells > max(_SMALL_CELLS, _MOST_CELLS_PER_BYTE * counts.size_bytes):
        raise TableError(
            f"{counts.rows} lines under a header of {columns} columns, but the file has "
            f"{size_text(counts.size_bytes)}: most cells are absent",
            path,
        )
    size_bytes = counts.size_bytes * _TEXT_BYTES_PER_BYTE + cells * _TEXT_BYTES_PER_CELL
    check_memory(size_bytes, f"a table of {counts.rows} x {columns} cells", TableError.at(path))


def _behind_comments(content: bytes, path: Path) -> tuple[int, int]:
    """Where the first line that is no comment begins, and its number."""
    at, line = 0, 1
    while content.startswith(b"#", at) and (end := content.find(b"\n", at)) >= 0:
        at, line = end + 1, line + 1
        if line > _MOST_LINES_ABOVE:
            raise TableError(f"no header in the first {_MOST_LINES_ABOVE} lines", path)
    return at, line


def _without_comments(content: bytes, columns: int, path: Path, header_line: int) -> bytes:
    """`content` with an empty line for each comment; a comment with as many cells is named."""
    if b"\n#" not in content:
        return content
    rows = [one for one in _COMMENT.finditer(content) if one[0].count(b",") == columns - 1]
    if rows and columns > 1:
        line = header_line + content.count(b"\n", 0, rows[0].start())
        more = f", as do {len(rows) - 1} more rows" if len(rows) > 1 else ""
        _warn(path, f"a row begins with #{more}: not read", line)
    return _COMMENT.sub(b"", content)


def _line_ends_in(cells: "pd.DataFrame", lines: int) -> IntArray:
    """Line ends in quoted cells ``(row,)``, up to each row; `lines` are those of the text."""
    ends = np.zeros(len(cells), dtype=np.int64)
    if lines != len(cells):
        for position in cells:
            ends += cells[position].str.count(r"\r\n|\r|\n").to_numpy(dtype=np.int64)
    return np.cumsum(ends)


def _warn_of_short_rows(table: TextTable, content: bytes, line: int, separator: str = ",") -> None:
    """Name the first row that has fewer cells than the header has names.

    `content` begins with `line`.
    """
    columns = max((at for at, name in enumerate(table.header, start=1) if name), default=0)
    last = table.cells[columns - 1] if columns > 1 else None
    if last is None or last.dtype.kind in "iuf" or not (last == "").any():
        return
    stream = io.TextIOWrapper(io.BytesIO(content), "utf-8", "replace", newline="")
    if b'"' in content and separator != " ":
        reader = csv.reader(stream, delimiter=separator)
        rows = ((reader.line_num, len(row)) for row in reader if any(map(str.strip, row)))
    else:
        rows = (
            (number, len(row.split(None if separator == " " else separator)))
            for number, row in enumerate(stream, start=1)
            if row.strip(f"{separator} \t\r\n")
        )
    with suppress(csv.Error):
        for number, count in rows:
            if count < columns:
                problem = f"{count} of the {columns} cells in the header"
                _warn(table.path, f"{problem}: the others are taken as empty", line + number - 1)
                return


def _silent(line: str) -> None:
    """A log of nothing."""


def _cut(text: str) -> str:
    """`text` at a length that fits into a message."""
    return text if len(text) <= _LONGEST_SHOWN else f"{text[: _LONGEST_SHOWN - 3]}..."


def _shown(cell: object) -> str:
    """A cell in a message: text in quotes."""
    return repr(_cut(cell)) if isinstance(cell, str) else str(cell)


def _unnamed_in(header: Sequence[str]) -> list[int]:
    """Positions of columns without a name."""
    return [at for at, name in enumerate(header) if not name or _NO_NAME.fullmatch(name)]


def _is_whole(text: str) -> bool:
    return text.isascii() and text.isdigit()


def header_in(text: str, path: Path) -> tuple[list[str], int, str]:
    """Columns of any program's table, where the rows below them begin, and what separates cells.

    `text` is the table, or its beginning.

    Raises
    ------
    TableError
        More columns than `MAX_COLUMNS`, or no header in the first lines.
    """
    line, at = "", 0
    for number in itertools.count(1):
        if at >= len(text):
            break
        if number > _MOST_LINES_ABOVE:
            raise TableError(f"no header in the first {_MOST_LINES_ABOVE} lines", path)
        end = text.find("\n", at) + 1 or len(text)
        if end - at > _HEADER_BYTES:
            raise TableError(f"a header of more than {_HEADER_BYTES} bytes", path, number)
        now, begin, at = text[at:end].strip(), at, end
        if not now:
            continue
        comment = now.startswith(_COMMENT_SIGNS)
        if line.startswith(_COMMENT_SIGNS) and not comment and _numbers_in(now):
            at = begin  # the comment before it was the header
            break
        line = now
        if not comment:
            break
    line = line.lstrip("".join(_COMMENT_SIGNS)).strip()
    separator = next((sign for sign in (";", "\t", ",") if sign in line), " ")
    if separator == " ":
        names = line.split()
    else:
        try:
            names = [cell.strip() for cell in next(csv.reader([line], delimiter=separator))]
        except csv.Error as error:
            raise TableError(f"not CSV: {error}", path) from error
    if len(names) > MAX_COLUMNS:
        raise TableError(f"{len(names)} columns, expected at most {MAX_COLUMNS}", path)
    return names, at, separator


def _cells_in(rows: bytes, width: int, separator: str) -> "pd.DataFrame":
    """Cells behind a header of `width`; or a ValueError."""
    import pandas as pd

    start = rows[: 2 * _HEADER_BYTES].decode(errors="replace").lstrip("\r\n")
    first = next((line for line in start[:_HEADER_BYTES].split("\n") if line.strip()), "")
    if len(first) >= _HEADER_BYTES or (not first and len(rows) > _HEADER_BYTES):
        raise ValueError(f"no whole row in the first {_HEADER_BYTES} bytes below the header")
    blank = separator == " "
    cells = (
        first.split() if blank else next(csv.reader([first.strip("\r")], delimiter=separator), [])
    )
    if cells and len(cells) != width:
        raise ValueError(f"{len(cells)} cells under a header of {width}: {first[:60]!r}")
    return pd.read_csv(
        io.BytesIO(rows),
        sep=r"\s+" if blank else separator,
        decimal="," if separator == ";" and not re.search(r"\d\.\d", start[:4096]) else ".",
        header=None,
        names=range(width),
        skipinitialspace=True,
        index_col=False,
        na_filter=False,
        low_memory=False,
        encoding="utf-8",
        encoding_errors="replace",
    )


def _numbers_in(line: str) -> bool:
    """Whether a line begins with a number."""
    return re.match(r"[+-]?\.?\d", line) is not None


def _others_table(content: bytes, path: Path) -> TextTable | None:
    """A table as other programs write it, with lines of %, or no commas; None of any other."""
    content = content.removeprefix(codecs.BOM_UTF8)
    start = content[:_START_BYTES].decode(errors="replace")
    header, begin, separator = header_in(start, path)
    if separator == "," and not start.lstrip().startswith("%"):
        at, _ = _behind_comments(content, path)
        row = content[at : at + _LONGEST_SHOWN].decode(errors="replace").lstrip()
        if not (at and _numbers_in(row)) and _is_utf8(content):
            return None
    _check_size(_counts_in(content, separator.encode()), len(header), path)
    above = start.count("\n", 0, begin)
    at = 0
    for _ in range(above):
        at = content.index(b"\n", at) + 1
    rows = content[at:] if begin < len(start) else b""
    try:
        table = read_table(_cells_in(rows, len(header), separator).set_axis(header, axis=1))
    except (ValueError, csv.Error) as error:
        raise TableError(f"no table: {_cut(str(error))}", path) from error
    table = replace(table, path=path, lines=table.lines + above, header_line=max(above, 1))
    _warn_of_short_rows(table, rows, above + 1, separator)
    return table


def _check_header(header: Sequence[str], columns: Sequence[str], path: Path, line: int = 1) -> None:
    for separator, name in _SEPARATORS.items():
        if len(header) == 1 and separator in header[0]:
            raise TableError(
                f"{_cut(header[0])!r} is separated by {name}, expected commas", path, line
            )
    for name in columns:
        if header.count(name) != 1:
            problem = "duplicate" if name in header else "no"
            others = [other for other in header if other not in columns]
            near = "" if name in header else near_hint(name, map(_cut, others[:_MOST_COMPARED]))
            raise TableError(
                f"{problem} column {name} in {_cut(','.join(header))!r}, "
                f"expected a header with {','.join(columns)}{near}",
                path,
                line,
            )


def _not_csv(
    content: bytes, path: Path, problem: ValueError | csv.Error, header_line: int = 1
) -> TableError:
    """What pandas says of `content`, with the line, in our words."""
    if cut := _IN_QUOTES.search(str(problem)):
        return TableError("not CSV: a quote is not closed", path, int(cut[1]) + header_line)
    if not (cells := _TOO_MANY_CELLS.search(str(problem))):
        return TableError(f"not CSV: {problem}", path)
    expected, line, count = map(int, cells.groups())
    stream = io.TextIOWrapper(io.BytesIO(content), "utf-8", newline="")
    row = next(itertools.islice(stream, line - 1, line), "").rstrip("\r\n")
    whole, _, decimals = row.rpartition(",")
    whole = whole.rpartition(",")[2]
    hint = ""
    if count == expected + 1 and whole.isdecimal() and decimals.isdecimal():
        hint = f"; '{_cut(f'{whole},{decimals}')}' looks like a decimal comma, expected a point"
    line += header_line - 1
    return TableError(f"{count} cells, expected {expected} as in the header{hint}", path, line)


def _number(cell: str) -> float:
    """The number in a cell; NaN where it is none."""
    try:
        return parse_number(cell)
    except ValueError:
        return math.nan
