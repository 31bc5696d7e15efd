"""The indentation: when a contact model is to be trusted, and recorded runs as response maps."""

import hashlib
import shutil
import struct
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fembridge.errors import ResponseError, ResultError
from fembridge.io.run_folder import read_run_folder, read_waveform
from fembridge.response.indentation import (
    CLOSURE_PERCENT,
    DEEP_UM,
    DEFAULT_DEPTH_UM,
    HysteresisError,
    depth_for,
    indentation,
    judge,
    measured_response,
)
from fembridge.response.response_map import FOLDER, read_map, write_map
from fembridge.results.readers import read_values
from fembridge.simulation.folder import stimuli_in
from fembridge.trace import PA_PER_MPA

DEPTH_UM = indentation().displacement_um
DEEPEST = int(DEPTH_UM.argmax())


def stress_at(depth_um):
    """Stress of two afferents that rises with depth, ``(T, 2)`` in Pa."""
    return np.stack([30.0 * depth_um, 0.01 * depth_um**2], -1)


def run(depth_um=DEPTH_UM, **changes):
    found = {
        "stress_pa": stress_at(depth_um),
        "force_n_per_mm": 1e-4 * depth_um,
        "apex_um": 0.9 * depth_um,
    }
    return judge(depth_um, **(found | changes))


def test_a_run_that_comes_back_exactly_is_accepted_with_a_closure_of_0():
    assert run() == (0.0, None)


@given(
    percent=st.floats(-50, 50),
    row=st.integers(DEEPEST + 1, DEPTH_UM.size - 1),
    column=st.integers(0, 1),
)
def test_the_closure_is_the_one_worst_sample_of_all(percent, row, column):
    stress_pa = stress_at(DEPTH_UM)
    stress_pa[row, column] *= 1 + percent / 100
    compared = DEPTH_UM[row] >= 0.05 * DEPTH_UM[DEEPEST]
    closure_percent, refusal = run(stress_pa=stress_pa)
    expected = abs(percent) if compared else 0.0
    assert closure_percent == pytest.approx(expected, abs=1e-9)
    if abs(expected - CLOSURE_PERCENT) > 1e-9:
        assert (refusal is None) is (expected < CLOSURE_PERCENT)
        assert refusal is None or isinstance(refusal, HysteresisError)


@pytest.mark.parametrize(
    ("changes", "shown"),
    [
        ({"apex_um": 0.49 * DEPTH_UM}, "196 um"),
        ({"force_n_per_mm": -1e-4 * DEPTH_UM}, "-0.04 N/mm"),
        ({"force_n_per_mm": np.nan * DEPTH_UM}, "nan N/mm"),
        ({"apex_um": np.nan * DEPTH_UM}, "nan um"),
        ({"stress_pa": stress_at(DEPTH_UM) * [1, 0]}, "400 um"),
    ],
)
def test_a_run_in_which_nothing_was_pushed_or_felt_is_refused(changes, shown):
    """The other trap: a probe slips between the nodes; the run ends well and closes exactly."""
    _, refusal = run(**changes)
    assert shown in str(refusal)
    assert not isinstance(refusal, HysteresisError)


@pytest.mark.parametrize(
    "depth_um",
    [
        DEPTH_UM[: DEEPEST + 1],
        np.array([0.0, 100.0, 200.0, 300.0, 250.0, 150.0]),
        np.array([0.0, 1.0, 200.0, 300.0, 1.0]),
    ],
)
def test_a_run_that_compares_nothing_proves_nothing(depth_um):
    """No way back, no depth that was loaded to, or first touch alone."""
    closure_percent, refusal = run(depth_um)
    assert np.isnan(closure_percent)
    assert isinstance(refusal, HysteresisError)


FIXTURES = Path(__file__).parents[3] / "fixtures"
RECORDED = sorted(path.parent for path in FIXTURES.glob("*/RUN.toml"))


def recorded_response(folder):
    return measured_response(read_run_folder(folder), *stimuli_in(folder).stimuli)


@pytest.fixture
def folder(tmp_path):
    """Give a copy of the recorded indentation of the quick finger."""
    return Path(shutil.copytree(FIXTURES / "response_quick", tmp_path / "run"))


