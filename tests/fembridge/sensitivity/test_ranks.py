"""Rank regression against what is known: linear, monotone, independent, constant."""

import math
import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fembridge.errors import UsageError
from fembridge.sensitivity import Output, SweptFingers, rank_regressions
from fembridge.sensitivity.ranks import least_fingers, regressions_in_order
from fembridge.sweep.design import hypercube_shares

RATE = Output("SA", "rate_ips", "all")
STRESS = Output("SA", "peak_stress_pa", "all")


def swept(value, *answers, outputs=None):
    names = tuple(f"skin.part_{k}" for k in range(value.shape[1]))
    outputs = outputs or tuple(Output("SA", "rate_ips", f"sine_{k}") for k in range(len(answers)))
    return SweptFingers(names, value, outputs, np.stack(answers, axis=1))


def orthogonal(parameters, levels=5):
    """Every combination of evenly spaced levels: ranks that do not go together."""
    grid = np.meshgrid(*[np.arange(levels, dtype=float)] * parameters, indexing="ij")
    return np.stack([each.ravel() for each in grid], axis=1)


@given(st.lists(st.floats(-3, 3), min_size=2, max_size=2))
def test_one_strictly_monotone_cause_has_coefficient_1_whatever_its_shape(ends):
    low, high = sorted(ends)
    if high - low < 0.01:
        return
    value = np.stack([np.linspace(low, high, 40), np.random.default_rng(0).permutation(40)], axis=1)
    [up, down] = rank_regressions(
        swept(value, np.exp(value[:, 0]), -(value[:, 0] ** 3)), resamples=50
    )

    np.testing.assert_allclose(up.coefficient, [1, 0], atol=1e-12)
    np.testing.assert_allclose(down.coefficient, [-1, 0], atol=1e-12)
    assert up.r_squared == pytest.approx(1) == down.r_squared
    np.testing.assert_allclose([up.low[0], up.high[0]], 1, atol=1e-12)


def test_an_answer_that_is_its_causes_ranks_has_the_coefficients_of_the_plane():
    """Answers are a permutation of 0…N−1 here, so ranking them changes nothing."""
    value = orthogonal(2, 7)
    answer = 7 * value[:, 0] + value[:, 1]  # each of 0…48 once

    [fit] = rank_regressions(swept(value, answer), resamples=20)

    spread = answer.std()
    expected = np.array([7, 1]) * value[:, 0].std() / spread
    np.testing.assert_allclose(fit.coefficient, expected, rtol=1e-12)
    assert fit.r_squared == pytest.approx((expected**2).sum(), rel=1e-12) == 1
    assert fit.adjusted_r_squared == pytest.approx(1)


@given(seed=st.integers(0, 2**32 - 1))
def test_it_is_least_squares_of_standardised_ranks(seed):
    """A plain loop beside the fast path: ranks with ties shared, then lstsq."""
    rng = np.random.default_rng(seed)
    value = rng.normal(size=(30, 3)).round(1)
    answer = (value @ [1.0, -0.5, 0.0] + rng.normal(size=30)).round(1)

    [fit] = rank_regressions(swept(value, answer), resamples=5)

    def standard(column):
        below = np.array([(column < each).sum() for each in column])
        ties = np.array([(column == each).sum() for each in column])
        ranks = below + (ties + 1) / 2
        return (ranks - ranks.mean()) / ranks.std()

    along = np.stack([standard(column) for column in value.T], axis=1)
    expected, residue, *_ = np.linalg.lstsq(along, standard(answer), rcond=None)
    np.testing.assert_allclose(fit.coefficient, expected, atol=1e-9)
    assert fit.r_squared == pytest.approx(1 - residue[0] / 30, abs=1e-9)


def test_a_cause_of_nothing_is_near_0_and_its_interval_holds_0():
    value = np.array(hypercube_shares(3, 60, 4))
    answer = 5 * value[:, 0] - 2 * value[:, 1]

    [fit] = rank_regressions(swept(value, answer))

    assert abs(fit.coefficient[2]) < 0.1
    assert [fit.is_sure(k) for k in range(3)] == [True, True, False]
    assert (fit.low <= fit.coefficient).all() and (fit.coefficient <= fit.high).all()
    assert fit.r_squared > 0.95


def test_what_is_not_monotone_shows_as_a_small_r_squared():
    value = np.array(hypercube_shares(2, 60, 4))
    [fit] = rank_regressions(swept(value, (value[:, 0] - 0.5) ** 2))

    assert fit.r_squared < 0.15
    assert fit.adjusted_r_squared < 0.1


def test_chance_alone_has_a_large_r_squared_and_an_adjusted_one_near_0():
    rng = np.random.default_rng(1)
    value = np.array(hypercube_shares(14, 50, 1))
    noise = rng.normal(size=(50, 40))
    fits = rank_regressions(swept(value, *noise.T), resamples=5)

    assert np.mean([fit.r_squared for fit in fits]) == pytest.approx(14 / 49, abs=0.05)
    assert np.mean([fit.adjusted_r_squared for fit in fits]) < 0.1


def test_an_answer_that_never_changes_is_told_and_warns_of_nothing():
    value = orthogonal(2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        still, moving = rank_regressions(swept(value, np.full(25, 7.0), value[:, 0]), resamples=50)

    assert not still.varies and moving.varies
    assert not still.coefficient.any() and still.r_squared == 0
    assert np.isfinite([still.low, still.high]).all()


def test_an_answer_that_hardly_ever_changes_gives_numbers_in_every_resample():
    """Most resamples leave out the one finger that fires."""
    value = orthogonal(2)
    answer = np.zeros(25)
    answer[-1] = 1.0

    [fit] = rank_regressions(swept(value, answer), resamples=200)

    assert np.isfinite([*fit.low, *fit.high, *fit.coefficient]).all()


def test_the_same_seed_gives_the_same_intervals_and_another_one_others():
    value = np.array(hypercube_shares(2, 20, 0))
    fingers = swept(value, value[:, 0] + 0.5 * value[:, 1] ** 2)
    one, same, other = (
        rank_regressions(fingers, resamples=100, seed=seed)[0] for seed in (1, 1, 2)
    )

    np.testing.assert_array_equal(one.low, same.low)
    assert (one.low != other.low).any()
    np.testing.assert_array_equal(one.coefficient, other.coefficient)


def test_too_few_fingers_for_the_parameters_are_refused():
    value = np.random.default_rng(0).normal(size=(9, 4))
    assert least_fingers(4) == 10

    with pytest.raises(UsageError, match="9 fingers for 4 parameters, expected 10 or"):
        rank_regressions(swept(value, value[:, 0]))


def test_parameters_that_rise_together_are_refused_by_name():
    value = np.random.default_rng(0).normal(size=(20, 2))
    value = np.column_stack([value, -(value[:, 0] ** 3)])

    with pytest.raises(UsageError, match=r"part_0 and skin\.part_2 rise and fall"):
        rank_regressions(swept(value, value[:, 1]))


def test_order_goes_by_the_mean_rate_and_by_stress_where_rates_are_equal():
    value = orthogonal(3, 3)
    outputs = (RATE, STRESS)
    rate = value[:, 2]
    stress = value[:, 1] + 0.5 * value[:, 0]
    fits = rank_regressions(swept(value, rate, stress, outputs=outputs), resamples=5)

    assert regressions_in_order(fits) == [2, 1, 0]
    assert not math.isnan(fits[0].r_squared)
