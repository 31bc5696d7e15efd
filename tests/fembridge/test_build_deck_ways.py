"""``fembridge build-deck``: a probe that slides, inertia, half of the section."""

import pytest

from fembridge.cli import main
from fembridge.run_folder import read_run_folder, read_waveform


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


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


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["--slide-mm-per-s", "0"], "slides at 0 mm/s, expected a speed other than 0"),
        (["--slide-mm-per-s", "4", "--solver", "marc"], "no sliding probe for marc"),
        (["--slide-mm-per-s", "1e4"], "expected inside the pad"),
        (["--inertia", "--solver", "marc"], "writes no inertia for marc"),
    ],
)
def test_a_way_that_no_deck_can_hold_is_one_line(here, capsys, words, problem):
    assert main(["build-deck", "--stimulus", "sine_20_250", *words]) in (1, 2)

    error = capsys.readouterr().err
    assert problem in error
    assert error.count("\n") == 1
    assert not (here / "runs").exists()


def test_an_own_deck_has_its_own_conditions_for_a_slide(here, capsys):
    assert main(["build-deck", "--stimulus", "sine_20_250", "-o", "ours"]) == 0
    base = here / "ours" / "sine_20_250" / "job.inp"
    words = ["--base-deck", str(base), "--slide-mm-per-s", "4"]

    assert main(["build-deck", "--stimulus", "sine_20_250", *words]) == 1

    assert "slides by your own conditions" in capsys.readouterr().err


def test_half_of_a_section_is_enough_unless_all_is_asked_for(here):
    words = ["build-deck", "--stimulus", "sine_20_250"]
    assert main([*words, "-o", "half"]) == 0
    assert main([*words, "-o", "whole", "--whole-section"]) == 0

    half, whole = (read_run_folder(here / name / "sine_20_250") for name in ("half", "whole"))
    assert half.inputs["section"] == "half"
    assert whole.inputs["section"].startswith("whole: the whole section was asked for")
    assert half.deck.stat().st_size < 0.65 * whole.deck.stat().st_size
