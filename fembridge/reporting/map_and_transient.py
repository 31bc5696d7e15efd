"""Study: interpolation in the response map compared with complete transients.

The map requires one indentation of 39 increments for all 82 stimuli; a transient requires 500
increments per stimulus. Six stimuli of the three families are solved as transients; stress,
the drive of each afferent and every spike are compared.
"""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from pandas import DataFrame

from decks.contact_analysis import Model
from decks.presets import PRESETS, model_of
from decks.stimuli import CATALOGUE, resolve
from decks.synthesis import make_stimulus
from fembridge.errors import ResponseError
from fembridge.reporting.verification_runs import (
    AT_LEAST,
    BoundCheck,
    Cost,
    Finding,
    RunAttempt,
    Runs,
    finish,
    largest_difference_percent,
    line,
    panels,
)
from fembridge.response.indentation import CONTACT_CAUSES, LADDER, indentation, measured_response
from fembridge.response.response_map import ResponseMap
from fembridge.results import read
from fembridge.stimulus import Stimulus
from fembridge.trace import StressTrace
from neural import encode_cells, parameter_set
from neural.models import model_named

TRACE_PERCENT, DRIVE_PERCENT, EQUAL_PERCENT = 0.1, 3.0, 99.0
FEWER_INCREMENTS, LESS_CPU = 1000.0, 300.0
# Stimulus and pre-indentation in um; the parameter set is the one fitted at that depth.
_CASES = (
    ("sine_20_250", 0.0),
    ("sine_300_31.02", 75.0),
    ("diharm_10_50_125", 0.0),
    ("diharm_50_250_44.46", 75.0),
    ("noise_5_100_50", 0.0),
    ("noise_25_250_20", 75.0),
)
# Samples of 0.5 ms to solve; 501 are a complete stimulus.
_SAMPLES = {"quick": 501, "paper": 101}
_QUICK_RUN_SAMPLES = 21
SHOWN = "diharm_10_50_125"
_DRAWN_STEP = 2
_DRAWN = 201  # samples: 100 ms


@dataclass(frozen=True, slots=True, eq=False)
class TransientComparison:
    """One stimulus on one finger: a row of the error table, its cost, and traces of both."""

    row: dict[str, Any]
    cost: Cost
    traces: tuple[Sequence[StressTrace], Sequence[StressTrace]]


def study(runs: Runs) -> Finding:
    """Errors and costs of the map against transients."""
    comparisons: list[TransientComparison] = []
    maps: dict[str, tuple[Cost, float]] = {}
    for finger in ("quick",) if runs.quick else ("quick", "paper"):
        model = model_of(PRESETS[finger])
        response, attempt = _solve_map(runs, f"{finger}/response", model)
        maps[finger] = attempt.cost, _interpolation_s(response)
        samples = _QUICK_RUN_SAMPLES if runs.quick else _SAMPLES[finger]
        for stimulus in [_shortened(*case, samples) for case in _CASES]:
            runs.log(f"map: solving {stimulus.id} on {finger}")
            comparisons.append(_compare(runs, model, response, stimulus))
    return finding_of(comparisons, maps)


def finding_of(
    comparisons: Sequence[TransientComparison], maps: Mapping[str, tuple[Cost, float]]
) -> Finding:
    """Finding of all comparisons; `maps` has solver cost and Python time in s by finger."""
    errors = DataFrame([comparison.row for comparison in comparisons])
    worst_trace = float(errors.filter(like="_stress").to_numpy().max())
    worst_drive = float(errors.filter(like="_drive").to_numpy().max())
    equal = int(errors.equal.sum())
    either = equal + int(errors.different.sum())
    share = 100 * equal / either if either else math.nan
    costs = _costs(comparisons, maps)
    fewer, less_cpu = float(costs.ratio.min()), float(costs.cpu_ratio.min())
    return Finding(
        checks=(
            BoundCheck("stress, largest error", worst_trace, TRACE_PERCENT, "%"),
            BoundCheck("drive, largest error", worst_drive, DRIVE_PERCENT, "%"),
            BoundCheck("spikes at the same sample", share, EQUAL_PERCENT, "%", AT_LEAST),
            BoundCheck(
                "82 stimuli: increments, transients / map", fewer, FEWER_INCREMENTS, side=AT_LEAST
            ),
            BoundCheck(
                "82 stimuli: processor time, transients / map", less_cpu, LESS_CPU, side=AT_LEAST
            ),
        ),
        tables={"map": errors.drop(columns="equal"), "map_cost": costs},
        numbers={"equal": equal},
        figure=_figure(comparisons),
    )


def _costs(
    comparisons: Sequence[TransientComparison], maps: Mapping[str, tuple[Cost, float]]
) -> DataFrame:
    """Cost of 82 stimuli by map and by transient, at the mean cost of the solved increments."""
    increments = sum(make_stimulus(entry).displacement_um.size - 1 for entry in CATALOGUE)
    rows = []
    for finger, (solver, python_s) in maps.items():
        costs = (
            comparison.cost
            for comparison in comparisons
            if comparison.row["finger"] == f"`{finger}`"
        )
        sampled = sum(costs, start=Cost())
        increment_cpu_s = sampled.cpu_s / sampled.increments
        map_cpu_s = solver.cpu_s + python_s
        rows.append(
            {
                "finger": f"`{finger}`",
                "map_increments": solver.increments,
                "transient_increments": increments,
                "ratio": increments / solver.increments,
                "map_cpu_s": map_cpu_s,
                "cpu_s_an_increment": increment_cpu_s,
                "transients_cpu_s": increment_cpu_s * increments,
                "cpu_ratio": increment_cpu_s * increments / map_cpu_s,
            }
        )
    return DataFrame(rows)


