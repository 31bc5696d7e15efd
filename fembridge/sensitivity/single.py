"""One parameter at a time: the answers where it is low, and where it is high."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fembridge.errors import UsageError
from fembridge.sensitivity.swept import ALL, RATE, Output, SweptFingers, order_of


@dataclass(frozen=True, slots=True)
class Effect:
    """One parameter from `low` to `high`, the others as in the base: one output.

    `is_monotone`: between neighbouring values the answer never goes the other way.
    """

    parameter: str
    low: float
    base: float
    high: float
    output: Output
    at_low: float
    at_base: float
    at_high: float
    is_monotone: bool

    @property
    def change(self) -> float:
        """From low to high."""
        return self.at_high - self.at_low

    @property
    def percent(self) -> float:
        """The change in percent of the base's answer; NaN where that is 0."""
        return 100 * self.change / self.at_base if self.at_base else math.nan


def is_one_at_a_time(swept: SweptFingers) -> bool:
    """Whether every finger differs from the first in one parameter at most."""
    return bool(((swept.value != swept.value[0]).sum(axis=1) <= 1).all())


def single_effects(swept: SweptFingers) -> list[Effect]:
    """Give the effect of each parameter on each output, in the order of `swept`.

    The first finger is the base.

    Raises
    ------
    UsageError
        A finger that differs from the base in more than one parameter.
    """
    if not is_one_at_a_time(swept):
        raise UsageError(
            "a finger differs from the first in more than one parameter: not one at a time"
        )
    effects = []
    for place, name in enumerate(swept.names):
        others = np.delete(swept.value, place, axis=1)
        mine = np.flatnonzero((others == others[0]).all(axis=1))
        mine = mine[swept.value[mine, place].argsort(kind="stable")]
        values = swept.value[mine, place]
        for output in swept.outputs:
            answers = swept.column(output)
            steps = np.diff(answers[mine])
            effects.append(
                Effect(
                    name,
                    float(values[0]),
                    float(swept.value[0, place]),
                    float(values[-1]),
                    output,
                    float(answers[mine[0]]),
                    float(answers[0]),
                    float(answers[mine[-1]]),
                    bool((steps >= 0).all() or (steps <= 0).all()),
                )
            )
    return effects


def effects_in_order(effects: Sequence[Effect]) -> list[str]:
    """Give the parameters, the one first that moves a class's mean rate most.

    Most in percent of the base's rate, whichever class of `effects` that is; of equals
    the one that moves the stress more.
    """
    strength: dict[str, list[float]] = {}
    for effect in effects:
        most = strength.setdefault(effect.parameter, [0.0, 0.0])
        if effect.output.group == ALL and not math.isnan(effect.percent):
            place = 0 if effect.output.quantity == RATE else 1
            most[place] = max(most[place], abs(effect.percent))
    names = list(strength)
    return [names[row] for row in order_of([(r, s) for r, s in strength.values()])]
