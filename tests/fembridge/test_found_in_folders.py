"""What verbs leave in a folder is found, and read again as it was."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from decks.stimuli import resolve
from decks.waveform import make_stimulus
from fembridge.errors import ResultError, UsageError
from fembridge.simulation import encode_all, find_file, stimuli_in
from fembridge.tables import read_spikes
from fembridge.trace import StressTrace
from neural.parameter_sets import parameter_set

RUN = Path(__file__).parents[2] / "fixtures" / "transient_sine"


@pytest.fixture(scope="module")
def simulation():
    """Two stimuli of a probe that was 75 um deep, one too weak for any spike."""
    chosen = parameter_set("fitted")
    stimuli = [make_stimulus(one, 75.0) for one in resolve("sine_20_250,sine_20_6.71")]
    traces = [
        [
            StressTrace(gain * np.maximum(one.displacement_um, 0.0), 0.5, 7, name)
            for name, gain in (("SA", 120.0), ("RA", 75.0), ("PC", 4.0))
        ]
        for one in stimuli
    ]
    return encode_all(stimuli, traces, chosen.parameters, {"parameters": {
        name: {"cells": one.cells} for name, one in chosen.parameters.items()
    }})  # fmt: skip


@pytest.fixture
def out(tmp_path, simulation):
    simulation.write(tmp_path / "out")
    return tmp_path / "out"


def test_a_simulation_comes_back_with_the_probe_as_it_was(out, simulation):
    written = stimuli_in(out)

    assert [one.id for one in written.stimuli] == ["sine_20_250", "sine_20_6.71"]
    for read, made in zip(written.stimuli, simulation.stimuli, strict=True):
        assert_array_equal(read.displacement_um, made.displacement_um)
        assert (read.preindent_um, read.window_ms) == (75.0, made.window_ms)
        assert read.displacement_um[0] == 75.0
    for read, made in zip(written.traces, simulation.traces, strict=True):
        assert [trace.afferent for trace in read] == ["SA", "RA", "PC"]
        for one, other in zip(read, made, strict=True):
            assert_array_equal(one.stress_pa, other.stress_pa)
    assert written.cells == {"SA": 10, "RA": 10, "PC": 10}


def test_cells_that_are_in_no_row_of_the_table_come_back_silent(out, simulation):
    def keys(trains):
        return sorted((t.stimulus, t.afferent, t.repeat, t.times_ms.size) for t in trains)

    tabled = read_spikes(out / "spikes.csv")

    assert len(tabled) < len(simulation.trains)
    assert keys(stimuli_in(out).with_silent(tabled)) == keys(simulation.trains)


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
