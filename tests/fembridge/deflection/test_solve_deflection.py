"""Deflections solved here: the stored one again, a closed form, and a refusal."""

import math
from dataclasses import replace

import pytest
from numpy.testing import assert_allclose

from decks.material import TABLE_1, Material
from decks.presets import QUICK, mesh_of
from fembridge.deflection.press import Press, press_of, solve_deflection
from fembridge.deflection.profile import (
    PROFILE_FILE,
    read_profile,
    stored_deflection,
    write_profile,
)
from fembridge.errors import ResponseError, SolverError
from fembridge.solver.ccx import SolverSettings

pytestmark = pytest.mark.solver
ONE_THREAD = SolverSettings(threads=1)


def test_the_coarsest_mesh_gives_again_what_is_stored(tmp_path):
    press = press_of(QUICK)
    solved = solve_deflection(tmp_path, press, ONE_THREAD)
    stored = stored_deflection("quick")
    assert solved.origin["deck_sha256"] == stored.origin["deck_sha256"]
    assert_allclose(solved.deflection_mm, stored.deflection_mm, rtol=0, atol=1e-4)
    assert_allclose(solved.loading_n_per_mm, stored.loading_n_per_mm, rtol=0, atol=1e-5)
    written = read_profile(tmp_path / PROFILE_FILE)
    assert_allclose(written.deflection_mm, solved.deflection_mm, rtol=0, atol=0)

    before = (tmp_path / "job.frd").stat().st_mtime_ns
    again = solve_deflection(tmp_path, press, ONE_THREAD)
    assert (tmp_path / "job.frd").stat().st_mtime_ns == before
    assert_allclose(again.deflection_mm, solved.deflection_mm, rtol=0, atol=0)


def test_in_a_finger_of_one_material_the_skin_goes_down_as_under_flamants_line_load(tmp_path):
    """``u(a) − u(b) = 2 P (1 − ν²)/(π E) ln(b/a)`` on a half plane.

    Johnson, Contact Mechanics (1985), section 2.3. From 0.1 to 1 mm away the probe
    is thin, and bone and sides are far; ridges and they leave 4 %.
    """
    soft = Material(0.05, 0.40)
    skin = dict.fromkeys(("stratum_corneum", "epidermis", "dermis", "subcutaneous_tissue"), soft)
    finger = replace(QUICK, materials={**TABLE_1, **skin})
    solved = solve_deflection(tmp_path, press_of(finger, 0.05), ONE_THREAD)
    plane = 2 * (1 - soft.poisson**2) / (math.pi * soft.young_mpa)
    for near_mm, far_mm in ((0.1, 0.2), (0.25, 0.5), (0.5, 1.0)):
        found_mm = float(solved.at(near_mm) - solved.at(far_mm))
        flamant_mm = solved.force_n_per_mm * plane * math.log(far_mm / near_mm)
        assert_allclose(found_mm, flamant_mm, rtol=0.04)


def test_on_the_mesh_as_it_is_stored_the_probe_slips_and_the_run_is_refused(tmp_path):
    """CalculiX ends well there: at 1 mm, with no force and the skin at rest."""
    press = Press(QUICK, mesh_of(QUICK))
    write_profile(tmp_path / PROFILE_FILE, stored_deflection("quick"))  # of before
    with pytest.raises(ResponseError, match="slipped between its nodes"):
        solve_deflection(tmp_path, press, ONE_THREAD)
    assert (tmp_path / "solver.toml").is_file()
    assert not (tmp_path / PROFILE_FILE).exists()


def test_the_linear_law_gives_way_before_a_millimetre(tmp_path):
    """Strongly compressed, it has no stiffness left: decision 0008."""
    press = replace(press_of(QUICK), law="linear")
    with pytest.raises(SolverError, match="did not converge"):
        solve_deflection(tmp_path, press, ONE_THREAD)
    assert (tmp_path / "failed").is_dir()
