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
from pathlib import Path

import numpy as np

from fembridge.errors import DeckError, ResultError
from fembridge.results.extrapolation import DOCUMENTED, ELEMENT_TYPES, FRD_ORDER, node_weights
from fembridge.results.fields import Scene, SceneCells
from fembridge.results.marc_post import PostMesh
from fembridge.results.read_options import ReadOptions
from fembridge.typing import BoolArray, FloatArray, IntArray

UNKNOWN_LAYERS = "the file does not hold the materials of its elements"
_LARGEST_DECK_BYTES = 200_000_000
_KINDS = {
    "quad4": "qu4", "quad8": "qu8", "tri3": "tr3", "tri6": "tr6", "hex8": "he8",
    "hex20": "he20", "tet4": "te4", "tet10": "te10", "wedge6": "pe6",
}  # fmt: skip


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
        deck = read_marc_deck(deck_path.read_bytes(), deck_path)
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


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """The elements of one layer at a node, by number and by their rows in the mesh.

    `weights` ``(K, point)`` make the node's value: multiply and sum over both.
    """

    node: int
    layer: int
    name: str
    elements: tuple[int, ...]
    element_rows: IntArray
    weights: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Elements to read, `element_rows` ``(K,)``, and `weights` ``(S, K, point)``.

    One of the ``S`` is a node, or a node's side in one layer: `sides` are the parts that
    each is made of. Found once; an increment then costs the values of these few elements.
    """

    element_rows: IntArray
    weights: FloatArray
    sides: tuple[tuple[Side, ...], ...]
    remarks: tuple[str, ...]

    def add_up(self, values: FloatArray) -> FloatArray:
        """``(S, C)`` of the values ``(K, point, C)`` at the points.

        A point that no node looks at may hold anything, NaN too.
        """
        used = (self.weights != 0).any(axis=0)
        clean = np.where(used[:, :, None], values, 0.0)
        total: FloatArray = np.einsum("skp,kpc->sc", self.weights, clean)
        return total


def plan(
    mesh: PostMesh,
    nodes: Sequence[int],
    stored: int,
    options: ReadOptions,
    path: Path,
    *,
    one_sided: bool = False,
) -> Plan:
    """One value a node, of one layer unless across materials; or `one_sided`, one a layer.

    `stored` counts the points of an element in the file.

    Raises
    ------
    ResultError
        A node lies between layers, is not in the mesh, or at no element with values; the
        points of an element there are not known.
    """
    layers = layers_of(mesh, path)
    touched = np.flatnonzero(np.isin(mesh.connectivity, nodes).any(axis=1))
    found: dict[tuple[int, int], dict[int, FloatArray]] = {}
    for _, rows, corners, weights in _corners(mesh, touched, stored, options.method, path):
        for row, own in zip(rows.tolist(), corners, strict=True):
            for node in set(own.tolist()).intersection(nodes):
                share = weights[own == node].mean(axis=0)
                found.setdefault((node, int(layers.layer[row])), {})[row] = share
    sides: dict[int, list[Side]] = {node: [] for node in nodes}
    for (node, layer), shares in sorted(found.items(), key=lambda item: item[0]):
        at = np.array(sorted(shares), dtype=np.int64)
        weights = np.array([shares[row] for row in at.tolist()]) / at.size
        elements = tuple(mesh.element_ids[at].tolist())
        sides[node].append(Side(node, layer, layers.names[layer], elements, at, weights))
    for node in nodes:
        if not sides[node]:
            raise _no_elements(mesh, node, path)
        if len(sides[node]) > 1 and not (options.across_materials or one_sided):
            names = " and ".join(side.name for side in sides[node])
            raise ResultError(
                f"node {node} lies between {names}: a mean over both belongs to neither; take "
                "a node inside one layer, each side with --one-sided, or the mean with "
                "--across-materials (across_materials=True)",
                path,
            )
    parts = [tuple(sides[node]) for node in nodes]
    if one_sided:
        parts = [(side,) for mine in parts for side in mine]
    rows = np.unique(np.concatenate([side.element_rows for mine in parts for side in mine]))
    total = np.zeros((len(parts), rows.size, stored))
    for share, mine in zip(total, parts, strict=True):
        count = sum(side.element_rows.size for side in mine)
        for side in mine:
            at = np.searchsorted(rows, side.element_rows)
            share[at] = side.weights * (side.element_rows.size / count)
    remarks = _remarks_on(mesh, rows, stored)
    if not layers.known:
        remarks.append(UNKNOWN_LAYERS)
    return Plan(rows, total, tuple(parts), tuple(remarks))


class MeshPoints:
    """All nodes of `mesh` at once; a point is a node as one layer has it.

    `rows` ``(P,)`` are the points' nodes in the mesh, `nodes` their numbers, `met` how many
    layers meet there; they come by layer, then by row. `bearing` ``(N,)`` are the nodes that
    are corners of elements with values.

    Raises
    ------
    ResultError
        An element has a node that the file does not list.
    """

    def __init__(self, mesh: PostMesh, path: Path) -> None:
        self.mesh = mesh
        self.path = path
        self.layers = layers_of(mesh, path)
        self._size = mesh.node_ids.size
        self._order = np.argsort(mesh.node_ids, kind="stable")
        known = np.isin(mesh.element_types, list(ELEMENT_TYPES))
        self.unknown_types: list[int] = np.unique(mesh.element_types[~known]).tolist()
        self._shapes: list[tuple[str, IntArray, IntArray]] = []
        for number in np.unique(mesh.element_types[known]).tolist():
            about = ELEMENT_TYPES[number]
            rows = np.flatnonzero(mesh.element_types == number)
            nodes = mesh.connectivity[rows][:, : about.nodes]
            whole = (nodes != 0).sum(axis=1) == about.nodes
            _check_nodes(mesh, rows[whole], nodes[whole], path)
            self._shapes.append((about.shape, rows[whole], nodes[whole]))
        keys = [self._keys_of(rows, nodes).ravel() for _, rows, nodes in self._shapes]
        self._keys: IntArray = np.unique(np.concatenate([np.empty(0, np.int64), *keys]))
        self.rows: IntArray = self._keys % max(self._size, 1)
        self.nodes: IntArray = mesh.node_ids[self.rows]
        self.met: IntArray = np.bincount(self.rows, minlength=self._size)[self.rows]
        self.bearing: BoolArray = np.zeros(self._size, dtype=bool)
        self.bearing[self.rows] = True

    def pressure_nodes(self) -> BoolArray:
        """Nodes that only come behind the corners of elements, ``(N,)``."""
        mesh = self.mesh
        unknown = np.isin(mesh.element_types, self.unknown_types)  # any of theirs may be a corner
        drawn = self.bearing | np.isin(mesh.node_ids, mesh.connectivity[unknown])
        return np.isin(mesh.node_ids, mesh.connectivity) & ~drawn

    def scene(self) -> Scene:
        """The mesh as pictures want it."""
        cells = []
        for shape, rows, nodes in self._shapes:
            corners = np.searchsorted(self._keys, self._keys_of(rows, nodes))
            order = FRD_ORDER.get(shape, slice(None))
            ids, layer = self.mesh.element_ids[rows], self.layers.layer[rows]
            cells.append(SceneCells(_KINDS[shape], ids, layer, corners[:, order]))
        return Scene(
            points_mm=self.mesh.coordinates_mm[self.rows],
            nodes=self.nodes,
            cells=tuple(cells),
            met=self.met,
            materials=dict(enumerate(self.layers.names)),
        )

    def averaged(self, values: FloatArray, method: str) -> FloatArray:
        """Mean at the points, ``(P, C)``, of values ``(E, point, C)`` carried there.

        Raises
        ------
        ResultError
            The points of an element type are not known.
        """
        total = np.zeros((self._keys.size, values.shape[2]))
        every = np.arange(self.mesh.element_ids.size)
        for number, rows, nodes, weights in _corners(
            self.mesh, every, values.shape[1], method, self.path
        ):
            if number in self.unknown_types:
                continue  # its nodes are no points
            used = (weights != 0).any(axis=0)
            carried = np.einsum("np,kpc->knc", weights[:, used], values[rows][:, used])
            at = np.searchsorted(self._keys, self._keys_of(rows, nodes)).ravel()
            once = 1.0 / _times(nodes)
            for column in range(values.shape[2]):
                share = (carried[:, :, column] * once).ravel()
                total[:, column] += np.bincount(at, share, len(total))
        return total / self.elements_at()[:, None]

    def elements_at(self) -> FloatArray:
        """How many elements of its layer each point has, ``(P,)``."""
        count = np.zeros(self._keys.size)
        for _, rows, nodes in self._shapes:
            at = np.searchsorted(self._keys, self._keys_of(rows, nodes)).ravel()
            count += np.bincount(at, (1.0 / _times(nodes)).ravel(), count.size)
        return count

    def _keys_of(self, rows: IntArray, nodes: IntArray) -> IntArray:
        """Layer and row of the corners `nodes` of elements as one number."""
        at = _rows_of(self.mesh, nodes, self._order)
        keys: IntArray = self.layers.layer[rows, None] * self._size + at
        return keys


def _times(nodes: IntArray) -> IntArray:
    """How often an element has the node of each corner, ``(K, corner)``."""
    times: IntArray = (nodes[:, :, None] == nodes[:, None, :]).sum(axis=2)
    return times


def _rows_of(mesh: PostMesh, nodes: IntArray, order: IntArray | None = None) -> IntArray:
    """Row in the mesh of node numbers that it has, any shape."""
    order = np.argsort(mesh.node_ids, kind="stable") if order is None else order
    place = np.searchsorted(mesh.node_ids, nodes, sorter=order)
    rows: IntArray = order[np.minimum(place, order.size - 1)]
    return rows


def _corners(
    mesh: PostMesh, rows: IntArray, stored: int, method: str, path: Path
) -> Iterator[tuple[int, IntArray, IntArray, FloatArray]]:
    """Elements at `rows`, type by type, and the corners of theirs that have values.

    The type, rows ``(K,)``, nodes ``(K, corner)``, weights ``(corner, point)``.
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
        _check_nodes(mesh, some, nodes, path)
        yield number, some, nodes, weights


