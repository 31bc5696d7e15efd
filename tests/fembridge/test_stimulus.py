"""A stimulus: what it refuses to be, and its clock."""

import numpy as np
import pytest

from fembridge.errors import StimulusError
from fembridge.stimulus import Stimulus

WAVE_UM = np.sin(np.linspace(0, 6.28, 501))


def make(displacement_um=WAVE_UM, dt_ms=0.5, window_ms=(5.0, 250.0), **more):
    return Stimulus("mine", displacement_um, dt_ms, window_ms, **more)


@pytest.mark.parametrize(
    ("displacement_um", "message"),
    [
        ([1.0], r"mine: expected \(T,\), got \(1,\)"),
        (np.zeros((501, 1)), r"mine: expected \(T,\), got \(501, 1\)"),
        ([0.0, np.nan, np.inf], "mine: sample 1 is nan"),
    ],
)
def test_samples_that_are_no_waveform_are_refused(displacement_um, message):
    with pytest.raises(StimulusError, match=message):
        make(displacement_um, window_ms=(0.0, 0.5))


@pytest.mark.parametrize("dt_ms", [0.0, -1.0, np.nan, np.inf])
def test_a_step_that_is_no_time_is_refused(dt_ms):
    with pytest.raises(StimulusError, match="mine: dt_ms must be > 0"):
        make(dt_ms=dt_ms)


@pytest.mark.parametrize(
    "window_ms",
    [(-1.0, 100.0), (100.0, 100.0), (200.0, 100.0), (5.0, 250.5), (np.nan, 100.0), (5.0, np.nan)],
)
def test_a_window_that_leaves_the_samples_is_refused(window_ms):
    with pytest.raises(StimulusError, match="is not inside 0 to 250 ms"):
        make(window_ms=window_ms)


def test_a_window_may_end_on_a_last_sample_that_rounding_moved():
    """0.1 ms has no exact float: 3 steps of it end beside 0.3 ms."""
    assert make(np.zeros(4), 0.1, (0.0, 0.3)).window_ms == (0.0, 0.3)


@pytest.mark.parametrize("preindent_um", [-1.0, np.nan, np.inf])
def test_a_preindentation_that_is_no_depth_is_refused(preindent_um):
    with pytest.raises(StimulusError, match="mine: preindent_um must be >= 0"):
        make(preindent_um=preindent_um)


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
