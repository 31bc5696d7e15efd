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
from neural.timing import van_rossum_distance, vector_strength, victor_purpura_distance

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


def cheapest_pairing(times_a_ms, times_b_ms, cost_per_ms):
    """Every way to move some spikes of a onto spikes of b, none onto two."""
    if not times_a_ms or not times_b_ms:
        return float(len(times_a_ms) + len(times_b_ms))
    first, *rest = times_a_ms
    costs = [1.0 + cheapest_pairing(rest, times_b_ms, cost_per_ms)]
    for row, time_ms in enumerate(times_b_ms):
        others = times_b_ms[:row] + times_b_ms[row + 1 :]
        moved = cost_per_ms * abs(first - time_ms)
        costs.append(moved + cheapest_pairing(rest, others, cost_per_ms))
    return min(costs)


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


@given(
    st.lists(st.integers(0, 40).map(float), max_size=5),
    st.lists(st.integers(0, 40).map(float), max_size=5),
    positive,
)
def test_victor_purpura_is_the_cheapest_of_all_ways(a, b, cost_per_ms):
    """Also of those in which spikes overtake each other."""
    assert victor_purpura_distance(a, b, cost_per_ms) == pytest.approx(
        cheapest_pairing(a, b, cost_per_ms), rel=1e-12, abs=1e-12
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
def test_a_distance_does_not_depend_on_which_train_comes_first(distance, a, b, scale):
    assert distance(a, b, scale) == pytest.approx(distance(b, a, scale), rel=1e-12)


@either
@few
@given(trains, trains, positive)
def test_a_distance_is_zero_for_equal_trains_and_only_for_them(distance, a, b, scale):
    assert distance(a, list(reversed(a)), scale) == 0.0
    assert (distance(a, b, scale) == 0.0) == (sorted(a) == sorted(b))
    assert distance(a, b, scale) >= 0.0


@either
@few
@given(trains, trains, trains, positive)
def test_a_detour_is_never_shorter(distance, a, b, c, scale):
    direct = distance(a, c, scale)

    detour = distance(a, b, scale) + distance(b, c, scale)

    assert direct <= detour + 1e-9


@either
@few
@given(trains, trains, positive, st.integers(-400, 400).map(lambda step: 0.25 * step))
def test_a_distance_does_not_ask_when_the_clock_was_started(distance, a, b, scale, later_ms):
    """Shifts of quarters of a millisecond are exact, so the intervals are the same."""
    moved = distance(np.add(a, later_ms), np.add(b, later_ms), scale)

    assert moved == distance(a, b, scale)


@few
@given(trains, trains, positive, positive)
def test_time_and_its_scale_stretch_together(a, b, scale, stretch):
    longer_a, longer_b = np.multiply(a, stretch), np.multiply(b, stretch)

    assert victor_purpura_distance(longer_a, longer_b, scale / stretch) == pytest.approx(
        victor_purpura_distance(a, b, scale), rel=1e-9, abs=1e-9
    )
    assert van_rossum_distance(longer_a, longer_b, scale * stretch) == pytest.approx(
        van_rossum_distance(a, b, scale), rel=1e-9, abs=1e-9
    )


@few
@given(trains, trains, positive)
def test_a_dearer_shift_never_brings_trains_together(a, b, cost_per_ms):
    cheap = victor_purpura_distance(a, b, cost_per_ms)

    assert victor_purpura_distance(a, b, 1.5 * cost_per_ms) >= cheap - 1e-12
    assert abs(len(a) - len(b)) - 1e-12 <= cheap <= len(a) + len(b)


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
@pytest.mark.parametrize(
    ("train", "words"),
    [
        ([1.0, math.nan], "times_b_ms is nan at spike 1"),
        ([math.inf], "times_b_ms is inf at spike 0"),
        ([[1.0, 2.0]], r"times_b_ms of shape \(1, 2\), expected \(spike,\)"),
        (3.0, r"times_b_ms of shape \(\)"),
    ],
)
def test_what_is_no_train_is_refused(distance, train, words):
    with pytest.raises(ParameterError, match=words):
        distance([1.0], train, 3.0)
    with pytest.raises(ParameterError, match=words.replace("_b_", "_a_")):
        distance(train, [1.0], 3.0)


@pytest.mark.parametrize("bad", [-1.0, math.nan, math.inf])
def test_a_scale_outside_its_meaning_is_refused(bad):
    with pytest.raises(ParameterError, match="tau_ms must be finite and > 0"):
        van_rossum_distance([1.0], [2.0], bad)
    with pytest.raises(ParameterError, match="tau_ms must be finite and > 0, got 0"):
        van_rossum_distance([1.0], [2.0], 0.0)
    with pytest.raises(ParameterError, match="cost_per_ms must be finite and >= 0"):
        victor_purpura_distance([1.0], [2.0], bad)


def test_the_examples_of_the_docstrings_are_true():
    outcome = doctest.testmod(neural.timing)

    assert outcome.attempted > 0
    assert outcome.failed == 0


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
