"""The verb ``deflect``: a table, a picture, and a summary."""

import argparse
import csv
import json

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from fembridge.commands import deflect
from fembridge.deflection.profile import stored_deflections
from fembridge.errors import FingerError, ResponseError, UsageError

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture
def call(tmp_path):
    """Run the verb with words, into a folder ``out``; give its summary."""

    def run(*words):
        parser = argparse.ArgumentParser()
        deflect.add_arguments(parser)
        parser.add_argument("--json", action="store_true")
        return deflect.run(parser.parse_args([*words, "-o", str(tmp_path / "out")]))

    return run


def table(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_without_options_all_stored_meshes_are_written_and_drawn(call, tmp_path):
    call()
    rows = table(tmp_path / "out" / "deflection.csv")
    assert list(rows[0]) == ["mesh", "distance_mm", "deflection_mm"]
    for mesh in stored_deflections():
        mine = [row for row in rows if row["mesh"] == mesh.name]
        distance_mm = np.array([float(row["distance_mm"]) for row in mine])
        deflection_mm = np.array([float(row["deflection_mm"]) for row in mine])
        assert_array_equal(distance_mm, mesh.distance_mm)
        assert_array_equal(deflection_mm, mesh.deflection_mm)
    assert len(rows) == sum(m.distance_mm.size for m in stored_deflections())
    assert (tmp_path / "out" / "deflection.png").read_bytes().startswith(PNG)


def test_the_screen_shows_each_mesh_with_change_and_limit(call, capsys):
    call("--stored")
    told = capsys.readouterr().out.splitlines()
    meshes = stored_deflections()
    assert told[0].split() == ["mesh", *(mesh.name for mesh in meshes), "change", "limit"]
    assert told[1].split() == ["elements", *(str(mesh.elements) for mesh in meshes)]
    (line,) = (line for line in told if line.startswith("deflection at 1 mm "))
    values = line.split()[4 : 4 + len(meshes)]
    assert values == [f"{float(mesh.at(1.0)):.5f}" for mesh in meshes]
    assert told[-1].startswith("deflection.csv, deflection.png: ")


def test_one_mesh_is_shown_alone(call, capsys):
    summary = call("--finger", "quick")
    told = capsys.readouterr().out
    assert told.splitlines()[0].split() == ["mesh", "quick"]
    assert "medium" not in told
    assert summary["convergence"] == []
    assert [mesh["mesh"] for mesh in summary["meshes"]] == ["quick"]


def test_the_summary_is_what_json_holds_and_nothing_else_is_printed(call, capsys):
    from fembridge.cli import _strict

    summary = call("--json")
    assert capsys.readouterr().out == ""
    found = json.loads(json.dumps(_strict(summary), allow_nan=False))
    assert found["source"] == "stored"
    force = found["convergence"][-1]
    assert force["quantity"] == "force_n_per_mm"
    assert_allclose(force["values"], [mesh.force_n_per_mm for mesh in stored_deflections()])


def test_a_mesh_that_is_not_stored_is_refused_and_nothing_is_written(call, tmp_path):
    with pytest.raises(ResponseError, match=r"'mine', only for .*--solver run solves"):
        call("--finger", "mine")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("option", ["--depth-mm", "--threads", "--time-limit"])
def test_what_is_for_the_solver_is_refused_without_it(call, option):
    with pytest.raises(UsageError, match=f"{option} is for --solver run"):
        call(option, "1")


def test_run_and_stored_together_are_misuse(call, capsys):
    with pytest.raises(SystemExit) as stop:
        call("--solver", "run", "--stored")
    assert stop.value.code == 2
    assert "not allowed with" in capsys.readouterr().err


def test_a_finger_that_does_not_exist_is_refused_before_anything_is_solved(call):
    with pytest.raises(FingerError, match=r"absent\.toml"):
        call("--solver", "run", "--finger", "absent.toml")


@pytest.mark.solver
def test_a_shallow_run_is_solved_written_and_kept(call, tmp_path, capsys):
    summary = call("--solver", "run", "--depth-mm", "0.05", "--threads", "1")
    assert (summary["source"], summary["depth_mm"]) == ("solved", 0.05)
    assert summary["meshes"][0]["force_n_per_mm"] > 0
    rows = table(tmp_path / "out" / "deflection.csv")
    assert {row["mesh"] for row in rows} == {"quick"}
    assert_allclose(float(rows[0]["deflection_mm"]), 0.05, rtol=0.03)
    assert (tmp_path / "out" / "run" / "deflection.toml").is_file()
    assert "stored differ" not in capsys.readouterr().err  # it is of another depth
