"""The benchmarks of encoding and fitting run, and print what they promise."""

import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def _from_the_root(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT))


def test_the_search_is_timed_against_an_empty_problem(monkeypatch, capsys):
    program = importlib.import_module("benchmarks.fit_search")
    monkeypatch.setattr(program, "REPEATS", 1)

    program.main(200)

    lines = capsys.readouterr().out.splitlines()
    assert lines[1].startswith("pymoo, empty problem")
    assert sum("x empty" in line for line in lines) == 6
    assert sum("all three" in line for line in lines) == 2


def test_encoding_is_timed_against_touchsim(monkeypatch, capsys):
    program = importlib.import_module("benchmarks.encode_all")
    monkeypatch.setattr(program, "REPEATS", 1)

    program.main()

    published, fitted, pad = capsys.readouterr().out.splitlines()
    assert "82 stimuli, 3 cells" in published
    assert "82 stimuli, 30 cells" in fitted
    assert pad.startswith("fitted_pad")
    assert "x less than TouchSim" in published
