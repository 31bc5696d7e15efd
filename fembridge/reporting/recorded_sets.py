"""One row for each recorded set and class: models beside data, and beside other models.

A set is a kind of stimulus with recorded responses. `recorded_points` has one row per recorded
number, with the number of each source under the same stimulus; `recorded_rows` has the agreement
of each source with a set. A set without data is a row that names the file which would fill it.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from decks.stimuli import CATALOGUE, Diharmonic, Entry, Noise, Sine, resolve
from fembridge.evidence import (
    OUYANG,
    published,
    touchsim_rates,
    touchsim_table,
)
from fembridge.evidence.recorded_folder import columns_text, ramp_windows
from fembridge.io.spike_table import RATE_COLUMNS, Rate
from fembridge.reporting.fingertip_responses import Fingertip
from fembridge.reporting.rate_tables import FINGERTIP, TOUCHSIM
from fembridge.trace import AFFERENTS
from fembridge.typing import FloatArray

if TYPE_CHECKING:
    from pandas import DataFrame, Series

    from fembridge.reporting.recorded import Evidence

OUYANG_SOURCE = "Ouyang et al. 2021"
JUDGED = "judged"
"""Column of the judged model in the points."""

TRAINING, VALIDATION, NEITHER = "training", "validation", "neither"
"""Use of a set for the shipped parameter sets: fitted to, chosen by, or none of both."""

TRAINING_HZ = (20.0, 50.0, 100.0, 300.0)
VALIDATION_HZ = (30.0, 150.0, 250.0)
# Frequencies of the diharmonics and bands of the noises by which models were chosen.
VALIDATION_PAIRS_HZ = ((10.0, 50.0), (50.0, 500.0))
VALIDATION_BANDS_HZ = ((5.0, 25.0), (25.0, 250.0))
TIMING_HZ = 20.0
"""Frequency of TouchSim's stored timing."""
# Median areas of human units in mm², at 4 to 5 times threshold.
HUMAN_FIELDS_MM2 = {"SA": 11.0, "RA": 12.6, "PC": 101.3}


@dataclass(frozen=True, slots=True)
class RecordedSet:
    """A recorded set: what was recorded, what it was used for, and where its data come from.

    `ratios` is true for amplitudes and areas, which are compared by ratio; `fills` names the option
    or table that has the data if fembridge has none.
    """

    name: str
    title: str
    role: str
    unit: str
    source: str
    afferents: tuple[str, ...] = AFFERENTS
    ratios: bool = False
    fills: str = ""
    family: str = ""


_MUNIAK = "Muniak et al. 2007"
_RATES = f"--observed or a table of --recorded: {columns_text('rates')}"


def _table(name: str) -> str:
    return f"a table of --recorded: {columns_text(name)}"


RECORDED_SETS = (
    RecordedSet("sine", "Sinusoids, 20, 50, 100, 300 Hz", TRAINING, "ips", _MUNIAK, fills=_RATES,
                family="sine"),
    RecordedSet("sine_validation", "Sinusoids, 30, 150, 250 Hz", VALIDATION, "ips", _MUNIAK,
                fills=_RATES),
    RecordedSet("sine_other", "Sinusoids, other frequencies", NEITHER, "ips", "user",
                fills=_RATES),
    RecordedSet("diharm_validation", "Diharmonics, 10 + 50, 50 + 500 Hz", VALIDATION, "ips",
                _MUNIAK, fills=_RATES, family="diharm"),
    RecordedSet("diharm_other", "Diharmonics, other frequencies", NEITHER, "ips", _MUNIAK,
                fills=_RATES),
    RecordedSet("noise_validation", "Noises, 5–25, 25–250 Hz", VALIDATION, "ips", _MUNIAK,
                fills=_RATES, family="noise"),
    RecordedSet("noise_other", "Noises, other bands", NEITHER, "ips", _MUNIAK, fills=_RATES),
    RecordedSet("thresholds", "Threshold amplitudes", TRAINING, "um", "Freeman & Johnson 1982",
                ratios=True),
    RecordedSet("timing_impulses", "Impulses per cycle at 20 Hz", NEITHER, "per cycle", _MUNIAK),
    RecordedSet("timing_strengths", "Vector strengths at 20 Hz", TRAINING, "1", _MUNIAK),
    RecordedSet("human", "Impulses per cycle of human units", NEITHER, "per cycle",
                "Johansson et al. 1982"),
    RecordedSet("distance", "Amplitude against distance", NEITHER, "um", "Johnson 1974", ("RA",),
                ratios=True),
    RecordedSet("fields", "Receptive field areas", TRAINING, "mm2", "Vallbo & Johansson 1980",
                ratios=True),
    RecordedSet("ramps_sa", "Ramp and hold, rates", VALIDATION, "ips", "Knibestöl 1975", ("SA",),
                fills=_table("ramps_sa")),
    RecordedSet("ramps_ra", "Ramps, impulses", VALIDATION, "impulses", "Knibestöl 1973", ("RA",),
                fills=_table("ramps_ra")),
    RecordedSet("textures", "Scanned textures, macaques", VALIDATION, "ips", "Weber et al. 2013",
                fills=_table("textures")),
    RecordedSet("bars", "Bars and gaps", NEITHER, "ips", "user", ("SA",), fills=_table("bars")),
)  # fmt: skip
"""All sets, in the order of the page."""

