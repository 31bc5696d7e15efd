"""How the values at integration points make up the value at a node.

A node's value is the mean over the elements there, each extrapolated to it; it can be
had of all of them, or layer by layer. An element that has the node twice (a
quadrilateral that is collapsed to a triangle) counts once, with the mean of its two
corners.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.extrapolation import DOCUMENTED, ELEMENT_TYPES, node_weights
from fembridge.results.marc_format.content import PostMesh
from fembridge.results.marc_nodes.layer import Layers
from fembridge.typing import FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """The elements of one layer at a node.

    `element_rows` ``(K,)`` are theirs in the mesh; `weights` ``(K, point)`` make the
    node's value: multiply and sum over both.
    """

    node: int
    layer: int
    element_rows: IntArray
    weights: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Corners:
    """Elements of one type, and the corners of theirs that have values.

    `element_rows` ``(K,)``, `nodes` ``(K, corner)`` their numbers, `weights`
    ``(corner, point)``, `once` ``(K, corner)``: 1, or 1/2 where an element has the
    node at two corners.
    """

    number: int
    element_rows: IntArray
    nodes: IntArray
    weights: FloatArray
    once: FloatArray


def corners_of(
    mesh: PostMesh, rows: IntArray, stored: int, method: str, path: Path
) -> Iterator[Corners]:
    """Give the elements at `rows`, type by type.

    Raises
    ------
    ResultError
        The points of an element type are not known, see `extrapolation.node_weights`;
        as for `check_nodes`.
    """
    types = mesh.element_types[rows]
    counts = (mesh.connectivity[rows] != 0).sum(axis=1)
    keys = np.stack([types, counts], axis=1)
    for number, count in np.unique(keys, axis=0).tolist():
        some = rows[(keys == (number, count)).all(axis=1)]
        try:
            weights = node_weights(number, count, stored, method)
        except ValueError as error:
            raise ResultError(f"element {mesh.element_ids[some[0]]}: {error}", path) from error
        nodes = mesh.connectivity[some][:, : len(weights)]
        check_nodes(mesh, some, nodes, path)
        times = (nodes[:, :, None] == nodes[:, None, :]).sum(axis=2)
        yield Corners(number, some, nodes, weights, 1.0 / times)


def check_nodes(mesh: PostMesh, rows: IntArray, nodes: IntArray, path: Path) -> None:
    """Make sure that the corners `nodes` ``(K, corner)`` of elements are nodes.

    Raises
    ------
    ResultError
        One is not in the file's list of nodes.
    """
    absent = np.argwhere(~np.isin(nodes, mesh.node_ids))
    if absent.size:
        k, corner = absent[0]
        raise ResultError(
            f"element {mesh.element_ids[rows[k]]} has node {nodes[k, corner]}, which "
            "has no coordinates in the file",
            path,
        )


def sides_of(
    mesh: PostMesh, layers: Layers, nodes: Sequence[int], stored: int, method: str, path: Path
) -> list[list[Side]]:
    """Give the sides of each node, lowest layer first.

    Raises
    ------
    ResultError
        A node is not in the mesh, or is a corner of no element that has values; as
        for `corners_of`.
    """
    touched = np.flatnonzero(np.isin(mesh.connectivity, nodes).any(axis=1))
    found: dict[int, list[tuple[int, int, FloatArray]]] = {node: [] for node in nodes}
    for corners in corners_of(mesh, touched, stored, method, path):
        here = np.isin(corners.nodes, nodes)
        for k in np.flatnonzero(here.any(axis=1)).tolist():
            row = int(corners.element_rows[k])
            for node in np.unique(corners.nodes[k][here[k]]).tolist():
                at = corners.nodes[k] == node
                weights = corners.weights[at].mean(axis=0)
                found[node].append((int(layers.layer[row]), row, weights))
    return [_sides(mesh, node, found[node], path) for node in nodes]


def remarks_on(mesh: PostMesh, rows: IntArray, stored: int) -> list[str]:
    """Tell what was inferred about the elements at `rows`, in words."""
    words = []
    for number in np.unique(mesh.element_types[rows]).tolist():
        about = ELEMENT_TYPES.get(number)
        if about is None:
            words.append(f"element type {number} is not known: the mean of its points")
            continue
        if number not in DOCUMENTED and about.points > 1:
            words.append(
                f"element type {number}: count and order of its integration points "
                "are inferred from its kin"
            )
        if stored == 1 < about.points:
            words.append(
                f"element type {number} has {about.points} integration points, the "
                "file stores 1: taken as the element's mean (the deck has no "
                "'all points')"
            )
        if stored > about.points:
            words.append(
                f"element type {number} has {about.points} integration points, the "
                f"file stores {stored} for each element: the first {about.points} taken"
            )
    return words


def _sides(
    mesh: PostMesh, node: int, found: list[tuple[int, int, FloatArray]], path: Path
) -> list[Side]:
    if not found:
        known = mesh.node_ids
        if node not in known:
            near = np.sort(known[np.argsort(np.abs(known - node), kind="stable")[:3]])
            words = f"it has {known.min()} to {known.max()}" if known.size else "none"
            close = f", near it {', '.join(map(str, near.tolist()))}" if known.size else ""
            raise ResultError(f"no node {node} in the mesh: {words}{close}", path)
        raise ResultError(
            f"node {node} is a corner of no element with values: a pressure node, or "
            "one that stands alone",
            path,
        )
    sides = []
    for layer in sorted({layer for layer, _, _ in found}):
        mine = [(row, weights) for number, row, weights in found if number == layer]
        mine.sort(key=lambda pair: pair[0])
        weights = np.array([weights for _, weights in mine]) / len(mine)
        rows = np.array([row for row, _ in mine], dtype=np.int64)
        sides.append(Side(node, layer, rows, weights))
    return sides
