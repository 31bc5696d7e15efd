"""CalculiX: an analysis as the text of an input deck, in the dialect of ccx 2.20.

The same analysis gives the same bytes, ASCII with LF line ends. A deck holds the right
half of the section where that shows all of it. Four parts of it are there because of how
ccx works, each explained where it is written: contact of a half, relaxing skin, the
probe's support, inertia.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from decks import keyword_deck as parts
from decks.analysis import Analysis, Contact, ElementSet
from decks.dialects import DIALECTS, DeckOptions
from decks.keyword_deck import OUTPUT_SET, Moved, element_lines, fixed, list_lines, material, real
from decks.material import Material, PronyTerm
from fembridge.errors import DeckError
from fembridge.typing import IntArray

_DIALECT = DIALECTS["calculix"]
_RIGID = "all of its nodes are tied to one"
# Fixed increments make nothing of CETOL, a bound of creep; ccx wants it all the same.
_CARDS = {
    "static": "*STATIC, DIRECT",
    "viscous": "*VISCO, DIRECT, CETOL=1.0E6",
    "dynamic": "*DYNAMIC, DIRECT, ALPHA=-0.3",
}

_TENSION_MPA = 0.001
_AXIS_SHARE = 0.5
# Branches add no mass to the layer that they lie over.
NO_MASS_KG_M3 = 1.0

_SUPPORT_N_PER_MM = 1.0e5
_NO_FORCE_N = 1.0e-12
# Places of nodes that no element has; for a person who looks at the mesh.
_RIGID_MM, _DRIVER_MM, _STORE_MM = 1.0, 2.0, 100.0
# 1e-3 N on 1e-9 N/mm store 500 N mm; skin pressed in by 0.5 mm, about 0.01.
_STORE_N_PER_MM = 1.0e-9
_STORE_N = 1.0e-3
# Of the residual, 0.5 % of this is allowed in a node.
_AVERAGE_FORCE_N = 5.0e-5


def calculix_files(analysis: Analysis, options: DeckOptions) -> dict[str, str]:
    """The deck under its name in a run folder."""
    return {_DIALECT.deck: calculix_deck(analysis, binary=options.results != "text")}


def calculix_deck(analysis: Analysis, *, binary: bool = True) -> str:
    """Write `analysis` as a deck for ccx 2.20.

    `binary` asks for float64 results at the watched nodes; without it ccx
    writes ASCII, whose six digits add noise to a second derivative.

    Raises
    ------
    DeckError
        An element or a contact that ccx has not.
    """
    _DIALECT.element_named(analysis.element)
    large_strain = ", NLGEOM" if analysis.large_strain else ""
    on_spring = analysis.support == "spring"
    if analysis.inertia:
        support, moved = _energy_store(analysis), _moved_with_store(analysis)
    elif on_spring:
        support, moved = _spring(analysis), _moved_by_spring(analysis)
    else:
        support, moved = iter(()), Moved()
    blocks = (
        _heading(analysis),
        parts.finger(analysis),
        parts.probe(analysis, _RIGID if on_spring else parts.PRESCRIBED),
        parts.sets(analysis),
        _axis(analysis),
        _materials(analysis),
        _contact(analysis),
        support,
        parts.waveform(analysis),
        parts.steps(analysis, _CARDS, large_strain, partial(_output, binary), moved),
    )
    return "\n".join(line for block in blocks for line in block) + "\n"


def _heading(model: Analysis) -> Iterator[str]:
    """What is in the deck, and of a half what is not."""
    yield from parts.heading(model)
    if model.is_half:
        yield "**"
        yield "** Of this section the right half alone, x >= 0: finger, probe and"
        yield "** motion are mirror images about x = 0. Numbers are those of the whole;"
        yield "** those of the left half do not occur. The half is 2 mm thick, for both"
        yield "** halves of 1 mm: forces are those of the whole."


def _axis(model: Analysis) -> Iterator[str]:
    """The nodes on the axis of a half."""
    if model.is_half:
        yield "** ---- On the axis of the half nothing moves aside, and shear is 0; the"
        yield "** SXY that is written there is a mean over one half, not over both"
        yield "*NSET, NSET=AXIS"
        yield from list_lines(model.axis)


def _materials(model: Analysis) -> Iterator[str]:
    yield from parts.MATERIALS_HEADING
    mass, thick_mm = model.inertia, model.thickness_mm
    for section in (*map(lasting, model.layers), model.probe):
        yield from material(section, inertia=mass, thickness_mm=thick_mm)
    first = int(model.probe.number.max()) + 1
    found = branches(model.layers, first, model.motion.phases[-1].dt_s)
    yield from branch_lines(found, model.element, inertia=mass, thickness_mm=thick_mm)


def _output(binary: bool, model: Analysis) -> Iterator[str]:
    kind, double = ("OUTPUT", ", DOUBLE") if binary else ("FILE", "")
    every = model.motion.phases[-1].every
    often = f", FREQUENCY={every}" if every > 1 else ""
    double += often
    yield f"*NODE {kind}, NSET={OUTPUT_SET}{double}"
    yield "U"
    yield f"*{'ELEMENT' if binary else 'EL'} {kind}, NSET={OUTPUT_SET}{double}"
    yield "S"
    if model.inertia:  # ccx has to keep energies from the first increment on
        yield "** energies, which that balance is made of"
        yield f"*EL PRINT, ELSET=PROBE_BODY, TOTALS=ONLY, FREQUENCY={every}"
        yield "ELSE"
    yield "** force of the skin on the probe"
    yield f"*NODE PRINT, NSET=PROBE, TOTALS=ONLY{often}"
    yield "RF"


# ---- Contact. Of a slave that is a set of nodes ccx gives each node the area of the face
# that it touches, not its own share of the skin. So in a half of the section the node on
# the axis, whose skin is left of it as well, gets a contact pair of its own, with springs
# half as stiff; without it the error is 0.3 % of the stress.


def _contact(model: Analysis) -> Iterator[str]:
    """The two sides, what is between them, and the pair."""
    contact = model.contact
    if contact.formulation not in parts.CONTACT_TYPES:
        raise DeckError(f"ccx has no contact {contact.formulation!r} for plane elements")
    by_node = contact.formulation == "node-to-surface"
    yield "**"
    yield "** ---- Contact: the skin is the slave, the probe the master"
    if by_node:
        yield from _slave("SKIN", np.setdiff1d(model.contact_node, model.axis))
    else:
        yield from parts.skin_surface(model)
    yield from parts.probe_surface(model)
    yield from _interaction("TOUCH", contact)
    yield from parts.contact_pair(model)
    if by_node and model.is_half:
        yield "** The skin on the axis: half of its springs: they are half as stiff"
        yield from _slave("AXIS", np.intersect1d(model.contact_node, model.axis))
        yield from _interaction("TOUCH_ON_AXIS", contact, _AXIS_SHARE)
        yield from parts.contact_pair(model, "AXIS_SURFACE", "TOUCH_ON_AXIS")


def _slave(name: str, nodes: IntArray) -> Iterator[str]:
    yield f"*NSET, NSET={name}_CONTACT"
    yield from list_lines(nodes)
    yield f"*SURFACE, NAME={name}_SURFACE, TYPE=NODE"
    yield f"{name}_CONTACT"


def _interaction(name: str, contact: Contact, share: float = 1.0) -> Iterator[str]:
    """The springs between the two sides, `share` of their stiffness."""
    by_node = contact.formulation == "node-to-surface"
    yield f"*SURFACE INTERACTION, NAME={name}"
    yield "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR"
    yield "** stiffness in MPa/mm" + (", tension at infinity in MPa" if by_node else "")
    stiffness = real(share * contact.stiffness_mpa_per_mm)
    tension = real(share * _TENSION_MPA)
    yield f"{stiffness}, {tension}" if by_node else stiffness
    if contact.friction > 0:
        yield "*FRICTION"
        yield "** coefficient, stick stiffness in MPa/mm"
        stick = contact.stiffness_mpa_per_mm * contact.stick_share * share
        yield f"{real(contact.friction)}, {real(stick)}"


# ---- Relaxing skin. ccx 2.20 reads over ``*VISCOELASTIC`` with a warning and stays elastic.
# So each layer is in the deck once for the share of its stiffness that lasts, and once more,
# on the same nodes, for each Prony term: a Maxwell branch, elastic with creep that is
# proportional to stress (``*CREEP, LAW=NORTON``, exponent 1; ``*VISCO``). The stress of the
# skin is the sum over the branches. At a node ccx writes their mean, which a reader
# multiplies by their number.
#
# ccx relaxes by backward Euler: in a step of x = dt/tau a branch keeps 1/(1 + x'), x' being
# 3 G A dt for the creep rate A sigma. With G' = G (e^x - 1)/x and 3 G' A dt = e^x - 1 that is
# exactly the exponential, and exactly the integral over a step in which strain changes evenly.


@dataclass(frozen=True, slots=True, eq=False)
class Branch:
    """A Maxwell branch: elements over those of a layer; `creep` per MPa and s."""

    section: ElementSet
    creep: float


def lasting(section: ElementSet) -> ElementSet:
    """A layer with the stiffness that does not relax, and all of its mass."""
    values = section.material
    share = values.lasting_share
    if share == 1.0:
        return section
    young_mpa = share * values.young_mpa
    left = Material(young_mpa, values.poisson, density_kg_m3=values.density_kg_m3)
    return replace(section, material=left)


def branches(layers: Sequence[ElementSet], first: int, dt_s: float) -> list[Branch]:
    """The branches of all `layers`; their elements have numbers from `first` on.

    Raises
    ------
    DeckError
        A term that is over within a time step.
    """
    found = []
    for layer in layers:
        for count, term in enumerate(layer.material.prony, start=1):
            if term.tau_s < dt_s:
                raise DeckError(
                    f"{layer.name}: tau_s is {term.tau_s:g}, expected the time step, "
                    f"{dt_s:g} s, or more: a faster term has no effect but a softer "
                    "layer"
                )
            number = np.arange(first, first + len(layer.number))
            first += len(layer.number)
            values, creep = _maxwell(layer.material, term, dt_s)
            name = f"{layer.name}_prony_{count}"
            found.append(Branch(ElementSet(name, number, layer.node, values, "linear"), creep))
    return found


def branch_lines(
    found: Sequence[Branch], element: str, *, inertia: bool, thickness_mm: float = 1.0
) -> Iterator[str]:
    """The branches' elements and materials: elastic, creeping with stress."""
    if found:
        yield "**"
        yield "** ---- Relaxing skin: a Maxwell branch a Prony term, over its layer"
    for branch in found:
        section = branch.section
        yield f"*ELEMENT, TYPE={element}, ELSET={section.name.upper()}"
        yield from element_lines(section.number.tolist(), section.node)
        creep = (
            "** creep rate per MPa and s, exponent of stress, exponent of time",
            "*CREEP, LAW=NORTON",
            f"{real(branch.creep)}, 1.0, 0.0",
        )
        yield from material(section, inertia=inertia, relaxation=creep, thickness_mm=thickness_mm)


