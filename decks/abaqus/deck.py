"""Abaqus/Standard: an analysis as the text of an input deck.

The same keywords as for CalculiX but for contact, step and output. No Abaqus was
at hand: the deck rests on its keyword reference, and was parsed back, not run.
"""

from collections.abc import Iterator

import numpy as np

from decks.analysis import Analysis
from decks.dialects import DIALECTS, DeckOptions
from decks.inp import model as parts
from decks.inp.lines import list_lines, real
from decks.inp.model import OUTPUT_SET
from decks.numbered import NumberedAnalysis, numbered
from fembridge.typing import IntArray


def abaqus_files(analysis: Analysis, options: DeckOptions) -> dict[str, str]:
    """Give the deck under its name in a run folder; `options` leave no choice."""
    return {DIALECTS["abaqus"].deck: abaqus_deck(analysis)}


def abaqus_deck(analysis: Analysis) -> str:
    """Write `analysis` as a deck for Abaqus/Standard.

    Displacement and stress go to the ``.odb`` in every increment; von Mises
    stress, averaged at the nodes around each afferent, is printed to the ``.dat``.
    """
    model = numbered(analysis)
    blocks = (
        parts.heading(model),
        parts.finger(model),
        parts.probe(model),
        parts.sets(model),
        _around(model),
        parts.materials(model),
        _contact(model),
        parts.waveform(model),
        _step(model),
    )
    return "\n".join(line for block in blocks for line in block) + "\n"


def _around(model: NumberedAnalysis) -> Iterator[str]:
    yield "** ---- The elements at each afferent's node, all of one layer"
    for name, node in model.afferent.items():
        yield f"*ELSET, ELSET=AROUND_{name.upper()}"
        yield from list_lines(_elements_at(model, node))


def _elements_at(model: NumberedAnalysis, node: int) -> IntArray:
    return np.concatenate(
        [layer.number[(layer.node == node).any(axis=1)] for layer in model.layers]
    )


def _contact(model: NumberedAnalysis) -> Iterator[str]:
    contact = model.analysis.contact
    yield "**"
    yield "** ---- Contact: the skin is the slave, the probe the master"
    yield from parts.skin_surface(model)
    yield from parts.probe_surface(model)
    yield "*SURFACE INTERACTION, NAME=TOUCH"
    yield "1.0,"
    yield "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR"
    yield "** stiffness in MPa/mm"
    yield f"{real(contact.stiffness_mpa_per_mm)},"
    if contact.friction > 0:
        yield "** Coulomb friction; how far skin may slip while it sticks is Abaqus's"
        yield "** default (SLIP TOLERANCE), not the stick stiffness of CalculiX"
        yield "*FRICTION"
        yield f"{real(contact.friction)},"
    yield from parts.contact_pair(model)


def _step(model: NumberedAnalysis) -> Iterator[str]:
    large = ", NLGEOM=YES" if model.analysis.large_strain else ", NLGEOM=NO"
    yield from parts.fixed_step(model, large)
    yield "*OUTPUT, FIELD, FREQUENCY=1"
    yield f"*NODE OUTPUT, NSET={OUTPUT_SET}"
    yield "U"
    for name in model.afferent:
        yield f"*ELEMENT OUTPUT, ELSET=AROUND_{name.upper()}"
        yield "S"
    for name in model.afferent:
        yield (
            f"*EL PRINT, ELSET=AROUND_{name.upper()}, POSITION=AVERAGED AT NODES, "
            "FREQUENCY=1, SUMMARY=NO"
        )
        yield "MISES"
    yield "** force of the skin on the probe"
    yield "*NODE PRINT, NSET=PROBE, TOTALS=YES, FREQUENCY=1, SUMMARY=NO"
    yield "RF2"
    yield "*END STEP"
