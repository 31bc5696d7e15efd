"""Our elements and contact in CalculiX against closed forms: the patch test, and Hertz."""

import pytest

from fembridge.report.verify import verify

pytestmark = pytest.mark.solver


def test_elements_of_any_shape_carry_the_stress_of_hooke_and_of_neo_hooke(tmp_path):
    found = verify(tmp_path, ["patch"], quick=True)["patch"]
    assert all(check.passed for check in found.checks)
    laws = set(found.tables["patch"]["strain"])
    assert {"small, Hooke", "large, linear law", "large, neo-Hookean"} <= laws


def test_a_cylinder_on_a_block_has_the_contact_and_the_stress_of_hertz(tmp_path):
    found = verify(tmp_path, ["hertz"], quick=True)["hertz"]
    assert len(found.checks) == 4
    assert all(check.passed for check in found.checks)
