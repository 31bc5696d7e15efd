"""Spike train distances against their first definitions, limits and axioms."""

import doctest
import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import neural.timing
from fembridge.errors import ParameterError
from neural.timing import van_rossum_distance, victor_purpura_distance

# Times on a grid of 0.5 ms, as the membrane's are: trains share spikes.
trains = st.lists(st.integers(0, 200).map(lambda step: 0.5 * step), max_size=9)
positive = st.floats(-2.0, 2.0).map(lambda exponent: 10.0**exponent)
few = settings(max_examples=40)  # drawing them is what takes the time
either = pytest.mark.parametrize("distance", [van_rossum_distance, victor_purpura_distance])


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


def first_van_rossum(times_a_ms, times_b_ms, tau_ms):
    """The integral of van Rossum (2001) by the midpoint rule, 2000 cells a τ.

    Spikes stand on edges of cells, so each cell is smooth.
    """
    step_ms = tau_ms / 2000.0
    end_ms = max([0.0, *times_a_ms, *times_b_ms]) + 30.0 * tau_ms
    middle_ms = (np.arange(round(end_ms / step_ms)) + 0.5) * step_ms

    def tails(times_ms):
        trace = np.zeros_like(middle_ms)
        for time_ms in times_ms:
            after = middle_ms > time_ms
            trace[after] += np.exp(-(middle_ms[after] - time_ms) / tau_ms)
        return trace

    difference = tails(times_a_ms) - tails(times_b_ms)
    return math.sqrt(np.sum(difference**2) * step_ms / tau_ms)


def paired_van_rossum(times_a_ms, times_b_ms, tau_ms):
    """The same integral multiplied out: exp(−|t − s| / τ) / 2 for each two spikes."""

    def overlap(one_ms, other_ms):
        return sum(math.exp(-abs(t - s) / tau_ms) for t in one_ms for s in other_ms)

    a, b = times_a_ms, times_b_ms
    return (overlap(a, a) + overlap(b, b) - 2.0 * overlap(a, b)) / 2.0


def spikes_without_twin(times_a_ms, times_b_ms):
    everywhere = set(times_a_ms) | set(times_b_ms)
    return [times_a_ms.count(t) - times_b_ms.count(t) for t in sorted(everywhere)]


@few
@given(trains, trains, positive)
def test_victor_purpura_is_its_recursion(a, b, cost_per_ms):
    assert victor_purpura_distance(a, b, cost_per_ms) == pytest.approx(
        first_victor_purpura(a, b, cost_per_ms), rel=1e-12, abs=1e-12
    )


@pytest.mark.parametrize("tau_ms", [1.0, 5.0, 40.0])
@pytest.mark.parametrize("seed", range(4))
def test_van_rossum_is_its_integral(seed, tau_ms):
    rng = np.random.default_rng(seed)
    a, b = (0.5 * rng.integers(0, 160, size) for size in rng.integers(0, 12, 2))

    # The midpoint rule is off by (step/τ)²/6, 4e-8 of each exponential.
    assert van_rossum_distance(a, b, tau_ms) == pytest.approx(
        first_van_rossum(a, b, tau_ms), rel=1e-6
    )


@few
@given(trains, trains, positive)
def test_van_rossum_is_its_integral_multiplied_out(a, b, tau_ms):
    """Squared, since the sum over pairs cancels where the trains are near."""
    assert van_rossum_distance(a, b, tau_ms) ** 2 == pytest.approx(
        paired_van_rossum(a, b, tau_ms), rel=1e-9, abs=1e-10
    )


@given(positive)
def test_one_spike_against_none_is_a_half(scale):
    assert van_rossum_distance([7.5], [], scale) ** 2 == pytest.approx(0.5, rel=1e-14)
    assert victor_purpura_distance([7.5], [], scale) == 1.0


