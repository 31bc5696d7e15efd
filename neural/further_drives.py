"""Filtered stress beyond the paper's: what drives the models of our own.

Shapes, ends and derivative schemes are those of `neural.drive`; every filter here
scales with the stress, or with a stated power of it, so that a cell of another
sensitivity sees the same drive in another size.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import ParameterError
from fembridge.typing import FloatArray
from neural.drive import acceleration_change, checked_stress, rate_change, stress_rate

# Over what time the differences of `sharp_rise` are taken. With it they are largest
# at 1 / (2 LAG_MS), 500 Hz; over one sample they would grow up to 1000 Hz.
LAG_MS = 1.0

# How the response of PC grows with them: a tenth for a thousandth.
COMPRESSION = 1.0 / 3.0


def absolute_rate(stress_pa: ArrayLike, dt_ms: float, derivative: str = "backward") -> FloatArray:
    """Give |σ′| in Pa/ms: how fast the stress changes, in either direction."""
    return np.abs(stress_rate(stress_pa, dt_ms, derivative))


def rate_rise(stress_pa: ArrayLike, dt_ms: float, derivative: str = "backward") -> FloatArray:
    """Give filter (3) one-sided, ``max(σ′(t) − σ′(t − dt), 0)``, in Pa/ms."""
    return np.maximum(rate_change(stress_pa, dt_ms, derivative), 0.0)


def acceleration_rise(
    stress_pa: ArrayLike, dt_ms: float, derivative: str = "backward"
) -> FloatArray:
    """Give filter (4) one-sided, ``max(σ″(t) − σ″(t − dt), 0)``, in Pa/ms²."""
    return np.maximum(acceleration_change(stress_pa, dt_ms, derivative), 0.0)


def sharp_rise(stress_pa: ArrayLike, dt_ms: float) -> FloatArray:
    """Compress the one-sided third difference of the stress: what drives a PC cell.

    Parameters
    ----------
    stress_pa
        Stress at the afferent, ``(T,)`` or ``(T, condition)`` in Pa.
    dt_ms
        Time between two samples; a whole number of them makes `LAG_MS`.

    Returns
    -------
    ndarray
        ``max(Δ³σ(t), 0)^(1/3)`` in Pa^(1/3), of the same shape, with
        ``Δσ(t) = σ(t) − σ(t − LAG_MS)``; 0 where one of its samples is missing.

    Raises
    ------
    ParameterError
        `LAG_MS` is not a whole number of samples.
    """
    stress = checked_stress(stress_pa)
    if not (math.isfinite(dt_ms) and dt_ms > 0):
        raise ParameterError(f"dt_ms must be > 0, got {dt_ms}")
    lag = round(LAG_MS / dt_ms)
    if lag < 1 or abs(lag * dt_ms - LAG_MS) > 1e-3 * LAG_MS:
        raise ParameterError(
            f"dt_ms is {dt_ms:g}, expected a whole part of {LAG_MS:g} ms, the lag of "
            "the third difference"
        )
    third = stress
    for _ in range(3):
        third = third[lag:] - third[:-lag]
    drive = np.zeros_like(stress)
    drive[3 * lag :] = np.cbrt(np.maximum(third, 0.0))
    return drive
