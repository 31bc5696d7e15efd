"""What a finest mesh is worth: observed order, limit, and the grid convergence index.

The limit and the order are `fembridge.deflection.profile.richardson`'s. The
index is Roache's (J. Fluids Eng. 116:405, 1994) for three meshes: 1.25 times the
estimated error of the finest, in percent of its value.
"""

import math
from dataclasses import dataclass

import numpy as np

from fembridge.deflection.profile import richardson
from fembridge.typing import FloatArray

SAFETY = 1.25


@dataclass(frozen=True, slots=True)
class Extrapolation:
    """Limit and order of the last three of a series, NaN where there are none.

    `uncertainty_percent` is the grid convergence index of the finest value, or where
    the series does not close in from one side the spread of its last three values.
    """

    limit: float
    order: float
    uncertainty_percent: float


def extrapolation(width: FloatArray, value: FloatArray) -> Extrapolation:
    """Extrapolate `value` ``(K,)`` at falling element widths ``(K,)`` to width 0.

    Where the last three values do not close in, the limit is NaN.
    """
    last = value[-3:]
    limit, order = richardson(width[-3:], last)
    if math.isnan(limit):
        spread = 100 * float((last.max() - last.min()) / abs(last[-1]))
        return Extrapolation(math.nan, math.nan, spread)
    index = SAFETY * 100 * abs(limit - float(last[-1])) / abs(float(last[-1]))
    return Extrapolation(limit, order, index)


def power_law_limit(width: FloatArray, value: FloatArray, order: float) -> tuple[float, float]:
    """Limit of ``limit + c width**order`` fitted to all values, and its error.

    For series that scatter: least squares over ``(K,)`` values, K > 2. The error is
    the standard error of the limit.
    """
    columns = np.stack([np.ones_like(width), width**order], -1)
    solution, *_ = np.linalg.lstsq(columns, value, rcond=None)
    off = value - columns @ solution
    variance = float(off @ off) / (len(value) - 2)
    covariance = variance * np.linalg.inv(columns.T @ columns)
    return float(solution[0]), math.sqrt(covariance[0, 0])
