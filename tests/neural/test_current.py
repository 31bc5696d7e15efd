"""Currents (4) to (6): where they are half, where they end, what they broadcast to."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fembridge.errors import ParameterError
from neural.current import pc_current, ra_current, sa_current, saturation


def test_a_drive_at_the_half_saturation_gives_half_the_current():
    """With Table 2's numbers: 10.23 / 2 for RA, 4.14 / 2 for PC, 1.79 for SA."""
    ra = ra_current([17191.87], a3_pa_per_ms=17191.87, alpha_mv_per_ms=10.23)
    pc = pc_current([16.34], a4_pa_per_ms2=16.34, alpha_mv_per_ms=4.14)
    sa = sa_current(
        [1926.32],
        [9850.98],
        a1_pa=1926.32,
        a2_pa_per_ms=9850.98,
        alpha_mv_per_ms=1.79,
    )

    assert (ra.tolist(), pc.tolist(), sa.tolist()) == ([5.115], [2.07], [1.79])


def test_three_times_the_half_saturation_gives_three_quarters():
    assert saturation([3.0], 1.0).tolist() == [0.75]


def test_the_two_drives_of_sa_add():
    current = sa_current(
        [4.0, 0.0, 4.0],
        [0.0, 1.0, 1.0],
        a1_pa=4.0,
        a2_pa_per_ms=3.0,
        alpha_mv_per_ms=2.0,
    )

    np.testing.assert_allclose(current, [1.0, 0.5, 1.5], rtol=1e-15)


@given(drive=st.floats(0, 1e12), half=st.floats(1e-3, 1e6))
def test_a_current_rises_from_nothing_to_its_greatest(drive, half):
    less, more = saturation([drive, 2 * drive + 1], half)

    assert 0.0 <= less <= more <= 1.0
    assert saturation([0.0], half) == 0.0


def test_candidates_take_the_second_axis():
    drive = np.random.default_rng(1).uniform(0, 10, (6, 3))
    half, alpha = np.array([1.0, 5.0]), np.array([2.0, 3.0])

    current = ra_current(drive, a3_pa_per_ms=half, alpha_mv_per_ms=alpha)

    assert current.shape == (6, 2, 3)
    for row in range(2):
        alone = ra_current(drive, a3_pa_per_ms=half[row], alpha_mv_per_ms=alpha[row])
        np.testing.assert_array_equal(current[:, row], alone)
    one_trace = ra_current(drive[:, 0], a3_pa_per_ms=half, alpha_mv_per_ms=alpha)
    np.testing.assert_array_equal(one_trace, current[:, :, 0])


def test_candidates_may_differ_in_alpha_alone():
    current = sa_current(
        np.ones((4, 3)),
        np.ones((4, 3)),
        a1_pa=1.0,
        a2_pa_per_ms=1.0,
        alpha_mv_per_ms=[1.0, 2.0],
    )

    assert current.shape == (4, 2, 3)
    assert current[0, :, 0].tolist() == [1.0, 2.0]


@pytest.mark.parametrize("half", [0.0, -1.0, np.nan, np.inf, [[1.0]]])
def test_a_half_saturation_must_be_positive(half):
    with pytest.raises(ParameterError, match="half-saturation"):
        saturation([1.0], half)


def test_unequal_numbers_of_candidates_are_refused():
    with pytest.raises(ParameterError, match="2 half-saturations for 3 alphas"):
        pc_current([1.0], a4_pa_per_ms2=[1.0, 2.0], alpha_mv_per_ms=[1.0, 2.0, 3.0])
