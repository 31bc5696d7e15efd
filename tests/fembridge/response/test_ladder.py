"""The ladder of contact models, skin that slips, and models that have no map."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from decks.finger import PronyTerm
from decks.presets import PRESETS, model_of
from decks.stimuli import resolve
from decks.synthesis import make_stimulus
from fembridge.errors import ResponseError, SolverError
from fembridge.io.run_folder import read_run_folder
from fembridge.response import indentation
from fembridge.response.indentation import (
    DEFAULT_DEPTH_UM,
    LADDER,
    FrictionSlipError,
    HysteresisError,
    list_attempts,
    map_obstacle,
    solve_response,
)
from fembridge.response.response_map import FOLDER, MAP_FILE, read_map
from fembridge.solver import ccx
from fembridge.solver.verdict import Cause, Failure, Outcome

RECORDED = Path(__file__).parents[3] / "fixtures" / "response_quick"


@pytest.fixture(scope="module")
def model():
    return model_of(PRESETS["quick"])


class Player:
    """Stands for `run_ccx`: one play a contact model, by its number; `smooth` are its twins."""

    def __init__(self):
        self.plays = {}
        self.cached = set()
        self.numbers = []
        self.smooth = []

    def __call__(self, run, settings=None, halt=None, on_start=None):
        folder = run.folder
        if on_start is not None and folder.name not in self.cached:
            on_start()
        if folder.name.startswith("frictionless_"):
            self.smooth.append(folder)
            return self.solve(folder)
        number = int(folder.name.removeprefix("contact_"))
        self.numbers.append(number)
        play = self.plays.get(number, "solve")
        if isinstance(play, Cause):
            return Outcome(folder, Failure(play, "increment 3"))
        return self.solve(folder)

    def solve(self, folder):
        run = read_run_folder(folder)
        for name in ("job.frd", "job.dat"):
            shutil.copy(RECORDED / name, folder)
        outcome = Outcome(folder, version="2.20", exit_code=0, wall_s=12.3, increments=39)
        ccx.write_record(folder, run.solver, outcome)
        return outcome


@pytest.fixture
def player(monkeypatch):
    player = Player()
    monkeypatch.setattr(ccx, "run_ccx", player)
    return player


@pytest.fixture
def path_dependent(monkeypatch):
    """Have what was solved in folders of these names refused; frictionless twins are.

    To have a twin accepted, take its name out.
    """
    names = {f"frictionless_{number}" for number in range(1, 10)}
    measured = indentation.measured_response

    def judge(run, stimulus):
        if run.folder.name in names:
            raise HysteresisError("unloading differs from loading by 17 %", closure_percent=17.0)
        return measured(run, stimulus)

    monkeypatch.setattr(indentation, "measured_response", judge)
    return names


ATTEMPTS = list_attempts(DEFAULT_DEPTH_UM, LADDER)


def test_the_first_contact_that_is_accepted_is_taken(tmp_path, model, player, logged):
    shown = logged
    solved, response = solve_response(tmp_path, model)
    assert player.numbers == [1]
    assert solved.contact == LADDER[0]
    assert "400 um" in shown[0]
    for value in ("12 s", "39 increments", str(LADDER[0])):
        assert value in shown[1]
    shipped = read_map(FOLDER / "quick.toml")
    np.testing.assert_array_equal(response.tensor_pa, shipped.tensor_pa)


@pytest.mark.parametrize("cause", [Cause.DIVERGED, Cause.NEGATIVE_JACOBIAN])
def test_a_contact_that_does_not_converge_is_left_and_told(tmp_path, model, player, cause, logged):
    player.plays[1] = cause
    shown = logged
    solved, response = solve_response(tmp_path, model)
    assert player.numbers == [1, 2]
    assert f"{LADDER[0]}: {cause.value}: increment 3" in shown[1]
    assert f"2 of {len(ATTEMPTS)}: {ATTEMPTS[1]}" in shown[2]
    assert solved.contact == LADDER[0]
    assert response.origin["drive"] == "spring"


def test_the_forecast_precedes_the_first_run_that_starts(tmp_path, model, player, logged):
    """The cache has the failure of the first contact model: only the second is solved."""
    player.plays[1], player.cached = Cause.DIVERGED, {"contact_1"}
    solve_response(tmp_path, model)
    forecasts = [row for row, line in enumerate(logged) if "about" in line]
    assert forecasts == [2]
    assert f"2 of {len(ATTEMPTS)}" in logged[1]


@pytest.mark.parametrize("cause", [Cause.NO_SOLVER, Cause.DISK_FULL, Cause.INTERRUPTED])
def test_what_another_contact_does_not_cure_ends_the_ladder(tmp_path, model, player, cause):
    """No solver, a full disk, an interrupt: five times the same would not help."""
    player.plays[1] = cause
    with pytest.raises(SolverError) as caught:
        solve_response(tmp_path, model)
    assert player.numbers == [1]
    assert caught.value.path == tmp_path / "contact_1"
    assert cause.value in str(caught.value)
    assert not (tmp_path / MAP_FILE).exists()


@pytest.mark.slow
def test_when_all_contacts_fail_each_is_listed_with_its_reason(
    tmp_path, model, player, path_dependent, logged
):
    player.plays = {1: Cause.DIVERGED, 3: Cause.STALLED}
    path_dependent.update(f"contact_{n}" for n in (2, *range(4, len(ATTEMPTS) + 1)))
    shown = logged

    with pytest.raises(ResponseError) as caught:
        solve_response(tmp_path, model)

    assert player.numbers == list(range(1, len(ATTEMPTS) + 1))
    reasons = (tmp_path / indentation.ATTEMPTS_FILE).read_text().splitlines()
    assert all(any(reason in line for line in shown) for reason in reasons)
    assert [reason.split(": ")[0] for reason in reasons] == [str(each) for each in ATTEMPTS]
    assert f"{Cause.DIVERGED.value}: increment 3" in reasons[0]
    assert reasons[1].endswith("17 %")
    assert f"{Cause.STALLED.value}: increment 3" in reasons[2]
    assert indentation.ATTEMPTS_FILE in str(caught.value)
    assert len(str(caught.value)) - len(str(tmp_path)) < 250
    assert not (tmp_path / MAP_FILE).exists()


def test_a_finished_contact_that_does_not_come_back_is_not_solved_again(
    tmp_path, model, player, path_dependent
):
    path_dependent.add("contact_1")
    solve_response(tmp_path, model)
    again, _ = solve_response(tmp_path, model)
    assert player.numbers == [1, 2]
    assert again.contact == LADDER[0]


def test_a_finished_run_that_lost_a_file_is_solved_again(tmp_path, model, player):
    solve_response(tmp_path, model)
    (tmp_path / "contact_1" / "job.dat").unlink()
    solve_response(tmp_path, model)
    assert player.numbers == [1, 1]


def test_what_comes_back_without_friction_alone_is_skin_that_slips(
    tmp_path, model, player, path_dependent
):
    path_dependent ^= {"contact_2", "frictionless_2"}
    player.plays[1] = Cause.DIVERGED

    with pytest.raises(FrictionSlipError) as slip:
        solve_response(tmp_path, model)

    assert (slip.value.contact, slip.value.closure_percent) == (LADDER[0], 17.0)
    for value in (str(LADDER[0]), "17 %"):
        assert value in str(slip.value)
    assert player.numbers == [1, 2]
    [folder] = player.smooth
    contact = read_run_folder(folder).inputs["contact"]
    rough = read_run_folder(tmp_path / "contact_2").inputs["contact"]
    assert contact == {**rough, "friction": 0.0}
    assert not (tmp_path / MAP_FILE).exists()


@pytest.fixture(scope="module")
def sine():
    return make_stimulus(resolve(["sine_20_250"])[0])


def relaxing(model, *layers):
    materials = dict(model.finger.materials)
    for layer in layers:
        materials[layer] = replace(materials[layer], prony=(PronyTerm(0.4, 0.02),))
    return replace(model, finger=replace(model.finger, materials=materials))


def test_skin_that_relaxes_inertia_and_a_slide_have_no_map_and_the_papers_model_has(model, sine):
    assert map_obstacle(model.finger, [sine], inertia=False) is None
    for made, waves, reason in (
        (relaxing(model, "dermis"), [sine], "dermis"),
        (relaxing(model, "epidermis", "dermis"), [sine], "epidermis, dermis"),
        (replace(model, inertia=True), [sine], "inertia"),
        (model, [sine, sine.sliding(5.0)], "sine_20_250_slide_5"),
    ):
        assert map_obstacle(made.finger, waves, inertia=made.inertia).startswith(reason)
