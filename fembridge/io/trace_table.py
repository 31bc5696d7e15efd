"""Stress traces as CSV tables: ``time_ms,afferent,node,von_mises_pa``, a row a sample.

``afferent`` may be empty, all columns but time and stress may be missing, and ``unit`` and
``stimulus`` distinguish traces of one class.
"""

import csv
import logging
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge.errors import TableError, TraceError, UsageError, warn
from fembridge.host.memory import check_memory
from fembridge.host.store import (
    read_toml,
    remove_file,
    sha256_of,
    structure,
    unstructure,
    write_toml,
)
from fembridge.io.column_units import ms_per, to_pa
from fembridge.io.sensor_table import resampled_step_ms
from fembridge.io.text_table import (
    HEADER_BYTES,
    MAX_COLUMNS,
    TextTable,
    check_header,
    count_cells,
    cut_text,
    discard_line,
    parse_foreign_table,
    parse_text_table,
    read_content,
    read_table,
    row_groups,
    unnamed_columns,
    warn_if_cut,
)
from fembridge.trace import (
    AFFERENTS,
    Origin,
    StressTrace,
    Traces,
    check_growth,
    doubt_of_gaps,
    doubt_of_step,
    mean_step,
    middle_step,
    resample,
)
from fembridge.typing import FloatArray

if TYPE_CHECKING:
    import pandas as pd
_LOGGER = logging.getLogger(__name__)


_LABELS = ("stimulus", "afferent", "unit", "node")
TRACE_KEYS = ("time", "time_ms", "value", *_LABELS)
"""What the columns of another table of traces can be."""
_NUMBER_BYTES_PER_CELL = 28
_LONG_STEP_MS = 20.0  # of a history of touch: it has changes that are faster


