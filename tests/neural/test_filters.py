"""The filters on traces whose answer is known, beside plain loops, and on a sine."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from fembridge.errors import ParameterError, TraceError
from neural import filters
from neural.filters import (
    DERIVATIVES,
    FADES,
    SLOW_HZ,
    acceleration_change,
    faded,
    rate_change,
    sa_level,
    sa_rate,
    slow_rate,
    stress_rate,
)

DT_MS = 0.5


def test_a_kink_drives_ra_once_and_pc_twice():
    """Slope 0, then 4 Pa/ms after sample 20: σ′ jumps by 4, σ″ is 4 / 0.5 once."""
    stress_pa = 2.0 * np.clip(np.arange(40) - 20, 0, None)
    ra, pc = rate_change(stress_pa, DT_MS), acceleration_change(stress_pa, DT_MS)
    assert {int(k): ra[k] for k in ra.nonzero()[0]} == {21: 4.0}
    assert {int(k): pc[k] for k in pc.nonzero()[0]} == {21: 8.0, 22: 8.0}


def test_a_waveform_that_starts_at_full_speed_does_not_fire_the_onset():
    """Never more than the sine's own greatest change, ω² dt and ω³ dt."""
    omega = 2e-3 * np.pi * 50
    stress_pa = np.sin(omega * DT_MS * np.arange(100))
    ra, pc = rate_change(stress_pa, DT_MS), acceleration_change(stress_pa, DT_MS)
    assert not ra[:2].any()
    assert not pc[:3].any()
    assert 0.99 * omega**2 * DT_MS < ra.max() <= omega**2 * DT_MS
    assert 0.99 * omega**3 * DT_MS < pc.max() <= omega**3 * DT_MS


def test_a_pre_indented_finger_has_its_level_from_the_first_sample_to_the_last():
    held_pa = np.full(50, 700.0)
    np.testing.assert_allclose(sa_level(held_pa), 700.0, rtol=1e-14)
    assert not sa_rate(held_pa, DT_MS).any()


def test_a_trace_at_rest_at_both_ends_is_padded_with_zeros_in_effect():
    """The literal sum (1), terms outside the trace left out, denominator 19."""
    stress_pa = np.random.default_rng(3).uniform(0, 1e4, 60)
    stress_pa[[0, -1]] = 0.0
    literal = np.convolve(stress_pa, np.ones(19), mode="same") / 19
    np.testing.assert_allclose(sa_level(stress_pa), literal, rtol=1e-12)


def test_filter_2_is_the_literal_sum_of_absolute_rates():
    stress_pa = np.random.default_rng(4).uniform(0, 1e4, 60)
    rate = np.abs(stress_rate(stress_pa, DT_MS))
    literal = [rate[max(t - 8, 0) : t + 10].sum() / 18 for t in range(60)]
    np.testing.assert_allclose(sa_rate(stress_pa, DT_MS), literal, rtol=1e-12)


def test_derivative_schemes_are_the_differences_they_are_named_after():
    stress_pa = np.array([1.0, 2.0, 4.0, 8.0])
    assert stress_rate(stress_pa, 0.5, "backward").tolist() == [0, 2, 4, 8]
    assert stress_rate(stress_pa, 0.5, "forward").tolist() == [2, 4, 8, 0]
    assert stress_rate(stress_pa, 0.5, "central").tolist() == [0, 3, 6, 0]


@pytest.mark.parametrize("scheme", DERIVATIVES)
@given(stress_pa=arrays(np.float64, 40, elements=st.integers(0, 10**6)), later=st.integers(1, 30))
def test_a_later_stimulus_has_the_same_drive_later(scheme, stress_pa, later):
    rest = np.zeros(20)
    early = np.concatenate([rest, stress_pa, np.zeros(50)])
    late = np.concatenate([np.zeros(later), early])[: early.size]

    for drive in (
        sa_level,
        lambda s: sa_rate(s, DT_MS, scheme),
        lambda s: rate_change(s, DT_MS, scheme),
        lambda s: acceleration_change(s, DT_MS, scheme),
    ):
        np.testing.assert_array_equal(drive(late)[later:], drive(early)[:-later])


