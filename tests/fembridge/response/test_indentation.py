"""The indentation that a map is made of: steps, and where it comes back to."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fembridge.errors import StimulusError
from fembridge.response.acceptance import DEFAULT_DEPTH_UM, STEPS, depth_for, indentation

depths = st.floats(1.0, 2000.0)


@given(depth_um=depths)
def test_it_goes_down_in_thirty_steps_and_up_over_depths_it_loaded_to(depth_um):
    depth = indentation(depth_um).displacement_um
    loading, unloading = depth[: STEPS + 1], depth[STEPS + 1 :]

    assert depth[0] == 0.0
    assert (np.diff(loading) > 0).all()
    assert loading[-1] == round(depth_um, 3) == depth.max()
    assert (np.diff(depth[STEPS:]) < 0).all()
    compared = np.intersect1d(loading, unloading)
    assert compared.size >= STEPS // 3 - 1
    assert (compared >= 0.05 * depth_um).sum() >= 7


@given(depth_um=depths)
def test_steps_grow_with_depth(depth_um):
    steps_um = np.diff(indentation(depth_um).displacement_um[: STEPS + 1])
    assert (np.diff(steps_um) > -0.002).all()  # depths are rounded to 1 nm


@given(depth_um=st.floats(401.0, 2000.0))
def test_deeper_than_the_default_it_comes_back_in_small_steps(depth_um):
    way_back_um = -np.diff(indentation(depth_um).displacement_um[STEPS:])
    assert way_back_um.max() <= 12.002


@pytest.mark.parametrize("depth_um", [0.0, 0.99, -5.0, 10_001.0, np.nan, np.inf])
def test_a_depth_that_makes_no_map_is_refused(depth_um):
    with pytest.raises(StimulusError, match=r"depth_um is .*, expected 1 to 10000"):
        indentation(depth_um)


@given(needed_um=st.floats(-100.0, 9900.0))
def test_the_indentation_reaches_what_is_needed_and_not_much_more(needed_um):
    depth_um = depth_for(needed_um)
    assert depth_um >= max(needed_um, DEFAULT_DEPTH_UM)
    assert depth_um - max(needed_um, DEFAULT_DEPTH_UM) <= 100.0


def test_all_shallow_stimuli_share_one_indentation():
    assert {depth_for(needed_um) for needed_um in (0.0, 250.0, 400.0)} == {400.0}
