"""What makes CalculiX faster, or more, leaves the stress of what is simpler: solved both ways."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from decks.presets import QUICK, model_of
from decks.stimuli import resolve
from decks.synthesis import make_stimulus
from fembridge.io.run_folder import read_run_folder
from fembridge.results import read
from fembridge.results.printed import read_node_print
from fembridge.solver.build import build_run_folder
from fembridge.solver.ccx import run_ccx
from fembridge.solver.settings import Solver
from fembridge.stimulus import Stimulus

pytestmark = [pytest.mark.slow, pytest.mark.solver]
LIGHT = {layer: replace(one, density_kg_m3=1.0) for layer, one in QUICK.materials.items()}


def sine(word, held_um=0.0):
    """Ten increments, in and back."""
    (entry,) = resolve(word)
    whole = make_stimulus(entry, preindent_um=held_um)
    return replace(whole, displacement_um=whole.displacement_um[:11], window_ms=(0.0, 5.0))


def solved(folder, wave, **changes):
    """The run, how it went, and its stress."""
    build_run_folder(folder, replace(model_of(QUICK), **changes), wave)
    run = read_run_folder(folder)
    outcome = run_ccx(run, Solver(threads=1))
    return run, outcome, np.array([one.stress_pa for one in read(folder)])


def assert_same(stress_pa, reference_pa, share):
    """Within a share of each afferent's peak."""
    peak_pa = reference_pa.max(axis=1, keepdims=True)
    assert peak_pa.min() > 100
    assert_allclose(stress_pa / peak_pa, reference_pa / peak_pa, rtol=0, atol=share)


def test_the_spring_changes_the_iterations_and_not_the_stress(tmp_path):
    wave = sine("sine_100_85.98")
    run, outcome, stress_pa = solved(tmp_path / "spring", wave)
    _, plain, reference_pa = solved(tmp_path / "prescribed", wave, support="prescribed")
    assert_same(stress_pa, reference_pa, 5e-4)
    assert outcome.iterations < plain.iterations
    assert run.inputs["drive"] == "spring"


@pytest.mark.parametrize(("word", "held_um"), [("sine_100_85.98", 0.0), ("sine_100_54.98", 75.0)])
def test_half_of_a_section_has_the_stress_and_the_force_of_the_whole(word, held_um, tmp_path):
    wave = sine(word, held_um)
    whole, _, reference_pa = solved(tmp_path / "whole", wave, section="whole")
    half, _, stress_pa = solved(tmp_path / "half", wave, section="half")
    assert (bool(whole.on_axis), bool(half.on_axis)) == (False, True)
    assert_same(stress_pa, reference_pa, 2e-4)
    reference_n, force_n = (
        read_node_print(run.folder / "job.dat", "total force", "PROBE")[2][:, 0, 1]
        for run in (whole, half)
    )
    peak_n = np.abs(reference_n).max()
    assert_allclose(force_n / peak_n, reference_n / peak_n, atol=5e-4)


def test_skin_that_weighs_next_to_nothing_answers_as_without_inertia(tmp_path):
    """On the way in: unloading, so light a skin flutters."""
    depth_um = 40.0 * (1 - np.cos(np.linspace(0, np.pi, 6)))
    wave = Stimulus("in", depth_um, 0.5, (0.0, 2.5))
    light = replace(QUICK, materials=LIGHT)
    _, _, reference_pa = solved(tmp_path / "static", wave, support="prescribed")
    _, _, stress_pa = solved(tmp_path / "dynamic", wave, finger=light, inertia=True)
    assert_same(stress_pa, reference_pa, 5e-3)
