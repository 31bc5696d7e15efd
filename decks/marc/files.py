"""What Marc and Mentat take from a run folder: the deck and a procedure."""

from decks.analysis import Analysis
from decks.dialects import DIALECTS, JOB, DeckOptions
from decks.marc.deck import marc_deck
from decks.marc.procedure import mentat_procedure

PROCEDURE = f"{JOB}.proc"

# How `DeckOptions.results` is called in a deck.
_POST = {"both": "both", "binary": "binary", "text": "formatted"}


def marc_files(analysis: Analysis, options: DeckOptions) -> dict[str, str]:
    """Give deck and procedure by their names in a run folder.

    Raises
    ------
    DeckError
        Something that a Marc deck of ours cannot say.
    """
    name, post = DIALECTS["marc"].deck, _POST[options.results or "both"]
    model = analysis.whole()
    return {
        name: marc_deck(model, probe=options.probe or "rigid", post=post),
        PROCEDURE: mentat_procedure(name, post=post, friction=analysis.contact.friction > 0),
    }
