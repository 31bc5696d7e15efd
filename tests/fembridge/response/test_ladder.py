"""The ladder of contact models, climbed by a solver that plays what it is told.

Each rung's results are the recorded ones of the quick finger, put where the
solver would leave them.
"""

import dataclasses

import numpy as np
import pytest

from fembridge.errors import OutputError, ResponseError, SolverError, StimulusError
from fembridge.response.response_map import FOLDER, MAP_FILE, read_map
from fembridge.response.solve import LADDER, solve_response
from fembridge.solver.ccx import SolverSettings
from fembridge.solver.verdict import Cause


def test_the_first_rung_that_is_accepted_is_taken(tmp_path, model, player):
    told = []

    solved = solve_response(tmp_path, model, log=told.append)

    assert player.rungs == [1]
    assert [str(rung) for rung in solved.rungs] == [
        "node-to-surface, 200 MPa/mm, friction 0.4: accepted"
    ]
    assert told == []
    assert not solved.outcome.skipped
    shipped = read_map(FOLDER / "quick.toml")
    np.testing.assert_array_equal(solved.response.tensor_pa, shipped.tensor_pa)


def test_the_accepted_map_is_written(tmp_path, model, player):
    solved = solve_response(tmp_path / "response", model)

    written = read_map(tmp_path / "response" / MAP_FILE)
    np.testing.assert_array_equal(written.tensor_pa, solved.response.tensor_pa)
    assert written.origin == solved.response.origin


@pytest.mark.parametrize(
    "cause", [Cause.DIVERGED, Cause.ENDLESS_ITERATION, Cause.STALLED, Cause.NEGATIVE_JACOBIAN]
)
def test_a_rung_that_does_not_converge_is_left_and_told(tmp_path, model, player, cause):
    player.plays[1] = cause
    told = []

    solved = solve_response(tmp_path, model, log=told.append)

    assert player.rungs == [1, 2]
    assert told == [f"left {LADDER[0]}: {cause.value}: increment 3"]
    assert [rung.contact for rung in solved.rungs] == list(LADDER[:2])
    assert solved.rungs[-1].problem is None
    inputs = solved.response.origin["contact"]
    assert inputs["stiffness_mpa_per_mm"] == LADDER[1].stiffness_mpa_per_mm


def test_a_rung_that_remembers_is_left_and_told(tmp_path, model, player, remembering):
    remembering.add(1)
    told = []

    solve_response(tmp_path, model, log=told.append)

    assert player.rungs == [1, 2]
    assert told == [f"left {LADDER[0]}: unloading differs from loading by 17 %"]


@pytest.mark.parametrize(
    "cause",
    sorted(
        set(Cause)
        - {Cause.DIVERGED, Cause.ENDLESS_ITERATION, Cause.STALLED, Cause.NEGATIVE_JACOBIAN},
        key=lambda cause: cause.name,
    ),
)
def test_what_another_contact_does_not_cure_ends_the_climb(tmp_path, model, player, cause):
    """No solver, a full disk, an interrupt: five times the same would not help."""
    player.plays[1] = cause

    with pytest.raises(SolverError) as caught:
        solve_response(tmp_path, model)

    assert player.rungs == [1]
    assert caught.value.path == tmp_path / "contact_1"
    assert cause.value in str(caught.value)
    assert not (tmp_path / MAP_FILE).exists()


def test_without_a_solver_the_error_names_the_line_that_installs_one(tmp_path, model, monkeypatch):
    monkeypatch.delenv("FEMBRIDGE_CCX", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path / "empty"))

    with pytest.raises(SolverError, match="no ccx on the PATH; install it: apt-get"):
        solve_response(tmp_path / "response", model)


def test_when_all_rungs_fail_each_is_listed_with_its_reason(tmp_path, model, player, remembering):
    player.plays = {1: Cause.DIVERGED, 3: Cause.STALLED}
    remembering.update({2, *range(4, len(LADDER) + 1)})
    told = []

    with pytest.raises(ResponseError) as caught:
        solve_response(tmp_path, model, log=told.append)

    message = str(caught.value)
    assert message.startswith(f"{tmp_path}: no contact model was accepted: ")
    assert player.rungs == list(range(1, len(LADDER) + 1))
    reasons = message.partition("accepted: ")[2].split("; ")
    assert [reason.split(": ")[0] for reason in reasons] == [str(c) for c in LADDER]
    assert reasons[0].endswith(f"{Cause.DIVERGED.value}: increment 3")
    assert reasons[1].endswith("unloading differs from loading by 17 %")
    assert reasons[2].endswith(f"{Cause.STALLED.value}: increment 3")
    assert told == [f"left {reason}" for reason in reasons]
    assert not (tmp_path / MAP_FILE).exists()


def test_a_finished_run_is_read_again_and_not_solved(tmp_path, model, player):
    first = solve_response(tmp_path, model)

    second = solve_response(tmp_path, model)

    assert player.rungs == [1]
    assert second.outcome.skipped
    np.testing.assert_array_equal(second.response.tensor_pa, first.response.tensor_pa)


def test_a_finished_rung_that_remembers_is_not_solved_again(tmp_path, model, player, remembering):
    remembering.add(1)
    solve_response(tmp_path, model)

    again = solve_response(tmp_path, model)

    assert player.rungs == [1, 2]
    assert len(again.rungs) == 2


@pytest.mark.parametrize("name", ["job.dat", "job.frd"])
def test_a_finished_run_that_lost_a_file_is_solved_again(tmp_path, model, player, name):
    solve_response(tmp_path, model)
    (tmp_path / "contact_1" / name).unlink()

    solved = solve_response(tmp_path, model)

    assert player.rungs == [1, 1]
    assert not solved.outcome.skipped


def test_a_finished_run_of_another_finger_is_solved_again(tmp_path, model, player):
    solve_response(tmp_path, model)
    materials = dict(model.finger.materials)
    materials["dermis"] = dataclasses.replace(materials["dermis"], young_mpa=0.06)
    softer = dataclasses.replace(model.finger, materials=materials)

    solve_response(tmp_path, dataclasses.replace(model, finger=softer))

    assert player.rungs == [1, 1]


def test_the_solver_is_run_as_asked(tmp_path, model, player):
    settings = SolverSettings(threads=3, time_limit_s=99.0)

    solve_response(tmp_path, model, settings)

    assert player.settings == [settings]


def test_a_shorter_ladder_may_be_climbed(tmp_path, model, player):
    solved = solve_response(tmp_path, model, ladder=LADDER[3:])
    assert solved.rungs[0].contact == LADDER[3]


def test_a_place_that_cannot_be_written_is_told_before_anything(tmp_path, model, player):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(OutputError, match="a file stands where a folder is wanted"):
        solve_response(tmp_path / "file", model)
    assert player.rungs == []


def test_a_depth_that_makes_no_map_is_refused(tmp_path, model, player):
    with pytest.raises(StimulusError, match="depth_um is 0, expected 1 to 10000"):
        solve_response(tmp_path, model, depth_um=0.0)
    assert player.rungs == []


def test_the_ladder_tries_what_was_measured_to_come_back_first():
    assert LADDER[0].formulation == "node-to-surface"
    assert LADDER[0].friction == 0.4
    assert len(set(LADDER)) == len(LADDER)
