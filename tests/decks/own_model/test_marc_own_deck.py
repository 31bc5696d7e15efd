"""Our own Marc deck, taken as a user's: its own waveform leaves it as it is."""

from dataclasses import replace

import pytest
from numpy.testing import assert_allclose

from decks.analysis import analyse
from decks.marc.deck import marc_deck
from decks.motion import motion_of
from decks.own_model.marc_dat import rebase_marc
from decks.own_model.request import Request
from decks.presets import QUICK, mesh_of
from decks.stimuli import resolve
from decks.waveform import make_stimulus

(NOISE,) = (make_stimulus(entry) for entry in resolve("noise_25_250_10"))
(SINE,) = (make_stimulus(entry) for entry in resolve("sine_20_250"))
ANALYSIS = analyse(QUICK, mesh_of(QUICK), NOISE)


@pytest.fixture(scope="module", params=["rigid", "meshed"])
def probe(request):
    return request.param


@pytest.fixture(scope="module")
def deck(probe):
    return marc_deck(ANALYSIS, probe=probe).encode("ascii")


def test_its_own_waveform_changes_no_byte(deck):
    assert rebase_marc(deck, motion_of(NOISE), Request()).deck == deck


def test_another_waveform_makes_it_the_deck_written_for_that(deck, probe):
    motion = motion_of(SINE)
    rebased = rebase_marc(deck, motion, Request()).deck
    analysis = replace(ANALYSIS, motion=motion)
    written = marc_deck(analysis, probe=probe).encode("ascii")
    assert data_of(rebased) == data_of(written)
    assert rebased != deck


def data_of(deck):
    """Its lines but for comments, which may name the stimulus."""
    return [line for line in deck.splitlines() if not line.startswith(b"$")]


def test_the_afferents_are_where_the_mesh_has_them(deck):
    nodes = ANALYSIS.afferent
    request = Request(afferents={name.upper(): node for name, node in nodes.items()})
    places = rebase_marc(deck, motion_of(NOISE), request).place_mm
    for name, node in nodes.items():
        place_mm = ANALYSIS.mesh.node_mm[node - 1]
        assert_allclose(places[name.upper()], place_mm, rtol=1e-14, atol=1e-15)
