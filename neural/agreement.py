"""Agreement of predicted with observed rates: regression line, RMSE and bias.

A point is one stimulus: x is its observed rate, y its predicted rate. The paper judges
a model by "the regression line of all plots of each tactile afferent": one line through
all stimuli of a family and a class (Figs. 3 (c), 4 (d) and 5 (d)). Its R² is a squared
correlation: a model with twice the observed rates has R² = 1. RMSE and bias show such a
difference.
"""

import math
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import ParameterError
from fembridge.typing import FloatArray

# Rates are means of counts over windows; closer than this they differ by rounding.
EQUAL_IPS = 1.0e-9

# A line through two points has no degree of freedom for a test.
_LEAST_TESTED = 3


@dataclass(frozen=True, slots=True)
class Regression:
    """Regression line ``predicted = slope * observed + intercept_ips`` with R² and p.

    `r_squared` is the squared Pearson correlation, `p_value` is from a two-sided t test
    against a slope of 0, `count` is the number of points. Values that the points do not
    determine are NaN; see `agreement`.
    """

    slope: float
    intercept_ips: float
    r_squared: float
    p_value: float
    count: int


@dataclass(frozen=True, slots=True)
class Agreement:
    """Regression, RMSE and bias (predicted minus observed), rates in impulses/s.

    Examples
    --------
    >>> from neural import agreement
    >>> agreement([1.0, 2.0, 3.0], [1.0, 2.0, 4.0]).regression.count
    3
    """

    regression: Regression
    rmse_ips: float
    bias_ips: float

    def to_row(self) -> dict[str, float]:
        """Values by name, those of the regression first."""
        return {**asdict(self.regression), "rmse_ips": self.rmse_ips, "bias_ips": self.bias_ips}


def agreement(observed_ips: ArrayLike, predicted_ips: ArrayLike) -> Agreement:
    """Regression, RMSE and bias of predicted rates against observed ones.

    Parameters
    ----------
    observed_ips, predicted_ips
        Rates of the same stimuli in the same order, ``(N,)`` each.

    Returns
    -------
    Agreement
        `bias_ips` is the mean of predicted minus observed: > 0 where the model
        overestimates. With equal predicted rates, as of a silent model, the slope is 0 and
        R² and p are NaN. With equal observed rates the whole regression is NaN except its
        count. With fewer than three points p is NaN.

    Raises
    ------
    ParameterError
        No rates, unequal numbers of observed and predicted rates, or a rate that is not finite.

    Notes
    -----
    The paper gives R² and p of "the regression line" and does not name the axes. R² and p
    do not depend on them; the slope does: here x is the observed rate.

    Examples
    --------
    >>> from neural.agreement import agreement
    >>> judged = agreement([0.0, 10.0, 20.0, 30.0], [1.0, 21.0, 41.0, 61.0])
    >>> judged.regression.r_squared, judged.regression.slope, judged.bias_ips
    (1.0, 2.0, 16.0)
    """
    observed, predicted = (
        _checked(rates, name)
        for rates, name in ((observed_ips, "observed_ips"), (predicted_ips, "predicted_ips"))
    )
    if observed.size != predicted.size:
        expected = f"{observed.size} rates, as many as observed"
        problem = f"has {predicted.size} rates, expected {expected}"
        raise ParameterError(
            problem, argument="predicted_ips", found=predicted.size, expected=expected
        )
    nan, count = math.nan, observed.size
    if np.ptp(observed) <= EQUAL_IPS:
        regression = Regression(nan, nan, nan, nan, count)
    elif np.ptp(predicted) <= EQUAL_IPS:
        regression = Regression(0.0, float(predicted.mean()), nan, nan, count)
    else:
        from scipy.stats import linregress

        line = linregress(observed, predicted)
        regression = Regression(
            slope=float(line.slope),
            intercept_ips=float(line.intercept),
            r_squared=min(1.0, float(line.rvalue) ** 2),
            p_value=float(line.pvalue) if count >= _LEAST_TESTED else nan,
            count=count,
        )
    error_ips = predicted - observed
    rmse_ips = math.sqrt(float(np.mean(error_ips**2)))
    return Agreement(regression, rmse_ips, bias_ips=float(np.mean(error_ips)))


def _checked(rates_ips: ArrayLike, name: str) -> FloatArray:
    """Rates as float64 ``(N,)``, N ≥ 1, all finite."""
    rates = np.asarray(rates_ips, dtype=np.float64)
    if rates.ndim != 1 or not rates.size:
        problem = f"has shape {rates.shape}, expected (N,) with N >= 1"
        raise ParameterError(problem, argument=name, found=rates.shape)
    bad = np.flatnonzero(~np.isfinite(rates))
    if bad.size:
        value = float(rates[bad[0]])
        raise ParameterError(f"is {value} at row {bad[0]}", argument=name, found=value)
    return rates
