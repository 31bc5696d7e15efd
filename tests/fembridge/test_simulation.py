"""What a simulation gives: spikes of the stress it was given, its files, and those found again."""

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from decks.stimuli import resolve
from decks.waveform import make_stimulus
from fembridge.errors import OutputError, ParameterError, ResultError, TraceError, UsageError
from fembridge.simulation import encode_all, find_file, stimuli_in
from fembridge.tables import read_spikes
from fembridge.trace import StressTrace
from neural import PUBLISHED, encode, parameter_set

RUN = Path(__file__).parents[2] / "fixtures" / "transient_sine"

GAIN_PA_PER_UM = {"SA": 120.0, "RA": 75.0, "PC": 4.0}
FILES = ["rates.csv", "simulation.toml", "spikes.csv", "traces.npz"]
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
        dataclasses.replace(simulation, origin=finger).write(tmp_path)
        assert (tmp_path / "finger.toml").exists()

    simulation.write(tmp_path)  # no response, no finger

    assert (tmp_path / "finger.toml").exists() == mine


@pytest.mark.parametrize("blocked", FILES)
def test_a_result_that_cannot_be_written_leaves_the_earlier_one(tmp_path, simulation, blocked):
    """Whichever of the four it is: no file of the new one beside three old ones."""
    simulation.write(tmp_path)
    (tmp_path / blocked).unlink()
    (tmp_path / blocked).mkdir()
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir() if p.is_file()}
    other = dataclasses.replace(simulation, trains=(), mean_rates=(), origin={"method": "x"})

    with pytest.raises(OutputError, match=f"{blocked}: a folder stands where a file"):
        other.write(tmp_path)

    after = {p.name: p.read_bytes() for p in tmp_path.iterdir() if p.is_file()}
    assert after == before
    assert len(before) == 3


def other_clock(**changes):
    rows = traces_of()
    rows[1][2] = dataclasses.replace(rows[1][2], **changes)
    return rows


@pytest.mark.parametrize(
    ("traces", "kind", "found"),
    [
        (traces_of(afferents=("SA", "XY")), TraceError, "of XY, expected 501 of SA, RA, PC"),
        (other_clock(stress_pa=np.zeros(500)), TraceError, "500 samples of PC, expected 501"),
        (other_clock(dt_ms=1.0), ParameterError, "PC: the trace has a sample every 1 ms"),
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


def test_cells_that_are_in_no_row_of_the_table_come_back_silent(out, indented):
    def keys(trains):
        return sorted((t.stimulus, t.afferent, t.repeat, t.times_ms.size) for t in trains)

    tabled = read_spikes(out / "spikes.csv")

    assert len(tabled) < len(indented.trains)
    assert keys(stimuli_in(out).with_silent(tabled)) == keys(indented.trains)


def test_a_run_folder_has_its_own_waveform():
    [stimulus] = stimuli_in(RUN).stimuli

    assert stimulus.id == "sine_50_250_first_60_ms"
    assert (stimulus.dt_ms, stimulus.displacement_um.max()) == (0.5, 250.0)


def test_any_other_folder_has_none(tmp_path):
    assert stimuli_in(tmp_path) is None


@pytest.mark.parametrize(
    ("name", "share"),
    [("traces.npz", 0.0), ("traces.npz", 0.5), ("traces.npz", 0.99), ("simulation.toml", 0.2)],
)
def test_a_cut_file_is_named(out, name, share):
    path = out / name
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(ResultError) as caught:
        stimuli_in(out)
    assert caught.value.path == path


def test_a_file_is_itself_and_a_folder_has_the_first_name_that_is_there(out):
    assert find_file(out / "spikes.csv", ("rates.csv",), "") == out / "spikes.csv"
    assert find_file(out, ("nothing.csv", "rates.csv"), "") == out / "rates.csv"


def test_the_only_one_below_is_taken_and_of_more_all_are_named(out):
    assert find_file(out.parent, ("rates.csv",), "") == out / "rates.csv"
    shutil.copytree(out, out.parent / "again")
    with pytest.raises(UsageError) as caught:
        find_file(out.parent, ("rates.csv",), "")
    assert str(out / "rates.csv") in str(caught.value)
    assert str(out.parent / "again" / "rates.csv") in str(caught.value)


def test_none_anywhere_says_what_makes_one(tmp_path):
    with pytest.raises(ResultError, match=r"rates\.csv.*simulate leaves it") as caught:
        find_file(tmp_path, ("rates.csv",), "simulate leaves it")
    assert caught.value.path == tmp_path
