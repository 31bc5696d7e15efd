"""The stored profiles make physical sense and are of the fingers that we ship."""

import math
from dataclasses import asdict

import numpy as np
import pytest
from numpy.testing import assert_allclose

from decks.finger_file import finger_table
from decks.presets import PAPER, QUICK
from fembridge.deflection import profile
from fembridge.deflection.press import FINGERS, PROBE, press_of, why_not
from fembridge.deflection.profile import (
    PAPER_STEP_MM,
    convergence,
    stored_deflection,
    stored_deflections,
)
from fembridge.errors import ResponseError

STORED = {deflection.name: deflection for deflection in stored_deflections()}


@pytest.fixture(params=STORED)
def deflection(request):
    return STORED[request.param]


def test_three_meshes_or_more_are_stored_from_3000_to_beyond_18000_elements():
    elements = [deflection.elements for deflection in stored_deflections()]
    assert len(elements) >= 3
    assert elements == sorted(elements)
    assert elements[0] < 4000
    assert elements[-1] > 18000


def test_each_is_of_a_finger_that_we_ship_and_of_the_probe_of_the_paper(deflection):
    assert deflection.origin["finger"] == finger_table(FINGERS[deflection.name])
    assert deflection.origin["probe"] == asdict(PROBE)
    assert deflection.depth_mm == 1.0


@pytest.mark.parametrize("finger", [QUICK, PAPER], ids=lambda finger: finger.name)
def test_those_of_the_presets_were_solved_on_the_meshes_that_we_ship(finger):
    found, press = STORED[finger.name], press_of(finger)
    assert found.elements == len(press.mesh.quad)
    for part, made_of in press.inputs().items():
        assert found.origin[part] == made_of, part


def test_the_skin_follows_the_probe_to_a_millimetre_and_the_force_grows(deflection):
    """Figure 2c: "the maximum skin surface deflection was approximately 1 mm"."""
    forces = deflection.loading_n_per_mm
    assert why_not(1.0, float(deflection.at(0.0)), forces) is None
    assert_allclose(deflection.at(0.0), 1.0, atol=0.002)
    assert (np.diff(forces) > 0).all()
    assert deflection.deflection_mm.max() == deflection.deflection_mm[0]


def test_the_deflection_gradually_decreases_with_distance(deflection):
    """As Fig. 2c says, at the interval of the paper and at each node."""
    every_mm = np.arange(0.0, 6.0 + 1e-9, PAPER_STEP_MM)
    steps_mm = -np.diff(deflection.at(every_mm))
    assert (steps_mm > 0).all()
    assert steps_mm.max() < 0.15
    assert (np.diff(deflection.deflection_mm) < 0.0005).all()  # ridges tilt
    assert 0 < deflection.at(6.0) < 0.1


def test_close_to_the_probe_the_skin_hangs_from_it_in_a_dent_of_its_own_size(deflection):
    """Beyond ten of its diameters only a stiff, bent layer carries the skin."""
    dent_mm = deflection.at(0.0) - deflection.at(0.1)
    assert 0.01 < dent_mm < PROBE.diameter_mm
    assert deflection.at(0.1) - deflection.at(0.5) < 0.08


def test_both_sides_of_the_finger_went_down_alike(deflection):
    assert 0 <= deflection.origin["sides_differ_mm"] < 0.001


def test_meshes_agree_within_a_hundredth_of_a_millimetre():
    meshes = stored_deflections()
    every_mm = np.arange(0.0, 6.0 + 1e-9, 0.05)
    finest_mm = meshes[-1].at(every_mm)
    off_mm = [np.abs(mesh.at(every_mm) - finest_mm).max() for mesh in meshes[:-1]]
    assert max(off_mm) < 0.012
    assert off_mm == sorted(off_mm, reverse=True)


def test_between_the_two_finest_meshes_nothing_changes_by_half_a_percent():
    for row in convergence(stored_deflections()):
        assert abs(row.change_percent) < 0.5, row


def test_the_force_converges_with_an_order_that_linear_elements_have():
    force = convergence(stored_deflections())[-1]
    assert 1.0 < force.order < 3.0
    assert_allclose(force.limit, force.values[-1], rtol=0.01)
    assert not math.isnan(force.limit)


def test_a_mesh_that_is_not_stored_is_named_with_those_that_are():
    assert stored_deflection("quick").name == "quick"
    with pytest.raises(ResponseError, match="finger 'mine', only for quick, medium"):
        stored_deflection("mine")


def test_a_folder_without_profiles_is_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr(profile, "FOLDER", tmp_path)
    with pytest.raises(ResponseError, match="no profile is stored there"):
        stored_deflections()
