"""Extrapolation from integration points to nodes, and means over the elements of a layer.

Marc stores stress at integration points, CalculiX prints it there. The methods have Mentat's
names:

``linear``     a straight line from the mean over the element's points through the nearest point
               (the mean of equally near ones): exact for stress linear in the element, and the
               rule of Marc
``translate``  the value of the nearest point; the mean of equally near points
``average``    the mean over the element's points

Marc's manuals do not state its rule. It was derived from the nodal print of a public model of two
bricks (github.com/nightly/fedes, ``models/Example-3D-beam-small``, ``Model1-output-Marc.70`` and
its ``.t19``): at all 12 nodes the tensor follows this rule, averaged over the elements. The
constant in the print is 1.73, for sqrt(3), to its five digits, times an unexplained factor of
0.9992 to 1.0033 at each node; with sqrt(3) the result is within 0.21 % of the greatest component
and 0.19 % of each von Mises stress. The polynomial through the points, trilinear in a brick,
differs by 7 %. Quadrilaterals and quadratic elements are assumed to follow the same rule; wedges,
whose points lie on no such line, use their polynomial.

Order of points: xi fastest, then eta, then zeta, from -1 to +1; in triangles, tetrahedra and
wedges point k is next to corner k. This is known for the Marc types in `DOCUMENTED`, and inferred
from related types for the others of `ELEMENT_TYPES`.

The value at a node is the mean of the values extrapolated from its elements, for each layer
separately unless requested otherwise. An element that has the node twice (a quadrilateral
collapsed to a triangle) counts once, with the mean of its two corners.

Post revision 14 has five more numbers for each element. Two of them repeat the number and kind in
the file's list of geometric properties; the first of the others is inferred to be the material.
Elements are in one layer only if all five are equal. Older files lack these numbers: there the
materials in the deck of the same name are used, else the element sets.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fembridge.errors import DeckError, ResultError
from fembridge.results.fields import Scene, SceneCells, numbers_near, rows_of
from fembridge.results.marc_post import PostMesh
from fembridge.typing import BoolArray, FloatArray, IntArray

UNKNOWN_LAYERS = "the materials of the elements are unknown: no ids in the file, no deck, no sets"
_LARGEST_DECK_BYTES = 200_000_000
_DISTANCE_TOLERANCE = 1.0e-9  # in units of an element's local coordinates
_GAUSS = {1: (0.0,), 2: (-(3**-0.5), 3**-0.5), 3: (-(0.6**0.5), 0.0, 0.6**0.5)}
_TRIANGLE, _TETRAHEDRON = (2 / 3, 1 / 6), (0.5854101966249685, 0.1381966011250105)
# Mid-side nodes: the pairs of corners (from 0) at their ends.
_RING = ((0, 1), (1, 2), (2, 3), (3, 0))
_MIDDLES = {
    "quad8": _RING,
    "tri6": ((0, 1), (1, 2), (2, 0)),
    "tet10": ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    "hex20": (
        *_RING, (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7),
    ),
}  # fmt: skip
FRD_ORDER: Mapping[str, list[int]] = {"hex20": [*range(12), *range(16, 20), *range(12, 16)]}
"""Order of a shape's nodes in a ``.frd`` if it differs from Marc's, which has the mid-sides of a
brick's top before those of its vertical edges."""
_SQUARE = ((-1, -1), (1, -1), (1, 1), (-1, 1))
_CUBE = (*((x, y, -1) for x, y in _SQUARE), *((x, y, 1) for x, y in _SQUARE))
_SIDE_POINTS = {1: 1, 8: 2, 27: 3}  # of a brick


@dataclass(frozen=True, slots=True)
class ElementType:
    """An element type of Marc: its `family`, number of `nodes` and of integration `points`.

    `nodes` are the corners and mid-side nodes, which have values; a Herrmann element has pressure
    nodes after them, which have none.
    """

    family: str
    nodes: int
    points: int

    @property
    def shape(self) -> str:
        """Family and number of nodes, such as ``quad4``."""
        return f"{self.family}{self.nodes}"


