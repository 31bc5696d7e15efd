"""Long CSV tables: one row a sample, a spike or a rate, in and out.

``traces``  ``time_ms,afferent,node,von_mises_pa``; afferent may be empty, all but time and
            stress may be missing, ``unit`` and ``stimulus`` may name what differs else
``spikes``  ``stimulus,afferent,repeat,spike_time_ms``; a silent train has no row
``rates``   ``stimulus,afferent,rate_ips``

Where units have names, ``unit`` stands behind ``afferent`` in spikes and rates.

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
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from decks.unit_system import UNIT_SYSTEMS
from fembridge.errors import TableError, TraceError, UsageError
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
_FRAME = Path("DataFrame")
_LONGEST_HEADER = 1 << 16
_NO_WHOLE = 2.0**53  # from here on a float is not every whole number
_NOT_UTF8 = "\N{REPLACEMENT CHARACTER}"  # what becomes of such a byte
_SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars"}
_TOO_MANY_CELLS = re.compile(r"Expected (\d+) fields in line (\d+), saw (\d+)")  # pandas
_COMMENT_SIGNS = ("%", "#")
_COMMENTS = re.compile("(?:#.*\\n)*")
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

    Parameters
    ----------
    log
        Gets a remark where the table does not end in a line end: its last number may be
        cut; and what resampling leaves out.
    columns
        Names of columns by `TRACE_KEYS`, where they are others. Several values are a
        trace each, whose unit is the column's name. ``time`` is in s unless its name ends
        in another unit, as ``t_ms`` or ``t [us]``.
    gain_pa
        What a value of 1 is in Pa. None: as the name of its column ends, in ``_pa`` or
        ``[kPa]``.
    resample_ms
        The step of the even grid on which traces are put.
    """
    named = {key: [one] if isinstance(one, str) else one for key, one in (columns or {}).items()}
    if unknown := [key for key in named if key not in TRACE_KEYS]:
        raise UsageError(f"column {unknown[0]!r}, expected one of {', '.join(TRACE_KEYS)}")
    in_ms = "time_ms" in named
    asked = {"value": ["von_mises_pa"], **named}
    asked["time"] = named.get("time_ms", named.get("time", ["time_ms"]))
    samples, error = samples_in(source, asked, named=bool(columns))
    said: set[str] = set()
    name = str(source) if isinstance(source, Path) else "traces"

    def say(line: str) -> None:
        if log is not None and line not in said:
            log(f"{name}: {line}")
        said.add(line)

    traces = Traces()
    if isinstance(source, Path):
        with source.open("rb") as file:
            file.seek(-1, os.SEEK_END)
            if file.read(1) not in b"\r\n":
                say("no line end behind the last number, which may be cut")
        traces = Traces(origin=_origin_of(source, log))
    [time], values = asked["time"], asked["value"]
    to_ms = ms_per(time, in_ms, say)
    keys = [key for key in _WHOSE if key in samples]
    parts: Any = samples.groupby(keys, sort=False, observed=True) if keys else [((), samples)]
    for key, part in parts:
        whose = dict(zip(keys, key, strict=True))
        stimulus, afferent, unit = (str(whose.get(key, "")) for key in _WHOSE[:3])
        node = int(whose.get("node", 0))
        who = " ".join(filter(None, [stimulus, afferent, unit, f"node {node}" if node else ""]))
        who = who or "the trace"
        rows = part.index.to_numpy()
        if len(rows) < 2:
            raise error(rows[0], f"{who}: one sample, expected more")
        times_ms = part["time"].to_numpy() * to_ms
        even_ms, odd = mean_step(times_ms)
        if odd is not None and resample_ms is None:
            before_ms, after_ms = times_ms[odd : odd + 2]
            raise error(
                rows[odd + 1],
                f"{who}: time goes from {before_ms:g} to {after_ms:g} ms, expected an even step: "
                "--resample-ms 0.5 (resample_ms) of encode or ingest makes one",
            )
        for number, value in enumerate(values):
            stress_pa = part[number].to_numpy() * _to_pa(value, gain_pa)
            if resample_ms is not None:
                if odd is None and (doubt := doubt_of_step(stress_pa, even_ms, resample_ms)):
                    say(f"{who}: {doubt}")
                try:
                    _, stress_pa = resample(times_ms, stress_pa, resample_ms, say)
                except TraceError as problem:
                    raise error(rows[0], f"{who}: {problem}") from problem
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
    return traces


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
    source: "Path | pd.DataFrame", asked: Mapping[str, Sequence[str]], *, named: bool
) -> "tuple[pd.DataFrame, Callable[[int, str], TableError]]":
    """Samples of a table of traces, and what makes an error of a row.

    `asked` has names of columns by ``time``, ``value`` and whose they are. Columns of the
    samples are ``time``, the number of a value from 0 on, and whose they are. A table whose
    columns are `named` may be as other programs write it.
    """
    import pandas as pd

    table = None
    if isinstance(source, Path):
        table = _plain_table(source, asked) or (_others_table(source) if named else None)
    table = table or read_table(source)
    found = _found(table.header, asked, table.path)
    if not table.size:
        raise TableError("a header and no rows, expected samples", table.path)
    samples: dict[str | int, Any] = {}
    for key, name in found.items():
        if key == "afferent":
            samples[key] = table.choices(name, ("", *AFFERENTS))
        elif key in _WHOSE[:3]:
            samples[key] = table.column(name)
        elif key == "node":
            samples[key] = table.numbers(name, 0, int)
        else:
            samples[key] = table.numbers(name)
    return pd.DataFrame(samples, copy=False), table.error


