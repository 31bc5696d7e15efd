"""The table of what a transient costs, with a solver made up."""

import importlib
from pathlib import Path

import numpy as np
import pytest

from decks.presets import QUICK
from fembridge.build import model_of
from fembridge.store import sha256_of

ROOT = Path(__file__).parents[2]
FORCE = b"*CLOAD\nSKIN_APEX, 2, 1.0E-12\n"


@pytest.fixture
def program(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT))
    return importlib.import_module("benchmarks.transient_cost")


def test_each_row_is_off_the_first_in_percent_of_the_peak(program, monkeypatch, tmp_path, capsys):
    """The second way's trace is 0.01 of the peak off, the third gives up."""
    runs = []

    def solve(run, threads):
        runs.append((run, threads))
        stress_pa = np.array([[0.0, 100.0], [0.0, 5000.0]])
        stress_pa[0, 0] += {2: 1.0}.get(len(runs), 0.0)
        gone = len(runs) == 3
        return program.Solved(12.0, 13.0, 7, 24, None if gone else stress_pa)

    monkeypatch.setattr(program, "solve", solve)
    program.main(["--finger", "quick", "--increments", "8", "--folder", str(tmp_path / "runs")])

    head, _, _, _, *rows = capsys.readouterr().out.splitlines()
    assert head == "`quick`, 8 increments"
    cells = [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]
    assert [row[0] for row in cells] == [way.told for way in program.WAYS]
    assert all(row[1:5] == ["12.0", "13.0", "24", "0.500"] for row in cells)
    assert [row[5] for row in cells[:4]] == [
        "0.0000",
        "1.0000",
        "ended after 7 increments",
        "0.0000",
    ]
    assert [threads for _, threads in runs] == [1, 1, 1, 2, 1, 1]


def test_the_ways_are_written_as_they_are_told(program, tmp_path):
    model = model_of(QUICK)
    runs = [
        program.build(tmp_path / str(number), model, way, 8)
        for number, way in enumerate(program.WAYS)
    ]
    decks = [run.deck.read_bytes() for run in runs]
    assert [run.deck_sha256 for run in runs] == [sha256_of(run.deck) for run in runs]
    assert [b"*SPRING" in deck for deck in decks] == [False] + 5 * [True]
    assert [bool(run.on_axis) for run in runs] == [False, False] + 4 * [True]
    assert [FORCE in deck for deck in decks] == [False, True, True, True, False, True]
    assert decks[4] == decks[2].replace(FORCE, b"")
    assert [b"*FRICTION" in deck for deck in decks] == 5 * [True] + [False]
    assert decks[3] == decks[2]


def test_the_probe_goes_in_and_then_stays_off_for_longer(program):
    wave = program.waveform(40)
    depth_um = wave.displacement_um
    assert (depth_um[0], depth_um.size, depth_um.argmax()) == (0.0, 41, 5)
    assert depth_um.max() == program.DEPTH_UM
    assert (depth_um[11:] <= -10).all()
    assert (np.diff(depth_um[11:]) < 0).all()


def test_a_transient_too_short_to_go_in_and_off_is_misuse(program):
    with pytest.raises(SystemExit):
        program.main(["--increments", "7"])
