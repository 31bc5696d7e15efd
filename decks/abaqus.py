"""Abaqus/Standard: an analysis as the text of an input deck.

The template ``abaqus.inp.j2`` has the same keywords as CalculiX's but for contact, step and
output. No Abaqus was at hand: the deck rests on its keyword reference, and was parsed back,
not run.
"""

import numpy as np

from decks.analysis import Analysis
from decks.dialects import DeckOptions
from decks.keyword_deck import keyword_deck


def abaqus_deck(analysis: Analysis, options: DeckOptions = DeckOptions()) -> str:  # noqa: B008 - frozen
    """Write `analysis` as a deck for Abaqus/Standard.

    Displacement and stress go to the ``.odb`` in every increment; von Mises
    stress, averaged at the nodes around each afferent, is printed to the ``.dat``. Every
    `options.frames` samples the whole field goes to the ``.odb`` too.
    """
    model = analysis.whole()
    around = {
        name: np.concatenate(
            [layer.number[(layer.node == node).any(axis=1)] for layer in model.layers]
        )
        for name, node in model.afferent.items()
    }
    steps = [(phase, False) for phase in model.motion.phases]
    sections = (*model.layers, model.probe)
    return keyword_deck(
        "abaqus.inp.j2", model, sections, steps, around=around, frames=options.frames
    )
