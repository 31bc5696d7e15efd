"""CalculiX: an analysis as the text of an input deck, in the dialect of ccx 2.20.

The same analysis gives the same bytes, ASCII with LF line ends. A deck holds the right
half of the section where that shows all of it. Four parts of it are there because of how
ccx works: relaxing skin, explained here; contact of a half, the probe's support and inertia,
explained in the template ``calculix.inp.j2``.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from decks.contact_analysis import ContactAnalysis, ElementSet
from decks.dialects import DeckOptions
from decks.finger import Material
from decks.keyword_deck import keyword_deck
from decks.motion import Motion, Phase
from fembridge.errors import DeckError, UsageError

# Branches add no mass to the layer that they lie over.
NO_MASS_KG_M3 = 1.0


def calculix_deck(analysis: ContactAnalysis, options: DeckOptions = DeckOptions()) -> str:  # noqa: B008 - frozen
    """Write `analysis` as a deck for ccx 2.20.

    Results at the watched nodes are float64; as "text" ccx writes ASCII, whose six
    digits add noise to a second derivative. A ccx step writes one set of nodes only, so with
    `options.frames` every frame is a separate step that writes all nodes.

    Raises
    ------
    DeckError
        The skin relaxes within a time step.
    UsageError
        Frames are requested together with inertia.
    """
    if options.frames > 1 and analysis.inertia:
        raise UsageError(
            argument="frames",
            found=options.frames,
            expected="1 with inertia: a new step would jolt the skin",
        )
    first = int(analysis.probe.number.max()) + 1
    creep_branches = branches(analysis.layers, first, analysis.motion.phases[-1].dt_s)
    on_axis = np.isin(analysis.contact_node, analysis.axis)
    return keyword_deck(
        "calculix.inp.j2",
        analysis,
        [lasting(layer) for layer in (*analysis.layers, analysis.probe)],
        list(_steps(analysis.motion, options.frames)),
        abaqus=False,
        binary=options.results != "text",
        branches=creep_branches,
        # Numbers beyond those of finger, probe and branches.
        free_element=first + sum(len(section.number) for section, _ in creep_branches),
        free_node=analysis.first_probe_node + len(analysis.probe_mesh.node_mm),
        tied=np.unique(analysis.probe.node).tolist(),
        skin_nodes=analysis.contact_node[~on_axis],
        axis_nodes=analysis.contact_node[on_axis],
    )


def _steps(motion: Motion, frames: int) -> Iterator[tuple[Phase, bool]]:
    """Steps, and whether each writes all nodes: one step per `frames` samples does."""
    *before, waveform = motion.phases
    if frames <= 1:
        yield from ((phase, frames == 1) for phase in motion.phases)
        return
    yield from ((phase, False) for phase in before)
    count, rest = divmod(waveform.increments, frames * waveform.sample_increments)
    for _ in range(count):
        yield replace(waveform, increments=(frames - 1) * waveform.sample_increments), False
        yield replace(waveform, increments=waveform.sample_increments), True
    if rest:
        yield replace(waveform, increments=rest), False


# ---- Relaxing skin. ccx 2.20 ignores ``*VISCOELASTIC`` with a warning and stays elastic.
# So the deck has the elements of each layer once for the lasting share of its stiffness, and
# again, on the same nodes, for each Prony term: a Maxwell branch, elastic with creep that is
# proportional to stress (``*CREEP, LAW=NORTON``, exponent 1; ``*VISCO``). The stress of the
# skin is the sum over the branches. ccx writes their mean at a node, which a reader
# multiplies by the number of terms.
#
# ccx relaxes by backward Euler: in a step of x = dt/tau a branch keeps 1/(1 + x'), x' being
# 3 G A dt for the creep rate A sigma. With G' = G (e^x - 1)/x and 3 G' A dt = e^x - 1 that is
# exactly the exponential, and exactly the integral over a step in which strain changes evenly.


def lasting(section: ElementSet) -> ElementSet:
    """A layer with its lasting stiffness and its full mass."""
    values = section.material
    if not values.prony:
        return section
    young_mpa = values.lasting_share * values.young_mpa
    return replace(section, material=replace(values, young_mpa=young_mpa, prony=()))


def branches(
    layers: Sequence[ElementSet], first: int, dt_s: float
) -> list[tuple[ElementSet, float]]:
    """Branches of all `layers` and their creep rate per MPa and s; elements start at `first`."""
    branch_sections = []
    for layer in layers:
        values = layer.material
        for count, term in enumerate(values.prony, start=1):
            grown = math.expm1(dt_s / term.tau_s) if term.tau_s >= dt_s else math.inf
            shear_mpa = term.g * values.shear_mpa * grown * term.tau_s / dt_s
            bulk_mpa = term.g * values.bulk_mpa
            if not 2 * shear_mpa <= 3 * bulk_mpa:  # Poisson's ratio of the branch below 0
                expected = (
                    f"the time step, {dt_s:g} s, or more, and of a Poisson's ratio as small as "
                    f"{values.poisson:g} more"
                )
                raise DeckError(
                    f"of {layer.name} is {term.tau_s:g}, expected {expected}",
                    argument="tau_s",
                    found=term.tau_s,
                    expected=expected,
                )
            young_mpa = 9 * bulk_mpa * shear_mpa / (3 * bulk_mpa + shear_mpa)
            poisson = young_mpa / (2 * shear_mpa) - 1
            branch = Material(young_mpa, poisson, density_kg_m3=NO_MASS_KG_M3)
            number = np.arange(first, first + len(layer.number))
            first += len(layer.number)
            section = ElementSet(
                f"{layer.name}_prony_{count}", number, layer.node, branch, "linear"
            )
            branch_sections.append((section, grown / (3 * shear_mpa * dt_s)))
    return branch_sections
