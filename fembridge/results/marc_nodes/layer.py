"""Which elements are of one layer: stress is never averaged over two unasked.

Post revision 14 adds five numbers to an element. Two of them repeat what the file's
list of geometric properties says (its number and kind); which of the others is the
material is inferred (the first), so elements count as one layer only where all five
are equal. Older files have none of them: there the deck beside the file tells, else its
element sets, and without these nothing does.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fembridge.results.marc_format.content import PostMesh, PostSet
from fembridge.results.marc_nodes.deck_layers import deck_materials
from fembridge.typing import BoolArray, IntArray

UNTOLD = "the file does not tell the materials of its elements"


@dataclass(frozen=True, slots=True, eq=False)
class Layers:
    """The layer of each element: `layer` ``(E,)`` counts from 0, `names` by it.

    `told` is False where the file does not say: all elements then are layer 0.
    """

    layer: IntArray
    names: tuple[str, ...]
    told: bool


def layers_of(mesh: PostMesh, path: Path) -> Layers:
    """Find the layers of a mesh of the post file `path`."""
    count = mesh.element_ids.size
    if mesh.extras.ndim == 2 and mesh.extras.shape[1] and count:
        ids, layer = np.unique(mesh.extras, axis=0, return_inverse=True)
        names = [f"elements with ids {' '.join(map(str, row))}" for row in ids.tolist()]
        layer = layer.reshape(-1)
        return Layers(layer, _named_by_sets(mesh, layer, names), True)
    layer, known = deck_materials(path, mesh.element_ids)
    if known:
        return Layers(layer, tuple(known), True)
    member = _membership(mesh)
    if not member.size:
        return Layers(np.zeros(count, dtype=np.int64), ("all elements",), False)
    columns, first, layer = np.unique(member, axis=1, return_index=True, return_inverse=True)
    order = np.argsort(first)  # as they come in the file
    names = [
        " and ".join(one.name for one, is_in in zip(_sets(mesh), column, strict=True) if is_in)
        or "no element set"
        for column in columns.T[order]
    ]
    return Layers(np.argsort(order)[layer.reshape(-1)], tuple(names), True)


def _named_by_sets(mesh: PostMesh, layer: IntArray, names: list[str]) -> tuple[str, ...]:
    """Name a layer by the smallest element set that has just its elements, or more."""
    member = _membership(mesh)
    for number in range(len(names)):
        mine = layer == number
        holding = [k for k in range(len(member)) if member[k][mine].all()]
        exact = [k for k in holding if member[k].sum() == mine.sum()]
        if exact:
            names[number] = _sets(mesh)[exact[0]].name
    return tuple(names)


def _membership(mesh: PostMesh) -> BoolArray:
    """Whether an element is in a set, ``(set, E)``."""
    member = np.zeros((len(_sets(mesh)), mesh.element_ids.size), dtype=bool)
    for row, one in zip(member, _sets(mesh), strict=True):
        row[:] = np.isin(mesh.element_ids, one.members)
    return member


def _sets(mesh: PostMesh) -> list[PostSet]:
    return [one for one in mesh.sets if one.kind == "element"]
