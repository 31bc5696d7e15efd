"""Each dialect: what it calls an element, and what it cannot say."""

import pytest

from decks.dialects import DIALECTS, DeckOptions, dialect_named
from fembridge.errors import DeckError, UsageError


@pytest.mark.parametrize(
    ("solver", "word", "ours"), [("marc", "80", "CPE4H"), ("marc", "cpe8r", "CPE8R")]
)
def test_an_element_goes_by_our_name_and_by_the_solvers(solver, word, ours):
    assert dialect_named(solver).element_named(word) == ours


@pytest.mark.parametrize(
    ("solver", "options", "words"),
    [
        ("calculix", {"results": "both"}, "no results 'both', expected binary or text"),
        ("calculix", {"probe": "rigid"}, "no probe 'rigid', expected meshed"),
        ("abaqus", {"results": "text"}, "no results 'text', expected binary"),
    ],
)
def test_an_option_that_the_dialect_has_not_is_refused(solver, options, words, models, short):
    with pytest.raises(UsageError, match=words):
        DIALECTS[solver].write(models["plain"].analysis(short), DeckOptions(**options))


def test_an_unknown_dialect_is_refused():
    with pytest.raises(DeckError, match="no deck dialect 'nastran', expected calculix"):
        dialect_named("nastran")
