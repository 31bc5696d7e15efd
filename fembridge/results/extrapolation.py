"""From integration points to nodes: weights in an element, means over the elements of a layer.

Marc stores stress at integration points, CalculiX prints it there; a node's value is made
of them. The methods carry the names that Mentat gives them:

``linear``     from the mean over the element's points in a straight line through the nearest
               point (the mean of those equally near): exact where stress is linear in the
               element, and what Marc does
``translate``  the value of the nearest point; of points equally near their mean
``average``    the mean over the element's points

Marc's rule is not in its manuals. It was found on the nodal print of a public model of two
bricks (github.com/nightly/fedes, ``models/Example-3D-beam-small``, ``Model1-output-Marc.70``
beside its ``.t19``): at all 12 nodes the tensor is that of this rule, averaged over the
elements. The constant in the print is 1.73, for sqrt(3), to its five digits, times a factor
of 0.9992 to 1.0033 a node that is not explained; sqrt(3) itself is within 0.21 % of the
greatest component and 0.19 % of each von Mises stress. The polynomial through the points, trilinear
in a brick, would be 7 % away. Quadrilaterals and quadratic elements are taken to follow;
wedges, whose points lie on no such line, keep their polynomial.

Order of points: xi fastest, then eta, then zeta, from -1 to +1; in triangles, tetrahedra
and wedges point k is the one next to corner k. Known for the Marc types in `DOCUMENTED`; for
the others of `ELEMENT_TYPES` it is inferred from their kin.

A node's value is the mean over the elements there, each extrapolated to it: over those of
one layer, never of two unasked. An element that has the node twice (a quadrilateral that
is collapsed to a triangle) counts once, with the mean of its two corners.

Post revision 14 adds five numbers to an element. Two of them repeat what the file's list of
geometric properties says (its number and kind); which of the others is the material is
inferred (the first), so elements are of one layer only where all five are equal. Older
files have none of them: there the deck beside the file says it, else its element sets.
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

UNKNOWN_LAYERS = "the file does not hold the materials of its elements"
_LARGEST_DECK_BYTES = 200_000_000
_SAME = 1.0e-9  # distances that differ by less are equal
_GAUSS = {1: (0.0,), 2: (-(3**-0.5), 3**-0.5), 3: (-(0.6**0.5), 0.0, 0.6**0.5)}
_TRIANGLE, _TETRAHEDRON = (2 / 3, 1 / 6), (0.5854101966249685, 0.1381966011250105)
# Mid-side nodes: the pairs of corners (from 0) that they lie between.
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
"""Where a ``.frd`` has the nodes of a shape in another order than Marc, which has the
mid-sides of a brick's top before those between."""
_SQUARE = ((-1, -1), (1, -1), (1, 1), (-1, 1))
_CUBE = (*((x, y, -1) for x, y in _SQUARE), *((x, y, 1) for x, y in _SQUARE))
_POINTS_A_SIDE = {1: 1, 8: 2, 27: 3}  # of a brick


@dataclass(frozen=True, slots=True)
class ElementType:
    """An element type of Marc: `family`, corners, mid-side nodes, and its `points`.

    `nodes` counts those that have values; a Herrmann element has one or more
    pressure nodes behind them, which get none.
    """

    family: str
    nodes: int
    points: int

    @property
    def shape(self) -> str:
        """Family and nodes in one word, ``quad4``."""
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
# Those whose count and order of points stand in a public source or a real file.
DOCUMENTED = frozenset({3, 6, 7, 11, 21, 27, 32, 54, 57, 114, 117, 118, 125, 127, 134,
                        136})  # fmt: skip