def _types(family: str, nodes: int, points: int, *numbers: int) -> dict[int, ElementType]:
    return dict.fromkeys(numbers, ElementType(family, nodes, points))


# Marc's numbers of element types whose points are known or inferred.
ELEMENT_TYPES: Mapping[int, ElementType] = {
    **_types("quad", 4, 4, 3, 10, 11, 18, 20, 75, 80, 81, 82, 139),
    **_types("quad", 4, 1, 114, 115, 116, 118, 119, 140),
    **_types("quad", 8, 9, 26, 27, 28, 32, 33),
    **_types("quad", 8, 4, 53, 54, 55, 58, 59),
    **_types("tri", 3, 1, 2, 6, 138, 201),
    **_types("tri", 6, 3, 124, 125, 126, 128, 129),
    **_types("hex", 8, 8, 7, 84),
    **_types("hex", 8, 1, 117, 120),
    **_types("hex", 20, 27, 21, 35),
    **_types("hex", 20, 8, 57, 61),
    **_types("tet", 4, 1, 134),
    **_types("tet", 10, 4, 127, 130),
    **_types("wedge", 6, 6, 136),
}
# Types whose count and order of points are known from a public source or a real file.
DOCUMENTED = frozenset({3, 6, 7, 11, 21, 27, 32, 54, 57, 114, 117, 118, 125, 127, 134,
                        136})  # fmt: skip


def node_weights(number: int, nodes: int, stored: int, method: str) -> FloatArray:
    """Weights ``(node, point)`` from stored points to an element's nodes; rows sum to 1.

    Parameters
    ----------
    number
        Marc's number of the element type.
    nodes
        Number of the element's nodes in the file, with pressure nodes. The first ones have
        values and a row of weights.
    stored
        Number of points that the file stores for each element, that of the type with most; a
        type with fewer points uses the first ones. A single point of a type with more is
        assumed to be the element's mean (the deck then has no ``all points``).
    method
        As in `ReadOptions`.

    Raises
    ------
    ValueError
        The type is unknown and `method` is not "average"; the file stores some of its points
        but not all; the element has too few nodes.
    """
    element_type = ELEMENT_TYPES.get(number)
    if element_type is None:
        if method != "average":
            raise ValueError(
                f"element type {number} has unknown integration points; average "
                "(extrapolate='average') takes their mean"
            )
        return np.full((nodes, stored), 1.0 / stored)
    if nodes < element_type.nodes:
        raise ValueError(f"element type {number} with {nodes} nodes, expected {element_type.nodes}")
    if 1 < stored < element_type.points:
        raise ValueError(
            f"element type {number} has {element_type.points} integration points, of which the "
            f"file stores {stored} unknown ones"
        )
    used = min(stored, element_type.points)
    weights = np.zeros((element_type.nodes, stored))
    if method == "average" or used == 1:
        weights[:, :used] = 1.0 / used
        return weights
    node_coordinates, point_coordinates = (
        node_positions(element_type),
        point_positions(element_type.family, used),
    )
    if method == "linear" and element_type.family == "wedge":
        weights[:, :used] = _wedge_terms(node_coordinates) @ np.linalg.inv(
            _wedge_terms(point_coordinates)
        )
        return weights
    distances = np.linalg.norm(node_coordinates[:, None, :] - point_coordinates[None, :, :], axis=2)
    nearest = (distances <= distances.min(axis=1, keepdims=True) + _DISTANCE_TOLERANCE).astype(
        np.float64
    )
    nearest /= nearest.sum(axis=1, keepdims=True)
    if method == "linear":
        center = point_coordinates.mean(axis=0)
        relative_distance = np.linalg.norm(node_coordinates - center, axis=1) / np.linalg.norm(
            nearest @ point_coordinates - center, axis=1
        )
        nearest = 1.0 / used + relative_distance[:, None] * (nearest - 1.0 / used)
    weights[:, :used] = nearest
    return weights


