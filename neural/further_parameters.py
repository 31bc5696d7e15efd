"""Parameters of the drives beyond the paper's; equations: `neural.drive_table`."""

from dataclasses import dataclass
from typing import ClassVar

from neural.parameters import AfferentParameters, RaParameters


@dataclass(frozen=True, slots=True, kw_only=True)
class RateRaParameters(RaParameters):
    """RA that also sees how fast the stress changes, |σ′|."""

    drives: ClassVar[tuple[str, ...]] = ("rate",)

    a5_pa_per_ms: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RisingSaParameters(AfferentParameters):
    """SA that counts rises of stress, and fires on under stress that is held.

    A quick rise of `step_pa` fires one spike; held stress above `held_pa` fires on.
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
class SharpPcParameters(AfferentParameters):
    """PC that sees sharp rises of stress, compressed.

    `beta_mv_per_ms` is the current at a third difference of 1 Pa.
    """

    afferent: ClassVar[str] = "PC"
    drives: ClassVar[tuple[str, ...]] = ("sharp",)

    beta_mv_per_ms: float
    threshold_mv: float = -55.0
    refractory_ms: float = 0.5
