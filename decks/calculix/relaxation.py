"""Relaxing skin for CalculiX, which has no linear viscoelasticity of its own.

ccx 2.20 reads over ``*VISCOELASTIC`` with a warning and stays elastic. So each layer
stands in the deck once for the share of its stiffness that lasts, and once more, on
the same nodes, for each Prony term: a Maxwell branch, elastic with creep that is
proportional to stress (``*CREEP, LAW=NORTON``, exponent 1; ``*VISCO``). The stress of
the skin is the sum over the branches. At a node ccx writes their mean, which a reader
multiplies by their number.

ccx relaxes by backward Euler: in a step of x = dt/tau a branch keeps 1/(1 + x'), x'
being 3 G A dt for the creep rate A sigma. With G' = G (e^x - 1)/x and 3 G' A dt =
e^x - 1 that is exactly the exponential, and exactly the integral over a step in
which strain changes evenly.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from decks.analysis import Analysis, ElementSet
from decks.inp.lines import element_lines, real
from decks.inp.materials import material
from decks.material import Material, PronyTerm
from fembridge.errors import DeckError

# Branches add no mass to the layer that they lie over.
NO_MASS_KG_M3 = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Branch:
    """A Maxwell branch: elements over those of a layer; `creep` per MPa and s."""

    section: ElementSet
    creep: float


def lasting(section: ElementSet) -> ElementSet:
    """Give a layer with the stiffness that does not relax, and all of its mass."""
    share = section.material.lasting_share
    values = section.material
    if share == 1.0:
        return section
    return replace(
        section,
        material=Material(
            share * values.young_mpa, values.poisson, density_kg_m3=values.density_kg_m3
        ),
    )


def branches(layers: Sequence[ElementSet], first: int, dt_s: float) -> list[Branch]:
    """Give the branches of all `layers`; their elements have numbers from `first` on.

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
            section = ElementSet(name, number, layer.node, values, "linear")
            found.append(Branch(section, creep))
    return found


def branches_at(analysis: Analysis) -> dict[int, int]:
    """Count the branches, the lasting one too, at the watched nodes that have more."""
    counts = {}
    model = analysis.whole()
    for node in model.watched.tolist():
        around = [
            1 + len(layer.material.prony) for layer in model.layers if (layer.node == node).any()
        ]
        if max(around) > 1:
            counts[node] = max(around)
    return counts


def branch_blocks(
    found: Sequence[Branch], element: str, *, inertia: bool, thickness_mm: float = 1.0
) -> Iterator[str]:
    """Give the branches' elements and materials: elastic, creeping with stress."""
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