# An error of a single value is its ratio or bias; a correlation requires one more.
_LEAST = 2

POINT_COLUMNS = ("set", "afferent", "condition", "recorded", JUDGED, FINGERTIP, TOUCHSIM)
ROW_COLUMNS = (
    "set", "afferent", "role", "unit", "source", "recorded", "count", "r_squared", "correlation",
    "explained", "rmse", "bias", "ratio", "missing",
)  # fmt: skip


def set_of(entry: Entry) -> str:
    """Name of the recorded set of a vibration."""
    if isinstance(entry, Sine):
        if entry.frequency_hz in TRAINING_HZ:
            return "sine"
        chosen = entry.frequency_hz in VALIDATION_HZ
        return "sine_validation" if chosen else "sine_other"
    if isinstance(entry, Diharmonic):
        pair = (entry.frequency1_hz, entry.frequency2_hz)
        return "diharm_validation" if pair in VALIDATION_PAIRS_HZ else "diharm_other"
    assert isinstance(entry, Noise)
    band = (entry.low_hz, entry.high_hz)
    return "noise_validation" if band in VALIDATION_BANDS_HZ else "noise_other"


def recorded_points(
    observed: Iterable[Rate],
    rates: Mapping[str, Iterable[Rate]],
    evidence: "Evidence",
    tables: "Mapping[str, DataFrame]",
    fingertip: Fingertip,
    textured: Fingertip,
    *,
    touches_of: str = FINGERTIP,
) -> "DataFrame":
    """Every recorded number with that of each source, NaN where a source has none.

    Parameters
    ----------
    observed
        Observed rates of vibrations.
    rates
        Rates of the sources `JUDGED` and `FINGERTIP` under these stimuli.
    evidence
        Comparison of both models with thresholds, timing, human units and distance.
    tables
        Tables of `fembridge.evidence.recorded_folder` by name.
    fingertip, textured
        The fingertip, and the fingertip with the skin on which textures are scanned.
    touches_of
        Source whose parameters the fingertip has: `FINGERTIP` (default) or, of a model that is on
        a pad itself, `JUDGED`.

    Returns
    -------
    DataFrame
        ``set, afferent, condition, recorded, judged, fingertip, TouchSim``; units of the set.
    """
    from pandas import DataFrame

    points = [
        *_rate_points(observed, rates),
        *_threshold_points(evidence),
        *_timing_points(evidence),
        *_human_points(evidence),
        *_distance_points(evidence),
        *_field_points(fingertip, tables.get("fields")),
        *_ramp_points(fingertip, tables.get("ramps_sa"), tables.get("ramps_ra")),
        *_texture_points(textured, tables.get("textures")),
        *_bar_points(fingertip, tables.get("bars")),
    ]
    table = DataFrame(points, columns=list(POINT_COLUMNS))
    if touches_of == JUDGED:
        table[JUDGED] = table[JUDGED].fillna(table[FINGERTIP])
        table[FINGERTIP] = np.nan
    return table


_Point = tuple[Any, ...]
"""A row of `POINT_COLUMNS`."""


