"""Relaxing materials of a deck for CalculiX as Maxwell branches, which ccx can solve.

    *MATERIAL, NAME=DERMIS
    *ELASTIC, MODULI=INSTANTANEOUS
    0.08, 0.48
    *VISCOELASTIC, TIME=PRONY
    0.3, 0., 0.02                share of the shear modulus, of the bulk modulus, time in s

ccx 2.20 leaves ``*VISCOELASTIC`` out and stays elastic. As in our own decks (`decks.calculix`)
the material keeps the stiffness that lasts, and its elements are there again for each term,
elastic with creep; ``*VISCO`` replaces ``*STATIC``. Materials that ccx cannot solve so stay as
they are.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from decks.calculix import branches, lasting
from decks.contact_analysis import ElementSet
from decks.finger import Material, PronyTerm
from decks.inp import Block, Deck, Row
from decks.keyword_deck import list_lines
from decks.own_model.inp_model import Element, ModelScope, family_of
from decks.unit_system import UnitSystem
from fembridge.errors import DeckError, FingerError

OWN_BRANCH = "FEMBRIDGE_PRONY_"
"""Names of the branches' sets and materials begin so."""
_PA_PER_MPA = 1.0e6
_OTHER_LAWS = ("PLASTIC", "CREEP", "HYPERELASTIC", "HYPERFOAM", "USERMATERIAL", "EXPANSION")


@dataclass(frozen=True, slots=True, eq=False)
class Relaxation:
    """A relaxing material: its cards, and the lines that replace it.

    `elastic` is the row of its moduli, which becomes `lasting_line`; `option` is ``MODULI``
    there. `branch_lines` are put before the first step; `terms` is the number of branches.
    """

    name: str
    viscoelastic: Block
    elastic: Block
    row: Row
    lasting_line: str
    branch_lines: tuple[str, ...]
    terms: int


def relaxations(
    deck: Deck, scope: ModelScope, units: UnitSystem, dt_s: float
) -> tuple[list[Relaxation], list[str]]:
    """The relaxing materials that ccx can solve, and remarks on those that it cannot.

    Parameters
    ----------
    dt_s
        The fixed increment, for which the branches are exact.
    """
    translated: list[Relaxation] = []
    remarks: list[str] = []
    elements = list(scope.elements())
    free = max((element.number for element in elements), default=0) + 1
    for head, cards in _materials(deck):
        viscous = [card for card in cards if card.keyword == "VISCOELASTIC"]
        if not viscous:
            continue
        name = head.value_of("NAME")
        members = [item for item in elements if scope.material_of(item.number) == name]
        try:
            values, elastic = _material(cards, viscous, members, units)
            number = len(translated) + 1
            lines = list(_branch_lines(values, number, members, free, scope, units, dt_s))
        except (DeckError, FingerError) as error:
            remarks.append(
                f"{viscous[0].where}: {name} relaxes, but CalculiX solves it elastic: {error}"
            )
            continue
        free += len(members) * len(values.prony)
        lasts = lasting(_element_set(values)).material
        unit_mpa = units.stress_pa / _PA_PER_MPA
        translated.append(
            Relaxation(
                name=name,
                viscoelastic=viscous[0],
                elastic=elastic,
                row=next(elastic.rows()),
                lasting_line=f"{lasts.young_mpa / unit_mpa:.9g}, {lasts.poisson:.9g}",
                branch_lines=tuple(lines),
                terms=len(values.prony),
            )
        )
    return translated, remarks


def _materials(deck: Deck) -> Iterator[tuple[Block, list[Block]]]:
    """Each ``*MATERIAL`` with the cards up to the next one, a section or a step."""
    head: Block | None = None
    cards: list[Block] = []
    for block in deck.blocks:
        ends = block.keyword in ("MATERIAL", "STEP") or block.keyword.endswith("SECTION")
        if ends and head is not None:
            yield head, cards
            head = None
        if block.keyword == "MATERIAL":
            head, cards = block, []
        elif head is not None:
            cards.append(block)
    if head is not None:
        yield head, cards


