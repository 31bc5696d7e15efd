"""What turns the filtered stress of an afferent into its current."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import ParameterError
from fembridge.typing import FloatArray
from neural.current import saturation


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
            return replace(
                self, halves=tuple(np.multiply(half, need) for half in self.halves)
            )
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
            shares = [
                saturation(x, half)
                for x, half in zip(filtered, self.halves, strict=True)
            ]
            return np.asarray(
                np.multiply(self.alpha_mv_per_ms, sum(shares[1:], shares[0]))
            )
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
            return tuple(
                np.multiply(self.alpha_mv_per_ms, weight)
                for weight in self.weights or ()
            )
        except ValueError as error:
            raise ParameterError(
                f"{np.size(self.alpha_mv_per_ms)} alphas do not go with the weights"
            ) from error
