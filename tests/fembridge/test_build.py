"""Run folders as they are built: same inputs, same bytes, and ``run.toml`` last."""

import dataclasses

import pytest

from decks.presets import PRESETS, model_of
from decks.probe import Probe
from decks.stimuli import resolve
from decks.waveform import make_stimulus
from fembridge import build
from fembridge.build import build_run_folder
from fembridge.errors import OutputError
from fembridge.run_folder import read_run_folder


def stimulus_of(word, **options):
    [entry] = resolve(word)
    return make_stimulus(entry, **options)


@pytest.fixture(scope="module")
def model():
    return model_of(PRESETS["quick"])


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_building_again_touches_nothing(tmp_path, model):
    """A solver at work there, or its results, keep what they were started with."""
    stimulus = stimulus_of("sine_50_250")
    build_run_folder(tmp_path, model, stimulus)
    before = {path.name: path.stat().st_ino for path in tmp_path.iterdir()}

    build_run_folder(tmp_path, model, stimulus)

    assert {path.name: path.stat().st_ino for path in tmp_path.iterdir()} == before


def test_run_toml_stands_only_where_all_was_written(tmp_path, model, monkeypatch):
    """A disk that is full at the waveform leaves what was there, all of it."""
    build_run_folder(tmp_path / "old", model, stimulus_of("sine_50_250"))
    before = contents(tmp_path / "old")
    other = stimulus_of("sine_100_85.98")

    def disk_full(stimulus, path):
        raise OutputError("cannot write: No space left on device", path)

    monkeypatch.setattr(build, "write_csv", disk_full)
    for name in ("old", "new"):
        with pytest.raises(OutputError) as caught:
            build_run_folder(tmp_path / name, model, other)
        assert caught.value.path == tmp_path / name / "stimulus.csv"

    assert contents(tmp_path / "old") == before
    assert contents(tmp_path / "new") == {}


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


def test_a_prescribed_probe_and_other_solvers_know_no_half(tmp_path, model):
    stimulus = stimulus_of("sine_50_250")
    still = dataclasses.replace(model, support="prescribed")
    abaqus = dataclasses.replace(model, element="CPE4H")
    for built in (
        build_run_folder(tmp_path / "prescribed", still, stimulus),
        build_run_folder(tmp_path / "abaqus", abaqus, stimulus, solver="abaqus"),
    ):
        assert "section" not in built.inputs
        assert built.on_axis == ()
