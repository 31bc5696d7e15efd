"""Recorded responses of a user: the tables of a folder, recognised by their columns.

``rates``      stimulus, afferent, rate_ips
``ramps_sa``   unit, depth_mm, rate_START_END, ...: impulses/s in windows in ms from first touch,
               ramp at 40 mm/s and hold, probe of 2 mm
``ramps_ra``   unit, depth_mm, speed_mm_per_s, impulses: on the ramp, probe of 2 mm
``textures``   speed_mm_per_s, shape, afferent, rate_ips: ``grating_P`` (period P mm), ``dots_P``
``bars``       shape, width_mm, position_mm, rate_ips: SA beside the middle of a ``bar``, or of a
               ``gap`` between bars of 4 mm, 1 mm deep
``fields``     afferent, area_mm2: areas at 4.5 times threshold
"""

import re
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge.errors import TableError, UsageError, warn
from fembridge.io.observed_rates import ObservedRates, read_observed
from fembridge.io.spike_table import RATE_COLUMNS
from fembridge.io.text_table import TextTable, read_table
from fembridge.trace import AFFERENTS

if TYPE_CHECKING:
    import pandas

COLUMNS = {
    "ramps_sa": ("unit", "depth_mm"),
    "ramps_ra": ("unit", "depth_mm", "speed_mm_per_s", "impulses"),
    "textures": ("speed_mm_per_s", "shape", "afferent", "rate_ips"),
    "bars": ("shape", "width_mm", "position_mm", "rate_ips"),
    "fields": ("afferent", "area_mm2"),
}
"""Columns of each table but ``rates``; SA ramps have windows in addition."""

RAMP_RATES = "rate_START_END"
DEEPEST_MM = 2.0
"""Depth to which the skin is computed."""

_WINDOW = re.compile(r"rate_(\d+)_(\d+)")
_TEXTURE = re.compile(r"(grating|dots)_(\d+(?:\.\d+)?)")
_BAR_SHAPES = ("bar", "gap")
_LARGEST = {
    "depth_mm": DEEPEST_MM,
    "speed_mm_per_s": 1000.0,
    "width_mm": 8.0,
    "position_mm": 4.0,
}
_SMALLEST = {"depth_mm": 0.01, "speed_mm_per_s": 0.1, "width_mm": 0.1}


def columns_text(name: str) -> str:
    """Columns of a table as a user writes them."""
    if name == "rates":
        return ",".join(RATE_COLUMNS)
    return ",".join((*COLUMNS[name], *((RAMP_RATES, "...") if name == "ramps_sa" else ())))


def ramp_windows(header: "pandas.Index[str] | tuple[str, ...]") -> list[tuple[str, float, float]]:
    """Name, start and end in ms of each column ``rate_START_END``."""
    matches = [_WINDOW.fullmatch(str(name)) for name in header]
    return [(m.group(), float(m.group(1)), float(m.group(2))) for m in matches if m]


def texture(shape: str) -> tuple[str, float]:
    """Kind and period in mm of a texture, such as ``dots_3``."""
    match = _TEXTURE.fullmatch(shape)
    assert match is not None
    return match.group(1), float(match.group(2))


def read_recorded_table(source: "Path | str | pandas.DataFrame", name: str) -> "pandas.DataFrame":
    """Table `name` of `COLUMNS` from a file or DataFrame.

    Raises
    ------
    TableError
        A missing file or column, or an invalid cell, with its line.
    """
    import pandas

    table = read_table(Path(source) if isinstance(source, str) else source, COLUMNS[name])
    windows = ramp_windows(table.header) if name == "ramps_sa" else []
    if name == "ramps_sa" and not windows:
        raise TableError(
            "has no rates", table.path, key=RAMP_RATES, expected="a column such as rate_0_100"
        )
    for column, start_ms, end_ms in windows:
        if not start_ms < end_ms:
            expected = "rate_START_END in ms, such as rate_0_100"
            raise TableError("is empty", table.path, key=column, expected=expected)
    columns = [*COLUMNS[name], *(column for column, *_ in windows)]
    return pandas.DataFrame({column: _cells(table, name, column) for column in columns})


