"""Filtered stress to current: shares that saturate, shares that do not, cells."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fembridge.errors import ParameterError
from neural.candidates import candidate_counts
from neural.coefficients import Coefficients
from neural.lif import spike_counts

positive = st.floats(1e-3, 1e3)


def two_drives(seed, shape=(50, 3)):
    return list(np.random.default_rng(seed).uniform(0, 100, (2, *shape)))


def test_a_share_at_its_half_is_one_half_and_shares_add():
    drives = [np.array([3.0, 0.0, 3.0]), np.array([0.0, 5.0, 15.0])]

    current = Coefficients(4.0, halves=(3.0, 5.0)).current(drives)

    np.testing.assert_allclose(current, [2.0, 2.0, 2.0 + 3.0], rtol=1e-15)


def test_linear_shares_are_weighted_and_keep_their_sign():
    drives = [np.array([1.0, -2.0]), np.array([10.0, 10.0])]
    coefficients = Coefficients(2.0, weights=(3.0, 0.5))

    assert coefficients.current(drives).tolist() == [6.0 + 10.0, -12.0 + 10.0]
    assert [float(gain) for gain in coefficients.gains()] == [6.0, 1.0]
    assert Coefficients(2.0, weights=(3.0,)).current(drives[:1]).tolist() == [6, -12]


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), alpha=positive, a=positive, b=positive)
def test_a_current_is_the_plain_sum_of_its_shares(seed, alpha, a, b):
    first, second = drives = two_drives(seed, (6, 2))
    saturating = Coefficients(alpha, halves=(a, b)).current(drives)
    linear = Coefficients(alpha, weights=(a, b)).current(drives)

    for place in np.ndindex(first.shape):
        x, y = float(first[place]), float(second[place])
        share = x / (a + x) + y / (b + y)
        np.testing.assert_allclose(saturating[place], alpha * share, rtol=1e-13)
        np.testing.assert_allclose(linear[place], alpha * a * x + alpha * b * y, rtol=1e-13)


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), need=st.floats(0.05, 20), half=positive)
def test_a_cell_of_greater_need_sees_the_stress_divided_by_it(seed, need, half):
    drives = two_drives(seed)
    smaller = [drive / need for drive in drives]

    for median in (Coefficients(7.0, halves=(half, 2.0)), Coefficients(7.0, weights=(half, 2.0))):
        np.testing.assert_allclose(
            median.for_need(need).current(drives), median.current(smaller), rtol=1e-12
        )


@settings(max_examples=20)
@given(need=st.floats(0.05, 20), degree=st.sampled_from([1.0, 0.5, 1 / 3]))
def test_a_filter_that_grows_with_a_power_of_the_stress_shrinks_by_it(need, degree):
    stress = np.linspace(0.0, 1e4, 9)
    median = Coefficients(3.0, weights=(2.0,), degree=degree)

    cell = median.for_need(need).current([stress**degree])

    np.testing.assert_allclose(cell, median.current([(stress / need) ** degree]), rtol=1e-12)


def test_a_need_of_one_changes_nothing():
    drives = two_drives(3)
    for median in (
        Coefficients(1.79, halves=(0.3, 0.7)),
        Coefficients(1.79, weights=(0.3, 0.7), degree=1 / 3),
    ):
        np.testing.assert_array_equal(median.for_need(1.0).current(drives), median.current(drives))


def test_needs_of_candidates_are_taken_one_by_one():
    need = np.array([0.5, 1.0, 4.0])
    halves = Coefficients([1.0, 2.0, 3.0], halves=([8.0, 8.0, 8.0],)).for_need(need)
    weights = Coefficients([1.0, 2.0, 3.0], weights=(5.0,)).for_need(need)

    assert halves.halves is not None
    np.testing.assert_array_equal(halves.halves[0], [4.0, 8.0, 32.0])
    assert halves.alpha_mv_per_ms == [1.0, 2.0, 3.0]
    np.testing.assert_array_equal(weights.alpha_mv_per_ms, [2.0, 2.0, 0.75])
    np.testing.assert_array_equal(weights.gains()[0], [10.0, 10.0, 3.75])


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), drives=st.integers(1, 2), candidates=st.integers(1, 4))
def test_a_batch_of_linear_currents_counts_what_each_of_them_counts(seed, drives, candidates):
    rng = np.random.default_rng(seed)
    filtered = list(rng.uniform(-30, 60, (drives, 80, 3)))
    alpha, tau_ms = rng.uniform(0.1, 2, candidates), rng.uniform(1, 80, candidates)
    weights = rng.uniform(0.1, 2, (drives, candidates))

    counts = candidate_counts(
        filtered,
        Coefficients(alpha, weights=tuple(weights)),
        tau_ms,
        dt_ms=0.5,
        gap_mv=10.0,
        refractory_ms=0.5,
    )

    for k in range(candidates):
        own = Coefficients(alpha[k], weights=tuple(weights[:, k])).current(filtered)
        expected = spike_counts(own, tau_ms[k], 0.5, 10.0, 0.5)
        np.testing.assert_array_equal(counts[k], expected)


def test_a_current_has_halves_or_weights():
    with pytest.raises(ParameterError, match="halves or weights, and not both"):
        Coefficients(1.0)
    with pytest.raises(ParameterError, match="halves or weights, and not both"):
        Coefficients(1.0, halves=(1.0,), weights=(1.0,))


@pytest.mark.parametrize("kind", ["halves", "weights"])
def test_every_filter_has_its_coefficient(kind):
    one = Coefficients(1.0, **{kind: (1.0,)})

    with pytest.raises(ParameterError, match="1 coefficients for 2 drives"):
        one.current([np.zeros(3), np.zeros(3)])


def test_a_half_that_is_none_is_refused():
    with pytest.raises(ParameterError, match="half-saturation"):
        Coefficients(1.0, halves=(0.0,)).current([np.ones(3)])
