"""Parameters of the three afferent classes, of the paper's model and of ours.

`AfferentParameters` has the common parameters; a subclass adds those of the filters and
the current of a model. ``drive`` names the model of `neural.models` that the numbers
belong to.
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

# Time step of the models whose equations have none. At 0.5 ms a swing of 600 Hz has three samples;
# rates at 0.1 and 0.05 ms differ by less than 2 % (decision 0056).
FINE_DT_MS = 0.1

MAX_CELLS = 1000

_MAY_BE_ZERO = ("refractory_ms", "spread", "jump_mv", "fatigue_mv")
_POTENTIALS = ("rest_mv", "threshold_mv")

# A refractory period longer than every stimulus is a mistake.
_MAXIMA = {"refractory_ms": 1.0e5, "spread": 10.0}
# Beyond these a product of two parameters may be infinite; no afferent has such a value.
_SMALLEST, _LARGEST = 1.0e-12, 1.0e12


@dataclass(frozen=True, slots=True, kw_only=True)
class AfferentParameters:
    """Common parameters of a class: membrane, cells and adaptation.

    The numbers are valid at the time step `dt_ms`, since differences in filters (3) and (4)
    are not divided by it. A recorded rate is a mean over afferents: `cells` cells represent
    the population, and `spread` is the standard deviation of the logarithm of their
    sensitivity to stress. A spike adds `jump_mv` to the threshold, which decays with the
    time constant `recovery_ms`. The paper has one cell and a fixed threshold.

    Examples
    --------
    >>> from neural import PUBLISHED
    >>> PUBLISHED["SA"].tau_ms, PUBLISHED["SA"].threshold_mv
    (32.14, -50.0)
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
            expected = " or ".join(self.drives)
            raise ParameterError(argument="drive", found=self.drive, expected=expected)
        if not 1 <= self.cells <= MAX_CELLS:
            raise ParameterError(argument="cells", found=self.cells, expected=f"1 to {MAX_CELLS}")
        for name in (field.name for field in fields(self)):
            if name in ("drive", "cells"):
                continue
            number = float(getattr(self, name))
            object.__setattr__(self, name, number)
            is_potential, is_zero = name in _POTENTIALS, name in _MAY_BE_ZERO and number == 0
            maximum = _MAXIMA.get(name, _LARGEST)
            in_range = abs(number) <= maximum if is_potential else _SMALLEST <= number <= maximum
            if not (math.isfinite(number) and (is_zero or in_range)):
                expected = "a finite number" if is_potential else "> 0"
                if name in _MAXIMA or abs(number) > maximum:
                    expected += f" and at most {maximum:g}"
                elif number > 0:
                    expected += f" and at least {_SMALLEST:g}"
                if name in _MAY_BE_ZERO:
                    expected += " (or 0)"
                raise ParameterError(argument=name, found=number, expected=expected)
        if not self.threshold_mv > self.rest_mv:
            raise ParameterError(
                argument="threshold_mv",
                found=self.threshold_mv,
                expected=f"above rest_mv, {self.rest_mv:g}",
            )
        for name in ("tau_ms", "recovery_ms", "fatigue_ms"):
            if getattr(self, name, self.dt_ms) < self.dt_ms:
                raise ParameterError(
                    argument=name,
                    found=getattr(self, name),
                    expected=f"dt_ms, {self.dt_ms:g}, or more",
                )

    def by_name(self) -> dict[str, Any]:
        """All parameters by name, `drive` included."""
        return {parameter.name: getattr(self, parameter.name) for parameter in fields(self)}


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
    """SA that counts rises of stress, and fires repeatedly under sustained stress.

    A fast rise by `step_pa` fires one spike; sustained stress above `held_pa` fires repeatedly.
    """

    afferent: ClassVar[str] = "SA"
    drives: ClassVar[tuple[str, ...]] = ("rising",)

    dt_ms: float = FINE_DT_MS
    step_pa: float
    held_pa: float
    threshold_mv: float = -50.0
    refractory_ms: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RisingRaParameters(AfferentParameters):
    """RA that counts rises of stress: each of `step_pa` fires one spike."""

    afferent: ClassVar[str] = "RA"
    drives: ClassVar[tuple[str, ...]] = ("rising",)

    dt_ms: float = FINE_DT_MS
    step_pa: float
    threshold_mv: float = -55.0
    refractory_ms: float = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class FadingSaParameters(RisingSaParameters):
    """SA that counts rises of stress; its response to sustained stress fades."""

    drives: ClassVar[tuple[str, ...]] = ("fading",)


@dataclass(frozen=True, slots=True, kw_only=True)
class TwoWayRaParameters(RisingRaParameters):
    """RA that counts rises and falls of stress on separate membranes.

    `retraction` is the sensitivity to falls as a share of that to rises. `jump_mv` decays with
    `recovery_ms` and ends when the stress turns: a further spike in one rise needs time, or much
    more stress. A spike also sets a second rise of the threshold to `fatigue_mv`, which decays
    with `fatigue_ms` across turns: under a weak vibration a cell fires in some of the cycles.
    `tau_ms` is not fitted: a rise at 20 Hz or above leaks little.
    """

    drives: ClassVar[tuple[str, ...]] = ("two_way",)

    retraction: float
    tau_ms: float = 50.0
    jump_mv: float = 80.0
    recovery_ms: float = 8.0
    fatigue_mv: float = 15.0
    fatigue_ms: float = 100.0


@dataclass(frozen=True, slots=True, kw_only=True)
class CorpusclePcParameters(AfferentParameters):
    """PC driven by stress filtered by its corpuscle, a band pass with compression.

    `beta_mv_per_ms` is the current at 1 Pa after the corpuscle. `jump_mv` decays with
    `recovery_ms` and ends when the filtered stress turns: a second spike in one swing needs
    a much stronger swing.
    """

    afferent: ClassVar[str] = "PC"
    drives: ClassVar[tuple[str, ...]] = ("corpuscle",)

    dt_ms: float = FINE_DT_MS
    beta_mv_per_ms: float
    threshold_mv: float = -55.0
    refractory_ms: float = 0.5
    jump_mv: float = 60.0
    recovery_ms: float = 9.0


Parameters: TypeAlias = Mapping[str, AfferentParameters]

# Table 2, "List of optimized parameters", one row per class; thresholds and refractory
# periods (the defaults above) are in section 2.2. The SA row also has 10.23 under α'2, the
# value of RA: SA has no α'2, so this is taken as an error in the table.
PUBLISHED: Parameters = MappingProxyType(
    {
        "SA": SaParameters(tau_ms=32.14, a1_pa=1926.32, a2_pa_per_ms=9850.98, alpha_mv_per_ms=1.79),
        "RA": RaParameters(tau_ms=456.70, a3_pa_per_ms=17191.87, alpha_mv_per_ms=10.23),
        "PC": PcParameters(tau_ms=639.85, a4_pa_per_ms2=16.34, alpha_mv_per_ms=4.14),
    }
)

AFFERENTS = tuple(PUBLISHED)


def finest_step_ms(parameters: Parameters) -> float:
    """Smallest time step of the classes, in ms."""
    return min(values.dt_ms for values in parameters.values())


def quantiles(cells: int) -> FloatArray:
    """Quantiles at the middle of `cells` equal shares of a normal distribution, ``(cells,)``.

    A cell at quantile q needs ``exp(spread q)`` times the stress of the median cell,
    so the first is the most sensitive.
    """
    normal = NormalDist()
    return np.array([normal.inv_cdf((cell + 0.5) / cells) for cell in range(cells)])
