"""A deck of one material in plane strain whose boundary is prescribed: no contact.

For problems with a closed form, and for the same mesh in another solver.
"""

from dataclasses import dataclass

import numpy as np

from decks.analysis import ElementSet
from decks.dialects import template
from decks.finger import Material
from decks.keyword_deck import LINES
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
        numbers = np.arange(len(self.element)) + 1
        mine = [self.element_material == one for one in range(len(self.materials))]
        node, axis = np.nonzero(~np.isnan(self.moved_mm))
        return template("plane.inp.j2").render(
            problem=self,
            sections=[
                ElementSet(f"{BODY}_{k}", numbers[rows], self.element[rows] + 1, material, self.law)
                for k, (rows, material) in enumerate(zip(mine, self.materials, strict=True))
            ],
            boundary=zip(
                (self.moved[node] + 1).tolist(),
                (axis + 1).tolist(),
                self.moved_mm[node, axis].tolist(),
                strict=True,
            ),
            printed=PRINTED,
            **LINES,
        )


def uniform_stress_mpa(
    gradient: FloatArray, material: Material, law: str, *, large_strain: bool
) -> FloatArray:
    """Cauchy stress ``(6,)`` of a displacement gradient ``(2, 2)`` in plane strain.

    Order xx yy zz xy yz zx, in closed form.

    Notes
    -----
    Small strain: Hooke. Large strain, ``linear``: the second Piola–Kirchhoff stress
    is Hooke's of Green's strain, ``sigma = F S Fᵀ / J``. ``neo-hookean``:
    ``U = G/2 (I1bar − 3) + K/2 (J − 1)²``, so that
    ``sigma = G/J dev(bbar) + K (J − 1) I`` with ``bbar = J^(−2/3) F Fᵀ``.
    """
    whole = np.zeros((3, 3))
    whole[:2, :2] = gradient
    if not large_strain:
        stress = _hooke_mpa(0.5 * (whole + whole.T), material)
    else:
        stretch = np.eye(3) + whole
        volume = float(np.linalg.det(stretch))
        if law == NEO_HOOKEAN:
            isochoric = volume ** (-2 / 3) * stretch @ stretch.T
            deviator = isochoric - np.trace(isochoric) / 3 * np.eye(3)
            stress = material.shear_mpa / volume * deviator
            stress += material.bulk_mpa * (volume - 1) * np.eye(3)
        else:
            green = 0.5 * (stretch.T @ stretch - np.eye(3))
            stress = stretch @ _hooke_mpa(green, material) @ stretch.T / volume
    order = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))
    return np.array([stress[place] for place in order])


def _hooke_mpa(strain: FloatArray, material: Material) -> FloatArray:
    lame_mpa = material.bulk_mpa - 2 * material.shear_mpa / 3
    stress: FloatArray = lame_mpa * np.trace(strain) * np.eye(3) + 2 * material.shear_mpa * strain
    return stress
