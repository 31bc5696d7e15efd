"""Parameters of the three afferent classes, as published or from a TOML table.

A table has a section for each class, with the names of the fields as keys::

    [SA]
    tau_ms = 30.0
    a1_pa = 2000.0

A section or key that is absent keeps its published value.
"""

import math
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar, TypeAlias

from fembridge.errors import ParameterError
from fembridge.typing import Table

# Section 2.2: rest, and the potential to which a spike resets, in mV.
REST_MV = -65.0

# Section 2.2: the time step of the calculation and of the fit, in ms.
DT_MS = 0.5

_MAY_BE_ZERO = ("refractory_ms",)
_POTENTIALS = ("rest_mv", "threshold_mv")


@dataclass(frozen=True, slots=True, kw_only=True)
class AfferentParameters:
    """What every class has: a membrane, and the greatest current of its filters.

    `dt_ms` is the time step at which the numbers hold: filters (3) and (4) take
    differences that are not divided by it.
    """

    afferent: ClassVar[str]

    tau_ms: float
    alpha_mv_per_ms: float
    threshold_mv: float
    refractory_ms: float
    rest_mv: float = REST_MV
    dt_ms: float = DT_MS

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise ParameterError(
                    f"{self.afferent}: {field.name} must be a number, got {value!r}"
                )
            object.__setattr__(self, field.name, float(value))
            if not math.isfinite(value):
                raise ParameterError(f"{self.afferent}: {field.name} is {value}")
            if field.name in _POTENTIALS or value > 0:
                continue
            if not (value == 0 and field.name in _MAY_BE_ZERO):
                least = ">= 0" if field.name in _MAY_BE_ZERO else "> 0"
                raise ParameterError(
                    f"{self.afferent}: {field.name} must be {least}, got {value:g}"
                )
        if not self.threshold_mv > self.rest_mv:
            raise ParameterError(
                f"{self.afferent}: threshold_mv {self.threshold_mv:g} is not above "
                f"rest_mv {self.rest_mv:g}"
            )
        if self.tau_ms < self.dt_ms:
            raise ParameterError(
                f"{self.afferent}: tau_ms {self.tau_ms:g} is below "
                f"dt_ms {self.dt_ms:g}, too short for its time step"
            )

    @property
    def gap_mv(self) -> float:
        """Threshold minus rest, in mV."""
        return self.threshold_mv - self.rest_mv


@dataclass(frozen=True, slots=True, kw_only=True)
class SaParameters(AfferentParameters):
    """Slowly adapting afferent: filters (1) and (2), current (4)."""

    afferent: ClassVar[str] = "SA"

    a1_pa: float
    a2_pa_per_ms: float
    threshold_mv: float = -50.0
    refractory_ms: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RaParameters(AfferentParameters):
    """Rapidly adapting afferent: filter (3), current (5)."""

    afferent: ClassVar[str] = "RA"

    a3_pa_per_ms: float
    threshold_mv: float = -55.0
    refractory_ms: float = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class PcParameters(AfferentParameters):
    """Pacinian afferent: filter (4), current (6)."""

    afferent: ClassVar[str] = "PC"

    a4_pa_per_ms2: float
    threshold_mv: float = -55.0
    refractory_ms: float = 0.5


Parameters: TypeAlias = Mapping[str, AfferentParameters]

# Table 2, "List of optimized parameters", one row a class; thresholds and refractory
# periods (the defaults above) are in section 2.2. The SA row prints 10.23 under α'2
# too, which is RA's: SA has no α'2, so it is taken as a slip of the table.
PUBLISHED: Parameters = MappingProxyType(
    {
        "SA": SaParameters(
            tau_ms=32.14, a1_pa=1926.32, a2_pa_per_ms=9850.98, alpha_mv_per_ms=1.79
        ),
        "RA": RaParameters(tau_ms=456.70, a3_pa_per_ms=17191.87, alpha_mv_per_ms=10.23),
        "PC": PcParameters(tau_ms=639.85, a4_pa_per_ms2=16.34, alpha_mv_per_ms=4.14),
    }
)

AFFERENTS = tuple(PUBLISHED)


def parameters_from_table(table: Mapping[str, object]) -> Parameters:
    """Make parameters of a table as TOML gives it; what is absent is published.

    Raises
    ------
    ParameterError
        An unknown section or key, or a value outside its meaning.
    """
    chosen = dict(PUBLISHED)
    for afferent, section in table.items():
        if afferent not in PUBLISHED:
            raise ParameterError(_unknown("section", afferent, AFFERENTS))
        if not isinstance(section, Mapping):
            raise ParameterError(f"{afferent}: expected a section, got {section!r}")
        known = [field.name for field in fields(PUBLISHED[afferent])]
        for key in section:
            if key not in known:
                raise ParameterError(f"{afferent}: {_unknown('key', key, known)}")
        chosen[afferent] = replace(PUBLISHED[afferent], **section)
    return MappingProxyType(chosen)


def parameters_to_table(parameters: Parameters) -> Table:
    """Give a table for TOML: a section for each class, every key."""
    return {name: asdict(one) for name, one in parameters.items()}


def read_parameters(path: Path) -> Parameters:
    """Read a TOML file of parameters.

    Raises
    ------
    ParameterError
        No such file, not TOML, or what `parameters_from_table` refuses.
    """
    try:
        with path.open("rb") as file:
            table = tomllib.load(file)
    except OSError as error:
        raise ParameterError(f"{path}: cannot read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ParameterError(f"{path}: not TOML: {error}") from error
    try:
        return parameters_from_table(table)
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from error


def _unknown(kind: str, word: str, known: list[str] | tuple[str, ...]) -> str:
    from difflib import get_close_matches

    folded = {name.casefold(): name for name in known}
    near = get_close_matches(str(word).casefold(), folded, n=1)
    hint = f"; did you mean {folded[near[0]]!r}?" if near else ""
    return f"unknown {kind} {word!r}, expected {', '.join(known)}{hint}"
