"""The deck of half a section: what is in it, and that its stress is the whole's."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from decks.abaqus import abaqus_deck
from decks.analysis import Model
from decks.dialects import DIALECTS, DeckOptions
from decks.presets import QUICK, mesh_of, model_of
from decks.stimuli import resolve
from decks.waveform import make_stimulus
from fembridge.build import build_run_folder
from fembridge.results import read
from fembridge.results.printed import read_node_print
from fembridge.run_folder import read_run_folder
from fembridge.solver.ccx import run_ccx
from fembridge.solver.settings import SolverSettings


def test_decks_of_other_solvers_are_of_the_whole(short):
    analysis = Model(QUICK, mesh_of(QUICK), element="CPE4H").analysis(short)
    whole = replace(analysis, section="whole")
    assert abaqus_deck(analysis) == abaqus_deck(whole)
    marc, same = (DIALECTS["marc"].write(one, DeckOptions()) for one in (analysis, whole))
    assert marc == same


@pytest.mark.slow
@pytest.mark.solver
@pytest.mark.parametrize(("word", "held_um"), [("sine_100_85.98", 0.0), ("sine_100_54.98", 75.0)])
def test_half_of_a_section_has_the_stress_of_the_whole(word, held_um, tmp_path):
    """Ten increments of a sine, in and back; within 0.02 % of the peak, forces as well."""
    [entry] = resolve([word])
    sine = make_stimulus(entry, preindent_um=held_um)
    wave = replace(sine, displacement_um=sine.displacement_um[:11], window_ms=(0.0, 5.0))
    traces, force_n = {}, {}
    for section in ("whole", "half"):
        model = replace(model_of(QUICK), section=section)
        folder = build_run_folder(tmp_path / section, model, wave).folder
        run_ccx(read_run_folder(folder), SolverSettings(threads=1))
        traces[section] = np.array([one.stress_pa for one in read(folder)])
        _, _, total_n = read_node_print(folder / "job.dat", "total force", "PROBE")
        force_n[section] = total_n[:, 0, 1]
        assert bool(read_run_folder(folder).on_axis) == (section == "half")
    peak_pa = traces["whole"].max(axis=1, keepdims=True)
    assert peak_pa.min() > 100
    assert_allclose(traces["half"] / peak_pa, traces["whole"] / peak_pa, rtol=0, atol=2e-4)
    peak_n = np.abs(force_n["whole"]).max()
    assert_allclose(force_n["half"] / peak_n, force_n["whole"] / peak_n, atol=5e-4)
