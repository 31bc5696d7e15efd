"""Run folders as they are built: same inputs, same bytes, and ``run.toml`` last."""

import dataclasses

import pytest

from decks.presets import PRESETS, model_of
from decks.probe import Probe
from decks.stimuli import resolve
from decks.waveform import make_stimulus
from fembridge.build import build_run_folder
from fembridge.run_folder import read_run_folder


def stimulus_of(word, **options):
    [entry] = resolve(word)
    return make_stimulus(entry, **options)


@pytest.fixture(scope="module")
def model():
    return model_of(PRESETS["quick"])


def test_building_again_touches_nothing(tmp_path, model):
    """A solver at work there, or its results, keep what they were started with."""
    stimulus = stimulus_of("sine_50_250")
    build_run_folder(tmp_path, model, stimulus)
    before = {path.name: path.stat().st_ino for path in tmp_path.iterdir()}

    build_run_folder(tmp_path, model, stimulus)

    assert {path.name: path.stat().st_ino for path in tmp_path.iterdir()} == before


def test_a_run_tells_how_much_of_the_section_is_computed_and_why(tmp_path, model):
    stimulus = stimulus_of("sine_50_250")
    half = build_run_folder(tmp_path / "half", model, stimulus)
    aside = dataclasses.replace(model, probe=Probe(x_mm=0.25))
    whole = build_run_folder(tmp_path / "whole", aside, stimulus)

    assert half.inputs["section"] == "half"
    assert set(half.on_axis) == {
        *(place.node for place in half.afferents if place.x_mm == 0),
        half.apex_node,
    }
    assert whole.inputs["section"] == "whole: the probe is no mirror image of itself"
    assert whole.on_axis == ()
    for built in (half, whole):
        assert read_run_folder(built.folder) == built
    still = dataclasses.replace(model, support="prescribed")
    abaqus = dataclasses.replace(model, element="CPE4H")
    for built in (
        build_run_folder(tmp_path / "prescribed", still, stimulus),
        build_run_folder(tmp_path / "abaqus", abaqus, stimulus, solver="abaqus"),
    ):
        assert "section" not in built.inputs
        assert built.on_axis == ()
