"""Profiles of several meshes side by side, and what an endless mesh would give.

A value that changes with the elements' width h as ``limit + c h**p`` is known when
three meshes are: Richardson's extrapolation. The width goes with the number of
elements to the power −1/2, since the meshes are made alike.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fembridge.deflection.profile import Deflection
from fembridge.errors import ResponseError
from fembridge.typing import FloatArray

# Where meshes are compared.
COMPARED_MM = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0)
# An order outside is none of a method that converges: the meshes differ otherwise.
_ORDERS = (0.25, 8.0)
_HALVINGS = 80


@dataclass(frozen=True, slots=True)
class ConvergenceRow:
    """One quantity on each mesh: `values` from the coarsest mesh to the finest.

    `change_percent` is the last step between two meshes, in percent of the finest
    value. `limit` and `order` are Richardson's, NaN where there are not three
    meshes or the values do not come nearer to each other from one side.
    """

    quantity: str
    values: tuple[float, ...]
    change_percent: float
    limit: float
    order: float


def convergence(deflections: Sequence[Deflection]) -> tuple[ConvergenceRow, ...]:
    """Compare the deflections at `COMPARED_MM` in mm, and the force in N/mm.

    Raises
    ------
    ResponseError
        Fewer than two profiles, or of different depths.
    """
    meshes = sorted(deflections, key=lambda deflection: deflection.elements)
    depths_mm = sorted({deflection.depth_mm for deflection in meshes})
    if len(meshes) < 2 or len(depths_mm) != 1:
        raise ResponseError(
            f"{len(meshes)} profiles of depths {depths_mm} mm, expected two or more of one depth"
        )
    width = np.array([deflection.elements**-0.5 for deflection in meshes])
    rows = [
        _row(
            f"deflection_mm at {distance_mm:g} mm",
            width,
            np.array([float(mesh.at(distance_mm)) for mesh in meshes]),
        )
        for distance_mm in COMPARED_MM
    ]
    force = np.array([mesh.force_n_per_mm for mesh in meshes])
    return (*rows, _row("force_n_per_mm", width, force))


def richardson(width: FloatArray, value: FloatArray) -> tuple[float, float]:
    """Limit and order of `value` ``(3,)`` at the element widths `width` ``(3,)``.

    Widths fall. The order solves ``(v1 − v2)/(v2 − v3) = (h1^p − h2^p)/(h2^p − h3^p)``
    (Roache, J. Fluids Eng. 116:405, 1994, for a ratio of widths that is not the
    same). Both are NaN where the values do not close in from one side, or with an
    order outside 0.25 to 8.
    """
    coarse, fine = value[0] - value[1], value[1] - value[2]
    if not (coarse * fine > 0):
        return math.nan, math.nan

    def excess(order: float) -> float:
        first, second, third = width**order
        return float((first - second) / (second - third) - coarse / fine)

    low, high = _ORDERS
    if not excess(low) < 0 < excess(high):
        return math.nan, math.nan
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) < 0 else (low, middle)
    order = 0.5 * (low + high)
    second, third = width[1] ** order, width[2] ** order
    return float(value[2] - fine * third / (second - third)), order


def _row(quantity: str, width: FloatArray, value: FloatArray) -> ConvergenceRow:
    limit, order = math.nan, math.nan
    if value.size >= 3:
        limit, order = richardson(width[-3:], value[-3:])
    return ConvergenceRow(
        quantity=quantity,
        values=tuple(value.tolist()),
        change_percent=100 * float((value[-1] - value[-2]) / value[-1]),
        limit=limit,
        order=order,
    )
