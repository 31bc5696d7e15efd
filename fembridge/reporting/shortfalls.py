"""Shortfalls of a model: one sentence per number that misses its bound, sorted by class."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fembridge.io.formatting import number
from fembridge.io.spike_table import SpikeTrain
from fembridge.reporting import rate_tables as rates
from fembridge.reporting.rate_tables import ALL_SETS, FAMILIES, FINGERTIP, OBSERVED, Family, row_of
from fembridge.reporting.recorded import RAMP
from fembridge.reporting.validation_data import ValidationData
from fembridge.trace import AFFERENTS
from fembridge.typing import FloatArray

if TYPE_CHECKING:
    from pandas import DataFrame

# An RMSE above this share of the mean rate is a shortfall even where R² is high.
RMSE_SHARE = 0.5

# Largest accepted difference from the median of human units, in impulses per cycle.
HUMAN_IMPULSES_TOLERANCE = 0.5

# Largest accepted factor between a model's and a recorded amplitude: at one frequency, and in
# the median.
MAX_FACTOR, MAX_MEDIAN_FACTOR = 4.0, 1.5

# Spikes are still counted as evoked by a ramp this long after its end.
_MARGIN_MS = 25.0


@dataclass(frozen=True, slots=True)
class Shortfall:
    """A number of a model that misses its bound.

    `topic` is one of ``rates, weakest_family, held_out, timing, unit_impulses, thresholds,
    human_impulses, distance, ramp``. `family` is the name of a family of stimuli, for rates.
    `message` holds the numbers and does not name the classes.
    """

    afferents: tuple[str, ...]
    topic: str
    message: str
    family: str = ""

    @property
    def sentence(self) -> str:
        """Classes and message, as the page shows them."""
        return f"{' and '.join(self.afferents)}, {self.message}."


def shortfalls(validation: ValidationData) -> tuple[Shortfall, ...]:
    """Shortfalls of the judged model.

    A class with good rates in every family has an entry for its weakest family.
    """
    evidence = validation.evidence
    return _sorted_by_class(
        *_all_rate_shortfalls(validation, validation.judged.name),
        *_held_out_shortfalls(validation),
        *_timing_shortfalls(evidence.judged.timing),
        *_tuning_shortfalls(evidence.judged.tuning),
        *_human_shortfalls(evidence.human),
        *_ramp_shortfalls(evidence.ramp),
    )


def fingertip_shortfalls(validation: ValidationData) -> tuple[Shortfall, ...]:
    """Shortfalls of the parameters of the whole fingertip; none where the model is on a pad."""
    evidence, fingertip = validation.evidence, validation.evidence.fingertip
    if fingertip is None:
        return ()
    return _sorted_by_class(
        *_all_rate_shortfalls(validation, FINGERTIP),
        *_timing_shortfalls(fingertip.timing),
        *_tuning_shortfalls(fingertip.tuning),
        *_distance_shortfalls(evidence.distance),
    )


def _sorted_by_class(*entries: Shortfall) -> tuple[Shortfall, ...]:
    return tuple(sorted(entries, key=lambda entry: AFFERENTS.index(entry.afferents[0])))


def _all_rate_shortfalls(validation: ValidationData, source: str) -> Iterator[Shortfall]:
    for afferent in AFFERENTS:
        yield from _rate_shortfalls(validation, source, afferent)


def _rate_shortfalls(validation: ValidationData, source: str, afferent: str) -> Iterator[Shortfall]:
    """Families with insufficient rates, or the weakest family of a good class."""
    candidates: dict[tuple[bool, float], Shortfall | None] = {}
    short_of_observed = False
    for family in FAMILIES:
        reference = validation.rates.reference(family.stimuli)
        key = (reference, source, family.name, ALL_SETS, afferent)
        cell = row_of(validation.agreement, *key)
        if not cell["count"]:
            continue
        target_ips = validation.rates.rates_ips(reference, afferent, family.stimuli)
        mean_ips = float(np.nanmean(target_ips))
        share = float(cell.rmse_ips) / mean_ips if mean_ips else math.inf
        observed = reference == OBSERVED
        good = cell.meets_goal if observed else cell.r_squared > rates.PAPER_R_SQUARED
        short = not (good and share <= RMSE_SHARE) if mean_ips else cell.rmse_ips > 0
        title = family.title.lower() + ("" if observed else ", against TouchSim")
        top_ips = float(np.nanmax(target_ips))
        predicted_ips = validation.rates.rates_ips(cell.source, afferent, family.stimuli)
        if top_ips > 0 and not np.nanmax(predicted_ips) > 0:
            subject = "the observed rates reach" if observed else f"{reference} reaches"
            message = f"{title}: silent throughout; {subject} {top_ips:.1f} impulses/s"
        else:
            high = cell.r_squared >= rates.GOAL_R_SQUARED
            remark = " (not below TouchSim’s)" if observed and high and not cell.meets_goal else ""
            message = (
                f"{title}: R² {number(cell.r_squared, '.2f')}, RMSE {cell.rmse_ips:.1f} "
                f"impulses/s{remark}, mean rate {mean_ips:.1f} impulses/s; "
                f"{_largest_bias(validation, source, family, afferent)}"
            )
        if short:
            short_of_observed |= observed
            yield Shortfall((afferent,), "rates", message, family.name)
        weakest = Shortfall((afferent,), "weakest_family", f"weakest under {message}", family.name)
        candidates[observed, share] = None if short else weakest
    if candidates and not short_of_observed and (entry := candidates[max(candidates)]):
        yield entry


def _largest_bias(validation: ValidationData, source: str, family: Family, afferent: str) -> str:
    """Set with the largest mean error, with size and sign of that error."""
    key = (validation.rates.reference(family.stimuli), source, family.name, afferent)
    levels = ["reference", "source", "family", "afferent"]
    titles = {stimulus_set.name: stimulus_set.title for stimulus_set in family.sets}
    cells = validation.agreement.xs(key, level=levels)
    biases_ips = cells.bias_ips.reindex(list(titles)).dropna()
    worst = str(biases_ips.abs().idxmax())
    side = "high" if biases_ips[worst] > 0 else "low"
    size_ips = abs(biases_ips[worst])
    return f"largest bias at {titles[worst]}: {size_ips:.1f} impulses/s too {side} on average"


def _held_out_shortfalls(validation: ValidationData) -> Iterator[Shortfall]:
    for afferent, rows in validation.held_out.groupby("afferent", sort=False):
        [total] = rows[rows.frequency_hz.isna()].to_dict("records")
        goal_ips = rates.HELD_OUT_GOAL_IPS[str(afferent)]
        if total["held_out_rmse_ips"] > goal_ips:
            message = (
                "frequencies left out of the fit: RMSE "
                f"{total['held_out_rmse_ips']:.1f} impulses/s, goal {goal_ips:g}"
            )
            yield Shortfall((str(afferent),), "held_out", message)


def _timing_shortfalls(timing: "DataFrame") -> Iterator[Shortfall]:
    for row in timing[~timing["strengths_near"]].itertuples():
        result = (
            f"vector strength {row.model_strength_f:.2f} at the frequency and "
            f"{row.model_strength_2f:.2f} at twice the frequency, recorded {row.strength_f:.2f} "
            f"and {row.strength_2f:.2f}"
        )
        if not row.model_impulses_per_cycle:
            result = "no spikes where recorded afferents fire"
        message = f"timing at {row.frequency_hz:g} Hz, {row.amplitude_um:g} µm: {result}"
        yield Shortfall((str(row.afferent),), "timing", message)
    for afferent, rows in timing[~timing["impulses_near"]].groupby("afferent", sort=False):
        differences = ", ".join(
            f"{row.model_unit_impulses:.1f} instead of {row.impulses_per_cycle:.1f} at "
            f"{row.amplitude_um:g} µm"
            for row in rows.itertuples()
        )
        message = f"impulses per cycle of the cell closest to the recorded unit: {differences}"
        yield Shortfall((str(afferent),), "unit_impulses", message)


def _factor(ratios: Iterable[float]) -> FloatArray:
    """Ratio or its inverse, whichever is above 1."""
    factors: FloatArray = np.exp(np.abs(np.log(np.asarray(ratios, dtype=np.float64))))
    return factors


def _tuning_shortfalls(tuning: "DataFrame") -> Iterator[Shortfall]:
    reached = tuning.dropna(subset="ratio")
    reached = reached.assign(factor=_factor(reached["ratio"]))
    for afferent in dict.fromkeys(reached["afferent"]):
        of_class = reached[reached["afferent"] == afferent]
        rows = of_class.sort_values("factor").to_dict("records")
        median, worst = float(np.median([row["factor"] for row in rows])), rows[-1]
        if median > MAX_MEDIAN_FACTOR or worst["factor"] > MAX_FACTOR:
            message = (
                f"thresholds: off by a factor of {median:.1f} in the median, most at "
                f"{worst['frequency_hz']:g} Hz ({worst['criterion'].replace('_', ' ')}): "
                f"{worst['model_um']:.3g} µm instead of {worst['amplitude_um']:.3g} µm"
            )
            yield Shortfall((afferent,), "thresholds", message)


def _human_shortfalls(human: "DataFrame") -> Iterator[Shortfall]:
    for afferent, rows in human.groupby("afferent", sort=False):
        difference = (rows["model"] - rows["impulses_per_cycle"]).abs()
        worst = rows.to_dict("records")[int(difference.to_numpy().argmax())]
        if difference.max() > HUMAN_IMPULSES_TOLERANCE:
            message = (
                "impulses per cycle of human units: largest difference at "
                f"{worst['frequency_hz']:g} Hz, {worst['amplitude_um']:g} µm, with "
                f"{worst['model']:.1f} instead of {worst['impulses_per_cycle']:.1f}"
            )
            yield Shortfall((str(afferent),), "human_impulses", message)


def _distance_shortfalls(distance: "DataFrame") -> Iterator[Shortfall]:
    factors = _factor((distance["model_um"] / distance["amplitude_um"]).dropna())
    if factors.size and np.median(factors) > MAX_MEDIAN_FACTOR:
        message = (
            "amplitudes away from the probe: off by a factor of "
            f"{np.median(factors):.1f} in the median, {factors.max():.1f} at most"
        )
        yield Shortfall(("RA",), "distance", message)


def _ramp_shortfalls(trains: Sequence[SpikeTrain]) -> Iterator[Shortfall]:
    start_ms, top_ms, release_ms, end_ms = RAMP.corners_ms

    def count(afferent: str, low_ms: float, high_ms: float) -> int:
        of_class = [train.times_ms for train in trains if train.afferent == afferent]
        return sum(int(((times > low_ms) & (times <= high_ms)).sum()) for times in of_class)

    early = count("SA", top_ms, top_ms + 100.0)
    late = count("SA", release_ms - 100.0, release_ms)
    if not early > late > 0:
        message = (
            f"ramp and hold: {early} spikes of all cells in the first 100 ms of the hold and "
            f"{late} in the last 100 ms; recorded units slow down and keep firing"
        )
        yield Shortfall(("SA",), "ramp", message)
    for low_ms, high_ms, phase in (
        (start_ms, top_ms + _MARGIN_MS, "indentation"),
        (release_ms, end_ms + _MARGIN_MS, "retraction"),
    ):
        silent = tuple(name for name in ("RA", "PC") if not count(name, low_ms, high_ms))
        if silent:
            yield Shortfall(silent, "ramp", f"ramp and hold: silent during {phase}")
    for name in ("RA", "PC"):
        if count(name, top_ms + 2 * _MARGIN_MS, release_ms):
            yield Shortfall((name,), "ramp", "ramp and hold: fires while the probe is held still")
