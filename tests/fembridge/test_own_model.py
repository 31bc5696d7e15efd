"""A user's own deck becomes run folders; what he wrote stays as he wrote it."""

import json
from pathlib import Path

import numpy as np
import pytest

from decks.own_model import Request
from decks.probe import Probe
from decks.stimuli import resolve
from decks.waveform import make_stimulus
from fembridge.api import build_deck
from fembridge.build import build_own_folder, read_base_deck
from fembridge.cli import main
from fembridge.errors import DeckError, UsageError
from fembridge.results.result import open_result
from fembridge.run_folder import read_run_folder, read_waveform

SAMPLES = Path(__file__).parents[2] / "fixtures"
INP = SAMPLES / "transient_sine" / "job.inp"
NODES = {"SA": 461, "RA": 367, "PC": 1459}


@pytest.fixture
def noise():
    return make_stimulus(resolve(["noise_25_250_5"])[0])


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.inp").write_bytes(INP.read_bytes())
    return tmp_path


def words(*more):
    return ["build-deck", "--stimulus", "noise_25_250_5", *more]


def test_a_folder_holds_deck_waveform_and_what_was_changed(here, noise):
    base = read_base_deck(Path("mine.inp"))
    run, remarks = build_own_folder(here / "run", base, noise, Request(afferents=NODES))
    assert run == read_run_folder(here / "run")
    assert (run.solver, run.increments, run.start_ms) == ("calculix", 500, 0.0)
    assert {place.afferent: place.node for place in run.afferents} == NODES
    assert any("amplitude DEPTH" in remark for remark in remarks)
    assert run.inputs["base_deck"]["changes"] == list(remarks)
    times_ms, depth_um = read_waveform(here / "run")
    np.testing.assert_array_equal(times_ms, noise.times_ms)
    np.testing.assert_allclose(depth_um, noise.displacement_um, rtol=1e-15)
    new = (here / "run/job.inp").read_bytes().splitlines()
    old = INP.read_bytes().splitlines()
    first = next(k for k, (a, b) in enumerate(zip(old, new, strict=False)) if a != b)
    assert old[first - 1].startswith(b"*AMPLITUDE")


def test_the_verb_tells_what_it_changed_and_its_summary_lists_it(here, capsys):
    nodes = [word for name, k in NODES.items() for word in ("--afferent", f"{name}={k}")]
    assert main(words("--base-deck", "mine.inp", *nodes, "--json")) == 0
    out, err = capsys.readouterr()
    summary = json.loads(out)
    assert summary["solver"] == "calculix"
    assert [row["increments"] for row in summary["folders"]] == [500]
    assert "mine.inp: line" in err
    assert len(err.splitlines()) == len(summary["remarks"])


@pytest.mark.parametrize(
    ("more", "code", "said"),
    [
        (["--finger", "paper"], 2, "--finger is for our finger"),
        (["--afferent", "SA=1", "--afferent", "SA=2"], 2, "names SA twice"),
        (["--solver", "marc"], 1, "mine.inp: a .inp is a deck for calculix or abaqus, not for"),
        (["--slide-mm-per-s", "4"], 1, "slides by your own conditions"),
        (["--amplitude", "NONE"], 1, "mine.inp"),
        (["--afferent", "SA=999999"], 1, "999999"),
        (["--results", "both"], 1, "expected binary or text"),
        (["--afferent", "SA"], 2, "expected NAME=NODE"),
        (["--afferent", "SA=-1"], 2, "expected NAME=NODE"),
        (["--afferent", "sa=3"], 2, "'sa', expected one of SA, RA, PC"),
    ],
)
def test_what_makes_no_sense_is_one_line(here, refused, more, code, said):
    refused(words("--base-deck", "mine.inp", *more), said, code)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"base_deck": "mine.inp", "finger": "paper"}, "finger is for our finger"),
        ({"base_deck": "mine.inp", "probe": Probe()}, "probe is for our finger"),
        ({"amplitude": "DEPTH"}, "amplitude is for base_deck alone"),
    ],
)
def test_what_python_gives_for_the_other_deck_is_refused(here, more, said):
    with pytest.raises(UsageError, match=said):
        build_deck("noise_25_250_5", **more)
    assert list(here.iterdir()) == [here / "mine.inp"]


@pytest.mark.parametrize(
    ("name", "said"),
    [("no.inp", "cannot be read"), ("mine.txt", "expected a deck"), ("", "expected")],
)
def test_a_file_that_is_no_deck_is_named(here, name, said):
    with pytest.raises(DeckError, match=said):
        read_base_deck(here / name)


def test_included_files_come_along(here, noise):
    lines = (here / "mine.inp").read_text().splitlines(keepends=True)
    first = next(k for k, line in enumerate(lines) if line.startswith("*NODE,"))
    after = next(k for k in range(first + 1, len(lines)) if lines[k].startswith("*"))
    (here / "mesh.inc").write_text("".join(lines[first:after]))
    lines[first:after] = ["*INCLUDE, INPUT=mesh.inc\n"]
    (here / "mine.inp").write_text("".join(lines))
    base = read_base_deck(here / "mine.inp")
    run, _ = build_own_folder(here / "run", base, noise, Request(afferents=NODES))
    assert (here / "run/mesh.inc").read_bytes() == (here / "mesh.inc").read_bytes()
    assert {place.afferent: place.node for place in run.afferents} == NODES
    (here / "mesh.inc").unlink()
    with pytest.raises(DeckError, match=r"mesh\.inc"):
        build_own_folder(here / "again", base, noise, Request())
    assert not (here / "again").exists()


@pytest.mark.parametrize("name", ["../mesh.inc", "run.toml"])
def test_an_included_file_from_elsewhere_is_refused(here, noise, name):
    text = (here / "mine.inp").read_text()
    (here / "mine.inp").write_text(f"*INCLUDE, INPUT={name}\n{text}")
    base = read_base_deck(here / "mine.inp")
    with pytest.raises(DeckError, match="expected a file beside it, by its name alone"):
        build_own_folder(here / "run", base, noise, Request())


def test_results_of_a_run_are_in_the_units_that_its_deck_was_built_with(here):
    deck = INP.read_text().replace("*HEADING\n", "*HEADING\nUnit system: M_TON_S_C\n")
    (here / "mine.inp").write_text(deck)
    assert main(words("--base-deck", "mine.inp", "-o", "out")) == 0
    run = read_run_folder(here / "out/noise_25_250_5")
    assert (run.stress_unit, run.length_unit) == ("kPa", "m")
    run.results.write_bytes(b"    1C\n")
    with open_result(run) as result:
        options = result.source.options
        assert (options.stress_unit, options.length_unit) == ("kPa", "m")
