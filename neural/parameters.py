"""Parameters of the three afferent classes, for the paper's model and the others.

`AfferentParameters` has the common ones; a subclass has those of a model's filters and
current. ``drive`` names the row of `neural.models` whose equation the numbers belong to.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from statistics import NormalDist
from types import MappingProxyType
from typing import Any, ClassVar, TypeAlias

import numpy as np

from fembridge.errors import ParameterError
from fembridge.typing import FloatArray

# Section 2.2: rest, and the potential to which a spike resets, in mV.
REST_MV = -65.0

# Section 2.2: the time step of the calculation and of the fit, in ms.
DT_MS = 0.5

MOST_CELLS = 1000

_MAY_BE_ZERO = ("refractory_ms", "spread", "jump_mv")
_POTENTIALS = ("rest_mv", "threshold_mv")

# Largest values; a longer refractory period exceeds any stimulus.
_MAXIMA = {"refractory_ms": 1.0e5, "spread": 10.0}


@dataclass(frozen=True, slots=True, kw_only=True)
class AfferentParameters:
    """Parameters of every class: membrane, differences between cells, adaptation.

    `dt_ms` is the time step in ms at which the numbers are valid: the differences of filters
    (3) and (4) are not divided by it. A recorded rate is a mean over afferents: `cells`
    represent the population, and `spread` is the standard deviation of the logarithm of
    their sensitivity to stress. `jump_mv` is the rise of the threshold by a spike,
    `recovery_ms` the time constant of its decay. The paper has one cell and a fixed
    threshold.
    """

    afferent: ClassVar[str]
    drives: ClassVar[tuple[str, ...]]

    tau_ms: float
    threshold_mv: float
    refractory_ms: float
    rest_mv: float = REST_MV
    dt_ms: float = DT_MS
    cells: int = 1
    spread: float = 0.0
    jump_mv: float = 0.0
    recovery_ms: float = 100.0
    drive: str = ""

    def __post_init__(self) -> None:
        if not self.drive:
            object.__setattr__(self, "drive", self.drives[0])
        if self.drive not in self.drives:
            raise ParameterError(
                f"{self.afferent}: model {self.drive!r} has other parameters, "
                f"expected {' or '.join(self.drives)}"
            )
        if not 1 <= self.cells <= MOST_CELLS:
            raise ParameterError(
                f"{self.afferent}: cells is {self.cells}, expected 1 to {MOST_CELLS}"
            )
        for name in (field.name for field in fields(self)):
            if name in ("drive", "cells"):
                continue
            number = float(getattr(self, name))
            object.__setattr__(self, name, number)
            potential, zero = name in _POTENTIALS, name in _MAY_BE_ZERO and number == 0
            maximum = _MAXIMA.get(name, math.inf)
            if not (math.isfinite(number) and (potential or zero or 0 < number <= maximum)):
                expected = "a finite number" if potential else "> 0"
                expected += f" and at most {maximum:g}" if name in _MAXIMA else ""
                raise ParameterError(
                    f"{self.afferent}: {name} is {number:g}, expected {expected}"
                    f"{' (or 0)' if name in _MAY_BE_ZERO else ''}"
                )
        if not self.threshold_mv > self.rest_mv:
            raise ParameterError(
                f"{self.afferent}: threshold_mv {self.threshold_mv:g} is not above "
                f"rest_mv {self.rest_mv:g}"
            )
        for name in ("tau_ms", "recovery_ms"):
            if getattr(self, name) < self.dt_ms:
                raise ParameterError(
                    f"{self.afferent}: {name} {getattr(self, name):g} is below "
                    f"dt_ms {self.dt_ms:g}, too short for its time step"
                )

    def by_name(self) -> dict[str, Any]:
        """All parameters by name, with `drive`."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