def _cells(table: TextTable, name: str, column: str) -> Any:  # noqa: ANN401 - an array
    if column == "unit":
        return table.words(column)
    if column == "afferent":
        return table.choices(column, AFFERENTS)
    if column == "shape":
        if name == "bars":
            return table.choices(column, _BAR_SHAPES)
        shapes = table.words(column)
        bad = np.array([_TEXTURE.fullmatch(shape) is None for shape in shapes])
        table.refuse(bad, lambda row: f"shape is {shapes[row]}, expected grating_P or dots_P")
        return shapes
    numbers = table.numbers(column, least=_SMALLEST.get(column, 0.0))
    largest = _LARGEST.get(column, np.inf)
    table.refuse(
        numbers > largest, lambda row: f"{column} is {numbers[row]:g}, expected {largest:g} or less"
    )
    return numbers


def read_recorded_folder(
    folder: "str | Path",
) -> tuple[list[ObservedRates], "dict[str, pandas.DataFrame]"]:
    """Rates of vibrations, and the other tables by name, of all CSV files in `folder`.

    Files with the same columns are one table. Other CSV files are a `FembridgeWarning`.

    Raises
    ------
    UsageError
        No such folder, or no table of `COLUMNS` and no rates in it.
    TableError
        An invalid table, with its line.
    """
    import pandas

    folder = Path(folder)
    if not folder.is_dir():
        raise UsageError("is not a folder", argument="recorded", found=str(folder))
    rates: list[ObservedRates] = []
    tables: dict[str, list[pandas.DataFrame]] = {}
    for path in sorted(folder.glob("*.csv")):
        name = _name_of(set(read_table(path).header))
        if name == "rates":
            rates.append(read_observed(path, complete=False))
        elif name:
            tables.setdefault(name, []).append(read_recorded_table(path, name))
        else:
            warn("is no table of recorded responses and is left out", path)
    if not rates and not tables:
        expected = "a CSV table with " + ", or ".join(map(columns_text, ("rates", *COLUMNS)))
        raise UsageError(argument="recorded", found=str(folder), expected=expected)
    return rates, {name: pandas.concat(parts, ignore_index=True) for name, parts in tables.items()}


def _name_of(header: set[str]) -> str:
    """Table with the most columns in `header`, all of its columns; "" for none."""
    candidates = {"rates": RATE_COLUMNS, **COLUMNS}
    fitting = [name for name, columns in candidates.items() if header >= set(columns)]
    if not ramp_windows(tuple(header)):
        fitting = [name for name in fitting if name != "ramps_sa"]
    return max(fitting, key=lambda name: len(candidates[name]), default="")


def joined_rates(parts: "list[ObservedRates]") -> ObservedRates | None:
    """Rates of several tables as one; None without any.

    Raises
    ------
    TableError
        Two tables have a rate of the same stimulus and class.
    """
    import pandas

    if len(parts) < 2:
        return parts[0] if parts else None
    seen: dict[tuple[str, str], Path] = {}
    for part in parts:
        for rate in part.rates():
            first = seen.setdefault((rate.stimulus, rate.afferent), part.path)
            if first is not part.path:
                problem = f"{rate.stimulus}, {rate.afferent} is also in {first.name}"
                raise TableError(problem, part.path, found=rate.stimulus)
    frame = pandas.DataFrame([rate for part in parts for rate in part.rates()])
    whole = read_observed(frame[list(RATE_COLUMNS)], complete=False)
    digest = sha256("".join(part.sha256 for part in parts).encode()).hexdigest()
    return replace(whole, path=Path(" and ".join(part.path.name for part in parts)), sha256=digest)
