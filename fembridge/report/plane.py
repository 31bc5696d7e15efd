"""A deck of one material in plane strain whose boundary is prescribed: no contact.

For problems with a closed form, and for the same mesh in another solver.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from decks.keyword_deck import element_lines, list_lines, node_lines, real
from decks.material import Material
from fembridge.typing import FloatArray, IntArray

NEO_HOOKEAN = "neo-hookean"
BODY = "BODY"
# What is printed at integration points is of this set of elements.
PRINTED = "PRINTED"


@dataclass(frozen=True, slots=True, eq=False)
class PlaneProblem:
    """Nodes ``(N, 2)`` in mm, elements ``(E, 4 or 8)`` as rows of nodes, and more.

    `materials` and `element_material` ``(E,)`` say what each element is made of, by
    `law`, one of `decks.analysis.LAWS`. `moved` ``(M,)`` are rows of nodes and
    `moved_mm` ``(M, 2)`` their displacement; NaN leaves a direction free.
    """

    kind: str
    node_mm: FloatArray
    element: IntArray
    materials: tuple[Material, ...]
    element_material: IntArray
    moved: IntArray
    moved_mm: FloatArray
    law: str = "linear"
    large_strain: bool = False
    increments: int = 1

    def deck(self) -> str:
        """Text of the deck; its step lasts a second an increment."""
        end = float(self.increments)
        blocks: tuple[Iterable[str], ...] = (
            ("*NODE, NSET=ALL",),
            node_lines(range(1, len(self.node_mm) + 1), self.node_mm),
            self._sections(),
            (f"*STEP, INC=1000{', NLGEOM' if self.large_strain else ''}",),
            ("*STATIC, DIRECT", f"1.0, {real(end)}"),
            ("*BOUNDARY", *self._boundary()),
            ("*NODE OUTPUT, NSET=ALL, DOUBLE", "U"),
            ("*ELEMENT OUTPUT, NSET=ALL, DOUBLE", "S"),
            (f"*EL PRINT, ELSET={PRINTED}", "S"),
            ("*END STEP",),
        )
        return "\n".join(line for block in blocks for line in block) + "\n"

    def _sections(self) -> Iterator[str]:
        for number, material in enumerate(self.materials):
            rows = np.flatnonzero(self.element_material == number)
            name = f"{BODY}_{number}"
            yield f"*ELEMENT, TYPE={self.kind}, ELSET={name}"
            yield from element_lines((rows + 1).tolist(), self.element[rows] + 1)
            yield f"*MATERIAL, NAME={name}"
            yield from material_lines(material, self.law)
            yield f"*SOLID SECTION, ELSET={name}, MATERIAL={name}"
            yield "1.0"
        yield f"*ELSET, ELSET={PRINTED}"
        yield from list_lines(np.arange(len(self.element)) + 1)

    def _boundary(self) -> Iterator[str]:
        for row, way_mm in zip(self.moved.tolist(), self.moved_mm.tolist(), strict=True):
            for axis, mm in enumerate(way_mm, start=1):
                if mm == mm:
                    yield f"{row + 1}, {axis}, {axis}, {real(mm)}"


def material_lines(material: Material, law: str) -> Iterator[str]:
    """Lines of a deck with the law of a material."""
    if law == NEO_HOOKEAN:
        c10_mpa, d1_per_mpa = neo_hookean(material)
        yield "*HYPERELASTIC, NEO HOOKE"
        yield f"{real(c10_mpa)}, {real(d1_per_mpa)}"
    else:
        yield "*ELASTIC"
        yield f"{real(material.young_mpa)}, {real(material.poisson)}"


def neo_hookean(material: Material) -> tuple[float, float]:
    """C10 in MPa and D1 in 1/MPa that have the material's moduli at rest."""
    shear_mpa, bulk_mpa = moduli_mpa(material)
    return 0.5 * shear_mpa, 2 / bulk_mpa


def moduli_mpa(material: Material) -> tuple[float, float]:
    """Shear and bulk modulus."""
    young_mpa, poisson = material.young_mpa, material.poisson
    return young_mpa / (2 * (1 + poisson)), young_mpa / (3 * (1 - 2 * poisson))


def uniform_stress_mpa(
    gradient: FloatArray, material: Material, law: str, *, large_strain: bool
) -> FloatArray:
    """Cauchy stress ``(6,)`` of a displacement gradient ``(2, 2)`` in plane strain.

    Order xx yy zz xy yz zx, in closed form.

    Notes
    -----
    Small strain: Hooke. Large strain, ``linear``: the second Piola–Kirchhoff stress
    is Hooke's of Green's strain, ``sigma = F S Fᵀ / J``. ``neo-hookean``:
    ``U = C10 (I1bar − 3) + (J − 1)²/D1``, so that
    ``sigma = 2 C10/J dev(bbar) + 2 (J − 1)/D1 I`` with ``bbar = J^(−2/3) F Fᵀ``.
    """
    whole = np.zeros((3, 3))
    whole[:2, :2] = gradient
    if not large_strain:
        stress = _hooke_mpa(0.5 * (whole + whole.T), material)
    else:
        stretch = np.eye(3) + whole
        volume = float(np.linalg.det(stretch))
        if law == NEO_HOOKEAN:
            c10_mpa, d1_per_mpa = neo_hookean(material)
            isochoric = volume ** (-2 / 3) * stretch @ stretch.T
            deviator = isochoric - np.trace(isochoric) / 3 * np.eye(3)
            stress = 2 * c10_mpa / volume * deviator
            stress += 2 * (volume - 1) / d1_per_mpa * np.eye(3)
        else:
            green = 0.5 * (stretch.T @ stretch - np.eye(3))
            stress = stretch @ _hooke_mpa(green, material) @ stretch.T / volume
    order = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))
    return np.array([stress[place] for place in order])


def _hooke_mpa(strain: FloatArray, material: Material) -> FloatArray:
    shear_mpa, bulk_mpa = moduli_mpa(material)
    lame_mpa = bulk_mpa - 2 * shear_mpa / 3
    stress: FloatArray = lame_mpa * np.trace(strain) * np.eye(3) + 2 * shear_mpa * strain
    return stress
