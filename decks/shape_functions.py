"""Shape functions of solid elements and their slopes, and the points where they are needed.

Natural coordinates run from 0 to 1 along edges of tetrahedra and triangles of wedges, else from -1
to 1. Nodes have the order of CalculiX, Abaqus and Marc.
"""

from collections.abc import Mapping
from itertools import product

import numpy as np

from fembridge.typing import FloatArray

# Nodes in the middle of edges: the corners at their ends.
EDGES: Mapping[str, tuple[tuple[int, int], ...]] = {
    "tet": ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    "wedge": (
        (0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5),
    ),
    "hex": (
        (0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6),
        (3, 7),
    ),
}  # fmt: skip
CORNERS: Mapping[str, int] = {"tet": 4, "wedge": 6, "hex": 8}
# Points at which strain is most accurate (Barlow 1976), in natural coordinates: the middle of
# linear elements, the points of reduced integration of quadratic ones.
_GAUSS = 3**-0.5
_TET = (0.5854101966249685, 0.1381966011250105)
BEST_POINTS: Mapping[str, FloatArray] = {
    "tet4": np.full((1, 3), 0.25),
    "tet10": np.array([[_TET[0] if axis == k else _TET[1] for axis in range(3)] for k in range(4)]),
    "wedge6": np.array([[1 / 3, 1 / 3, 0.0]]),
    "wedge15": np.array(
        [
            [x, y, z]
            for z in (-_GAUSS, _GAUSS)
            for x, y in ((1 / 6, 1 / 6), (2 / 3, 1 / 6), (1 / 6, 2 / 3))
        ]
    ),
    "hex8": np.zeros((1, 3)),
    "hex20": np.array(list(product((-_GAUSS, _GAUSS), repeat=3))),
}
# Middle of an element.
MIDDLE: Mapping[str, FloatArray] = {
    "tet": np.full(3, 0.25),
    "wedge": np.array([1 / 3, 1 / 3, 0.0]),
    "hex": np.zeros(3),
}


def shape_functions(kind: str, point: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shape functions ``(n,)`` of an element and their slopes ``(n, 3)`` at a natural `point`.

    Parameters
    ----------
    kind
        ``tet4``, ``tet10``, ``wedge6``, ``wedge15``, ``hex8`` or ``hex20``, nodes in the order of
        CalculiX and Abaqus.
    point
        Three coordinates: of tetrahedra and wedges from 0 to 1 along edges, else from -1 to 1.
    """
    family = kind.rstrip("0123456789")
    quadratic = int(kind.removeprefix(family)) > CORNERS[family]
    first, second = np.array(EDGES[family]).T
    if family == "tet":
        area = np.append(1 - point.sum(), point)
        slope = np.concatenate([-np.ones((1, 3)), np.eye(3)])
        if not quadratic:
            return area, slope
        corner = area * (2 * area - 1), (4 * area - 1)[:, None] * slope
        side = (
            4 * area[first] * area[second],
            4 * (area[first, None] * slope[second] + area[second, None] * slope[first]),
        )
        return np.concatenate([corner[0], side[0]]), np.concatenate([corner[1], side[1]])
    if family == "wedge":
        area = np.tile(np.append(1 - point[:2].sum(), point[:2]), 2)
        flat = np.zeros((6, 3))
        flat[:, :2] = np.tile([[-1.0, -1], [1, 0], [0, 1]], (2, 1))
        up = np.repeat([-1.0, 1.0], 3)
        half = (1 + up * point[2]) / 2
        rise = np.zeros((6, 3))
        rise[:, 2] = up / 2
        if not quadratic:
            return area * half, flat * half[:, None] + area[:, None] * rise
        bubble, fall = 1 - point[2] ** 2, np.array([0.0, 0.0, -2 * point[2]])
        corner = (
            area * (2 * area - 1) * half - area * bubble / 2,
            (4 * area - 1)[:, None] * flat * half[:, None]
            + (area * (2 * area - 1))[:, None] * rise
            - 0.5 * (flat * bubble + area[:, None] * fall),
        )
        a, b = first[:6], second[:6]
        product_of = (area[a] * area[b])[:, None]
        turned = area[a, None] * flat[b] + area[b, None] * flat[a]
        side = 4 * product_of[:, 0] * half[a], 4 * (turned * half[a, None] + product_of * rise[a])
        upright = area[:3] * bubble, flat[:3] * bubble + area[:3, None] * fall
        return (
            np.concatenate([corner[0], side[0], upright[0]]),
            np.concatenate([corner[1], side[1], upright[1]]),
        )
    sign = np.array([[x, y, z] for z in (-1, 1) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    if not quadratic:
        factor = 1 + sign * point
        return factor.prod(axis=1) / 8, sign * _others(factor) / 8
    corner_factor = 1 + sign * point
    excess = (sign * point).sum(axis=1) - 2
    corner = corner_factor.prod(axis=1) / 8
    corner_slope = sign * (_others(corner_factor) * excess[:, None] + 8 * corner[:, None]) / 8
    middle = (sign[first] + sign[second]) / 2
    factor = np.where(middle == 0, 1 - point**2, 1 + middle * point)
    rate = np.where(middle == 0, -2 * point, middle)
    return (
        np.concatenate([corner * excess, factor.prod(axis=1) / 4]),
        np.concatenate([corner_slope, rate * _others(factor) / 4]),
    )


def _others(factor: FloatArray) -> FloatArray:
    """Products ``(n, 3)`` of the other two of three factors."""
    others: FloatArray = np.stack(
        [factor[:, 1] * factor[:, 2], factor[:, 2] * factor[:, 0], factor[:, 0] * factor[:, 1]], -1
    )
    return others
