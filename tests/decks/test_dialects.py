"""Decks of each solver keep their bytes; what each calls an element and what it cannot say."""

import hashlib
from dataclasses import replace

import pytest

from decks.dialects import DIALECTS, DeckOptions, dialect_named
from decks.finger import PronyTerm
from decks.keyword_deck import abaqus_deck
from decks.presets import QUICK
from fembridge.cli import main
from fembridge.errors import DeckError, UsageError

RELAXING = """base = "quick"
[[materials.dermis.prony]]
g = 0.3
tau_s = 0.05
"""
# Options, and the beginning of the SHA-256 of the deck: those of 22 November 2026, when no probe
# was pre-indented by default, but for a comment since: which of two opposite forces is printed.
GOLDEN = {
    "": "26c38c4d79446f67",
    "--finger paper": "f8790a030f285b0b",
    "--results text --element CPE8R --preindent-um 75": "6c118a17d325428a",
    "--probe-shape flat --probe-diameter-mm 2": "bf793b5de61a8473",
    "--whole-section --probe-x-mm 0.4": "a4648dfef5f1eb21",
    "--slide-mm-per-s 5": "9acb4b87c0c127fd",
    "--slide-mm-per-s 5 --preindent-um 75": "e44f2d7419c1015f",
    "--inertia": "4df6ee202a136ec3",
    "--inertia --finger relaxing.toml --preindent-um 50": "503128fca83b9563",
    "--contact surface-to-surface --friction 0": "4efc2c0f24f20496",
    "--finger relaxing.toml --preindent-um 50": "2016e4a7e01cac5e",
    "--solver abaqus": "1c4bc81edc542146",
    "--solver abaqus --finger relaxing.toml": "2fcf168c0eda08fe",
    "--solver abaqus --slide-mm-per-s 5 --element CPE8R --contact surface-to-surface": (
        "f9334988d3460f40"
    ),
    "--solver abaqus --inertia": "1d77603abdead8cc",
    "--solver marc": "5af3a8a8062cce66",
    "--solver marc --probe-body meshed --preindent-um 75": "f268d684a0e52f72",
    "--solver marc --friction 0": "bb8a4b7c72d48def",
    "--solver marc --results text": "cb85e21444a45e2a",
    "--solver marc --element 11": "13d3aac249b604e3",
    "--solver marc --element 27": "8609a29cb3da8278",
    "--solver marc --element 54": "56c27831da927e1c",
    "--solver marc --element 118": "dfa9183b522925f2",
}


@pytest.mark.parametrize("words", GOLDEN)
def test_a_deck_keeps_its_bytes(words, here):
    (here / "relaxing.toml").write_text(RELAXING)
    unindented = [] if "--preindent-um" in words else ["--preindent-um", "0"]
    assert main(["build-deck", "--stimulus", "sine_50_50", *words.split(), *unindented]) == 0
    (deck,) = here.glob("runs/*/job.*[pt]")
    assert hashlib.sha256(deck.read_bytes()).hexdigest().startswith(GOLDEN[words])


@pytest.mark.parametrize(("word", "ours"), [("80", "CPE4H"), ("cpe8r", "CPE8R")])
def test_an_element_goes_by_our_name_and_by_the_solvers(word, ours):
    assert dialect_named("marc").element_named(word) == ours


@pytest.mark.parametrize(
    ("solver", "options", "argument"),
    [
        ("calculix", {"results": "both"}, "results"),
        ("calculix", {"probe": "rigid"}, "probe_body"),
        ("abaqus", {"results": "text"}, "results"),
    ],
)
def test_an_option_that_the_dialect_has_not_is_refused(solver, options, argument, models, short):
    with pytest.raises(UsageError) as caught:
        DIALECTS[solver].write(models["plain"].analysis(short), DeckOptions(**options))
    assert (caught.value.argument, caught.value.found) == (argument, *options.values())


def test_an_unknown_dialect_is_refused():
    with pytest.raises(DeckError) as caught:
        dialect_named("nastran")
    assert (caught.value.argument, caught.value.found) == ("target", "nastran")


# ---- Abaqus, read back by the plain parser


@pytest.mark.parametrize("element", ["CPE4H", "CPE8R"])
def test_the_elements_around_an_afferent_are_all_that_have_its_node(
    element, models, short, parse_deck
):
    model = replace(models["plain"], element=element).analysis(short)
    deck = parse_deck(abaqus_deck(model))
    elements = deck.elements()
    for name, node in model.afferent.items():
        _, _, rows = deck.one("ELSET", ELSET=f"AROUND_{name.upper()}")
        found = {int(word) for row in rows for word in row}
        assert found == {k for k, nodes in elements.items() if node in nodes}
        layers = {layer.name for layer in model.layers if found & set(layer.number.tolist())}
        assert len(layers) == 1


def test_relaxing_skin_is_a_prony_series_of_the_moduli_at_once(models, parse_deck, short):
    terms = (PronyTerm(0.4, 0.02), PronyTerm(0.1, 1.0))
    materials = {**QUICK.materials, "dermis": replace(QUICK.materials["dermis"], prony=terms)}
    model = replace(models["plain"], finger=replace(QUICK, materials=materials))
    deck = parse_deck(abaqus_deck(model.analysis(short)))

    [(_, options, rows)] = deck.all("VISCOELASTIC")
    assert options["TIME"] == "PRONY"
    assert [[float(word) for word in row] for row in rows] == [[0.4, 0.0, 0.02], [0.1, 0.0, 1.0]]
    at_once = [card for card in deck.all("ELASTIC") if card[1]]
    assert [card[1] for card in at_once] == [{"MODULI": "INSTANTANEOUS"}]
    assert len(deck.all("VISCO")) == 1
