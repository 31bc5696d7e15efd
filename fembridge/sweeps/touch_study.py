"""A table of touches: one row a touch, from Python, a table file or a study file.

A column is an argument of `fembridge.touch`, of its trajectories or of its shapes, under the name
of the option of ``fembridge touch``; a position is two columns. Columns ``label`` and ``label_...``
are the user's own and stay as they are::

    [touches]                         # settings of every touch
    shape = "braille:text=a"
    press_n = 0.3
    trials = 10

    [touches.product]                 # every combination
    shape = ["braille:text=a", "braille:text=b"]
    press_n = [0.1, 0.3]

    [touches.draw]                    # touches of each combination, drawn at random
    count = 100
    seed = 1
    x_mm = { uniform = [-3, 3] }
    population_seed = "each"          # a population of its own

All keys are in ``docs/how_to/touches.md``. File names are relative to the folder of the table.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from fembridge.errors import FembridgeError, MissingError, TableError, UsageError
from fembridge.host.store import MAX_TOML_BYTES, near_hint, read_toml
from fembridge.io.number import parse_number
from fembridge.io.text_table import read_table
from fembridge.ranges import RANGES, check_range

SETTINGS: Mapping[str, type] = {
    "shape": str,
    "pixel_mm": float,
    "relief_mm": float,
    "tile": bool,
    "x_mm": float,
    "z_mm": float,
    "angle_deg": float,
    "tilt_across_deg": float,
    "tilt_along_deg": float,
    "friction": float,
    "stimulus": str,
    "press_um": float,
    "press_n": float,
    "ramp_ms": float,
    "hold_ms": float,
    "slide_mm_per_s": float,
    "direction_deg": float,
    "duration_ms": float,
    "path": str,
    "pins": str,
    "preindent_um": float,
    "pad": str,
    "finger": str,
    "ridges": str,
    "map": str,
    "population": str,
    "population_seed": int,
    "endings_mm": float,
    "sa_von_mises": bool,
    "parameters": str,
    "trials": int,
    "noise_mv": float,
    "seed": int,
}
"""Columns of a table of touches and their types."""

OBJECTS = (
    *("shape", "stimulus", "trajectory", "path", "pins", "pad"),
    *("finger", "ridges", "population", "parameters"),
)
"""Settings that may be Python objects; `trajectory` is nothing else."""

FILES = (
    *("shape", "stimulus", "path", "pins", "pad", "finger", "map"),
    *("population", "parameters"),
)
"""Settings that may name a file."""

CONTACT = (
    *("shape", "pixel_mm", "relief_mm", "tile", "x_mm", "z_mm", "angle_deg"),
    *("tilt_across_deg", "tilt_along_deg", "friction", "stimulus", "press_um", "press_n"),
    *("ramp_ms", "hold_ms", "slide_mm_per_s", "direction_deg", "duration_ms", "path", "pins"),
    *("preindent_um", "trajectory", "pad", "finger", "ridges", "map"),
)
"""Settings that the contact depends on; touches that agree in them share it."""

MOST_TOUCHES = 1_000_000
OWN_SEED = "each"
"""A drawn ``seed`` or ``population_seed`` of its own for each touch."""

_LABEL = "label"
_TABLES = (".csv", ".parquet")
_RANGE_OF = {
    **dict.fromkeys(("x_mm", "z_mm"), "at_mm"),
    **dict.fromkeys(("tilt_across_deg", "tilt_along_deg"), "tilt_deg"),
    "population_seed": "seed",
}
_PAIRS = {"at_mm": ("x_mm", "z_mm"), "tilt_deg": ("tilt_across_deg", "tilt_along_deg")}
_DRAWS = ("uniform", "log_uniform", "normal", "choice")
_SECTIONS = ("product", "draw", "rows")
_MOTIONS = ("stimulus", "path", "pins", "trajectory")
_DRAWN_SEEDS = 2**31


@dataclass(frozen=True, slots=True, eq=False)
class TouchTable:
    """Rows of settings, in which only what is given occurs.

    `labels` are the names of the user's own columns, `folder` is what file names are relative
    to, `text` the study file, and `path` the file of the table.
    """

    rows: tuple[Mapping[str, Any], ...]
    labels: tuple[str, ...]
    folder: Path
    name: str
    text: str = ""
    path: Path | None = None


def is_touch_study(path: Path) -> bool:
    """Whether `path` is a table of touches, or a study file with ``[touches]``."""
    if path.suffix.lower() in _TABLES:
        return True
    return "touches" in read_toml(path, UsageError, 10 * MAX_TOML_BYTES, 200_000)


def read_touches(source: object) -> TouchTable:
    """Table of touches of a path, a DataFrame, a list of dicts, or the dict of a study file.

    Raises
    ------
    UsageError, TableError
        An unknown column or key, with near names, a value of another type or out of range, or
        settings that exclude each other; with the file and the row.
    MissingError
        A Parquet file without pyarrow.
    """
    if isinstance(source, str | Path):
        return _read_file(Path(source))
    if isinstance(source, Mapping):
        return _study(source, Path.cwd(), "touches")
    if hasattr(source, "to_dicts"):  # Polars
        rows = source.to_dicts()
    elif hasattr(source, "to_dict") and hasattr(source, "columns"):
        rows = source.astype(object).to_dict("records")  # type: ignore[attr-defined] # pandas
    elif isinstance(source, Sequence) and all(isinstance(row, Mapping) for row in source):
        rows = list(source)
    else:
        expected = "a DataFrame, a list of dicts, the dict of a study, or a path"
        raise UsageError(argument="table", found=source, expected=expected)
    return _table(rows, Path.cwd(), "touches")


def _read_file(path: Path) -> TouchTable:
    suffix = path.suffix.lower()
    if suffix not in _TABLES:
        content = read_toml(path, UsageError, 10 * MAX_TOML_BYTES, 200_000)
        try:
            table = _study(content, path.parent, path.stem, path.read_text("utf-8-sig"))
            return replace(table, path=path)
        except FembridgeError as error:
            raise UsageError.from_error(error, path, "") from error
    if suffix == ".csv":
        rows, lines = _csv_rows(path)
        return _table(rows, path.parent, path.stem, path, lines=lines)
    return _table(_parquet_rows(path), path.parent, path.stem, path)


def _csv_rows(path: Path) -> tuple[list[dict[str, Any]], list[int]]:
    """Rows of a CSV file, and the line of each."""
    table = read_table(path)
    table.check_header(())
    columns = {name: _parsed(name, table.column(name).tolist()) for name in table.header}
    rows = [dict(zip(columns, cells, strict=True)) for cells in zip(*columns.values(), strict=True)]
    return rows, table.lines.tolist()


def _parsed(name: str, cells: Sequence[object]) -> list[Any]:
    """Values of a column: numbers or truth values where it has some, else its texts.

    A column of the user's own has numbers if all its cells are numbers.
    """
    texts = [str(cell) for cell in cells]
    kind = SETTINGS.get(name, str)
    if kind is bool:
        truths = {"true": True, "false": False, "1": True, "0": False}
        return [truths.get(text.lower(), text or None) for text in texts]
    if _is_label(name):
        numbers = [_number(text, float) for text in texts if text]
        if numbers and all(isinstance(number, float) for number in numbers):
            kind = int if all(number % 1 == 0 for number in numbers) else float
    return [_number(text, kind) if text else None for text in texts]


def _number(text: str, kind: type) -> Any:  # noqa: ANN401 - a number or a text
    """The number that `text` states, or the text, which is refused with the row."""
    if kind is str:
        return text
    try:
        number = parse_number(text)
    except ValueError:
        return text
    return int(number) if kind is int and number == int(number) else number


def _parquet_rows(path: Path) -> list[dict[str, Any]]:
    try:
        import pyarrow.parquet as parquet
    except ImportError as error:
        raise MissingError(f"{path} needs pyarrow: pip install 'fembridge[datasets]'") from error
    try:
        rows: list[dict[str, Any]] = parquet.read_table(path).to_pylist()
    except (OSError, ValueError) as error:  # errors of Arrow are ValueErrors
        problem = getattr(error, "strerror", None) or error
        raise TableError(f"cannot be read: {problem}", path) from error
    return rows


def _table(
    rows: Sequence[Mapping[Any, Any]],
    folder: Path,
    name: str,
    path: Path | None = None,
    text: str = "",
    lines: Sequence[int] = (),
) -> TouchTable:
    """Checked table of `rows`, which come from the file `path`, from `lines` of it."""
    if not 1 <= len(rows) <= MOST_TOUCHES:
        problem = f"has {len(rows)} rows, expected 1 to {MOST_TOUCHES}"
        raise UsageError(problem, path, argument="table", found=len(rows))
    checked = []
    for number, row in enumerate(rows, start=1):
        try:
            checked.append(_checked(row))
        except FembridgeError as error:
            if path is not None and lines:
                raise TableError(
                    error.problem,
                    path,
                    lines[number - 1],
                    argument=error.argument,
                    found=error.found,
                    expected=error.expected,
                ) from error
            failure = UsageError(
                f"of row {number} {error.problem}",
                path,
                argument=error.argument,
                found=error.found,
                expected=error.expected,
            )
            raise failure from error
    labels = dict.fromkeys(key for row in checked for key in row if key.startswith(_LABEL))
    for label in labels:
        kinds = {type(row[label]) for row in checked if label in row}
        if len(kinds) > 1 and kinds - {int, float}:
            raise UsageError(
                f"has values of several types: {', '.join(sorted(k.__name__ for k in kinds))}",
                path,
                argument=label,
            )
    return TouchTable(tuple(checked), tuple(labels), folder.resolve(), name, text, path)


def _checked(row: Mapping[Any, Any]) -> dict[str, Any]:
    """The settings of a row without empty cells; each with its type and within its range."""
    settings: dict[str, Any] = {}
    for name, value in row.items():
        if value is None or (isinstance(value, float) and math.isnan(value)):
            continue
        if name in _PAIRS:
            settings |= _pair(name, value)
            continue
        settings[name] = _value(name, value)
    _check_motion(settings)
    return settings


def _pair(name: str, value: object) -> dict[str, float]:
    columns = _PAIRS[name]
    if not isinstance(value, Sequence | np.ndarray) or isinstance(value, str) or len(value) != 2:
        raise UsageError(argument=name, found=value, expected="two numbers")
    return {column: _value(column, number) for column, number in zip(columns, value, strict=True)}


def _value(name: object, value: object) -> Any:  # noqa: ANN401 - a cell
    """Checked value of the setting `name`."""
    if not isinstance(name, str) or not _is_column(name):
        expected = "an argument of fembridge.touch, or label or label_..."
        hint = near_hint(str(name), [*SETTINGS, "trajectory", *_PAIRS])
        hint = hint or f"; expected {expected}"
        problem = f"is no column of a table of touches{hint}"
        raise UsageError(problem, argument=str(name), found=name, expected=expected)
    if isinstance(value, np.generic):
        value = value.item()
    if _is_label(name):
        if not isinstance(value, str | int | float | bool):
            expected = "a text, a number or a truth value"
            raise UsageError(argument=name, found=value, expected=expected)
        return value
    if isinstance(value, Path):
        value = str(value)
    if name in OBJECTS and not isinstance(value, str | int | float | bool):
        return value
    kind = SETTINGS.get(name)
    if kind is None:
        raise UsageError(argument=name, found=value, expected="a fembridge.Trajectory")
    if kind is str:
        if not isinstance(value, str) or not value:
            raise UsageError(argument=name, found=value, expected="a text")
        return value
    if kind is bool:
        if value not in (True, False):
            raise UsageError(argument=name, found=value, expected="true or false")
        return bool(value)
    check_range(name, value, RANGES[_RANGE_OF.get(name, name)])  # type: ignore[arg-type]
    if kind is int and isinstance(value, float) and value != int(value):
        raise UsageError(argument=name, found=value, expected="a whole number")
    return kind(value)


def _is_column(name: str) -> bool:
    return name in SETTINGS or name in OBJECTS or _is_label(name)


def _is_label(name: str) -> bool:
    return name == _LABEL or name.startswith(f"{_LABEL}_")


def _check_motion(settings: Mapping[str, Any]) -> None:
    """Check that the settings describe one trajectory, and none that it does not use."""
    motions = [name for name in _MOTIONS if name in settings]
    presses = [name for name in ("press_um", "press_n") if name in settings]
    prescribed = motions or presses
    if not prescribed:
        expected = f"one of press_um, press_n, {', '.join(_MOTIONS)}"
        raise UsageError("is missing", argument="press_um", expected=expected)
    if motions and presses:
        raise UsageError(f"cannot be combined with {motions[0]}", argument=presses[0])
    if len(prescribed) > 1:
        raise UsageError(f"cannot be combined with {prescribed[0]}", argument=prescribed[1])
    slides = "slide_mm_per_s" in settings
    uses = {
        "slide_mm_per_s": (presses, "a slide, with press_um or press_n"),
        "direction_deg": (slides, "a slide"),
        "duration_ms": (slides, "a slide"),
        "ramp_ms": (presses and not slides, "a press"),
        "hold_ms": (presses and not slides, "a press"),
        "preindent_um": (not presses and "path" not in settings, "a waveform or pins"),
        **dict.fromkeys(("pixel_mm", "relief_mm", "tile"), ("shape" in settings, "a shape")),
    }
    if "map" in settings:
        others = set(settings) - {"map", "stimulus", "parameters", "preindent_um"}
        uses |= {name: (False, "a pad, not for a map") for name in others if not _is_label(name)}
    for name, (is_used, purpose) in uses.items():
        if name in settings and not is_used:
            raise UsageError(f"is for {purpose}", argument=name, found=settings[name])
    if "map" in settings and "stimulus" not in settings:
        raise UsageError("is missing, as for every map", argument="stimulus")


# ---- Study files


def _study(content: Mapping[str, Any], folder: Path, name: str, text: str = "") -> TouchTable:
    """Table of the parsed study file."""
    accepted = ("name", "touches")
    for key in content:
        if key not in accepted:
            hint = near_hint(key, accepted)
            raise UsageError(f"is no key of a study of touches{hint}", key=key, found=key)
    touches = content.get("touches")
    if not isinstance(touches, Mapping):
        raise UsageError(key="touches", found=touches, expected="a table")
    _check_keys("touches", touches, _SECTIONS)
    shared = {key: value for key, value in touches.items() if key not in _SECTIONS}
    listed = touches.get("rows", [{}])
    if isinstance(listed, str):
        listed = [dict(row) for row in _rows_of(folder / listed)]
    if not isinstance(listed, list) or not all(isinstance(row, Mapping) for row in listed):
        raise UsageError(key="touches.rows", found=listed, expected="tables, or a file of a table")
    combined = _combinations(touches.get("product", {}))
    if len(listed) * len(combined) > MOST_TOUCHES:
        problem = f"has {len(listed) * len(combined)} combinations, expected {MOST_TOUCHES} at most"
        raise UsageError(problem, key="touches.product")
    rows = [{**shared, **row, **item} for row in listed for item in combined]
    if "draw" in touches:
        rows = _drawn(rows, touches["draw"])
    title = content.get("name", name)
    return _table(rows, folder, str(title), text=text)


def _check_keys(table: str, content: Mapping[str, Any], others: Sequence[str] = ()) -> None:
    """Refuse keys of a table of the study that are neither settings nor one of `others`."""
    for name in content:
        if name not in others and name not in _PAIRS and not _is_column(name):
            hint = near_hint(name, [*others, *SETTINGS, "trajectory", *_PAIRS])
            expected = "an argument of fembridge.touch, or label or label_..."
            problem = f"is neither a setting of a touch nor a key of {table}{hint}"
            raise UsageError(problem, key=f"{table}.{name}", found=name, expected=expected)


def _rows_of(path: Path) -> list[dict[str, Any]]:
    suffix = path.suffix.lower()
    if suffix not in _TABLES:
        raise UsageError(key="touches.rows", found=path.name, expected="a .csv or .parquet")
    return _csv_rows(path)[0] if suffix == ".csv" else _parquet_rows(path)


def _combinations(factors: object) -> list[dict[str, Any]]:
    """Every combination of the listed values; the last factor varies fastest."""
    if not isinstance(factors, Mapping):
        raise UsageError(key="touches.product", found=factors, expected="a table of lists")
    _check_keys("touches.product", factors)
    for name, values in factors.items():
        if not isinstance(values, list) or not values:
            key = f"touches.product.{name}"
            raise UsageError(key=key, found=values, expected="a list of values")
    if math.prod(len(values) for values in factors.values()) > MOST_TOUCHES:
        problem = f"has more than {MOST_TOUCHES} combinations"
        raise UsageError(problem, key="touches.product")
    return [dict(zip(factors, values, strict=True)) for values in product(*factors.values())]


def _drawn(rows: Sequence[Mapping[str, Any]], draw: object) -> list[dict[str, Any]]:
    """`rows`, each ``count`` times with settings drawn at random.

    The draws of a touch depend only on the seed and the number of the row and of the draw, so
    that more draws leave the earlier ones as they are; ``shared = true`` leaves out the row.
    """
    if not isinstance(draw, Mapping):
        raise UsageError(key="touches.draw", found=draw, expected="a table")
    options = {"count": 1, "seed": 0, "shared": False}
    _check_keys("touches.draw", draw, tuple(options))
    values = {name: draw.get(name, default) for name, default in options.items()}
    count, seed = values["count"], values["seed"]
    for key, value, least in (("count", count, 1), ("seed", seed, 0)):
        if isinstance(value, bool) or not isinstance(value, int) or value < least:
            expected = f"a whole number, {least} or more"
            raise UsageError(key=f"touches.draw.{key}", found=value, expected=expected)
    if len(rows) * count > MOST_TOUCHES:
        problem = f"has {len(rows) * count} touches, expected {MOST_TOUCHES} at most"
        raise UsageError(problem, key="touches.draw.count", found=count)
    drawn = {name: rule for name, rule in draw.items() if name not in options}
    touches = []
    for row_number, row in enumerate(rows):
        for number in range(count):
            origin = (seed, number) if values["shared"] else (seed, row_number, number)
            rng = np.random.default_rng(origin)
            touches.append(
                {**row, **{name: _draw(name, rule, rng) for name, rule in drawn.items()}}
            )
    return touches


def _draw(name: str, rule: object, rng: np.random.Generator) -> object:
    """A value of the setting `name`, drawn by `rule`."""
    key = f"touches.draw.{name}"
    if rule == OWN_SEED:
        if SETTINGS.get(name) is not int or name == "trials":
            raise UsageError("is for seed and population_seed", key=key, found=rule)
        return int(rng.integers(_DRAWN_SEEDS))
    if not isinstance(rule, Mapping) or len(rule) != 1 or next(iter(rule)) not in _DRAWS:
        expected = f"{{ {' | '.join(_DRAWS)} = [...] }}, or {OWN_SEED!r} of a seed"
        raise UsageError(key=key, found=rule, expected=expected)
    [(kind, limits)] = rule.items()
    if kind == "choice":
        if not isinstance(limits, list) or not limits:
            raise UsageError(key=key, found=limits, expected="a list of values")
        return limits[int(rng.integers(len(limits)))]
    is_pair = isinstance(limits, list) and len(limits) == 2
    if not is_pair or not all(
        isinstance(end, int | float) and not isinstance(end, bool) and math.isfinite(end)
        for end in limits
    ):
        raise UsageError(key=key, found=limits, expected="two numbers")
    first, second = map(float, limits)
    if kind == "normal":
        if second < 0:
            raise UsageError(key=key, found=limits, expected="a mean and a deviation, 0 or more")
        return float(rng.normal(first, second))
    if first > second or (kind == "log_uniform" and first <= 0):
        expected = "from, to" + (", above 0" if kind == "log_uniform" else "")
        raise UsageError(key=key, found=limits, expected=expected)
    if kind == "log_uniform":
        return float(math.exp(rng.uniform(math.log(first), math.log(second))))
    return float(rng.uniform(first, second))
