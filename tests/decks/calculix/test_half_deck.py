"""The deck of half a section: what is in it, and that its stress is the whole's."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from decks.abaqus import abaqus_deck
from decks.analysis import Contact, Model
from decks.calculix import calculix_deck
from decks.dialects import DIALECTS, DeckOptions
from decks.material import PronyTerm
from decks.presets import QUICK, mesh_of, model_of
from decks.probe import Probe
from decks.stimuli import resolve
from decks.waveform import make_stimulus
from fembridge.build import build_run_folder
from fembridge.results import read
from fembridge.results.printed import read_node_print
from fembridge.run_folder import read_run_folder
from fembridge.solver.ccx import run_ccx
from fembridge.solver.settings import SolverSettings

SKIN = mesh_of(QUICK)
RELAXING = replace(
    QUICK,
    materials={
        **QUICK.materials,
        "dermis": replace(QUICK.materials["dermis"], prony=(PronyTerm(0.4, 0.02),)),
    },
)


def half_of(stimulus, finger=QUICK, **options):
    return Model(finger, SKIN, **options).analysis(stimulus)


@pytest.fixture(scope="module", params=["plain", "quadratic", "relaxing", "smooth", "flat"])
def both(request, parse_deck, short):
    """Give what the parser reads in the deck of a whole, and of its half."""
    analysis = {
        "plain": lambda: half_of(short),
        "quadratic": lambda: half_of(short, element="CPE8R"),
        "relaxing": lambda: half_of(short, RELAXING),
        "smooth": lambda: half_of(short, contact=Contact(friction=0.0)),
        "flat": lambda: half_of(short, probe=Probe("flat", 2.0, 0.2)),
    }[request.param]()
    return [
        parse_deck(calculix_deck(replace(analysis, section=section)))
        for section in ("whole", "half")
    ]


def test_decks_of_other_solvers_are_of_the_whole(short):
    analysis = half_of(short, element="CPE4H")
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
