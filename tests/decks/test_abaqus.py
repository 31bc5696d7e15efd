"""An Abaqus deck, read back by the plain parser of keyword decks."""

from dataclasses import replace

import pytest

from decks.abaqus import abaqus_deck
from decks.analysis import Model
from decks.finger import PronyTerm
from decks.presets import QUICK, mesh_of

ELEMENTS = ("CPE4H", "CPE8R")


@pytest.fixture(scope="module", params=ELEMENTS)
def read(request, models, short, parse_deck):
    analysis = replace(models["plain"], element=request.param).analysis(short)
    return analysis, parse_deck(abaqus_deck(analysis))


def test_the_elements_around_an_afferent_are_all_that_have_its_node(read):
    model, deck = read
    elements = deck.elements()
    for name, node in model.afferent.items():
        _, _, rows = deck.one("ELSET", ELSET=f"AROUND_{name.upper()}")
        found = {int(word) for row in rows for word in row}
        assert found == {k for k, nodes in elements.items() if node in nodes}
        layers = {layer.name for layer in model.layers if found & set(layer.number.tolist())}
        assert len(layers) == 1


# ---- Relaxing skin, inertia and a sliding probe

SKIN = mesh_of(QUICK)


def relaxing_finger():
    dermis = replace(QUICK.materials["dermis"], prony=(PronyTerm(0.4, 0.02), PronyTerm(0.1, 1.0)))
    return replace(QUICK, materials={**QUICK.materials, "dermis": dermis})


def test_relaxing_skin_is_a_prony_series_of_the_moduli_at_once(parse_deck, short):
    deck = parse_deck(
        abaqus_deck(Model(relaxing_finger(), SKIN, support="prescribed").analysis(short))
    )

    [(_, options, rows)] = deck.all("VISCOELASTIC")
    assert options["TIME"] == "PRONY"
    assert [[float(word) for word in row] for row in rows] == [[0.4, 0.0, 0.02], [0.1, 0.0, 1.0]]
    at_once = [card for card in deck.all("ELASTIC") if card[1]]
    assert [card[1] for card in at_once] == [{"MODULI": "INSTANTANEOUS"}]
    assert len(deck.all("VISCO")) == 1