def branches_at(model: Analysis) -> dict[int, int]:
    """Number of branches, the lasting one too, at the watched nodes that have more."""
    counts = {}
    for node in model.watched.tolist():
        around = [
            1 + len(layer.material.prony) for layer in model.layers if (layer.node == node).any()
        ]
        if max(around) > 1:
            counts[node] = max(around)
    return counts


def _maxwell(values: Material, term: PronyTerm, dt_s: float) -> tuple[Material, float]:
    grown = math.expm1(dt_s / term.tau_s)
    shear_mpa = term.g * values.shear_mpa * grown * term.tau_s / dt_s
    bulk_mpa = term.g * values.bulk_mpa
    young_mpa = 9 * bulk_mpa * shear_mpa / (3 * bulk_mpa + shear_mpa)
    poisson = young_mpa / (2 * shear_mpa) - 1
    if poisson < 0:
        raise DeckError(
            f"tau_s {term.tau_s:g} is too near the time step, {dt_s:g} s, for a layer "
            f"of Poisson's ratio {values.poisson:g}: expected more of one or the other"
        )
    branch = Material(young_mpa, poisson, density_kg_m3=NO_MASS_KG_M3)
    return branch, grown / (3 * shear_mpa * dt_s)


def _free_element(model: Analysis) -> int:
    """First number that neither finger, probe nor Maxwell branch has."""
    more = sum(len(layer.number) * len(layer.material.prony) for layer in model.layers)
    return int(model.probe.number.max()) + 1 + more


