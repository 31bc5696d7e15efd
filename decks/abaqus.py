"""Abaqus/Standard: an analysis as the text of an input deck.

The same keywords as for CalculiX but for contact, step and output. No Abaqus was
at hand: the deck rests on its keyword reference, and was parsed back, not run.
"""

from collections.abc import Iterator

import numpy as np

from decks import keyword_deck as parts
from decks.analysis import Analysis, Contact, ElementSet
from decks.dialects import DIALECTS, DeckOptions
from decks.keyword_deck import OUTPUT_SET, Moved, list_lines, material, real

_CARDS = {
    "static": "*STATIC, DIRECT",
    "viscous": "*VISCO",  # without CETOL its increments are fixed
    "dynamic": "*DYNAMIC, DIRECT",
}


def abaqus_files(analysis: Analysis, options: DeckOptions) -> dict[str, str]:
    """The deck under its name in a run folder; `options` leave no choice."""
    return {DIALECTS["abaqus"].deck: abaqus_deck(analysis, options.frames)}


def abaqus_deck(analysis: Analysis, frames: int = 0) -> str:
    """Write `analysis` as a deck for Abaqus/Standard.

    Displacement and stress go to the ``.odb`` in every increment; von Mises
    stress, averaged at the nodes around each afferent, is printed to the ``.dat``. Every
    `frames` samples the whole field goes to the ``.odb`` too.
    """
    model = analysis.whole()
    large_strain = ", NLGEOM=YES" if model.large_strain else ", NLGEOM=NO"
    blocks = (
        parts.model_lines(model),
        _around(model),
        _materials(model),
        parts.contact_lines(model, _interaction(model.contact)),
        parts.steps(model, _CARDS, large_strain, lambda _: _output(model, frames), Moved()),
    )
    return "\n".join(line for block in blocks for line in block) + "\n"


def _around(model: Analysis) -> Iterator[str]:
    yield "** ---- The elements at each afferent's node, all of one layer"
    for name, node in model.afferent.items():
        yield f"*ELSET, ELSET=AROUND_{name.upper()}"
        at = [layer.number[(layer.node == node).any(axis=1)] for layer in model.layers]
        yield from list_lines(np.concatenate(at))


def _materials(model: Analysis) -> Iterator[str]:
    yield from parts.MATERIALS_HEADING
    for section in (*model.layers, model.probe):
        relaxes = bool(section.material.prony)
        yield from material(
            section,
            inertia=model.inertia,
            moduli=", MODULI=INSTANTANEOUS" if relaxes else "",
            relaxation=_relaxation(section),
        )


def _relaxation(section: ElementSet) -> Iterator[str]:
    if section.material.prony:
        yield "** share of the shear modulus, of the bulk modulus, time constant in s"
        yield "*VISCOELASTIC, TIME=PRONY"
    for term in section.material.prony:
        yield f"{real(term.g)}, 0.0, {real(term.tau_s)}"


def _interaction(contact: Contact) -> Iterator[str]:
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


def _output(model: Analysis, frames: int) -> Iterator[str]:
    every = model.motion.phases[-1].every
    yield f"*OUTPUT, FIELD, FREQUENCY={every}"
    yield f"*NODE OUTPUT, NSET={OUTPUT_SET}"
    yield "U"
    for name in model.afferent:
        yield f"*ELEMENT OUTPUT, ELSET=AROUND_{name.upper()}"
        yield "S"
    if frames:
        yield f"** the whole field every {frames} samples"
        yield f"*OUTPUT, FIELD, FREQUENCY={frames * every}"
        yield from ("*NODE OUTPUT", "U", "*ELEMENT OUTPUT", "S")
    for name in model.afferent:
        yield (
            f"*EL PRINT, ELSET=AROUND_{name.upper()}, POSITION=AVERAGED AT NODES, "
            f"FREQUENCY={every}, SUMMARY=NO"
        )
        yield "MISES"
    yield "** force that holds the probe in the skin: along -y where it presses"
    yield f"*NODE PRINT, NSET=PROBE, TOTALS=YES, FREQUENCY={every}, SUMMARY=NO"
    yield "RF2"
