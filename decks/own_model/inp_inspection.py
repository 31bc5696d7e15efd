"""Contents of a keyword deck (``.inp``): parts, materials, sets, steps, motion, loads, contact.

Nothing here refuses: a row that cannot be read is left out. `inp_deck.rebase_inp` refuses decks
that take no waveform.
"""

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import chain

import numpy as np

from decks.assembly import Scope, scopes_of
from decks.inp import Block, Deck, Resolver, members, normalized_name, read_inp
from decks.own_model import Request
from decks.own_model.inp_deck import units_of
from decks.own_model.inp_drive import (
    MOVABLE,
    Drive,
    Step,
    load_magnitudes,
    period_s,
    steps_of,
)
from decks.own_model.inp_load_drive import drive_of
from decks.own_model.inp_loads import LOADS, direction_text, loads_in, ramps
from decks.own_model.inp_model import EXPANDED, WITHOUT_STRESS, ModelScope, elements_in, family_of
from decks.own_model.inspection import (
    PA_PER_MPA,
    WAVEFORM,
    Finding,
    Inspection,
    density_kg_m3,
    gravity_finding,
    part_row,
)
from fembridge.errors import DeckError
from fembridge.typing import FloatArray, Table

# Cards that define how a material deforms, the first that a solver goes by.
_LAWS = (
    *("HYPERELASTIC", "HYPERFOAM", "USERMATERIAL", "DEFORMATIONPLASTICITY", "ELASTIC"),
    *("FLUIDCONSTANTS", "CONDUCTIVITY"),
)
_ADDED_LAWS = ("PLASTIC", "CYCLICHARDENING", "CREEP", "VISCOELASTIC", "MOHRCOULOMB", "EXPANSION")
_OTHER_PROCEDURES = (
    *("FREQUENCY", "BUCKLE", "MODALDYNAMIC", "STEADYSTATEDYNAMICS", "HEATTRANSFER", "CFD"),
    *("COUPLEDTEMPERATURE-DISPLACEMENT", "UNCOUPLEDTEMPERATURE-DISPLACEMENT", "GREEN"),
    *("COMPLEXFREQUENCY", "SENSITIVITY", "ELECTROMAGNETICS", "SUBSTRUCTUREGENERATE"),
    *("NOANALYSIS", "RADIATE", "FEASIBLEDIRECTION", "ROBUSTDESIGN", "CRACKPROPAGATION"),
)
PROCEDURES = (*MOVABLE, *_OTHER_PROCEDURES)
# Cards that CalculiX ignores or replaces by something else.
_APPROXIMATED = {
    "VISCOELASTIC": "ccx 2.20 leaves it out and solves the material elastic; build-deck writes "
    "Maxwell branches instead, where ccx can solve them",
    "MULLINSEFFECT": "ccx 2.20 leaves it out",
    "HYSTERESIS": "ccx 2.20 leaves it out",
}
_LAST_FREE_DEGREE = 3
_APART = 10**12  # between the numbers of two instances
_MANY = 10_000_000


def inspect_inp(
    data: bytes, request: Request, *, dialect: str, resolver: Resolver | None = None
) -> Inspection:
    """Inspect a deck of ``"calculix"`` or ``"abaqus"``.

    `request` names the motion, the step, the afferents and the unit of length, as for a new
    waveform; where it leaves the motion open, no row has the role of the waveform.

    Raises
    ------
    DeckError
        The deck has no readable structure: files that include each other, parts without an end.
    """
    deck = read_inp(data, abaqus=dialect == "abaqus", resolver=resolver)
    units, stated = units_of(deck, request)
    scopes = scopes_of(deck)
    result = Inspection(dialect, units)
    if request.length_unit:
        result.stated = "requested"
    elif stated:
        result.stated = "the heading"
    models = [(scope, ModelScope(scope.blocks)) for scope in scopes]
    _add_mesh(result, deck, scopes)
    _add_parts(result, models, request)
    _add_materials(result, deck, models)
    _add_sets(result, scopes)
    _add_contacts(result, deck)
    drive = None
    with suppress(DeckError):  # `rebase_inp` reports it
        drive = drive_of(deck, request)
    _add_steps(result, deck, request, drive)
    _add_afferents(result, models, request)
    _add_cards(result, deck)
    result.check_units()
    return result