def node_positions(element_type: ElementType) -> FloatArray:
    """Local coordinates of the nodes, ``(node, axis)``: xi, eta, zeta from -1 to 1.

    A triangle and a tetrahedron have an axis for each corner, 1 there and 0 at the others; a
    wedge has the three axes of its triangle, and zeta.
    """
    corners = _corners(element_type.family)
    middles = [corners[list(pair)].mean(axis=0) for pair in _MIDDLES.get(element_type.shape, ())]
    return np.array([*corners, *middles])


def point_positions(family: str, points: int) -> FloatArray:
    """Local coordinates of the integration points, ``(point, axis)``, as `node_positions`."""
    corners = _corners(family)
    if points == 1:
        center: FloatArray = corners.mean(axis=0, keepdims=True)
        return center
    if family == "wedge":
        far, near = _TRIANGLE
        flat = np.full((3, 3), near) + (far - near) * np.eye(3)
        return np.array([[*row, z] for z in _GAUSS[2] for row in flat])
    if family in ("tri", "tet"):
        far, near = _TRIANGLE if family == "tri" else _TETRAHEDRON
        return np.full((points, points), near) + (far - near) * np.eye(points)
    axes = 2 if family == "quad" else 3
    side = _GAUSS[round(points ** (1 / axes))]
    return np.array([position[::-1] for position in product(side, repeat=axes)])


def brick_weights(shape: str, points: int, corner: int) -> FloatArray:
    """Weights ``(points,)`` from the points of a brick to a node of "quad8", "hex20", ...

    The polynomial through the points, a product of one in each direction: constant for one point,
    linear for two, quadratic for three. CalculiX expands a plane element to a brick, whose points
    are equal through the thickness except for rounding; their mean is used. `corner` is the index
    of the node in a ``.frd``. An unknown shape or number of points raises a ValueError.
    """
    if shape not in ("quad4", "quad8", "hex8", "hex20") or points not in _SIDE_POINTS:
        raise ValueError(f"{shape} with {points} integration points is not extrapolated")
    family, nodes = ("quad", shape[4:]) if shape.startswith("quad") else ("hex", shape[3:])
    positions = node_positions(ElementType(family, int(nodes), points))
    position = positions[FRD_ORDER.get(shape, slice(None))][corner]
    side = _SIDE_POINTS[points]
    gauss = _GAUSS[side]
    factors = [
        np.array([np.prod([(x - b) / (a - b) for b in gauss if b != a]) for a in gauss])
        for x in position.tolist()
    ]
    if len(factors) == 2:
        factors.append(np.full(side, 1.0 / side))
    weights: FloatArray = np.einsum("x,y,z->zyx", *factors).ravel()
    return weights


def _corners(family: str) -> FloatArray:
    if family in ("tri", "tet"):
        return np.eye(3 if family == "tri" else 4)
    if family == "wedge":
        return np.array([[*row, z] for z in (-1.0, 1.0) for row in np.eye(3)])
    return np.array(_SQUARE if family == "quad" else _CUBE, dtype=np.float64)


def _wedge_terms(positions: FloatArray) -> FloatArray:
    """Terms of the polynomial through a wedge's points, ``(position, term)``."""
    flat, z = positions[:, :3], positions[:, 3:]
    return np.hstack([flat, flat * z])


@dataclass(frozen=True, slots=True, eq=False)
class Layers:
    """Layer of each element: `layer` ``(E,)`` is an index from 0 into `names`.

    Without `is_known` the layers are unknown, and all elements are in layer 0.
    """

    layer: IntArray
    names: tuple[str, ...]
    is_known: bool = True


