"""Fingers of a sweep and what came of each: numbers in, numbers out."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fembridge.errors import UsageError
from fembridge.typing import FloatArray

ALL = "all"
"""In the place of a group: the mean over all stimuli."""

RATE = "rate_ips"
STRESS = "peak_stress_pa"
QUANTITIES = (RATE, STRESS)


@dataclass(frozen=True, slots=True)
class Output:
    """The mean of one quantity of one afferent over a group of stimuli."""

    afferent: str
    quantity: str
    group: str


@dataclass(frozen=True, slots=True, eq=False)
class SweptFingers:
    """Parameters `value` ``(finger, parameter)``, answers ``(finger, output)``.

    `names` are those of parameters that are not the same in all fingers. `causes`
    tell why fingers were left out, one each.

    Raises
    ------
    UsageError
        Fewer than two fingers, no parameter that is different, or an array of
        another shape.
    """

    names: tuple[str, ...]
    value: FloatArray
    outputs: tuple[Output, ...]
    answer: FloatArray
    causes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("value", "answer"):
            array = np.array(getattr(self, name), dtype=np.float64)
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        fingers = len(self.value)
        if self.value.shape != (fingers, len(self.names)) or self.answer.shape != (
            fingers,
            len(self.outputs),
        ):
            raise UsageError(
                f"parameters {self.value.shape} and answers {self.answer.shape} of "
                f"{len(self.names)} parameters and {len(self.outputs)} outputs"
            )
        if fingers < 2:
            lost = f", {len(self.causes)} failed" if self.causes else ""
            raise UsageError(f"fingers: {fingers}{lost}, expected two or more")
        if not self.names:
            raise UsageError("no parameter is different from finger to finger")
        if not self.outputs:
            raise UsageError("no answers: neither rates nor stresses")

    @property
    def afferents(self) -> tuple[str, ...]:
        """Names of the afferents, in the order of the table."""
        return tuple(dict.fromkeys(each.afferent for each in self.outputs))

    @property
    def groups(self) -> tuple[str, ...]:
        """Groups of stimuli, the mean over all first."""
        return tuple(dict.fromkeys(each.group for each in self.outputs))

    def column(self, output: Output) -> FloatArray:
        """Give the answers of all fingers to `output`, ``(finger,)``."""
        column: FloatArray = self.answer[:, self.outputs.index(output)]
        return column


def order_of(strength: Sequence[tuple[float, float]]) -> list[int]:
    """Give rows from the strongest down; the first of equals first."""
    return sorted(range(len(strength)), key=strength.__getitem__, reverse=True)
