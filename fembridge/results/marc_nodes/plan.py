"""What to read for the stress at chosen nodes, and how to add it up.

The elements at the nodes are found once for each mesh of the file; then an increment
costs the values of those few elements.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.marc_format.content import PostMesh
from fembridge.results.marc_nodes.layer import Layers
from fembridge.results.marc_nodes.share import Side, remarks_on, sides_of
from fembridge.typing import FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Elements to read, `element_rows` ``(K,)``, and `weights` ``(S, K, point)``.

    One of the ``S`` is a node, or a node's side in one layer: `sides` are the parts
    that each is made of. `places` tells what the elements are, so that two meshes
    can be held against each other.
    """

    element_rows: IntArray
    weights: FloatArray
    sides: tuple[tuple[Side, ...], ...]
    places: FloatArray
    remarks: tuple[str, ...]

    @property
    def nodes(self) -> list[int]:
        """The node of each of the ``S``."""
        return [parts[0].node for parts in self.sides]

    def add_up(self, values: FloatArray) -> FloatArray:
        """Give ``(S, C)`` of the values ``(K, point, C)`` at the points.

        A point that no node looks at may hold anything, NaN too.
        """
        used = (self.weights != 0).any(axis=0)
        clean = np.where(used[:, :, None], values, 0.0)
        total: FloatArray = np.einsum("skp,kpc->sc", self.weights, clean)
        return total

    def same_as(self, other: "Plan") -> bool:
        """Whether both read the same elements at the same places."""
        return np.array_equal(self.places, other.places)


def plan_nodes(
    mesh: PostMesh,
    layers: Layers,
    nodes: Sequence[int],
    stored: int,
    method: str,
    path: Path,
    *,
    across_materials: bool = False,
) -> Plan:
    """Plan one value a node, of one layer unless `across_materials`.

    Raises
    ------
    ResultError
        A node lies between layers, is not in the mesh, or at no element with values;
        an element's points are not known.
    """
    found = sides_of(mesh, layers, nodes, stored, method, path)
    for node, sides in zip(nodes, found, strict=True):
        if len(sides) > 1 and not across_materials:
            names = " and ".join(layers.names[side.layer] for side in sides)
            raise ResultError(
                f"node {node} lies between {names}: a mean over both belongs to "
                "neither; take a node inside one layer, each side with --one-sided, "
                "or the mean with --across-materials (across_materials=True)",
                path,
            )
    return _plan(mesh, [tuple(sides) for sides in found], stored)


def plan_sides(
    mesh: PostMesh, layers: Layers, node: int, stored: int, method: str, path: Path
) -> Plan:
    """Plan one value a layer at `node`, lowest layer first; raises as `plan_nodes`."""
    (sides,) = sides_of(mesh, layers, [node], stored, method, path)
    return _plan(mesh, [(side,) for side in sides], stored)


def _plan(mesh: PostMesh, parts: list[tuple[Side, ...]], stored: int) -> Plan:
    rows = np.unique(np.concatenate([side.element_rows for sides in parts for side in sides]))
    weights = np.zeros((len(parts), rows.size, stored))
    for share, sides in zip(weights, parts, strict=True):
        total = sum(side.element_rows.size for side in sides)
        for side in sides:
            at = np.searchsorted(rows, side.element_rows)
            share[at] = side.weights * (side.element_rows.size / total)
    nodes = mesh.connectivity[rows]
    order = np.argsort(mesh.node_ids, kind="stable")
    place = np.searchsorted(mesh.node_ids, nodes, sorter=order)
    at_mm = mesh.coordinates_mm[order[np.minimum(place, order.size - 1)]]
    at_mm = np.where((nodes != 0)[:, :, None], at_mm, 0.0)
    told = np.hstack([mesh.element_types[rows, None], nodes, at_mm.reshape(rows.size, -1)])
    return Plan(rows, weights, tuple(parts), told, tuple(remarks_on(mesh, rows, stored)))
