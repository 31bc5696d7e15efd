"""``fembridge plot``: from the words of a user to a picture in a file."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import fembridge
from decks.presets import PRESETS
from decks.probe import Probe
from decks.stimuli import resolve
from decks.synthesis import make_stimulus
from fembridge.cli import main
from fembridge.io.run_folder import AfferentNode
from fembridge.io.spike_table import Rate, SpikeTrain, write_rates, write_spikes
from fembridge.response.response_map import ResponseMap, stored_response, write_map
from fembridge.simulation.simulation import encode_all
from fembridge.trace import StressTrace, Traces
from neural import PUBLISHED

ROOT = Path(fembridge.__file__).parents[1]
STUDY = ROOT / "docs/studies/sensitivity_one_at_a_time.csv"
PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A current folder with a response, traces, and spikes of two stimuli."""
    monkeypatch.chdir(tmp_path)
    depth_um = np.array([0.0, 100.0, 400.0])
    tensor_pa = np.zeros((3, 1, 6))
    tensor_pa[:, 0, 1] = -100.0 * depth_um
    place = AfferentNode("SA", 7, "epidermis", 0.0, -0.6, 0.6)
    write_map(
        tmp_path / "response.toml",
        ResponseMap(depth_um, tensor_pa, 1e-5 * depth_um, (place,), 0.02),
    )
    stress_pa = np.linspace(0.0, 3000.0, 501)
    traces = [StressTrace(stress_pa, 0.5, 7, "SA"), StressTrace(stress_pa / 2, 0.5, 8)]
    Traces(traces).to_frame().to_csv(tmp_path / "traces.csv", index=False)
    write_spikes(
        tmp_path / "spikes.csv",
        [
            SpikeTrain("sine_20_250", "SA", np.array([10.0, 60.0])),
            SpikeTrain("sine_50_250", "RA", np.array([110.0])),
        ],
    )
    write_rates(tmp_path / "rates.csv", [Rate("sine_20_250", "SA", 25.0)])
    return tmp_path