def _add_mesh(result: Inspection, deck: Deck, scopes: Sequence[Scope]) -> None:
    """Number of nodes and the box around them."""
    boxes: list[FloatArray] = []
    numbers: set[tuple[str, int]] = set()
    for scope in scopes:
        positions: list[list[float]] = []
        for block in scope.blocks:
            if block.keyword != "NODE":
                continue
            cylindrical = block.value_of("SYSTEM") not in ("", "R")
            for row in block.rows():
                with suppress(DeckError):
                    numbers.add((scope.instance, row.integer(0)))
                    if not cylindrical:
                        positions.append([row.number(1 + axis, blank=0.0) for axis in range(3)])
        if positions:
            placed = scope.placement.moved(np.array(positions))
            boxes += [placed.min(axis=0), placed.max(axis=0)]
    result.nodes = len(numbers)
    if boxes:
        result.size = tuple(np.ptp(boxes, axis=0).tolist())
    for inclusion in deck.inclusions:
        if not inclusion.read:
            result.warn("cards", f"{inclusion.where}: {inclusion.name} was not read")


def _add_parts(
    result: Inspection, models: Sequence[tuple[Scope, ModelScope]], request: Request
) -> None:
    """Element types by section; elements without a section have a part of their own."""
    for scope, model in models:
        counts: Counter[tuple[str, str, str]] = Counter()
        for block in scope.blocks:
            if block.keyword != "ELEMENT":
                continue
            kind = block.value_of("TYPE")
            for element in elements_in(block):
                section = model.section_of(element.number)
                name = block.value_of("ELSET") if section is None else section.element_set
                counts[name, kind, "" if section is None else section.material] += 1
        bare: Counter[tuple[str, str]] = Counter()  # type of elements, card of their section
        cards = {section.element_set: section.block for section in model.sections}
        for (name, kind, material), count in counts.items():
            result.parts.append(part_row(name, kind, count, material, scope.instance))
            if not material and family_of(kind) not in (*WITHOUT_STRESS, "other"):
                bare[kind, cards[name].title if name in cards else ""] += count
        for (kind, card), count in bare.items():
            reason = (
                f"{card} states none, so there is no stress" if card else "no section names them"
            )
            message = f"{count} elements {kind} have no material: {reason}"
            result.problems.append(Finding("materials", message))
    families = result.families
    result.dimensions = 2 if families & {"plane"} and not families & {"solid", *EXPANDED} else 3
    if result.solver != "calculix":
        return
    for family in sorted(families.intersection(EXPANDED)):
        layered = family in ("shell", "membrane")
        if layered and request.shell_face is not None:
            continue
        effect = "needs --shell-face, the layer whose stress it reads" if layered else "is refused"
        result.warn(
            "elements",
            f"CalculiX makes solids of {family} elements; an afferent at their nodes {effect}",
        )


