"""What the commands do, as functions: the examples of their docstrings, and the files."""

import doctest
import importlib.util
import shutil
from pathlib import Path

import pandas
import pytest

import fembridge as fb
from fembridge import api
from fembridge.cli import main
from fembridge.results import result

RECORDED = Path(__file__).parents[2] / "fixtures/transient_sine"


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("FEMBRIDGE_CCX", raising=False)
    monkeypatch.setenv("PATH", "")


@pytest.mark.parametrize("module", [fb, api, result])
def test_the_examples_are_true(tmp_path, module, monkeypatch):
    """But for the evidence of a validation, which is most of it and is tested beside it."""
    monkeypatch.setattr("fembridge.report.validate.gather", lambda *_: None)
    shutil.copytree(RECORDED, tmp_path / "runs/sine_20_250")
    found = doctest.testmod(module)
    assert found.attempted
    assert not found.failed


def test_simulate_gives_what_the_command_writes(tmp_path):
    words = ["--stimulus", "sine_20_250,noise_25_250_20", "--no-plot", "-o", "out"]
    assert main(["simulate", *words]) == 0
    result = fb.simulate(["sine_20_250", "noise_25_250_20"])
    for frame, name in ((result.rates, "rates"), (result.spikes, "spikes")):
        pandas.testing.assert_frame_equal(frame, pandas.read_csv(f"out/{name}.csv"))
    result.write("again")
    for name in ("rates.csv", "spikes.csv", "traces.npz", "simulation.toml"):
        written = (tmp_path / "again" / name).read_bytes()
        assert written == (tmp_path / "out" / name).read_bytes()


def test_no_module_hides_a_public_function():
    """A submodule that was imported is an attribute of its package, whatever it hides."""
    for name in fb.__all__:
        assert importlib.util.find_spec(f"fembridge.{name}") is None


def test_values_are_shown_in_a_notebook_without_their_samples():
    two = fb.simulate(["sine_20_250", "sine_50_250"], stored=True)
    shown = f"{two!r} {two.stimuli[0]!r} {two.traces[0][0]!r}"
    assert len(shown) < 300
    assert "sine_20_250" in shown
    assert "501 samples" in shown
