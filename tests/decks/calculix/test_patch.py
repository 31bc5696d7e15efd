"""The patch test: elements under a linear displacement carry the stress of a closed form."""

import pytest

from fembridge.report.verify import verify


@pytest.mark.solver
def test_elements_of_any_shape_carry_the_stress_of_hooke_and_of_neo_hooke(tmp_path):
    found = verify(tmp_path, ["patch"], quick=True)["patch"]
    assert all(check.passed for check in found.checks)
    laws = set(found.tables["patch"]["strain"])
    assert {"small, Hooke", "large, linear law", "large, neo-Hookean"} <= laws
