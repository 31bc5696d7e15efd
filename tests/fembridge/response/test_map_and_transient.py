"""The response map against whole transients: the claim the default method rests on."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from decks.presets import PRESETS, model_of
from decks.stimuli import resolve
from decks.waveform import make_stimulus
from fembridge.build import build_run_folder
from fembridge.response.indentation import solve_response
from fembridge.response.response_map import FOLDER, read_map, stored_response
from fembridge.results import read
from fembridge.run_folder import read_run_folder, read_waveform
from fembridge.solver.ccx import run_ccx
from fembridge.stimulus import Stimulus
from neural import PUBLISHED, encode

FIXTURES = Path(__file__).parents[3] / "fixtures"

# DESIGN of the test: a map's trace lies within this share of its own peak.
TRACE_SHARE = 0.002


def assert_same_neurons(by_map, by_transient):
    """Stress within 0.2 % of its peak, and the very same spikes."""
    assert [t.afferent for t in by_map] == [t.afferent for t in by_transient]
    for mapped, solved in zip(by_map, by_transient, strict=True):
        assert mapped.node == solved.node
        peak_pa = solved.stress_pa.max()
        off_pa = np.abs(mapped.stress_pa - solved.stress_pa).max()
        assert off_pa <= TRACE_SHARE * peak_pa, (mapped.afferent, off_pa / peak_pa)
        spikes = [
            encode(trace.stress_pa, trace.dt_ms, PUBLISHED[trace.afferent])[0]
            for trace in (mapped, solved)
        ]
        np.testing.assert_array_equal(*spikes)


@pytest.mark.parametrize("name", ["transient_sine", "transient_sine_ascii"])
def test_the_stored_map_answers_a_recorded_transient_as_the_solver_did(name):
    folder = FIXTURES / name
    times_ms, displacement_um = read_waveform(folder)
    stimulus = Stimulus(name, displacement_um, 0.5, (0.0, float(times_ms[-1])))
    response = read_map(FOLDER / "quick.toml")

    assert_same_neurons(response.traces(stimulus), read(folder))


def test_the_recorded_transient_makes_every_class_fire():
    """Else the comparison of spikes above would compare nothing."""
    for trace in read(FIXTURES / "transient_sine"):
        spikes = encode(trace.stress_pa, trace.dt_ms, PUBLISHED[trace.afferent])[0]
        assert spikes.size >= 1, trace.afferent


@pytest.mark.slow
@pytest.mark.solver
def test_map_and_transient_agree_on_noise_solved_here(tmp_path):
    """The first 20 ms of a noise; of a sine ``test_chain`` shows it."""
    whole = make_stimulus(*resolve("noise_25_250_20"), preindent_um=60.0)
    stimulus = dataclasses.replace(
        whole, displacement_um=whole.displacement_um[:41], window_ms=(0.0, 20.0)
    )
    model = model_of(PRESETS["quick"])
    _, solved = solve_response(tmp_path / "response", model)
    folder = tmp_path / "transient"
    build_run_folder(folder, model, stimulus)
    run_ccx(read_run_folder(folder))

    assert_same_neurons(solved.traces(stimulus), read(folder))
    stored = stored_response(model.finger, model.probe, model.element)
    np.testing.assert_allclose(solved.tensor_pa, stored.tensor_pa, rtol=1e-6, atol=1e-3)
    assert read_run_folder(folder).start_ms > 0
