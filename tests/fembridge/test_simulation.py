"""The whole pipeline as a function: where stress comes from, what it gives, its files."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import fembridge as fb
from decks.contact_analysis import Contact
from decks.dialects import JOB
from decks.finger import PronyTerm
from decks.presets import PRESETS, model_of
from decks.stimuli import resolve
from decks.synthesis import make_stimulus
from fembridge.errors import (
    FembridgeWarning,
    ParameterError,
    ResponseError,
    ResultError,
    SolverError,
    TraceError,
    UsageError,
)
from fembridge.io.run_folder import read_run_folder
from fembridge.io.spike_table import read_spikes
from fembridge.response.indentation import LADDER, FrictionSlipError
from fembridge.response.response_map import FOLDER, read_map
from fembridge.simulation import transients as module
from fembridge.simulation.folder import stimuli_in
from fembridge.simulation.simulate import simulate
from fembridge.simulation.simulation import Simulation, encode_all
from fembridge.simulation.transients import check_cost
from fembridge.solver.analysis import Analysis
from fembridge.solver.settings import DEFAULTS, Solver
from fembridge.solver.verdict import Cause, Failure, Outcome
from fembridge.trace import StressTrace
from neural import PUBLISHED, encode, parameter_set

GAIN_PA_PER_UM = {"SA": 120.0, "RA": 75.0, "PC": 4.0}
STIMULI = tuple(make_stimulus(entry) for entry in resolve(["sine_20_250,noise_25_250_20"]))


def trace_of(stimulus, afferent, **more):
    stress_pa = GAIN_PA_PER_UM.get(afferent, 1.0) * np.maximum(stimulus.displacement_um, 0.0)
    return StressTrace(stress_pa, 0.5, 7, afferent, **more)


def traces_of(stimuli=STIMULI, afferents=("SA", "RA", "PC")):
    return [[trace_of(stimulus, name) for name in afferents] for stimulus in stimuli]


@pytest.fixture(scope="module")
def simulation():
    return encode_all(STIMULI, traces_of(), PUBLISHED, {"method": "map"})


def test_spikes_are_those_of_each_trace_alone(simulation):
    """All stimuli are encoded in one batch; here one by one."""
    expected = [
        (stimulus.id, trace.afferent, encode(trace.stress_pa, 0.5, PUBLISHED[name])[0])
        for stimulus, row in zip(STIMULI, traces_of(), strict=True)
        for trace, name in zip(row, PUBLISHED, strict=True)
    ]

    assert len(simulation.trains) == 6
    for train, (stimulus_id, afferent, times_ms) in zip(simulation.trains, expected, strict=True):
        assert (train.stimulus, train.afferent) == (stimulus_id, afferent)
        assert_array_equal(train.times_ms, times_ms)
    assert sum(train.times_ms.size for train in simulation.trains) > 50


def test_windows_may_differ_from_stimulus_to_stimulus():
    stimuli = [make_stimulus(e) for e in resolve(["sine_20_250,sine_100_85.98"])]
    assert [s.window_ms for s in stimuli] == [(5.0, 250.0), (100.0, 200.0)]
    found = encode_all(stimuli, traces_of(stimuli), PUBLISHED, {})
    last, train = found.mean_rates[-1], found.trains[-1]
    inside = (train.times_ms > 100.0) & (train.times_ms <= 200.0)
    assert last.rate_ips == pytest.approx(inside.sum() / 0.1, rel=1e-12)
    assert inside.any()


@pytest.mark.parametrize("mine", [False, True])
def test_the_finger_of_an_earlier_simulation_goes_and_one_of_ones_own_stays(
    tmp_path, simulation, mine
):
    if mine:
        (tmp_path / "finger.toml").write_text("base = 'quick'\n", encoding="utf-8")
    else:
        finger = {"response": {"finger": {"name": "quick"}}}
        replace(simulation, origin=finger).write(tmp_path)
        assert (tmp_path / "finger.toml").exists()
    simulation.write(tmp_path)  # no response, no finger
    assert (tmp_path / "finger.toml").exists() == mine


def other_clock(**changes):
    rows = traces_of()
    rows[1][2] = replace(rows[1][2], **changes)
    return rows


@pytest.mark.parametrize(
    ("traces", "kind", "found"),
    [
        (traces_of(afferents=("SA", "XY")), TraceError, "of XY, expected 501 of SA, RA, PC"),
        (other_clock(stress_pa=np.zeros(500)), TraceError, "500 samples of PC, expected 501"),
        (other_clock(dt_ms=1.0), ParameterError, "dt_ms is 1 ms.*PC"),
    ],
)
def test_traces_that_do_not_fit_stimuli_or_parameters_are_refused(traces, kind, found):
    with pytest.raises(kind, match=found):
        encode_all(STIMULI, traces, PUBLISHED, {})


@pytest.fixture(scope="module")
def indented():
    """Two stimuli of a probe that was 75 um deep, one too weak for any spike."""
    chosen = parameter_set("fitted").parameters
    stimuli = [make_stimulus(one, 75.0) for one in resolve("sine_20_250,sine_20_6.71")]
    cells = {name: {"cells": one.cells} for name, one in chosen.items()}
    return encode_all(stimuli, traces_of(stimuli), chosen, {"parameters": cells})


@pytest.fixture
def out(tmp_path, indented):
    indented.write(tmp_path / "out")
    return tmp_path / "out"


def test_a_simulation_comes_back_with_the_probe_as_it_was(out, indented):
    written = stimuli_in(out)

    assert [one.id for one in written.stimuli] == ["sine_20_250", "sine_20_6.71"]
    for read, made in zip(written.stimuli, indented.stimuli, strict=True):
        assert_array_equal(read.displacement_um, made.displacement_um)
        assert (read.preindent_um, read.window_ms) == (75.0, made.window_ms)
        assert read.displacement_um[0] == 75.0
    traces = [trace for row in indented.traces for trace in row]
    for one, other in zip(written.traces, traces, strict=True):
        assert one.afferent == other.afferent
        assert_array_equal(one.stress_pa, other.stress_pa)
    assert [trace.stimulus for trace in written.traces[::3]] == ["sine_20_250", "sine_20_6.71"]
    assert written.cells == {"SA": 10, "RA": 10, "PC": 10}


def test_a_simulation_that_is_read_equals_the_one_that_was_written(tmp_path, indented):
    """With nodes, silent cells, provenance; written again, it gives the same bytes."""
    stored = simulate(["sine_20_250", "ramp_300_20_50_20"], stored=True)
    for name, made in {"indented": indented, "stored": stored}.items():
        made.write(tmp_path / name)
        back = Simulation.read(tmp_path / name)
        assert back.rates.equals(made.rates)
        assert back.spikes.equals(made.spikes)
        assert [len(train.times_ms) for train in back.trains] == [
            len(train.times_ms) for train in made.trains
        ]
        assert [t.node for t in back.traces[0]] == [t.node for t in made.traces[0]]
        for row, expected in zip(back.traces, made.traces, strict=True):
            for trace, other in zip(row, expected, strict=True):
                assert_array_equal(trace.stress_pa, other.stress_pa)
        assert back.provenance.keys() == made.provenance.keys()
        back.write(tmp_path / "again")
        for path in (tmp_path / name).iterdir():
            if path.suffix != ".npz":  # a ZIP has the time
                assert (tmp_path / "again" / path.name).read_bytes() == path.read_bytes()


def test_a_folder_without_a_simulation_is_refused(tmp_path):
    with pytest.raises(ResultError) as refused:
        Simulation.read(tmp_path)
    assert refused.value.path == tmp_path


def test_cells_that_are_in_no_row_of_the_table_come_back_silent(out, indented):
    def keys(trains):
        return sorted((t.stimulus, t.afferent, t.cell, t.times_ms.size) for t in trains)

    tabled = read_spikes(out / "spikes.csv")

    assert len(tabled) < len(indented.trains)
    assert keys(stimuli_in(out).with_silent(tabled)) == keys(indented.trains)


def run_simulation(stimuli, model, folder, *, settings=DEFAULTS, **options):
    """`fembridge.simulate` of a model, with the solver's runs in `folder`."""
    return simulate(
        stimuli,
        parameters="published",
        finger=model.finger,
        probe=model.probe,
        analysis=Analysis(model.element, model.inertia, law=model.law),
        solver=replace(settings, runs_folder=folder),
        **options,
    )