def _found(
    header: Sequence[str], asked: Mapping[str, Sequence[str]], path: Path
) -> dict[str | int, str]:
    """Columns of a `header`: by ``time``, by number of the value, and whose they are."""
    found: dict[str | int, str] = {"time": asked["time"][0], **dict(enumerate(asked["value"]))}
    for key in _WHOSE:
        if key in asked or header.count(key) == 1:
            [found[key]] = asked.get(key, [key])
    try:
        _check_header(header, list(found.values()), path)
    except TableError as error:
        way_out = "; or say which: --columns time=NAME,value=NAME"
        raise TableError(error.problem + way_out, path, error.line) from None
    return found


def _plain_table(path: Path, asked: Mapping[str, Sequence[str]]) -> "TextTable | None":
    """A table as we write it, its columns read as what they are; None of any other.

    Of ten million samples the cells as text would take gigabytes.
    """
    import pandas as pd

    always = tuple(map(int, pd.__version__.split(".")[:2])) >= (3, 1)
    exact: Any = {} if always else {"float_precision": "round_trip"}
    try:
        with path.open("rb") as file:
            line = file.readline(_LONGEST_HEADER).decode("ascii")
        header = [name.strip(' "') for name in line.rstrip("\r\n").split(",")]
        kinds: dict[int, Any] = dict.fromkeys(range(len(header)), "category")
        found = _found(header, asked, path)
        for key in found.keys() - set(_WHOSE[:3]):
            kinds[header.index(found[key])] = np.int64 if key == "node" else np.float64
        with np.errstate(invalid="ignore"):  # a node past all whole numbers
            cells = pd.read_csv(
                path,
                header=None,
                skiprows=1,
                dtype=kinds,
                na_filter=False,
                skip_blank_lines=False,
                quoting=csv.QUOTE_NONE,
                **exact,
            )
    except (OSError, ValueError, OverflowError, TypeError, TableError):
        return None  # the other way says what is wrong, and where
    texts = [cells[header.index(found[key])] for key in _WHOSE[:3] if key in found]
    words = [str(word) for column in texts for word in column.cat.categories]
    if '"' in line or any('"' in word or word != word.strip() for word in words):
        return None
    if cells.shape[1] != len(header) or not len(cells):
        return None
    return TextTable(path, tuple(header), cells, np.arange(len(cells)) + 2)


def _origin_file(path: Path) -> Path:
    """Where it is kept which run the traces of the table `path` are of."""
    return path.with_name(f"{path.name}.toml")


def _origin_of(path: Path, log: Callable[[str], None] | None) -> Origin | None:
    """The run that the traces of the table `path` are of, if that is known."""
    record = _origin_file(path)
    if not record.is_file():
        return None
    failed = TableError.at(record)
    table = read_toml(record, failed)
    if table.pop("traces_sha256", None) == sha256_of(path):
        return structure(table, Origin, failed)
    if log is not None:
        log(f"{record}: of another table than {path.name}, not used")
    return None


def write_origin(path: Path, origin: Origin | None) -> None:
    """Write of which run the traces of the table `path` are; None takes an earlier one away."""
    if origin is None:
        remove_file(_origin_file(path))
    else:
        table = {"traces_sha256": sha256_of(path), **unstructure(origin)}
        write_toml(_origin_file(path), table)


