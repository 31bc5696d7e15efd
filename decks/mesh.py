"""A mesh of quadrilaterals in layers: checked, stored, made finer around a point.

Rows count from 0 here; a deck numbers nodes and elements from 1.
"""

import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from decks.finger import LAYERS, AfferentSite
from fembridge.errors import FingerError
from fembridge.host.store import replacing
from fembridge.typing import BoolArray, FloatArray, IntArray

# Coordinates are stored to a picometre: below what arithmetic differs by
# between processors, above what matters.
DIGITS = 9
MIN_SCALED_JACOBIAN = 0.3
# Exceptions of NumPy for a damaged archive of arrays.
_DAMAGE = (OSError, EOFError, KeyError, TypeError, ValueError, zipfile.BadZipFile, zlib.error)


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """`node_mm` ``(N, 2)``, `quad` ``(E, 4)`` rows of nodes, `layer` ``(E,)``.

    `layer` indexes `decks.finger.LAYERS`. Quads run counter-clockwise. The mesh of a user's
    finger is `checked` when it is made; stored meshes have been checked.
    """

    node_mm: FloatArray
    quad: IntArray
    layer: IntArray

    def __post_init__(self) -> None:
        for name, kind in (("node_mm", float), ("quad", np.int64), ("layer", np.int64)):
            array = np.array(getattr(self, name), dtype=kind)
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    def area_mm2(self) -> FloatArray:
        """Area of each quad, ``(E,)``."""
        corner = self.node_mm[self.quad]
        (ax, ay), (bx, by) = (corner[:, 2] - corner[:, 0]).T, (corner[:, 3] - corner[:, 1]).T
        area: FloatArray = 0.5 * (ax * by - ay * bx)
        return area

    def edges(self) -> tuple[IntArray, IntArray, IntArray]:
        """All element edges: nodes ``(4E, 2)``, element and face (0 to 3)."""
        nodes = np.stack([self.quad, np.roll(self.quad, -1, axis=1)], -1).reshape(-1, 2)
        count = len(self.quad)
        return nodes, np.repeat(np.arange(count), 4), np.tile(np.arange(4), count)

    def outline(self) -> tuple[IntArray, IntArray, IntArray]:
        """Edges that belong to one element only, in the form of `edges`."""
        nodes, element, face = self.edges()
        key = nodes.min(axis=1) * len(self.node_mm) + nodes.max(axis=1)
        _, first, count = np.unique(key, return_index=True, return_counts=True)
        rows = np.sort(first[count == 1])
        return nodes[rows], element[rows], face[rows]

    def pad(self) -> IntArray:
        """Rows of the nodes on the pad, the upper half of the outline, from left to right."""
        edge, _, _ = self.outline()
        node = np.unique(edge)
        node = node[self.node_mm[node, 1] > 0.5 * self.node_mm[:, 1].min()]
        ordered: IntArray = node[np.argsort(self.node_mm[node, 0], kind="stable")]
        return ordered

    def with_midsides(self) -> tuple[FloatArray, IntArray]:
        """Nodes ``(M, 2)`` and quads of eight nodes ``(E, 8)``, mid-sides last."""
        nodes, _, _ = self.edges()
        key, edge_of_side = np.unique(np.sort(nodes, axis=1), axis=0, return_inverse=True)
        middle_mm = self.node_mm[key].mean(axis=1)
        midside = len(self.node_mm) + edge_of_side.reshape(-1, 4)
        return np.concatenate([self.node_mm, middle_mm]), np.concatenate(
            [self.quad, midside], axis=1
        )

    def in_layer(self, layer: str) -> BoolArray:
        """Which elements ``(E,)`` belong to `layer`."""
        inside: BoolArray = self.layer == LAYERS.index(layer)
        return inside

    def node_at(self, site: AfferentSite) -> int:
        """Row of the node that lies nearest to `site`, all of its elements in that layer.

        Raises
        ------
        FingerError
            The layer has no inner node, or none within 0.3 mm of the site.
        """
        inside = self.in_layer(site.layer)
        rows = np.setdiff1d(self.quad[inside], self.quad[~inside])
        if not rows.size:
            raise FingerError(
                f"has no node inside {site.layer}: use more rows there",
                argument="resolution",
                found=site.layer,
            )
        site_mm = np.array([site.x_mm, -site.depth_mm])
        distance_mm = np.linalg.norm(self.node_mm[rows] - site_mm, axis=1)
        nearest = int(distance_mm.argmin())
        if distance_mm[nearest] > 0.3:
            raise FingerError(
                f"the node of {site.layer} nearest ({site.x_mm:g}, {-site.depth_mm:g}) "
                f"mm is {distance_mm[nearest]:.2f} mm away, expected within 0.3 mm",
                found=float(distance_mm[nearest]),
                expected="within 0.3 mm",
            )
        return int(rows[nearest])

    def checked(self) -> "Mesh":
        """The mesh itself, if its quads are sound and make one piece without holes.

        A section cut into elements has ``nodes - edges + elements = 1`` (Euler). A hole, a
        slit, a second piece, a node that hangs on an edge or on nothing make another sum.

        Raises
        ------
        FingerError
            A quad is clockwise, folded or too skewed, or the sum is not 1.
        """
        worst = scaled_jacobian(self.node_mm, self.quad)
        row = int(worst.argmin())
        if not worst[row] >= MIN_SCALED_JACOBIAN:
            x, y = self.node_mm[self.quad[row]].mean(axis=0)
            fault = "too skewed"
            if worst[row] <= 0:
                fault = "clockwise" if self.area_mm2()[row] < 0 else "folded"
            raise FingerError(
                f"element {row + 1} at ({x:.3f}, {y:.3f}) mm is {fault}: scaled "
                f"Jacobian {worst[row]:.2f}, expected {MIN_SCALED_JACOBIAN} or more"
            )
        edges = np.unique(np.sort(self.edges()[0], axis=1), axis=0)
        if len(self.node_mm) - len(edges) + len(self.quad) != 1:
            raise FingerError("the elements are not one piece: layers leave a gap")
        return self