def stimuli_of(word, **options):
    return [make_stimulus(entry, **options) for entry in resolve([word])]


ONE, TWO = stimuli_of("sine_20_250"), stimuli_of("sine_20_12.5,sine_20_250")


@pytest.fixture(scope="module")
def model():
    return model_of(PRESETS["quick"])


@pytest.fixture
def lines(logged):
    """What is logged."""
    return logged


@pytest.fixture
def solving(monkeypatch):
    """A solver is there, and an indentation gives what the function makes of model and ladder."""
    calls = []

    def give(of):
        def solved(folder, model, needed_um, settings, *, ladder=LADDER, **options):
            calls.append((folder, model, needed_um))
            return of(model, ladder[0]), read_map(FOLDER / "quick.toml")

        monkeypatch.setattr("fembridge.host.machine.find_ccx", lambda: Path("/usr/bin/ccx"))
        monkeypatch.setattr("fembridge.response.indentation.solve_response", solved)
        monkeypatch.setattr(module, "solve_response", solved)
        return calls

    return give


@pytest.fixture
def ccx(solving):
    """Its response is solved with the second contact tried."""
    return solving(lambda model, first: replace(model, contact=Contact(friction=0.0)))


@pytest.fixture
def accepting(solving):
    """Its indentation is accepted with whatever contact comes first."""
    return solving(lambda model, first: replace(model, contact=first))