def _check_nodes(mesh: PostMesh, rows: IntArray, nodes: IntArray, path: Path) -> None:
    absent = np.argwhere(~np.isin(nodes, mesh.node_ids))
    if absent.size:
        k, corner = absent[0]
        raise ResultError(
            f"element {mesh.element_ids[rows[k]]} has node {nodes[k, corner]}, which has no "
            "coordinates in the file",
            path,
        )


def _no_elements(mesh: PostMesh, node: int, path: Path) -> ResultError:
    known = mesh.node_ids
    if node in known:
        return ResultError(
            f"node {node} is a corner of no element with values: a pressure node, or one that "
            "stands alone",
            path,
        )
    words = "none"
    if known.size:
        near = np.sort(known[np.argsort(np.abs(known - node), kind="stable")[:3]])
        words = f"it has {known.min()} to {known.max()}, near it {', '.join(map(str, near))}"
    return ResultError(f"no node {node} in the mesh: {words}", path)


def _remarks_on(mesh: PostMesh, rows: IntArray, stored: int) -> list[str]:
    """What was inferred about the elements at `rows`, in words."""
    words = []
    for number in np.unique(mesh.element_types[rows]).tolist():
        about = ELEMENT_TYPES.get(number)
        if about is None:
            words.append(f"element type {number} is not known: the mean of its points")
            continue
        has = f"element type {number} has {about.points} integration points, the file stores"
        if number not in DOCUMENTED and about.points > 1:
            words.append(
                f"element type {number}: count and order of its integration points are inferred "
                "from its kin"
            )
        if stored == 1 < about.points:
            words.append(f"{has} 1: taken as the element's mean (the deck has no 'all points')")
        if stored > about.points:
            words.append(f"{has} {stored} for each element: the first {about.points} taken")
    return words
