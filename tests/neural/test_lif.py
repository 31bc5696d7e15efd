"""The integrate-and-fire kernel against what can be worked out by hand."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from fembridge.errors import ParameterError, TraceError
from neural.lif import integrate, spike_counts, spike_mask, spike_times


def plain_run(current_mv_per_ms, tau_ms, dt_ms, gap_mv, refractory_ms):
    """Equation (7) as a reader would write it; the rows that end in a spike."""
    potential_mv, quiet_rows, rows = 0.0, 0, []
    for row, fed in enumerate(current_mv_per_ms):
        if quiet_rows > 0:
            quiet_rows -= 1
            fed = 0.0
        potential_mv = potential_mv * (1.0 - dt_ms / tau_ms) + dt_ms * fed
        if potential_mv > gap_mv:
            rows.append(row)
            potential_mv = 0.0
            quiet_rows = round(refractory_ms / dt_ms)
    return rows


@given(tau_ms=st.floats(5, 700), current=st.floats(0.1, 15))
def test_constant_current_fires_with_the_period_of_the_recurrence(tau_ms, current):
    """Under forward Euler sample k is Iτ(1 − (1 − dt/τ)^k), exactly."""
    steady_mv, dt_ms, gap_mv = current * tau_ms, 0.5, 10.0
    assume(steady_mv > 1.05 * gap_mv)
    period = math.log1p(-gap_mv / steady_mv) / math.log1p(-dt_ms / tau_ms)
    assume(abs(period - round(period)) > 1e-6)  # a tie is for rounding to break

    spikes = spike_counts(np.full((500, 1), current), tau_ms=tau_ms, dt_ms=dt_ms, gap_mv=gap_mv)

    assert spikes[0] == 500 // math.ceil(period)


def test_a_refractory_period_lengthens_every_interval_but_the_first():
    """τ = 20 ms, I' = 1.5 mV/ms: v_k = 30 (1 − 0.975^k) exceeds 10 at k = 17.

    ln(2/3) / ln(0.975) = 16.02. Two rows of pause make the period 19 rows.
    """
    times_ms = spike_times(np.full(100, 1.5), 20.0, 0.5, 10.0, refractory_ms=1.0)

    np.testing.assert_array_equal(times_ms, 0.5 * np.array([17, 36, 55, 74, 93]))


def test_without_leak_worth_naming_charge_alone_sets_the_count():
    """10.5 mV/ms x 0.5 ms = 5.25 mV a row: the second row exceeds 10 mV."""
    fired = spike_mask(np.full(8, 10.5), 1e12, 0.5, 10.0)

    assert fired.tolist() == [False, True] * 4


def test_a_potential_at_the_threshold_is_not_above_it():
    """dt = τ forgets all but the last row, so v = dt I' = 10 mV exactly."""
    at, above = 20.0, np.nextafter(20.0, 21.0)

    assert spike_counts(np.full(6, at), 0.5, 0.5, 10.0) == 0
    assert spike_counts(np.full(6, above), 0.5, 0.5, 10.0) == 6
    assert not spike_mask(np.full(6, at), 0.5, 0.5, 10.0).any()
    assert spike_mask(np.full(6, above), 0.5, 0.5, 10.0).all()


def test_current_in_the_refractory_period_leaves_no_charge():
    current = np.zeros(50)
    current[0] = 21.0  # fires at once: 10.5 mV
    current[1:3] = 1e6  # two rows of pause
    current[3] = 19.0  # 9.5 mV: not enough by itself

    assert spike_mask(current, 1e9, 0.5, 10.0, refractory_ms=1.0).sum() == 1
    assert spike_mask(current, 1e9, 0.5, 10.0, refractory_ms=0.5).sum() == 2


def test_the_potential_decays_by_its_factor_between_inputs():
    current = np.zeros(6)
    current[0] = 4.0

    potential_mv, fired = integrate(current, 10.0, 0.5, 15.0)

    np.testing.assert_allclose(potential_mv, 2.0 * 0.95 ** np.arange(6), rtol=1e-14)
    assert not fired.any()


def test_a_spike_stands_one_step_after_the_current_that_caused_it():
    current = np.zeros(10)
    current[4] = 100.0

    assert spike_times(current, 30.0, 0.5, 15.0, start_ms=0.0).tolist() == [2.5]
    assert spike_times(current, 30.0, 0.5, 15.0, start_ms=7.0).tolist() == [9.5]