def node_weights(number: int, nodes: int, stored: int, method: str) -> FloatArray:
    """Weights ``(node, point)`` from what a file stores to an element's nodes; rows sum to 1.

    `number` is Marc's of the element type, `nodes` counts the element's in the file, pressure
    nodes among them: rows are those with values, the first ones. `stored` is how many points
    the file has for each element: that of the type in it that has most; further ones of a
    smaller type are not looked at. A single one where the type has more is the element's
    mean (inferred: the deck then has no ``all points``). `method` is of `ReadOptions`.

    Raises
    ------
    ValueError
        The type is unknown and `method` is not "average"; the file has some of its
        points and not all; the element has too few nodes.
    """
    about = ELEMENT_TYPES.get(number)
    if about is None:
        if method != "average":
            raise ValueError(
                f"element type {number}: where its integration points lie is not "
                "known here; average of them is what can be had"
            )
        return np.full((nodes, stored), 1.0 / stored)
    if nodes < about.nodes:
        raise ValueError(f"element type {number} with {nodes} nodes, expected {about.nodes}")
    if 1 < stored < about.points:
        raise ValueError(
            f"element type {number} has {about.points} integration points, the "
            f"file stores {stored}: which they are is not known"
        )
    used = min(stored, about.points)
    weights = np.zeros((about.nodes, stored))
    if method == "average" or used == 1:
        weights[:, :used] = 1.0 / used
        return weights
    to, here = node_places(about), point_places(about.family, used)
    if method == "linear" and about.family == "wedge":
        weights[:, :used] = _wedge_terms(to) @ np.linalg.inv(_wedge_terms(here))
        return weights
    away = np.linalg.norm(to[:, None, :] - here[None, :, :], axis=2)
    nearest = (away <= away.min(axis=1, keepdims=True) + _SAME).astype(np.float64)
    nearest /= nearest.sum(axis=1, keepdims=True)
    if method == "linear":
        middle = here.mean(axis=0)
        reach = np.linalg.norm(to - middle, axis=1) / np.linalg.norm(
            nearest @ here - middle, axis=1
        )
        nearest = 1.0 / used + reach[:, None] * (nearest - 1.0 / used)
    weights[:, :used] = nearest
    return weights


def node_places(about: ElementType) -> FloatArray:
    """Where the nodes lie, ``(node, axis)``: in xi, eta, zeta from -1 to 1.

    A triangle and a tetrahedron have one axis a corner, 1 there and 0 at the
    others; a wedge the three of its triangle, and zeta.
    """
    corners = _corners(about.family)
    middle = [corners[list(pair)].mean(axis=0) for pair in _MIDDLES.get(about.shape, ())]
    return np.array([*corners, *middle])


def point_places(family: str, points: int) -> FloatArray:
    """Where the integration points lie, ``(point, axis)``, as `node_places`."""
    corners = _corners(family)
    if points == 1:
        middle: FloatArray = corners.mean(axis=0, keepdims=True)
        return middle
    if family == "wedge":
        far, near = _TRIANGLE
        flat = np.full((3, 3), near) + (far - near) * np.eye(3)
        return np.array([[*row, z] for z in _GAUSS[2] for row in flat])
    if family in ("tri", "tet"):
        far, near = _TRIANGLE if family == "tri" else _TETRAHEDRON
        return np.full((points, points), near) + (far - near) * np.eye(points)
    axes = 2 if family == "quad" else 3
    side = _GAUSS[round(points ** (1 / axes))]
    return np.array([place[::-1] for place in product(side, repeat=axes)])


