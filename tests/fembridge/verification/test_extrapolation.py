"""Limits of series whose limit is known."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from fembridge.verification.extrapolation import extrapolation, power_law_limit

WIDTH = np.array([0.8, 0.4, 0.2, 0.1])


@given(order=st.floats(0.5, 4), factor=st.floats(0.01, 5), limit=st.floats(1, 20))
def test_a_power_law_is_found_and_its_index_is_a_quarter_more_than_the_error(order, factor, limit):
    value = limit + factor * WIDTH**order
    found = extrapolation(WIDTH, value)
    assert found.closes_in
    assert_allclose(found.order, order, rtol=1e-4)
    assert_allclose(found.limit, limit, rtol=1e-6)
    expected = 1.25 * 100 * (value[-1] - limit) / value[-1]
    assert_allclose(found.uncertainty_percent, expected, rtol=1e-3)


def test_a_series_that_scatters_has_no_limit_and_its_spread_for_an_uncertainty():
    found = extrapolation(WIDTH, np.array([9.0, 10.0, 12.0, 11.0]))
    assert not found.closes_in
    assert math.isnan(found.limit)
    assert_allclose(found.uncertainty_percent, 100 * (12 - 10) / 11)


@given(order=st.floats(0.5, 3), factor=st.floats(-5, 5), limit=st.floats(1, 20))
def test_the_fit_gives_the_limit_of_a_power_law_without_an_error(order, factor, limit):
    found, error = power_law_limit(WIDTH, limit + factor * WIDTH**order, order)
    assert_allclose(found, limit, rtol=1e-9)
    assert error < 1e-9


def test_the_error_of_the_fit_covers_the_scatter_of_its_values():
    """Of many series with known scatter two thirds of the limits lie within it."""
    rng = np.random.default_rng(3)
    width = np.linspace(0.1, 1, 12)
    inside = []
    for _ in range(400):
        value = 5 + 2 * width + 0.1 * rng.standard_normal(12)
        found, error = power_law_limit(width, value, 1.0)
        inside.append(abs(found - 5) < error)
    assert 0.58 < np.mean(inside) < 0.74
