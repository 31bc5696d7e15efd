"""Each dialect: what it calls an element, and what it cannot say."""

import subprocess
import sys
from dataclasses import replace

import pytest

from decks.dialects import DIALECTS, DeckOptions, dialect_named, dialect_of
from fembridge.errors import DeckError


def test_every_dialect_writes_its_own_element_into_its_own_deck(models, short):
    for dialect in DIALECTS.values():
        model = replace(models["plain"], element=dialect.element)
        files = dialect.write(model.analysis(short), DeckOptions())
        assert next(iter(files)) == dialect.deck
        assert all(text.isascii() and text.endswith("\n") for text in files.values())


def test_the_same_analysis_gives_the_same_bytes_in_every_dialect(models, short):
    analysis = models["plain"].analysis(short)
    for dialect in DIALECTS.values():
        first = dialect.write(analysis, DeckOptions())
        assert dialect.write(analysis, DeckOptions()) == first


@pytest.mark.parametrize(
    ("solver", "word", "ours"),
    [
        ("marc", "80", "CPE4H"),
        ("marc", "11", "CPE4"),
        ("marc", "27", "CPE8"),
        ("marc", "cpe8r", "CPE8R"),
        ("calculix", "CPE4R", "CPE4R"),
        ("abaqus", "cpe4rh", "CPE4RH"),
    ],
)
def test_an_element_goes_by_our_name_and_by_the_solvers(solver, word, ours):
    assert dialect_named(solver).element_named(word) == ours


def test_an_element_that_the_dialect_has_not_is_refused_with_those_it_has():
    with pytest.raises(DeckError, match=r"marc has no element '82', .* 80 \(CPE4H\)"):
        dialect_named("marc").element_named("82")


@pytest.mark.parametrize(
    ("solver", "options", "words"),
    [
        ("calculix", {"results": "both"}, "no results 'both', expected binary or text"),
        ("calculix", {"probe": "rigid"}, "no probe 'rigid', expected meshed"),
        ("abaqus", {"results": "text"}, "no results 'text', expected binary"),
    ],
)
def test_an_option_that_the_dialect_has_not_is_refused(solver, options, words, models, short):
    with pytest.raises(DeckError, match=words):
        DIALECTS[solver].write(models["plain"].analysis(short), DeckOptions(**options))


def test_an_unknown_option_or_dialect_is_refused():
    with pytest.raises(DeckError, match="results 'hdf', expected one of binary"):
        DeckOptions(results="hdf")
    with pytest.raises(DeckError, match="no deck dialect 'nastran', expected calculix"):
        dialect_named("nastran")


def test_a_solver_of_another_package_has_the_files_of_calculix():
    assert dialect_of("somebodys").deck == "job.inp"


def test_the_table_alone_loads_no_numpy():
    code = "import sys, decks.dialects; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
