"""From Marc's integration points to nodes, layer by layer.

A node's value is the mean over the elements there, each extrapolated to it: over those of
one layer, never of two unasked. An element that has the node twice (a quadrilateral that
is collapsed to a triangle) counts once, with the mean of its two corners.

Post revision 14 adds five numbers to an element. Two of them repeat what the file's list of
geometric properties says (its number and kind); which of the others is the material is
inferred (the first), so elements are of one layer only where all five are equal. Older
files have none of them: there the deck beside the file says it, else its element sets.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fembridge.errors import DeckError, ResultError
from fembridge.results.extrapolation import DOCUMENTED, ELEMENT_TYPES, FRD_ORDER, node_weights
from fembridge.results.fields import Scene, SceneCells
from fembridge.results.marc_post import PostMesh
from fembridge.typing import BoolArray, FloatArray, IntArray

UNKNOWN_LAYERS = "the file does not hold the materials of its elements"
_LARGEST_DECK_BYTES = 200_000_000


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
        self._size = mesh.node_ids.size
        self._order = np.argsort(mesh.node_ids, kind="stable")
        self.element_rows: IntArray = np.arange(mesh.element_ids.size)
        if wanted is not None:
            touched = np.isin(mesh.connectivity, wanted).any(axis=1)
            self.element_rows = np.flatnonzero(touched)
        types = mesh.element_types[self.element_rows]
        self.unknown_types: list[int] = np.unique(
            types[~np.isin(types, list(ELEMENT_TYPES))]
        ).tolist()
        self._groups = list(self._grouped())
        keys = [self._keys_of(one) for one in self._groups]
        if wanted is not None:
            keys = [
                key[np.isin(one.nodes, wanted)] for key, one in zip(keys, self._groups, strict=True)
            ]
        every = [np.empty(0, np.int64), *(key.ravel() for key in keys)]
        self._keys: IntArray = np.unique(np.concatenate(every))
        self.rows: IntArray = self._keys % max(self._size, 1)
        self.nodes: IntArray = mesh.node_ids[self.rows]
        self.met: IntArray = np.bincount(self.rows, minlength=self._size)[self.rows]
        self.bearing: BoolArray = np.zeros(self._size, dtype=bool)
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
            group = _Group(number, count, corners, some, mesh.connectivity[some][:, :corners])
            absent = np.argwhere(~np.isin(group.nodes, mesh.node_ids))
            if absent.size:
                k, corner = absent[0]
                raise ResultError(
                    f"element {mesh.element_ids[some[k]]} has node {group.nodes[k, corner]}, which "
                    "has no coordinates in the file",
                    self.path,
                )
            yield group

    def names_at(self, node: int) -> list[str]:
        """Names of the layers at a node."""
        return [self.layers.names[one] for one in self._layer[self.nodes == node].tolist()]

    def sides(self) -> Iterator[tuple[int, tuple[int, ...]]]:
        """The layer of each point, and the elements of that layer there."""
        for key, layer in zip(self._keys.tolist(), self._layer.tolist(), strict=True):
            at = [one.rows[(self._keys_of(one) == key).any(axis=1)] for one in self._groups]
            yield layer, tuple(self.mesh.element_ids[np.sort(np.concatenate(at))].tolist())

    @property
    def _layer(self) -> IntArray:
        layer: IntArray = self._keys // max(self._size, 1)
        return layer

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
            if one.number in self.unknown_types or not one.corners:
                continue
            shape = ELEMENT_TYPES[one.number].shape
            corners = np.searchsorted(self._keys, self._keys_of(one))
            rows = corners[:, FRD_ORDER.get(shape, slice(None))]
            cell = self.mesh.element_ids[one.rows], self.layers.layer[one.rows], rows
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
            keys = self._keys_of(one)
            here = np.isin(keys, self._keys)
            groups.append(
                (np.searchsorted(self.element_rows, one.rows), weights[:, used], used, here)
            )
            at.append(np.searchsorted(self._keys, keys[here]))
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

    def _keys_of(self, one: "_Group") -> IntArray:
        """Layer and row of the corners of elements as one number."""
        place = np.searchsorted(self.mesh.node_ids, one.nodes, sorter=self._order)
        keys: IntArray = self.layers.layer[one.rows, None] * self._size + self._order[place]
        return keys

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
            near = np.sort(known[np.argsort(np.abs(known - node), kind="stable")[:3]])
            words = f"it has {known.min()} to {known.max()}, near it {', '.join(map(str, near))}"
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

    `held` counts an element's nodes, pressure nodes among them; without `corners` it is not
    known where its points lie.
    """

    number: int
    held: int
    corners: int
    rows: IntArray
    nodes: IntArray


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