def _figure(comparisons: Sequence[TransientComparison]) -> Figure:
    """Stress over time of one stimulus, from the map and from the transient."""
    shown = next(
        comparison for comparison in comparisons if comparison.row["stimulus"] == f"`{SHOWN}`"
    )
    figure, all_panels = panels(len(shown.traces[0]))
    for panel, mapped, solved in zip(all_panels, *shown.traces, strict=True):
        times_ms = (mapped.times_ms - mapped.times_ms[0])[:_DRAWN]
        mapped_kpa, solved_kpa = mapped.stress_pa[:_DRAWN] / 1000, solved.stress_pa[:_DRAWN] / 1000
        panel.plot(times_ms, mapped_kpa, label="map", **line(0, mark="line"))
        every_second = slice(None, None, _DRAWN_STEP)
        panel.plot(
            times_ms[every_second],
            solved_kpa[every_second],
            label="transient",
            **line(1, mark="dots"),
        )
        y = "von Mises stress (kPa)" if panel is all_panels[0] else ""
        finish(panel, "time (ms)", y, title=str(mapped.afferent))
    return figure


def _solve_map(runs: Runs, name: str, model: Model) -> tuple[ResponseMap, RunAttempt]:
    stimulus = indentation()
    model = replace(model, support="prescribed")  # as in `solve_response`
    attempt = runs.attempt(f"map/{name}", model, stimulus).accepted()
    response = measured_response(attempt.run, stimulus)
    return response, attempt


def _shortened(stimulus_id: str, preindent_um: float, samples: int) -> Stimulus:
    """First `samples` of a stimulus, at most all of them."""
    [entry] = resolve(stimulus_id)
    stimulus = make_stimulus(entry, preindent_um=preindent_um)
    if samples >= stimulus.displacement_um.size:
        return stimulus
    return replace(
        stimulus,
        displacement_um=stimulus.displacement_um[:samples],
        window_ms=(0.0, (samples - 1) * stimulus.dt_ms),
    )


def _compare(
    runs: Runs, model: Model, response: ResponseMap, stimulus: Stimulus
) -> TransientComparison:
    """Comparison with the first converging contact of the ladder; each has its own map."""
    for number, contact in enumerate(LADDER):
        model_tried = replace(model, contact=contact)
        name = f"{model.finger.name}/{stimulus.id}_{number}"
        if number:
            response, _ = _solve_map(runs, f"{name}_response", model_tried)
        attempt = runs.attempt(f"map/{name}", model_tried, stimulus)
        if attempt.failure is None:
            return _comparison(model_tried, response, stimulus, attempt)
        if attempt.failure.cause not in CONTACT_CAUSES:
            break
        runs.log(f"map: trying the next contact model, {contact} failed: {attempt.failure}")
    raise ResponseError(f"{stimulus.id}: no contact model converged")


def _comparison(
    model: Model, response: ResponseMap, stimulus: Stimulus, attempt: RunAttempt
) -> TransientComparison:
    by_map, by_transient = response.traces(stimulus), read(attempt.run)
    # The parameter set fitted at this pre-indentation.
    parameters = parameter_set("fitted" if stimulus.preindent_um else "published").parameters
    trace_percent, drive_percent = {}, {}
    spikes = equal = extra = 0
    for mapped, solved in zip(by_map, by_transient, strict=True):
        name = str(mapped.afferent)
        trace_percent[f"{name}_stress"] = largest_difference_percent(
            mapped.stress_pa, solved.stress_pa
        )
        drives, trains = [], []
        for trace in (mapped, solved):
            filters = model_named(parameters[name].drive, name)
            drives.append(filters.filtered(trace.stress_pa, trace.dt_ms, "backward"))
            trains.append(encode_cells(trace.stress_pa, trace.dt_ms, parameters[name])[0])
        drive_percent[f"{name}_drive"] = max(map(largest_difference_percent, *drives))
        for map_ms, transient_ms in zip(*trains, strict=True):
            matching = int(np.isin(transient_ms, map_ms).sum())
            spikes += transient_ms.size
            equal += matching
            extra += map_ms.size - matching
    row = {
        "finger": f"`{model.finger.name}`",
        "stimulus": f"`{stimulus.id}`",
        "held_um": stimulus.preindent_um,
        "solved_ms": (stimulus.displacement_um.size - 1) * stimulus.dt_ms,
        **trace_percent,
        **drive_percent,
        "spikes": spikes,
        "equal": equal,
        "different": spikes - equal + extra,
        "iterations": attempt.cost.iterations,
        "cpu_s": attempt.cost.cpu_s,
        "contact": str(model.contact),
    }
    return TransientComparison(row, attempt.cost, (by_map, by_transient))


def _interpolation_s(response: ResponseMap) -> float:
    """Processor time to interpolate the stress of all 82 stimuli."""
    begin_s = time.process_time()
    for entry in CATALOGUE:
        response.traces(make_stimulus(entry))
    return time.process_time() - begin_s
