"""Membrane currents: the drive of an afferent, saturated, currents (4) to (6).

A current here is ``I' = (R_m / τ_m) I`` in mV/ms, so that ``alpha_mv_per_ms`` is
the α′ of Table 2 and neither R_m nor the milliamperes of α are needed.

Drives are ``(T,)`` or ``(T, condition)``. Scalars for the other arguments keep that
shape; arrays ``(candidate,)`` put their axis second: ``(T, candidate, condition)``.
"""

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import ParameterError
from fembridge.typing import FloatArray


def sa_current(
    level_pa: ArrayLike,
    rate_pa_per_ms: ArrayLike,
    *,
    a1_pa: ArrayLike,
    a2_pa_per_ms: ArrayLike,
    alpha_mv_per_ms: ArrayLike,
) -> FloatArray:
    """Give the current of SA in mV/ms, current (4): at most twice `alpha_mv_per_ms`."""
    sustained = saturation(level_pa, _beside(a1_pa, alpha_mv_per_ms))
    dynamic = saturation(rate_pa_per_ms, _beside(a2_pa_per_ms, alpha_mv_per_ms))
    return _scaled(sustained + dynamic, alpha_mv_per_ms, np.ndim(level_pa))


def ra_current(
    drive_pa_per_ms: ArrayLike, *, a3_pa_per_ms: ArrayLike, alpha_mv_per_ms: ArrayLike
) -> FloatArray:
    """Give the current of RA in mV/ms, current (5): at most `alpha_mv_per_ms`."""
    share = saturation(drive_pa_per_ms, _beside(a3_pa_per_ms, alpha_mv_per_ms))
    return _scaled(share, alpha_mv_per_ms, np.ndim(drive_pa_per_ms))


def pc_current(
    drive_pa_per_ms2: ArrayLike, *, a4_pa_per_ms2: ArrayLike, alpha_mv_per_ms: ArrayLike
) -> FloatArray:
    """Give the current of PC in mV/ms, current (6): at most `alpha_mv_per_ms`."""
    share = saturation(drive_pa_per_ms2, _beside(a4_pa_per_ms2, alpha_mv_per_ms))
    return _scaled(share, alpha_mv_per_ms, np.ndim(drive_pa_per_ms2))


def saturation(drive: ArrayLike, half: ArrayLike) -> FloatArray:
    """Share of its greatest value that a current reaches: ``|x| / (a + |x|)``.

    Parameters
    ----------
    drive
        Filtered stress x, ``(T,)`` or ``(T, condition)``, in the unit of `half`.
    half
        The drive a at which the share is one half; a number, or ``(candidate,)``.

    Returns
    -------
    ndarray
        From 0 to 1; the shape of `drive`, with the axis of `half` second.

    Raises
    ------
    ParameterError
        `half` is not > 0 everywhere, or has more than one axis.
    """
    a = np.asarray(half, dtype=np.float64)
    if a.ndim > 1 or not (np.isfinite(a).all() and (a > 0).all()):
        raise ParameterError(
            f"half-saturation must be numbers > 0, one or (candidate,), got {a}"
        )
    x = np.abs(np.asarray(drive, dtype=np.float64))
    if a.ndim:
        a = a.reshape(-1, *[1] * (x.ndim - 1))
        x = x[:, np.newaxis]
    share: FloatArray = x / (a + x)
    return share


def _beside(half: ArrayLike, alpha_mv_per_ms: ArrayLike) -> FloatArray:
    """Give `half` the candidate axis that `alpha_mv_per_ms` may have alone."""
    try:
        both = np.broadcast_arrays(half, alpha_mv_per_ms)
    except ValueError as error:
        raise ParameterError(
            f"{np.size(half)} half-saturations for {np.size(alpha_mv_per_ms)} alphas; "
            "expected one of each a candidate"
        ) from error
    return np.asarray(both[0], dtype=np.float64)


def _scaled(
    share: FloatArray, alpha_mv_per_ms: ArrayLike, drive_axes: int
) -> FloatArray:
    alpha = np.asarray(alpha_mv_per_ms, dtype=np.float64)
    if alpha.ndim:
        alpha = alpha.reshape(-1, *[1] * (drive_axes - 1))
    current: FloatArray = alpha * share
    return current
