"""The solid model of a keyword deck: nodes, elements, sets, surfaces and sections.

Elements are C3D4, C3D6, C3D8, C3D10, C3D15 and C3D20 with any ending (R, I, H, T, M). Others may
be in the deck; they have no skin and no stress here. Numbers are the deck's, rows count from 0.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from decks.inp import Block, Deck, members, normalized_name
from decks.shape_functions import CORNERS, EDGES
from decks.unit_system import LENGTH_UNITS, MM, UnitSystem, unit_system_in
from fembridge.errors import DeckError
from fembridge.typing import BoolArray, FloatArray, IntArray

_SOLID = re.compile(r"(?:F|D)?C3D(4|6|8|10|15|20)[A-Z]*")
KINDS: Mapping[int, str] = {
    4: "tet4", 6: "wedge6", 8: "hex8", 10: "tet10", 15: "wedge15", 20: "hex20",
}  # fmt: skip
# Faces S1, S2, ... of tetrahedra, wedges and bricks: corners, from 0.
_FACES: Mapping[str, tuple[tuple[int, ...], ...]] = {
    "tet": ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    "wedge": ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    "hex": (
        (0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0),
    ),
}  # fmt: skip
# Triangles of a face with its corners, then its mid-side nodes.
_TRIANGLES: Mapping[int, tuple[tuple[int, int, int], ...]] = {
    3: ((0, 1, 2),),
    4: ((0, 1, 2), (0, 2, 3)),
    6: ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
    8: ((0, 4, 7), (4, 1, 5), (5, 2, 6), (6, 3, 7), (4, 5, 6), (4, 6, 7)),
}
# Degrees of freedom that Abaqus holds by a word.
HELD_WORDS = {"XSYMM": "1", "YSYMM": "2", "ZSYMM": "3", "ENCASTRE": "123", "PINNED": "123"}
_AXES = 3


@dataclass(frozen=True, slots=True, eq=False)
class ElementBlock:
    """Elements of one kind: `number` ``(E,)`` and rows of their nodes ``(E, n)``.

    `kind` is ``hex8`` and the like, `name` the deck's, as ``C3D8R``.
    """

    kind: str
    name: str
    number: IntArray
    rows: IntArray

    @property
    def family(self) -> str:
        """``tet``, ``wedge`` or ``hex``."""
        return self.kind.rstrip("0123456789")

    def faces(self) -> list[IntArray]:
        """Rows of the nodes of each face S1, S2, ..., ``(E, corners, then mid-sides)``."""
        faces = []
        corners, edges = CORNERS[self.family], EDGES[self.family]
        for face in _FACES[self.family]:
            ring = zip(face, (*face[1:], face[0]), strict=True)
            columns = list(face)
            if self.rows.shape[1] > corners:
                sides = [frozenset(edge) for edge in edges]
                columns += [corners + sides.index(frozenset(pair)) for pair in ring]
            faces.append(self.rows[:, columns])
        return faces


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """Elements of a set with a material; `oriented` if the section has an orientation."""

    elements: IntArray
    set_name: str
    material: str
    oriented: bool


@dataclass(frozen=True, eq=False)
class Skin:
    """A surface of a model: triangles of its faces.

    Parameters
    ----------
    rows
        Rows of its nodes in the model, rising, ``(S,)``.
    triangles
        Corners of each triangle by their place in `rows`, ``(F, 3)``, seen from outside
        counter-clockwise.
    """

    rows: IntArray
    triangles: IntArray

    @cached_property
    def border(self) -> BoolArray:
        """Nodes at the end of the surface, ``(S,)``: on an edge of one triangle alone."""
        edges = np.concatenate([self.triangles[:, pair] for pair in ((0, 1), (1, 2), (2, 0))])
        edges.sort(axis=1)
        single, count = np.unique(edges, axis=0, return_counts=True)
        at_border = np.zeros(self.rows.size, dtype=bool)
        at_border[single[count == 1]] = True
        return at_border


@dataclass(frozen=True, eq=False)
class SolidModel:
    """Nodes ``(N,)``, rising, at `position` ``(N, 3)`` in the deck's unit, and what they form.

    `node_sets` and `element_sets` have the numbers of each set, names in capitals without blanks;
    `surfaces` are the ``*SURFACE`` blocks of a keyword deck. `sections` are in the order of the
    deck. `unread` names the files that the deck includes and that were not read.
    """

    units: UnitSystem
    node: IntArray
    position: FloatArray
    elements: tuple[ElementBlock, ...]
    node_sets: Mapping[str, IntArray]
    element_sets: Mapping[str, IntArray]
    sections: tuple[Section, ...]
    surfaces: Mapping[str, Block] = field(default_factory=dict)
    unread: str = ""

    @property
    def element_count(self) -> int:
        """Number of solid elements."""
        return sum(block.number.size for block in self.elements)

    def rows_of(self, nodes: IntArray) -> IntArray:
        """Rows of node numbers; those that no ``*NODE`` defines are left out."""
        at = np.minimum(np.searchsorted(self.node, nodes), self.node.size - 1)
        rows: IntArray = at[self.node[at] == nodes]
        return rows

    def prescribed(self, blocks: Sequence[Block]) -> BoolArray:
        """Displacements that ``*BOUNDARY`` `blocks` prescribe, ``(N, 3)``.

        Raises
        ------
        DeckError
            A set that the deck does not have.
        """
        prescribed = np.zeros((self.node.size, _AXES), dtype=bool)
        for block in blocks:
            for row in block.rows():
                target = normalized_name(row.fields[0])
                nodes = self.node_sets.get(target)
                if nodes is None:
                    nodes = np.array([row.integer(0)])
                if (
                    len(row.fields) > 1
                    and (constraint := normalized_name(row.fields[1])) in HELD_WORDS
                ):
                    axes = [int(digit) for digit in HELD_WORDS[constraint]]
                else:
                    first = row.integer(1)
                    axes = list(range(first, row.integer(2, blank=first) + 1))
                for axis in axes:
                    if 1 <= axis <= _AXES:
                        prescribed[self.rows_of(nodes), axis - 1] = True
        return prescribed

    def skin(self, name: str) -> Skin:
        """The surface `name`: of elements, of nodes, or the outer faces of a node set.

        Raises
        ------
        DeckError
            No such surface or set, or one without faces of solid elements.
        """
        key = normalized_name(name)
        surfaces = self.surfaces
        if key in surfaces and surfaces[key].value_of("TYPE") != "NODE":
            faces = list(self._faces_of(surfaces[key]))
        elif key in surfaces or key in self.node_sets:
            faces = list(self._outer_faces(self._surface_nodes(key, surfaces.get(key))))
        else:
            available = ", ".join([*surfaces, *self.node_sets]) or "none"
            problem = f"no surface and no node set {name!r}; the deck has {available}{self.unread}"
            raise DeckError(problem, argument="skin", found=name, expected=available)
        if not faces:
            problem = f"{name} has no outer face of a solid element"
            raise DeckError(problem, argument="skin", found=name)
        return _triangulated(faces)

    def whole_skin(self) -> Skin:
        """All outer faces of the solid elements."""
        return _triangulated(list(self._outer_faces(self.node)))

    def _surface_nodes(self, name: str, block: Block | None) -> IntArray:
        if block is None:
            return self.node_sets[name]
        parts = []
        for row in block.rows():
            target = normalized_name(row.fields[0])
            parts.append(self.node_sets.get(target, None))
            if parts[-1] is None:
                parts[-1] = np.array([row.integer(0)])
        return np.unique(np.concatenate([part for part in parts if part is not None]))

    def _faces_of(self, block: Block) -> Iterator[IntArray]:
        """Outward faces of the rows ``set or element, S1`` of a surface."""
        for row in block.rows():
            target = normalized_name(row.fields[0])
            label = normalized_name(row.fields[1]) if len(row.fields) > 1 else ""
            if not re.fullmatch("S[1-6]", label):
                raise DeckError(f"{row.where}: face {label!r}, expected S1 to S6")
            numbers = self.element_sets.get(target)
            if numbers is None:
                numbers = np.array([row.integer(0)])
            for block_ in self.elements:
                selected, faces = np.isin(block_.number, numbers), block_.faces()
                if selected.any() and int(label[1]) <= len(faces):
                    yield self._outward(faces[int(label[1]) - 1][selected], block_.rows[selected])

    def _outer_faces(self, nodes: IntArray) -> Iterator[IntArray]:
        """Faces of one element alone whose corners all are of `nodes`."""
        inside = np.zeros(self.node.size, dtype=bool)
        inside[self.rows_of(nodes)] = True
        candidates = []
        for block in self.elements:
            for face in block.faces():
                corners = face[:, : 3 if face.shape[1] in (3, 6) else 4]
                selected = inside[corners].all(axis=1)
                if selected.any():
                    key = np.full((int(selected.sum()), 4), -1)
                    key[:, : corners.shape[1]] = corners[selected]
                    candidates.append((np.sort(key, axis=1), face[selected], block.rows[selected]))
        if not candidates:
            return
        keys = np.concatenate([key for key, *_ in candidates])
        _, index, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
        single = count[index.ravel()] == 1
        first = 0
        for key, face, rows in candidates:
            outer = single[first : first + len(key)]
            first += len(key)
            if outer.any():
                yield self._outward(face[outer], rows[outer])

    def _outward(self, faces: IntArray, elements: IntArray) -> IntArray:
        """`faces` turned so that they are counter-clockwise as seen from outside their element."""
        first, second, third = (self.position[faces[:, k]] for k in range(3))
        normal = np.cross(second - first, third - first)
        away = first - self.position[elements].mean(axis=1)
        inward = np.einsum("fi,fi->f", normal, away) < 0
        turned = {3: [0, 2, 1], 4: [0, 3, 2, 1], 6: [0, 2, 1, 5, 4, 3], 8: [0, 3, 2, 1, 7, 6, 5, 4]}
        faces = faces.copy()
        faces[inward] = faces[inward][:, turned[faces.shape[1]]]
        return faces


def _triangulated(faces: Sequence[IntArray]) -> Skin:
    """Triangles of `faces`, of which there is one or more."""
    corners = np.concatenate(
        [face[:, triangle] for face in faces for triangle in _TRIANGLES[face.shape[1]]]
    )
    rows, vertex = np.unique(corners, return_inverse=True)
    return Skin(rows, vertex.reshape(-1, 3))


def read_solid_model(deck: Deck, length_unit: str | None = None) -> SolidModel:
    """The solid model of a deck without parts; `decks.flat_assembly` makes one of parts.

    Parameters
    ----------
    deck
        The deck, with the files that it includes.
    length_unit
        ``"mm"``, ``"m"`` or ``"in"``. Default: None, as the heading states, else mm.

    Raises
    ------
    DeckError
        Parts and instances, no nodes, no solid elements, or a line that is none.
    """
    for block in deck.blocks_of("PART", "INSTANCE"):
        raise block.error(f"{block.title}: expected a deck without parts")
    numbers, positions = list[int](), list[tuple[float, float, float]]()
    for block in deck.blocks_of("NODE"):
        for row in block.rows():
            numbers.append(row.integer(0))
            x, y, z = (row.number(1 + axis, blank=0.0) for axis in range(_AXES))
            positions.append((x, y, z))
    if not numbers:
        raise DeckError(f"no *NODE{deck.unread}")
    # Of a node that is defined twice the last line counts.
    node, last = np.unique(np.array(numbers)[::-1], return_index=True)
    position = np.array(positions)[::-1][last]
    elements = tuple(_element_blocks(deck, node))
    if not elements:
        raise DeckError(f"no solid element (C3D4 to C3D20){deck.unread}")
    element_sets = _sets(deck, "ELSET", "ELEMENT")
    return SolidModel(
        units=_units(deck, length_unit),
        node=node,
        position=position,
        elements=elements,
        node_sets=_sets(deck, "NSET", "NODE"),
        element_sets=element_sets,
        sections=tuple(_sections(deck, element_sets)),
        surfaces={block.value_of("NAME"): block for block in deck.blocks_of("SURFACE")},
        unread=deck.unread,
    )


def _sections(deck: Deck, element_sets: Mapping[str, IntArray]) -> Iterator[Section]:
    """Sections of solids; ``*SOLID SECTION`` of trusses and plane elements is left out."""
    others = {block.value_of("ELSET") for block in deck.blocks_of("ELEMENT")}
    for block in deck.blocks_of("SOLIDSECTION"):
        name = block.value_of("ELSET")
        if name in element_sets:
            oriented = block.option("ORIENTATION") is not None
            yield Section(element_sets[name], name, block.value_of("MATERIAL"), oriented)
        elif name not in others:
            raise block.error(f"element set {name} is nowhere in the deck{deck.unread}")


def _units(deck: Deck, length_unit: str | None) -> UnitSystem:
    if length_unit is not None:
        return LENGTH_UNITS[length_unit]
    for block in deck.blocks_of("HEADING"):
        text = b"".join(piece.text.data[piece.start : piece.stop] for piece in block.pieces)
        if (stated := unit_system_in(text.decode("latin-1"))) is not None:
            return stated
    return MM


def _element_blocks(deck: Deck, node: IntArray) -> Iterator[ElementBlock]:
    for block in deck.blocks_of("ELEMENT"):
        match = _SOLID.fullmatch(block.value_of("TYPE"))
        if match is None:
            continue
        count = int(match[1])
        table = _table(block, 1 + count)
        rows = np.minimum(np.searchsorted(node, table[:, 1:]), node.size - 1)
        absent = node[rows] != table[:, 1:]
        if absent.any():
            problem = (
                f"element {table[absent.any(axis=1)][0, 0]} has node {table[:, 1:][absent][0]}"
            )
            raise block.error(f"{problem}, which no *NODE of the deck defines{deck.unread}")
        yield ElementBlock(KINDS[count], match[0], table[:, 0], rows)


def _table(block: Block, width: int) -> IntArray:
    """The whole numbers of a block, `width` a line of data, which may be continued."""
    values: list[str] = []
    for row in block.rows():
        values += row.fields if row.fields[-1] else row.fields[:-1]
    try:
        table = np.array(values, dtype=np.int64)
    except ValueError:
        table = np.zeros(1, dtype=np.int64)
    if table.size % width:
        raise block.error(f"{block.title}: expected lines of {width} whole numbers")
    return table.reshape(-1, width)


def _sets(deck: Deck, keyword: str, maker: str) -> dict[str, IntArray]:
    """Members of the sets that `keyword` and `maker` define, rising; a set may be in pieces."""
    runs: dict[str, list[range]] = {}
    pieces: dict[str, list[IntArray]] = {}
    for block in deck.blocks_of(keyword, maker):
        name = block.value_of(keyword)
        if not name:
            continue
        if block.keyword == "ELEMENT":
            match = _SOLID.fullmatch(block.value_of("TYPE"))
            if match is not None:
                pieces.setdefault(name, []).append(_table(block, 1 + int(match[1]))[:, 0])
            continue
        members_listed = _named_members(block, pieces) if block.keyword == keyword else None
        if members_listed is None:
            members_listed = [
                np.arange(run.start, run.stop, run.step) for run in members(block, runs)
            ]
        pieces.setdefault(name, []).extend(members_listed)
    return {name: np.unique(np.concatenate(parts)) for name, parts in pieces.items() if parts}


def _named_members(block: Block, pieces: Mapping[str, list[IntArray]]) -> list[IntArray] | None:
    """Members of a block that lists numbers and names of sets; None of one that generates them."""
    if block.option("GENERATE") is not None:
        return None
    members_listed: list[IntArray] = []
    numbers = list[int]()
    for row in block.rows():
        for column, text in enumerate(row.fields):
            if not text:
                continue
            if not text.isdigit() and normalized_name(text) in pieces:
                members_listed += pieces[normalized_name(text)]
            else:
                numbers.append(row.integer(column))
    return [*members_listed, np.array(numbers, dtype=np.int64)]
