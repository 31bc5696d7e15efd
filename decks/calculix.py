"""CalculiX: an analysis as the text of an input deck, in the dialect of ccx 2.20.

The same analysis gives the same bytes, ASCII with LF line ends. A deck holds the right
half of the section where that shows all of it. Four parts of it are there because of how
ccx works, each explained where it is written: contact of a half, relaxing skin, the
probe's support, inertia.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from decks import keyword_deck as parts
from decks.analysis import Analysis, Contact, ElementSet
from decks.dialects import DIALECTS, DeckOptions
from decks.keyword_deck import OUTPUT_SET, Moved, element_lines, fixed, list_lines, material, real
from decks.material import Material
from fembridge.errors import DeckError, UsageError
from fembridge.typing import IntArray

_DIALECT = DIALECTS["calculix"]
_RIGID = "all of its nodes are tied to one"
# Fixed increments make nothing of CETOL, a bound of creep; ccx wants it all the same.
_CARDS = {
    "static": "*STATIC, DIRECT",
    "viscous": "*VISCO, DIRECT, CETOL=1.0E6",
    "dynamic": "*DYNAMIC, DIRECT, ALPHA=-0.3",
}

# Of a half: what is not in the deck, and what holds on its axis.
_HALF = (
    "**",
    "** Of this section the right half alone, x >= 0: finger, probe and",
    "** motion are mirror images about x = 0. Numbers are those of the whole;",
    "** those of the left half do not occur. The half is 2 mm thick, for both",
    "** halves of 1 mm: forces are those of the whole.",
)
_AXIS = (
    "** ---- On the axis of the half nothing moves aside, and shear is 0; the",
    "** SXY that is written there is a mean over one half, not over both",
    "*NSET, NSET=AXIS",
)
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
    return {_DIALECT.deck: calculix_deck(analysis, options.results != "text", options.frames)}


def calculix_deck(analysis: Analysis, binary: bool = True, frames: int = 0) -> str:
    """Write `analysis` as a deck for ccx 2.20.

    `binary` asks for float64 results at the watched nodes; without it ccx
    writes ASCII, whose six digits add noise to a second derivative. A step of ccx writes
    one set of nodes alone: so with `frames` every so many samples are a step of all nodes.

    Raises
    ------
    DeckError
        An element that ccx has not, or skin that relaxes within a time step.
    """
    _DIALECT.element_named(analysis.element)
    mass, thick_mm, contact = analysis.inertia, analysis.thickness_mm, analysis.contact
    why_rigid, moved = parts.PRESCRIBED, Moved()
    support: Iterator[str] = iter(())
    if mass:
        support, moved = _energy_store(analysis), _moved_with_store(analysis)
    elif analysis.support == "spring":
        why_rigid, support, moved = _RIGID, _spring(analysis), _moved_by_spring(analysis)
    lines = [*parts.model_lines(analysis, _HALF if analysis.is_half else (), why_rigid)]
    if analysis.is_half:
        lines += [*_AXIS, *list_lines(analysis.axis)]
    lines += parts.MATERIALS_HEADING
    for section in (*analysis.layers, analysis.probe):
        lasts = lasting(section) if section.material.prony else section
        lines += material(lasts, inertia=mass, thickness_mm=thick_mm)
    if analysis.finger.relaxing_s:
        first = int(analysis.probe.number.max()) + 1
        found = branches(analysis.layers, first, analysis.motion.phases[-1].dt_s)
        lines += branch_lines(found, analysis.element, inertia=mass, thickness_mm=thick_mm)
    slave: tuple[str, ...] = ()
    by_node = contact.formulation == "node-to-surface"
    if by_node:
        slave = _slave("SKIN", np.setdiff1d(analysis.contact_node, analysis.axis))
    lines += parts.contact_lines(analysis, _interaction("TOUCH", contact), slave)
    if by_node and analysis.is_half:
        lines += [
            "** The skin on the axis: half of its springs: they are half as stiff",
            *_slave("AXIS", np.intersect1d(analysis.contact_node, analysis.axis)),
            *_interaction("TOUCH_ON_AXIS", contact, _AXIS_SHARE),
            "*CONTACT PAIR, INTERACTION=TOUCH_ON_AXIS, TYPE=NODE TO SURFACE",
            "AXIS_SURFACE, PROBE_SURFACE",
        ]
    lines += support
    large_strain = ", NLGEOM" if analysis.large_strain else ""
    if frames > 1 and mass:
        raise UsageError("frames: 1 alone where inertia counts: a new step would jolt the skin")
    output = partial(_output, analysis, binary)
    lines += parts.steps(analysis, _CARDS, large_strain, output, moved, frames)
    return "\n".join(lines) + "\n"


def _output(model: Analysis, binary: bool, all_nodes: bool) -> Iterator[str]:
    kind, element, double = ("OUTPUT", "ELEMENT", ", DOUBLE") if binary else ("FILE", "EL", "")
    every = model.motion.phases[-1].every
    often = f", FREQUENCY={every}" if every > 1 else ""
    at = "" if all_nodes else f", NSET={OUTPUT_SET}"
    yield f"*NODE {kind}{at}{double}{often}"
    yield "U"
    yield f"*{element} {kind}{at}{double}{often}"
    yield "S"
    if model.inertia:  # ccx has to keep energies from the first increment on
        yield "** energies, which that balance is made of"
        yield f"*EL PRINT, ELSET=PROBE_BODY, TOTALS=ONLY, FREQUENCY={every}"
        yield "ELSE"
    yield "** force that holds the probe in the skin: along -y where it presses"
    yield f"*NODE PRINT, NSET=PROBE, TOTALS=ONLY{often}"
    yield "RF"


# ---- Contact. Of a slave that is a set of nodes ccx gives each node the area of the face
# that it touches, not its own share of the skin. So in a half of the section the node on
# the axis, whose skin is left of it as well, gets a contact pair of its own, with springs
# half as stiff; without it the error is 0.3 % of the stress.


def _slave(name: str, nodes: IntArray) -> tuple[str, ...]:
    return (
        f"*NSET, NSET={name}_CONTACT",
        *list_lines(nodes),
        f"*SURFACE, NAME={name}_SURFACE, TYPE=NODE",
        f"{name}_CONTACT",
    )


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


def lasting(section: ElementSet) -> ElementSet:
    """A layer with the stiffness that does not relax, and all of its mass."""
    values = section.material
    young_mpa = values.lasting_share * values.young_mpa
    left = Material(young_mpa, values.poisson, density_kg_m3=values.density_kg_m3)
    return replace(section, material=left)


def branches(
    layers: Sequence[ElementSet], first: int, dt_s: float
) -> list[tuple[ElementSet, float]]:
    """Branches of all `layers` with their creep per MPa and s; elements from `first` on."""
    found = []
    for layer in layers:
        values = layer.material
        for count, term in enumerate(values.prony, start=1):
            grown = math.expm1(dt_s / term.tau_s) if term.tau_s >= dt_s else math.inf
            shear_mpa = term.g * values.shear_mpa * grown * term.tau_s / dt_s
            bulk_mpa = term.g * values.bulk_mpa
            if not 2 * shear_mpa <= 3 * bulk_mpa:  # Poisson's ratio of the branch below 0
                raise DeckError(
                    f"{layer.name}: tau_s is {term.tau_s:g}, expected the time step, {dt_s:g} s, "
                    f"or more, and of a Poisson's ratio as small as {values.poisson:g} more"
                )
            young_mpa = 9 * bulk_mpa * shear_mpa / (3 * bulk_mpa + shear_mpa)
            poisson = young_mpa / (2 * shear_mpa) - 1
            branch = Material(young_mpa, poisson, density_kg_m3=NO_MASS_KG_M3)
            number = np.arange(first, first + len(layer.number))
            first += len(layer.number)
            section = ElementSet(
                f"{layer.name}_prony_{count}", number, layer.node, branch, "linear"
            )
            found.append((section, grown / (3 * shear_mpa * dt_s)))
    return found


def branch_lines(
    found: Sequence[tuple[ElementSet, float]],
    element: str,
    *,
    inertia: bool,
    thickness_mm: float = 1.0,
) -> Iterator[str]:
    """The branches' elements and materials: elastic, creeping with stress."""
    yield "**"
    yield "** ---- Relaxing skin: a Maxwell branch a Prony term, over its layer"
    for section, rate in found:
        yield f"*ELEMENT, TYPE={element}, ELSET={section.name.upper()}"
        yield from element_lines(section.number.tolist(), section.node)
        creep = (
            "** creep rate per MPa and s, exponent of stress, exponent of time",
            "*CREEP, LAW=NORTON",
            f"{real(rate)}, 1.0, 0.0",
        )
        yield from material(section, inertia=inertia, relaxation=creep, thickness_mm=thickness_mm)


def _free_element(model: Analysis) -> int:
    """First number that neither finger, probe nor Maxwell branch has."""
    more = sum(len(layer.number) * len(layer.material.prony) for layer in model.layers)
    return int(model.probe.number.max()) + 1 + more


def _free_node(model: Analysis) -> int:
    """First number that neither finger nor probe has."""
    return model.first_probe_node + len(model.probe_mesh.node_mm)


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
        for node in np.unique(model.probe.node).tolist():
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
