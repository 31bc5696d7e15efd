"""Currents (4) to (6): where they are half, where they end, what they broadcast to."""

from dataclasses import asdict

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fembridge.errors import ParameterError
from neural.coefficients import saturation
from neural.drive_table import drive_named
from neural.parameters import PUBLISHED


def current(afferent, filtered, **values):
    return drive_named("published", afferent).coefficients(values).current(filtered)


def test_a_drive_at_the_half_saturation_gives_half_the_current():
    """With Table 2's numbers: 10.23 / 2 for RA, 4.14 / 2 for PC, 1.79 for SA."""
    at_half = {
        "RA": [np.array([17191.87])],
        "PC": [np.array([16.34])],
        "SA": [np.array([1926.32]), np.array([9850.98])],
    }
    found = {
        name: current(name, filtered, **asdict(PUBLISHED[name])).tolist()
        for name, filtered in at_half.items()
    }

    assert found == {"RA": [5.115], "PC": [2.07], "SA": [1.79]}


def test_three_times_the_half_saturation_gives_three_quarters():
    assert saturation([3.0], 1.0).tolist() == [0.75]


def test_the_two_drives_of_sa_add():
    level, rate = np.array([4.0, 0.0, 4.0]), np.array([0.0, 1.0, 1.0])

    found = current("SA", [level, rate], a1_pa=4.0, a2_pa_per_ms=3.0, alpha_mv_per_ms=2.0)

    np.testing.assert_allclose(found, [1.0, 0.5, 1.5], rtol=1e-15)


@given(drive=st.floats(0, 1e12), half=st.floats(1e-3, 1e6))
def test_a_current_rises_from_nothing_to_its_greatest(drive, half):
    less, more = saturation([drive, 2 * drive + 1], half)

    assert 0.0 <= less <= more <= 1.0
    assert saturation([0.0], half) == 0.0


def test_halves_take_the_second_axis():
    drive = np.random.default_rng(1).uniform(0, 10, (6, 3))
    halves = np.array([1.0, 5.0])

    share = saturation(drive, halves)

    assert share.shape == (6, 2, 3)
    for row in range(2):
        np.testing.assert_array_equal(share[:, row], saturation(drive, halves[row]))


@pytest.mark.parametrize("half", [0.0, -1.0, np.nan, np.inf, [[1.0]]])
def test_a_half_saturation_must_be_positive(half):
    with pytest.raises(ParameterError, match="half-saturation"):
        saturation([1.0], half)