def _add_materials(
    result: Inspection, deck: Deck, models: Sequence[tuple[Scope, ModelScope]]
) -> None:
    """Materials with their law, initial stiffness and density."""
    elements: Counter[str] = Counter()
    for part in result.parts:
        for material in part["material"].split("+"):
            elements[material] += part["elements"]
    groups: list[list[Block]] = []
    for block in deck.blocks:
        if block.keyword == "MATERIAL":
            groups.append([block])
        elif groups and (block.keyword in _LAWS or block.keyword in (*_ADDED_LAWS, "DENSITY")):
            groups[-1].append(block)
    for head, *cards in groups:
        name = head.value_of("NAME")
        law = next((card for keyword in _LAWS for card in cards if card.keyword == keyword), None)
        young, poisson = (None, None) if law is None else stiffness_of(law)
        density = next(
            (
                row.number(0, blank=0.0)
                for card in cards
                if card.keyword == "DENSITY"
                for row in [*card.rows()][:1]
            ),
            None,
        )
        laws = [] if law is None else [_law_name(law)]
        laws += [card.keyword.lower() for card in cards if card.keyword in _ADDED_LAWS]
        result.materials.append(
            {
                "material": name,
                "law": ", ".join(dict.fromkeys(laws)),
                "young_mpa": None if young is None else young * result.units.stress_pa / PA_PER_MPA,
                "poisson": poisson,
                "density_kg_m3": None if density is None else density_kg_m3(density, result.units),
                "elements": elements[name],
                "line": head.line,
            }
        )
        if poisson is not None and not -1.0 < poisson < 0.5:
            message = f"Poisson's ratio of {name} is {poisson:g}, expected less than 0.5"
            result.problems.append(Finding("materials", message, head.line, head.text.name))
    missing = elements.keys() - {row["material"] for row in result.materials} - {""}
    result.problems += [
        Finding("materials", f"a section names the material {name}, which no *MATERIAL defines")
        for name in sorted(missing)
        if not any(not inclusion.read for inclusion in deck.inclusions)
    ]
    for _, model in models:
        for section in model.sections:
            if not model.element_sets.get(section.element_set):
                result.warn(
                    "materials",
                    f"{section.block.title} is for the set {section.element_set}, which has no "
                    "elements",
                    section.block.line,
                    section.block.text.name,
                )


def _law_name(law: Block) -> str:
    names = [law.keyword.lower()]
    names += [
        option.name.lower() if option.value is None else option.normalized.lower()
        for option in law.options
        if option.name not in ("MODULI", "DEPENDENCIES", "CONSTANTS", "TESTDATAINPUT")
    ]
    return " ".join(names)


def stiffness_of(law: Block) -> tuple[float | None, float | None]:
    """Young's modulus at small strain, in the deck's unit, and Poisson's ratio; None if unknown.

    Of an anisotropic material the smallest modulus that is listed. Of a hyperelastic one
    E = 2 (1 + nu) G with nu = 0.5 and G twice the sum of C10 and C01, or the sum of mu.
    """
    rows = list(law.rows())
    try:
        numbers = [row.number(k) for row in rows for k, text in enumerate(row.fields) if text]
    except DeckError:
        return None, None
    if not numbers:
        return None, None
    if law.keyword in ("ELASTIC", "DEFORMATIONPLASTICITY"):
        kind = law.value_of("TYPE")
        if kind in ("", "ISO", "ISOTROPIC"):
            return numbers[0], numbers[1] if len(numbers) > 1 else None
        if kind == "ENGINEERINGCONSTANTS":
            return min(numbers[:3]), None
        diagonal = [numbers[k] for k in (0, 2, 5) if k < len(numbers)]
        return min(diagonal), None
    if law.keyword in ("HYPERELASTIC", "HYPERFOAM"):
        shear = _hyperelastic_shear(law, numbers)
        return (None, None) if shear is None else (3.0 * shear, None)
    return None, None


def _hyperelastic_shear(law: Block, numbers: Sequence[float]) -> float | None:
    """Shear modulus at small strain of a hyperelastic material; None if it is not known."""
    options = {option.name for option in law.options}
    order = 1
    with suppress(ValueError):
        order = int(law.value_of("N") or 1)
    if "OGDEN" in options:
        return sum(numbers[0 : 2 * order : 2])
    if law.keyword == "HYPERFOAM":
        return sum(numbers[0 : 2 * order : 2])
    if options & {"NEOHOOKE", "YEOH", "REDUCEDPOLYNOMIAL"}:
        return 2.0 * numbers[0]
    if options & {"MOONEY-RIVLIN", "POLYNOMIAL"}:
        return 2.0 * sum(numbers[:2])
    if options & {"ARRUDA-BOYCE"}:
        return numbers[0]
    return None


