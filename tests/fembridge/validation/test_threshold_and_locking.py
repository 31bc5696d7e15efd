"""Thresholds, entrainment and phase, from rates and spikes made by hand."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from fembridge.tables import AFFERENTS, Rate, SpikeTrain
from fembridge.validation.compared_rates import compare_rates
from fembridge.validation.locking_row import locking_rows
from fembridge.validation.study import STIMULI
from fembridge.validation.threshold_row import ThresholdRow, threshold_rows, times_apart

AMPLITUDES_UM = st.one_of(st.floats(1, 300), st.just(math.inf))


def row(threshold_um):
    return ThresholdRow("own", "SA", 20.0, 6.71, 250.0, threshold_um, math.inf, None)


def test_a_threshold_is_read_off_the_curve_of_its_frequency():
    """The rate rises from 0 to 50 ips between 113.6 and 168.52 um, log scale."""
    steps = {"sine_50_113.6": 0.0, "sine_50_168.52": 50.0, "sine_50_250": 50.0}
    rates = [Rate(stimulus, "RA", rate) for stimulus, rate in steps.items()]
    [found] = threshold_rows(compare_rates(STIMULI, {"own": rates}))
    share = 1000 / 245 / 50
    assert_allclose(found.threshold_um, 113.6 ** (1 - share) * 168.52**share)
    assert_allclose(found.entrainment_um, 168.52)
    assert_allclose(found.plateau.high_um, 250.0)
    assert (found.lowest_um, found.highest_um) == (113.6, 250.0)
    assert (found.afferent, found.frequency_hz) == ("RA", 50.0)


def test_a_threshold_tells_whether_it_may_be_lower_or_higher():
    assert row(math.inf).told(math.inf) == "> 250"
    assert row(6.71).told(6.71) == "≤ 6.71"
    assert row(23.0).told(23.0) == "23.0"


@given(one=AMPLITUDES_UM, other=AMPLITUDES_UM)
def test_how_far_apart_two_thresholds_are_does_not_depend_on_their_order(one, other):
    apart = times_apart(row(one), row(other))
    assert apart == times_apart(row(other), row(one))
    assert apart >= 1.0
    assert (apart == math.inf) == (math.isinf(one) != math.isinf(other))


def test_spikes_at_one_phase_are_locked_and_those_outside_the_window_do_not_count():
    """50 Hz is counted from 100 to 200 ms: five cycles."""
    locked = np.array([3.0, 104.0, 124.0, 144.0, 164.0, 184.0, 207.0])
    spread = np.array([110.0, 115.0, 120.0, 125.0])
    trains = [
        SpikeTrain("sine_50_250", "SA", locked),
        SpikeTrain("sine_50_250", "RA", spread),
        SpikeTrain("sine_50_250", "PC", np.empty(0)),
    ]
    rates = [
        Rate("sine_50_250", afferent, rate)
        for afferent, rate in zip(AFFERENTS, (50.0, 40.0, 0.0), strict=True)
    ]
    found = locking_rows(compare_rates(STIMULI, {"own": rates}), {"own": trains})
    assert [one.afferent for one in found] == list(AFFERENTS)
    assert_allclose([one.impulses_per_cycle for one in found], [1.0, 0.8, 0.0])
    assert_allclose(found[0].vector_strength, 1.0)
    assert_allclose(found[1].vector_strength, 0.0, atol=1e-12)
    assert math.isnan(found[2].vector_strength)


def test_the_phase_of_a_population_is_that_of_its_cells_not_of_their_sum():
    """Two cells in opposite phase are each locked; together they would cancel."""
    early, late = np.array([105.0, 125.0]), np.array([115.0, 135.0])
    trains = [
        SpikeTrain("sine_50_250", "SA", early, repeat=1),
        SpikeTrain("sine_50_250", "SA", late, repeat=2),
    ]
    rates = [Rate("sine_50_250", "SA", 20.0)]
    [found] = locking_rows(compare_rates(STIMULI, {"own": rates}), {"own": trains})
    assert_allclose(found.vector_strength, 1.0)
