"""The probe pressed in: mesh, way, and when a run is not to be trusted."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from decks.calculix import calculix_deck
from decks.presets import PAPER, QUICK
from decks.probe import Probe
from fembridge.deflection.press import (
    DEPTH_MM,
    PROBE,
    STEPS,
    Press,
    both_sides,
    digest,
    press_of,
    surface_of,
    why_not,
)
from fembridge.errors import UsageError

PRESSES = {finger.name: press_of(finger) for finger in (QUICK, PAPER)}


@pytest.fixture(params=PRESSES)
def press(request):
    return PRESSES[request.param]


def test_the_probe_and_its_depth_are_those_of_the_paper():
    assert (PROBE.shape, PROBE.diameter_mm, DEPTH_MM) == ("cylinder", 0.05, 1.0)


def test_a_tenth_of_the_probe_is_wider_than_the_elements_under_it(press):
    """Wider ones let the probe slip between their nodes."""
    x_mm = press.mesh.node_mm[surface_of(press.mesh), 0]
    under = np.diff(x_mm[np.abs(x_mm) <= press.probe.diameter_mm])
    assert under.size >= 18
    assert under.max() <= press.probe.diameter_mm / 10


def test_the_surface_runs_from_side_to_side_over_the_origin(press):
    x_mm, y_mm = press.mesh.node_mm[surface_of(press.mesh)].T
    assert (np.diff(x_mm) > 0).all()
    half_mm = press.finger.outline.half_width_mm
    assert_allclose([x_mm[0], x_mm[-1]], [-half_mm, half_mm], rtol=0.01)
    ((row,),) = np.nonzero(x_mm == 0)
    assert y_mm[row] == 0 == y_mm.max()


def test_the_probe_goes_down_only_in_steps_that_grow_to_4_percent_of_the_depth(press):
    depth_um = press.stimulus().displacement_um
    assert (depth_um.size, depth_um[0], depth_um[-1]) == (STEPS + 1, 0.0, 1000.0)
    steps_um = np.diff(depth_um)
    assert (np.diff(steps_um) > 0).all()
    assert 0 < steps_um[0] < 0.05 * 1000 * press.probe.diameter_mm
    assert steps_um[-1] < 43.0


def test_the_deck_presses_a_neo_hookean_skin_and_watches_all_of_its_surface(press):
    analysis = press.analysis()
    assert analysis.law == "neo-hookean"
    assert set(surface_of(press.mesh) + 1) <= set(analysis.watched.tolist())
    assert "*HYPERELASTIC, NEO HOOKE" in calculix_deck(analysis)


def test_a_mesh_is_told_by_its_digest_and_no_other_has_it():
    assert digest(PRESSES["quick"].mesh) == digest(press_of(QUICK).mesh)
    assert digest(PRESSES["quick"].mesh) != digest(PRESSES["paper"].mesh)
    assert PRESSES["quick"].inputs()["mesh_sha256"] == digest(PRESSES["quick"].mesh)


@pytest.mark.parametrize("depth_mm", [0.0, -1.0, 0.04, 2.1, np.nan])
def test_a_depth_that_no_pad_has_is_refused(depth_mm):
    with pytest.raises(UsageError, match=r"expected 0\.05 to 2 mm"):
        Press(QUICK, PRESSES["quick"].mesh, depth_mm=depth_mm)


def test_a_probe_aside_of_the_fine_elements_is_refused():
    aside = Probe(diameter_mm=0.05, x_mm=0.25)
    with pytest.raises(UsageError, match=r"0\.25 mm"):
        Press(QUICK, PRESSES["quick"].mesh, aside)


def test_the_surface_of_the_refined_mesh_is_that_of_the_preset_between_its_nodes():
    from decks.presets import mesh_of

    coarse_mm = mesh_of(QUICK).node_mm[surface_of(mesh_of(QUICK))]
    fine = PRESSES["quick"].mesh
    fine_mm = fine.node_mm[surface_of(fine)]
    on_coarse = np.interp(fine_mm[:, 0], *coarse_mm.T)
    assert_allclose(fine_mm[:, 1], on_coarse, rtol=0, atol=3e-9)
    assert_array_equal(np.isin(coarse_mm[:, 0], fine_mm[:, 0]), True)


FORCE = np.linspace(0.0, 0.035, 41) ** 1.1


def test_a_run_in_which_force_grows_and_the_skin_follows_is_accepted():
    assert why_not(1.0, 0.999, FORCE) is None


@pytest.mark.parametrize(
    ("apex_mm", "force", "words"),
    [
        (0.999, np.zeros(41), "the probe did not push: the force at 1 mm is 0 N/mm"),
        (0.999, -FORCE, "the probe did not push"),
        (0.999, np.where(np.arange(41) == 7, np.nan, FORCE), "the probe did not push"),
        (0.0, FORCE, "slipped between its nodes"),
        (0.94, FORCE, "moved 0.94 mm, expected 0.95 to 1.01 mm"),
        (1.03, FORCE, "slipped between its nodes"),
        (np.nan, FORCE, "slipped between its nodes"),
        (0.999, np.where(np.arange(41) == 30, 0.0, FORCE), "the force fell by"),
    ],
    ids=[
        "no force",
        "pulled",
        "no number",
        "skin at rest",
        "skin lags",
        "skin ahead",
        "skin nowhere",
        "contact lost for one increment",
    ],
)
def test_a_run_in_which_the_probe_did_not_push_is_refused(apex_mm, force, words):
    assert words in why_not(1.0, apex_mm, force)


@given(
    x_mm=st.lists(st.floats(0.01, 8), min_size=2, max_size=30, unique=True),
    slope=st.floats(-0.01, 0.01),
)
def test_folding_gives_the_even_part_and_tells_the_odd_part(x_mm, slope):
    """Of ``cos(x/8) + slope x`` the mean of both sides is the cosine alone."""
    right_mm = np.sort(x_mm)
    all_mm = np.concatenate([-right_mm[::-1], [0.0], right_mm])
    down_mm = np.cos(all_mm / 8) + slope * all_mm
    distance_mm, mean_mm, unlike_mm = both_sides(all_mm, down_mm)
    assert_allclose(distance_mm, [0.0, *right_mm])
    assert_allclose(mean_mm, np.cos(distance_mm / 8), atol=1e-12)
    assert_allclose(unlike_mm, 2 * abs(slope) * right_mm[-1], rtol=1e-9, atol=1e-12)