def _free_node(model: Analysis) -> int:
    """First number that neither finger nor probe has."""
    return model.first_probe_node + len(model.probe_node_mm)


# ---- The probe on a spring. ccx begins an increment where the last one's velocities lead to,
# but for what is prescribed: a prescribed probe stands at its new place at once. Where it
# slows down the skin runs ahead of it, contact is lost in the first iteration, and four to
# six more, or none, bring it back. A probe whose nodes are unknowns is predicted as the skin
# is. So they are tied to one node that hangs on the prescribed driver by a spring which gives
# 0.01 um a N/mm: two iterations an increment, the fewest that ccx makes.
#
# Where the probe is off the skin the solution falls to 1e-320, numbers with which processors
# are seven times slower. A force that moves nothing keeps it off that.


def _spring(model: Analysis) -> Iterator[str]:
    """The driver, the spring, and the probe's nodes as one body."""
    driver, element = _free_node(model), _free_element(model)
    rigid = driver + 1
    yield "**"
    yield "** ---- The probe on a stiff spring: its nodes are tied to RIGID, which the"
    yield "** spring, in N/mm, ties to the prescribed DRIVER"
    for name, number, height_mm in (("DRIVER", driver, _DRIVER_MM), ("RIGID", rigid, _RIGID_MM)):
        yield f"*NODE, NSET={name}"
        yield f"{number}, 0.0, {height_mm}, 0.0"
    for count, axis in enumerate((2,) if model.motion.aside_mm is None else (1, 2)):
        yield f"*ELEMENT, TYPE=SPRING2, ELSET=DRIVE_{axis}"
        yield f"{element + count}, {rigid}, {driver}"
        yield f"*SPRING, ELSET=DRIVE_{axis}"
        yield f"{axis}, {axis}"
        yield f"{_SUPPORT_N_PER_MM}"
        for node in model.probe_node.tolist():
            yield "*EQUATION"
            yield "2"
            yield f"{node}, {axis}, 1.0, {rigid}, {axis}, -1.0"