def brick_weights(shape: str, points: int, corner: int) -> FloatArray:
    """Weights ``(points,)`` from the points of a brick to a node of "quad8", "hex20", ...

    The polynomial through the points, product of one a direction: constant of one point,
    linear of two, quadratic of three. CalculiX makes a brick of a plane element too: its
    points are equal through the thickness but for rounding, and their mean is taken.
    `corner` counts nodes as a ``.frd`` has them. A shape, or a number of its points, that is
    not known here is a ValueError.
    """
    if shape not in ("quad4", "quad8", "hex8", "hex20") or points not in _POINTS_A_SIDE:
        raise ValueError(f"{shape} with {points} integration points is not extrapolated")
    family, nodes = ("quad", shape[4:]) if shape.startswith("quad") else ("hex", shape[3:])
    places = node_places(ElementType(family, int(nodes), points))
    place = places[FRD_ORDER.get(shape, slice(None))][corner]
    side = _POINTS_A_SIDE[points]
    gauss = _GAUSS[side]
    factors = [
        np.array([np.prod([(x - b) / (a - b) for b in gauss if b != a]) for a in gauss])
        for x in place.tolist()
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


def _wedge_terms(places: FloatArray) -> FloatArray:
    """Terms of the polynomial through a wedge's points, ``(place, term)``."""
    flat, z = places[:, :3], places[:, 3:]
    return np.hstack([flat, flat * z])


@dataclass(frozen=True, slots=True, eq=False)
class Layers:
    """The layer of each element: `layer` ``(E,)`` counts from 0, `names` by it.

    Without `known` the file does not say: all elements then are layer 0.
    """

    layer: IntArray
    names: tuple[str, ...]
    known: bool = True


def layers_of(mesh: PostMesh, path: Path) -> Layers:
    """Layers of a mesh of the post file `path`."""
    count = mesh.element_ids.size
    sets = [one for one in mesh.sets if one.kind == "element"]
    member = np.array([np.isin(mesh.element_ids, one.members) for one in sets], dtype=bool)
    if mesh.extras.shape[1] and count:
        ids, layer = np.unique(mesh.extras, axis=0, return_inverse=True)
        layer = layer.reshape(-1)
        names = [f"elements with ids {' '.join(map(str, row))}" for row in ids.tolist()]
        for number in range(len(names)):  # named by a set of just its elements
            same = [k for k in range(len(sets)) if np.array_equal(member[k], layer == number)]
            names[number] = sets[same[0]].name if same else names[number]
        return Layers(layer, tuple(names))
    beside = _materials_beside(path, mesh.element_ids)
    if beside is not None:
        return beside
    if not member.size:
        return Layers(np.zeros(count, dtype=np.int64), ("all elements",), known=False)
    columns, first, layer = np.unique(member, axis=1, return_index=True, return_inverse=True)
    order = np.argsort(first)  # as they come in the file
    named = (
        " and ".join(one.name for one, is_in in zip(sets, column, strict=True) if is_in)
        for column in columns.T[order]
    )
    names = [name or "no element set" for name in named]
    return Layers(np.argsort(order)[layer.reshape(-1)], tuple(names))


def _materials_beside(path: Path, element_ids: IntArray) -> Layers | None:
    """Layers by the materials of the deck that has the stem of the post file `path`.

    None without one, or where it does not have all elements (it is another model's). From
    input version 14 on ``connectivity`` has the material; before, a material lists elements.
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
    for one in materials:
        number_of.update(dict.fromkeys(one.elements, one.number))
    numbers = np.array([number_of.get(element, 0) for element in element_ids.tolist()])
    if not numbers.all() or not numbers.size:
        return None
    used, layer = np.unique(numbers, return_inverse=True)
    names = {one.number: one.name for one in materials}
    named = tuple(names.get(number) or f"material {number}" for number in used.tolist())
    return Layers(layer.reshape(-1), named)


class MeshPoints:
    """Nodes of `mesh`, all or those `wanted`; a point is a node as one layer has it.

    `rows` ``(P,)`` are the points' nodes in the mesh, `nodes` their numbers, `met` how many
    layers meet there; they come by layer, then by row. `element_rows` ``(K,)`` are the elements
    at them, whose values at `stored` points each `averaged` takes; `bearing` ``(N,)`` the nodes
    that are corners of elements with values.
    """

    def __init__(
        self,
        mesh: PostMesh,
        path: Path,
        method: str,
        stored: int,
        wanted: Sequence[int] | None = None,
    ) -> None:
        self.mesh, self.path, self._method, self._stored = mesh, path, method, stored
        self.layers = layers_of(mesh, path)
        self.element_rows: IntArray = np.arange(mesh.element_ids.size)
        if wanted is not None:
            self.element_rows = np.flatnonzero(np.isin(mesh.connectivity, wanted).any(axis=1))
        types = mesh.element_types[self.element_rows]
        unknown = types[~np.isin(types, list(ELEMENT_TYPES))]
        self.unknown_types: list[int] = np.unique(unknown).tolist()
        self._groups = list(self._grouped())
        keys = [np.empty(0, np.int64)]
        for one in self._groups:
            here = slice(None) if wanted is None else np.isin(one.nodes, wanted)
            keys.append(one.keys[here].ravel())
        self._keys: IntArray = np.unique(np.concatenate(keys))
        self._layer, self.rows = np.divmod(self._keys, max(mesh.node_ids.size, 1))
        self.nodes: IntArray = mesh.node_ids[self.rows]
        self.met: IntArray = np.bincount(self.rows, minlength=mesh.node_ids.size)[self.rows]
        self.bearing: BoolArray = np.zeros(mesh.node_ids.size, dtype=bool)
        self.bearing[self.rows] = True

    def _grouped(self) -> Iterator["_Group"]:
        """The elements, those of one type and count of nodes together."""
        mesh, rows = self.mesh, self.element_rows
        keys = np.stack([mesh.element_types[rows], (mesh.connectivity[rows] != 0).sum(axis=1)], 1)
        for number, count in np.unique(keys, axis=0).tolist():
            some = rows[(keys == (number, count)).all(axis=1)]
            about = ELEMENT_TYPES.get(number)
            corners = count if self._method == "average" else 0  # of an unknown type
            if about is not None:
                corners = about.nodes if count >= about.nodes else 0
            nodes = mesh.connectivity[some][:, :corners]
            row = rows_of(nodes, mesh.node_ids)
            if (row < 0).any():
                k, corner = np.argwhere(row < 0)[0]
                raise ResultError(
                    f"element {mesh.element_ids[some[k]]} has node {nodes[k, corner]}, which "
                    "has no coordinates in the file",
                    self.path,
                )
            layer = self.layers.layer[some, None]
            yield _Group(number, count, some, nodes, layer * mesh.node_ids.size + row)

    def names_at(self, node: int) -> list[str]:
        """Names of the layers at a node."""
        return [self.layers.names[one] for one in self._layer[self.nodes == node].tolist()]

    def sides(self) -> Iterator[tuple[int, tuple[int, ...]]]:
        """The layer of each point, and the elements of that layer there."""
        for key, layer in zip(self._keys.tolist(), self._layer.tolist(), strict=True):
            at = [one.rows[(one.keys == key).any(axis=1)] for one in self._groups]
            yield layer, tuple(self.mesh.element_ids[np.sort(np.concatenate(at))].tolist())

    def pressure_nodes(self) -> BoolArray:
        """Nodes that only come behind the corners of elements, ``(N,)``."""
        mesh = self.mesh
        unknown = np.isin(mesh.element_types, self.unknown_types)  # any of theirs may be a corner
        drawn = self.bearing | np.isin(mesh.node_ids, mesh.connectivity[unknown])
        return np.isin(mesh.node_ids, mesh.connectivity) & ~drawn

    def scene(self) -> Scene:
        """The mesh as pictures want it."""
        cells: dict[str, list[tuple[IntArray, IntArray, IntArray]]] = {}
        for one in self._groups:
            if one.number in self.unknown_types or not one.keys.size:
                continue
            shape = ELEMENT_TYPES[one.number].shape
            corners = np.searchsorted(self._keys, one.keys)[:, FRD_ORDER.get(shape, slice(None))]
            cell = self.mesh.element_ids[one.rows], self.layers.layer[one.rows], corners
            cells.setdefault(shape, []).append(cell)
        return Scene(
            points_mm=self.mesh.coordinates_mm[self.rows],
            nodes=self.nodes,
            cells=tuple(
                SceneCells(kind, *map(np.concatenate, zip(*some, strict=True)))
                for kind, some in cells.items()
            ),
            met=self.met,
            materials=dict(enumerate(self.layers.names)),
        )

    def averaged(self, values: FloatArray) -> FloatArray:
        """Mean at the points, ``(P, C)``, of values ``(K, point, C)`` carried there.

        A point that no node looks at may hold anything, NaN too.
        """
        plan = self.plan
        carried = [
            np.einsum("np,kpc->knc", weights, values[place][:, used])[here]
            for place, weights, used, here in plan.groups
        ]
        if not self._keys.size:
            return np.zeros((0, values.shape[2]))
        every = np.concatenate(carried)[plan.order] * plan.share[:, None]
        total = np.add.reduceat(every, plan.starts, axis=0)
        mean: FloatArray = total / plan.elements[:, None]
        return mean

    @cached_property
    def plan(self) -> "_Plan":
        """How values get here."""
        groups, at, share = [], [np.empty(0, np.int64)], [np.empty(0)]
        for one in self._groups:
            try:
                weights = node_weights(one.number, one.held, self._stored, self._method)
            except ValueError as error:
                element = self.mesh.element_ids[one.rows[0]]
                raise ResultError(f"element {element}: {error}", self.path) from error
            used = (weights != 0).any(axis=0)
            here = np.isin(one.keys, self._keys)
            groups.append(
                (np.searchsorted(self.element_rows, one.rows), weights[:, used], used, here)
            )
            at.append(np.searchsorted(self._keys, one.keys[here]))
            # An element that is collapsed has a node at two corners: with the mean of both.
            times = (one.nodes[:, :, None] == one.nodes[:, None, :]).sum(axis=2)
            share.append(1.0 / times[here])
        places, shares = np.concatenate(at), np.concatenate(share)
        order = np.argsort(places, kind="stable")
        starts = np.searchsorted(places[order], np.arange(self._keys.size))
        elements = np.bincount(places, shares, self._keys.size).astype(np.float64)
        return _Plan(groups, order, shares[order], starts, elements)

    def one_a_node(self, at_points: FloatArray) -> tuple[IntArray, FloatArray]:
        """Rows of the nodes, and the mean over all elements there, of values at the points."""
        rows, place, layers = np.unique(self.rows, return_inverse=True, return_counts=True)
        if layers.size == place.size:
            return rows, at_points[np.argsort(self.rows)]
        total = np.zeros((rows.size, at_points.shape[1]))
        np.add.at(total, place, at_points * self.plan.elements[:, None])
        found = total / np.bincount(place, self.plan.elements, rows.size)[:, None]
        single = layers[place] == 1
        found[place[single]] = at_points[single]
        return rows, found

    def no_elements(self, node: int) -> ResultError:
        """The error of a node that is at no element with values."""
        known = self.mesh.node_ids
        if node in known:
            return ResultError(
                f"node {node} is a corner of no element with values: a pressure node, or one that "
                "stands alone",
                self.path,
            )
        words = "none"
        if known.size:
            words = f"it has {known.min()} to {known.max()}, near it {numbers_near(known, node)}"
        return ResultError(f"no node {node} in the mesh: {words}", self.path)

    def remarks(self) -> Iterator[str]:
        """What was inferred about the elements and their points."""
        stored = self._stored
        for number in np.unique(self.mesh.element_types[self.element_rows]).tolist():
            about = ELEMENT_TYPES.get(number)
            if about is None:
                yield f"element type {number} is not known: the mean of its points"
                continue
            has = f"element type {number} has {about.points} integration points, the file stores"
            if number not in DOCUMENTED and about.points > 1:
                yield (
                    f"element type {number}: count and order of its integration points are "
                    "inferred from its kin"
                )
            if stored == 1 < about.points:
                yield f"{has} 1: taken as the element's mean (the deck has no 'all points')"
            if stored > about.points:
                yield f"{has} {stored} for each element: the first {about.points} taken"


class _Group(NamedTuple):
    """Elements of one type: rows ``(K,)``, and the nodes ``(K, corner)`` that have values.

    `held` counts an element's nodes, pressure nodes among them; there are no corners where it
    is not known where its points lie. `keys` are layer and row of each corner as one number.
    """

    number: int
    held: int
    rows: IntArray
    nodes: IntArray
    keys: IntArray


class _Plan(NamedTuple):
    """How values get from integration points to the points of a mesh: found once.

    Of each group the places of its elements, weights ``(corner, used point)``, which points are
    used and which corners are wanted; then the order of all corners by point, how much of its
    element each is, where each point begins, and how many elements it has.
    """

    groups: list[tuple[IntArray, FloatArray, BoolArray, BoolArray]]
    order: IntArray
    share: FloatArray
    starts: IntArray
    elements: FloatArray
