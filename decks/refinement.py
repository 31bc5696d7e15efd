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
    fine = _fine_nodes(mesh.quad, way_mm <= radius_mm)
    cut = _Cut(mesh.node_mm)
    quads: list[list[int]] = []
    layers: list[int] = []
    for quad, layer in zip(mesh.quad.tolist(), mesh.layer.tolist(), strict=True):
        corner, pieces = fine[quad], [quad]
        if corner.all():
            pieces = cut.nine(*quad)
        elif corner.sum() == 2:  # beside each other: turn the element until they lead
            first = next(k for k in range(4) if corner[k] and corner[(k + 1) % 4])
            pieces = cut.four(*quad[first:], *quad[:first])
        quads += pieces
        layers += [layer] * len(pieces)
    return Mesh(np.array(cut.place_mm), np.array(quads), np.array(layers)).checked()


def _fine_nodes(quad: IntArray, near: BoolArray) -> BoolArray:
    """Nodes of the fine region: no element has three of them, or two opposite."""
    fine = np.zeros(len(near), dtype=bool)
    filled = near[quad].any(axis=1)
    while filled.any():
        fine[quad[filled]] = True
        corner = fine[quad]
        count = corner.sum(axis=1)
        filled = (count == 3) | ((count == 2) & (corner[:, 0] == corner[:, 2]))
    return fine


class _Cut:
    """Nodes, the old ones first; an edge that two elements share is cut once."""

    def __init__(self, node_mm: FloatArray) -> None:
        self.place_mm = list(node_mm)
        self._edges: dict[tuple[int, int], tuple[int, int]] = {}

    def nine(self, a: int, b: int, c: int, d: int) -> list[list[int]]:
        """An element cut in three both ways."""
        south, east = self._edge(a, b), self._edge(b, c)
        north, west = self._edge(d, c), self._edge(a, d)
        inner = [[self._inside((a, b, c, d), s / 3, t / 3) for s in (1, 2)] for t in (1, 2)]
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

    def four(self, a: int, b: int, c: int, d: int) -> list[list[int]]:
        """Cut from three on the side `a` to `b` down to one on the side `c` to `d`.

        The two inner nodes stand a third of the width before the far side, where the
        corners there are half right angles, but not before the middle.
        """
        left, right = self._edge(a, b)
        a_mm, b_mm, c_mm, d_mm = (self.place_mm[node] for node in (a, b, c, d))
        height_mm = 0.5 * (np.linalg.norm(c_mm - b_mm) + np.linalg.norm(a_mm - d_mm))
        share = max(0.5, 1 - float(np.linalg.norm(b_mm - a_mm) / (3 * height_mm)))
        under_left, under_right = (self._inside((a, b, c, d), s / 3, share) for s in (1, 2))
        return [
            [a, left, under_left, d],
            [left, right, under_right, under_left],
            [right, b, c, under_right],
            [under_left, under_right, c, d],
        ]

    def _edge(self, start: int, end: int) -> tuple[int, int]:
        """The two nodes on the edge from `start` to `end`, in that order."""
        if (start, end) not in self._edges:
            a_mm, b_mm = self.place_mm[start], self.place_mm[end]
            pair = self._add((2 * a_mm + b_mm) / 3), self._add((a_mm + 2 * b_mm) / 3)
            self._edges[start, end], self._edges[end, start] = pair, pair[::-1]
        return self._edges[start, end]

    def _inside(self, quad: tuple[int, ...], s: float, t: float) -> int:
        """A new node inside `quad`: `s` along its first side, `t` across."""
        a_mm, b_mm, c_mm, d_mm = (self.place_mm[node] for node in quad)
        near_mm, far_mm = (1 - s) * a_mm + s * b_mm, (1 - s) * d_mm + s * c_mm
        return self._add((1 - t) * near_mm + t * far_mm)

    def _add(self, point_mm: FloatArray) -> int:
        self.place_mm.append(np.round(point_mm, DIGITS) + 0.0)
        return len(self.place_mm) - 1
