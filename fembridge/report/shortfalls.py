"""What a model does not do, a sentence each, found by the numbers, class by class."""

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from fembridge.report import rates
from fembridge.report.rates import EVERY_SET, FAMILIES, FINGERTIP, OBSERVED, Family, row_of
from fembridge.report.recorded import RAMP
from fembridge.report.validate import Validation
from fembridge.tables import AFFERENTS, SpikeTrain
from fembridge.words import number

if TYPE_CHECKING:
    from pandas import DataFrame

# An RMSE above this share of the mean rate is a shortfall even where R² is high.
RMSE_SHARE = 0.5

# Impulses a cycle that a model may be off the median of human units.
IMPULSES_IN_MAN_APART = 0.5

# A tuning curve may be off by so many times at one frequency, and by so many in the median.
MOST_TIMES, MEDIAN_TIMES = 4.0, 1.5


def shortfalls(study: Validation) -> tuple[str, ...]:
    """A sentence for everything in which the judged model is not good enough.

    Of a class whose rates are near enough in every family it is the family that is worst.
    """
    return _class_by_class(
        *(sentence for one in AFFERENTS for sentence in _of_rates(study, study.judged.name, one)),
        *_held_out_shortfalls(study),
        *_timing_shortfalls(study.evidence.judged.timing),
        *_tuning_shortfalls(study.evidence.judged.tuning),
        *_man_shortfalls(study.evidence.man),
        *_ramp_shortfalls(study.evidence.ramp),
    )


def fingertip_shortfalls(study: Validation) -> tuple[str, ...]:
    """The same of the parameters of the whole fingertip."""
    return _class_by_class(
        *(sentence for one in AFFERENTS for sentence in _of_rates(study, FINGERTIP, one)),
        *_timing_shortfalls(study.evidence.fingertip.timing),
        *_tuning_shortfalls(study.evidence.fingertip.tuning),
        *_distance_shortfalls(study.evidence.distance),
    )


def _class_by_class(*sentences: str) -> tuple[str, ...]:
    return tuple(sorted(sentences, key=lambda sentence: AFFERENTS.index(sentence[:2])))


def _of_rates(study: Validation, source: str, afferent: str) -> Iterator[str]:
    """Families of which the rates are not near enough, or that are the worst of a good class."""
    fine = {}
    observed_is_short = False
    for family in FAMILIES:
        reference = study.rates.reference(family.stimuli)
        key = (reference, source, family.name, EVERY_SET, afferent)
        cell = row_of(study.agreement, *key)
        if not cell["count"]:
            continue
        target_ips = study.rates.of(reference, afferent, family.stimuli)
        mean_ips = float(np.nanmean(target_ips))
        share = float(cell.rmse_ips) / mean_ips if mean_ips else math.inf
        observed = reference == OBSERVED
        good = cell.meets_goal if observed else cell.r_squared > rates.PAPER_R_SQUARED
        short = not (good and share <= RMSE_SHARE) if mean_ips else cell.rmse_ips > 0
        high = cell.r_squared >= rates.GOAL_R_SQUARED
        lost = ", not below TouchSim’s" if observed and high and not cell.meets_goal else ""
        words = (
            f"{family.title.lower()}{'' if observed else ', against TouchSim'}: R² "
            f"{number(cell.r_squared, '.2f')}, RMSE {cell.rmse_ips:.1f} impulses/s{lost} where "
            f"the mean rate is {mean_ips:.1f}; at {_worst_set(study, source, family, afferent)}."
        )
        top_ips = float(np.nanmax(target_ips))
        if top_ips > 0 and not np.nanmax(study.rates.of(cell.source, afferent, family.stimuli)) > 0:
            where = f"where {reference} reaches {top_ips:.1f} impulses/s"
            words = f"{words.partition(':')[0]}: silent throughout, {where}."
        if short:
            observed_is_short |= observed
            yield f"{afferent}, {words}"
        fine[observed, share] = "" if short else words
    worst = fine[max(fine)] if fine and not observed_is_short else ""
    if worst:
        yield f"{afferent}, weakest under {worst}"


def _worst_set(study: Validation, source: str, family: Family, afferent: str) -> str:
    """Set with the largest mean error, how far and to which side: in words."""
    place = (study.rates.reference(family.stimuli), source, family.name, afferent)
    levels = ["reference", "source", "family", "afferent"]
    titles = {one.name: one.title for one in family.sets}
    biases_ips = study.agreement.xs(place, level=levels).bias_ips.reindex(list(titles)).dropna()
    worst = str(biases_ips.abs().idxmax())
    side = "high" if biases_ips[worst] > 0 else "low"
    return f"{titles[worst]} {abs(biases_ips[worst]):.1f} impulses/s too {side} on average"


