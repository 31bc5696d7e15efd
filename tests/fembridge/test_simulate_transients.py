"""Whole transients in the pipeline: which contact they get, and what ends them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from decks.analysis import Contact
from decks.dialects import JOB
from decks.material import PronyTerm
from decks.presets import PRESETS, model_of
from decks.stimuli import resolve
from decks.waveform import make_stimulus
from fembridge import simulation as module
from fembridge.errors import SolverError, UsageError
from fembridge.response import solve
from fembridge.response import transients as transients_module
from fembridge.response.response_map import FOLDER, read_map
from fembridge.response.solve import LADDER, FrictionSlipError, Rung, Solved
from fembridge.run_folder import read_run_folder
from fembridge.simulation import simulate
from fembridge.solver.settings import SolverSettings
from fembridge.solver.verdict import Cause, Failure, Outcome
from fembridge.trace import StressTrace


def stimuli_of(*words, **options):
    return [make_stimulus(entry, **options) for entry in resolve(words)]


@pytest.fixture(scope="module")
def model():
    return model_of(PRESETS["quick"])


@pytest.fixture
def ccx(monkeypatch):
    """A solver is there, and solves the response with the second contact tried."""
    calls = []

    def solved(folder, model, settings, **options):
        calls.append((folder, model, options))
        frictionless = Contact(friction=0.0)
        rungs = (Rung(Contact(), "diverged"), Rung(frictionless, None))
        outcome = Outcome(folder, wall_s=12.3, increments=39)
        return Solved(read_map(FOLDER / "quick.toml"), rungs, outcome)

    monkeypatch.setattr(module, "find_ccx", lambda: Path("/usr/bin/ccx"))
    monkeypatch.setattr(solve, "solve_response", solved)
    return calls


@pytest.fixture
def transients(monkeypatch, ccx):
    """Solver and reader of whole transients, played; calls are kept."""
    calls = []

    def run_folders(runs, settings):
        places = [run.folder for run in runs]
        calls.append((places, settings))
        return [Outcome(place, wall_s=20.0, increments=500) for place in places]

    def read(run):
        wave = np.linspace(0, 1e4, run.increments + 1)
        return [StressTrace(wave, 0.5, p.node, p.afferent) for p in run.afferents]

    monkeypatch.setattr(transients_module, "run_folders", run_folders)
    monkeypatch.setattr(transients_module, "read", read)
    return calls


def test_a_transient_uses_the_contact_that_the_indentation_accepted(tmp_path, model, transients):
    told = []

    found = simulate(
        stimuli_of("sine_20_12.5,sine_20_250"),
        model,
        tmp_path,
        method="transient",
        settings=SolverSettings(threads=2, jobs=2),
        log=told.append,
    )

    [(places, settings)] = transients
    assert [place.name for place in places] == ["sine_20_12.5", "sine_20_250"]
    assert {place.parent for place in places} == {tmp_path / "runs"}
    for place in places:
        assert read_run_folder(place).inputs["contact"]["friction"] == 0.0
        assert (place / f"{JOB}.inp").is_file()
    assert (settings.jobs, settings.threads) == (2, 2)
    assert told[-1].startswith("2 transients solved in 40 s, contact node-to-surface")
    assert told[-1].endswith("no friction")
    assert found.origin["method"] == "transient"
    assert found.traces[0][0].stress_pa[-1] == 1e4


def test_a_full_disk_ends_the_simulation_at_once(tmp_path, model, ccx, monkeypatch):
    calls = []

    def failing(runs, settings):
        calls.append([run.folder for run in runs])
        failure = Failure(Cause.DISK_FULL, "increment 30")
        return [Outcome(calls[0][0]), Outcome(calls[0][1], failure)]

    monkeypatch.setattr(transients_module, "run_folders", failing)
    with pytest.raises(SolverError, match="sine_20_250: the results could not"):
        simulate(stimuli_of("sine_20_12.5,sine_20_250"), model, tmp_path, method="transient")
    assert len(calls) == 1


@pytest.fixture
def accepting(monkeypatch, transients):
    """A solver whose indentation is accepted with whatever contact comes first."""

    def solved(folder, model, settings, *, ladder, **options):
        outcome = Outcome(folder, wall_s=12.3, increments=39)
        rungs = (Rung(ladder[0], None),)
        return Solved(read_map(FOLDER / "quick.toml"), rungs, outcome)

    monkeypatch.setattr(solve, "solve_response", solved)


def diverging(times, seen):
    """Play a solver on which the last run diverges the first `times` times."""

    def run_folders(runs, settings):
        seen.append([run.folder.name for run in runs])
        outcomes = [Outcome(run.folder, wall_s=20.0) for run in runs]
        if len(seen) <= times:
            failure = Failure(Cause.DIVERGED, "increment 30")
            outcomes[-1] = Outcome(outcomes[-1].folder, failure)
        return outcomes

    return run_folders


def test_a_transient_that_diverges_gets_the_next_contact_and_the_others_stay(
    tmp_path, model, accepting, monkeypatch
):
    seen, told = [], []
    monkeypatch.setattr(transients_module, "run_folders", diverging(1, seen))

    found = simulate(
        stimuli_of("sine_20_12.5,sine_20_250"),
        model,
        tmp_path,
        method="transient",
        log=told.append,
    )

    assert seen == [["sine_20_12.5", "sine_20_250"], ["sine_20_250"]]
    used = [
        read_run_folder(tmp_path / "runs" / name).inputs["contact"]
        for name in ("sine_20_12.5", "sine_20_250")
    ]
    assert [contact["stiffness_mpa_per_mm"] for contact in used] == [200.0, 200.0]
    assert [contact["stick_share"] for contact in used] == [0.1, 0.01]
    assert list(found.origin["contacts"].values()) == used
    assert any("left node-to-surface, 200 MPa/mm" in line for line in told)
    assert [stimulus.id for stimulus in found.stimuli] == seen[0]


def test_a_transient_that_diverges_with_every_contact_is_an_error(
    tmp_path, model, accepting, monkeypatch
):
    seen = []
    monkeypatch.setattr(transients_module, "run_folders", diverging(99, seen))

    with pytest.raises(SolverError, match="sine_20_250: an increment did not converge"):
        simulate(stimuli_of("sine_20_250"), model, tmp_path, method="transient")
    assert len(seen) == len(LADDER)


def soft(model):
    dermis = replace(model.finger.materials["dermis"], prony=(PronyTerm(0.4, 0.02),))
    materials = {**model.finger.materials, "dermis": dermis}
    return replace(model, finger=replace(model.finger, materials=materials))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda model, waves: (soft(model), waves), "dermis relaxes"),
        (
            lambda model, waves: (model, [each.sliding(2.0) for each in waves]),
            "slides across the skin",
        ),
    ],
)
def test_where_there_is_no_map_each_waveform_is_solved_and_the_reason_told(
    tmp_path, model, ccx, transients, change, reason
):
    told = []
    model, waves = change(model, stimuli_of("sine_20_12.5,sine_20_250"))

    found = simulate(waves, model, tmp_path, log=told.append)

    [(places, _)] = transients
    assert len(places) == 2
    assert reason in told[0]
    assert told[0].endswith("so there is no response map: each waveform is solved")
    assert found.origin["method"] == "transient"
    assert reason in found.origin["no_map"]
    [(_, indented, _)] = ccx
    assert not indented.depends_on_time


def test_a_map_that_was_asked_for_and_cannot_be_is_refused(tmp_path, model, ccx):
    with pytest.raises(UsageError, match=r"no response map: dermis relaxes.*transient"):
        simulate(stimuli_of("sine_20_250"), soft(model), tmp_path, method="map")
    assert ccx == []


def slipping(folder, model, settings, *, ladder, **options):
    raise FrictionSlipError("skin slips under the probe", 1.5, 1)


def test_skin_that_slips_under_friction_gets_transients_with_that_contact(
    tmp_path, model, transients, monkeypatch
):
    told = []
    monkeypatch.setattr(solve, "solve_response", slipping)

    found = simulate(stimuli_of("sine_20_250"), model, tmp_path, log=told.append)

    [([place], _)] = transients
    contact = read_run_folder(place).inputs["contact"]
    assert contact["friction"] == LADDER[0].friction
    assert told[0].startswith("skin slips under the probe; so there is no response map")
    assert (found.origin["method"], found.origin["closure_percent"]) == ("transient", 1.5)
    assert "response" not in found.origin


def test_skin_that_slips_is_an_error_of_a_map_that_was_asked_for(tmp_path, model, ccx, monkeypatch):
    monkeypatch.setattr(solve, "solve_response", slipping)
    with pytest.raises(UsageError, match="no response map: skin slips under the probe"):
        simulate(stimuli_of("sine_20_250"), model, tmp_path, method="map")


def test_after_a_slip_the_next_contact_is_taken_though_it_slips_as_well(
    tmp_path, model, transients, monkeypatch
):
    monkeypatch.setattr(solve, "solve_response", slipping)
    seen = []
    monkeypatch.setattr(transients_module, "run_folders", diverging(1, seen))

    simulate(stimuli_of("sine_20_250"), model, tmp_path)

    place = tmp_path / "runs" / "sine_20_250"
    contact = read_run_folder(place).inputs["contact"]
    assert contact["stick_share"] == LADDER[1].stick_share


def test_where_skin_slips_no_contact_without_friction_is_tried(
    tmp_path, model, transients, monkeypatch
):
    monkeypatch.setattr(solve, "solve_response", slipping)
    seen = []
    monkeypatch.setattr(transients_module, "run_folders", diverging(99, seen))

    with pytest.raises(SolverError):
        simulate(stimuli_of("sine_20_250"), model, tmp_path)

    rough = [contact for contact in LADDER if contact.friction == LADDER[0].friction]
    assert len(seen) == len(rough) < len(LADDER)


def test_a_stored_response_is_no_answer_where_there_is_no_map(tmp_path, model, ccx):
    with pytest.raises(UsageError, match="answers no transient: dermis relaxes"):
        simulate(stimuli_of("sine_20_250"), soft(model), tmp_path, stored=True)
    assert ccx == []