def summary(capsys, *words):
    assert main(["plot", *words, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_the_suffix_chooses_the_format_and_the_file_is_said(here, capsys):
    assert main(["plot", "stimulus", "sine_20_250", "-o", "new/a.SVG"]) == 0
    assert capsys.readouterr().out == "new/a.SVG\n"
    assert (here / "new/a.SVG").read_bytes().startswith(b"<?xml")


@pytest.mark.usefixtures("unrendered")
@pytest.mark.parametrize(
    ("words", "shown"),
    [
        (["stimulus", "noise_5_25"], {"stimuli": [entry.id for entry in resolve("noise_5_25")]}),
        (["mesh", "--finger", "soft.toml"], {"finger": "soft"}),
        (
            ["response", "response.toml"],
            {"afferents": ["SA"], "depths": 3, "deepest_um": 400.0, "closure_percent": 0.02},
        ),
        (
            ["trace", "traces.csv", "--stimulus", "sine_20_250"],
            {
                "traces": [
                    {"afferent": "SA", "node": 7, "peak_pa": 3000.0},
                    {"afferent": None, "node": 8, "peak_pa": 1500.0},
                ]
            },
        ),
        (
            ["raster", "spikes.csv"],
            {"stimuli": ["sine_20_250", "sine_50_250"], "silent": [], "spikes": 3},
        ),
        (["raster", "spikes.csv", "--afferent", "RA", "--window-ms", "100:200"], {"spikes": 1}),
        (["isi", "spikes.csv"], {"intervals": 1, "bin_ms": 1.0}),
        (["psth", "spikes.csv"], {"spikes": 3, "bin_ms": 5.0}),
        (["rates", "rates.csv"], {"stimuli": ["sine_20_250"], "left_out": []}),
    ],
    ids=lambda words: words[0] if isinstance(words, list) else "",
)
def test_the_summary_holds_what_is_in_the_picture(here, capsys, words, shown):
    Path("soft.toml").write_text("[materials.dermis]\nyoung_mpa = 0.02\n")
    found = summary(capsys, *words)
    assert shown.items() <= found.items()
    assert (found["picture"], found["file"]) == (words[0], f"{words[0]}.png")


@pytest.mark.usefixtures("unrendered")
def test_json_is_an_option_of_the_verb_too(here, capsys):
    found = summary(capsys, "raster", "spikes.csv")
    assert main(["plot", "--json", "raster", "spikes.csv"]) == 0
    assert json.loads(capsys.readouterr().out) == found


@pytest.mark.usefixtures("unrendered")
def test_without_a_file_the_stored_response_of_a_finger_is_drawn(here, capsys):
    for words, elements in (([], "quick"), (["--finger", "paper"], "paper")):
        shown = summary(capsys, "response", *words)
        assert shown["deepest_um"] == stored_response(PRESETS[elements], Probe(), "CPE4").deepest_um


@pytest.mark.usefixtures("unrendered")
def test_a_raster_has_the_rows_that_were_asked_for_and_says_which_are_silent(here, capsys):
    words = ["--stimulus", "sine_20_6.71,sine_20_250", "--stimulus", "sine_20_18"]
    assert main(["plot", "raster", "spikes.csv", *words, "--json"]) == 0
    streams = capsys.readouterr()
    shown = json.loads(streams.out)
    assert shown["stimuli"] == ["sine_20_6.71", "sine_20_250", "sine_20_18"]
    assert shown["silent"] == ["sine_20_6.71", "sine_20_18"]
    assert shown["spikes"] == 2
    assert "spikes.csv: no spike of sine_20_6.71, sine_20_18: silent" in streams.err


def raster_arguments(monkeypatch, *words, table="spikes.csv"):
    found = {}

    def figure(trains, **options):
        found.update(options, trains=trains)
        return Figure(figsize=(1, 1))

    monkeypatch.setattr("fembridge.plots.spike_figures.raster_figure", figure)
    assert main(["plot", "raster", table, *words]) == 0
    return found


def test_a_single_stimulus_brings_its_waveform_and_its_window(here, monkeypatch):
    single = raster_arguments(monkeypatch, "--stimulus", "sine_50_250")
    assert single["waveform"].id == "sine_50_250"
    assert single["window_ms"] == (100.0, 200.0)
    assert single["afferents"] == ["SA", "RA"]  # those of the table, also if silent
    several = raster_arguments(monkeypatch, "--stimulus", "sine_50")
    assert several["waveform"] is several["window_ms"] is None
    words = ["--stimulus", "sine_50_250", "--window-ms", "5:50"]
    assert raster_arguments(monkeypatch, *words)["window_ms"] == (5.0, 50.0)


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    ("words", "code", "shown"),
    [
        ([], 2, "required: PICTURE"),
        (["mesh", "-o", "mesh.xyz"], 2, "mesh.xyz: cannot draw .xyz, expected one of"),
        (["response", "response.toml", "--finger", "quick"], 2, {"argument": "--finger"}),
        (["stimulus", "sine_20_25o"], 2, "did you mean"),
        (
            ["trace", "traces.csv", "--stimulus", "sine_20"],
            2,
            {"argument": "--stimulus", "found": "sine_20"},
        ),
        (["mesh", "--probe-diameter-mm", "0"], 2, "--probe-diameter-mm"),
        (["mesh", "--finger", "nobody"], 2, {"argument": "--finger", "found": "nobody"}),
        (["mesh", "--probe-x-mm", "20"], 1, "the probe spans x = "),
        (["response", "nothing.toml"], 2, "nothing.toml: cannot be read"),
        (["trace", "spikes.csv"], 1, "no column"),
        (["stimulus", "sine_20_250", "-o", "spikes.csv/a.png"], 1, "spikes.csv: "),
    ],
)
def test_what_cannot_be_drawn_is_one_line(refused, words, code, shown):
    refused(["plot", *words], shown, code)


@pytest.mark.usefixtures("unrendered")
def test_a_table_of_no_spikes_is_drawn_where_a_stimulus_is_named(here, capsys):
    Path("none.csv").write_text("stimulus,afferent,cell,spike_time_ms\n")
    assert main(["plot", "raster", "none.csv"]) == 2
    assert "none.csv: no spikes; --stimulus ID" in capsys.readouterr().err
    assert main(["plot", "raster", "none.csv", "--stimulus", "sine_20_250"]) == 0
    assert (here / "raster.png").read_bytes().startswith(PNG)


@pytest.fixture
def out(here):
    """A simulation's folder: two stimuli of a probe 75 um deep, one of them silent."""
    stimuli = [make_stimulus(entry, 75.0) for entry in resolve("sine_20_250,sine_20_6.71")]
    traces = [
        [StressTrace(gain * np.maximum(one.displacement_um, 0.0), 0.5, 7, "SA")]
        for one, gain in zip(stimuli, (120.0, 0.1), strict=True)
    ]
    simulation = encode_all(stimuli, traces, PUBLISHED, {"parameters": {"SA": {"cells": 1}}})
    simulation.write(here / "out")
    (here / "out/response").mkdir()
    shutil.copy(here / "response.toml", here / "out/response")
    shutil.copy(STUDY, here / "out/results.csv")
    return here / "out"


@pytest.mark.usefixtures("unrendered", "out")
@pytest.mark.parametrize(
    ("picture", "place"),
    [
        ("raster", "."),
        *((name, "out") for name in ("psth", "isi", "rates", "trace", "response", "sensitivity")),
    ],
)
def test_every_picture_of_a_file_takes_the_folder_that_has_it(here, capsys, picture, place):
    for name in ("spikes.csv", "traces.csv", "response.toml"):
        (here / name).unlink()
    words = ["--stimulus", "sine_20_250"] if picture == "trace" else []
    shown = summary(capsys, picture, place, *words)
    assert shown["picture"] == picture
    assert (here / f"{picture}.png").read_bytes() == PNG


@pytest.mark.usefixtures("unrendered")
def test_a_folder_of_a_simulation_tells_silence_and_the_depth_of_the_probe(
    out, capsys, monkeypatch
):
    assert summary(capsys, "raster", "out")["silent"] == ["sine_20_6.71"]
    assert capsys.readouterr().err == ""
    assert summary(capsys, "trace", "out", "--stimulus", "sine_20_6.71")["preindent_um"] == 75.0
    drawn = raster_arguments(monkeypatch, "--stimulus", "sine_20_250", table="out/spikes.csv")
    assert drawn["waveform"].displacement_um[0] == 75.0
    assert [(t.stimulus, t.times_ms.size > 0) for t in drawn["trains"]] == [("sine_20_250", True)]


@pytest.mark.usefixtures("unrendered")
def test_a_table_alone_takes_the_depth_from_the_option_or_says_that_it_is_0(
    here, capsys, monkeypatch
):
    words = ["--stimulus", "sine_50_250"]
    assert raster_arguments(monkeypatch, *words)["waveform"].displacement_um[0] == 0.0
    assert "without pre-indentation" in capsys.readouterr().err
    drawn = raster_arguments(monkeypatch, *words, "--preindent-um", "75")
    assert drawn["waveform"].displacement_um[0] == 75.0
    assert capsys.readouterr().err == ""


@pytest.mark.usefixtures("unrendered")
def test_rates_are_drawn_beside_those_observed_and_touchsims(out, capsys):
    Path("observed.csv").write_text(
        "stimulus,afferent,rate_ips\nsine_20_250,SA,25\nsine_50_250,SA,4\n"
    )
    shown = summary(capsys, "rates", "out", "--observed", "observed.csv", "--touchsim")
    assert shown["stimuli"] == ["sine_20_250", "sine_20_6.71"]
    assert (shown["observed"], shown["touchsim"]) == (1, 6)


@pytest.mark.usefixtures("unrendered", "out")
@pytest.mark.parametrize(
    ("words", "code", "shown"),
    [
        (["trace", "out"], 2, "out/traces.npz: has 2 stimuli"),
        (["trace", "out", "--stimulus", "sine_50_250"], 2, "out/traces.npz: has 2 stimuli"),
        (
            ["raster", "out", "--stimulus", "sine_20_250", "--preindent-um", "0"],
            2,
            {"argument": "--preindent-um", "found": 0.0, "expected": "75"},
        ),
        (["raster", "empty"], 1, "empty: no spikes.csv in this folder"),
        (["raster", "many"], 2, "many: 2 folders in it have one"),
        (["psth", "out", "--bin-ms", "0"], 2, {"argument": "--bin-ms", "found": "0"}),
        (
            ["isi", "out", "--longest-ms", "-1"],
            2,
            {"argument": "--longest-ms", "found": "-1"},
        ),
        (["rates", "named.csv"], 2, "no rate of a sinusoid, diharmonic or noise"),
        (["rates", "docs.csv"], 2, "docs.csv: rates of several fingers"),
    ],
)
def test_what_is_absent_or_ambiguous_is_said_in_one_line(here, refused, words, code, shown):
    for name in ("empty", "many/a", "many/b"):
        (here / name).mkdir(parents=True)
    for name in ("many/a", "many/b"):
        shutil.copy("spikes.csv", name)
    Path("named.csv").write_text("stimulus,afferent,rate_ips\nmine,SA,25\n")
    head = "skin.dermis_mm,stimulus,afferent,rate_ips,status\n"
    rows = "1,sine_20_250,SA,25,done\n2,sine_20_250,SA,26,done\n"
    Path("docs.csv").write_text(head + rows)
    refused(["plot", *words], shown, code)