def read_traces(
    source: "Path | pd.DataFrame",
    *,
    columns: Mapping[str, str | Sequence[str]] | None = None,
    gain_pa: float | None = None,
    resample_ms: float | None = None,
    is_sensor: bool = False,
) -> Traces:
    """Traces of a table, in the order in which their units first appear, and their run.

    A doubt is a `FembridgeWarning`: a table that may be cut, a record of another table, times
    whose unit is not stated, power or samples that resampling loses.

    Parameters
    ----------
    columns
        Names of columns by `TRACE_KEYS`, where they are others. Several values are a
        trace each, whose unit is the column's name. ``time`` is in s unless its name ends
        in another unit, as ``t_ms`` or ``t [us]``.
    gain_pa
        What a value of 1 is in Pa. None: as the name of its column ends, in ``_pa`` or
        ``[kPa]``.
    resample_ms
        The step of the even grid on which traces are put.
    is_sensor
        Whether the table is of a sensor: samples at uneven times are put on an even grid.

    Raises
    ------
    TableError
        A column that is missing, duplicate or misspelt, a row that is no sample.
    """
    names = {
        key: [name] if isinstance(name, str) else name for key, name in (columns or {}).items()
    }
    if unknown := [key for key in names if key not in TRACE_KEYS]:
        expected = f"one of {', '.join(TRACE_KEYS)}"
        problem = f"has {unknown[0]!r}, expected {expected}"
        raise UsageError(problem, argument="columns", found=unknown[0], expected=expected)
    in_ms = "time_ms" in names
    columns_by_key = {"value": ["von_mises_pa"], **names}
    columns_by_key["time"] = names.get("time_ms", names.get("time", ["time_ms"]))
    [time], values = columns_by_key["time"], columns_by_key["value"]
    path = source if isinstance(source, Path) else Path("traces")
    logged: set[str] = set()

    def say(line: str) -> None:
        if line not in logged:
            _LOGGER.info(f"{path}: {line}")
        logged.add(line)

    def say_uneven(line: str) -> None:
        say(f"samples at uneven times are {line}")

    assumed: list[str] = []
    factors: dict[str | int, float] = {"time": ms_per(time, in_ms, assumed.append)}
    factors |= {number: to_pa(value, gain_pa) for number, value in enumerate(values)}
    samples, error = samples_in(
        source, columns_by_key, named=bool(columns), factors=factors, log=say
    )
    traces, doubts, resampled = Traces(), [], 0
    if isinstance(source, Path):
        traces = Traces(origin=_origin_of(source))
    keys = [key for key in _LABELS if key in samples]
    numbers = {key: samples[key].to_numpy() for key in samples if key not in _LABELS[:3]}
    groups = row_groups(samples, keys, path)
    firsts = samples.iloc[[rows[0] for rows in groups]]
    labels = [firsts[key].tolist() if key in samples else [""] * len(groups) for key in _LABELS[:3]]
    for rows, stimulus, afferent, unit in zip(groups, *labels, strict=True):
        first = int(rows[0])
        node = int(numbers["node"][first]) if "node" in keys else 0
        who = " ".join(filter(None, [stimulus, afferent, unit, f"node {node}" if node else ""]))
        who = cut_text(who) or "the trace"
        if len(rows) < 2:
            raise error(first, f"{who}: one sample, expected more")
        times_ms = numbers["time"][rows]
        with np.errstate(over="ignore", invalid="ignore"):  # of 1e308
            even_ms, odd = mean_step(times_ms)
        step_ms = resample_ms
        if odd is not None and is_sensor and step_ms is None:
            step_ms = resampled_step_ms(middle_step(np.diff(times_ms)))
        note = say if odd is None else say_uneven
        if odd is not None and step_ms is None:
            before_ms, after_ms = times_ms[odd : odd + 2]
            raise error(
                rows[odd + 1],
                f"{who}: time goes from {before_ms:g} to {after_ms:g} ms, expected an even step: "
                "--resample-ms 0.5 (resample_ms) of encode or ingest makes one",
            )
        for number, value in enumerate(values):
            stress_pa = numbers[number][rows]
            if step_ms is not None:
                doubt = (
                    doubt_of_step(stress_pa, even_ms, step_ms)
                    if odd is None
                    else doubt_of_gaps(times_ms)
                )
                if doubt:
                    doubts.append(f"{who}: {doubt}")
                try:
                    length = _length_at(times_ms, step_ms)
                    resampled += length
                    check_growth(len(samples), resampled, length)
                    _, stress_pa = resample(times_ms, stress_pa, step_ms, note)
                except TraceError as problem:
                    raise error(first, f"{who}: {problem}") from problem
            traces.append(
                StressTrace(
                    stress_pa,
                    step_ms or even_ms,
                    node,
                    afferent or None,
                    float(times_ms[0]),
                    f"{unit} {value}".strip() if len(values) > 1 else unit,
                    stimulus,
                )
            )
    for line in assumed:
        longest_ms = min(trace.dt_ms for trace in traces)
        if longest_ms > _LONG_STEP_MS:
            warn(f"a sample every {longest_ms:g} ms: {line}", path)
        elif not is_sensor:  # reported with the columns
            say(line)
    if doubt := _doubt_of_ends(traces):
        warn(doubt, path)
    if doubts:
        more = f" (and of {len(doubts) - 1} more)" if len(doubts) > 1 else ""
        warn(f"{doubts[0]}{more}", path)
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
            return f"{cut_text(who)} ends at {end_ms:g} ms, others at {other_ms:g} ms: a cut table?"
    return None


def samples_in(
    source: "Path | pd.DataFrame",
    columns_by_key: Mapping[str, Sequence[str]],
    *,
    named: bool,
    factors: Mapping[str | int, float] | None = None,
    log: Callable[[str], None] | None = None,
) -> "tuple[pd.DataFrame, Callable[[int, str], TableError]]":
    """Samples of a table of traces, and what makes an error of a row.

    `columns_by_key` has names of columns by ``time``, ``value`` and labels (``afferent``, ...).
    Columns of the samples are ``time``, the number of a value from 0, and the labels; numbers
    are multiplied by their factor of `factors`. A table whose columns are `named` may be as other
    programs write it. `log` gets the names of columns that are not used.
    """
    import pandas as pd

    table = None
    if isinstance(source, Path):
        table = _plain_table(source, columns_by_key)
        if table is None:
            content = read_content(source)
            table = parse_foreign_table(content, source) if named else None
            table = table or parse_text_table(content, source)
    table = table or read_table(source)
    columns = _columns_in(table.header, columns_by_key, table.path)
    table.check_columns(list(columns.values()), _LABELS, log or discard_line, refuse=not named)
    if not table.size:
        raise TableError("a header and no rows, expected samples", table.path)
    samples: dict[str | int, Any] = {}
    for key, name in columns.items():
        if key == "afferent":
            samples[key] = table.choices(name, ("", *AFFERENTS))
        elif key in _LABELS[:3]:
            samples[key] = table.column(name)
        elif key == "node":
            samples[key] = table.numbers(name, 0, int)
        else:
            samples[key] = table.numbers(name, factor=(factors or {}).get(key, 1.0))
    return pd.DataFrame(samples, copy=False), table.error


