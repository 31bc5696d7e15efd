"""Inertia in decks of CalculiX: one dynamic step, and the store beside it."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from decks.analysis import Model
from decks.calculix import calculix_deck
from decks.presets import QUICK, mesh_of, model_of
from fembridge.build import build_run_folder
from fembridge.results import read
from fembridge.run_folder import read_run_folder
from fembridge.solver.ccx import run_ccx
from fembridge.solver.settings import SolverSettings
from fembridge.stimulus import Stimulus

SKIN = mesh_of(QUICK)


@pytest.fixture
def held(short):
    held_um = 300.0 + short.displacement_um
    return replace(short, displacement_um=held_um, preindent_um=300.0)


@pytest.fixture
def deck(parse_deck, held):
    return parse_deck(
        calculix_deck(Model(QUICK, SKIN, inertia=True, support="prescribed").analysis(held))
    )


def test_the_store_touches_nothing_and_outweighs_the_skin(deck):
    numbers = [int(row[0]) for row in deck.one("NODE", NSET="STORE")[2]]
    elements = deck.all("ELEMENT")
    for card in elements:
        if card[1]["TYPE"] != "SPRING1":
            assert not any(str(n) in row[1:] for row in card[2] for n in numbers)
    stiffness = float(deck.one("SPRING", ELSET="STORE_SPRING")[2][1][0])
    [(_, _, [[node, _, force]])] = deck.all("CLOAD")
    assert int(node) in numbers
    stored_n_mm = float(force) ** 2 / stiffness / 2
    pressed_n_mm = 0.5 * 0.02 * 0.3  # 0.02 N at 300 um, about linear
    assert stored_n_mm > 1e4 * pressed_n_mm


def test_a_run_folder_tells_samples_and_not_increments(tmp_path, held):
    model = replace(model_of(QUICK), inertia=True)
    run = build_run_folder(tmp_path / "run", model, held)
    assert (run.increments, run.dt_ms, run.before_ms) == (43, 0.5, 0.0)
    assert run.increments_in_all == 86
    assert_allclose([run.start_ms, run.end_ms], [20.0, 21.5])
    assert run.inputs["inertia"] is True
    assert "drive" not in run.inputs


@pytest.mark.slow
@pytest.mark.solver
def test_skin_that_weighs_next_to_nothing_answers_as_without_inertia(tmp_path):
    """On the way in: unloading, so light a skin flutters."""
    depth_um = 40.0 * (1 - np.cos(np.linspace(0, np.pi, 6)))
    wave = Stimulus("in", depth_um, 0.5, (0.0, 2.5))
    light = {layer: replace(one, density_kg_m3=1.0) for layer, one in QUICK.materials.items()}
    whole = replace(model_of(QUICK), support="prescribed")
    light_finger = replace(QUICK, materials=light)
    models = {"static": whole, "dynamic": replace(whole, finger=light_finger, inertia=True)}
    stress_pa = {}
    for name, model in models.items():
        build_run_folder(tmp_path / name, model, wave)
        run_ccx(read_run_folder(tmp_path / name), SolverSettings(threads=1))
        stress_pa[name] = np.array([one.stress_pa for one in read(tmp_path / name)])
    peak_pa = stress_pa["static"].max(axis=1, keepdims=True)
    assert_allclose(stress_pa["dynamic"] / peak_pa, stress_pa["static"] / peak_pa, atol=5e-3)
