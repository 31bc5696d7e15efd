"""``fembridge build-deck``: a run folder a stimulus, what it refuses, what it leaves as it is."""

import dataclasses
import json
import math
from pathlib import Path

import pytest
from numpy.testing import assert_allclose

import fembridge as fb
from decks.presets import PRESETS, model_of
from decks.probe import Probe
from decks.stimuli import resolve
from decks.synthesis import make_stimulus
from fembridge.cli import main
from fembridge.errors import OutputError
from fembridge.host.store import sha256_of
from fembridge.io.run_folder import read_run_folder, read_waveform
from fembridge.solver.build import build_run_folder

LEVELS = ["0.25", "1", "5", "10", "20"]


def test_a_set_gives_a_folder_a_level(here, capsys):
    words = ["build-deck", "--stimulus", "noise_25_250", "-o", "runs"]
    assert main(words) == 0
    streams = capsys.readouterr()
    folders = [f"runs/noise_25_250_{level}" for level in LEVELS]
    lines = [f"{folder}  520 increments of 0.5 ms" for folder in folders]
    assert streams.out.splitlines() == [*lines, "next:", "  fembridge run runs/*"]
    [line] = streams.err.splitlines()
    assert "75 um" in line
    assert sorted(f"runs/{path.name}" for path in (here / "runs").iterdir()) == sorted(folders)
    assert main([*words, "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["finger"], summary["solver"]) == ("quick", "calculix")
    for shown, folder in zip(summary["folders"], folders, strict=True):
        run = read_run_folder(here / folder)
        assert sha256_of(here / folder / "job.inp") == run.deck_sha256
        assert shown == {
            **{"stimulus": run.inputs["stimulus"]["id"], "folder": folder},
            **{"increments": 520, "deck_sha256": run.deck_sha256},
        }


def test_options_arrive_in_the_record_of_the_deck(here):
    """In its bytes: `tests/decks/test_dialects.py`."""
    words = ["build-deck", "--stimulus", "noise_25_250_10", "--friction", "0.2", "--seed", "7"]
    words += ["--contact", "surface-to-surface", "--stiffness-mpa-per-mm", "1000"]
    words += ["--probe-shape", "flat", "--probe-diameter-mm", "2", "--probe-x-mm", "0.5"]
    assert main([*words, "--element", "CPE8R"]) == 0
    found = read_run_folder(here / "runs/noise_25_250_10").inputs
    contact = {"formulation": "surface-to-surface", "stiffness_mpa_per_mm": 1000.0, "friction": 0.2}
    assert contact.items() <= found["contact"].items()
    assert {"shape": "flat", "diameter_mm": 2.0, "x_mm": 0.5}.items() <= found["probe"].items()
    assert (found["element"], found["stimulus"]["seed"]) == ("CPE8R", 7)


@pytest.mark.parametrize(
    ("words", "code", "found"),
    [
        (["--stimulus", "sine_20_-5"], 2, "sine_20_-5"),
        (["--friction", "-1"], 2, {"argument": "--friction", "found": "-1"}),
        (
            ["--stiffness-mpa-per-mm", "0"],
            2,
            {"argument": "--stiffness-mpa-per-mm", "found": "0"},
        ),
        (
            ["--probe-diameter-mm", "-1"],
            2,
            {"argument": "--probe-diameter-mm", "found": "-1"},
        ),
        (["--probe-fillet-mm", "0.05"], 2, "--probe-shape flat"),
        (["--probe-x-mm", "50"], 1, "the probe spans x = "),
        (["--slide-mm-per-s", "0"], 2, {"argument": "--slide-mm-per-s", "found": 0.0}),
        (["--slide-mm-per-s", "1e4"], 1, "expected inside the pad"),
        (["--solver", "marc", "--slide-mm-per-s", "4"], 1, "marc"),
        (["--solver", "marc", "--contact", "surface-to-surface"], 2, "--contact"),
        (["--solver", "marc", "--element", "82"], 2, {"argument": "--element", "found": "82"}),
        (["--solver", "marc", "--frames", "5"], 2, "marc"),
        (["--inertia", "--frames", "5"], 2, {"argument": "--frames", "found": 5}),
        (["--frames", "-1"], 2, {"argument": "--frames", "found": "-1"}),
    ],
)
def test_what_no_deck_can_hold_is_one_line_and_nothing_is_written(refused, words, code, found):
    refused(["build-deck", "--stimulus", "sine_20_250", *words], found, code)


def test_help_shows_an_example_that_runs(here, capsys):
    assert main(["build-deck", "--help"]) == 0
    example = capsys.readouterr().out.split("example: fembridge ")[1].split()
    assert main(example) == 0
    assert len(list((here / "runs").iterdir())) == 5


def test_a_probe_that_slides_has_its_way_in_deck_and_waveform(here):
    words = ["build-deck", "--stimulus", "sine_20_250", "--slide-mm-per-s", "4"]
    assert main(words) == 0
    folder = here / "runs" / "sine_20_250_slide_4"
    lines = (folder / "stimulus.csv").read_text("utf-8").splitlines()
    assert lines[0] == "time_ms,displacement_um,aside_um"
    assert lines[-1].split(",")[::2] == ["250.0", "1000.0"]
    times_ms, depth_um = read_waveform(folder)
    assert (times_ms.size, depth_um.size) == (501, 501)
    assert read_run_folder(folder).inputs["stimulus"]["slide_mm_per_s"] == 4.0
    assert "*AMPLITUDE, NAME=ASIDE" in (folder / "job.inp").read_text("ascii")


def wave(samples):
    rows = [f"{0.5 * k},{100 * math.sin(0.05 * math.pi * k)!r}" for k in range(samples + 1)]
    Path("wave.csv").write_text("\n".join(["time_ms,displacement_um", *rows, ""]))
    return ["build-deck", "--stimulus", "wave.csv", "--preindent-um", "0", "--json"]


@pytest.mark.parametrize(
    ("frames", "steps"), [(0, [(12, False)]), (1, [(12, True)]), (5, [(4, False), (1, True)] * 2)]
)
def test_every_so_many_samples_are_a_step_that_writes_all_nodes(here, frames, steps):
    assert main([*wave(12), "--frames", str(frames)]) == 0
    deck = (here / "runs/wave/job.inp").read_text()
    found = [
        (round(float(step.split("\n")[2].split(", ")[1]) / 0.0005), "*NODE OUTPUT, DOUBLE" in step)
        for step in deck.split("*STEP")[1:]
    ]
    assert found == [*steps, *([(2, False)] if frames == 5 else [])]
    run = read_run_folder(here / "runs/wave")
    assert (run.increments, run.end_ms, run.before_ms) == (12, 6.0, 0.0)


def test_abaqus_is_asked_for_the_whole_field_beside_the_afferents(here):
    assert main([*wave(12), "--solver", "abaqus", "--frames", "5"]) == 0
    deck = (here / "runs/wave/job.inp").read_text()
    assert "*OUTPUT, FIELD, FREQUENCY=5\n*NODE OUTPUT\nU\n*ELEMENT OUTPUT\nS\n" in deck
    assert "*OUTPUT, FIELD, FREQUENCY=1\n*NODE OUTPUT, NSET=OUTPUT_NODES\n" in deck


@pytest.mark.slow
@pytest.mark.solver
def test_traces_are_the_same_and_every_frame_shows_the_finger(here, capsys):
    stress = {}
    for frames in (0, 3):
        assert main([*wave(6), "--frames", str(frames), "-o", f"runs{frames}"]) == 0
        assert main(["run", f"runs{frames}/wave"]) == 0
        stress[frames] = fb.read(f"runs{frames}/wave")
    for one, other in zip(*stress.values(), strict=True):
        assert_allclose(other.stress_pa, one.stress_pa, rtol=0, atol=2e-5 * one.stress_pa.max())
    assert main(["ingest", "runs3/wave", "--vtu", "fields"]) == 0
    assert "left out: 4 of 6 increments, at fewer nodes" in capsys.readouterr().err
    assert len(list(here.glob("fields/*.vtu"))) == 2
    sizes = [len(field.nodes) > 1000 for field in fb.read_fields("runs3/wave")]
    assert sizes == 2 * [False, False, True]


def stimulus_of(word, **options):
    [entry] = resolve(word)
    return make_stimulus(entry, **options)


@pytest.fixture(scope="module")
def model():
    return model_of(PRESETS["quick"])


def test_building_again_touches_nothing_nor_does_a_disk_that_is_full(tmp_path, model, monkeypatch):
    """A solver at work there, or its results, keep what they were started with."""

    def contents():
        return {path.name: (path.stat().st_ino, path.read_bytes()) for path in tmp_path.iterdir()}

    def disk_full(stimulus, path):
        raise OutputError("cannot write: No space left on device", path)

    stimulus = stimulus_of("sine_50_250")
    build_run_folder(tmp_path, model, stimulus)
    before = contents()
    build_run_folder(tmp_path, model, stimulus)
    assert contents() == before
    monkeypatch.setattr("fembridge.solver.build.write_csv", disk_full)
    with pytest.raises(OutputError, match=r"stimulus\.csv"):
        build_run_folder(tmp_path, model, stimulus_of("sine_100_85.98"))
    assert contents() == before


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
