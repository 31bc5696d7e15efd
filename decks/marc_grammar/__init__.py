"""Marc's input decks, read without losing a byte, in no writer's words.

`read_marc_deck` cuts a deck into options; the mesh, tables, conditions, contact,
history and output are views of them. Nothing here was checked with Marc: the rules
come from decks that Mentat 2014 to 2024 wrote and from what third parties state.
"""

from decks.marc_grammar.deck import MarcDeck
from decks.marc_grammar.describe import describe_marc_deck
from decks.marc_grammar.option import Option, Section
from decks.marc_grammar.reader import looks_like_marc, read_marc_deck

__all__ = [
    "MarcDeck",
    "Option",
    "Section",
    "describe_marc_deck",
    "looks_like_marc",
    "read_marc_deck",
]
