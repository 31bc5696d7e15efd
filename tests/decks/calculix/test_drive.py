"""The probe on a spring: tied nodes, a driver that the waveform moves, no force."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from decks.analysis import Model
from decks.calculix import calculix_deck
from decks.presets import QUICK, mesh_of, model_of
from decks.stimuli import resolve
from decks.waveform import make_stimulus
from fembridge.build import build_run_folder
from fembridge.results import read
from fembridge.run_folder import read_run_folder
from fembridge.solver.ccx import run_ccx
from fembridge.solver.settings import SolverSettings

SKIN = mesh_of(QUICK)


def deck_of(parse_deck, stimulus, **options):
    analysis = Model(QUICK, SKIN, section="whole", **options).analysis(stimulus)
    return analysis, parse_deck(calculix_deck(analysis))


def tied(deck, axis):
    """Nodes that follow another one along `axis`, by that one."""
    rows = [card[2][1] for card in deck.all("EQUATION")]
    pairs = {}
    for node, dof, one, other, same_dof, minus_one in rows:
        assert (dof, float(one), float(minus_one)) == (same_dof, 1.0, -1.0)
        if int(dof) == axis:
            pairs[int(node)] = int(other)
    return pairs


def test_all_nodes_of_the_probe_go_down_with_the_node_on_the_spring(parse_deck, short):
    model, deck = deck_of(parse_deck, short)
    count = len(model.probe_mesh.node_mm)
    probe = set(range(model.first_probe_node, model.first_probe_node + count))
    pairs = tied(deck, 2)
    assert set(pairs) == probe
    [rigid] = set(pairs.values())
    [(_, _, [spring])] = [card for card in deck.all("ELEMENT") if card[1]["TYPE"] == "SPRING2"]
    _, on_spring, driver = map(int, spring)
    assert on_spring == rigid
    assert {rigid, driver}.isdisjoint(probe)
    assert not tied(deck, 1)


@pytest.mark.slow
@pytest.mark.solver
def test_the_spring_changes_the_iterations_and_not_the_stress(tmp_path):
    """Ten increments of a sine, in and back, both ways; within 0.05 % of the peak."""
    [entry] = resolve(["sine_100_85.98"])
    whole = make_stimulus(entry)
    wave = replace(whole, displacement_um=whole.displacement_um[:11], window_ms=(0.0, 5.0))
    traces, iterations = {}, {}
    for support in ("prescribed", "spring"):
        model = replace(model_of(QUICK), support=support)
        run = build_run_folder(tmp_path / support, model, wave)
        outcome = run_ccx(run, SolverSettings(threads=1))
        traces[support] = np.array([one.stress_pa for one in read(run.folder)])
        iterations[support] = outcome.iterations
        assert read_run_folder(run.folder).inputs.get("drive", "prescribed") == support
    peak_pa = traces["prescribed"].max(axis=1, keepdims=True)
    assert_allclose(traces["spring"] / peak_pa, traces["prescribed"] / peak_pa, rtol=0, atol=5e-4)
    assert iterations["spring"] < iterations["prescribed"]