@pytest.fixture
def slipping(solving):
    """Its indentation shows that skin slips under friction."""

    def slip(model, first):
        raise FrictionSlipError("skin slips under the probe", closure_percent=1.5, contact=first)

    return solving(slip)


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
    found = run_simulation(ONE, model, tmp_path, stored=True)
    assert ["'quick'" in line for line in lines] == [True]
    assert found.origin["source"] == "stored response"
    assert ccx == []


def test_with_a_solver_the_response_is_solved_below_the_folder(tmp_path, model, ccx):
    stimuli = stimuli_of("sine_20_12.5,sine_20_250", preindent_um=100.0)
    with pytest.warns(FembridgeWarning, match="100 um"):  # Table 2 has no pre-indentation
        found = run_simulation(stimuli, model, tmp_path)
    [(folder, solved, needed_um)] = ccx
    assert (folder, solved.finger, needed_um) == (tmp_path / "response", model.finger, 350.0)
    assert found.origin["source"] == "CalculiX"


def test_asked_for_what_is_not_stored_no_install_line_is_named(tmp_path, model, ccx):
    with pytest.raises(ResponseError, match="for this element") as caught:
        run_simulation(ONE, replace(model, element="CPE8R"), tmp_path, stored=True)
    assert "install" not in str(caught.value)


@pytest.mark.parametrize(
    ("stimuli", "change", "options", "found"),
    [
        (ONE, None, {"method": "magic"}, "'magic'"),
        (ONE, None, {"method": "transient", "stored": True}, "stored"),
        (ONE, soft, {"stored": True}, "dermis relaxes"),
        (ONE, soft, {"method": "map"}, "dermis relaxes"),
    ],
)
def test_options_that_mean_nothing_are_misuse(
    tmp_path, model, ccx, stimuli, change, options, found
):
    with pytest.raises(UsageError, match=found):
        run_simulation(stimuli, change(model) if change else model, tmp_path, **options)
    assert ccx == []


