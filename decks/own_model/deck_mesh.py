"""The mesh of any deck as faces of materials, for a picture.

Plane elements and shells are faces themselves; of solids the faces on the boundary of a material
are taken, those that one element of it alone has.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from decks.assembly import scopes_of
from decks.inp import folder_resolver, read_inp
from decks.marc.contents import read_marc_deck
from decks.own_model.inp_model import ModelScope, family_of
from fembridge.errors import DeckError
from fembridge.typing import FloatArray, IntArray

# Corners of the faces of a solid by the number of its corners; orders of Abaqus and Marc agree.
_FACES = {
    4: ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    6: ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    8: (
        *((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1)),
        *((1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)),
    ),
}
# Corners of an element by the number of its nodes, for flat elements and for solids.
_FLAT_CORNERS = {3: 3, 4: 4, 5: 4, 6: 3, 8: 4, 9: 4}
_SOLID_CORNERS = {4: 4, 5: 4, 6: 6, 8: 8, 9: 8, 10: 4, 15: 6, 20: 8, 27: 8}
_FLAT = ("plane", "shell", "membrane", "rigid")


@dataclass(frozen=True, slots=True, eq=False)
class DeckMesh:
    """Faces of a mesh, in the deck's unit of length.

    Parameters
    ----------
    point
        Nodes, ``(N, 3)``.
    face
        Rows of the corners of each face, ``(F, 4)``; a triangle repeats its last corner.
    material
        Index of the material of each face, ``(F,)``.
    materials
        Their names; "" for elements without one.
    flat
        Whether all nodes lie in the plane of the first two coordinates.
    """

    point: FloatArray
    face: IntArray
    material: IntArray
    materials: tuple[str, ...]
    flat: bool


def read_deck_mesh(path: Path) -> DeckMesh:
    """The mesh of a deck of CalculiX or Abaqus (``.inp``) or Marc (``.dat``).

    Raises
    ------
    DeckError
        The deck has no readable structure, or no element that could be drawn.
    """
    reader = _marc_parts if path.suffix.lower() == ".dat" else _inp_parts
    numbers: dict[tuple[str, int], int] = {}
    points: list[tuple[float, ...]] = []
    faces: list[tuple[int, ...]] = []
    names: dict[str, int] = {}
    materials: list[int] = []
    for instance, nodes, cells in reader(path):
        for number, position in nodes.items():
            numbers[instance, number] = len(points)
            points.append(position)
        for name, solid, corners in cells:
            index = names.setdefault(name, len(names))
            for nodes_of_face in _faces_of(corners, solid):
                rows = [numbers.get((instance, node), -1) for node in nodes_of_face]
                if min(rows) >= 0:
                    faces.append((*rows, rows[-1])[:4])
                    materials.append(index)
    if not faces:
        raise DeckError("no plane, shell or solid element with known nodes", path)
    point = np.array(points, dtype=np.float64)
    face, material = np.array(faces, dtype=np.int64), np.array(materials, dtype=np.int64)
    keep = _on_boundaries(face, material, len(names))
    used = point[np.unique(face[keep])]
    extent = np.ptp(used, axis=0)
    flat = bool(extent[2] <= 1e-9 * max(extent.max(), 1e-300))
    return DeckMesh(point, face[keep], material[keep], tuple(names), flat)


_Part = tuple[str, dict[int, tuple[float, ...]], Iterator[tuple[str, bool, Sequence[int]]]]
"""Name of an instance, its nodes, and its elements: material, whether solid, corners."""


def _inp_parts(path: Path) -> Iterator[_Part]:
    deck = read_inp(path.read_bytes(), resolver=folder_resolver(path))
    for scope in scopes_of(deck):
        own: dict[int, list[float]] = {}
        for block in scope.blocks:
            for row in block.rows() if block.keyword == "NODE" else ():
                with suppress(DeckError):
                    own[row.integer(0)] = [row.number(1 + axis, blank=0.0) for axis in range(3)]
        placed = scope.placement.moved(np.array([*own.values()]).reshape(-1, 3))
        nodes = {number: tuple(row) for number, row in zip(own, placed.tolist(), strict=True)}
        model = ModelScope(scope.blocks)
        yield scope.instance, nodes, _inp_cells(model)


def _inp_cells(model: ModelScope) -> Iterator[tuple[str, bool, Sequence[int]]]:
    for element in model.elements():
        family, count = family_of(element.kind), len(element.nodes)
        solid = family in ("solid", "solid shell")
        corners = (_SOLID_CORNERS if solid else _FLAT_CORNERS).get(count, 0)
        if corners and (solid or family in _FLAT):
            yield model.material_of(element.number), solid, element.nodes[:corners]


def _marc_parts(path: Path) -> Iterator[_Part]:
    deck = read_marc_deck(path.read_bytes())
    mesh = deck.coordinates
    position = np.pad(mesh.position, ((0, 0), (0, max(0, 3 - mesh.position.shape[1]))))[:, :3]
    nodes = {
        number: tuple(row)
        for number, row in zip(mesh.number.tolist(), position.tolist(), strict=True)
    }
    solid = bool(position.size and np.ptp(position[:, 2]))
    names: dict[int, str] = {}
    with suppress(DeckError):
        names = {item.number: item.name for item in deck.materials()}
    yield (
        "",
        nodes,
        (
            (names.get(block.material, ""), solid, row[:corners])
            for block in deck.elements
            if (corners := (_SOLID_CORNERS if solid else _FLAT_CORNERS).get(block.node.shape[1], 0))
            for row in block.node.tolist()
        ),
    )


def _faces_of(corners: Sequence[int], solid: bool) -> Iterator[Sequence[int]]:
    if not solid:
        yield corners
        return
    for face in _FACES[len(corners)]:
        yield [corners[corner] for corner in face]


def _on_boundaries(face: IntArray, material: IntArray, count: int) -> IntArray:
    """Rows of the faces that one element of their material alone has."""
    key = np.column_stack([material, np.sort(face, axis=1)])
    _, row, times = np.unique(key, axis=0, return_index=True, return_counts=True)
    return np.sort(row[times == 1])
