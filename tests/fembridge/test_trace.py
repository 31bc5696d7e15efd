"""A stress trace and a stimulus: what they refuse to be, and the even grid of a trace."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from fembridge.errors import StimulusError, TraceError
from fembridge.stimulus import Stimulus
from fembridge.trace import STEP_TOLERANCE, StressTrace, mean_step, resample


def test_a_trace_keeps_its_own_samples_and_lets_nobody_write():
    stress_pa = np.array([0.0, 1.0, 2.0])
    trace = StressTrace(stress_pa, 0.5, 7)
    stress_pa[1] = 99.0
    np.testing.assert_array_equal(trace.stress_pa, [0.0, 1.0, 2.0])
    with pytest.raises(ValueError, match="read-only"):
        trace.stress_pa[0] = 1.0
    with pytest.raises(AttributeError):
        trace.dt_ms = 1.0


@given(
    dt_ms=st.floats(1e-3, 10),
    start_ms=st.floats(0, 100),
    count=st.integers(2, 50),
    digits=st.integers(6, 10),
)
def test_times_printed_with_six_digits_or_more_are_an_even_grid(dt_ms, start_ms, count, digits):
    exact_ms = start_ms + dt_ms * np.arange(count)
    printed_ms = [float(f"{time_ms:.{digits - 1}e}") for time_ms in exact_ms]
    rounding_ms = 10.0 ** (1 - digits) * exact_ms[-1]
    if 2 * rounding_ms > 0.9 * STEP_TOLERANCE * dt_ms:
        return  # a clock so late that its digits do not show the step
    mean_ms, odd = mean_step(np.array(printed_ms))
    assert odd is None
    np.testing.assert_allclose(mean_ms, dt_ms, rtol=STEP_TOLERANCE)


@pytest.mark.parametrize(
    ("times_ms", "mean_ms", "row"),
    [
        ([0.5, 1.0, 2.0, 2.5], 2 / 3, 1),
        ([0.5, 0.5, 0.5], 0.0, 0),
        ([1.5, 1.0, 0.5], -0.5, 0),
        ([0.5, np.nan, 1.5], 0.5, 0),
    ],
)
def test_times_that_are_no_even_grid_have_an_odd_row(times_ms, mean_ms, row):
    assert mean_step(np.array(times_ms)) == (pytest.approx(mean_ms), row)


@pytest.mark.parametrize(
    ("argument", "value", "found"),
    [
        ("stress_pa", [1.0], (1,)),
        ("stress_pa", 3.0, ()),
        ("stress_pa", np.zeros((4, 2)), (4, 2)),
        ("stress_pa", [0.0, -np.inf, np.nan], -np.inf),
        *(("dt_ms", step_ms, step_ms) for step_ms in (0.0, -0.5, np.nan, np.inf)),
        *(("start_ms", start_ms, start_ms) for start_ms in (np.nan, np.inf)),
    ],
)
def test_an_invalid_trace_is_refused(argument, value, found):
    with pytest.raises(TraceError) as caught:
        StressTrace(**{"stress_pa": [0.0, 1.0], "dt_ms": 0.5, "node": 7, argument: value})
    assert (caught.value.argument, caught.value.found) == (argument, found)


@given(
    gaps_ms=st.lists(st.floats(0.01, 40.0), min_size=1, max_size=30),
    dt_ms=st.floats(0.05, 0.9),
    seed=st.integers(0, 2**16),
)
def test_a_resampled_history_keeps_its_samples_range_and_edges(gaps_ms, dt_ms, seed):
    """Monotone between samples: no value outside those around it, none beyond the ends."""
    times_ms = np.cumsum([3.0, *gaps_ms])
    dt_ms *= float(times_ms[-1] - times_ms[0])
    values = np.random.default_rng(seed).normal(size=(times_ms.size, 2))

    even_ms, found = resample(times_ms, values, dt_ms)

    assert even_ms[0] == times_ms[0]
    assert times_ms[-1] - dt_ms * 1.01 < even_ms[-1] <= times_ms[-1]
    row = np.clip(np.searchsorted(times_ms, even_ms, side="right") - 1, 0, times_ms.size - 2)
    around = np.stack([values[row], values[row + 1]])
    assert (found >= around.min(axis=0) - 1e-12).all()
    assert (found <= around.max(axis=0) + 1e-12).all()


def test_resampling_passes_through_the_samples_and_says_edge_and_gap():
    times_ms = np.array([0.5, 1.0, 2.0, 2.5, 2.9])
    said: list[str] = []
    even_ms, found = resample(times_ms, times_ms**2, 0.5, said.append)
    assert_allclose(even_ms, [0.5, 1.0, 1.5, 2.0, 2.5], rtol=1e-14)
    assert_allclose(found[[0, 1, 3, 4]], [0.25, 1.0, 4.0, 6.25], rtol=1e-12)
    [line] = said
    assert "to 2.5 ms (of 2.9)" in line
    assert "1 of 4" in line and "up to 1 ms at 1 ms" in line


@pytest.mark.parametrize(
    ("times_ms", "dt_ms", "named"),
    [
        ([1.0], 0.5, "1 sample"),
        ([1.0, 3.0, 2.0], 0.5, "2 ms comes after 3 ms"),
        ([1.0, 1.0], 0.5, "1 ms comes after 1 ms"),
        ([1.0, 2.0], 2.0, "1 to 2 ms"),
        ([1.0, 2.0], 0.0, "a step of 0 ms"),
        ([1.0, np.nan], 0.5, "not finite"),
        ([0.0, 1e9], 0.5, "0.5 ms"),
    ],
)
def test_what_cannot_be_resampled_is_refused(times_ms, dt_ms, named):
    with pytest.raises(TraceError, match=named):
        resample(np.array(times_ms), np.zeros(len(times_ms)), dt_ms)


WAVE_UM = np.sin(np.linspace(0, 6.28, 501))


def make(displacement_um=WAVE_UM, dt_ms=0.5, window_ms=(5.0, 250.0), **more):
    return Stimulus("mine", displacement_um, dt_ms, window_ms, **more)


WINDOWS_MS = [(-1, 100), (100, 100), (200, 100), (5, 250.5), (np.nan, 100), (5, np.nan)]


@pytest.mark.parametrize(
    ("argument", "value", "found"),
    [
        ("displacement_um", [1.0], (1,)),
        ("displacement_um", np.zeros((501, 1)), (501, 1)),
        ("displacement_um", [0.0, np.inf, np.nan], np.inf),
        *(("dt_ms", step_ms, step_ms) for step_ms in (0.0, -1.0, np.nan, np.inf)),
        *(("window_ms", window_ms, window_ms) for window_ms in WINDOWS_MS),
        *(("preindent_um", depth_um, depth_um) for depth_um in (-1, np.nan, np.inf)),
    ],
)
def test_an_invalid_stimulus_is_refused(argument, value, found):
    with pytest.raises(StimulusError) as caught:
        make(**{argument: value})
    assert (caught.value.argument, caught.value.found) == (argument, found)


def test_a_window_may_end_on_a_last_sample_that_rounding_moved():
    """0.1 ms has no exact float: 3 steps of it end beside 0.3 ms."""
    assert make(np.zeros(4), 0.1, (0.0, 0.3)).window_ms == (0.0, 0.3)


def test_a_stimulus_keeps_its_own_samples_and_lets_nobody_write():
    wave_um, origin = WAVE_UM.copy(), {"family": "mine"}
    stimulus = make(wave_um, origin=origin)
    wave_um[:] = 0.0
    origin["family"] = "other"
    np.testing.assert_array_equal(stimulus.displacement_um, WAVE_UM)
    assert stimulus.origin == {"family": "mine"}
    with pytest.raises(ValueError, match="read-only"):
        stimulus.displacement_um[0] = 1.0
    with pytest.raises(AttributeError):
        stimulus.id = "other"