def _rate_points(
    observed: Iterable[Rate], rates: Mapping[str, Iterable[Rate]]
) -> "Iterable[_Point]":
    names = (JUDGED, FINGERTIP, TOUCHSIM)
    further = touchsim_table("sinusoids")[list(RATE_COLUMNS)].to_numpy().tolist()
    stored = [*touchsim_rates(), *(Rate(*row) for row in further)]
    sources = {**rates, TOUCHSIM: stored}
    values = {
        (name, rate.stimulus, rate.afferent): float(rate.rate_ips)
        for name in names
        for rate in sources.get(name, ())
    }
    for rate in observed:
        key = (rate.stimulus, rate.afferent)
        [entry] = resolve(rate.stimulus)
        numbers = (values.get((name, *key), np.nan) for name in names)
        yield (set_of(entry), rate.afferent, rate.stimulus, rate.rate_ips, *numbers)


def _joined(table: "DataFrame", name: str, keys: list[str], column: str) -> FloatArray:
    """TouchSim's `column` of its table `name` at the `keys` of each row of `table`."""
    stored = touchsim_table(name)[[*keys, column]].rename(columns={column: "touchsim"})
    joined = table[keys].merge(stored, how="left", on=keys)
    return np.asarray(joined["touchsim"], dtype=np.float64)


def _within(x: Any, known_x: "Series[float]", known_y: "Series[float]") -> Any:  # noqa: ANN401 - as NumPy's
    """Linear interpolation; NaN outside `known_x`."""
    return np.interp(x, known_x, known_y, left=np.nan, right=np.nan)


def _threshold_points(evidence: "Evidence") -> "Iterable[_Point]":
    judged, keys = evidence.judged.tuning, ["afferent", "criterion", "frequency_hz"]
    fingertip_um: Any = np.full(len(judged), np.nan)
    if evidence.fingertip:
        fingertip_um = judged[keys].merge(evidence.fingertip.tuning, how="left", on=keys)
        fingertip_um = fingertip_um["model_um"]
    touchsim = _joined(judged, "thresholds", keys, "amplitude_um")
    for row, other_um, touchsim_um in zip(judged.itertuples(), fingertip_um, touchsim, strict=True):
        condition = f"{row.criterion}, {row.frequency_hz:g} Hz"
        numbers = (row.amplitude_um, row.model_um, other_um, touchsim_um)
        yield ("thresholds", str(row.afferent), condition, *map(float, numbers))


def _timing_points(evidence: "Evidence") -> "Iterable[_Point]":
    judged = evidence.judged.timing
    fingertip = evidence.fingertip.timing if evidence.fingertip else None
    keys = ["afferent", "amplitude_um"]
    names = {
        "impulses_per_cycle": "impulses_per_cycle",
        "strength_f": "vector_strength_20hz",
        "strength_2f": "vector_strength_40hz",
    }
    at_20_hz = (judged["frequency_hz"] == TIMING_HZ).to_numpy()
    for name, stored in names.items():
        touchsim = np.where(at_20_hz, _joined(judged, "timing", keys, stored), np.nan)
        group = "timing_impulses" if name == "impulses_per_cycle" else "timing_strengths"
        column = f"model_{name}"
        others = np.full(len(judged), np.nan) if fingertip is None else fingertip[column]
        numbers = zip(judged[name], judged[column], others, touchsim, strict=True)
        for row, values in zip(judged.itertuples(), numbers, strict=True):
            condition = f"{name}, {row.frequency_hz:g} Hz, {row.amplitude_um:g} um"
            yield (group, str(row.afferent), condition, *map(float, values))


def _human_points(evidence: "Evidence") -> "Iterable[_Point]":
    table = evidence.human
    keys = ["afferent", "frequency_hz", "amplitude_um"]
    touchsim = _joined(table, "impulses", keys, "impulses_per_cycle")
    for row, touchsim_value in zip(table.itertuples(), touchsim, strict=True):
        condition = f"{row.frequency_hz:g} Hz, {row.amplitude_um:g} um"
        numbers = (row.impulses_per_cycle, row.model, np.nan, touchsim_value)
        yield ("human", str(row.afferent), condition, *map(float, numbers))


def _distance_points(evidence: "Evidence") -> "Iterable[_Point]":
    stored = touchsim_table("distance")
    for row in evidence.distance.to_dict("records"):
        distance_mm = row["distance_mm"]
        touchsim_um = _within(distance_mm, stored["distance_mm"], stored["amplitude_um"])
        numbers = (row["amplitude_um"], np.nan, row["model_um"], float(touchsim_um))
        yield ("distance", "RA", f"{distance_mm:g} mm", *numbers)


