"""What the study of map and transients says: errors, spikes, and what each costs."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from decks.stimuli.catalogue import CATALOGUE
from decks.stimuli.waveform import make_stimulus
from fembridge.stimulus import Stimulus
from fembridge.trace import StressTrace
from fembridge.verification.bench import Cost
from fembridge.verification.finding import AT_LEAST, Chart, Check, Finding, Line, NumberTable, Panel

NAME = "map"
TITLE = "Response map against whole transients"

TRACE_PERCENT, DRIVE_PERCENT, EQUAL_PERCENT = 0.1, 3.0, 99.0
FEWER_INCREMENTS, LESS_CPU = 1000.0, 300.0
_SHOWN = "diharm_10_50_125"
_EVERY = 2
_DRAWN = 201  # samples: 100 ms


@dataclass(frozen=True, slots=True, eq=False)
class Compared:
    """One stimulus on one finger: largest errors in percent of the peak, and spikes.

    `trace_percent` and `drive_percent` are by afferent. `spikes` counts those of the
    transient, `equal` those that the map has at the same sample, `more` those that
    the map alone has. `traces` are the map's and the transient's.
    """

    finger: str
    stimulus: Stimulus
    contact: str
    trace_percent: Mapping[str, float]
    drive_percent: Mapping[str, float]
    spikes: int
    equal: int
    more: int
    cost: Cost
    traces: tuple[Sequence[StressTrace], Sequence[StressTrace]]


@dataclass(frozen=True, slots=True)
class MapCost:
    """Of one finger's map: the solver's, and Python's for the stress of 82 stimuli."""

    solver: Cost
    python_s: float

    @property
    def cpu_s(self) -> float:
        """Processor time of all of it."""
        return self.solver.cpu_s + self.python_s


def finding_of(
    found: Sequence[Compared], maps: Mapping[str, MapCost], *, spent: Cost, reduced: str
) -> Finding:
    """Put the comparisons together."""
    worst_trace = max(max(each.trace_percent.values()) for each in found)
    worst_drive = max(max(each.drive_percent.values()) for each in found)
    spikes = sum(each.spikes for each in found)
    equal = sum(each.equal for each in found)
    either = spikes + sum(each.more for each in found)
    share = 100 * equal / either if either else math.nan
    costs = {finger: _costs(finger, found, maps[finger]) for finger in maps}
    increments_ratio = min(row[3] for row in costs.values())
    cpu_ratio = min(row[7] for row in costs.values())
    return Finding(
        name=NAME,
        title=TITLE,
        question=(
            "`simulate` interpolates in one load–unload indentation for every "
            "stimulus. Six stimuli of the three families, on an unheld probe that "
            "leaves the skin in each cycle (parameters of the paper) and on one held "
            "at 75 µm (fitted parameters), are also solved as whole transients, and "
            "compared: stress, the afferents' drives (what an equation's filters "
            "make of stress, second derivatives among them), and the spikes of all "
            "cells, one by one."
        ),
        words=(
            f"Followed were the first {_parts(found)} of each stimulus.",
            f"{equal} of {either} spikes stand at the same sample "
            f"({share:.2f} %); stress is within {worst_trace:.2g} % of "
            f"its peak, the drives within {worst_drive:.2g} %.",
            "A drive with differences of stress in it shows errors of stress enlarged "
            "many times where those pass through zero.",
            f"All 82 stimuli by the map take {increments_ratio:.0f} times fewer "
            f"increments of the solver and {cpu_ratio:.0f} times less processor time "
            "than 82 transients would; the time of an increment is that of the six.",
        ),
        checks=(
            Check("stress, largest error", worst_trace, TRACE_PERCENT, "%"),
            Check("drive, largest error", worst_drive, DRIVE_PERCENT, "%"),
            Check("spikes at the same sample", share, EQUAL_PERCENT, "%", AT_LEAST),
            Check(
                "82 stimuli: times fewer increments",
                increments_ratio,
                FEWER_INCREMENTS,
                side=AT_LEAST,
            ),
            Check("82 stimuli: times less processor time", cpu_ratio, LESS_CPU, side=AT_LEAST),
        ),
        tables=(_errors(found), _cost_table(costs)),
        charts=(_chart(found),),
        reduced=reduced,
        cost=spent,
    )


