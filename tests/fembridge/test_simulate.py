"""The whole pipeline as a function: where its stress comes from, and who gets a line about it."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from decks.analysis import Contact
from decks.dialects import JOB
from decks.finger import PronyTerm
from decks.presets import PRESETS, model_of
from decks.stimuli import resolve
from decks.waveform import make_stimulus
from fembridge import simulation as module
from fembridge.errors import ResponseError, SolverError, UsageError
from fembridge.response.indentation import LADDER, FrictionSlipError
from fembridge.response.response_map import FOLDER, read_map
from fembridge.run_folder import read_run_folder
from fembridge.simulation import check_cost, simulate
from fembridge.solver.settings import SolverSettings
from fembridge.solver.verdict import Cause, Failure, Outcome
from fembridge.trace import StressTrace


def stimuli_of(word, **options):
    return [make_stimulus(entry, **options) for entry in resolve([word])]


ONE, TWO = stimuli_of("sine_20_250"), stimuli_of("sine_20_12.5,sine_20_250")


@pytest.fixture(scope="module")
def model():
    return model_of(PRESETS["quick"])


@pytest.fixture
def lines():
    """What is logged: pass its `append`."""
    return []


@pytest.fixture
def indented(monkeypatch):
    """A solver is there, and an indentation gives what the function makes of model and ladder."""
    calls = []

    def give(of):
        def solved(folder, model, needed_um, settings, *, ladder=LADDER, **options):
            calls.append((folder, model, needed_um))
            return of(model, ladder[0]), read_map(FOLDER / "quick.toml")

        monkeypatch.setattr(module, "find_ccx", lambda: Path("/usr/bin/ccx"))
        monkeypatch.setattr(module, "solve_response", solved)
        return calls

    return give


@pytest.fixture
def ccx(indented):
    """Its response is solved with the second contact tried."""
    return indented(lambda model, first: replace(model, contact=Contact(friction=0.0)))


@pytest.fixture
def accepting(indented):
    """Its indentation is accepted with whatever contact comes first."""
    return indented(lambda model, first: replace(model, contact=first))


@pytest.fixture
def slipping(indented):
    """Its indentation shows that skin slips under friction."""

    def slip(model, first):
        raise FrictionSlipError("skin slips under the probe", 1.5, first)

    return indented(slip)


@pytest.fixture
def transients(monkeypatch):
    """Solver and reader of whole transients: which runs it was called with.

    The last run of a call fails with the next of `failures`, if there is one.
    """

    class Calls(list):
        failures = ()

    calls = Calls()

    def run_folders(runs, settings):
        calls.append(([run.folder for run in runs], settings))
        outcomes = [Outcome(run.folder, wall_s=20.0, increments=500) for run in runs]
        if len(calls) <= len(calls.failures):
            failure = Failure(calls.failures[len(calls) - 1], "increment 30")
            outcomes[-1] = Outcome(outcomes[-1].folder, failure)
        return outcomes

    def read(run):
        wave = np.linspace(0, 1e4, run.increments + 1)
        return [StressTrace(wave, 0.5, p.node, p.afferent) for p in run.afferents]

    monkeypatch.setattr(module, "run_folders", run_folders)
    monkeypatch.setattr(module, "read", read)
    return calls


def contact_of(place):
    return read_run_folder(place).inputs["contact"]


def soft(model):
    dermis = replace(model.finger.materials["dermis"], prony=(PronyTerm(0.4, 0.02),))
    materials = {**model.finger.materials, "dermis": dermis}
    return replace(model, finger=replace(model.finger, materials=materials))


def test_a_stored_response_can_be_asked_for_where_a_solver_is(tmp_path, model, ccx, lines):
    found = simulate(ONE, model, tmp_path, stored=True, log=lines.append)
    assert lines == ["stored response of finger 'quick'"]
    assert found.origin["source"] == "stored response"
    assert ccx == []


def test_with_a_solver_the_response_is_solved_below_the_folder(tmp_path, model, ccx):
    stimuli = stimuli_of("sine_20_12.5,sine_20_250", preindent_um=100.0)
    found = simulate(stimuli, model, tmp_path)

    assert ccx == [(tmp_path / "response", model, 350.0)]
    assert found.origin["source"] == "CalculiX"


def test_asked_for_what_is_not_stored_no_install_line_is_named(tmp_path, model, ccx):
    with pytest.raises(ResponseError, match="for this element") as caught:
        simulate(ONE, replace(model, element="CPE8R"), tmp_path, stored=True)
    assert "install" not in str(caught.value)


@pytest.mark.parametrize(
    ("stimuli", "change", "options", "found"),
    [
        ([], None, {}, "no stimulus"),
        (ONE, None, {"method": "magic"}, "'magic'"),
        (ONE, None, {"method": "transient", "stored": True}, "stored response"),
        (ONE, soft, {"stored": True}, "dermis relaxes"),
        (ONE, soft, {"method": "map"}, "dermis relaxes"),
    ],
)
def test_options_that_mean_nothing_are_misuse(
    tmp_path, model, ccx, stimuli, change, options, found
):
    with pytest.raises(UsageError, match=found):
        simulate(stimuli, change(model) if change else model, tmp_path, **options)
    assert ccx == []


def test_a_transient_uses_the_contact_that_the_indentation_accepted(
    tmp_path, model, ccx, transients, lines
):
    settings = SolverSettings(threads=2, jobs=2)

    found = simulate(TWO, model, tmp_path, method="transient", settings=settings, log=lines.append)

    [(places, used)] = transients
    assert places == [tmp_path / "runs" / stimulus.id for stimulus in TWO]
    for place in places:
        assert contact_of(place)["friction"] == 0.0
        assert (place / f"{JOB}.inp").is_file()
    assert (used.jobs, used.threads) == (2, 2)
    assert lines[-1].startswith("2 transients solved in 40 s, contact node-to-surface")
    assert found.origin["method"] == "transient"
    assert found.traces[0][0].stress_pa[-1] == 1e4


def test_ctrl_c_keeps_the_transients_that_are_solved_and_says_how_many(
    tmp_path, model, accepting, transients, lines, monkeypatch
):
    """The same command reads them: `fembridge.solver.ccx.run_folders` solves no run twice."""

    def stop(runs, settings):
        raise KeyboardInterrupt

    finished = [Outcome(tmp_path), None]
    monkeypatch.setattr(module, "run_folders", stop)
    monkeypatch.setattr(module, "finished_outcome", lambda run: finished.pop())
    with pytest.raises(KeyboardInterrupt):
        simulate(TWO, model, tmp_path, method="transient", log=lines.append)
    assert lines[-1].startswith("1 of 2 transients are kept")


def test_a_full_disk_ends_the_simulation_at_once(tmp_path, model, ccx, transients):
    transients.failures = [Cause.DISK_FULL] * 9
    with pytest.raises(SolverError, match="sine_20_250"):
        simulate(TWO, model, tmp_path, method="transient")
    assert len(transients) == 1


def test_a_transient_that_diverges_gets_the_next_contact_and_the_others_stay(
    tmp_path, model, accepting, transients, lines
):
    transients.failures = [Cause.DIVERGED]

    found = simulate(TWO, model, tmp_path, method="transient", log=lines.append)

    both = [tmp_path / "runs" / stimulus.id for stimulus in TWO]
    assert [places for places, _ in transients] == [both, both[1:]]
    used = [contact_of(place) for place in both]
    assert [contact["stiffness_mpa_per_mm"] for contact in used] == [200.0, 200.0]
    assert [contact["stick_share"] for contact in used] == [0.1, 0.01]
    assert list(found.origin["contacts"].values()) == used
    assert any("left node-to-surface, 200 MPa/mm" in line for line in lines)


def test_a_transient_that_diverges_with_every_contact_is_an_error(
    tmp_path, model, accepting, transients
):
    transients.failures = [Cause.DIVERGED] * 99
    with pytest.raises(SolverError, match="sine_20_250"):
        simulate(ONE, model, tmp_path, method="transient")
    assert len(transients) == len(LADDER)


@pytest.mark.parametrize(
    ("change", "waves", "reason"),
    [
        (soft, TWO, "dermis relaxes"),
        (lambda model: model, [each.sliding(2.0) for each in TWO], "slides across the skin"),
    ],
)
def test_where_there_is_no_map_each_waveform_is_solved_and_the_reason_logged(
    tmp_path, model, ccx, transients, lines, change, waves, reason
):
    found = simulate(waves, change(model), tmp_path, log=lines.append)

    [(places, _)] = transients
    assert len(places) == 2
    assert reason in lines[0]
    assert found.origin["method"] == "transient"
    assert reason in found.origin["no_map"]
    assert len(ccx) == 1  # for the contact


def test_skin_that_slips_under_friction_gets_transients_with_that_contact(
    tmp_path, model, slipping, transients, lines
):
    found = simulate(ONE, model, tmp_path, log=lines.append)

    [([place], _)] = transients
    assert contact_of(place)["friction"] == LADDER[0].friction
    assert lines[0].startswith("skin slips under the probe")
    assert (found.origin["method"], found.origin["closure_percent"]) == ("transient", 1.5)
    assert "response" not in found.origin


def test_skin_that_slips_is_an_error_of_a_map_that_was_asked_for(tmp_path, model, slipping):
    with pytest.raises(UsageError, match="skin slips under the probe"):
        simulate(ONE, model, tmp_path, method="map")


def test_after_a_slip_contacts_with_friction_follow_and_no_others(
    tmp_path, model, slipping, transients
):
    transients.failures = [Cause.DIVERGED]
    simulate(ONE, model, tmp_path / "once")
    assert contact_of(tmp_path / "once/runs/sine_20_250")["stick_share"] == LADDER[1].stick_share

    transients.clear()
    transients.failures = [Cause.DIVERGED] * 99
    with pytest.raises(SolverError):
        simulate(ONE, model, tmp_path / "always")
    rough = [contact for contact in LADDER if contact.friction == LADDER[0].friction]
    assert len(transients) == len(rough) < len(LADDER)


@pytest.mark.parametrize(
    ("threads", "asked", "runs", "expected"),
    [
        (None, None, 1, 8),
        (None, None, 3, 2),
        (None, None, 20, 1),
        (None, "5", 1, None),
        (3, "5", 2, 3),
        (3, None, 1, 3),
    ],
)
def test_cores_are_shared_unless_someone_said_otherwise(
    monkeypatch, threads, asked, runs, expected
):
    """OMP_NUM_THREADS is the user's word about the machine: None leaves it alone."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: set(range(8)), raising=False)
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    if asked is not None:
        monkeypatch.setenv("OMP_NUM_THREADS", asked)
    assert SolverSettings(threads=threads).shared_by(runs).threads == expected


def test_long_transients_take_a_word_before_anything_is_solved(tmp_path, model, ccx, lines):
    all_of_them = stimuli_of("all")
    with pytest.raises(UsageError, match=r"82 transients of .* --yes") as caught:
        simulate(all_of_them, model, tmp_path, method="transient", yes=False)
    assert len(str(caught.value)) < 300
    assert ccx == []
    limited = SolverSettings(time_limit_s=5.0)
    check_cost(all_of_them, model, limited, lines.append, yes=False)
    assert lines[0].startswith("82 transients of ")