def _held_out_shortfalls(study: Validation) -> Iterator[str]:
    for afferent, rows in study.held_out.groupby("afferent", sort=False):
        [total] = rows[rows.frequency_hz.isna()].to_dict("records")
        goal_ips = rates.HELD_OUT_GOAL_IPS[str(afferent)]
        if total["held_out_rmse_ips"] > goal_ips:
            yield (
                f"{afferent}, frequencies left out of the fit: RMSE "
                f"{total['held_out_rmse_ips']:.1f} impulses/s, where {goal_ips:g} is the goal."
            )


def _timing_shortfalls(timing: "DataFrame") -> Iterator[str]:
    for row in timing[~timing["strengths_near"]].itertuples():
        words = (
            f"vector strength {row.model_strength_f:.2f} and {row.model_strength_2f:.2f} at the "
            f"frequency and at twice it, recorded {row.strength_f:.2f} and {row.strength_2f:.2f}"
        )
        if not row.model_impulses_per_cycle:
            words = "no spikes where recorded afferents fire"
        place = f"{row.frequency_hz:g} Hz, {row.amplitude_um:g} µm"
        yield f"{row.afferent}, timing at {place}: {words}."
    for afferent, off in timing[~timing["impulses_near"]].groupby("afferent", sort=False):
        words = ", ".join(
            f"{row.model_unit_impulses:.1f} instead of {row.impulses_per_cycle:.1f} at "
            f"{row.amplitude_um:g} µm"
            for row in off.itertuples()
        )
        yield f"{afferent}, impulses a cycle of the cell most like the recorded unit: {words}."


def _tuning_shortfalls(tuning: "DataFrame") -> Iterator[str]:
    known = tuning.dropna(subset="ratio")
    known = known.assign(times=np.exp(np.abs(np.log(known["ratio"]))))
    for afferent in dict.fromkeys(known["afferent"]):
        rows = known[known["afferent"] == afferent].sort_values("times").to_dict("records")
        median, worst = float(np.median([row["times"] for row in rows])), rows[-1]
        if median > MEDIAN_TIMES or worst["times"] > MOST_TIMES:
            yield (
                f"{afferent}, thresholds: off by {median:.1f} times in the median, most at "
                f"{worst['frequency_hz']:g} Hz ({worst['criterion'].replace('_', ' ')}): "
                f"{worst['model_um']:.3g} µm instead of {worst['amplitude_um']:.3g}."
            )


def _man_shortfalls(man: "DataFrame") -> Iterator[str]:
    for afferent, mine in man.groupby("afferent", sort=False):
        apart = (mine["model"] - mine["impulses_per_cycle"]).abs()
        row = mine.to_dict("records")[int(apart.to_numpy().argmax())]
        if apart.max() > IMPULSES_IN_MAN_APART:
            yield (
                f"{afferent}, impulses a cycle in man: farthest off with {row['model']:.1f} "
                f"instead of {row['impulses_per_cycle']:.1f} at {row['frequency_hz']:g} Hz, "
                f"{row['amplitude_um']:g} µm."
            )


def _distance_shortfalls(distance: "DataFrame") -> Iterator[str]:
    ratio = (distance["model_um"] / distance["amplitude_um"]).dropna()
    times = np.exp(np.abs(np.log(ratio.to_numpy())))
    if times.size and np.median(times) > MEDIAN_TIMES:
        yield (
            f"RA, away from a probe: amplitudes off by "
            f"{np.median(times):.1f} times in the median, {times.max():.1f} at most."
        )


def _ramp_shortfalls(trains: Sequence[SpikeTrain]) -> Iterator[str]:
    start_ms, top_ms, back_ms, end_ms = RAMP.corners_ms

    def count(afferent: str, low_ms: float, high_ms: float) -> int:
        mine = [train.times_ms for train in trains if train.afferent == afferent]
        return sum(int(((one > low_ms) & (one <= high_ms)).sum()) for one in mine)

    early = count("SA", top_ms, top_ms + 100.0)
    late = count("SA", back_ms - 100.0, back_ms)
    if not early > late > 0:
        yield (
            f"SA, ramp and hold: {early} spikes of all cells in the first 100 ms of the hold and "
            f"{late} in the last; recorded ones slow down and fire on."
        )
    margin_ms = 25.0
    for low_ms, high_ms, name in (
        (start_ms, top_ms + margin_ms, "indentation"),
        (back_ms, end_ms + margin_ms, "retraction"),
    ):
        silent = [one for one in ("RA", "PC") if not count(one, low_ms, high_ms)]
        if silent:
            yield f"{' and '.join(silent)}, ramp and hold: silent during {name}."
    for one in ("RA", "PC"):
        if count(one, top_ms + 2 * margin_ms, back_ms):
            yield f"{one}, ramp and hold: fires while the probe stands."