def _parts(found: Sequence[Compared]) -> str:
    """Tell how much of the stimuli was followed on each finger."""
    parts = []
    for name in dict.fromkeys(each.finger for each in found):
        ms = [_solved_ms(each) for each in found if each.finger == name]
        span = f"{min(ms):g}" if min(ms) == max(ms) else f"{min(ms):g} to {max(ms):g}"
        parts.append(f"{span} ms on `{name}`")
    return " and ".join(parts)


def _solved_ms(each: Compared) -> float:
    return (each.stimulus.displacement_um.size - 1) * each.stimulus.dt_ms


def _errors(found: Sequence[Compared]) -> NumberTable:
    names = tuple(found[0].trace_percent)
    return NumberTable(
        name="map",
        caption="Largest error in percent of the peak, of stress and of drive; spikes "
        "of the transient, those that are not in both. `held` is "
        "the depth of the probe before time 0, `solved` the part of the stimulus "
        "that was followed",
        columns=(
            *("finger", "stimulus", "held_um", "solved_ms"),
            *(f"{name}_stress" for name in names),
            *(f"{name}_drive" for name in names),
            *("spikes", "different", "iterations", "cpu_s", "contact"),
        ),
        rows=tuple(
            (
                f"`{each.finger}`",
                f"`{each.stimulus.id}`",
                each.stimulus.preindent_um,
                _solved_ms(each),
                *each.trace_percent.values(),
                *each.drive_percent.values(),
                each.spikes,
                each.spikes - each.equal + each.more,
                each.cost.iterations,
                each.cost.cpu_s,
                each.contact,
            )
            for each in found
        ),
        formats=(*("", "", "g", "g"), *[".1e"] * (2 * len(names)), *("d", "d", "d", ".0f", "")),
    )


def _costs(
    finger: str, found: Sequence[Compared], of_map: MapCost
) -> tuple[str, int, int, float, float, float, float, float]:
    """Increments of map and transients, their ratio; CPU alike."""
    sampled = sum((one.cost for one in found if one.finger == finger), start=Cost())
    an_increment_s = sampled.cpu_s / sampled.increments
    increments = sum(make_stimulus(entry).displacement_um.size - 1 for entry in CATALOGUE)
    transients_s = an_increment_s * increments
    return (
        f"`{finger}`",
        of_map.solver.increments,
        increments,
        increments / of_map.solver.increments,
        of_map.cpu_s,
        an_increment_s,
        transients_s,
        transients_s / of_map.cpu_s,
    )


def _cost_table(costs: Mapping[str, tuple[str | int | float, ...]]) -> NumberTable:
    return NumberTable(
        name="map_cost",
        caption="What all 82 stimuli take. Processor time of the map has the "
        "interpolation in Python in it; that of the transients is the mean of the "
        "increments solved here times their number",
        columns=(
            *("finger", "map_increments", "transient_increments", "ratio"),
            *("map_cpu_s", "cpu_s_an_increment", "transients_cpu_s", "cpu_ratio"),
        ),
        rows=tuple(costs.values()),
        formats=("", "d", "d", ".0f", ".1f", ".2f", ".0f", ".0f"),
    )


def _chart(found: Sequence[Compared]) -> Chart:
    """Stress over time of one stimulus, by the map and by the transient."""
    shown = next(each for each in found if each.stimulus.id == _SHOWN)
    panels: list[Panel] = []
    for mapped, solved in zip(*shown.traces, strict=True):
        name = str(mapped.afferent)
        times_ms = (mapped.times_ms - mapped.times_ms[0])[:_DRAWN]
        panels.append(
            Panel(
                along="time (ms)",
                up="von Mises stress (kPa)" if not panels else "",
                lines=(
                    Line(
                        "map",
                        tuple(times_ms.tolist()),
                        tuple((mapped.stress_pa / 1000)[:_DRAWN].tolist()),
                        "line",
                    ),
                    Line(
                        "transient",
                        tuple(times_ms[::_EVERY].tolist()),
                        tuple((np.asarray(solved.stress_pa) / 1000)[:_DRAWN:_EVERY].tolist()),
                        "dots",
                    ),
                ),
                title=name,
            )
        )
    return Chart(
        name="map",
        caption=f"`{_SHOWN}` on `{shown.finger}`, unheld: line the map, dots the "
        "transient (every second sample).",
        panels=tuple(panels),
    )