def _add_sets(result: Inspection, scopes: Sequence[Scope]) -> None:
    """Sets of nodes and elements, and how many members each has.

    A set of the assembly may name sets of an instance.
    """
    assembly, *instances = scopes
    names = ["", *(normalized_name(scope.instance) for scope in instances)]
    of_instance: dict[tuple[str, str], dict[str, list[range]]] = {}
    tables: list[list[Table]] = []
    for scope in (*instances, assembly):
        rows: list[Table] = []
        for kind, maker in (("NSET", "NODE"), ("ELSET", "ELEMENT")):
            runs: dict[str, list[range]] = {}
            lines: dict[str, int] = {}
            for block in scope.blocks:
                name = block.value_of(kind)
                if block.keyword in (kind, maker) and name:
                    lines.setdefault(name, block.line)
                    instance = block.value_of("INSTANCE")
                    source = of_instance.get((instance, kind), runs)
                    # The same number of two instances is two members.
                    apart = names.index(instance) * _APART if instance in names else 0
                    runs.setdefault(name, []).extend(
                        range(run.start + apart, run.stop + apart, run.step)
                        for run in list(_numbers(block, source))
                    )
            of_instance[normalized_name(scope.instance), kind] = runs
            rows += [
                {
                    "set": name,
                    "instance": scope.instance,
                    "kind": "nodes" if kind == "NSET" else "elements",
                    "members": _count(runs[name]),
                    "line": line,
                }
                for name, line in lines.items()
            ]
        tables.append(rows)
    *of_instances, of_assembly = tables
    for rows in (of_assembly, *of_instances):
        result.sets += rows


def _count(runs: Sequence[range]) -> int:
    """How many different numbers runs have; of very many their sum."""
    total = sum(map(len, runs))
    return total if total > _MANY else len(set(chain.from_iterable(runs)))


def _numbers(block: Block, sets: Mapping[str, list[range]]) -> Iterator[range]:
    if block.keyword == "ELEMENT":
        yield from (range(item.number, item.number + 1) for item in elements_in(block))
        return
    try:
        yield from members(block, sets)
    except DeckError:
        return


def _add_contacts(result: Inspection, deck: Deck) -> None:
    """Contact pairs and ties, and a warning of path-dependent contact."""
    for block in deck.blocks_of("CONTACTPAIR", "TIE"):
        for row in block.rows():
            slave, master = (*row.fields, "", "")[:2]
            result.contacts.append(
                {
                    "kind": block.keyword.lower().replace("contactpair", "contact pair"),
                    "type": block.value_of("TYPE"),
                    "slave": slave,
                    "master": master,
                    "interaction": block.value_of("INTERACTION"),
                    "line": block.line,
                }
            )
    if result.solver == "calculix":
        for block in deck.blocks_of("CONTACTPAIR"):
            if block.value_of("TYPE") == "SURFACETOSURFACE":
                result.warn(
                    "contact",
                    f"{block.title}, TYPE={block.value_of('TYPE')} is path-dependent in CalculiX: "
                    "on unloading, stress at a depth differs from that on loading (by 1.7 % on a "
                    "block, up to 20 %); TYPE=NODE TO SURFACE is not",
                    block.line,
                    block.text.name,
                )


def _add_steps(result: Inspection, deck: Deck, request: Request, drive: Drive | None) -> None:
    """Steps with their part in a run, displacements and loads."""
    try:
        steps = steps_of(deck)
    except DeckError:  # `rebase_inp` reports it
        return
    kept_ramps: set[int] = set()
    if drive is not None:
        with suppress(DeckError):  # `rebase_inp` reports it
            ramped = ramps(deck, drive, abaqus=result.solver == "abaqus")
            kept_ramps = {load.row.start for ramp in ramped for load in ramp.loads}
    for step in steps:
        procedure = next(iter(step.blocks_of(*PROCEDURES)), None)
        period = None
        with suppress(DeckError):
            if procedure is not None and procedure.keyword in MOVABLE:
                period = period_s(procedure)
        result.steps.append(
            {
                "step": step.number,
                "name": step.head.value_of("NAME"),
                "procedure": "" if procedure is None else procedure.title,
                "nlgeom": step.head.option("NLGEOM") is not None,
                "period_s": period,
                "role": _role(step, drive),
                "line": step.head.line,
            }
        )
        _add_motions(result, deck, step, drive)
        _add_loads(result, step, drive, kept_ramps)


