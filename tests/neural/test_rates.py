"""Windows: what is inside, what is on the edge, what a row of a current is in."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fembridge.errors import ParameterError
from neural.rates import mean_rate_ips, rate_ips, spikes_inside, window_rows


def test_the_start_of_a_window_is_excluded_and_its_end_included():
    assert spikes_inside([5.0, 5.5, 100.0, 250.0, 250.5], (5.0, 250.0)) == 3


def test_a_rate_is_impulses_a_second():
    assert rate_ips([10.0, 20.0, 30.0], (0.0, 100.0)) == 30.0
    assert rate_ips(np.arange(1, 50) * 5.0, (5.0, 250.0)) == pytest.approx(48 / 0.245)
    assert rate_ips([], (0.0, 100.0)) == 0.0
    # Three spikes of two cells in a tenth of a second: 15 a second each.
    assert mean_rate_ips([[10.0, 20.0, 200.0], [30.0]], (0.0, 100.0)) == 15.0


@given(
    start_row=st.integers(0, 300),
    length=st.integers(1, 300),
    dt_ms=st.sampled_from([0.1, 0.25, 0.5, 1.0]),
    start_ms=st.sampled_from([-3.0, 0.0, 0.5, 7.0]),
)
def test_rows_of_a_window_are_the_spikes_inside_it(start_row, length, dt_ms, start_ms):
    rows = 400
    window_ms = (start_ms + start_row * dt_ms, start_ms + (start_row + length) * dt_ms)
    every_spike_ms = start_ms + (np.arange(rows) + 1) * dt_ms
    chosen = every_spike_ms[window_rows(window_ms, dt_ms, start_ms)]
    assert chosen.size == spikes_inside(every_spike_ms, window_ms)
    assert all(spikes_inside([time], window_ms) for time in chosen)


@pytest.mark.parametrize("window_ms", [(5.0, 5.0), (9.0, 5.0), (0.0, np.nan)])
def test_a_window_that_ends_before_it_starts_is_refused(window_ms):
    with pytest.raises(ParameterError):
        rate_ips([1.0], window_ms)
