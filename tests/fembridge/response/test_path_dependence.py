"""When no map can answer: told before anything is solved, with its reason."""

from dataclasses import replace

import pytest

from decks.material import PronyTerm
from decks.presets import PRESETS
from decks.stimuli import resolve
from decks.waveform import make_stimulus
from fembridge.build import model_of
from fembridge.response.solve import why_no_map


@pytest.fixture(scope="module")
def model():
    return model_of(PRESETS["quick"])


@pytest.fixture(scope="module")
def sine():
    return make_stimulus(resolve(["sine_20_250"])[0])


def relaxing(model, *layers):
    materials = dict(model.finger.materials)
    for layer in layers:
        materials[layer] = replace(materials[layer], prony=(PronyTerm(0.4, 0.02),))
    return replace(model, finger=replace(model.finger, materials=materials))


def test_nothing_speaks_against_a_map_of_the_papers_model(model, sine):
    assert why_no_map(model, [sine]) is None
    assert not model.depends_on_time
    assert model.at_once() is model


def test_skin_that_relaxes_is_named(model, sine):
    one = why_no_map(relaxing(model, "dermis"), [sine])
    assert one.startswith("dermis relaxes: stress depends on time")
    two = why_no_map(relaxing(model, "epidermis", "dermis"), [sine])
    assert two.startswith("epidermis, dermis relax:")


def test_inertia_and_a_slide_are_told(model, sine):
    assert why_no_map(replace(model, inertia=True), [sine]).startswith("inertia")
    slid = why_no_map(model, [sine, sine.sliding(5.0)])
    assert slid.startswith("sine_20_250_slide_5: the probe slides")


def test_the_contact_is_judged_on_the_model_that_does_not_know_of_time(model):
    slow = replace(relaxing(model, "dermis"), inertia=True)
    assert slow.depends_on_time
    still = slow.at_once()
    assert not still.depends_on_time
    assert still.finger == model.finger
    assert still.mesh is slow.mesh
