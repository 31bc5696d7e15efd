"""A mesh of quadrilaterals in layers, checked when made.

Rows count from 0 here; a deck numbers nodes and elements from 1.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from decks.finger import LAYERS, AfferentSite
from fembridge.errors import FingerError
from fembridge.typing import BoolArray, FloatArray, IntArray

MIN_SCALED_JACOBIAN = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """`node_mm` ``(N, 2)``, `quad` ``(E, 4)`` rows of nodes, `layer` ``(E,)``.

    `layer` indexes `decks.finger.LAYERS`. Quads run counter-clockwise.

    Raises
    ------
    FingerError
        A quad that is clockwise, folded or too skewed, a node that no element
        uses, two nodes in one place, or a section with a gap or an overlap.
    """

    node_mm: FloatArray
    quad: IntArray
    layer: IntArray

    def __post_init__(self) -> None:
        for name, kind in (("node_mm", float), ("quad", np.int64), ("layer", np.int64)):
            array = np.array(getattr(self, name), dtype=kind)
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        if self.quad.ndim != 2 or self.quad.shape[1] != 4 or not len(self.quad):
            raise FingerError(f"expected quads (E, 4), got {self.quad.shape}")
        used = np.bincount(self.quad.ravel(), minlength=len(self.node_mm))
        if len(used) > len(self.node_mm) or not used.all():
            raise FingerError("a mesh whose elements and nodes do not belong together")
        worst = self.scaled_jacobian()
        row = int(worst.argmin())
        if not worst[row] >= MIN_SCALED_JACOBIAN:
            x, y = self.node_mm[self.quad[row]].mean(axis=0)
            raise FingerError(
                f"element {row + 1} at ({x:.3f}, {y:.3f}) mm has scaled Jacobian "
                f"{worst[row]:.2f}, expected {MIN_SCALED_JACOBIAN} or more"
            )
        self._check_cover()

    def scaled_jacobian(self) -> FloatArray:
        """Worst corner of each quad ``(E,)``: 1 is a rectangle, <= 0 is folded."""
        corner = self.node_mm[self.quad]
        ahead = np.roll(corner, -1, axis=1) - corner
        back = np.roll(corner, 1, axis=1) - corner
        cross = ahead[..., 0] * back[..., 1] - ahead[..., 1] * back[..., 0]
        length = np.linalg.norm(ahead, axis=2) * np.linalg.norm(back, axis=2)
        with np.errstate(invalid="ignore", divide="ignore"):
            worst: FloatArray = np.nan_to_num(cross / length, nan=-1.0).min(axis=1)
        return worst

    def area_mm2(self) -> FloatArray:
        """Area of each quad, ``(E,)``."""
        corner = self.node_mm[self.quad]
        diagonal = corner[:, 2] - corner[:, 0], corner[:, 3] - corner[:, 1]
        area: FloatArray = 0.5 * (
            diagonal[0][:, 0] * diagonal[1][:, 1]
            - diagonal[0][:, 1] * diagonal[1][:, 0]
        )
        return area

    def edges(self) -> tuple[IntArray, IntArray, IntArray]:
        """Give all element edges: nodes ``(4E, 2)``, element and face (0 to 3)."""
        nodes = np.stack([self.quad, np.roll(self.quad, -1, axis=1)], -1).reshape(-1, 2)
        count = len(self.quad)
        return nodes, np.repeat(np.arange(count), 4), np.tile(np.arange(4), count)

    def outline(self) -> tuple[IntArray, IntArray, IntArray]:
        """Give the edges that one element alone has, as `edges` does."""
        nodes, element, face = self.edges()
        key = np.sort(nodes, axis=1)
        _, first, count = np.unique(key, axis=0, return_index=True, return_counts=True)
        rows = np.sort(first[count == 1])
        return nodes[rows], element[rows], face[rows]

    def with_midsides(self) -> tuple[FloatArray, IntArray]:
        """Nodes ``(M, 2)`` and quads of eight nodes ``(E, 8)``, mid-sides last."""
        nodes, _, _ = self.edges()
        key, which = np.unique(np.sort(nodes, axis=1), axis=0, return_inverse=True)
        middle_mm = self.node_mm[key].mean(axis=1)
        midside = len(self.node_mm) + which.reshape(-1, 4)
        return np.concatenate([self.node_mm, middle_mm]), np.concatenate(
            [self.quad, midside], axis=1
        )

    def in_layer(self, layer: str) -> BoolArray:
        """Which elements ``(E,)`` belong to `layer`."""
        inside: BoolArray = self.layer == LAYERS.index(layer)
        return inside

    def nodes_inside(self, layer: str) -> IntArray:
        """Nodes whose every element belongs to `layer`."""
        inside = self.in_layer(layer)
        wanted = np.zeros(len(self.node_mm), dtype=bool)
        wanted[self.quad[inside]] = True
        wanted[self.quad[~inside]] = False
        return np.flatnonzero(wanted)

    def node_at(self, site: AfferentSite) -> int:
        """Row of the node inside `site`'s layer that lies nearest to it.

        Raises
        ------
        FingerError
            The layer has no inner node, or none within 0.3 mm of the site.
        """
        rows = self.nodes_inside(site.layer)
        if not rows.size:
            raise FingerError(f"no node lies inside {site.layer}: use more rows there")
        wanted = np.array([site.x_mm, -site.depth_mm])
        distance_mm = np.linalg.norm(self.node_mm[rows] - wanted, axis=1)
        nearest = int(distance_mm.argmin())
        if distance_mm[nearest] > 0.3:
            raise FingerError(
                f"the node of {site.layer} nearest ({site.x_mm:g}, {-site.depth_mm:g}) "
                f"mm is {distance_mm[nearest]:.2f} mm away, expected within 0.3 mm"
            )
        return int(rows[nearest])

    def _check_cover(self) -> None:
        """The outline is one closed line, and the elements fill what it encloses."""
        nodes, _, _ = self.edges()
        _, count = np.unique(np.sort(nodes, axis=1), axis=0, return_counts=True)
        if count.max() > 2:
            raise FingerError("an edge with more than two elements: layers overlap")
        edge, _, _ = self.outline()
        following: dict[int, int] = dict(edge.tolist())
        ring = _ring(following, start=int(edge[0, 0]))
        if len(ring) != len(edge) or len(following) != len(edge):
            raise FingerError("the outline is not one closed line: layers leave a gap")
        x, y = self.node_mm[ring].T
        enclosed_mm2 = 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
        filled_mm2 = float(self.area_mm2().sum())
        if not abs(enclosed_mm2 - filled_mm2) <= 1e-9 * abs(enclosed_mm2):
            raise FingerError(
                f"the elements fill {filled_mm2:.6f} mm2 of the {enclosed_mm2:.6f} mm2 "
                "inside the outline"
            )


def _ring(following: dict[int, int], start: int) -> list[int]:
    ring = [start]
    while (node := following.get(ring[-1], start)) != start:
        ring.append(node)
        if len(ring) > len(following):
            break
    return ring


def write_mesh(path: Path, mesh: Mesh) -> None:
    """Store `mesh` as NPZ; the same mesh gives the same bytes."""
    from fembridge.outputs import replacing

    with replacing(path) as draft:
        np.savez_compressed(
            draft,
            node_mm=mesh.node_mm,
            quad=mesh.quad.astype(np.int32),
            layer=mesh.layer.astype(np.int8),
        )


def read_mesh(path: Path) -> Mesh:
    """Read a mesh that `write_mesh` stored."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            return Mesh(stored["node_mm"], stored["quad"], stored["layer"])
    except (OSError, KeyError, ValueError) as error:
        raise FingerError(f"{path}: not a stored mesh: {error}") from error
