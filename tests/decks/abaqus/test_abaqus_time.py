"""Relaxing skin, inertia and a sliding probe in decks of Abaqus."""

from dataclasses import replace

import numpy as np
import pytest

from decks.abaqus import abaqus_deck
from decks.analysis import analyse
from decks.material import PronyTerm
from decks.presets import QUICK, mesh_of
from fembridge.errors import FingerError

SKIN = mesh_of(QUICK)


def relaxing_finger():
    dermis = replace(QUICK.materials["dermis"], prony=(PronyTerm(0.4, 0.02), PronyTerm(0.1, 1.0)))
    return replace(QUICK, materials={**QUICK.materials, "dermis": dermis})


def test_relaxing_skin_is_a_prony_series_of_the_moduli_at_once(parse_deck, short):
    deck = parse_deck(abaqus_deck(analyse(relaxing_finger(), SKIN, short)))

    [(_, options, rows)] = deck.all("VISCOELASTIC")
    assert options["TIME"] == "PRONY"
    assert [[float(word) for word in row] for row in rows] == [[0.4, 0.0, 0.02], [0.1, 0.0, 1.0]]
    at_once = [card for card in deck.all("ELASTIC") if card[1]]
    assert [card[1] for card in at_once] == [{"MODULI": "INSTANTANEOUS"}]
    assert len(deck.all("VISCO")) == 1


def test_inertia_is_a_dynamic_step_with_a_density_a_material(parse_deck, short):
    deck = parse_deck(abaqus_deck(analyse(QUICK, SKIN, short, inertia=True)))

    assert len(deck.all("DYNAMIC")) == 1
    assert len(deck.all("DENSITY")) == len(deck.all("MATERIAL"))
    densities = [float(card[2][0][0]) for card in deck.all("DENSITY")]
    assert densities[2] == pytest.approx(1.109e-9)  # t/mm3: the dermis


def test_a_sliding_probe_follows_a_second_amplitude(parse_deck, short):
    deck = parse_deck(abaqus_deck(analyse(QUICK, SKIN, short.sliding(10.0))))

    names = [card[1]["NAME"] for card in deck.all("AMPLITUDE")]
    assert names == ["DEPTH", "ASIDE"]
    numbers = [float(word) for row in deck.all("AMPLITUDE")[1][2] for word in row]
    np.testing.assert_allclose(numbers[1::2], 10.0 * np.array(numbers[::2]), atol=1e-9)
    moved = [card for card in deck.all("BOUNDARY") if card[1] == {"AMPLITUDE": "ASIDE"}]
    assert [card[2] for card in moved] == [[["PROBE", "1", "1", "1.0"]]]


def test_a_probe_that_would_slide_off_the_pad_is_refused(short):
    with pytest.raises(FingerError, match="on its way, expected inside the pad"):
        analyse(QUICK, SKIN, short.sliding(1e5))
