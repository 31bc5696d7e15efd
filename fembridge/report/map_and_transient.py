"""Study: an interpolation in the response map against whole transients.

The map takes one indentation of 39 increments for all 82 stimuli; a transient of one
stimulus takes 500. Six stimuli of the three families are solved in full and compared:
stress, the drive of each afferent, and the spikes, one by one.
"""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from decks.analysis import Model
from decks.presets import PRESETS, model_of
from decks.stimuli import CATALOGUE, resolve
from decks.waveform import make_stimulus
from fembridge.build import inputs_of
from fembridge.errors import ResponseError
from fembridge.report.runs import Attempt, Cost, Runs
from fembridge.report.study import AT_LEAST, Check, Finding, finish, line, panels
from fembridge.response.acceptance import indentation, recorded_response
from fembridge.response.response_map import ResponseMap
from fembridge.response.solve import CONTACT_CAUSES, LADDER
from fembridge.results import read
from fembridge.stimulus import Stimulus
from fembridge.trace import StressTrace
from fembridge.typing import FloatArray
from neural import encode_cells, parameter_set
from neural.encoder import afferent_drives

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

TRACE_PERCENT, DRIVE_PERCENT, EQUAL_PERCENT = 0.1, 3.0, 99.0
FEWER_INCREMENTS, LESS_CPU = 1000.0, 300.0
# Stimulus, and depth of the probe before time 0. Parameters are those that hold for it.
_CASES = (
    ("sine_20_250", 0.0),
    ("sine_300_31.02", 75.0),
    ("diharm_10_50_125", 0.0),
    ("diharm_50_250_44.46", 75.0),
    ("noise_5_100_50", 0.0),
    ("noise_25_250_20", 75.0),
)
# How many samples of 0.5 ms are followed: 501 are a whole stimulus.
_SAMPLES = {"quick": 501, "paper": 101}
_QUICK_RUN_SAMPLES = 21
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

    @property
    def solved_ms(self) -> float:
        """How much of the stimulus was followed."""
        return (self.stimulus.displacement_um.size - 1) * self.stimulus.dt_ms


@dataclass(frozen=True, slots=True)
class MapCost:
    """Of one finger's map: the solver's, and Python's for the stress of 82 stimuli."""

    solver: Cost
    python_s: float

    @property
    def cpu_s(self) -> float:
        """Processor time of all of it."""
        return self.solver.cpu_s + self.python_s


def study(runs: Runs) -> Finding:
    """Solve and compare."""
    found: list[Compared] = []
    maps: dict[str, MapCost] = {}
    for finger in ("quick",) if runs.quick else ("quick", "paper"):
        model = model_of(PRESETS[finger])
        response, attempt = _mapped(runs, f"{finger}/response", model)
        maps[finger] = MapCost(attempt.cost, _interpolation_s(response))
        samples = _QUICK_RUN_SAMPLES if runs.quick else _SAMPLES[finger]
        for stimulus in [_shortened(*case, samples) for case in _CASES]:
            runs.log(f"map: {stimulus.id} on {finger}")
            found.append(_compare(runs, model, response, stimulus))
    return finding_of(found, maps)


def finding_of(found: Sequence[Compared], maps: Mapping[str, MapCost]) -> Finding:
    """Put the comparisons together."""
    worst_trace = max(max(each.trace_percent.values()) for each in found)
    worst_drive = max(max(each.drive_percent.values()) for each in found)
    equal = sum(each.equal for each in found)
    either = sum(each.spikes + each.more for each in found)
    share = 100 * equal / either if either else math.nan
    costs = _costs(found, maps)
    fewer, less_cpu = float(costs.ratio.min()), float(costs.cpu_ratio.min())
    return Finding(
        checks=(
            Check("stress, largest error", worst_trace, TRACE_PERCENT, "%"),
            Check("drive, largest error", worst_drive, DRIVE_PERCENT, "%"),
            Check("spikes at the same sample", share, EQUAL_PERCENT, "%", AT_LEAST),
            Check("82 stimuli: times fewer increments", fewer, FEWER_INCREMENTS, side=AT_LEAST),
            Check("82 stimuli: times less processor time", less_cpu, LESS_CPU, side=AT_LEAST),
        ),
        tables={"map": _errors(found), "map_cost": costs},
        numbers={
            "followed_ms": {
                name: sorted({each.solved_ms for each in found if each.finger == name})
                for name in maps
            },
            "equal": equal,
            "either": either,
            "share_percent": share,
            "trace_percent": worst_trace,
            "drive_percent": worst_drive,
            "fewer": fewer,
            "less_cpu": less_cpu,
            "shown": _SHOWN,
            "finger": found[0].finger,
        },
        figure=_figure(found),
    )


def _errors(found: Sequence[Compared]) -> "DataFrame":
    from pandas import DataFrame

    rows: list[dict[str, Any]] = [
        {
            "finger": f"`{each.finger}`",
            "stimulus": f"`{each.stimulus.id}`",
            "held_um": each.stimulus.preindent_um,
            "solved_ms": each.solved_ms,
            **{f"{name}_stress": off for name, off in each.trace_percent.items()},
            **{f"{name}_drive": off for name, off in each.drive_percent.items()},
            "spikes": each.spikes,
            "different": each.spikes - each.equal + each.more,
            "iterations": each.cost.iterations,
            "cpu_s": each.cost.cpu_s,
            "contact": each.contact,
        }
        for each in found
    ]
    return DataFrame(rows)


