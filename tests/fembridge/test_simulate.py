"""The whole pipeline as a function: where its stress comes from, and who is told."""

import dataclasses
import os
import shutil
from pathlib import Path

import pytest
from numpy.testing import assert_array_equal

from decks.analysis import Contact
from decks.presets import PRESETS, model_of
from decks.probe import Probe
from decks.stimuli import resolve
from decks.waveform import make_stimulus
from fembridge import simulation as module
from fembridge.errors import MissingError, ResponseError, UsageError
from fembridge.machine import SOLVER_INSTALL_LINE
from fembridge.response import solve
from fembridge.response.response_map import FOLDER, read_map
from fembridge.response.solve import Rung, Solved
from fembridge.simulation import simulate
from fembridge.solver import ccx
from fembridge.solver.settings import SolverSettings
from fembridge.solver.verdict import Outcome
from fembridge.store import sha256_of
from neural import PUBLISHED

RECORDED = Path(__file__).parents[2] / "fixtures" / "response_quick"


def stimuli_of(*words, **options):
    return [make_stimulus(entry, **options) for entry in resolve(words)]


@pytest.fixture(scope="module")
def model():
    return model_of(PRESETS["quick"])


@pytest.fixture
def no_ccx(monkeypatch):
    monkeypatch.setattr(module, "find_ccx", lambda: None)


@pytest.fixture
def played(monkeypatch):
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


def test_without_a_solver_the_stored_response_answers_and_it_is_told(tmp_path, model, no_ccx):
    told, stimuli = [], stimuli_of("noise_25_250")

    found = simulate(stimuli, model, tmp_path / "out", log=told.append)

    assert told == [
        "no ccx on the PATH: stored response of finger 'quick'; "
        f"to solve it here: {SOLVER_INSTALL_LINE}"
    ]
    assert found.origin["source"] == "stored response"
    response = read_map(FOLDER / "quick.toml")
    for stimulus, row in zip(stimuli, found.traces, strict=True):
        for trace, expected in zip(row, response.traces(stimulus), strict=True):
            assert_array_equal(trace.stress_pa, expected.stress_pa)
    assert not (tmp_path / "out").exists()


def test_a_stored_response_can_be_asked_for_where_a_solver_is(tmp_path, model, played):
    told = []
    found = simulate(stimuli_of("sine_20_250"), model, tmp_path, stored=True, log=told.append)
    assert told == ["stored response of finger 'quick'"]
    assert found.origin["source"] == "stored response"
    assert played == []


def test_with_a_solver_the_response_is_solved_below_the_folder(tmp_path, model, played):
    told = []

    found = simulate(stimuli_of("sine_20_250"), model, tmp_path, log=told.append)

    [(folder, solved_model, options)] = played
    assert folder == tmp_path / "response"
    assert solved_model is model
    assert options["depth_um"] == 400.0
    assert found.origin["source"] == "CalculiX"
    assert told == [
        "response of finger 'quick' solved in 12 s: 39 increments, contact "
        "node-to-surface, 200 MPa/mm, no friction, unloading within "
        "1e-06 % of loading"
    ]


def test_the_indentation_goes_as_deep_as_the_deepest_stimulus(tmp_path, model, played):
    stimuli = stimuli_of("sine_20_12.5,sine_20_250", preindent_um=210.0)
    with pytest.raises(ResponseError, match="goes 460 um deep, the response map"):
        simulate(stimuli, model, tmp_path)  # the play's map is shallower than asked
    assert played[0][2]["depth_um"] == 500.0


def test_the_record_tells_all_that_the_result_depends_on(tmp_path, model, no_ccx):
    origin = simulate(stimuli_of("sine_20_250"), model, tmp_path).origin
    assert origin["method"] == "map"
    assert origin["response"]["finger"]["name"] == "quick"
    assert origin["parameters"]["SA"]["tau_ms"] == PUBLISHED["SA"].tau_ms
    assert origin["closure_percent"] == 1e-6