def read_spikes(path: Path) -> list[SpikeTrain]:
    """Spike trains of a table; each train's spikes come back in rising order."""
    import pandas as pd

    table = read_table(path, SPIKE_COLUMNS)
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
    trains = []
    for _, part in spikes.groupby(["stimulus", "afferent", "unit", "repeat"], sort=False):
        stimulus, afferent, unit, repeat, _ = part.iloc[0]
        trains.append(SpikeTrain(stimulus, afferent, np.sort(part["time_ms"]), int(repeat), unit))
    return trains


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
    """Rates of a table, a file or as it was read, in its order, to the last digit."""
    import pandas as pd

    table = read_table(source, RATE_COLUMNS) if isinstance(source, Path) else source
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

    `header` has the names of the columns, `cells` their text by number of column,
    without blanks around it, or numbers and categories where they came as such, and
    `lines` ``(row,)`` the line of the file on which each row ends.
    """

    path: Path
    header: tuple[str, ...]
    cells: "pd.DataFrame"
    lines: IntArray

    @property
    def size(self) -> int:
        """Number of rows."""
        return self.lines.size

    def where(self, mask: BoolArray) -> "TextTable":
        """The rows of `mask` ``(row,)`` alone."""
        return replace(self, cells=self.cells[mask], lines=self.lines[mask])

    def column(self, name: str) -> NDArray[Any]:
        """Text of the cells of a column ``(row,)``, or its categories."""
        cells = self.cells[self.header.index(name)]
        if cells.dtype == "category":
            return cells.array  # type: ignore[no-any-return] # as good as an array
        if cells.dtype != object:
            cells = cells.astype(object).where(cells.notna(), "").map(str)
        return cells.to_numpy(dtype=object)

    def words(self, name: str) -> NDArray[Any]:
        """Column of cells that must not be empty."""
        cells = self.column(name)
        self.refuse(cells == "", lambda row: f"{name} is empty")
        return cells

    def choices(self, name: str, choices: Sequence[str]) -> NDArray[Any]:
        """Column of cells that must be one of `choices`."""
        import pandas as pd

        cells = self.column(name)
        known = ", ".join(filter(None, choices))
        self.refuse(
            ~pd.Series(cells).isin(choices).to_numpy(),
            lambda row: f"{name} is {cells[row]!r}, expected one of {known}",
        )
        return cells

    def numbers(
        self, name: str, least: float = -math.inf, kind: type[float] = float
    ) -> NDArray[Any]:
        """Column of finite numbers of a `kind`, `least` or more."""
        column = self.cells[self.header.index(name)]
        typed = column.dtype.kind in "iuf"
        cells = column.to_numpy() if typed else self.column(name)
        numbers = np.asarray(cells if typed else [*map(_number, cells)], dtype=np.float64)
        good = np.isfinite(numbers) & (numbers >= least)
        if kind is int:
            good &= (numbers % 1 == 0) & (numbers < _NO_WHOLE)
        wanted = "a whole number" if kind is int else "a number"
        wanted += f", {least:g} or more" if least > -math.inf else ""

        def problem(row: int) -> str:
            cell = cells[row]
            return f"{name} is {repr(cell) if isinstance(cell, str) else cell}, expected {wanted}"

        self.refuse(~good, problem)
        return numbers.astype(kind, copy=False)

    def refuse_duplicates(self, keys: "pd.DataFrame") -> None:
        """Refuse two rows of the same `keys`, a row of them for each row here."""

        def problem(row: int) -> str:
            first = int((keys == keys.iloc[row]).all(axis=1).to_numpy().argmax())
            same = ", ".join(filter(None, map(str, keys.iloc[row])))
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


def read_table(
    source: "Path | pd.DataFrame",
    columns: Sequence[str] = (),
    optional: Sequence[str] | None = None,
) -> TextTable:
    """A CSV table, which must have `columns`, as text; of a DataFrame a line is a row, from 1.

    Lines that begin with # are no rows. Where `optional` is given, it has no other columns.

    Raises
    ------
    TableError
        Absent, not UTF-8, not CSV, a row longer than the header, a column that is
        missing or duplicate.
    """
    import pandas as pd

    if isinstance(source, pd.DataFrame):
        path, header = _FRAME, tuple(map(str, source.columns))
        _check_header(header, columns, path, optional=optional)
        cells = source.set_axis(range(len(header)), axis=1)
        words = cells.select_dtypes(exclude="number")
        cells[words.columns] = words.astype(object).where(words.notna(), "").map(str)
        return TextTable(path, header, cells, np.arange(len(cells)) + 1)
    path, text = source, _decoded(source)
    try:
        above = text[: len(text) - len(_COMMENTS.sub("", text, count=1))]
        rows = csv.reader(io.StringIO(text[len(above) :], newline=""))
        header = tuple(name.strip() for name in next(rows, ()))
        if not header:
            raise TableError(f"empty, expected a header {','.join(columns)}".strip(), path)
        _check_header(header, columns, path, 1 + above.count("\n"), optional)
        if "#" in text:
            blank = "," * (len(header) - 1) or '""'
            text = re.sub("^#.*", blank, text, flags=re.MULTILINE)
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
    lines = np.arange(len(cells)) + 1
    if '"' in text:  # a cell may have several
        rows = csv.reader(io.StringIO(text, newline=""))
        lines = np.array([rows.line_num for _ in rows])
    filled = np.flatnonzero((cells != "").any(axis=1))[1:]
    return TextTable(path, header, cells.iloc[filled], lines[filled])


def header_in(text: str) -> tuple[list[str], str, str]:
    """Columns of any program's table, the text behind their line, and what separates cells."""
    line, at = "", 0
    while at < len(text):
        end = text.find("\n", at) + 1 or len(text)
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
    separator = next((one for one in (";", "\t", ",") if one in line), " ")
    if separator == " ":
        return line.split(), text[at:], separator
    cells = next(csv.reader([line], delimiter=separator))
    return [cell.strip() for cell in cells], text[at:], separator


