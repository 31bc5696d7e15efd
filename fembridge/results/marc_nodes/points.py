"""All nodes of a mesh at once: values of elements averaged within each layer.

A point is a node as one layer has it; a node between layers is several points. For
pictures all of them are kept; a table of nodes has those that lie in one layer, or the
mean where that is asked for.
"""

from pathlib import Path

import numpy as np

from fembridge.results.extrapolation import ELEMENT_TYPES
from fembridge.results.field_source import Scene, SceneCells
from fembridge.results.marc_format.content import PostMesh
from fembridge.results.marc_nodes.layer import Layers, layers_of
from fembridge.results.marc_nodes.share import check_nodes, corners_of
from fembridge.typing import BoolArray, FloatArray, IntArray

_KINDS = {
    "quad4": "qu4", "quad8": "qu8", "tri3": "tr3", "tri6": "tr6", "hex8": "he8",
    "hex20": "he20", "tet4": "te4", "tet10": "te10", "wedge6": "pe6",
}  # fmt: skip
# Marc has the mid-sides of a brick's top before those between; a .frd behind them.
_ORDERS = {"hex20": [*range(12), *range(16, 20), *range(12, 16)]}


class MeshPoints:
    """The points of `mesh`: `nodes` ``(P,)`` and `layer` ``(P,)`` of each.

    They stand by layer, then by the row of the node.

    Raises
    ------
    ResultError
        An element has a node that the file does not list.
    """

    def __init__(self, mesh: PostMesh, path: Path) -> None:
        self.mesh = mesh
        self.layers: Layers = layers_of(mesh, path)
        self._order = np.argsort(mesh.node_ids, kind="stable")
        self._known = np.isin(mesh.element_types, list(ELEMENT_TYPES))
        size = mesh.node_ids.size
        for _, rows, nodes in self._shapes():
            check_nodes(mesh, rows, nodes, path)
        keys = [
            self.layers.layer[rows, None] * size + self.rows_of(nodes)
            for _, rows, nodes in self._shapes()
        ]
        flat = [key.ravel() for key in keys] or [np.empty(0, dtype=np.int64)]
        self._keys: IntArray = np.unique(np.concatenate(flat))
        self.rows: IntArray = self._keys % max(size, 1)
        self.layer: IntArray = self._keys // max(size, 1)
        self.nodes: IntArray = mesh.node_ids[self.rows]

    @property
    def unknown_types(self) -> list[int]:
        """Element types that are not drawn: their shape is not known here."""
        return [int(n) for n in np.unique(self.mesh.element_types[~self._known])]

    @property
    def bearing(self) -> BoolArray:
        """Which nodes of the mesh are corners of elements with values, ``(N,)``."""
        found = np.zeros(self.mesh.node_ids.size, dtype=bool)
        found[self.rows] = True
        return found

    @property
    def met(self) -> IntArray:
        """How many layers meet at the node of each point, ``(P,)``."""
        counts = np.bincount(self.rows, minlength=self.mesh.node_ids.size)
        return counts[self.rows]

    def rows_of(self, nodes: IntArray) -> IntArray:
        """Row in the mesh of each node number, any shape."""
        place = np.searchsorted(self.mesh.node_ids, nodes, sorter=self._order)
        rows: IntArray = self._order[np.minimum(place, self._order.size - 1)]
        return rows

    def scene(self) -> Scene:
        """Give the mesh as pictures want it."""
        size = self.mesh.node_ids.size
        cells = []
        for shape, rows, nodes in self._shapes():
            layer = self.layers.layer[rows]
            keys = layer[:, None] * size + self.rows_of(nodes)
            corners = np.searchsorted(self._keys, keys)
            order = _ORDERS.get(shape, slice(None))
            cells.append(
                SceneCells(_KINDS[shape], self.mesh.element_ids[rows], layer, corners[:, order])
            )
        return Scene(
            points_mm=self.mesh.coordinates_mm[self.rows],
            nodes=self.nodes,
            cells=tuple(cells),
            met=self.met,
            materials=dict(enumerate(self.layers.names)),
        )

    def averaged(self, values: FloatArray, method: str, path: Path) -> FloatArray:
        """Carry ``(E, point, C)`` to the points and average there, ``(P, C)``.

        Raises
        ------
        ResultError
            An element type whose points are not known, see `share.corners_of`.
        """
        total = np.zeros((self._keys.size, values.shape[2]))
        count = np.zeros(self._keys.size)
        every = np.arange(self.mesh.element_ids.size)
        size = self.mesh.node_ids.size
        for some in corners_of(self.mesh, every, values.shape[1], method, path):
            if some.number not in ELEMENT_TYPES:
                continue  # its nodes are no points
            used = (some.weights != 0).any(axis=0)
            at_points = values[some.element_rows][:, used]
            carried = np.einsum("np,kpc->knc", some.weights[:, used], at_points)
            keys = self.layers.layer[some.element_rows, None] * size + self.rows_of(some.nodes)
            at = np.searchsorted(self._keys, keys).ravel()
            count += np.bincount(at, some.once.ravel(), count.size)
            for column in range(values.shape[2]):
                share = (carried[:, :, column] * some.once).ravel()
                total[:, column] += np.bincount(at, share, count.size)
        return total / count[:, None]

    def elements_at(self) -> FloatArray:
        """How many elements of its layer each point has, ``(P,)``."""
        count = np.zeros(self._keys.size)
        size = self.mesh.node_ids.size
        for _, rows, nodes in self._shapes():
            times = (nodes[:, :, None] == nodes[:, None, :]).sum(axis=2)
            keys = self.layers.layer[rows, None] * size + self.rows_of(nodes)
            at = np.searchsorted(self._keys, keys).ravel()
            count += np.bincount(at, (1.0 / times).ravel(), count.size)
        return count

    def _shapes(self) -> list[tuple[str, IntArray, IntArray]]:
        """Shape, rows and nodes of the elements, type by type."""
        found = []
        for number in np.unique(self.mesh.element_types[self._known]).tolist():
            about = ELEMENT_TYPES[number]
            rows = np.flatnonzero(self.mesh.element_types == number)
            whole = self.mesh.connectivity[rows][:, : about.nodes]
            fine = (whole != 0).sum(axis=1) == about.nodes
            found.append((about.shape, rows[fine], whole[fine]))
        return found
