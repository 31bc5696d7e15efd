"""All parameters at once: standardised rank regression, with intervals.

Parameters and answer are replaced by their ranks, these put to mean 0 and variance 1,
and a plane is fitted. Its coefficients tell how far the answer moves in its order
when one parameter moves in its own and the others stay; R² tells how much of the
order they explain together. An R² well below 1 says that a part is not monotone, goes
by two parameters together, or is noise (Iman & Conover 1979, Technometrics 21:499;
Saltelli & Marivoet 1990, Reliab. Eng. Syst. Saf. 28:229).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fembridge.errors import UsageError
from fembridge.sensitivity.swept import ALL, RATE, STRESS, Output, SweptFingers, order_of
from fembridge.typing import FloatArray

RESAMPLES = 2000
SHARE = 0.95
"""Of resamples inside an interval."""

# Of a correlation matrix: below this, parameters of a resample go together.
_SINGULAR = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class RankRegression:
    """How one output depends on all parameters; arrays are ``(parameter,)``.

    `low` and `high` hold 95 % of the coefficients of resampled fingers. Without
    variation of the output (`varies` is False) all are 0.
    """

    output: Output
    coefficient: FloatArray
    low: FloatArray
    high: FloatArray
    r_squared: float
    fingers: int
    varies: bool = True

    @property
    def adjusted_r_squared(self) -> float:
        """R² without what so many parameters explain by chance; at least 0."""
        free = self.fingers - len(self.coefficient) - 1
        return max(0.0, 1 - (1 - self.r_squared) * (self.fingers - 1) / free)

    def is_sure(self, parameter: int) -> bool:
        """Whether the interval of the coefficient leaves out 0."""
        return bool(self.low[parameter] > 0 or self.high[parameter] < 0)


def least_fingers(parameters: int) -> int:
    """Give how many fingers a regression on so many parameters needs."""
    return 2 * (parameters + 1)


def rank_regressions(
    swept: SweptFingers, *, resamples: int = RESAMPLES, seed: int = 0
) -> list[RankRegression]:
    """Fit every output of `swept`; the same seed draws the same resamples.

    Raises
    ------
    UsageError
        Fewer than `least_fingers`, or two parameters of one order.
    """
    fingers, parameters = swept.value.shape
    if fingers < least_fingers(parameters):
        raise UsageError(
            f"{fingers} fingers for {parameters} parameters, expected "
            f"{least_fingers(parameters)} or more"
        )
    _check_apart(swept)
    coefficient, r_squared = _fitted(swept.value, swept.answer)
    rng = np.random.default_rng(seed)
    rows = rng.integers(fingers, size=(resamples, fingers))
    drawn, _ = _fitted(swept.value[rows], swept.answer[rows])
    tail = 0.5 * (1 - SHARE)
    low, high = np.quantile(drawn, [tail, 1 - tail], axis=0)
    varies = (swept.answer != swept.answer[0]).any(axis=0)
    return [
        RankRegression(
            output,
            coefficient[:, k],
            low[:, k],
            high[:, k],
            float(r_squared[k]),
            fingers,
            bool(varies[k]),
        )
        for k, output in enumerate(swept.outputs)
    ]


def regressions_in_order(regressions: Sequence[RankRegression]) -> list[int]:
    """Give rows of parameters, the one first with the largest coefficient of a rate.

    The mean rate over all stimuli counts, of whichever class of `regressions`; of
    equals the coefficient of the stress.
    """
    whole = [each for each in regressions if each.output.group == ALL]
    parameters = len(regressions[0].coefficient)
    most = {
        quantity: np.max(
            [np.zeros(parameters)]
            + [abs(e.coefficient) for e in whole if e.output.quantity == quantity],
            axis=0,
        )
        for quantity in (RATE, STRESS)
    }
    return order_of(list(zip(most[RATE].tolist(), most[STRESS].tolist(), strict=True)))


def _fitted(value: FloatArray, answer: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Fit ranks, ``(…, finger, parameter)`` and ``(…, finger, output)``.

    Returns coefficients ``(…, parameter, output)`` and R² ``(…, output)``. What does
    not vary has no part in the fit.
    """
    along, up = _standardised(value), _standardised(answer)
    fingers = value.shape[-2]
    turned = along.swapaxes(-1, -2)
    alike = turned @ along / fingers
    together = turned @ up / fingers
    inverse = np.linalg.pinv(alike, rcond=_SINGULAR, hermitian=True)
    coefficient: FloatArray = inverse @ together
    r_squared: FloatArray = np.clip((coefficient * together).sum(axis=-2), 0.0, 1.0)
    return coefficient, r_squared


def _standardised(array: FloatArray) -> FloatArray:
    """Give ranks along the fingers, mean 0 and variance 1; 0 where all are equal."""
    from scipy.stats import rankdata

    ranks = rankdata(array, axis=-2)
    centred = ranks - ranks.mean(axis=-2, keepdims=True)
    spread = np.sqrt((centred**2).mean(axis=-2, keepdims=True))
    standard: FloatArray = np.divide(centred, spread, out=np.zeros_like(centred), where=spread > 0)
    return standard


def _check_apart(swept: SweptFingers) -> None:
    """Refuse parameters that no fit can tell apart."""
    along = _standardised(swept.value)
    alike = np.abs(along.T @ along) / len(along)
    for row, name in enumerate(swept.names):
        same = np.flatnonzero(alike[row, :row] > 1 - _SINGULAR)
        if same.size:
            raise UsageError(
                f"{swept.names[same[0]]} and {name} rise and fall together: their "
                "effects cannot be told apart"
            )