def write_mesh(path: Path, mesh: Mesh) -> None:
    """Store `mesh` as NPZ; the same mesh gives the same bytes."""
    with replacing(path) as draft, draft.open("wb") as file:
        np.savez_compressed(
            file,
            node_mm=mesh.node_mm,
            quad=mesh.quad.astype(np.int32),
            layer=mesh.layer.astype(np.int8),
        )


def read_mesh(path: Path) -> Mesh:
    """Read a mesh that `write_mesh` stored.

    Raises
    ------
    FingerError
        The file is missing or damaged.
    """
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            arrays = [stored[name] for name in ("node_mm", "quad", "layer")]
        return Mesh(*arrays)
    except _DAMAGE as error:
        raise FingerError(f"not a stored mesh: {error}", path) from error


def scaled_jacobian(node_mm: FloatArray, quad: IntArray) -> FloatArray:
    """Worst corner of each quad ``(E,)``: 1 is a rectangle, <= 0 is folded."""
    corner = node_mm[quad]
    forward = np.roll(corner, -1, axis=1) - corner
    backward = np.roll(corner, 1, axis=1) - corner
    cross = forward[..., 0] * backward[..., 1] - forward[..., 1] * backward[..., 0]
    length = np.linalg.norm(forward, axis=2) * np.linalg.norm(backward, axis=2)
    with np.errstate(invalid="ignore", divide="ignore"):
        worst: FloatArray = np.nan_to_num(cross / length, nan=-1.0).min(axis=1)
    return worst


# ---- Three times finer around a point, all quadrilaterals, nothing hanging. An edge with both
# ends in the fine region is cut in three. An element there becomes nine; one with one side
# there becomes four, wider towards the far side; all others stay. So each layer keeps its
# outline, and the mesh is that of before elsewhere.


def refined(mesh: Mesh, center_mm: tuple[float, float], radius_mm: float) -> Mesh:
    """Elements with a node within `radius_mm` of `center_mm` cut in three both ways.

    Raises
    ------
    FingerError
        An element beside the fine ones is too skewed.
    """
    near = np.linalg.norm(mesh.node_mm - np.array(center_mm), axis=1) <= radius_mm
    fine = _fine_nodes(mesh.quad, near)
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
    return Mesh(np.array(cut.node_mm), np.array(quads), np.array(layers)).checked()


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
        self.node_mm = list(node_mm)
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
        a_mm, b_mm, c_mm, d_mm = (self.node_mm[node] for node in (a, b, c, d))
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
            a_mm, b_mm = self.node_mm[start], self.node_mm[end]
            pair = self._add((2 * a_mm + b_mm) / 3), self._add((a_mm + 2 * b_mm) / 3)
            self._edges[start, end], self._edges[end, start] = pair, pair[::-1]
        return self._edges[start, end]

    def _inside(self, quad: tuple[int, ...], s: float, t: float) -> int:
        """A new node inside `quad`: `s` along its first side, `t` across."""
        a_mm, b_mm, c_mm, d_mm = (self.node_mm[node] for node in quad)
        near_mm, far_mm = (1 - s) * a_mm + s * b_mm, (1 - s) * d_mm + s * c_mm
        return self._add((1 - t) * near_mm + t * far_mm)

    def _add(self, point_mm: FloatArray) -> int:
        self.node_mm.append(np.round(point_mm, DIGITS) + 0.0)
        return len(self.node_mm) - 1
