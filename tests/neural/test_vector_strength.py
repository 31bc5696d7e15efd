"""Phase locking of spikes whose phases are known."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fembridge.errors import ParameterError
from neural.threshold import vector_strength


@given(
    phase_ms=st.floats(0.0, 50.0),
    frequency_hz=st.sampled_from([20.0, 50.0, 100.0, 300.0]),
    cycles=st.lists(st.integers(0, 1000), min_size=1, max_size=50),
)
def test_spikes_at_one_phase_have_strength_one(phase_ms, frequency_hz, cycles):
    """Cycles may be left out: it is the phase that counts, not the rate."""
    times_ms = phase_ms + np.array(cycles) * 1000.0 / frequency_hz

    strength = vector_strength(times_ms, frequency_hz)

    assert 1.0 - 1e-9 < strength <= 1.0


@given(st.integers(2, 40), st.floats(0.0, 20.0))
def test_spikes_spread_evenly_over_a_cycle_have_strength_zero(spikes, phase_ms):
    times_ms = phase_ms + 20.0 * np.arange(spikes) / spikes

    assert vector_strength(times_ms, 50.0) < 1e-12


@given(st.floats(0.01, 1.0))
def test_two_phases_have_the_cosine_of_half_their_distance(distance_cycles):
    """|1 + exp(iφ)| / 2 = |cos(φ/2)|."""
    times_ms = 4.0 + np.array([0.0, distance_cycles]) * 20.0

    assert vector_strength(times_ms, 50.0) == pytest.approx(
        abs(math.cos(math.pi * distance_cycles)), abs=1e-12
    )


def test_spikes_jittered_by_a_normal_have_the_strength_of_its_transform():
    """exp(−(2πfs)²/2) for a standard deviation s; here 100 Hz and 1 ms."""
    rng = np.random.default_rng(3)
    times_ms = 10.0 * np.arange(40_000) + rng.normal(0.0, 1.0, 40_000)

    expected = math.exp(-((2 * math.pi * 0.1) ** 2) / 2)
    assert vector_strength(times_ms, 100.0) == pytest.approx(expected, abs=0.01)


def test_spikes_at_random_phases_have_about_the_strength_the_docstring_says():
    """The mean square of a random walk of n steps of 1/n is 1/n, its median 0.69/n."""
    rng = np.random.default_rng(8)

    strengths = [vector_strength(rng.uniform(0, 20, 25), 50.0) for _ in range(4000)]

    assert np.mean(np.square(strengths)) == pytest.approx(1 / 25, rel=0.1)
    assert np.mean(strengths) == pytest.approx(math.sqrt(math.pi / 4 / 25), rel=0.05)


def test_no_spike_has_no_phase():
    assert math.isnan(vector_strength([], 50.0))
    assert vector_strength([3.0], 50.0) == pytest.approx(1.0, rel=1e-14)


def test_a_spike_time_that_is_not_finite_is_refused():
    with pytest.raises(ParameterError, match="spike_times_ms is nan at spike 1"):
        vector_strength([1.0, math.nan], 50.0)


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
def test_a_frequency_that_is_none_is_refused(bad):
    with pytest.raises(ParameterError, match="frequency_hz must be finite and > 0"):
        vector_strength([1.0], bad)