@given(
    stress_pa=arrays(np.float64, (30, 3), elements=st.integers(0, 10**6)),
    factor=st.sampled_from([0.5, 2.0, 1024.0]),
)
def test_a_drive_goes_with_the_size_of_the_stress_and_not_with_its_neighbours(stress_pa, factor):
    for drive in (
        sa_level,
        lambda s: sa_rate(s, DT_MS),
        lambda s: rate_change(s, DT_MS),
        lambda s: acceleration_change(s, DT_MS),
    ):
        together = drive(stress_pa)
        assert (together >= 0).all()
        np.testing.assert_array_equal(drive(factor * stress_pa), factor * together)
        np.testing.assert_array_equal(drive(-stress_pa), together)
        np.testing.assert_array_equal(drive(stress_pa[:, 1]), together[:, 1])


@pytest.mark.parametrize(
    ("stress_pa", "trace", "error", "named"),
    [
        ([[0.0, 0.0], [0.0, np.nan]], (DT_MS,), TraceError, "nan at sample 1, 1"),
        ([0.0, np.inf, 0.0], (DT_MS,), TraceError, "inf at sample 1"),
        (1.0, (DT_MS,), TraceError, "shape"),
        ([1.0], (DT_MS,), TraceError, "1,"),
        (np.zeros((4, 2, 2)), (DT_MS,), TraceError, "4, 2, 2"),
        (np.zeros(20), (DT_MS, "upwind"), ParameterError, "'upwind'"),
        (np.zeros(20), (0,), ParameterError, "dt_ms"),
    ],
)
def test_what_no_filter_takes_is_refused(stress_pa, trace, error, named):
    with pytest.raises(error, match=named):
        stress_rate(stress_pa, *trace)


@pytest.mark.parametrize("frequency_hz", [20.0, 100.0, 400.0])
def test_movement_reaches_sa_through_a_low_pass_of_one_pole(frequency_hz):
    times_ms = np.arange(0.0, 200.0, 0.05)
    turn = 2 * math.pi * frequency_hz / 1000.0  # rad/ms
    passed = slow_rate(1e4 * np.sin(turn * times_ms), 0.05)
    gain = 1.0 / math.hypot(1.0, frequency_hz / SLOW_HZ)
    settled = passed[times_ms > 100.0]
    np.testing.assert_allclose(np.abs(settled).max(), 1e4 * turn * gain, rtol=0.01)


@pytest.mark.parametrize("shape", [(70_000,), (501, 2), (501, 40)])
def test_what_follows_stress_is_that_of_a_plain_loop(shape):
    stress_pa = np.random.default_rng(1).uniform(0.0, 2e4, shape)
    expected_pa = stress_pa.copy()
    for share, fade_ms in FADES:
        followed, gain = stress_pa.copy(), -math.expm1(-0.5 / fade_ms)
        for row in range(1, len(stress_pa)):
            followed[row] = followed[row - 1] + gain * (stress_pa[row] - followed[row - 1])
        expected_pa -= share * followed
    np.testing.assert_allclose(faded(stress_pa, 0.5), np.maximum(expected_pa, 0.0), atol=1e-8)


@pytest.mark.parametrize("columns", [2, 40])
def test_a_filter_of_a_stress_that_ended_does_not_decay_to_denormal_numbers(columns):
    """With these a processor is ten times as slow."""
    stress = np.zeros((30_000, columns))
    stress[10:20] = 1000.0
    passed = filters._low_passed(stress, 500.0, 0.1, None)
    assert passed[100].all()
    assert not np.any((passed != 0) & (np.abs(passed) < np.finfo(float).tiny))
    assert np.abs(passed[-1]).max() < 1e-200
