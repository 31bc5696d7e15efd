"""Materials and sections of a keyword deck."""

from collections.abc import Iterable, Iterator

from decks.analysis import ElementSet
from decks.inp.lines import real
from decks.material import Material

_T_PER_MM3 = 1.0e-12  # in one kg/m3


def heading() -> Iterator[str]:
    """Say what follows."""
    yield "**"
    yield "** ---- Materials: Young's modulus in MPa, Poisson's ratio"


def material(
    section: ElementSet,
    *,
    inertia: bool,
    moduli: str = "",
    relaxation: Iterable[str] = (),
    thickness_mm: float = 1.0,
) -> Iterator[str]:
    """Give the material of `section`, and the section, `thickness_mm` thick.

    `moduli` is what the solver wants to be told of the elastic moduli, with its
    comma; `relaxation` are its lines that say how the material relaxes.
    """
    name, values = section.name.upper(), section.material
    yield f"*MATERIAL, NAME={name}"
    if inertia:
        yield "*DENSITY"
        yield f"{values.density_kg_m3 * _T_PER_MM3:.9E}"
    if section.law == "neo-hookean":
        yield from _neo_hookean(values, moduli)
    else:
        yield f"*ELASTIC{moduli}"
        yield f"{real(values.young_mpa)}, {real(values.poisson)}"
    yield from relaxation
    yield f"*SOLID SECTION, ELSET={name}, MATERIAL={name}"
    yield f"{thickness_mm}"


def _neo_hookean(values: Material, moduli: str) -> Iterator[str]:
    """``U = C10 (I1 − 3) + (J − 1)²/D1``, I1 of the strain without its volume part.

    Equal to Hooke's law for small strain: C10 = G/2, D1 = 2/K.
    """
    yield (f"** C10 in MPa, D1 in 1/MPa: E = {values.young_mpa:g}, nu = {values.poisson:g} at rest")
    yield f"*HYPERELASTIC, NEO HOOKE{moduli}"
    yield f"{real(values.shear_mpa / 2)}, {real(2 / values.bulk_mpa)}"