def _material(
    cards: list[Block], viscous: list[Block], elements: list[Element], units: UnitSystem
) -> tuple[Material, Block]:
    """The material with instantaneous moduli in MPa, and its ``*ELASTIC``."""
    if others := [card.title for card in cards if card.keyword in _OTHER_LAWS]:
        raise DeckError(f"{others[0]} and creep are not possible together")
    elastic = [card for card in cards if card.keyword == "ELASTIC"]
    if len(elastic) != 1 or len(viscous) != 1 or elastic[0].value_of("TYPE") not in ("", "ISO"):
        raise DeckError("expected one *ELASTIC, isotropic, and one *VISCOELASTIC")
    if viscous[0].value_of("TIME") != "PRONY" or len(list(elastic[0].rows())) != 1:
        raise DeckError("expected TIME=PRONY, and moduli that do not depend on temperature")
    families = {family_of(element.kind) for element in elements}
    if not elements or families - {"solid", "plane"}:
        raise DeckError("expected solid or plane elements")
    terms = []
    for row in viscous[0].rows():
        shear, bulk, tau_s = (row.number(index, blank=0.0) for index in range(3))
        if bulk:
            raise DeckError("its bulk modulus relaxes as well")
        terms.append(PronyTerm(shear, tau_s))
    row = next(elastic[0].rows())
    young_mpa = row.number(0) * units.stress_pa / _PA_PER_MPA
    poisson = row.number(1, blank=0.0)
    at_once = elastic[0].value_of("MODULI") == "INSTANTANEOUS"
    if not at_once:  # the moduli that last; the bulk modulus is the same at all times
        share = 1.0 - sum(term.g for term in terms)
        if share <= 0:
            raise DeckError("its terms take all of the shear modulus")
        bulk_mpa = young_mpa / (3.0 * (1.0 - 2.0 * poisson))
        shear_mpa = young_mpa / (2.0 * (1.0 + poisson)) / share
        young_mpa = 9.0 * bulk_mpa * shear_mpa / (3.0 * bulk_mpa + shear_mpa)
        poisson = young_mpa / (2.0 * shear_mpa) - 1.0
    return Material(young_mpa, poisson, tuple(terms)), elastic[0]


def _element_set(values: Material) -> ElementSet:
    none = np.empty((0, 4), dtype=np.int64)
    return ElementSet("", np.empty(0, dtype=np.int64), none, values, "linear")


def _branch_lines(
    values: Material,
    number: int,
    elements: list[Element],
    free: int,
    scope: ModelScope,
    units: UnitSystem,
    dt_s: float,
) -> Iterator[str]:
    """Elements, materials and sections of the branches of one material, from element `free`."""
    unit_mpa = units.stress_pa / _PA_PER_MPA
    for term, (branch, creep) in enumerate(branches([_element_set(values)], 1, dt_s), start=1):
        by_section: dict[str, list[Element]] = {}
        for element in elements:
            section = scope.section_of(element.number)
            assert section is not None  # it has the material
            by_section.setdefault(section.element_set, []).append(element)
        material = f"{OWN_BRANCH}{number}_{term}"
        for part, (set_name, members) in enumerate(by_section.items(), start=1):
            name = f"{material}_{part}"
            for kind in dict.fromkeys(element.kind for element in members):
                yield f"*ELEMENT, TYPE={kind}, ELSET={name}"
                for element in members:
                    if element.kind == kind:
                        yield from list_lines([free, *element.nodes]).rstrip(",").splitlines()
                        free += 1
            section = next(
                item for item in reversed(scope.sections) if item.element_set == set_name
            )
            yield f"*SOLID SECTION, ELSET={name}, MATERIAL={material}"
            thickness = next(section.block.rows(), None)
            if thickness is not None:
                yield ", ".join(thickness.fields)
        yield f"*MATERIAL, NAME={material}"
        yield "*ELASTIC"
        yield f"{branch.material.young_mpa / unit_mpa:.9g}, {branch.material.poisson:.9g}"
        yield "*CREEP, LAW=NORTON"
        yield f"{creep * unit_mpa:.9g}, 1., 0."


def without_branches(elements: list[Element], scope: ModelScope) -> tuple[list[Element], int]:
    """`elements` without those of branches, and how many branches the node has."""
    sets: dict[str, None] = {}
    others = []
    for element in elements:
        section = scope.section_of(element.number)
        if section is not None and section.element_set.startswith(OWN_BRANCH):
            sets.setdefault(section.material)
        else:
            others.append(element)
    return others, len(sets)