def test_a_transient_uses_the_contact_that_the_indentation_accepted(
    tmp_path, model, ccx, transients, lines
):
    settings = Solver(threads=2, jobs=2)

    found = run_simulation(TWO, model, tmp_path, method="transient", settings=settings)

    [(places, used)] = transients
    assert places == [tmp_path / "runs" / stimulus.id for stimulus in TWO]
    for place in places:
        assert contact_of(place)["friction"] == 0.0
        assert (place / f"{JOB}.inp").is_file()
    assert (used.jobs, used.threads) == (2, 2)
    for value in ("2 transients", "40 s", "node-to-surface"):
        assert value in lines[-1]
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
        run_simulation(TWO, model, tmp_path, method="transient")
    assert "1 of 2 transients" in lines[-1]


def test_a_full_disk_ends_the_simulation_at_once(tmp_path, model, ccx, transients):
    transients.failures = [Cause.DISK_FULL] * 9
    with pytest.raises(SolverError, match="sine_20_250"):
        run_simulation(TWO, model, tmp_path, method="transient")
    assert len(transients) == 1


def test_a_transient_that_diverges_gets_the_next_contact_and_the_others_stay(
    tmp_path, model, accepting, transients, lines
):
    transients.failures = [Cause.DIVERGED]
    found = run_simulation(TWO, model, tmp_path, method="transient")
    both = [tmp_path / "runs" / stimulus.id for stimulus in TWO]
    assert [places for places, _ in transients] == [both, both[1:]]
    used = [contact_of(place) for place in both]
    assert [contact["stiffness_mpa_per_mm"] for contact in used] == [200.0, 200.0]
    assert [contact["stick_share"] for contact in used] == [0.1, 0.01]
    assert list(found.origin["contacts"].values()) == used
    assert any("node-to-surface, 200 MPa/mm" in line and TWO[1].id in line for line in lines)


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
    found = run_simulation(waves, change(model), tmp_path)
    [(places, _)] = transients
    assert len(places) == 2
    assert reason in lines[0]
    assert found.origin["method"] == "transient"
    assert reason in found.origin["no_map"]
    assert len(ccx) == 1  # for the contact


def test_skin_that_slips_under_friction_gets_transients_with_that_contact(
    tmp_path, model, slipping, transients, lines
):
    found = run_simulation(ONE, model, tmp_path)
    [([place], _)] = transients
    assert contact_of(place)["friction"] == LADDER[0].friction
    assert "skin slips under the probe" in lines[0]
    assert (found.origin["method"], found.origin["closure_percent"]) == ("transient", 1.5)
    assert "response" not in found.origin


def test_skin_that_slips_is_an_error_of_a_map_that_was_asked_for(tmp_path, model, slipping):
    with pytest.raises(UsageError, match="skin slips under the probe"):
        run_simulation(ONE, model, tmp_path, method="map")


def test_after_a_slip_contacts_with_friction_follow_and_no_others(
    tmp_path, model, slipping, transients
):
    transients.failures = [Cause.DIVERGED]
    run_simulation(ONE, model, tmp_path / "once")
    assert contact_of(tmp_path / "once/runs/sine_20_250")["stick_share"] == LADDER[1].stick_share
    transients.clear()
    transients.failures = [Cause.DIVERGED] * 99
    with pytest.raises(SolverError):
        run_simulation(ONE, model, tmp_path / "always")
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
    assert Solver(threads=threads).shared_by(runs).threads == expected


