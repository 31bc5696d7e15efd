"""A stimulus: what it refuses to be, and its clock."""

import numpy as np
import pytest

from fembridge.errors import StimulusError
from fembridge.stimulus import Stimulus

WAVE_UM = np.sin(np.linspace(0, 6.28, 501))


def make(displacement_um=WAVE_UM, dt_ms=0.5, window_ms=(5.0, 250.0), **more):
    return Stimulus("mine", displacement_um, dt_ms, window_ms, **more)


WINDOWS_MS = [(-1, 100), (100, 100), (200, 100), (5, 250.5), (np.nan, 100), (5, np.nan)]


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"displacement_um": [1.0]}, r"expected \(T,\), got \(1,\)"),
        ({"displacement_um": np.zeros((501, 1))}, r"expected \(T,\), got \(501, 1\)"),
        ({"displacement_um": [0.0, np.nan, np.inf]}, "sample 1 is nan"),
        *(({"dt_ms": each}, "dt_ms must be > 0") for each in (0.0, -1.0, np.nan, np.inf)),
        *(({"window_ms": each}, "is not inside 0 to 250 ms") for each in WINDOWS_MS),
        *(({"preindent_um": each}, "preindent_um must be >= 0") for each in (-1, np.nan, np.inf)),
    ],
)
def test_what_is_no_stimulus_is_refused(changed, message):
    with pytest.raises(StimulusError, match=f"mine: .*{message}"):
        make(**changed)


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
