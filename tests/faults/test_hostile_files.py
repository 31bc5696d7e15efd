"""Files from users with values that break things, or would like to."""

import shutil

import pytest

from fembridge.response import response_map

FINGERS = {
    "huge count": "[resolution]\ndermis_rows = 1000000000",
    "huge mesh": "resolution = {contact_mm=0.005, ridge_mm=0.005, dermis_rows=200}",
    "tiny ridges": "[ridges]\nspacing_mm = 1e-9",
    "name outside": 'name = "../../outside"',
    "base outside": 'base = "../../etc/passwd"',
    "nan": "[materials.dermis]\nyoung_mpa = nan",
    "negative thickness": "[skin]\nepidermis_mm = -0.4",
    "python": "[skin]\nepidermis_mm = \"__import__('os').system('touch hacked')\"",
    "python key": '__import__ = "os"',
    "no end": 'name = "' + 900_000 * "a",
}
PARAMETERS = {
    "nan": "base = 'fitted'\n[SA]\ntau_ms = nan",
    "huge count": "base = 'fitted'\n[SA]\ncells = 1000000000000",
    "python": "base = 'fitted'\n[SA]\ndrive = \"__import__('os')\"",
    "key": '__import__ = "os"',
}
RUNS = {
    "nan": ("dt_ms = 0.5", "dt_ms = nan"),
    "huge count": ("increments = 4", "increments = 1000000000000"),
    "solver outside": ('solver = "calculix"', 'solver = "../../bin/sh"'),
    "python": ('solver = "calculix"', "solver = \"__import__('os')\""),
}
STIMULI = [
    *("../../outside", "__import__('os')"),
    *("sine_nan_1", "sine_20_1e300", "noise_1e308_5_25"),
]


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A folder inside another one, in which nothing else may appear."""
    place = tmp_path / "a" / "b"
    place.mkdir(parents=True)
    monkeypatch.chdir(place)
    return place


@pytest.mark.parametrize("kind", FINGERS)
def test_a_hostile_finger_makes_no_deck(here, tmp_path, files_below, refused, kind):
    (here / "finger.toml").write_text(FINGERS[kind])
    before = files_below(tmp_path)
    words = ["--finger", "finger.toml", "--stimulus", "sine_20_250", "-o", "runs"]
    line = refused("build-deck", *words)
    assert files_below(tmp_path) == before
    assert not (here / "runs").exists()
    assert len(line) < 400


@pytest.mark.parametrize("kind", PARAMETERS)
def test_hostile_parameters_fire_nothing(here, tmp_path, files_below, refused, kind):
    (here / "mine.toml").write_text(PARAMETERS[kind])
    before = files_below(tmp_path)
    words = ["--parameters", "mine.toml", "--stimulus", "sine_20_250", "-o", "out"]
    refused("simulate", "--stored", *words)
    assert files_below(tmp_path) == before


@pytest.mark.parametrize("kind", RUNS)
def test_a_hostile_run_folder_gives_no_result(fake_ccx, make_run, refused, kind):
    folder = make_run("normal")
    path = folder / "run.toml"
    old, new = RUNS[kind]
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    refused("run", folder)
    assert not (folder / "job.frd").exists()


@pytest.mark.parametrize("stimulus", STIMULI)
def test_a_hostile_stimulus_names_no_folder(here, tmp_path, files_below, refused, stimulus):
    refused("build-deck", "--stimulus", stimulus, "-o", "runs")
    assert files_below(tmp_path) == {}


@pytest.mark.parametrize("number", ["depth_um", "closure_percent", "young_mpa"])
def test_a_stored_map_that_was_edited_answers_nothing(here, monkeypatch, refused, number):
    maps = here / "maps"
    shutil.copytree(response_map.FOLDER, maps)
    path = maps / "quick.toml"
    head, key, tail = path.read_text(encoding="utf-8").partition(f"{number} = ")
    place = next(k for k, letter in enumerate(tail) if letter in "123456789")
    edited = str(int(tail[place]) % 9 + 1)
    path.write_text(head + key + tail[:place] + edited + tail[place + 1 :], "utf-8")
    monkeypatch.setattr(response_map, "FOLDER", maps)

    refused("simulate", "--stored", "--stimulus", "sine_20_250", "-o", "out")

    assert not (here / "out").exists()
