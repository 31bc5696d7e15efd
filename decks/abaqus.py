"""Abaqus/Standard: an analysis as the text of an input deck.

The template ``abaqus.inp.j2`` has the same keywords as CalculiX's but for contact, step and
output. No Abaqus was at hand: the deck rests on its keyword reference, and was parsed back,
not run.
"""

import numpy as np

from decks.analysis import Analysis
from decks.dialects import DIALECTS, DeckOptions
from decks.keyword_deck import keyword_deck


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
    around = {
        name: np.concatenate(
            [layer.number[(layer.node == node).any(axis=1)] for layer in model.layers]
        )
        for name, node in model.afferent.items()
    }
    steps = [(phase, False) for phase in model.motion.phases]
    sections = (*model.layers, model.probe)
    return keyword_deck("abaqus.inp.j2", model, sections, steps, around=around, frames=frames)