def find_layers(mesh: PostMesh, path: Path) -> Layers:
    """Layers of a mesh of the post file `path`."""
    count = mesh.element_ids.size
    sets = [entry for entry in mesh.sets if entry.kind == "element"]
    member = np.array([np.isin(mesh.element_ids, entry.members) for entry in sets], dtype=bool)
    if mesh.extras.shape[1] and count:
        ids, layer = np.unique(mesh.extras, axis=0, return_inverse=True)
        layer = layer.reshape(-1)
        names = [f"elements with ids {' '.join(map(str, row))}" for row in ids.tolist()]
        for number in range(len(names)):  # the name of a set with the same elements
            same = [k for k in range(len(sets)) if np.array_equal(member[k], layer == number)]
            names[number] = sets[same[0]].name if same else names[number]
        return Layers(layer, tuple(names))
    deck_layers = _deck_layers(path, mesh.element_ids)
    if deck_layers is not None:
        return deck_layers
    if not member.size:
        return Layers(np.zeros(count, dtype=np.int64), ("all elements",), is_known=False)
    columns, first, layer = np.unique(member, axis=1, return_index=True, return_inverse=True)
    order = np.argsort(first)  # file order
    set_names = (
        " and ".join(entry.name for entry, is_in in zip(sets, column, strict=True) if is_in)
        for column in columns.T[order]
    )
    names = [name or "no element set" for name in set_names]
    return Layers(np.argsort(order)[layer.reshape(-1)], tuple(names))


def _deck_layers(path: Path, element_ids: IntArray) -> Layers | None:
    """Layers by the materials in the deck of the same name as the post file `path`.

    None without a deck, or if it lacks elements (a deck of another model). From input version 14
    on ``connectivity`` has the material; before, a material lists its elements.
    """
    from decks.marc.contents import read_marc_deck
    from decks.marc.grammar import is_marc_deck

    deck_path = path.with_suffix(".dat")
    if not is_marc_deck(deck_path) or deck_path.stat().st_size > _LARGEST_DECK_BYTES:
        return None
    try:
        deck = read_marc_deck(deck_path.read_bytes())
        materials = deck.materials()
    except (OSError, DeckError):
        return None
    number_of: dict[int, int] = {}
    for block in deck.elements:
        number_of.update(dict.fromkeys(block.number.tolist(), block.material))
    for material in materials:
        number_of.update(dict.fromkeys(material.elements, material.number))
    numbers = np.array([number_of.get(element, 0) for element in element_ids.tolist()])
    if not numbers.all() or not numbers.size:
        return None
    used, layer = np.unique(numbers, return_inverse=True)
    names = {material.number: material.name for material in materials}
    layer_names = tuple(names.get(number) or f"material {number}" for number in used.tolist())
    return Layers(layer.reshape(-1), layer_names)