def _moved_by_spring(model: Analysis) -> Moved:
    slides = model.motion.aside_mm is not None
    return Moved(
        name="DRIVER",
        fixed=(
            *(("AXIS, 1, 1",) if model.is_half else ()),
            *(() if slides else ("PROBE, 1, 1", "RIGID, 1, 1")),
            "RIGID, 3, 3",
            "DRIVER, 3, 3",
        ),
        loads=(
            "** a force that moves nothing, against numbers of 1e-320",
            "*CLOAD",
            f"SKIN_APEX, 2, {_NO_FORCE_N:.1E}",
        ),
    )


# ---- Inertia: what a ``*DYNAMIC`` step with contact takes to go through. ccx 2.20 holds
# increments of implicit dynamics with contact against a balance of energy, also fixed ones,
# and ends a run whose balance jumps by 0.25 % of the largest energy so far. The work of a
# prescribed displacement is not in its balance, so a probe that is moved always breaks it.
# The rule has no switch. But a massless spring that is joined to nothing may store, in the
# first increment, many times the energy of the skin: what the skin does is a jump of nothing
# then. That spring moves, so ccx's measure of displacement is void; the residual force alone
# decides, against an average force that is given.
#
# A static step cannot precede: it leaves its speed behind, and a pressed contact a kick. So
# the probe is ramped in, smoothly, in the same step.


def _energy_store(model: Analysis) -> Iterator[str]:
    """The spring, its two nodes, and when it is loaded."""
    motion, end = model.motion, _free_node(model)
    first_s, last_s = motion.phases[0].dt_s, float(motion.time_s[-1])
    yield "**"
    yield "** ---- A store of energy, joined to nothing: beside it no increment of the"
    yield "** skin breaks the balance by which ccx judges contact in dynamics"
    yield "*NODE, NSET=STORE"
    yield f"{end}, 0.0, {_STORE_MM}, 0.0"
    yield f"{end + 1}, 1.0, {_STORE_MM}, 0.0"
    yield "*ELEMENT, TYPE=SPRING1, ELSET=STORE_SPRING"
    yield f"{_free_element(model)}, {end + 1}"
    yield "*SPRING, ELSET=STORE_SPRING"
    yield "1"
    yield f"{_STORE_N_PER_MM:.6e}"
    yield "*AMPLITUDE, NAME=STORED, TIME=TOTAL TIME"
    yield f"0.0, 0.0, {fixed(first_s, 7)}, 1.0, {fixed(2 * last_s, 7)}, 1.0"


def _moved_with_store(model: Analysis) -> Moved:
    end = _free_node(model)
    return Moved(
        controls=(
            "** more iterations before an increment is given up",
            "*CONTROLS, PARAMETERS=TIME INCREMENTATION",
            "30, 40, 9, 200, 60, 4",
            "** the fourth number is the average force, in N, for the residual",
            "*CONTROLS, PARAMETERS=FIELD",
            f"0.005, 0.01, 0.0, {_AVERAGE_FORCE_N:.1E}",
        ),
        fixed=("STORE, 2, 3", f"{end}, 1, 1"),
        loads=("*CLOAD, AMPLITUDE=STORED", f"{end + 1}, 1, {_STORE_N:.1E}"),
    )
