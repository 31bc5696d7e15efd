"""Study: an interpolation in the response map against whole transients.

The map takes one indentation of 39 increments for all 82 stimuli; a transient of one
stimulus takes 500. Six stimuli of the three families are solved in full and compared:
stress, the drive of each afferent, and the spikes, one by one.
"""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from pandas import DataFrame

from decks.analysis import Model
from decks.presets import PRESETS, model_of
from decks.stimuli import CATALOGUE, resolve
from decks.waveform import make_stimulus
from fembridge.errors import ResponseError
from fembridge.report.study import (
    AT_LEAST,
    Attempt,
    Check,
    Cost,
    Finding,
    Runs,
    finish,
    line,
    off_percent,
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
SHOWN = "diharm_10_50_125"
_EVERY = 2
_DRAWN = 201  # samples: 100 ms


@dataclass(frozen=True, slots=True, eq=False)
class Compared:
    """One stimulus on one finger: a row of the table of errors, its cost, and both traces."""

    row: dict[str, Any]
    cost: Cost
    traces: tuple[Sequence[StressTrace], Sequence[StressTrace]]


def study(runs: Runs) -> Finding:
    """Solve and compare."""
    found: list[Compared] = []
    maps: dict[str, tuple[Cost, float]] = {}
    for finger in ("quick",) if runs.quick else ("quick", "paper"):
        model = model_of(PRESETS[finger])
        response, attempt = _mapped(runs, f"{finger}/response", model)
        maps[finger] = attempt.cost, _interpolation_s(response)
        samples = _QUICK_RUN_SAMPLES if runs.quick else _SAMPLES[finger]
        for stimulus in [_shortened(*case, samples) for case in _CASES]:
            runs.log(f"map: {stimulus.id} on {finger}")
            found.append(_compare(runs, model, response, stimulus))
    return finding_of(found, maps)


def finding_of(found: Sequence[Compared], maps: Mapping[str, tuple[Cost, float]]) -> Finding:
    """Put the comparisons together; a map is its solver's cost and Python's time in s."""
    errors = DataFrame([each.row for each in found])
    worst_trace = float(errors.filter(like="_stress").to_numpy().max())
    worst_drive = float(errors.filter(like="_drive").to_numpy().max())
    equal = int(errors.equal.sum())
    either = equal + int(errors.different.sum())
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
        tables={"map": errors.drop(columns="equal"), "map_cost": costs},
        numbers={"equal": equal},
        figure=_figure(found),
    )


def _costs(found: Sequence[Compared], maps: Mapping[str, tuple[Cost, float]]) -> DataFrame:
    """What 82 stimuli take by map and by transient, whose increments cost those solved."""
    increments = sum(make_stimulus(entry).displacement_um.size - 1 for entry in CATALOGUE)
    rows = []
    for finger, (solver, python_s) in maps.items():
        mine = (each.cost for each in found if each.row["finger"] == f"`{finger}`")
        sampled = sum(mine, start=Cost())
        an_increment_s = sampled.cpu_s / sampled.increments
        map_cpu_s = solver.cpu_s + python_s
        rows.append(
            {
                "finger": f"`{finger}`",
                "map_increments": solver.increments,
                "transient_increments": increments,
                "ratio": increments / solver.increments,
                "map_cpu_s": map_cpu_s,
                "cpu_s_an_increment": an_increment_s,
                "transients_cpu_s": an_increment_s * increments,
                "cpu_ratio": an_increment_s * increments / map_cpu_s,
            }
        )
    return DataFrame(rows)


def _figure(found: Sequence[Compared]) -> Figure:
    """Stress over time of one stimulus, by the map and by the transient."""
    shown = next(each for each in found if each.row["stimulus"] == f"`{SHOWN}`")
    figure, all_panels = panels(len(shown.traces[0]))
    for panel, mapped, solved in zip(all_panels, *shown.traces, strict=True):
        times_ms = (mapped.times_ms - mapped.times_ms[0])[:_DRAWN]
        mapped_kpa, solved_kpa = mapped.stress_pa[:_DRAWN] / 1000, solved.stress_pa[:_DRAWN] / 1000
        panel.plot(times_ms, mapped_kpa, label="map", **line(0, mark="line"))
        some = slice(None, None, _EVERY)
        panel.plot(times_ms[some], solved_kpa[some], label="transient", **line(1, mark="dots"))
        y = "von Mises stress (kPa)" if panel is all_panels[0] else ""
        finish(panel, "time (ms)", y, title=str(mapped.afferent))
    return figure


def _mapped(runs: Runs, name: str, model: Model) -> tuple[ResponseMap, Attempt]:
    stimulus = indentation()
    model = replace(model, support="prescribed")  # as `solve_response` has it
    attempt = runs.attempt(f"map/{name}", model, stimulus).accepted()
    response = measured_response(attempt.run, stimulus)
    return response, attempt


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
        attempt = runs.attempt(f"map/{place}", tried, stimulus)
        if attempt.failure is None:
            return _compared(tried, response, stimulus, attempt)
        if attempt.failure.cause not in CONTACT_CAUSES:
            break
        runs.log(f"map: left {contact}: {attempt.failure}")
    raise ResponseError(f"{stimulus.id}: no contact model converged")


def _compared(
    model: Model, response: ResponseMap, stimulus: Stimulus, attempt: Attempt
) -> Compared:
    by_map, by_transient = response.traces(stimulus), read(attempt.run)
    # Those that hold for its pre-indentation.
    parameters = parameter_set("fitted" if stimulus.preindent_um else "published").parameters
    trace_percent, drive_percent = {}, {}
    spikes = equal = more = 0
    for mapped, solved in zip(by_map, by_transient, strict=True):
        name = str(mapped.afferent)
        trace_percent[f"{name}_stress"] = off_percent(mapped.stress_pa, solved.stress_pa)
        drives, trains = [], []
        for trace in (mapped, solved):
            filters = model_named(parameters[name].drive, name)
            drives.append(filters.filtered(trace.stress_pa, trace.dt_ms, "backward"))
            trains.append(encode_cells(trace.stress_pa, trace.dt_ms, parameters[name])[0])
        drive_percent[f"{name}_drive"] = max(map(off_percent, *drives))
        for one, other in zip(*trains, strict=True):
            same = int(np.isin(other, one).sum())
            spikes += other.size
            equal += same
            more += one.size - same
    row = {
        "finger": f"`{model.finger.name}`",
        "stimulus": f"`{stimulus.id}`",
        "held_um": stimulus.preindent_um,
        "solved_ms": (stimulus.displacement_um.size - 1) * stimulus.dt_ms,
        **trace_percent,
        **drive_percent,
        "spikes": spikes,
        "equal": equal,
        "different": spikes - equal + more,
        "iterations": attempt.cost.iterations,
        "cpu_s": attempt.cost.cpu_s,
        "contact": str(model.contact),
    }
    return Compared(row, attempt.cost, (by_map, by_transient))


def _interpolation_s(response: ResponseMap) -> float:
    """Processor time of the stress of all 82 stimuli by the map."""
    begin_s = time.process_time()
    for entry in CATALOGUE:
        response.traces(make_stimulus(entry))
    return time.process_time() - begin_s
