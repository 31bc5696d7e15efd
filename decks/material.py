"""Materials of a finger's layers: elasticity, relaxation, density.

Table 1 of the paper is elastic. Two entries beside it make stress depend on time:
Prony terms, by which a layer relaxes, and the density, which counts where inertia
is asked for. Neither is in the paper; both are a user's choice.
"""

from dataclasses import dataclass
from typing import ClassVar

from decks.checks import NOT_NEGATIVE, POSITIVE, Ranged
from fembridge.errors import FingerError

_MOST_TERMS = 5
_LONGEST_S = 10.0


@dataclass(frozen=True, slots=True)
class PronyTerm(Ranged):
    """A share `g` of the shear modulus that is lost with time constant `tau_s`.

    ``G(t) = G0 (1 - sum g (1 - exp(-t/tau)))``, as Abaqus has it; the bulk modulus
    does not relax.
    """

    g: float
    tau_s: float

    RANGES: ClassVar = {"g": POSITIVE, "tau_s": (1e-4, _LONGEST_S)}


@dataclass(frozen=True, slots=True)
class Material(Ranged):
    """Linear elastic, isotropic; with `prony` terms the moduli are those at once.

    `density_kg_m3` counts where inertia is asked for; 1109 is that of skin (IT'IS
    Foundation, tissue properties database 4.1).
    """

    young_mpa: float
    poisson: float
    prony: tuple[PronyTerm, ...] = ()
    density_kg_m3: float = 1109.0

    RANGES: ClassVar = {
        "young_mpa": (1e-6, 1e9),
        "poisson": NOT_NEGATIVE,
        "density_kg_m3": (1.0, 1e5),
    }

    def __post_init__(self) -> None:
        Ranged.__post_init__(self)
        if not self.poisson < 0.5:
            raise FingerError(f"poisson must be in [0, 0.5), got {self.poisson}")
        object.__setattr__(self, "prony", tuple(self.prony))
        if len(self.prony) > _MOST_TERMS:
            raise FingerError(f"{len(self.prony)} Prony terms, expected at most {_MOST_TERMS}")
        if self.prony and not self.lasting_share > 0:
            raise FingerError("Prony terms take all of the shear modulus, expected less")

    @property
    def lasting_share(self) -> float:
        """Share of the shear modulus that never relaxes."""
        return 1.0 - sum(term.g for term in self.prony)

    @property
    def shear_mpa(self) -> float:
        """Shear modulus, at once."""
        return self.young_mpa / (2 * (1 + self.poisson))

    @property
    def bulk_mpa(self) -> float:
        """Bulk modulus."""
        return self.young_mpa / (3 * (1 - 2 * self.poisson))


# Ishizuka et al., Table 1. Densities: IT'IS Foundation 4.1 (skin; subcutaneous fat;
# cortical bone); of the nail that of keratin, rounded.
TABLE_1: dict[str, Material] = {
    "stratum_corneum": Material(2.0, 0.30),
    "epidermis": Material(2.0, 0.30),
    "dermis": Material(0.050, 0.48),
    "subcutaneous_tissue": Material(0.024, 0.40, density_kg_m3=911.0),
    "bone": Material(1.7e4, 0.30, density_kg_m3=1908.0),
    "nail": Material(1.7e2, 0.30, density_kg_m3=1300.0),
}