def test_other_parameters_are_passed_on(tmp_path, model, no_ccx):
    stronger = dict(PUBLISHED)
    stronger["SA"] = dataclasses.replace(PUBLISHED["SA"], alpha_mv_per_ms=9.0)
    plain, strong = (
        simulate(stimuli_of("sine_20_250"), model, tmp_path, parameters=chosen)
        for chosen in (PUBLISHED, stronger)
    )
    assert strong.mean_rates[0].rate_ips > plain.mean_rates[0].rate_ips
    assert strong.mean_rates[1:] == plain.mean_rates[1:]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"probe": Probe(diameter_mm=2.0)}, "no response is stored for this probe"),
        ({"element": "CPE8R"}, "no response is stored for this element"),
    ],
)
def test_what_is_not_stored_takes_a_solver(tmp_path, model, no_ccx, change, told):
    with pytest.raises(MissingError) as caught:
        simulate(stimuli_of("sine_20_250"), dataclasses.replace(model, **change), tmp_path)
    assert str(caught.value).startswith("no ccx on the PATH, and ")
    assert told in str(caught.value)
    assert str(caught.value).endswith(SOLVER_INSTALL_LINE)


def test_asked_for_what_is_not_stored_no_install_line_is_named(tmp_path, model, played):
    other = dataclasses.replace(model, element="CPE8R")
    with pytest.raises(ResponseError, match="for this element") as caught:
        simulate(stimuli_of("sine_20_250"), other, tmp_path, stored=True)
    assert "install" not in str(caught.value)


def test_too_deep_for_the_stored_response_names_the_stimulus_and_both_depths(
    tmp_path, model, no_ccx
):
    stimuli = stimuli_of("sine_20_12.5,sine_20_250", preindent_um=200.0)
    with pytest.raises(MissingError) as caught:
        simulate(stimuli, model, tmp_path)
    assert str(caught.value) == (
        "no ccx on the PATH, and sine_20_250 goes 450 um deep, the stored response of "
        f"finger 'quick' reaches 400 um; install the solver: {SOLVER_INSTALL_LINE}"
    )


def test_a_transient_takes_a_solver(tmp_path, model, no_ccx):
    with pytest.raises(MissingError) as caught:
        simulate(stimuli_of("sine_20_250"), model, tmp_path, method="transient")
    assert str(caught.value).endswith(f"install it: {SOLVER_INSTALL_LINE}")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "magic"}, "method 'magic', expected auto, map or transient"),
        ({"method": "transient", "stored": True}, "a stored response answers no"),
    ],
)
def test_options_that_mean_nothing_are_misuse(tmp_path, model, options, message):
    with pytest.raises(UsageError, match=message):
        simulate(stimuli_of("sine_20_250"), model, tmp_path, **options)


def test_no_stimulus_is_misuse(tmp_path, model):
    with pytest.raises(UsageError, match="no stimulus to simulate"):
        simulate([], model, tmp_path)


@pytest.mark.parametrize("name", ["jobs", "threads"])
@pytest.mark.parametrize("number", [0, -1])
def test_settings_below_one_are_misuse(name, number):
    with pytest.raises(UsageError, match=f"{name} is {number}, expected 1 or more"):
        SolverSettings(**{name: number})


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


def test_results_that_are_there_answer_without_another_solve(tmp_path, model, monkeypatch):
    """The real ladder, over the recorded run, whose record has the second read it again."""
    lines = []

    def play(run, settings, halt=None):
        for name in ("job.frd", "job.dat"):
            shutil.copy(RECORDED / name, run.folder)
        outcome = Outcome(run.folder, exit_code=0, wall_s=9.6, increments=39)
        ccx._write_record(run, outcome, sha256_of(run.deck))
        return outcome

    monkeypatch.setattr(module, "find_ccx", lambda: Path("/usr/bin/ccx"))
    monkeypatch.setattr(ccx, "run_ccx", play)
    simulate(stimuli_of("sine_20_250"), model, tmp_path, log=lines.append)
    monkeypatch.setattr(ccx, "run_ccx", None)
    simulate(stimuli_of("sine_20_250"), model, tmp_path, log=lines.append)

    assert "solved in 10 s: 39 increments" in lines[0]
    assert "read again: 39 increments" in lines[1]