def _columns_in(
    header: Sequence[str], columns_by_key: Mapping[str, Sequence[str]], path: Path
) -> dict[str | int, str]:
    """Columns of a `header`: by ``time``, by number of the value, and by label."""
    columns: dict[str | int, str] = {
        "time": columns_by_key["time"][0],
        **dict(enumerate(columns_by_key["value"])),
    }
    for key in _LABELS:
        if key in columns_by_key or key in header:
            [columns[key]] = columns_by_key.get(key, [key])
    try:
        check_header(header, list(columns.values()), path)
    except TableError as error:
        way_out = (
            "; or name them: --columns time=NAME,value=NAME (columns={'time': ..., 'value': ...})"
        )
        raise TableError(error.problem + way_out, path, error.line) from None
    return columns


def _plain_table(path: Path, columns_by_key: Mapping[str, Sequence[str]]) -> "TextTable | None":
    """A table as fembridge writes it, read with the type of each column; None for any other.

    Of ten million samples the cells as text would take gigabytes.
    """
    import pandas as pd

    always = tuple(map(int, pd.__version__.split(".")[:2])) >= (3, 1)
    exact: Any = {} if always else {"float_precision": "round_trip"}
    try:
        if not path.is_file():
            return None
        with path.open("rb") as file:
            line = file.readline(HEADER_BYTES).decode("ascii")
            first_row = file.readline(HEADER_BYTES)
        header = [name.strip(' "') for name in line.rstrip("\r\n").split(",")]
        if len(header) > MAX_COLUMNS or first_row.count(b",") != len(header) - 1:
            return None
        columns = _columns_in(header, columns_by_key, path)
        # The last column shows which rows are short, those without a name may be row numbers.
        kinds: dict[int, Any] = dict.fromkeys(unnamed_columns(header), object)
        kinds[len(header) - 1] = object
        for key, name in columns.items():
            kind: Any = {"node": np.int64}.get(str(key), np.float64)
            kinds[header.index(name)] = "category" if key in _LABELS[:3] else kind
    except (OSError, ValueError, TableError):
        return None  # the other way says what is wrong, and where
    counts = count_cells(path)
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
    texts = [cells[header.index(columns[key])] for key in _LABELS[:3] if key in columns]
    labels = [str(label) for column in texts for label in column.cat.categories]
    if '"' in line or any('"' in label or label != label.strip() for label in labels):
        return None
    if cells.shape[1] != len(kinds) or not len(cells):
        return None
    last = cells[len(header) - 1]
    if last.dtype == object and (last == "").any():
        return None  # perhaps a row that lacks a cell, and another with one too many
    warn_if_cut(path, counts.last_byte)
    return TextTable(path, tuple(header), cells, np.arange(len(cells)) + 2)


def _origin_file(path: Path) -> Path:
    """File of the origin of the traces in the table `path`."""
    return path.with_name(f"{path.name}.toml")


def _origin_of(path: Path) -> Origin | None:
    """Origin of the traces in the table `path`; None if unknown."""
    record = _origin_file(path)
    if not record.is_file():
        return None
    failed = TableError.at(record)
    table = read_toml(record, failed)
    if table.pop("traces_sha256", None) == sha256_of(path):
        return structure(table, Origin, failed)
    warn(f"of another table than {path.name}, not used", record)
    return None


def write_origin(path: Path, origin: Origin | None) -> None:
    """Write the origin of the traces in the table `path`; None removes an earlier one."""
    if origin is None:
        remove_file(_origin_file(path))
    else:
        table = {"traces_sha256": sha256_of(path), **unstructure(origin)}
        write_toml(_origin_file(path), table)
