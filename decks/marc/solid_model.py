"""The solid model of a Marc deck: nodes, solid elements, sets, and a section for each material.

Elements are tetrahedra, wedges and bricks, also those with nodes of pressure, which are left out.
"""

from collections.abc import Iterator

import numpy as np

from decks.inp import normalized_name
from decks.marc.contents import FIXED_DISPLACEMENT, TRANSLATIONS, LoadCase, MarcDeck
from decks.solid_model import ElementBlock, Section, SolidModel
from decks.unit_system import LENGTH_UNITS
from fembridge.errors import DeckError
from fembridge.typing import BoolArray, IntArray

# Kind of an element by Marc's type, Volume B; `fembridge.results.extrapolation` has their points.
KINDS = {
    7: "hex8", 84: "hex8", 117: "hex8", 120: "hex8",
    21: "hex20", 35: "hex20", 57: "hex20", 61: "hex20",
    134: "tet4", 157: "tet4", 127: "tet10", 130: "tet10",
    136: "wedge6", 202: "wedge15",
}  # fmt: skip


def marc_solid_model(deck: MarcDeck, length_unit: str | None = None) -> SolidModel:
    """The solid model of a Marc deck.

    Parameters
    ----------
    deck
        The deck.
    length_unit
        ``"mm"``, ``"m"`` or ``"in"``. Default: None, mm.

    Raises
    ------
    DeckError
        No nodes, no solid elements, or an element whose nodes have no coordinates.
    """
    mesh = deck.coordinates
    if not mesh.number.size:
        raise DeckError("no `coordinates`")
    node, last = np.unique(mesh.number[::-1], return_index=True)
    position = np.zeros((len(mesh.number), TRANSLATIONS))
    position[:, : mesh.position.shape[1]] = mesh.position[:, :TRANSLATIONS]
    blocks: list[ElementBlock] = []
    by_material: dict[int, list[IntArray]] = {}
    for block in deck.elements:
        kind = KINDS.get(block.kind)
        if kind is None:
            continue
        corners = block.node[:, : int(kind.removeprefix(kind.rstrip("0123456789")))]
        rows = np.minimum(np.searchsorted(node, corners), node.size - 1)
        absent = node[rows] != corners
        if absent.any():
            number = block.number[absent.any(axis=1)][0]
            raise DeckError(f"element {number} has node {corners[absent][0]} without coordinates")
        blocks.append(ElementBlock(kind, str(block.kind), block.number, rows))
        by_material.setdefault(block.material, []).append(block.number)
    if not blocks:
        types_text = ", ".join(sorted({str(block.kind) for block in deck.elements})) or "none"
        expected = ", ".join(map(str, sorted(KINDS)))
        raise DeckError(
            f"element types {types_text}, expected solids: {expected}", found=types_text
        )
    materials = deck.materials()
    for material in materials:
        if material.elements:  # of decks up to input version 11
            by_material[material.number] = [np.array(material.elements)]
    names = {material.number: material.name for material in materials}
    sections = [
        Section(np.concatenate(parts), normalized_name(names.get(number) or f"{number}"), "", False)
        for number, parts in by_material.items()
        if number or len(by_material) == 1
    ]
    sets = {kind: {} for kind in ("node", "element")}  # type: dict[str, dict[str, IntArray]]
    for name, entry in deck.sets().items():
        if entry.kind in sets:
            sets[entry.kind][normalized_name(name)] = np.unique(entry.member)
    elements = {section.set_name: section.elements for section in sections} | sets["element"]
    return SolidModel(
        units=LENGTH_UNITS[length_unit or "mm"],
        node=node,
        position=position[::-1][last],
        elements=tuple(blocks),
        node_sets=sets["node"],
        element_sets=elements,
        sections=tuple(sections),
    )


def held_freedoms(deck: MarcDeck, model: SolidModel, names: tuple[str, ...]) -> BoolArray:
    """Displacements that the conditions `names` prescribe, ``(N, 3)``.

    Of a set of edges or faces all nodes of its elements are taken.
    """
    is_held, sets = np.zeros((model.node.size, TRANSLATIONS), dtype=bool), deck.sets()
    for condition in deck.conditions():
        if condition.family != FIXED_DISPLACEMENT or condition.name not in names:
            continue
        entry = sets.get(condition.set_name)
        if entry is None:
            raise condition.line.error(f"no set {condition.set_name!r} of {condition.name!r}")
        rows = (
            model.rows_of(np.unique(entry.member))
            if entry.kind == "node"
            else np.unique(
                np.concatenate(
                    [
                        block.rows[np.isin(block.number, entry.member[:, 0])].ravel()
                        for block in model.elements
                    ]
                )
            )
        )
        for _, _, direction in condition.drives:
            if 1 <= direction <= TRANSLATIONS:
                is_held[rows, direction - 1] = True
    return is_held


def held_names(deck: MarcDeck, case: LoadCase | None) -> Iterator[str]:
    """Names of the fixed displacements that act in a load case; of all without one."""
    for condition in deck.conditions():
        acts = case is None or condition.name in case.active
        if condition.family == FIXED_DISPLACEMENT and acts:
            yield condition.name
