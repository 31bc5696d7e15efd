"""A mesh made three times finer around a point, all quadrilaterals, nothing hanging.

An edge with both ends in the fine region is cut in three. An element there becomes
nine; one with one side there becomes four, wider towards the far side; all others
stay. So each layer keeps its outline, and the mesh is that of before elsewhere.
"""

import numpy as np

from decks.mesh import DIGITS, Mesh
from fembridge.errors import FingerError
from fembridge.typing import BoolArray, FloatArray, IntArray


def refined(mesh: Mesh, at_mm: tuple[float, float], radius_mm: float) -> Mesh:
    """Cut in three what has a node within `radius_mm` of the point `at_mm`.

    Raises
    ------
    FingerError
        No node is that near, or an element beside the fine ones is too skewed.
    """
    way_mm = np.linalg.norm(mesh.node_mm - np.array(at_mm), axis=1)
    if not (way_mm <= radius_mm).any():
        raise FingerError(
            f"no node lies within {radius_mm:g} mm of ({at_mm[0]:g}, {at_mm[1]:g}) mm, "
            f"the nearest {way_mm.min():.3g} mm away"
        )
    cut = _Cut(mesh.node_mm)
    fine = _fine_nodes(mesh.quad, way_mm <= radius_mm)
    quads: list[list[int]] = []
    layers: list[int] = []
    for quad, layer in zip(mesh.quad.tolist(), mesh.layer.tolist(), strict=True):
        pieces = _pieces(cut, quad, fine)
        quads += pieces
        layers += [layer] * len(pieces)
    return Mesh(cut.node_mm(), np.array(quads), np.array(layers)).checked()


def _fine_nodes(quad: IntArray, near: BoolArray) -> BoolArray:
    """Nodes of the fine region: no element has three of them, or two opposite."""
    fine = np.zeros(len(near), dtype=bool)
    fine[quad[near[quad].any(axis=1)]] = True
    while True:
        corner = fine[quad]
        count = corner.sum(axis=1)
        opposite = (count == 2) & (corner[:, 0] == corner[:, 2])
        filled = (count == 3) | opposite
        if not filled.any():
            return fine
        fine[quad[filled]] = True


def _pieces(cut: "_Cut", quad: list[int], fine: BoolArray) -> list[list[int]]:
    corner = fine[quad]
    if corner.all():
        return _nine(cut, *quad)
    if corner.sum() == 2:  # beside each other: turn the element until they lead
        first = next(k for k in range(4) if corner[k] and corner[(k + 1) % 4])
        return _four(cut, *quad[first:], *quad[:first])
    return [quad]


def _nine(cut: "_Cut", a: int, b: int, c: int, d: int) -> list[list[int]]:
    south, east = cut.edge(a, b), cut.edge(b, c)
    north, west = cut.edge(d, c), cut.edge(a, d)
    quad = [a, b, c, d]
    inner = [[cut.inside(quad, s / 3, t / 3) for s in (1, 2)] for t in (1, 2)]
    grid = [
        [a, *south, b],
        [west[0], *inner[0], east[0]],
        [west[1], *inner[1], east[1]],
        [d, *north, c],
    ]
    return [
        [grid[r][k], grid[r][k + 1], grid[r + 1][k + 1], grid[r + 1][k]]
        for r in range(3)
        for k in range(3)
    ]


def _four(cut: "_Cut", a: int, b: int, c: int, d: int) -> list[list[int]]:
    """Cut from three on the side `a` to `b` down to one on the side `c` to `d`.

    The two inner nodes stand a third of the width before the far side, where the
    corners there are half right angles, but not before the middle.
    """
    left, right = cut.edge(a, b)
    width_mm = cut.length_mm(a, b)
    height_mm = 0.5 * (cut.length_mm(b, c) + cut.length_mm(d, a))
    share = max(0.5, 1 - width_mm / (3 * height_mm))
    quad = [a, b, c, d]
    under_left, under_right = (cut.inside(quad, s / 3, share) for s in (1, 2))
    return [
        [a, left, under_left, d],
        [left, right, under_right, under_left],
        [right, b, c, under_right],
        [under_left, under_right, c, d],
    ]


class _Cut:
    """Nodes, old and new; an edge that two elements share is cut once."""

    def __init__(self, node_mm: FloatArray) -> None:
        self._old_mm = node_mm
        self._new_mm: list[FloatArray] = []
        self._edges: dict[tuple[int, int], tuple[int, int]] = {}

    def node_mm(self) -> FloatArray:
        """All nodes ``(N, 2)``, the old ones first."""
        return np.concatenate([self._old_mm, *self._new_mm])

    def edge(self, start: int, end: int) -> tuple[int, int]:
        """Rows of the two nodes on the edge from `start` to `end`, in that order."""
        if (start, end) not in self._edges:
            a_mm, b_mm = self._old_mm[start], self._old_mm[end]
            pair = self._add((2 * a_mm + b_mm) / 3), self._add((a_mm + 2 * b_mm) / 3)
            self._edges[start, end] = pair
            self._edges[end, start] = pair[::-1]
        return self._edges[start, end]

    def inside(self, quad: list[int], s: float, t: float) -> int:
        """Row of a new node inside `quad`: `s` along its first side, `t` across."""
        a_mm, b_mm, c_mm, d_mm = self._old_mm[quad]
        near_mm, far_mm = (1 - s) * a_mm + s * b_mm, (1 - s) * d_mm + s * c_mm
        return self._add((1 - t) * near_mm + t * far_mm)

    def length_mm(self, start: int, end: int) -> float:
        """Length of an edge."""
        return float(np.linalg.norm(self._old_mm[end] - self._old_mm[start]))

    def _add(self, point_mm: FloatArray) -> int:
        self._new_mm.append(np.round(point_mm[None], DIGITS) + 0.0)
        return len(self._old_mm) + len(self._new_mm) - 1
