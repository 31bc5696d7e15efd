"""A thick ring whose inner side is moved inwards: closed form, at any Poisson's ratio.

Plane strain, inner side moved by `u` away from the middle, outer side free:

    u_r = A r + B / r,  A = mu B / ((lambda + mu) b^2),  u = A a + B / a
    sigma_rr, sigma_tt = 2 (lambda + mu) A -/+ 2 mu B / r^2,  sigma_zz = 2 lambda A

(Timoshenko & Goodier, Theory of Elasticity, section 28). Towards a Poisson's ratio of
0.5 the ring's volume stays the same: A goes to 0 while its product with lambda stays
finite. An element that cannot keep its volume pays with a mean stress that is wrong.
"""

import numpy as np

from decks.material import Material
from fembridge.typing import FloatArray, IntArray
from fembridge.verification.plane_deck import PlaneProblem, moduli_mpa

INNER_MM, OUTER_MM = 0.5, 2.0
MOVED_MM = -0.005
_QUADRATIC = ("CPE8", "CPE8R")


def ring_problem(kind: str, rows: int, material: Material) -> PlaneProblem:
    """Mesh a quarter of the ring of `rows` elements across the wall; the cuts slide."""
    quadratic = kind in _QUADRATIC
    step = 2 if quadratic else 1
    across, along = step * rows + 1, step * 2 * rows + 1
    share = np.linspace(0.0, 1.0, across)
    radius_mm = INNER_MM * (OUTER_MM / INNER_MM) ** share
    if quadratic:  # mid-sides in the middle of straight sides
        radius_mm[1::2] = 0.5 * (radius_mm[:-1:2] + radius_mm[2::2])
    angle = np.linspace(0.0, np.pi / 2, along)
    at = np.stack([np.outer(radius_mm, np.cos(angle)), np.outer(radius_mm, np.sin(angle))], -1)
    if quadratic:
        at[:, 1::2] = 0.5 * (at[:, :-1:2] + at[:, 2::2])
    number = np.arange(across * along).reshape(across, along)
    element = _elements(number, quadratic)
    used, compact = np.unique(element, return_inverse=True)
    node_mm = at.reshape(-1, 2)[used]
    place = np.unravel_index(used, (across, along))
    moved, moved_mm = _moved(place, node_mm, (across, along))
    return PlaneProblem(
        kind=kind,
        node_mm=node_mm,
        element=compact.reshape(element.shape),
        materials=(material,),
        element_material=np.zeros(len(element), dtype=np.int64),
        moved=moved,
        moved_mm=moved_mm,
    )


def ring_stress_mpa(radius_mm: FloatArray, material: Material) -> FloatArray:
    """Radial, tangential and axial stress ``(..., 3)``."""
    shear_mpa, bulk_mpa = moduli_mpa(material)
    lame_mpa = bulk_mpa - 2 * shear_mpa / 3
    a, b = _constants(material)
    plane = 2 * (lame_mpa + shear_mpa) * a
    turn = 2 * shear_mpa * b / radius_mm**2
    axial = np.full_like(radius_mm, 2 * lame_mpa * a)
    return np.stack([plane - turn, plane + turn, axial], -1)


def _constants(material: Material) -> tuple[float, float]:
    shear_mpa, bulk_mpa = moduli_mpa(material)
    share = shear_mpa / ((bulk_mpa + shear_mpa / 3) * OUTER_MM**2)
    b = MOVED_MM / (share * INNER_MM + 1 / INNER_MM)
    return share * b, b


def _elements(number: IntArray, quadratic: bool) -> IntArray:
    """Rows of nodes, counter-clockwise: outwards first, then along the ring."""
    step = 2 if quadratic else 1
    low, high = number[:-1:step, :-1:step], number[step::step, :-1:step]
    corners = [low, high, number[step::step, step::step], number[:-1:step, step::step]]
    if quadratic:
        corners += [
            number[1::2, :-1:2],
            number[2::2, 1::2],
            number[1::2, 2::2],
            number[:-1:2, 1::2],
        ]
    return np.stack([each.ravel() for each in corners], -1)


def _moved(
    place: tuple[IntArray, ...], node_mm: FloatArray, shape: tuple[int, int]
) -> tuple[IntArray, FloatArray]:
    """Rows of the prescribed nodes and their displacement; NaN is free."""
    across, along = place
    way_mm = np.full_like(node_mm, np.nan)
    way_mm[along == 0, 1] = 0.0
    way_mm[along == shape[1] - 1, 0] = 0.0
    inner = across == 0
    way_mm[inner] = MOVED_MM * node_mm[inner] / INNER_MM
    rows = np.flatnonzero(~np.isnan(way_mm).all(axis=1))
    return rows, way_mm[rows]
