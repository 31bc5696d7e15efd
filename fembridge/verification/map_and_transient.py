"""Study: an interpolation in the response map against whole transients.

The map takes one indentation of 39 increments for all 82 stimuli; a transient of one
stimulus takes 500. Six stimuli of the three families are solved in full and compared:
stress, the drive of each afferent, and the spikes, one by one.
"""

import time
from dataclasses import replace

import numpy as np

from decks.presets import PRESETS
from decks.stimuli.catalogue import CATALOGUE, resolve
from decks.stimuli.waveform import make_stimulus
from fembridge.build import Model, inputs_of, model_of
from fembridge.errors import ResponseError
from fembridge.response.indentation import indentation
from fembridge.response.measured import measured_response
from fembridge.response.response_map import ResponseMap
from fembridge.response.solve import CONTACT_CAUSES, LADDER
from fembridge.results import read
from fembridge.stimulus import Stimulus
from fembridge.trace import StressTrace
from fembridge.typing import FloatArray
from fembridge.verification.bench import Attempt, Bench
from fembridge.verification.finding import Finding
from fembridge.verification.map_finding import NAME, Compared, MapCost, finding_of
from neural import Parameters, afferent_drives, encode_cells, parameter_set

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


def study(bench: Bench) -> Finding:
    """Solve and compare."""
    found: list[Compared] = []
    maps: dict[str, MapCost] = {}
    for finger in ("quick",) if bench.quick else ("quick", "paper"):
        model = model_of(PRESETS[finger])
        response, attempt = _mapped(bench, f"{finger}/response", model)
        maps[finger] = MapCost(attempt.cost, _interpolation_s(response))
        samples = _QUICK_RUN_SAMPLES if bench.quick else _SAMPLES[finger]
        for stimulus in [_shortened(*case, samples) for case in _CASES]:
            bench.tell(f"{NAME}: {stimulus.id} on {finger}")
            found.append(_compare(bench, model, response, stimulus))
    reduced = "`quick` alone, 10 ms of each stimulus" if bench.quick else ""
    return finding_of(found, maps, spent=bench.spent, reduced=reduced)


def _mapped(bench: Bench, name: str, model: Model) -> tuple[ResponseMap, Attempt]:
    stimulus = indentation()
    model = replace(model, support="prescribed")  # as `solve_response` has it
    attempt = bench.solve(
        f"{NAME}/{name}", model.analysis(stimulus), stimulus, inputs_of(model, stimulus)
    )
    return measured_response(attempt.folder), attempt


def _shortened(word: str, held_um: float, count: int) -> Stimulus:
    """Give the first `count` samples of a stimulus, or all of them."""
    [entry] = resolve(word)
    whole = make_stimulus(entry, preindent_um=held_um)
    if count >= whole.displacement_um.size:
        return whole
    return replace(
        whole,
        displacement_um=whole.displacement_um[:count],
        window_ms=(0.0, (count - 1) * whole.dt_ms),
    )


def _compare(bench: Bench, model: Model, response: ResponseMap, stimulus: Stimulus) -> Compared:
    """Follow the ladder of contacts, as `simulate` does: each with its own map."""
    for number, contact in enumerate(LADDER):
        tried = replace(model, contact=contact)
        place = f"{model.finger.name}/{stimulus.id}_{number}"
        if number:
            response, _ = _mapped(bench, f"{place}_response", tried)
        attempt = bench.attempt(
            f"{NAME}/{place}", tried.analysis(stimulus), stimulus, inputs_of(tried, stimulus)
        )
        if attempt.failure is None:
            return _compared(tried, response, stimulus, attempt)
        if attempt.failure.cause not in CONTACT_CAUSES:
            break
        bench.tell(f"{NAME}: left {contact}: {attempt.failure}")
    raise ResponseError(f"{stimulus.id}: no contact model converged")


def _compared(
    model: Model, response: ResponseMap, stimulus: Stimulus, attempt: Attempt
) -> Compared:
    by_map, by_transient = response.traces(stimulus), read(attempt.folder)
    parameters = _parameters(stimulus)
    trace_percent, drive_percent = {}, {}
    spikes = equal = more = 0
    for mapped, solved in zip(by_map, by_transient, strict=True):
        name = str(mapped.afferent)
        trace_percent[name] = _off_percent(mapped.stress_pa, solved.stress_pa)
        drive_percent[name] = _drive_percent(name, mapped, solved, parameters)
        for one, other in zip(
            encode_cells(mapped.stress_pa, mapped.dt_ms, parameters[name])[0],
            encode_cells(solved.stress_pa, solved.dt_ms, parameters[name])[0],
            strict=True,
        ):
            spikes += other.size
            equal += np.isin(other, one).sum()
            more += one.size - np.isin(one, other).sum()
    return Compared(
        finger=model.finger.name,
        stimulus=stimulus,
        contact=str(model.contact),
        trace_percent=trace_percent,
        drive_percent=drive_percent,
        spikes=int(spikes),
        equal=int(equal),
        more=int(more),
        cost=attempt.cost,
        traces=(by_map, by_transient),
    )


def _parameters(stimulus: Stimulus) -> Parameters:
    """Those that hold for its pre-indentation."""
    return parameter_set("fitted" if stimulus.preindent_um else "published").parameters


def _off_percent(found: FloatArray, expected: FloatArray) -> float:
    """Largest difference in percent of the largest value."""
    return 100 * float(np.abs(found - expected).max() / np.abs(expected).max())


def _drive_percent(
    name: str, mapped: StressTrace, solved: StressTrace, parameters: Parameters
) -> float:
    drive = parameters[name].drive
    return max(
        _off_percent(one, other)
        for one, other in zip(
            afferent_drives(name, mapped.stress_pa, mapped.dt_ms, drive=drive),
            afferent_drives(name, solved.stress_pa, solved.dt_ms, drive=drive),
            strict=True,
        )
    )


def _interpolation_s(response: ResponseMap) -> float:
    """Processor time of the stress of all 82 stimuli by the map."""
    begin_s = time.process_time()
    for entry in CATALOGUE:
        response.traces(make_stimulus(entry))
    return time.process_time() - begin_s
