"""Folders as people name them, and longer than any solver expects."""

from pathlib import Path

import pytest

from fembridge.cli import main
from fembridge.io.run_folder import read_run_folder
from fembridge.solver.ccx import run_ccx

NAMES = {
    "quotes": 'the "quick" one\'s $HOME; `x` & %s {y} [z] *',
    "no name of a file elsewhere": "a:b?c|d<e>\\f",
    "other script": "人差し指の先",
    "200 characters": "größer  als " + "n n" * 62,
}


@pytest.mark.parametrize("name", NAMES)
def test_a_run_in_an_odd_folder_is_like_any_other(fake_ccx, make_run, capsys, as_in_table, name):
    folder = make_run("normal", NAMES[name])
    assert main(["run", str(folder)]) == 0
    as_in_table(capsys.readouterr().out.strip())
    assert (folder / "job.frd").read_text().endswith(" 9999\n")


def test_an_odd_folder_gives_the_same_results_and_nothing_beside_them(here, files_below):
    words = ["simulate", "--stored", "--no-plot", "--stimulus", "sine_20_250", "-o"]
    for output in ("plain", f"{NAMES['200 characters']}/{NAMES['quotes']}"):
        assert main([*words, output]) == 0
    found = files_below(here)
    plain = {name: found.pop(f"plain/{name}") for name in files_below(Path("plain"))}
    odd = {name.rpartition("/")[2]: content for name, content in found.items()}
    assert odd == plain
    assert len(plain) == 5


@pytest.mark.solver
@pytest.mark.parametrize("name", ["quotes", "200 characters"])
def test_calculix_itself_works_in_an_odd_folder(make_run, patch, name):
    """It keeps 132 characters of its job's name; it is started in the folder."""
    assert run_ccx(read_run_folder(make_run(deck=patch(), name=NAMES[name]))).accepted


def test_a_solver_in_an_odd_folder_is_started(fake_ccx, make_run, monkeypatch):
    odd = fake_ccx.parent / NAMES["200 characters"]
    odd.mkdir()
    monkeypatch.setenv("FEMBRIDGE_CCX", str(fake_ccx.rename(odd / "my ccx")))
    assert run_ccx(read_run_folder(make_run("normal"))).accepted


def test_a_name_that_is_too_long_for_the_system_is_said(tmp_path, refused):
    words = ["build-deck", "--stimulus", "sine_20_250", "-o", tmp_path / (300 * "n")]
    refused(*words)
    assert list(tmp_path.iterdir()) == []
