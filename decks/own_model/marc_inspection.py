"""Contents of a Marc deck: elements, materials, sets, load cases, motion, contact.

A part that has a shape which no known deck has is left out with a warning.
"""

from collections import Counter
from collections.abc import Callable, Iterable
from typing import TypeVar

import numpy as np

from decks.marc.contents import (
    BODY_KINDS,
    FIXED_DISPLACEMENT,
    MarcDeck,
    read_marc_deck,
)
from decks.own_model import Request
from decks.own_model.inspection import PA_PER_MPA, Inspection
from decks.own_model.marc_deck import materials_at, table_uses
from decks.unit_system import LENGTH_UNITS
from fembridge.errors import DeckError

_Item = TypeVar("_Item")
# Families of element types, of the types that `decks.marc.contents.NODES` lists.
_PLANE = {3, 6, 11, 26, 27, 53, 54, 58, 80, 91, 114, 115, 118, 124, 125, 128, 139, 151, 152, 201}
_PLANE |= {2, 10, 20, 28, 32, 33, 55, 59, 66, 67, 82, 83, 116, 119, 126, 129, 156, 200}
_SHELL = {1, 15, 22, 49, 50, 72, 75, 85, 86, 87, 88, 89, 138, 139, 140}
_BEAM = {5, 13, 14, 16, 25, 45, 52, 76, 77, 78, 79, 98}
_TRUSS = {9, 12, 51, 64}


def inspect_marc(data: bytes, request: Request) -> Inspection:
    """Inspect a Marc deck; `request` names the motion, the step, afferents and unit of length.

    Raises
    ------
    DeckError
        No Marc deck, cut short, or its counts do not agree.
    """
    deck = read_marc_deck(data)
    result = Inspection("marc", LENGTH_UNITS[request.length_unit or "mm"])
    result.stated = "requested" if request.length_unit else "assumed"
    for remark in deck.remarks:
        result.warn("elements", remark)

    mesh = deck.coordinates
    result.nodes = len(mesh.number)
    result.size = tuple(np.ptp(mesh.position, axis=0).tolist()) if mesh.position.size else ()
    names = _add_materials(result, deck)
    counts: Counter[tuple[int, int]] = Counter()
    for block in deck.elements:
        counts[block.kind, block.material] += len(block.number)
    for (kind, material), count in counts.items():
        row = {
            "part": "",
            "instance": "",
            "element": str(kind),
            "family": _family(kind),
            "elements": count,
            "material": names.get(material, str(material) if material else ""),
        }
        result.parts.append(row)
    flat = len(result.size) < 3 or not result.size[2]
    result.dimensions = 2 if flat else 3
    result.sets += [
        {"set": name, "instance": "", "kind": item.kind, "members": len(item.member), "line": None}
        for name, item in _read(result, lambda: deck.sets().items())
    ]
    result.contacts += [
        {
            "kind": "contact body",
            "type": BODY_KINDS.get(body.kind, str(body.kind)),
            "slave": body.name,
            "master": "",
            "interaction": "",
            "line": body.line.number,
        }
        for body in _read(result, deck.bodies)
    ]
    for case in _read(result, deck.load_cases):
        result.steps.append(
            {
                "step": case.number,
                "name": case.name,
                "procedure": "" if case.stepping is None else case.stepping.keyword,
                "nlgeom": False,
                "period_s": case.period,
                "role": "",
                "line": case.line.number,
            }
        )
    quantity = "displacement" if request.load is None else request.load.quantity
    _add_motions(result, deck, quantity)
    for name, node in request.afferents.items():
        kinds = [str(block.kind) for block in deck.elements if (block.node == node).any()]
        materials = [names.get(number, str(number)) for number in materials_at(deck, node)]
        result.afferents.append(
            {
                "afferent": name,
                "node": node,
                "instance": "",
                "elements": ", ".join(dict.fromkeys(kinds)),
                "materials": ", ".join(materials),
            }
        )
    result.check_units()
    return result


def _read(result: Inspection, view: Callable[[], Iterable[_Item]]) -> list[_Item]:
    """Items of a part of the deck; none and a warning where it cannot be read."""
    try:
        return list(view())
    except DeckError as error:
        result.warn("cards", f"not read: {error}")
        return []


def _family(kind: int) -> str:
    if kind in _PLANE:
        return "plane"
    for family, kinds in (("shell", _SHELL), ("beam", _BEAM), ("truss", _TRUSS)):
        if kind in kinds:
            return family
    return "solid"


def _add_materials(result: Inspection, deck: MarcDeck) -> dict[int, str]:
    """Isotropic materials; their names by number."""
    elements: Counter[int] = Counter()
    for block in deck.elements:
        elements[block.material] += len(block.number)
    names: dict[int, str] = {}
    materials = _read(result, deck.materials)
    for material in materials:
        names[material.number] = material.name
        young, poisson = material.values[:2]
        count = len(material.elements) or elements[material.number]
        result.materials.append(
            {
                "material": material.name,
                "law": "isotropic",
                "young_mpa": young * result.units.stress_pa / PA_PER_MPA,
                "poisson": poisson,
                "density_kg_m3": None,
                "elements": count or None,
                "line": None,
            }
        )
    return names


def _add_motions(result: Inspection, deck: MarcDeck, quantity: str) -> None:
    """Motions and loads with a table, and conditions without one.

    Those of the `quantity` that becomes the waveform have the role of a motion.
    """
    tables = {table.number: table.name for table in deck.tables}
    for use in _read(result, lambda: table_uses(deck)):
        result.motions.append(
            {
                "step": None,
                "target": use.target,
                "degree": None,
                "direction": "",
                "magnitude": use.value,
                "amplitude": tables.get(use.table, str(use.table)),
                "role": "motion" if use.quantity == quantity else "load",
                "line": use.line.number,
            }
        )
    for condition in _read(result, deck.conditions):
        for value, table, direction in condition.drives:
            if value and not table:
                result.loads.append(
                    {
                        "step": None,
                        "card": condition.family,
                        "target": condition.set_name or condition.name,
                        "label": str(direction) if condition.family == FIXED_DISPLACEMENT else "",
                        "magnitude": value,
                        "course": "without a table",
                        "line": condition.line.number,
                    }
                )
                result.warn(
                    "waveform",
                    f"`{condition.family}` {condition.name!r} has no table: Marc may ramp it "
                    "over the load case, whose length becomes the waveform's; give it a table",
                    condition.line.number,
                )