def _field_points(fingertip: Fingertip, table: "DataFrame | None") -> "Iterable[_Point]":
    recorded = (
        HUMAN_FIELDS_MM2.items()
        if table is None
        else table[["afferent", "area_mm2"]].itertuples(index=False)
    )
    medians = touchsim_table("fields").groupby("afferent")["area_mm2"].median()
    areas: dict[str, float] = {}
    for afferent, area_mm2 in recorded:
        if afferent not in areas:
            areas[afferent], _ = fingertip.field_mm2(afferent)
        numbers = (area_mm2, np.nan, areas[afferent], medians[afferent])
        yield ("fields", afferent, "4.5 times threshold", *map(float, numbers))


def _ramp_points(
    fingertip: Fingertip, sa: "DataFrame | None", ra: "DataFrame | None"
) -> "Iterable[_Point]":
    if sa is not None:
        windows = ramp_windows(sa.columns)
        stored = touchsim_table("ramps_sa")
        times_ms = [(start, end) for _, start, end in windows]
        rates_ips = {
            depth_mm: fingertip.ramp_rates_ips(depth_mm, times_ms)
            for depth_mm in sorted(set(sa["depth_mm"]))
        }
        for row in sa.to_dict("records"):
            depth_mm = row["depth_mm"]
            for (name, *_), model_ips in zip(windows, rates_ips[depth_mm], strict=True):
                touchsim = (
                    _within(depth_mm, stored["depth_mm"], stored[name])
                    if name in stored
                    else np.nan
                )
                condition = f"unit {row['unit']}, {depth_mm:g} mm, {name}"
                yield ("ramps_sa", "SA", condition, row[name], np.nan, model_ips, float(touchsim))
    if ra is not None:
        of_touchsim = _touchsim_ramps()
        for row in ra.to_dict("records"):
            ramp = (row["depth_mm"], row["speed_mm_per_s"])
            condition = f"unit {row['unit']}, {ramp[0]:g} mm at {ramp[1]:g} mm/s"
            model = fingertip.ramp_impulses(*ramp)
            numbers = (row["impulses"], np.nan, model, of_touchsim(*ramp))
            yield ("ramps_ra", "RA", condition, *numbers)


def _touchsim_ramps() -> Callable[[float, float], float]:
    """Impulses of TouchSim's RA by depth in mm and speed in mm/s; NaN beyond its table."""
    from scipy.interpolate import RegularGridInterpolator

    wide = touchsim_table("ramps_ra").pivot_table(
        index="depth_mm", columns="speed_mm_per_s", values="impulses"
    )
    axes = (wide.index.to_numpy(float), np.log(wide.columns.to_numpy(float)))
    function = RegularGridInterpolator(axes, wide.to_numpy(), bounds_error=False)
    return lambda depth_mm, speed_mm_per_s: float(function((depth_mm, np.log(speed_mm_per_s))))


def _texture_points(fingertip: Fingertip, table: "DataFrame | None") -> "Iterable[_Point]":
    if table is None:
        return
    keys = ["speed_mm_per_s", "shape", "afferent"]
    touchsim = _joined(table, "textures", keys, "rate_ips")
    scans = {
        key: fingertip.texture_rates_ips(key[1], key[0])
        for key in dict.fromkeys(zip(table["speed_mm_per_s"], table["shape"], strict=True))
    }
    for row, touchsim_ips in zip(table.to_dict("records"), touchsim.tolist(), strict=True):
        speed, shape, afferent = (row[key] for key in keys)
        model_ips = scans[speed, shape][afferent]
        condition = f"{shape} at {speed:g} mm/s"
        yield ("textures", afferent, condition, row["rate_ips"], np.nan, model_ips, touchsim_ips)


def _bar_points(fingertip: Fingertip, table: "DataFrame | None") -> "Iterable[_Point]":
    if table is None:
        return
    stored = touchsim_table("bars")
    groups: list[tuple[Any, DataFrame]] = [*table.groupby(["shape", "width_mm"], sort=False)]
    for (kind, width_mm), rows in groups:
        position_mm = rows["position_mm"].to_numpy(float)
        model_ips = fingertip.bar_rates_ips(kind, width_mm, position_mm)
        same = stored[(stored["shape"] == kind) & (stored["width_mm"] == width_mm)]
        touchsim_ips = (
            _within(position_mm, same["position_mm"], same["rate_ips"])
            if len(same)
            else np.full(position_mm.size, np.nan)
        )
        for row, model, touchsim in zip(rows.itertuples(), model_ips, touchsim_ips, strict=True):
            condition = f"{kind} of {width_mm:g} mm, {row.position_mm:g} mm from its middle"
            numbers = (row.rate_ips, np.nan, model, touchsim)
            yield ("bars", "SA", condition, *map(float, numbers))


