"""The right half of a mesh, before it is mirrored: arrays as the mesher left them."""

from dataclasses import dataclass

import numpy as np

from decks.finger import LAYERS, AfferentSite
from decks.mesh import Mesh
from fembridge.typing import FloatArray, IntArray

# Closer to x = 0 than this is on it.
_ON_AXIS_MM = 1e-7
# A node that moves less than this share of its shortest edge folds nothing.
_SNAP_SHARE = 0.45


@dataclass(frozen=True, slots=True, eq=False)
class HalfMesh:
    """`node_mm` ``(N, 2)`` with x >= 0, `quad` ``(E, 4)``, `layer` ``(E,)``."""

    node_mm: FloatArray
    quad: IntArray
    layer: IntArray

    def snapped(self, site: AfferentSite) -> "HalfMesh":
        """Move the nearest inner node of the site's layer onto the site.

        So an afferent sits at the same point whatever the resolution. A node
        that is further away stays, as does one on the axis where the site is
        not; `Mesh` checks the shapes.
        """
        mine = self.layer == LAYERS.index(site.layer)
        inner = np.setdiff1d(self.quad[mine], self.quad[~mine])
        if not inner.size:
            return self
        wanted = np.array([abs(site.x_mm), -site.depth_mm])
        away_mm = np.linalg.norm(self.node_mm[inner] - wanted, axis=1)
        row = int(inner[away_mm.argmin()])
        if (self.node_mm[row, 0] < _ON_AXIS_MM) != (wanted[0] < _ON_AXIS_MM):
            return self
        if not away_mm.min() <= _SNAP_SHARE * self._shortest_edge_mm(row):
            return self
        node_mm = self.node_mm.copy()
        node_mm[row] = wanted
        return HalfMesh(node_mm, self.quad, self.layer)

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
