"""Membranes that do not fall below rest or that adapt, beside a plain loop."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fembridge.errors import TraceError
from neural.candidates import candidate_counts
from neural.coefficients import Coefficients
from neural.lif import integrate

DT_MS, GAP_MV = 0.5, 10.0
seeds = st.integers(0, 2**32 - 1)


def plain_run(
    current_mv_per_ms, tau_ms, *, pause_rows=0, floored=False, jump_mv=0.0, recovery_ms=math.inf
):
    """Potential and spiking rows as a reader of `neural.lif` would write them."""
    potential_mv, raised_mv, quiet_rows = 0.0, 0.0, 0
    course_mv, rows = [], []
    for row, fed in enumerate(current_mv_per_ms):
        potential_mv = potential_mv * (1.0 - DT_MS / tau_ms) + DT_MS * fed
        if quiet_rows > 0:
            quiet_rows -= 1
            potential_mv = 0.0
        if floored and potential_mv < 0.0:
            potential_mv = 0.0
        raised_mv *= 1.0 - DT_MS / recovery_ms
        if potential_mv > GAP_MV + raised_mv:
            rows.append(row)
            raised_mv += jump_mv
            potential_mv, quiet_rows = 0.0, pause_rows
        course_mv.append(potential_mv)
    return course_mv, rows


@settings(max_examples=25)
@given(
    seed=seeds,
    rows=st.integers(1, 150),
    scale=st.sampled_from([3.0, 30.0, 150.0]),
    pause_rows=st.integers(0, 3),
    floored=st.booleans(),
    jump_mv=st.sampled_from([0.0, 0.3, 7.0]),
    recovery_ms=st.sampled_from([0.5, 4.0, 90.0, math.inf]),
)
def test_a_run_is_that_of_a_plain_loop(
    seed, rows, scale, pause_rows, floored, jump_mv, recovery_ms
):
    rng = np.random.default_rng(seed)
    current, tau_ms = scale * rng.uniform(-0.6, 1.0, rows), rng.uniform(DT_MS, 60)
    membrane = {"floored": floored, "jump_mv": jump_mv, "recovery_ms": recovery_ms}

    potential_mv, fired = integrate(current, tau_ms, DT_MS, GAP_MV, DT_MS * pause_rows, **membrane)

    expected_mv, spikes = plain_run(current, tau_ms, pause_rows=pause_rows, **membrane)
    assert np.flatnonzero(fired).tolist() == spikes
    np.testing.assert_allclose(potential_mv, expected_mv, rtol=1e-9, atol=1e-11)


@settings(max_examples=25)
@given(
    seed=seeds,
    candidates=st.integers(1, 4),
    conditions=st.integers(1, 3),
    scale=st.sampled_from([3.0, 30.0]),
    pause_rows=st.integers(0, 3),
    floored=st.booleans(),
    adaptive=st.booleans(),
)
def test_a_batch_counts_what_a_plain_loop_counts(
    seed, candidates, conditions, scale, pause_rows, floored, adaptive
):
    rng = np.random.default_rng(seed)
    drive = rng.uniform(-0.6, 1.0, (90, conditions))
    alpha = scale * rng.uniform(0.5, 2.0, candidates)
    tau_ms = rng.uniform(1, 60, candidates)
    jump_mv = rng.uniform(0, 9, candidates) * adaptive
    recovery_ms = rng.uniform(1, 90, candidates)
    edges = np.sort(rng.integers(0, 91, (2, conditions)), axis=0)

    counts = candidate_counts(
        [drive],
        Coefficients(alpha, weights=(1.0,)),
        tau_ms,
        dt_ms=DT_MS,
        gap_mv=GAP_MV,
        refractory_ms=DT_MS * pause_rows,
        window=(edges[0], edges[1]),
        floored=floored,
        jump_mv=jump_mv,
        recovery_ms=recovery_ms,
    )

    for k, condition in np.ndindex(counts.shape):
        _, spikes = plain_run(
            alpha[k] * drive[:, condition],
            tau_ms[k],
            pause_rows=pause_rows,
            floored=floored,
            jump_mv=jump_mv[k],
            recovery_ms=recovery_ms[k],
        )
        first, end = edges[:, condition]
        assert counts[k, condition] == sum(first <= row < end for row in spikes)


@settings(max_examples=20)
@given(seed=seeds, tau_ms=st.floats(0.5, 100))
def test_a_floored_membrane_is_never_below_rest_nor_below_one_that_is_not(seed, tau_ms):
    """Below its threshold the floored one holds at least as much, at every row."""
    current = np.random.default_rng(seed).normal(0, 8, (120, 4))

    bounded_mv, _ = integrate(current, tau_ms, DT_MS, 1e6, floored=True)
    free_mv, _ = integrate(current, tau_ms, DT_MS, 1e6)

    assert (bounded_mv >= 0.0).all()
    assert (bounded_mv >= free_mv).all()
    assert free_mv.min() < 0.0


@settings(max_examples=20)
@given(seed=seeds, tau_ms=st.floats(0.5, 100))
def test_a_floor_does_nothing_where_no_current_takes_away(seed, tau_ms):
    current = np.random.default_rng(seed).uniform(0, 30, (120, 2))

    with_floor = integrate(current, tau_ms, DT_MS, GAP_MV, 0.5, floored=True)
    without = integrate(current, tau_ms, DT_MS, GAP_MV, 0.5)

    for bounded, free in zip(with_floor, without, strict=True):
        np.testing.assert_array_equal(bounded, free)
    assert without[1].any()


def test_what_is_taken_away_at_rest_is_not_owed():
    """−6 mV, then 7.5 and 7.5: 1.5 and 9 mV with the debt, 7.5 and 15 without."""
    current = np.array([-12.0, 15.0, 15.0])

    owing, late = integrate(current, 1e12, DT_MS, GAP_MV)
    _, early = integrate(current, 1e12, DT_MS, GAP_MV, floored=True)

    np.testing.assert_allclose(owing, [-6.0, 1.5, 9.0], rtol=1e-9)
    assert (late.tolist(), early.tolist()) == ([False] * 3, [False, False, True])


@settings(max_examples=20)
@given(tau_ms=st.floats(5, 500), taken=st.integers(1, 60), given_mv=st.floats(0.5, 20))
def test_after_any_drain_a_floored_membrane_fires_as_from_rest(tau_ms, taken, given_mv):
    """Sample k of a constant current is Iτ(1 − (1 − dt/τ)^k), from the floor on."""
    steady_mv = given_mv * tau_ms
    rows = np.arange(1, 401)
    course_mv = -steady_mv * np.expm1(rows * math.log1p(-DT_MS / tau_ms))
    if np.abs(course_mv - GAP_MV).min() < 1e-9:
        return  # a tie is for rounding to break
    above = np.flatnonzero(course_mv > GAP_MV)
    current = np.concatenate([np.full(taken, -9.0), np.full(400, given_mv)])

    _, fired = integrate(current, tau_ms, DT_MS, GAP_MV, floored=True)

    period = above[0] + 1 if above.size else 401
    expected = taken + period * np.arange(1, 400 // period + 1) - 1
    np.testing.assert_array_equal(np.flatnonzero(fired), expected)


def test_a_floor_does_not_hide_a_current_that_is_none():
    with pytest.raises(TraceError, match="not finite"):
        integrate([0.0, math.nan], 20.0, DT_MS, GAP_MV, floored=True)
    with pytest.raises(TraceError, match="not finite"):
        integrate([0.0, -math.inf], 20.0, DT_MS, GAP_MV, floored=True)


def test_single_precision_does_not_see_a_grazed_threshold_and_double_does():
    """τ = dt forgets all but the last row, so v = dt I', 10 mV and a trillionth."""
    grazing = [np.full((6, 2), 20.0 * (1 + 1e-12))]
    arguments = {"dt_ms": DT_MS, "gap_mv": GAP_MV}

    for coefficients in (
        Coefficients(1.0, weights=(1.0,)),
        Coefficients(40.0 * (1 + 1e-12), halves=(20.0 * (1 + 1e-12),)),
    ):
        single = candidate_counts(grazing, coefficients, DT_MS, **arguments, single=True)
        double = candidate_counts(grazing, coefficients, DT_MS, **arguments)
        assert (single.tolist(), double.tolist()) == ([[0, 0]], [[6, 6]])