def recorded_rows(points: "DataFrame", judged: str) -> "DataFrame":
    """Agreement of each source with each recorded set, by class.

    Returns
    -------
    DataFrame
        ``set, afferent, role, unit, source, recorded, count, r_squared, correlation, explained,
        rmse, bias, ratio, missing``. `recorded` numbers, of which the source has `count`.
        `r_squared` is the squared correlation, `explained` the explained share of the variance
        (1 minus squared errors over squared deviations of the data), `ratio` the sum of the
        model over that of the data. Of amplitudes and areas, correlation and share are of
        logarithms, `ratio` is the geometric mean of the ratios and `rmse` the factor of the
        root-mean-square error.
        A set without data has one row per class whose column `missing` names the data.
    """
    from pandas import DataFrame

    sources = {judged: JUDGED, FINGERTIP: FINGERTIP, TOUCHSIM: TOUCHSIM}
    rows: list[dict[str, Any]] = []
    for recorded_set in RECORDED_SETS:
        for afferent in recorded_set.afferents:
            chosen = (points["set"] == recorded_set.name) & (points["afferent"] == afferent)
            of_class = points[chosen]
            fixed = {
                "set": recorded_set.name,
                "afferent": afferent,
                "role": recorded_set.role,
                "unit": recorded_set.unit,
                "recorded": len(of_class),
                "missing": math.nan,
            }
            if of_class.empty:
                row = {"source": math.nan, "count": 0, "missing": recorded_set.fills}
                rows.append({**fixed, **row})
            for source, column in sources.items():
                numbers = _agreement(
                    of_class["recorded"].to_numpy(float),
                    of_class[column].to_numpy(float),
                    ratios=recorded_set.ratios,
                )
                if numbers["count"]:
                    rows.append({**fixed, "source": source, **numbers})
            if len(of_class) and recorded_set.family:
                rows += [
                    {**fixed, "source": OUYANG_SOURCE, "count": np.nan, **numbers}
                    for numbers in _ouyang(recorded_set.family, afferent)
                ]
    return DataFrame(rows, columns=list(ROW_COLUMNS))


def _agreement(recorded: FloatArray, model: FloatArray, *, ratios: bool) -> dict[str, float]:
    """Numbers of `recorded_rows` for one source."""
    both = np.isfinite(recorded) & np.isfinite(model)
    if ratios:
        both &= (recorded > 0) & (model > 0)
    numbers: dict[str, float] = {"count": int(both.sum())}
    if not both.any():
        return numbers
    data, predicted = recorded[both], model[both]
    if ratios:
        data, predicted = np.log(data), np.log(predicted)
    error = predicted - data
    rmse, bias = float(np.sqrt(np.mean(error**2))), float(error.mean())
    if data.size < _LEAST:
        rmse = math.nan
    deviation = float(np.sum((data - data.mean()) ** 2))
    if data.size > _LEAST and deviation > 0:
        numbers["explained"] = 1.0 - float(np.sum(error**2)) / deviation
        if np.ptp(predicted) > 0:
            numbers["correlation"] = float(np.corrcoef(data, predicted)[0, 1])
            numbers["r_squared"] = numbers["correlation"] ** 2
    if ratios:
        return {**numbers, "rmse": float(np.exp(rmse)), "ratio": float(np.exp(bias))}
    total = float(data.sum())
    ratio = float(predicted.sum()) / total if total > 0 else np.nan
    return {**numbers, "rmse": rmse, "bias": bias, "ratio": ratio}


def _ouyang(family: str, afferent: str) -> Iterable[dict[str, float]]:
    """Published agreement on all stimuli of a family, with the stimuli of the paper."""
    table = published(OUYANG).table
    chosen = (table["family"] == family) & (table["afferent"] == afferent)
    for row in table[chosen & (table["stimuli"] == "paper")].to_dict("records"):
        yield {"r_squared": row["r_squared"], "rmse": row["rmse_ips"]}


def further_stimuli(observed: Iterable[Rate]) -> tuple[Entry, ...]:
    """Observed vibrations that are not in the catalogue."""
    entries = dict.fromkeys(resolve(rate.stimulus)[0] for rate in observed)
    return tuple(entry for entry in entries if entry not in CATALOGUE)
