"""The table that separates a finger's change from its mesh's, with a solver made up."""

import importlib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from decks.presets import QUICK

ROOT = Path(__file__).parents[2]


@pytest.fixture
def program(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT))
    program = importlib.import_module("benchmarks.sensitivity_mesh")
    monkeypatch.setattr(program, "model_of", lambda finger: finger)

    def indent(bench, name, finger):
        """Stress that goes with the dermis' thickness, and 1 kPa more when finer."""
        rows = finger.resolution.epidermis_rows
        more = 1000.0 * (rows > QUICK.resolution.epidermis_rows)
        stress_pa = 10_000 * finger.skin.dermis_mm * np.array([1.0, 2.0, 0.5]) + more
        return SimpleNamespace(last_pa=stress_pa, elements=100 * rows)

    monkeypatch.setattr(program, "indent", indent)
    return program


def test_only_fingers_of_another_shape_are_pressed_on_both_meshes(program, tmp_path, capsys):
    study = tmp_path / "study.toml"
    study.write_text(
        'stimuli = ["sine_20_250"]\n[[fingers]]\ndesign = "one-at-a-time"\n'
        "[fingers.ranges]\nskin.dermis_mm = [0.99, 1.21]\n"
        'materials.dermis.young_mpa = "20 %"\ncontact.friction = "20 %"\n'
    )
    program.main([str(study), "--folder", str(tmp_path / "runs")])

    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "own mesh, 800 elements; finer mesh, 1600 elements"
    assert lines[4] == ("| the first | 11 kPa | 12 kPa | 22 kPa | 23 kPa | 5.5 kPa | 6.5 kPa |")
    assert lines[5] == (
        "| dermis thickness 0.99 | −10.0 % | −9.2 % | −10.0 % | −9.6 % | −10.0 % | −8.5 % |"
    )
    assert len(lines) == 7


def test_the_finer_mesh_has_twice_the_columns_and_rows_of_the_skin(program):
    fine = program.finer(QUICK.resolution)

    assert fine.contact_mm == QUICK.resolution.contact_mm / 2
    assert fine.epidermis_rows == 2 * QUICK.resolution.epidermis_rows
    assert fine.far_mm == QUICK.resolution.far_mm