def _cells_in(text: str, width: int, separator: str) -> "pd.DataFrame":
    """Cells behind a header of `width`; or a ValueError."""
    import pandas as pd

    first = next((line for line in text.splitlines() if line.strip()), "")
    blank = separator == " "
    cells = first.split() if blank else next(csv.reader([first], delimiter=separator), [])
    if cells and len(cells) != width:
        raise ValueError(f"{len(cells)} cells under a header of {width}: {first[:60]!r}")
    return pd.read_csv(
        io.StringIO(text),
        sep=r"\s+" if blank else separator,
        decimal="," if separator == ";" and not re.search(r"\d\.\d", text[:4096]) else ".",
        header=None,
        names=range(width),
        skipinitialspace=True,
        index_col=False,
    )


def _numbers_in(line: str) -> bool:
    """Whether a line begins with a number."""
    return re.match(r"[+-]?\.?\d", line) is not None


def _others_table(path: Path) -> TextTable | None:
    """A table as other programs write it, with lines of %, or no commas; None of any other."""
    text = _decoded(path, "replace")
    header, rest, separator = header_in(text)
    commented = _numbers_in(_COMMENTS.sub("", text, count=1).lstrip())
    ours = not (commented or text.lstrip().startswith("%") or _NOT_UTF8 in text)
    if separator == "," and ours:
        return None
    try:
        table = read_table(_cells_in(rest, len(header), separator).set_axis(header, axis=1))
    except ValueError as error:
        raise TableError(f"no table: {str(error)[:120]}", path) from error
    above = text[: len(text) - len(rest)].count("\n")
    return replace(table, path=path, lines=table.lines + above)


def _decoded(path: Path, errors: str = "strict") -> str:
    content = read_bytes(path, MAX_TABLE_BYTES, TableError.at(path))
    if b"\0" in content:
        raise TableError(
            "a binary file, expected a CSV table in UTF-8; of results `fembridge ingest` makes one",
            path,
        )
    try:
        return content.decode("utf-8-sig", errors)
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        found = f"byte 0x{content[error.start]:02x}"
        raise TableError(f"{found} is not UTF-8", path, line) from error


def _check_header(
    header: Sequence[str],
    columns: Sequence[str],
    path: Path,
    line: int = 1,
    optional: Sequence[str] | None = None,
) -> None:
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
    for name in () if optional is None else header:
        names = (*columns, *(optional or ()))
        if name not in names or header.count(name) > 1:
            problem = "duplicate" if name in names else "unknown"
            raise TableError(
                f"{problem} column {name!r}, expected {', '.join(names)}{near_hint(name, names)}",
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


def _number(cell: str) -> float:
    """The number in a cell; NaN where it is none."""
    try:
        return parse_number(cell)
    except ValueError:
        return math.nan
