"""The patch test: elements under a linear displacement carry the stress of a closed form."""

import pytest

from fembridge.report.verify import verify


@pytest.mark.solver
def test_elements_of_any_shape_carry_the_stress_of_hooke_and_of_neo_hooke(tmp_path):
    found = verify(tmp_path, ["patch"], quick=True)["patch"].to_frame()
    assert len(found)
    assert found["passed"].all()