@dataclass(frozen=True, slots=True, kw_only=True)
class SaParameters(AfferentParameters):
    """Slowly adapting afferent: filters (1) and (2), current (4)."""

    afferent: ClassVar[str] = "SA"
    drives: ClassVar[tuple[str, ...]] = ("published", "energy", "adaptive")

    a1_pa: float
    a2_pa_per_ms: float
    alpha_mv_per_ms: float
    threshold_mv: float = -50.0
    refractory_ms: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RaParameters(AfferentParameters):
    """Rapidly adapting afferent: filter (3), current (5)."""

    afferent: ClassVar[str] = "RA"
    drives: ClassVar[tuple[str, ...]] = ("published", "energy", "adaptive")

    a3_pa_per_ms: float
    alpha_mv_per_ms: float
    threshold_mv: float = -55.0
    refractory_ms: float = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class PcParameters(AfferentParameters):
    """Pacinian afferent: filter (4), current (6)."""

    afferent: ClassVar[str] = "PC"
    drives: ClassVar[tuple[str, ...]] = ("published", "energy", "adaptive")

    a4_pa_per_ms2: float
    alpha_mv_per_ms: float
    threshold_mv: float = -55.0
    refractory_ms: float = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class RisingSaParameters(AfferentParameters):
    """SA that counts rises of stress and keeps firing under sustained stress.

    A quick rise of `step_pa` fires one spike; sustained stress above `held_pa` keeps firing.
    """

    afferent: ClassVar[str] = "SA"
    drives: ClassVar[tuple[str, ...]] = ("rising",)

    step_pa: float
    held_pa: float
    threshold_mv: float = -50.0
    refractory_ms: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RisingRaParameters(AfferentParameters):
    """RA that counts rises of stress: each of `step_pa` fires one spike."""

    afferent: ClassVar[str] = "RA"
    drives: ClassVar[tuple[str, ...]] = ("rising",)

    step_pa: float
    threshold_mv: float = -55.0
    refractory_ms: float = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class FadingSaParameters(RisingSaParameters):
    """SA that counts rises of stress; its response to a held stress fades."""

    drives: ClassVar[tuple[str, ...]] = ("fading",)


@dataclass(frozen=True, slots=True, kw_only=True)
class TwoWayRaParameters(RisingRaParameters):
    """RA that counts rises and falls of stress, each on a separate membrane.

    `retraction` is the sensitivity to falls over that to rises. `jump_mv` lasts until the
    stress turns: in one rise the first spike needs `step_pa`, each later spike four times
    as much. `tau_ms` is not fitted: a rise at 20 Hz or above leaks little.
    """

    drives: ClassVar[tuple[str, ...]] = ("two_way",)

    retraction: float
    tau_ms: float = 300.0
    jump_mv: float = 30.0


@dataclass(frozen=True, slots=True, kw_only=True)
class CorpusclePcParameters(AfferentParameters):
    """PC whose corpuscle is a band pass with compressed output.

    `beta_mv_per_ms` is the current at an output of 1 Pa. `jump_mv` fades with `recovery_ms`
    and is 0 again when the output changes sign: a second spike in one half cycle needs a
    far stronger stimulus.
    """

    afferent: ClassVar[str] = "PC"
    drives: ClassVar[tuple[str, ...]] = ("corpuscle",)

    beta_mv_per_ms: float
    threshold_mv: float = -55.0
    refractory_ms: float = 0.5
    jump_mv: float = 80.0
    recovery_ms: float = 12.0


Parameters: TypeAlias = Mapping[str, AfferentParameters]

# Table 2, "List of optimized parameters", one row per class; thresholds and refractory
# periods (the defaults above) are in section 2.2. The SA row also has 10.23 under α'2, the
# value of RA; SA has no α'2, so this is taken as a misprint.
PUBLISHED: Parameters = MappingProxyType(
    {
        "SA": SaParameters(tau_ms=32.14, a1_pa=1926.32, a2_pa_per_ms=9850.98, alpha_mv_per_ms=1.79),
        "RA": RaParameters(tau_ms=456.70, a3_pa_per_ms=17191.87, alpha_mv_per_ms=10.23),
        "PC": PcParameters(tau_ms=639.85, a4_pa_per_ms2=16.34, alpha_mv_per_ms=4.14),
    }
)

AFFERENTS = tuple(PUBLISHED)


def quantiles(cells: int) -> FloatArray:
    """Quantiles of a normal distribution at the middles of equal shares, ``(cells,)`` ascending.

    A cell at quantile q needs ``exp(spread q)`` times the stress of the median cell,
    so the first is the most sensitive.
    """
    normal = NormalDist()
    return np.array([normal.inv_cdf((k + 0.5) / cells) for k in range(cells)])
