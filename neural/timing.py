"""Timing of spikes: phase locking, and distances between two trains.

A train is its spike times in ms, ``(spike,)``, in any order; a duplicate time is two spikes,
and it may be empty. The distances of van Rossum and of Victor and Purpura are metrics: 0
for equal trains only, symmetric, with the triangle inequality. Each has one parameter for
the temporal precision of a spike: `tau_ms` or ``1 / cost_per_ms``.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from fembridge.typing import FloatArray


def vector_strength(times_ms: ArrayLike, frequency_hz: float) -> float:
    """Vector strength of spikes relative to a vibration, 0 to 1.

    1 where all spikes have one phase, 0 where phases are spread evenly; NaN without spikes.
    Few spikes give large values: one gives 1, and n at random phases about ``sqrt(0.8 / n)``.

    Notes
    -----
    Goldberg and Brown, J. Neurophysiol. 32, 613 (1969): the length of the mean of
    ``exp(2πi f t)``.
    """
    cycles = _sorted(times_ms) * (frequency_hz / 1000.0)
    if not cycles.size:
        return math.nan
    return min(1.0, float(np.abs(np.mean(np.exp(2j * np.pi * (cycles % 1.0))))))


def van_rossum_distance(times_a_ms: ArrayLike, times_b_ms: ArrayLike, tau_ms: float) -> float:
    """Distance of two trains, each spike convolved with an exponential of `tau_ms`.

    With a time constant far below the intervals, spikes without a match are counted; far
    above them, the numbers of spikes are compared.

    Returns
    -------
    float
        D ≥ 0, without unit: ``sqrt(1/2)`` for one spike against none,
        ``sqrt(1 − exp(−δ/τ))`` for a spike moved by δ, ``|n − m| sqrt(1/2)`` for
        n against m spikes as τ grows.

    Notes
    -----
    van Rossum, Neural Computation 13, 751 (2001)::

        D² = 1/τ ∫ (f(t) − g(t))² dt,    f(t) = Σ exp(−(t − t_i)/τ) for t ≥ t_i

    D, the root, is the metric; some programs scale D² by 2, so that one spike counts as 1.
    Between two spikes f − g only decays, so the integral is a sum with one term >= 0 per
    interval: without a time grid and without cancellation.

    Examples
    --------
    >>> from neural.timing import van_rossum_distance
    >>> round(van_rossum_distance([10.0, 20.0], [10.0], tau_ms=5.0) ** 2, 12)
    0.5
    """
    train_a, train_b = _sorted(times_a_ms), _sorted(times_b_ms)
    times_ms, time_index = np.unique(np.concatenate((train_a, train_b)), return_inverse=True)
    sign = np.repeat([1.0, -1.0], [train_a.size, train_b.size])
    jumps = np.bincount(time_index, sign, minlength=times_ms.size)
    intervals = np.diff(times_ms, append=np.inf) / tau_ms
    decays = np.exp(-intervals)
    shares = -0.5 * np.expm1(-2.0 * intervals)  # 1/τ ∫ exp(−2t/τ) over the interval

    difference = squared = 0.0
    for jump, decay, share in zip(jumps.tolist(), decays.tolist(), shares.tolist(), strict=True):
        difference += jump
        squared += difference * difference * share
        difference *= decay
    return math.sqrt(squared)


def victor_purpura_distance(
    times_a_ms: ArrayLike, times_b_ms: ArrayLike, cost_per_ms: float
) -> float:
    """Smallest cost of transforming one train into the other.

    Moving a spike by 1 ms costs q = `cost_per_ms`; removing or adding one costs 1. So a spike
    is moved by at most ``2 / q``. For q = 0 the distance is the difference of the spike
    counts, for a large q the number of spikes without a match.

    Notes
    -----
    D^spike[q] of Victor and Purpura, J. Neurophysiol. 76, 1310 (1996)::

        D(i, j) = min(D(i − 1, j) + 1, D(i, j − 1) + 1, D(i − 1, j − 1) + q|a_i − b_j|)

    Computed row by row: each added spike costs 1, so ``D(i, j) − j`` never rises along j,
    and a running minimum replaces the term ``D(i, j − 1) + 1``.

    Examples
    --------
    >>> from neural.timing import victor_purpura_distance
    >>> victor_purpura_distance([10.0, 20.0], [12.0], cost_per_ms=0.25)
    1.5
    """
    short_ms, long_ms = sorted((_sorted(times_a_ms), _sorted(times_b_ms)), key=len)
    added = np.arange(long_ms.size + 1, dtype=np.float64)
    costs = added.copy()
    for time_ms in short_ms:
        moved = costs[:-1] + cost_per_ms * np.abs(long_ms - time_ms)
        costs += 1.0
        np.minimum(costs[1:], moved, out=costs[1:])
        costs = np.minimum.accumulate(costs - added) + added
    return float(costs[-1])


def _sorted(times_ms: ArrayLike) -> FloatArray:
    return np.sort(np.asarray(times_ms, dtype=np.float64))