def _costs(found: Sequence[Compared], maps: Mapping[str, MapCost]) -> "DataFrame":
    """What 82 stimuli take by map and by transient, whose increments cost those solved."""
    from pandas import DataFrame

    increments = sum(make_stimulus(entry).displacement_um.size - 1 for entry in CATALOGUE)
    rows = []
    for finger, of_map in maps.items():
        sampled = sum((each.cost for each in found if each.finger == finger), start=Cost())
        an_increment_s = sampled.cpu_s / sampled.increments
        rows.append(
            {
                "finger": f"`{finger}`",
                "map_increments": of_map.solver.increments,
                "transient_increments": increments,
                "ratio": increments / of_map.solver.increments,
                "map_cpu_s": of_map.cpu_s,
                "cpu_s_an_increment": an_increment_s,
                "transients_cpu_s": an_increment_s * increments,
                "cpu_ratio": an_increment_s * increments / of_map.cpu_s,
            }
        )
    return DataFrame(rows)


def _figure(found: Sequence[Compared]) -> "Figure":
    """Stress over time of one stimulus, by the map and by the transient."""
    shown = next(each for each in found if each.stimulus.id == _SHOWN)
    figure, all_panels = panels(len(shown.traces[0]))
    for panel, mapped, solved in zip(all_panels, *shown.traces, strict=True):
        times_ms = (mapped.times_ms - mapped.times_ms[0])[:_DRAWN]
        mapped_kpa, solved_kpa = mapped.stress_pa / 1000, np.asarray(solved.stress_pa) / 1000
        panel.plot(times_ms, mapped_kpa[:_DRAWN], label="map", **line(0, mark="line"))
        panel.plot(
            times_ms[::_EVERY],
            solved_kpa[:_DRAWN:_EVERY],
            label="transient",
            **line(1, mark="dots"),
        )
        y = "von Mises stress (kPa)" if panel is all_panels[0] else ""
        finish(panel, "time (ms)", y, title=str(mapped.afferent))
    return figure


def _mapped(runs: Runs, name: str, model: Model) -> tuple[ResponseMap, Attempt]:
    stimulus = indentation()
    model = replace(model, support="prescribed")  # as `solve_response` has it
    attempt = runs.attempt(
        f"map/{name}", model.analysis(stimulus), stimulus, inputs_of(model, stimulus)
    ).accepted()
    return recorded_response(attempt.folder), attempt


def _shortened(word: str, preindent_um: float, count: int) -> Stimulus:
    """First `count` samples of a stimulus, or all of them."""
    [entry] = resolve(word)
    whole = make_stimulus(entry, preindent_um=preindent_um)
    if count >= whole.displacement_um.size:
        return whole
    return replace(
        whole,
        displacement_um=whole.displacement_um[:count],
        window_ms=(0.0, (count - 1) * whole.dt_ms),
    )


def _compare(runs: Runs, model: Model, response: ResponseMap, stimulus: Stimulus) -> Compared:
    """Follow the ladder of contacts, as `simulate` does: each with its own map."""
    for number, contact in enumerate(LADDER):
        tried = replace(model, contact=contact)
        place = f"{model.finger.name}/{stimulus.id}_{number}"
        if number:
            response, _ = _mapped(runs, f"{place}_response", tried)
        attempt = runs.attempt(
            f"map/{place}", tried.analysis(stimulus), stimulus, inputs_of(tried, stimulus)
        )
        if attempt.failure is None:
            return _compared(tried, response, stimulus, attempt)
        if attempt.failure.cause not in CONTACT_CAUSES:
            break
        runs.log(f"map: left {contact}: {attempt.failure}")
    raise ResponseError(f"{stimulus.id}: no contact model converged")


def _compared(
    model: Model, response: ResponseMap, stimulus: Stimulus, attempt: Attempt
) -> Compared:
    by_map, by_transient = response.traces(stimulus), read(attempt.folder)
    # Those that hold for its pre-indentation.
    parameters = parameter_set("fitted" if stimulus.preindent_um else "published").parameters
    trace_percent, drive_percent = {}, {}
    spikes = equal = more = 0
    for mapped, solved in zip(by_map, by_transient, strict=True):
        name = str(mapped.afferent)
        trace_percent[name] = _off_percent(mapped.stress_pa, solved.stress_pa)
        drives, trains = [], []
        for trace in (mapped, solved):
            drive = parameters[name].drive
            drives.append(afferent_drives(name, trace.stress_pa, trace.dt_ms, model=drive))
            trains.append(encode_cells(trace.stress_pa, trace.dt_ms, parameters[name])[0])
        drive_percent[name] = max(map(_off_percent, *drives))
        for one, other in zip(*trains, strict=True):
            spikes += other.size
            equal += int(np.isin(other, one).sum())
            more += one.size - int(np.isin(one, other).sum())
    return Compared(
        finger=model.finger.name,
        stimulus=stimulus,
        contact=str(model.contact),
        trace_percent=trace_percent,
        drive_percent=drive_percent,
        spikes=spikes,
        equal=equal,
        more=more,
        cost=attempt.cost,
        traces=(by_map, by_transient),
    )


def _off_percent(found: FloatArray, expected: FloatArray) -> float:
    """Largest difference in percent of the largest value."""
    return 100 * float(np.abs(found - expected).max() / np.abs(expected).max())


def _interpolation_s(response: ResponseMap) -> float:
    """Processor time of the stress of all 82 stimuli by the map."""
    begin_s = time.process_time()
    for entry in CATALOGUE:
        response.traces(make_stimulus(entry))
    return time.process_time() - begin_s
