"""A plain parser of decks, which shares no code with their writer, and decks to read.

It knows cards, options and data lines, nothing of fingers.
"""

from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
import pytest

from decks.calculix import calculix_deck
from decks.contact_analysis import Contact, Model
from decks.presets import QUICK, mesh_of
from decks.probe import Probe
from fembridge.stimulus import Stimulus


@dataclass(eq=False)
class Deck:
    """Cards in order: ``(keyword, options, data lines as words)``."""

    cards: list = field(default_factory=list)
    comments: list = field(default_factory=list)

    def all(self, keyword):
        return [card for card in self.cards if card[0] == keyword]

    def one(self, keyword, **options):
        (card,) = (
            card
            for card in self.all(keyword)
            if all(card[1].get(name) == value for name, value in options.items())
        )
        return card

    def set_of(self, name):
        return [int(word) for row in self.one("NSET", NSET=name)[2] for word in row]

    @cache  # noqa: B019 - few decks
    def nodes(self):
        return {
            int(row[0]): tuple(map(float, row[1:])) for card in self.all("NODE") for row in card[2]
        }

    @cache  # noqa: B019 - few decks
    def elements(self):
        return {
            int(row[0]): tuple(map(int, row[1:])) for card in self.all("ELEMENT") for row in card[2]
        }


def parse(text):
    deck = Deck()
    for line in text.splitlines():
        if line.startswith("**"):
            deck.comments.append(line[2:].strip())
        elif line.startswith("*"):
            keyword, *words = (word.strip() for word in line[1:].split(","))
            pairs = (word.partition("=") for word in words)
            options = {name.strip(): value.strip() for name, _, value in pairs}
            deck.cards.append((keyword, options, []))
        else:
            words = [word.strip() for word in line.rstrip(",").split(",")]
            deck.cards[-1][2].append(words)
    return deck


SKIN = mesh_of(QUICK)
SHORT = Stimulus("short", np.array([0.0, 1.5, -2.25, 100.0]), 0.5, (0.0, 1.5))
PLAIN = Model(QUICK, SKIN, support="prescribed")
MODELS = {
    "plain": PLAIN,
    "by surface": replace(PLAIN, contact=Contact("surface-to-surface", 1000.0)),
    "smooth": replace(PLAIN, contact=Contact(friction=0.0)),
    "flat aside": replace(PLAIN, probe=Probe("flat", 2.0, 0.2, 0.3), element="CPE8R"),
}


@pytest.fixture(scope="session")
def parse_deck():
    """Give the parser."""
    return parse


@pytest.fixture(scope="session")
def short():
    """Give a stimulus of four samples."""
    return SHORT


@pytest.fixture(scope="session")
def models():
    """Give a model of each kind of element, contact and probe, by name."""
    return MODELS


@pytest.fixture(scope="session", params=MODELS)
def built(request):
    """Give an analysis, its deck, and what the parser reads in it."""
    analysis = MODELS[request.param].analysis(SHORT)
    text = calculix_deck(analysis)
    return analysis, text, parse(text)
