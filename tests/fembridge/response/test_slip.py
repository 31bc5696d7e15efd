"""Skin that slips under friction, and skin that relaxes: no map is made of them."""

import dataclasses
import pickle

import pytest

from decks.material import PronyTerm
from fembridge.errors import ResponseError
from fembridge.response import solve
from fembridge.response.response_map import MAP_FILE
from fembridge.response.solve import FrictionSlipError, HysteresisError, solve_response
from fembridge.run_folder import read_run_folder
from fembridge.solver.verdict import Cause


def test_what_comes_back_without_friction_alone_is_skin_that_slips(
    tmp_path, model, player, monkeypatch
):
    measured = solve.measured_response

    def judge(run, *waveform):
        if run.folder.name == "contact_2":
            raise HysteresisError(f"{run.folder}: unloading differs by 1.5 %", 1.5)
        return measured(run, *waveform)

    monkeypatch.setattr(solve, "measured_response", judge)
    player.plays[1] = Cause.DIVERGED

    with pytest.raises(FrictionSlipError) as slip:
        solve_response(tmp_path, model)

    assert (slip.value.rung, slip.value.closure_percent) == (2, 1.5)
    for words in ("skin slips", "friction 0.4", "by 1.5 %", "the probe's way"):
        assert words in str(slip.value)
    assert player.rungs == [1, 2]
    [folder] = player.smooth
    contact = read_run_folder(folder).inputs["contact"]
    rough = read_run_folder(tmp_path / "contact_2").inputs["contact"]
    assert contact == {**rough, "friction": 0.0}
    assert not (tmp_path / MAP_FILE).exists()


def test_a_rung_without_friction_has_no_frictionless_twin(tmp_path, model, player, remembering):
    remembering.update({1, 2, 3})

    solve_response(tmp_path, model)

    assert [folder.name for folder in player.smooth] == ["frictionless_1", "frictionless_2"]


def test_a_slip_is_still_itself_after_a_worker_raised_it():
    slip = pickle.loads(pickle.dumps(FrictionSlipError("words", 1.5, 2)))

    assert (str(slip), slip.closure_percent, slip.rung) == ("words", 1.5, 2)


def test_no_indentation_is_solved_for_skin_that_relaxes(tmp_path, model, player):
    dermis = dataclasses.replace(model.finger.materials["dermis"], prony=(PronyTerm(0.4, 0.02),))
    materials = {**model.finger.materials, "dermis": dermis}
    finger = dataclasses.replace(model.finger, materials=materials)

    with pytest.raises(ResponseError, match="no response map: dermis relaxes"):
        solve_response(tmp_path, dataclasses.replace(model, finger=finger))

    assert player.rungs == []
