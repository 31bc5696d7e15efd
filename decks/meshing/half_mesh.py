"""The right half of a mesh, before it is mirrored: arrays as the mesher left them."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from decks.finger import LAYERS, AfferentSite
from decks.meshing.mesh import Mesh
from decks.meshing.mesh_checks import MIN_SCALED_JACOBIAN, scaled_jacobian
from fembridge.typing import BoolArray, FloatArray, IntArray

# Closer to x = 0 than this is on it.
_ON_AXIS_MM = 1e-7
# A node that moves less than this share of its shortest edge folds nothing.
_ALONE_SHARE = 0.45
# A longer way fades out over this many times its length.
_REACH_WAYS = 6.0
# Coordinates are stored to a picometre: below what arithmetic differs by
# between processors, above what matters.
DIGITS = 9


@dataclass(frozen=True, slots=True, eq=False)
class HalfMesh:
    """`node_mm` ``(N, 2)`` with x >= 0, `quad` ``(E, 4)``, `layer` ``(E,)``."""

    node_mm: FloatArray
    quad: IntArray
    layer: IntArray

    def snapped(self, sites: Iterable[AfferentSite]) -> "HalfMesh":
        """Move the nearest inner node of each site's layer onto the site.

        So an afferent sits at the same point whatever the resolution. A node
        with a short way goes alone; with a longer one it takes the nodes of its
        layer around it along, the less the further they are. On the axis nodes
        stay on the axis, and the layer's boundaries stay where they are. Where
        the elements would not bear it nothing moves.
        """
        half = self
        taken: list[int] = []
        for site in sites:
            half, row = half._snapped(site, taken)
            if row is not None:
                taken.append(row)
        return half

    def mirrored(self) -> Mesh:
        """Join with the mirror image; number nodes from the pad inwards."""
        node_mm = self.node_mm.copy()
        on_axis = np.abs(node_mm[:, 0]) < _ON_AXIS_MM
        node_mm[on_axis, 0] = 0.0
        count = len(node_mm)
        image = np.where(on_axis, np.arange(count), count + np.cumsum(~on_axis) - 1)
        quad = self._counter_clockwise()
        nodes = np.concatenate([node_mm, node_mm[~on_axis] * [-1.0, 1.0]])
        quads = np.concatenate([quad, image[quad][:, ::-1]])
        layers = np.concatenate([self.layer, self.layer])
        order = np.lexsort((nodes[:, 0], -nodes[:, 1]))
        new_row = np.empty_like(order)
        new_row[order] = np.arange(len(order))
        quads = new_row[quads]
        first = quads.argmin(axis=1)
        quads = np.take_along_axis(quads, (first[:, None] + np.arange(4)) % 4, axis=1)
        sort = np.lexsort((quads[:, 0], layers))
        return Mesh(nodes[order], quads[sort], layers[sort])

    def _snapped(self, site: AfferentSite, taken: list[int]) -> tuple["HalfMesh", int | None]:
        """Do it for one site; also give the node, and leave those `taken` alone."""
        mine = self.layer == LAYERS.index(site.layer)
        inner = np.setdiff1d(self.quad[mine], self.quad[~mine])
        wanted = np.array([abs(site.x_mm), -site.depth_mm])
        wanted[0] *= wanted[0] >= _ON_AXIS_MM
        there = (self.node_mm[taken] == wanted).all(axis=1)
        inner = np.setdiff1d(inner, taken)
        like = inner[self._on_axis(inner) == (wanted[0] < _ON_AXIS_MM)]
        if there.any() or not like.size:
            return self, None
        row = int(like[np.linalg.norm(self.node_mm[like] - wanted, axis=1).argmin()])
        way_mm = wanted - self.node_mm[row]
        alone = self.node_mm.copy()
        around = self._spread(inner, row, way_mm)
        near = np.linalg.norm(way_mm) <= _ALONE_SHARE * self._shortest_edge_mm(row)
        for node_mm in (alone, around) if near else (around,):
            node_mm[row] = wanted
            if self._bears(node_mm):
                return HalfMesh(node_mm, self.quad, self.layer), row
        return self, None

    def _spread(self, inner: IntArray, row: int, way_mm: FloatArray) -> FloatArray:
        """Move `row` by `way_mm` and what is around it by less; give all nodes."""
        reach_mm = max(_REACH_WAYS * float(np.linalg.norm(way_mm)), _ON_AXIS_MM)
        away_mm = np.linalg.norm(self.node_mm[inner] - self.node_mm[row], axis=1)
        share = np.clip(1 - away_mm / reach_mm, 0.0, None)
        node_mm = self.node_mm.copy()
        on_axis = self._on_axis(inner)
        node_mm[inner] = np.round(node_mm[inner] + share[:, None] * way_mm, DIGITS)
        node_mm[inner[on_axis], 0] = self.node_mm[inner[on_axis], 0]
        return node_mm

    def _on_axis(self, rows: IntArray) -> BoolArray:
        on_axis: BoolArray = np.abs(self.node_mm[rows, 0]) < _ON_AXIS_MM
        return on_axis

    def _bears(self, node_mm: FloatArray) -> bool:
        """Whether the elements are sound with the nodes at `node_mm`."""
        worst = scaled_jacobian(node_mm, self._counter_clockwise())
        return bool(worst.min() >= MIN_SCALED_JACOBIAN)

    def _shortest_edge_mm(self, row: int) -> float:
        around = self.quad[(self.quad == row).any(axis=1)]
        edges = np.stack([around, np.roll(around, -1, axis=1)], -1).reshape(-1, 2)
        start, end = self.node_mm[edges[(edges == row).any(axis=1)]].swapaxes(0, 1)
        return float(np.linalg.norm(start - end, axis=1).min())

    def _counter_clockwise(self) -> IntArray:
        corner = self.node_mm[self.quad]
        ahead, across = corner[:, 2] - corner[:, 0], corner[:, 3] - corner[:, 1]
        clockwise = ahead[:, 0] * across[:, 1] - ahead[:, 1] * across[:, 0] < 0
        return np.where(clockwise[:, None], self.quad[:, ::-1], self.quad)
