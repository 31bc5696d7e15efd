"""Somebody's small `.inp` for what is tested on it."""

import numpy as np
import pytest

from decks.motion import Motion
from decks.own_model import Request
from decks.own_model.inp import rebase_inp
from fembridge.errors import DeckError

MOTION = Motion(np.arange(5) * 5e-4, np.array([0.0, 0.1, 0.2, 0.1, 0.0]), 5e-4, 0)
DECK = """\
*HEADING
somebody's deck
*NODE, NSET=ALL
1, 0., 0., 0.
2, 1., 0., 0.
3, 1., 1., 0.
4, 0., 1., 0.
*ELEMENT, TYPE=CPE4, ELSET=SKIN
1, 1, 2, 3, 4
*AMPLITUDE, NAME=PRESS
0., 0., 1., 1.
*AMPLITUDE, NAME=OTHER
0., 0., 1., 1.
*STEP, NAME=push, INC=200
*STATIC
0.1, 1.
*BOUNDARY
1, 1, 2
*BOUNDARY, AMPLITUDE=PRESS
4, 2, 2, -1.
*NODE FILE
U
*END STEP
"""


@pytest.fixture
def deck():
    """Give somebody's `.inp`, which is taken as it is."""
    return DECK


@pytest.fixture
def step():
    """Give the step of that deck."""
    return DECK[DECK.index("*STEP") :]


@pytest.fixture
def rebase():
    """Give a function that puts a short motion into a deck."""

    def run(deck=DECK, dialect=None, resolver=None, **request):
        return rebase_inp(
            deck.encode(), MOTION, Request(**request), dialect=dialect, resolver=resolver
        )

    return run


@pytest.fixture
def refused(rebase):
    """Give a function that asserts that a deck is refused, and how the message begins."""

    def run(deck, begin, **options):
        with pytest.raises(DeckError, match=f"^{begin}"):
            rebase(deck, **options)

    return run


@pytest.fixture
def changed():
    """Give a function that replaces the one `old` in that deck."""

    def run(old, new):
        assert DECK.count(old) == 1
        return DECK.replace(old, new)

    return run