@pytest.mark.parametrize("folder", RECORDED, ids=lambda folder: folder.name)
def test_a_recording_is_what_its_checksums_say(folder):
    record = tomllib.loads((folder / "RUN.toml").read_text(encoding="utf-8"))
    checksums = record.get("files") or record["sha256"]

    found = {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.iterdir()
        if path.name in checksums
    }

    assert found == checksums
    known = {"CalculiX": "2.20", "Marc": "2020"}
    assert str(record["version"])[:4] == known[record["solver"]]
    unlisted = {path.name for path in folder.iterdir()} - set(checksums)
    assert unlisted <= {"RUN.toml", "expected.json"}


SHIPPED = ["response_quick", "response_paper", "response_quick_deep", "response_paper_deep"]


@pytest.mark.parametrize("name", SHIPPED)
def test_the_shipped_map_is_the_recorded_run(name, tmp_path):
    measured = recorded_response(FIXTURES / name)
    shipped = FOLDER / f"{name.removeprefix('response_')}.toml"
    read = read_map(shipped)
    for part in ("depth_um", "tensor_pa", "force_n_per_mm"):
        np.testing.assert_array_equal(getattr(measured, part), getattr(read, part))
    assert measured.places == read.places
    assert measured.closure_percent == read.closure_percent
    write_map(tmp_path / "again.toml", measured)
    assert (tmp_path / "again.toml").read_bytes() == shipped.read_bytes()


@pytest.mark.parametrize("name", ["quick", "paper"])
def test_the_deep_map_is_the_default_one_as_far_as_that_goes(name):
    """One hangs on a spring, in half a section, and goes in other steps."""
    default, deep = (read_map(FOLDER / f"{name}{end}.toml") for end in ("", "_deep"))
    depth_um = np.linspace(0.0, default.deepest_um, 300)
    expected, found = (each.tensors(depth_um) for each in (default, deep))
    assert np.abs(found - expected).max() < 1e-3 * np.abs(expected).max()
    assert deep.deepest_um == 1000.0
    assert deep.closure_percent < 0.05


def scale(path, number, factor):
    """Multiply a number that stands once in a binary file."""
    old, new = (struct.pack("<d", value) for value in (number, number * factor))
    content = path.read_bytes()
    assert content.count(old) == 1
    path.write_bytes(content.replace(old, new))


def deepest_row(folder):
    return int(read_waveform(folder)[1].argmax()) - 1  # a file holds no rest state


@pytest.mark.parametrize(
    ("factor", "error", "found"),
    [
        (1.03, HysteresisError, r"2\.\d* %"),
        (np.nan, ResultError, "job.frd"),
    ],
)
def test_a_run_whose_unloading_was_tampered_with_is_refused(folder, factor, error, found):
    """One component of SA's stress at the first increment on the way back."""
    run = read_run_folder(folder)
    [node] = [place.node for place in run.afferents if place.afferent == "SA"]
    _, tensor_pa = read_values(run.results, [node])
    scale(folder / "job.frd", tensor_pa[deepest_row(folder) + 1, 0, 0] / PA_PER_MPA, factor)
    with pytest.raises(error, match=found):
        recorded_response(folder)


def test_a_probe_that_the_skin_did_not_follow_is_refused(folder):
    run = read_run_folder(folder)
    _, moved_mm = read_values(run.results, [run.apex_node], quantity="displacement")
    scale(folder / "job.frd", moved_mm[deepest_row(folder), 0, 1], 0.4)
    with pytest.raises(ResponseError, match="400 um"):
        recorded_response(folder)


def test_a_waveform_of_other_times_is_refused(folder):
    lines = (folder / "stimulus.csv").read_text().splitlines()
    moved = [
        lines[0],
        *(f"{10 * float(a)},{b}" for a, b in (line.split(",") for line in lines[1:])),
    ]
    (folder / "stimulus.csv").write_text("\n".join(moved) + "\n")
    with pytest.raises(ResultError, match=r"0\.0005 s.*0\.005 s"):
        recorded_response(folder)


@given(needed_um=st.floats(-100.0, 9900.0))
def test_two_indentations_answer_all_but_the_deepest_stimuli(needed_um):
    depth_um = depth_for(needed_um)
    assert depth_um >= needed_um
    assert depth_um in (DEFAULT_DEPTH_UM, DEEP_UM) or depth_um - needed_um <= 100.0
