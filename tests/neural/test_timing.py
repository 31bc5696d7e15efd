"""Spike train distances against their first definitions, limits and axioms."""

import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from neural.timing import van_rossum_distance, vector_strength, victor_purpura_distance

# Times on a grid of 0.5 ms, as the membrane's are: trains share spikes.
trains = st.lists(st.integers(0, 200).map(lambda step: 0.5 * step), max_size=9)
positive = st.floats(-2.0, 2.0).map(lambda exponent: 10.0**exponent)


def first_victor_purpura(times_a_ms, times_b_ms, cost_per_ms):
    """The recursion of Victor and Purpura (1996), spike by spike."""
    a, b = sorted(times_a_ms), sorted(times_b_ms)

    @cache
    def cost(i, j):
        if i == 0 or j == 0:
            return float(i + j)
        moved = cost(i - 1, j - 1) + cost_per_ms * abs(a[i - 1] - b[j - 1])
        return min(cost(i - 1, j) + 1.0, cost(i, j - 1) + 1.0, moved)

    return cost(len(a), len(b))


def paired_van_rossum(times_a_ms, times_b_ms, tau_ms):
    """The same integral multiplied out: exp(−|t − s| / τ) / 2 for each two spikes."""

    def overlap(one_ms, other_ms):
        return sum(math.exp(-abs(t - s) / tau_ms) for t in one_ms for s in other_ms)

    a, b = times_a_ms, times_b_ms
    return (overlap(a, a) + overlap(b, b) - 2.0 * overlap(a, b)) / 2.0


@given(trains, trains, positive)
def test_victor_purpura_is_its_recursion(a, b, cost_per_ms):
    assert victor_purpura_distance(a, b, cost_per_ms) == pytest.approx(
        first_victor_purpura(a, b, cost_per_ms), rel=1e-12, abs=1e-12
    )


@given(trains, trains, positive)
def test_van_rossum_is_its_integral_multiplied_out(a, b, tau_ms):
    """Squared, since the sum over pairs cancels where the trains are near."""
    assert van_rossum_distance(a, b, tau_ms) ** 2 == pytest.approx(
        paired_van_rossum(a, b, tau_ms), rel=1e-9, abs=1e-10
    )


@given(st.floats(1e-6, 100.0), positive)
def test_a_moved_spike_costs_by_how_far_it_moved(moved_ms, scale):
    a, b = [0.0], [moved_ms]
    assert van_rossum_distance(a, b, scale) == pytest.approx(
        math.sqrt(-math.expm1(-moved_ms / scale)), rel=1e-12
    )
    assert victor_purpura_distance(a, b, scale) == pytest.approx(
        min(2.0, scale * moved_ms), rel=1e-12
    )


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


def test_no_spike_has_no_phase():
    assert math.isnan(vector_strength([], 50.0))
    assert vector_strength([3.0], 50.0) == pytest.approx(1.0, rel=1e-14)
