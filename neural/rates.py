"""Firing rates: spikes per time window.

A window is ``(start, end)`` in ms, start excluded and end included, so that adjacent
windows share no spike.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import ParameterError

# Times are sums of steps; a spike within this distance in ms of an edge is on the edge.
EDGE_MS = 1.0e-6


def spikes_inside(spike_times_ms: ArrayLike, window_ms: tuple[float, float]) -> int:
    """Number of spikes after the start of the window, up to and including its end."""
    start, end = window_ms
    times_ms = np.asarray(spike_times_ms, dtype=np.float64)
    inside = (times_ms > start + EDGE_MS) & (times_ms <= end + EDGE_MS)
    return int(np.count_nonzero(inside))


def rate_ips(spike_times_ms: ArrayLike, window_ms: tuple[float, float]) -> float:
    """Firing rate in a window, in impulses/s.

    Examples
    --------
    >>> from neural import rate_ips
    >>> rate_ips([20.0, 40.0, 130.0], (0, 100))
    20.0
    """
    return mean_rate_ips([spike_times_ms], window_ms)


def mean_rate_ips(cells_ms: Sequence[ArrayLike], window_ms: tuple[float, float]) -> float:
    """Mean rate in impulses/s of cells, from the spike times of each cell in ms.

    Examples
    --------
    >>> from neural import mean_rate_ips
    >>> mean_rate_ips([[20.0, 40.0], [30.0]], (0, 100))
    15.0
    """
    start, end = window_ms
    if not start < end:
        raise ParameterError(argument="window_ms", found=(start, end), expected="start < end")
    spikes = sum(spikes_inside(times_ms, window_ms) for times_ms in cells_ms)
    return spikes * 1000.0 / (len(cells_ms) * (end - start))


def window_rows(window_ms: tuple[float, float], dt_ms: float, start_ms: float = 0.0) -> slice:
    """Rows of a current whose spikes are inside a window.

    The spike of row k is at ``start_ms + (k + 1) dt_ms``; see `neural.lif`.
    """
    first, stop = (math.floor((edge + EDGE_MS - start_ms) / dt_ms) for edge in window_ms)
    return slice(max(first, 0), max(stop, 0))
