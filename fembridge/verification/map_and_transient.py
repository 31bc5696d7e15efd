"""Study: an interpolation in the response map against whole transients.

The map takes one indentation of 39 increments for all 82 stimuli; a transient of one
stimulus takes 500. Six stimuli of the three families are solved in full and compared:
stress, the drive of each afferent, and the spikes, one by one.
"""

import re
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

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
from fembridge.solvers.workplace import LOG_FILE
from fembridge.stimulus import Stimulus
from fembridge.trace import StressTrace
from fembridge.typing import BoolArray, FloatArray
from fembridge.verification.bench import Attempt, Bench
from fembridge.verification.finding import Finding
from fembridge.verification.map_finding import NAME, Compared, MapCost, finding_of
from neural import Parameters, afferent_drives, encode_cells, parameter_set

# Stimulus, depth of the probe before time 0, samples that are followed on `quick`,
# every 0.5 ms (501 are a whole stimulus). Parameters are those that hold for the depth.
# Where the probe leaves the skin, an increment takes several times as long.
_CASES = (
    ("sine_20_250", 0.0, 101),
    ("sine_300_31.02", 75.0, 101),
    ("diharm_10_50_125", 0.0, 41),
    ("diharm_50_250_44.46", 75.0, 101),
    ("noise_5_100_50", 0.0, 41),
    ("noise_25_250_20", 75.0, 101),
)
# On `paper` all are unheld: a ramp to a pre-indentation is 20 increments. One gives
# way to another: unheld it does not converge there with the default contact, and every
# further contact of the ladder takes an indentation of its own.
_PAPER_SAMPLES = 11
_PAPER_INSTEAD = {"sine_300_31.02": "sine_100_85.98"}
# Of a quick run: one stimulus held, so that there are spikes, the others as on `paper`.
_QUICK_RUN_HELD = ("sine_300_31.02", 75.0, 21)
_DT_MS = 0.5
_INCREMENT = re.compile(r"^ increment (\d+) attempt", re.MULTILINE)
_SPRINGS = re.compile(r"Number of contact spring elements=(\d+)")
_STRAY_TIMES = 5.0
# Filters of drives look back by three samples and their differences by three more.
_REACH = 6


def study(bench: Bench) -> Finding:
    """Solve and compare."""
    found: list[Compared] = []
    maps: dict[str, MapCost] = {}
    for finger in ("quick",) if bench.quick else ("quick", "paper"):
        model = model_of(PRESETS[finger])
        response, attempt = _mapped(bench, f"{finger}/response", model)
        maps[finger] = MapCost(attempt.cost, _interpolation_s(response))
        for stimulus in _stimuli(finger, quick=bench.quick):
            bench.tell(f"{NAME}: {stimulus.id} on {finger}")
            found.append(_compare(bench, model, response, stimulus))
    reduced = "`quick` alone, 5 or 10 ms of each, one of them held"
    return finding_of(
        found, maps, spent=bench.spent, reduced=reduced if bench.quick else ""
    )


def _stimuli(finger: str, *, quick: bool) -> list[Stimulus]:
    """Give the beginnings of stimuli that are followed on a finger."""
    if finger == "quick" and not quick:
        return [_shortened(*case) for case in _CASES]
    if quick:
        held = _QUICK_RUN_HELD
        others = [word for word, *_ in _CASES if word != held[0]]
        return [_shortened(*held), *_unheld(others)]
    return _unheld([_PAPER_INSTEAD.get(word, word) for word, *_ in _CASES])


def _unheld(words: Sequence[str]) -> list[Stimulus]:
    return [_shortened(word, 0.0, _PAPER_SAMPLES) for word in words]


def _mapped(bench: Bench, name: str, model: Model) -> tuple[ResponseMap, Attempt]:
    stimulus = indentation()
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


def _compare(
    bench: Bench, model: Model, response: ResponseMap, stimulus: Stimulus
) -> Compared:
    """Follow the ladder of contacts, as `simulate` does: each with its own map."""
    for number, contact in enumerate(LADDER):
        tried = replace(model, contact=contact)
        place = f"{model.finger.name}/{stimulus.id}_{number}"
        if number:
            response, _ = _mapped(bench, f"{place}_response", tried)
        attempt = bench.attempt(
            f"{NAME}/{place}",
            tried.analysis(stimulus),
            stimulus,
            inputs_of(tried, stimulus),
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
    stray = stray_samples(attempt.folder / LOG_FILE, stimulus.displacement_um.size)
    for mapped, solved in zip(by_map, by_transient, strict=True):
        name = str(mapped.afferent)
        trace_percent[name] = _off_percent(mapped.stress_pa, solved.stress_pa, ~stray)
        drive_percent[name] = _drive_percent(
            name, mapped, solved, parameters, ~_after(stray)
        )
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
        stray=int(stray.sum()),
        cost=attempt.cost,
        traces=(by_map, by_transient),
    )


def _parameters(stimulus: Stimulus) -> Parameters:
    """Those that hold for its pre-indentation."""
    return parameter_set("fitted" if stimulus.preindent_um else "published").parameters


def stray_samples(log: Path, samples: int) -> BoolArray:
    """Tell on which samples ``(T,)`` the solver converged to a stray contact.

    That is one with several times as many contact springs as usual in the run: seen
    once, where a node or two touched before and after, with stress half a percent off.
    """
    parts = _INCREMENT.split(log.read_text(encoding="utf-8", errors="replace"))
    counts: dict[int, int] = {}
    for number, part in zip(parts[1::2], parts[2::2], strict=True):
        springs = _SPRINGS.findall(part)  # of an increment's last attempt
        counts[int(number)] = int(springs[-1]) if springs else 0
    by_sample = np.array([counts[number] for number in sorted(counts)])[1 - samples :]
    usual = max(1.0, float(np.median(by_sample)))
    stray: BoolArray = np.concatenate([[False], by_sample > _STRAY_TIMES * usual])
    return stray


def _after(stray: BoolArray) -> BoolArray:
    """Mark the samples as well that a filter still sees a stray one from."""
    reach = np.convolve(stray, np.ones(_REACH + 1), "full")[: stray.size]
    seen: BoolArray = reach > 0
    return seen


def _off_percent(found: FloatArray, expected: FloatArray, kept: BoolArray) -> float:
    """Largest difference in percent of the largest value, of the samples `kept`."""
    off = np.abs(found - expected)[kept].max()
    return 100 * float(off / np.abs(expected[kept]).max())


def _drive_percent(
    name: str,
    mapped: StressTrace,
    solved: StressTrace,
    parameters: Parameters,
    kept: BoolArray,
) -> float:
    drive = parameters[name].drive
    return max(
        _off_percent(one, other, kept)
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