@given(st.floats(1e-6, 100.0), positive)
def test_a_moved_spike_costs_by_how_far_it_moved(moved_ms, scale):
    a, b = [0.0], [moved_ms]

    assert van_rossum_distance(a, b, scale) == pytest.approx(
        math.sqrt(-math.expm1(-moved_ms / scale)), rel=1e-12
    )
    assert victor_purpura_distance(a, b, scale) == pytest.approx(
        min(2.0, scale * moved_ms), rel=1e-12
    )


@few
@given(trains, trains)
def test_the_coarsest_distances_compare_the_numbers_of_spikes(a, b):
    more = abs(len(a) - len(b))

    assert victor_purpura_distance(a, b, 0.0) == more
    assert van_rossum_distance(a, b, 1e14) == pytest.approx(
        more * math.sqrt(0.5), rel=1e-9, abs=1e-4
    )


@few
@given(trains, trains)
def test_the_finest_distances_count_the_spikes_without_a_twin(a, b):
    """In van Rossum's, spikes of one train at one time add up before the square."""
    alone = spikes_without_twin(a, b)

    assert victor_purpura_distance(a, b, 1e9) == sum(map(abs, alone))
    assert victor_purpura_distance(a, b, 1e308) == sum(map(abs, alone))
    for tau_ms in (1e-3, 5e-324):
        assert van_rossum_distance(a, b, tau_ms) == pytest.approx(
            math.sqrt(sum(count**2 for count in alone) / 2.0), rel=1e-12
        )


@either
@few
@given(trains, trains, positive)
def test_a_distance_is_zero_for_equal_trains_and_only_for_them(distance, a, b, scale):
    assert distance(a, list(reversed(a)), scale) == 0.0
    assert distance(a, b, scale) == pytest.approx(distance(b, a, scale), rel=1e-12)
    assert (distance(a, b, scale) == 0.0) == (sorted(a) == sorted(b))
    assert distance(a, b, scale) >= 0.0


@either
@few
@given(trains, trains, trains, positive)
def test_a_detour_is_never_shorter(distance, a, b, c, scale):
    direct = distance(a, c, scale)

    detour = distance(a, b, scale) + distance(b, c, scale)

    assert direct <= detour + 1e-9


def test_near_trains_keep_their_digits():
    """δ = 2⁻⁴⁰ ms: 1 − exp(−δ/τ) is δ/τ, which a sum over pairs would round away."""
    moved_ms = 2.0**-40

    squared = van_rossum_distance([1.0], [1.0 + moved_ms], 10.0) ** 2

    assert squared == pytest.approx(moved_ms / 10.0, rel=1e-9, abs=0.0)


def test_long_trains_are_what_their_definitions_say():
    """A second of PC, locked to 300 Hz, and the same 0.4 ms late: 300 q δ.

    Every spike is nearer to its own than to any other.
    """
    a = 1000.0 / 300.0 * np.arange(300)

    assert victor_purpura_distance(a, a + 0.4, 0.5) == pytest.approx(60.0, rel=1e-9)
    assert van_rossum_distance(a, a + 0.4, 2.0) ** 2 == pytest.approx(
        paired_van_rossum(a.tolist(), (a + 0.4).tolist(), 2.0), rel=1e-9
    )


@either
def test_a_train_without_spikes_is_a_train(distance):
    assert distance([], [], 3.0) == 0.0
    assert distance(np.array([]), [1.0], 3.0) == distance([1.0], (), 3.0) > 0.0


@either
@pytest.mark.parametrize("train", [[1.0, math.nan], [math.inf], [[1.0, 2.0]], 3.0])
def test_what_is_no_train_is_refused(distance, train):
    for trains_ in (([1.0], train), (train, [1.0])):
        with pytest.raises(ParameterError):
            distance(*trains_, 3.0)


@either
@pytest.mark.parametrize("bad", [-1.0, math.nan, math.inf])
def test_a_scale_outside_its_meaning_is_refused(distance, bad):
    with pytest.raises(ParameterError):
        distance([1.0], [2.0], bad)


def test_the_examples_of_the_docstrings_are_true():
    outcome = doctest.testmod(neural.timing)

    assert outcome.attempted > 0
    assert outcome.failed == 0