def _role(step: Step, drive: Drive | None) -> str:
    """Role of a step in a run: before, waveform, left out; "" if no motion is chosen."""
    if drive is None:
        return ""
    if step.number == drive.step.number:
        return "waveform"
    return "before" if step.number < drive.step.number else "left out"


def _add_motions(result: Inspection, deck: Deck, step: Step, drive: Drive | None) -> None:
    """Displacements other than 0, and which of them becomes the waveform."""
    driven = set() if drive is None else {(push.row.start, push.axis) for push in drive.push}
    for block in step.blocks_of("BOUNDARY"):
        with suppress(DeckError):
            for push in load_magnitudes(block, zero=True):
                is_driven = (
                    drive is not None
                    and step.number == drive.step.number
                    and (push.row.start, push.axis) in driven
                )
                if not (push.magnitude or is_driven):
                    continue
                is_length = push.axis <= _LAST_FREE_DEGREE
                result.motions.append(
                    {
                        "step": step.number,
                        "target": push.target,
                        "degree": push.axis,
                        "direction": direction_text(deck, push) if is_length else "",
                        "magnitude": push.magnitude,
                        "amplitude": push.amplitude,
                        "role": "waveform" if is_driven else _role(step, drive) and "other",
                        "line": push.row.line,
                    }
                )


def _add_loads(
    result: Inspection, step: Step, drive: Drive | None, kept_ramps: Collection[int]
) -> None:
    """Loads and their course, and warnings of those that the waveform's step ramps."""
    for block in step.blocks_of(*LOADS):
        with suppress(DeckError):
            for load in loads_in(block):
                if block.keyword == "BOUNDARY" or not load.magnitude:
                    continue
                ramped = (
                    drive is not None
                    and step.number == drive.step.number
                    and load.row.start in kept_ramps
                )
                course = f"amplitude {load.amplitude}" if load.amplitude else ""
                if drive is not None and load.row.start in {push.row.start for push in drive.push}:
                    course = WAVEFORM
                result.loads.append(
                    {
                        "step": step.number,
                        "card": block.title,
                        "target": load.target,
                        "label": load.label,
                        "magnitude": load.magnitude,
                        "course": "own ramp kept" if ramped else course,
                        "line": load.row.line,
                    }
                )
                if load.label == "GRAV":
                    finding = gravity_finding(
                        load.magnitude, result.units, load.row.line, load.row.text.name
                    )
                    result.warnings += [] if finding is None else [finding]


def _add_afferents(
    result: Inspection, models: Sequence[tuple[Scope, ModelScope]], request: Request
) -> None:
    """Elements and materials at each afferent's node."""
    for scope, model in models:
        around = model.elements_at(request.afferents.values())
        for name, node in request.afferents.items():
            if not around[node] and len(models) > 1:
                continue
            kinds = dict.fromkeys(element.kind for element in around[node])
            materials = dict.fromkeys(model.material_of(item.number) for item in around[node])
            result.afferents.append(
                {
                    "afferent": name,
                    "node": node,
                    "instance": scope.instance,
                    "elements": ", ".join(kinds),
                    "materials": ", ".join(filter(None, materials)),
                }
            )
            if len(materials) > 1 and result.solver == "abaqus":
                result.warn(
                    "afferents",
                    f"{name}: node {node} is between {' and '.join(materials)}; read the stress of "
                    "one material alone",
                )


def _add_cards(result: Inspection, deck: Deck) -> None:
    """Cards that CalculiX leaves out or solves as something else."""
    if result.solver != "calculix":
        return
    for block in deck.blocks:
        effect = _APPROXIMATED.get(block.keyword)
        if effect is not None:
            result.cards.append({"card": block.title, "effect": effect, "line": block.line})
            result.warn("cards", f"{block.title}: {effect}", block.line, block.text.name)
