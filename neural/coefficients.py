"""What turns the filtered stress of an afferent into its current.

A current here is ``I' = (R_m / τ_m) I`` in mV/ms, so that ``alpha_mv_per_ms`` is the
α′ of Table 2 and neither R_m nor the milliamperes of α are needed. With halves it is
current (4), (5) or (6) of the paper.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import ParameterError
from fembridge.typing import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Coefficients:
    """Of a current ``alpha × Σ share``, one share a filter.

    With `halves` a share saturates, ``x / (half + x)``; with `weights` it is linear,
    ``weight × x``; just one of both is given. Entries are numbers or ``(candidate,)``.
    `degree` is the power of the stress that linear filters grow with.

    Raises
    ------
    ParameterError
        Both or none of `halves` and `weights`.
    """

    alpha_mv_per_ms: ArrayLike
    halves: tuple[ArrayLike, ...] | None = None
    weights: tuple[ArrayLike, ...] | None = None
    degree: float = 1.0

    def __post_init__(self) -> None:
        if (self.halves is None) == (self.weights is None):
            raise ParameterError("a current has halves or weights, and not both")

    def for_need(self, need: ArrayLike) -> "Coefficients":
        """Give them for a cell that needs `need` times the stress for the same."""
        if self.halves is not None:
            return replace(self, halves=tuple(np.multiply(half, need) for half in self.halves))
        alpha = np.divide(self.alpha_mv_per_ms, np.power(need, self.degree))
        return replace(self, alpha_mv_per_ms=alpha)

    def current(self, filtered: Sequence[FloatArray]) -> FloatArray:
        """Give the current in mV/ms of filtered stress ``(T, …)``, for numbers alone.

        Raises
        ------
        ParameterError
            Not one coefficient a filter.
        """
        each = self.halves if self.halves is not None else self.weights
        assert each is not None
        if len(each) != len(filtered):
            raise ParameterError(f"{len(each)} coefficients for {len(filtered)} drives")
        if self.halves is not None:
            shares = [saturation(x, half) for x, half in zip(filtered, self.halves, strict=True)]
            return np.asarray(np.multiply(self.alpha_mv_per_ms, sum(shares[1:], shares[0])))
        parts = [gain * x for x, gain in zip(filtered, self.gains(), strict=True)]
        return np.asarray(sum(parts[1:], parts[0]))

    def gains(self) -> tuple[FloatArray, ...]:
        """Give ``alpha × weight`` of each linear share.

        Raises
        ------
        ParameterError
            Arrays of unequal length.
        """
        try:
            return tuple(np.multiply(self.alpha_mv_per_ms, weight) for weight in self.weights or ())
        except ValueError as error:
            raise ParameterError(
                f"{np.size(self.alpha_mv_per_ms)} alphas do not go with the weights"
            ) from error


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
        raise ParameterError(f"half-saturation must be numbers > 0, one or (candidate,), got {a}")
    x = np.abs(np.asarray(drive, dtype=np.float64))
    if a.ndim:
        a = a.reshape(-1, *[1] * (x.ndim - 1))
        x = x[:, np.newaxis]
    share: FloatArray = x / (a + x)
    return share