@given(
    seed=st.integers(0, 2**32 - 1),
    rows=st.integers(1, 400),
    shape=st.tuples(st.integers(1, 3), st.integers(1, 4)),
    scale=st.sampled_from([0.5, 3.0, 30.0, 200.0]),
    dt_ms=st.sampled_from([0.25, 0.5, 1.0]),
    pause_rows=st.integers(0, 4),
)
def test_the_kernel_counts_what_a_plain_loop_counts(seed, rows, shape, scale, dt_ms, pause_rows):
    rng = np.random.default_rng(seed)
    current = rng.uniform(-0.2, 1.0, (rows, *shape)) * scale
    tau_ms = rng.uniform(dt_ms, 80.0, shape[0])
    refractory_ms = pause_rows * dt_ms
    edges = np.sort(rng.integers(0, rows + 1, (2, shape[1])), axis=0)

    counts = spike_counts(current, tau_ms, dt_ms, 10.0, refractory_ms, window=(edges[0], edges[1]))

    for candidate, condition in np.ndindex(shape):
        run = current[:, candidate, condition]
        expected = plain_run(run, tau_ms[candidate], dt_ms, 10.0, refractory_ms)
        fired = spike_mask(run, tau_ms[candidate], dt_ms, 10.0, refractory_ms)
        first, end = edges[:, condition]
        assert np.flatnonzero(fired).tolist() == expected
        assert counts[candidate, condition] == sum(first <= k < end for k in expected)


def test_blocks_do_not_show_in_the_counts(monkeypatch):
    current = np.random.default_rng(5).uniform(0, 40, (60, 7, 3))
    whole = spike_counts(current, 20.0, 0.5, 10.0, 0.5)

    monkeypatch.setattr("neural.tally.BLOCK", 6)

    np.testing.assert_array_equal(spike_counts(current, 20.0, 0.5, 10.0, 0.5), whole)
    assert whole.sum() > 100


def test_counts_above_a_byte_are_kept():
    counts = spike_counts(np.full((1000, 2), 50.0), 1e6, 0.5, 10.0)

    assert counts.tolist() == [1000, 1000]


def test_counts_have_the_shape_of_the_current_without_time():
    assert spike_counts(np.zeros(5), 20.0, 0.5, 10.0).shape == ()
    assert spike_counts(np.zeros((5, 2)), 20.0, 0.5, 10.0).shape == (2,)
    assert spike_counts(np.zeros((5, 3, 2)), 20.0, 0.5, 10.0).shape == (3, 2)


def test_a_slice_counts_its_rows_alone():
    current = np.full((100, 2), 25.0)  # a spike every row

    assert spike_counts(current, 1e6, 0.5, 10.0, window=slice(10, 30)).tolist() == [20, 20]
    assert spike_counts(current, 1e6, 0.5, 10.0, window=slice(30, 10)).sum() == 0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"tau_ms": 0.4}, "at least dt_ms"),
        ({"tau_ms": math.nan}, "tau_ms must be > 0, got nan"),
        ({"tau_ms": np.ones(3)}, "expected a number"),
        ({"dt_ms": 0.0}, "dt_ms must be > 0"),
        ({"gap_mv": -1.0}, "gap_mv must be > 0"),
        ({"refractory_ms": -0.5}, "refractory_ms must be >= 0"),
        ({"window": slice(0, 9, 2)}, "step"),
        ({"window": ([0, 0], [5, 11])}, "condition 1: window from row 0 to 11"),
        ({"window": ([0, 0, 0], [5, 5, 5])}, "expected 2"),
        ({"window": ([0.5, 0], [5, 5])}, "whole row numbers"),
    ],
)
def test_a_number_outside_its_meaning_is_refused(change, words):
    arguments = {"tau_ms": 20.0, "dt_ms": 0.5, "gap_mv": 10.0, **change}

    with pytest.raises(ParameterError, match=words):
        spike_counts(np.zeros((10, 2)), **arguments)


@pytest.mark.parametrize("bad", [math.nan, -math.inf])
def test_a_current_that_is_not_finite_is_refused(bad):
    current = np.zeros((10, 2))
    current[3, 1] = bad

    with pytest.raises(TraceError, match="not finite"):
        spike_counts(current, 20.0, 0.5, 10.0)
    with pytest.raises(TraceError, match="not finite"):
        integrate(current, 20.0, 0.5, 10.0)


def test_a_current_of_another_shape_is_refused():
    with pytest.raises(TraceError, match="expected"):
        spike_counts(np.zeros((2, 2, 2, 2)), 20.0, 0.5, 10.0)
    with pytest.raises(TraceError, match="expected one run"):
        spike_times(np.zeros((5, 2)), 20.0, 0.5, 10.0)
