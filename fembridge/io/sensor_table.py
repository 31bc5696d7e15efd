"""The table of a robot's sensor: which column is the time, and which are values.

A table of our own names its columns; one of a robot's log has a column of time and one or several
of values. They are recognised by name and content, and reported; ``--columns`` names others.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fembridge.errors import TableError
from fembridge.io.column_units import ms_per, pa_per
from fembridge.io.number import parse_number
from fembridge.io.text_table import NOTE_COLUMNS, header_in, unnamed_columns
from fembridge.trace import MS_PER_S, middle_step

if TYPE_CHECKING:
    import pandas

_TIME = re.compile(r"(time|t|timestamp|stamp|elapsed|seconds|secs|millis|micros)(?![a-z])", re.I)
_MS_NAMES = ("millis",)
_NO_VALUES = {"seq", "index", "sample", "count", "n", "id", "frame", "frame_id"}
_LABELS = {"stimulus", "afferent", "unit", "node"}
_START_BYTES = 1 << 16
_ROWS = 500
# A sensor of touch has more than 20 samples a second: a step without a unit that is longer is in
# ms, not in s.
_LONGEST_STEP_S = 0.05
# At 2 kHz vibrations of 500 Hz reach PC.
_ENOUGH_HZ = 2000.0


@dataclass(frozen=True, slots=True)
class SensorTable:
    """Columns of a sensor's table, as `read_traces` takes them, and its time step.

    `step_ms` is the median of the first rows; None where they have no times.
    """

    columns: Mapping[str, str | Sequence[str]]
    step_ms: float | None

    @property
    def value_names(self) -> list[str]:
        """Names of the value columns."""
        value = self.columns.get("value", [])
        return [value] if isinstance(value, str) else list(value)


def sensor_table(
    source: "Path | pandas.DataFrame",
    columns: Mapping[str, str | Sequence[str]] | None = None,
    *,
    has_gain: bool = False,
) -> SensorTable | None:
    """Columns of a table that is not ours; None where they are not recognised.

    Parameters
    ----------
    source
        The table.
    columns
        Names that are given; only the time step is looked up. Default: None.
    has_gain
        Whether a gain is known; otherwise columns whose name has a unit of stress are preferred.
        Default: False.
    """
    header, first, numbers = _beginning(source)
    if columns:
        time = columns.get("time_ms", columns.get("time", ""))
        name = time if isinstance(time, str) else next(iter(time), "")
        in_ms = "time_ms" in columns
        step = _step(numbers.get(name))
        factor = None if step is None else ms_per(name, in_ms, lambda _: None)
        return SensorTable(columns, None if step is None or factor is None else step * factor)
    if "von_mises_pa" in header:
        return None
    times = [name for name in header if name in numbers and _TIME.match(name.lstrip("."))]
    if not times:
        return None
    time, unnamed = times[0], {header[at] for at in unnamed_columns(header)}
    values = [
        name
        for name in header
        if name in first
        and name not in {*times, *unnamed}
        and name.casefold() not in {*_NO_VALUES, *_LABELS, *NOTE_COLUMNS}
    ]
    in_pa = [name for name in values if pa_per(name) is not None]
    values = values if has_gain or not in_pa else in_pa
    if not values or len(set(header)) < len(header):
        return None
    step, without_unit = _step(numbers[time]), False

    def note(_: str) -> None:
        nonlocal without_unit
        without_unit = True

    factor = ms_per(time, False, note)
    is_ms = time.casefold() in _MS_NAMES
    is_ms |= without_unit and step is not None and step > _LONGEST_STEP_S
    key, factor = ("time_ms", 1.0) if is_ms else ("time", factor)
    return SensorTable({key: time, "value": values}, None if step is None else step * factor)


def _step(times: Sequence[float] | None) -> float | None:
    if times is None or len(times) < 2:
        return None
    step = middle_step(np.diff(np.array(times)))
    return step if step > 0 else None


def _beginning(
    source: "Path | pandas.DataFrame",
) -> tuple[list[str], set[str], dict[str, list[float]]]:
    """Header, columns of numbers, and the numbers of the first rows of each such column."""
    if isinstance(source, Path):
        header, rows = _first_rows(source)
    else:
        header = [str(name) for name in source.columns]
        rows = source.head(_ROWS).astype(object).to_numpy().tolist()
    numbers: dict[str, list[float]] = {}
    for at, name in enumerate(header):
        try:
            numbers[name] = [float(parse_number(str(row[at]).strip())) for row in rows]
        except (ValueError, IndexError):
            continue
    return header, {name for name, values in numbers.items() if values}, numbers


def _first_rows(path: Path) -> tuple[list[str], list[list[str]]]:
    try:
        with path.open("rb") as file:
            text = file.read(_START_BYTES).decode("utf-8-sig", errors="replace")
        header, begin, separator = header_in(text, path)
    except (OSError, TableError):
        return [], []  # the reader says what is wrong
    lines = [line for line in text[begin:].splitlines() if line.strip()]
    if len(text) >= _START_BYTES - 8:
        lines = lines[:-1]  # may be cut
    rows = []
    for line in lines[:_ROWS]:
        cells = line.split() if separator == " " else line.split(separator)
        if separator == ";":
            cells = [cell.replace(",", ".") for cell in cells]
        rows.append([cell.strip().strip('"') for cell in cells])
    return header, rows


def resampled_step_ms(step_ms: float) -> float:
    """Step of the even grid for samples every `step_ms` at uneven times.

    Steps that all parameter sets take: 0.5 ms, or 0.1 ms for faster sensors.
    """
    return 0.5 if step_ms > 0.4 else 0.1


def deaf_above(step_ms: float) -> str | None:
    """What PC misses of a signal every `step_ms`; None where that is nothing.

    Samples have no vibration above half their rate; above a quarter of the rate the interpolation
    of the encoder weakens a vibration by 3 % and more.
    """
    rate_hz = MS_PER_S / step_ms
    if rate_hz >= _ENOUGH_HZ * (1 - 1e-3):
        return None
    return (
        f"{rate_hz:.4g} samples a second: PC, most sensitive at 200 to 300 Hz, misses vibrations "
        f"above {rate_hz / 2:.3g} Hz, and those above {rate_hz / 4:.3g} Hz are weakened; "
        f"{_ENOUGH_HZ:g} samples a second have its whole band"
    )
