"""How far two spike trains are apart in time: van Rossum, and Victor and Purpura.

A train is its spike times in ms, in any order; a duplicate time is two spikes. Both
distances are metrics: 0 for equal trains only, symmetric, and they keep the triangle
inequality. Each has one number that
says how precise in time a spike is taken to be: `tau_ms` or ``1 / cost_per_ms``.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import ParameterError
from fembridge.typing import FloatArray


def van_rossum_distance(times_a_ms: ArrayLike, times_b_ms: ArrayLike, tau_ms: float) -> float:
    """Distance of two trains, each spike convolved with an exponential.

    Parameters
    ----------
    times_a_ms, times_b_ms
        Spike times, ``(spike,)`` each; a train may be empty.
    tau_ms
        Time constant of the tails. Far below the intervals every spike without a
        twin counts by itself; far above them the numbers of spikes are compared.

    Returns
    -------
    float
        D ≥ 0, without unit: ``sqrt(1/2)`` for one spike against none,
        ``sqrt(1 − exp(−δ/τ))`` for a spike moved by δ, ``|n − m| sqrt(1/2)`` for
        n against m spikes as τ grows.

    Raises
    ------
    ParameterError
        A time that is not finite, or a `tau_ms` that is not > 0.

    Notes
    -----
    van Rossum, Neural Computation 13, 751 (2001)::

        D² = 1/τ ∫ (f(t) − g(t))² dt,    f(t) = Σ exp(−(t − t_i)/τ) for t ≥ t_i

    D, its root, is the metric; some programs scale D² by 2, so that one spike counts
    as 1. Between two spikes f − g only decays, so the integral is a sum with one
    term an interval, all ≥ 0: no grid of time, nothing that cancels.

    Examples
    --------
    >>> from neural.timing import van_rossum_distance
    >>> round(van_rossum_distance([10.0, 20.0], [10.0], tau_ms=5.0) ** 2, 12)
    0.5
    """
    train_a = _checked_ms(times_a_ms, "times_a_ms")
    train_b = _checked_ms(times_b_ms, "times_b_ms")
    _check_number(tau_ms, "tau_ms", may_be_zero=False)
    times_ms, place = np.unique(np.concatenate((train_a, train_b)), return_inverse=True)
    sign = np.repeat([1.0, -1.0], [train_a.size, train_b.size])
    jumps = np.bincount(place, sign, minlength=times_ms.size)
    with np.errstate(over="ignore"):  # an interval of very many tau is an infinite one
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
    """Least cost of turning one train into the other, spike by spike.

    Parameters
    ----------
    times_a_ms, times_b_ms
        Spike times, ``(spike,)`` each; a train may be empty.
    cost_per_ms
        q, the cost of moving a spike by 1 ms; to take a spike away or to add one
        costs 1. So a spike is moved by at most ``2 / q``.

    Returns
    -------
    float
        D ≥ 0, without unit. For q = 0 the difference of the spike counts; for a
        large q the number of spikes without a twin.

    Raises
    ------
    ParameterError
        A time that is not finite, or a `cost_per_ms` that is not ≥ 0.

    Notes
    -----
    D^spike[q] of Victor and Purpura, J. Neurophysiol. 76, 1310 (1996)::

        D(i, j) = min(D(i − 1, j) + 1, D(i, j − 1) + 1, D(i − 1, j − 1) + q|a_i − b_j|)

    A row at a time: a run of added spikes costs 1 each, so ``D(i, j) − j`` never
    rises along j, and a running minimum stands for the term that looks left.

    Examples
    --------
    >>> from neural.timing import victor_purpura_distance
    >>> victor_purpura_distance([10.0, 20.0], [12.0], cost_per_ms=0.25)
    1.5
    """
    train_a = _checked_ms(times_a_ms, "times_a_ms")
    train_b = _checked_ms(times_b_ms, "times_b_ms")
    _check_number(cost_per_ms, "cost_per_ms", may_be_zero=True)
    short_ms, long_ms = sorted((train_a, train_b), key=len)
    added = np.arange(long_ms.size + 1, dtype=np.float64)
    costs = added.copy()
    with np.errstate(over="ignore"):  # a cost beyond all numbers is never the least
        for time_ms in short_ms:
            moved = costs[:-1] + cost_per_ms * np.abs(long_ms - time_ms)
            costs += 1.0
            np.minimum(costs[1:], moved, out=costs[1:])
            costs = np.minimum.accumulate(costs - added) + added
    return float(costs[-1])


def _checked_ms(spike_times_ms: ArrayLike, name: str) -> FloatArray:
    """Spike times as float64 ``(spike,)``, all finite, in order of time."""
    times_ms = np.asarray(spike_times_ms, dtype=np.float64)
    if times_ms.ndim != 1:
        raise ParameterError(f"{name} of shape {times_ms.shape}, expected (spike,)")
    bad = np.flatnonzero(~np.isfinite(times_ms))
    if bad.size:
        raise ParameterError(f"{name} is {times_ms[bad[0]]} at spike {bad[0]}")
    return np.sort(times_ms)


def _check_number(value: float, name: str, may_be_zero: bool) -> None:
    if not (math.isfinite(value) and (value > 0 or (may_be_zero and value == 0))):
        least = ">= 0" if may_be_zero else "> 0"
        raise ParameterError(f"{name} must be finite and {least}, got {value}")