class MeshPoints:
    """Mesh points, one for each node and layer, of all nodes of `mesh` or those `requested`.

    `rows` ``(P,)`` are the rows of the points' nodes in the mesh, `nodes` their numbers,
    `material_count` the number of layers at the node; points are sorted by layer, then by row.
    `element_rows` ``(K,)`` are the elements at the points, whose values at `stored` points each
    are the argument of `average`. `has_values` ``(N,)`` marks nodes at corners of elements with
    values.
    """

    def __init__(
        self,
        mesh: PostMesh,
        path: Path,
        method: str,
        stored: int,
        requested: Sequence[int] | None = None,
    ) -> None:
        self.mesh, self.path, self._method, self._stored = mesh, path, method, stored
        self.layers = find_layers(mesh, path)
        self.element_rows: IntArray = np.arange(mesh.element_ids.size)
        if requested is not None:
            self.element_rows = np.flatnonzero(np.isin(mesh.connectivity, requested).any(axis=1))
        types = mesh.element_types[self.element_rows]
        unknown = types[~np.isin(types, list(ELEMENT_TYPES))]
        self.unknown_types: list[int] = np.unique(unknown).tolist()
        self._groups = list(self._grouped())
        keys = [np.empty(0, np.int64)]
        for group in self._groups:
            is_requested = slice(None) if requested is None else np.isin(group.nodes, requested)
            keys.append(group.keys[is_requested].ravel())
        self._keys: IntArray = np.unique(np.concatenate(keys))
        self._layer, self.rows = np.divmod(self._keys, max(mesh.node_ids.size, 1))
        self.nodes: IntArray = mesh.node_ids[self.rows]
        self.material_count: IntArray = np.bincount(self.rows, minlength=mesh.node_ids.size)[
            self.rows
        ]
        self.has_values: BoolArray = np.zeros(mesh.node_ids.size, dtype=bool)
        self.has_values[self.rows] = True

    def _grouped(self) -> Iterator["_Group"]:
        """Elements grouped by type and number of nodes."""
        mesh, rows = self.mesh, self.element_rows
        keys = np.stack([mesh.element_types[rows], (mesh.connectivity[rows] != 0).sum(axis=1)], 1)
        for number, count in np.unique(keys, axis=0).tolist():
            selected = rows[(keys == (number, count)).all(axis=1)]
            element_type = ELEMENT_TYPES.get(number)
            corners = count if self._method == "average" else 0  # of an unknown type
            if element_type is not None:
                corners = element_type.nodes if count >= element_type.nodes else 0
            nodes = mesh.connectivity[selected][:, :corners]
            row = rows_of(nodes, mesh.node_ids)
            if (row < 0).any():
                k, corner = np.argwhere(row < 0)[0]
                raise ResultError(
                    f"element {mesh.element_ids[selected[k]]} has node {nodes[k, corner]} without "
                    "coordinates",
                    self.path,
                )
            layer = self.layers.layer[selected, None]
            yield _Group(number, count, selected, nodes, layer * mesh.node_ids.size + row)

    def layer_names(self, node: int) -> list[str]:
        """Names of the layers at a node."""
        return [self.layers.names[layer] for layer in self._layer[self.nodes == node].tolist()]

    def sides(self) -> Iterator[tuple[int, tuple[int, ...]]]:
        """Layer of each point, and the elements of that layer at the point."""
        for key, layer in zip(self._keys.tolist(), self._layer.tolist(), strict=True):
            rows = [group.rows[(group.keys == key).any(axis=1)] for group in self._groups]
            yield layer, tuple(self.mesh.element_ids[np.sort(np.concatenate(rows))].tolist())

    def pressure_nodes(self) -> BoolArray:
        """Whether each node occurs only after the corners of elements, ``(N,)``."""
        mesh = self.mesh
        unknown = np.isin(mesh.element_types, self.unknown_types)  # their nodes may be corners
        drawn = self.has_values | np.isin(mesh.node_ids, mesh.connectivity[unknown])
        return np.isin(mesh.node_ids, mesh.connectivity) & ~drawn

    def scene(self) -> Scene:
        """Mesh for ParaView."""
        cells: dict[str, list[tuple[IntArray, IntArray, IntArray]]] = {}
        for group in self._groups:
            if group.number in self.unknown_types or not group.keys.size:
                continue
            shape = ELEMENT_TYPES[group.number].shape
            corners = np.searchsorted(self._keys, group.keys)[:, FRD_ORDER.get(shape, slice(None))]
            cell = self.mesh.element_ids[group.rows], self.layers.layer[group.rows], corners
            cells.setdefault(shape, []).append(cell)
        return Scene(
            points_mm=self.mesh.coordinates_mm[self.rows],
            nodes=self.nodes,
            cells=tuple(
                SceneCells(kind, *map(np.concatenate, zip(*parts, strict=True)))
                for kind, parts in cells.items()
            ),
            material_count=self.material_count,
            materials=dict(enumerate(self.layers.names)),
        )

    def average(self, values: FloatArray) -> FloatArray:
        """Mean at the mesh points, ``(P, C)``, of values ``(K, point, C)`` of elements.

        An integration point without weight may have any value, also NaN.
        """
        plan = self.plan
        carried = [
            np.einsum("np,kpc->knc", weights, values[elements][:, used])[is_selected]
            for elements, weights, used, is_selected in plan.groups
        ]
        if not self._keys.size:
            return np.zeros((0, values.shape[2]))
        contributions = np.concatenate(carried)[plan.order] * plan.share[:, None]
        total = np.add.reduceat(contributions, plan.starts, axis=0)
        mean: FloatArray = total / plan.elements[:, None]
        return mean

    @cached_property
    def plan(self) -> "_Plan":
        """Weights and order of the averaging."""
        groups, points_by_group, shares_by_group = [], [np.empty(0, np.int64)], [np.empty(0)]
        for group in self._groups:
            try:
                weights = node_weights(group.number, group.node_count, self._stored, self._method)
            except ValueError as error:
                element = self.mesh.element_ids[group.rows[0]]
                raise ResultError(f"element {element}: {error}", self.path) from error
            used = (weights != 0).any(axis=0)
            is_selected = np.isin(group.keys, self._keys)
            groups.append(
                (
                    np.searchsorted(self.element_rows, group.rows),
                    weights[:, used],
                    used,
                    is_selected,
                )
            )
            points_by_group.append(np.searchsorted(self._keys, group.keys[is_selected]))
            # A collapsed element has a node at two corners and contributes the mean of both.
            times = (group.nodes[:, :, None] == group.nodes[:, None, :]).sum(axis=2)
            shares_by_group.append(1.0 / times[is_selected])
        points, shares = np.concatenate(points_by_group), np.concatenate(shares_by_group)
        order = np.argsort(points, kind="stable")
        starts = np.searchsorted(points[order], np.arange(self._keys.size))
        elements = np.bincount(points, shares, self._keys.size).astype(np.float64)
        return _Plan(groups, order, shares[order], starts, elements)

    def node_means(self, at_points: FloatArray) -> tuple[IntArray, FloatArray]:
        """Rows of the nodes, and at each the mean over all its elements of `at_points`."""
        rows, index, layer_counts = np.unique(self.rows, return_inverse=True, return_counts=True)
        if layer_counts.size == index.size:
            return rows, at_points[np.argsort(self.rows)]
        total = np.zeros((rows.size, at_points.shape[1]))
        np.add.at(total, index, at_points * self.plan.elements[:, None])
        means = total / np.bincount(index, self.plan.elements, rows.size)[:, None]
        is_single = layer_counts[index] == 1
        means[index[is_single]] = at_points[is_single]
        return rows, means

    def no_elements_error(self, node: int) -> ResultError:
        """Error about a node at no element with values."""
        node_ids = self.mesh.node_ids
        if node in node_ids:
            return ResultError(
                f"node {node} is not a corner of an element with values: a pressure node, or a "
                "node without elements",
                self.path,
            )
        message = "none"
        if node_ids.size:
            near = numbers_near(node_ids, node)
            message = f"the mesh has {node_ids.min()} to {node_ids.max()}, nearest {near}"
        return ResultError(f"no node {node} in the mesh: {message}", self.path)

    def remarks(self) -> Iterator[str]:
        """Assumptions about the elements and their integration points."""
        stored = self._stored
        for number in np.unique(self.mesh.element_types[self.element_rows]).tolist():
            element_type = ELEMENT_TYPES.get(number)
            if element_type is None:
                yield f"element type {number} is unknown: the mean of its points is taken"
                continue
            points = element_type.points
            prefix = f"element type {number} has {points} integration points, the file stores"
            if number not in DOCUMENTED and element_type.points > 1:
                yield (
                    f"element type {number}: count and order of its integration points are "
                    "inferred from related types"
                )
            if stored == 1 < element_type.points:
                yield f"{prefix} 1: taken as the element's mean (the deck has no 'all points')"
            if stored > element_type.points:
                yield f"{prefix} {stored} for each element: the first {element_type.points} taken"


class _Group(NamedTuple):
    """Elements of one type: rows ``(K,)``, and their nodes with values ``(K, corner)``.

    `node_count` is the number of an element's nodes, with pressure nodes. A type with unknown
    integration points has no corners. `keys` are layer and row of each corner as one number.
    """

    number: int
    node_count: int
    rows: IntArray
    nodes: IntArray
    keys: IntArray


class _Plan(NamedTuple):
    """Weights and order of the averaging from integration points to mesh points.

    `groups` has for each group the indices of its elements, the weights ``(corner, used point)``,
    the used points and the requested corners. `order` sorts all corners by mesh point, `share` is
    the share of each corner in its element, `starts` the first corner of each mesh point and
    `elements` the number of its elements.
    """

    groups: list[tuple[IntArray, FloatArray, BoolArray, BoolArray]]
    order: IntArray
    share: FloatArray
    starts: IntArray
    elements: FloatArray
