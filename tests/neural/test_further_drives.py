"""The filters of our own beside plain loops, scalings, and a sine worked by hand."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fembridge.errors import ParameterError, TraceError
from neural.drive import DERIVATIVES, pc_drive, ra_drive
from neural.drive_table import drive_named
from neural.further_drives import LAG_MS, absolute_rate, acceleration_rise, rate_rise, sharp_rise

DT_MS = 0.5
WITH_SCHEME = (absolute_rate, rate_rise, acceleration_rise)


def walk(seed, rows=60, conditions=None):
    shape = rows if conditions is None else (rows, conditions)
    return 1e4 + np.cumsum(np.random.default_rng(seed).normal(0, 300, shape), axis=0)


def plain_sharp_rise(stress, dt_ms):
    lag = round(LAG_MS / dt_ms)
    drive = [0.0] * len(stress)
    for t in range(3 * lag, len(stress)):
        third = stress[t] - 3 * stress[t - lag] + 3 * stress[t - 2 * lag] - stress[t - 3 * lag]
        drive[t] = third ** (1 / 3) if third > 0 else 0.0
    return drive


@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_rate_and_its_rise_are_those_of_a_plain_loop(seed):
    stress = walk(seed)
    rate = [0.0] + [(b - a) / DT_MS for a, b in pairwise(stress)]
    rise = [0.0, 0.0] + [max(rate[t] - rate[t - 1], 0.0) for t in range(2, len(rate))]

    np.testing.assert_array_equal(absolute_rate(stress, DT_MS), np.abs(rate))
    np.testing.assert_array_equal(rate_rise(stress, DT_MS), rise)


@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_rise_of_the_acceleration_is_that_of_a_plain_loop(seed):
    stress = walk(seed)
    rise = np.zeros(len(stress))
    for t in range(3, len(stress)):
        a, b, c, d = stress[t - 3 : t + 1]
        rise[t] = max((d - 3 * c + 3 * b - a) / DT_MS**2, 0.0)

    np.testing.assert_allclose(acceleration_rise(stress, DT_MS), rise, rtol=1e-9, atol=1e-7)


@settings(max_examples=25)
@given(
    seed=st.integers(0, 2**32 - 1),
    dt_ms=st.sampled_from([0.125, 0.25, 0.5, 1.0]),
    rows=st.integers(2, 60),
)
def test_the_sharp_rise_is_that_of_a_plain_loop(seed, dt_ms, rows):
    stress = walk(seed, rows)

    drive = sharp_rise(stress, dt_ms)

    np.testing.assert_allclose(drive, plain_sharp_rise(stress, dt_ms), rtol=1e-6)


@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), scheme=st.sampled_from(DERIVATIVES))
def test_what_rises_and_what_falls_are_together_the_published_filters(seed, scheme):
    stress = walk(seed)

    for one_sided, published in ((rate_rise, ra_drive), (acceleration_rise, pc_drive)):
        rising = one_sided(stress, DT_MS, scheme)
        falling = one_sided(-stress, DT_MS, scheme)
        both = published(stress, DT_MS, scheme)
        np.testing.assert_array_equal(rising + falling, both)
        assert not (rising * falling).any()
        assert rising.any()


@pytest.mark.parametrize("scheme", DERIVATIVES)
def test_the_rate_of_a_ramp_is_its_slope_in_either_direction(scheme):
    for slope in (256.0, -256.0):
        rate = absolute_rate(slope * np.arange(9), DT_MS, scheme)
        np.testing.assert_array_equal(rate[1:-1], 512.0)


@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), power=st.integers(-3, 3))
def test_filters_grow_with_the_stress_and_sharp_with_its_cube_root(seed, power):
    stress = walk(seed)
    scale = 8.0**power

    for drive in WITH_SCHEME:
        np.testing.assert_array_equal(drive(scale * stress, DT_MS), scale * drive(stress, DT_MS))
    np.testing.assert_allclose(
        sharp_rise(scale * stress, DT_MS), 2.0**power * sharp_rise(stress, DT_MS), rtol=1e-14
    )


@pytest.mark.parametrize("frequency_hz", [20.0, 100.0, 250.0, 400.0, 500.0])
def test_sharp_sees_a_sine_by_the_cube_of_its_chord(frequency_hz):
    """Δ of a sine is 2 sin(πfL) times it, a quarter ahead and half the lag behind.

    Three times that is −(2 sin πfL)³ cos(2πf(t − 3L/2)).
    """
    times_ms = DT_MS * np.arange(200)
    cycles = 1e-3 * frequency_hz
    chord = 2 * np.sin(np.pi * cycles * LAG_MS)
    third = -1e4 * chord**3 * np.cos(2 * np.pi * cycles * (times_ms - 1.5 * LAG_MS))

    drive = sharp_rise(1e4 * np.sin(2 * np.pi * cycles * times_ms), DT_MS)

    expected = np.maximum(third, 0.0)
    expected[:6] = 0.0
    np.testing.assert_allclose(drive**3, expected, rtol=1e-9, atol=1e-6)
    assert drive.max() > 0


def test_sharp_is_keenest_at_500_hz():
    times_ms = 0.125 * np.arange(800)

    def peak(frequency_hz):
        return sharp_rise(np.sin(2e-3 * np.pi * frequency_hz * times_ms), 0.125).max()

    peaks = [peak(hz) for hz in (50, 100, 250, 500)]
    assert peaks == sorted(peaks)
    assert peak(500) > peak(600) > peak(800)


def test_a_sample_without_its_past_is_silent_and_the_next_is_not():
    jump = np.zeros(12)
    jump[6] = 8.0
    started = np.zeros(7)
    started[0] = 8.0  # at 6 it would stand with −1 in the difference: no rise

    assert sharp_rise(jump, DT_MS).tolist() == [
        *[0.0] * 6,
        *[2.0, 0.0, 0.0, 0.0],
        *[np.cbrt(24.0), 0.0],
    ]
    assert sharp_rise(-jump, DT_MS)[8] == np.cbrt(24.0)
    assert not sharp_rise(started, DT_MS).any()
    assert sharp_rise(-started, DT_MS)[6] == 2.0


@pytest.mark.parametrize("rows", range(2, 8))
def test_a_trace_may_be_shorter_than_the_stencil(rows):
    drive = sharp_rise(np.arange(rows) ** 3.0, DT_MS)

    assert drive.shape == (rows,)
    assert np.flatnonzero(drive).tolist() == list(range(6, rows))


@pytest.mark.parametrize("drive", [*WITH_SCHEME, sharp_rise])
def test_traces_filtered_together_are_filtered_alone(drive):
    stress = walk(7, conditions=3)

    together = drive(stress, DT_MS)

    assert together.shape == stress.shape
    assert (together >= 0).all()
    for column in range(3):
        np.testing.assert_array_equal(together[:, column], drive(stress[:, column], DT_MS))


@pytest.mark.parametrize("dt_ms", [0.3, 0.4, 2.0, 1e9])
def test_a_step_that_makes_no_lag_is_refused(dt_ms):
    with pytest.raises(ParameterError, match=r"expected a whole part of 1 ms, the lag"):
        sharp_rise(np.zeros(20), dt_ms)


@pytest.mark.parametrize("dt_ms", [0.0, -0.5, math.nan, math.inf])
def test_a_step_that_is_no_step_is_refused(dt_ms):
    with pytest.raises(ParameterError, match="dt_ms must be > 0"):
        sharp_rise(np.zeros(20), dt_ms)


def test_the_differences_look_back_whatever_the_scheme_and_refuse_an_unknown_one():
    stress, row = walk(5), drive_named("sharp", "PC")
    for scheme in ("backward", "central", "forward"):
        [drive] = row.filters(stress, DT_MS, scheme)
        np.testing.assert_array_equal(drive, sharp_rise(stress, DT_MS))
    with pytest.raises(ParameterError, match="derivative 'sideways'"):
        row.filters(stress, DT_MS, "sideways")


def test_a_step_printed_with_six_digits_makes_the_lag():
    stress = walk(8)

    np.testing.assert_array_equal(sharp_rise(stress, 0.500001), sharp_rise(stress, DT_MS))
    assert sharp_rise(stress, 0.333333)[9:].any()


@pytest.mark.parametrize("drive", [*WITH_SCHEME, sharp_rise])
def test_what_is_no_stress_history_is_refused(drive):
    for bad in ([1.0], [1.0, np.nan], np.zeros((3, 2, 2))):
        with pytest.raises(TraceError, match="stress"):
            drive(bad, DT_MS)
