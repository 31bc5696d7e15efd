"""One model of an afferent class: what it filters, its current, and why it exists."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from numpy.typing import ArrayLike

from fembridge.typing import FloatArray
from neural.coefficients import Coefficients
from neural.parameters import AfferentParameters

Filters: TypeAlias = Callable[[FloatArray, float, str], tuple[FloatArray, ...]]
Values: TypeAlias = Mapping[str, ArrayLike]


@dataclass(frozen=True, slots=True)
class Free:
    """A parameter that a fit searches, evenly in its logarithm, from `low` to `high`.

    `even` ones are searched evenly in themselves.
    """

    field: str
    low: float
    high: float
    unit: str
    even: bool = False


@dataclass(frozen=True, slots=True)
class Drive:
    """One model of one class: what it filters, how that becomes current, and why.

    `floored` membranes do not fall below rest. `quantity` is the stress that it
    reads: ``von_mises``, or ``energy``, the uniaxial stress of equal strain energy.
    """

    name: str
    afferent: str
    parameters: type[AfferentParameters]
    filters: Filters
    coefficients: Callable[[Values], Coefficients]
    own_free: tuple[Free, ...]
    equation: str
    reason: str
    floored: bool = False
    quantity: str = "von_mises"
    adaptive: bool = False
    cells: int = 1

    def free(self, cells: int | None = None) -> tuple[Free, ...]:
        """Give what a fit of so many cells searches; by default the drive's own."""
        own = (TAU, *self.own_free)
        if self.adaptive:
            own = (*own, JUMP, RECOVERY)
        return (*own, SPREAD) if (cells or self.cells) > 1 else own


# How far each parameter is searched; the paper does not tell its bounds.
TAU = Free("tau_ms", 1.0, 1000.0, "ms")
SPREAD = Free("spread", 0.0, 2.0, "1", even=True)
JUMP = Free("jump_mv", 0.1, 30.0, "mV")
RECOVERY = Free("recovery_ms", 1.0, 1000.0, "ms")
A1 = Free("a1_pa", 1e2, 1e6, "Pa")
A2 = Free("a2_pa_per_ms", 1e2, 1e6, "Pa/ms")
A3 = Free("a3_pa_per_ms", 1e1, 1e6, "Pa/ms")
A4 = Free("a4_pa_per_ms2", 1e-1, 1e4, "Pa/ms²")
A5 = Free("a5_pa_per_ms", 1e1, 1e6, "Pa/ms")
ALPHA = Free("alpha_mv_per_ms", 1e-1, 1e3, "mV/ms")
BETA = Free("beta_mv_per_ms", 1e-2, 1e2, "mV/ms")
STEP = Free("step_pa", 1e3, 1e6, "Pa")
HELD = Free("held_pa", 1e3, 1e6, "Pa")