def test_long_transients_take_a_word_before_anything_is_solved(tmp_path, model, ccx, lines):
    all_of_them = stimuli_of("all")
    with pytest.raises(UsageError, match=r"82 transients of .* --yes") as caught:
        run_simulation(all_of_them, model, tmp_path, method="transient", yes=False)
    assert len(str(caught.value)) < 300
    assert ccx == []
    limited = Solver(time_limit_s=5.0)
    check_cost(all_of_them, model, limited, yes=False)
    assert lines[0].startswith("82 transients of ")


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"von_mises_pas": np.zeros(3)}, "unknown array von_mises_pas, .*mean von_mises_pa"),
        ({"dt_ms": None}, "no array dt_ms"),
        ({"dt_ms": np.array(np.nan)}, "dt_ms is nan"),
        ({"dt_ms": np.array([0.5])}, r"dt_ms has shape \(1,\)"),
        ({"stimulus": np.array(["a", "a"])}, "stimulus has names that are empty or duplicate"),
        ({"stimulus": np.array(["a", "b"], dtype=object)}, "stimulus is of type object"),
        ({"stimulus": np.array([1.0, 2.0])}, "stimulus is of type float64"),
        ({"afferent": np.array(["SA"])}, r"afferent has shape \(1,\), expected \(3,\)"),
        ({"displacement_um": np.zeros((2, 4))}, r"displacement_um has shape \(2, 4\)"),
        ({"von_mises_pa": np.zeros((2, 3))}, r"von_mises_pa has shape \(2, 3\)"),
        ({"von_mises_pa": np.zeros((2, 0, 3))}, r"von_mises_pa has shape \(2, 0, 3\)"),
        (("von_mises_pa", (1, 5, 2), np.nan), "von_mises_pa of noise_25_250_20 is not finite"),
        (("von_mises_pa", (1, 5, 2), np.inf), "von_mises_pa of noise_25_250_20 is not finite"),
        (("von_mises_pa", (1, 5, 2), -1.0), "von_mises_pa is -1, expected 0 or more"),
        (("displacement_um", (0, -1), np.inf), "displacement_um of sine_20_250 is not finite"),
        (("displacement_um", (0, -1), np.nan), "von_mises_pa of sine_20_250 is not finite"),
        (("von_mises_pa", None, complex), "von_mises_pa is of type complex128"),
    ],
)
def test_arrays_of_a_simulation_that_are_damaged_are_refused_by_name(
    simulation, tmp_path, change, problem
):
    simulation.write(tmp_path)
    path = tmp_path / "traces.npz"
    with np.load(path) as stored:
        arrays = dict(stored)
    if isinstance(change, tuple):
        name, place, value = change
        if value is complex:
            arrays[name] = arrays[name] * 1j
        else:
            arrays[name][place] = value
    else:
        arrays = {name: array for name, array in {**arrays, **change}.items() if array is not None}
    np.savez(path, **arrays)
    with pytest.raises(ResultError, match=problem):
        stimuli_in(tmp_path)


def test_a_simulation_that_unpacks_to_more_than_the_limits_is_refused(
    simulation, tmp_path, monkeypatch
):
    simulation.write(tmp_path)
    path = tmp_path / "traces.npz"
    with np.load(path) as stored:
        np.savez_compressed(path, **{**stored, "von_mises_pa": np.zeros((2, 5000, 3))})
    with pytest.raises(ResultError, match="displacement_um has shape"):
        stimuli_in(tmp_path)
    simulation.write(tmp_path)
    monkeypatch.setenv("FEMBRIDGE_MEMORY", "20K")
    with pytest.raises(ResultError, match="FEMBRIDGE_MEMORY=8G"):
        stimuli_in(tmp_path)


def test_a_result_shows_itself_in_a_few_lines_and_a_notebook():
    result = fb.simulate(["sine_20_250", "sine_100_200"], stored=True)
    assert len(repr(result).splitlines()) <= 5
    assert "data:image/png;base64," in result._repr_html_()
    assert result.plot()._repr_png_().startswith(b"\x89PNG")


@pytest.mark.parametrize(("kind", "panels"), [("raster", 3), ("psth", 3), ("isi", 3), ("rates", 6)])
def test_a_picture_is_drawn_into_the_axes_of_the_caller(kind, panels):
    from matplotlib.figure import Figure

    result = fb.simulate(["sine_20_250", "sine_100_200"], stored=True)
    figure = Figure()
    axes = figure.subplots(1, panels)
    assert result.plot(kind, ax=axes) is figure
    assert all(panel.has_data() for panel in axes)
    assert len(figure.axes) == panels
    with pytest.raises(UsageError) as caught:
        result.plot(kind, ax=axes[:2])
    assert (caught.value.argument, caught.value.found) == ("ax", 2)
