"""The solver says that all is well and leaves a file that is not whole."""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from fembridge.errors import FembridgeError
from fembridge.io.run_folder import read_run_folder, read_waveform
from fembridge.response.indentation import measured_response
from fembridge.simulation.folder import stimuli_in
from fembridge.solver.ccx import run_folders
from fembridge.solver.verdict import Cause, SolverLog, judge

RECORDED = Path(__file__).parents[2] / "fixtures" / "response_quick"
PLACES = 40 if os.environ.get("CI") == "true" else 8
ALL_IS_WELL = SolverLog((), (), "Job finished", "2.20")


def places_to_cut(size):
    spread = np.linspace(0, size - 1, PLACES).astype(int).tolist()
    return sorted({*spread, *range(size - 12, size - 1)})


@pytest.fixture
def solved(tmp_path):
    """A copy of the recorded run of `quick`, whole."""
    folder = tmp_path / "solved"
    shutil.copytree(RECORDED, folder)
    return folder


def test_a_result_file_cut_anywhere_is_never_accepted(solved):
    run, frd = read_run_folder(solved), solved / "job.frd"
    assert judge(solved, run, 0, ALL_IS_WELL) is None
    content = frd.read_bytes()
    for size in places_to_cut(len(content.rstrip())):
        frd.write_bytes(content[:size])
        failure = judge(solved, run, 0, ALL_IS_WELL)
        assert failure is not None, size
        assert failure.cause is Cause.DISK_FULL, (size, failure)


def test_a_result_file_that_ends_in_zeros_is_not_accepted(solved):
    """What a file system leaves that kept the size of a file and lost its end."""
    run, frd = read_run_folder(solved), solved / "job.frd"
    content = frd.read_bytes()
    half = len(content) // 2
    frd.write_bytes(content[:half] + bytes(len(content) - half))
    failure = judge(solved, run, 0, ALL_IS_WELL)
    assert failure.cause is Cause.DISK_FULL


def test_forces_cut_anywhere_are_refused_or_were_not_needed(solved):
    of = read_run_folder(solved), *stimuli_in(solved).stimuli
    whole = measured_response(*of)
    dat = solved / "job.dat"
    content = dat.read_bytes()
    refused = 0

    for size in places_to_cut(len(content.rstrip())):
        dat.write_bytes(content[:size])
        try:
            found = measured_response(*of)
        except FembridgeError:
            refused += 1
        else:
            np.testing.assert_array_equal(found.force_n_per_mm, whole.force_n_per_mm)

    assert refused >= PLACES - 2


@pytest.mark.parametrize("suffix", [".frd", ".dat"])
def test_a_simulation_does_not_use_what_was_cut(
    replaying_ccx, tmp_path, monkeypatch, refused, suffix
):
    monkeypatch.setenv("REPLAY_CUT", suffix)
    out = tmp_path / "out"
    refused("simulate", "--no-plot", "--stimulus", "sine_20_250", "-o", out, notes=1)
    assert [path.name for path in out.iterdir()] == ["response"]
    assert not (out / "response" / "response.toml").exists()


@pytest.mark.parametrize("name", ["job.frd", "job.dat"])
def test_one_byte_that_was_edited_has_the_run_made_again(replaying_ccx, tmp_path, make_run, name):
    folder = make_run(increments=len(read_waveform(RECORDED)[0]) - 1)
    assert [run_folders([folder])[0].skipped for _ in range(2)] == [False, True]
    content = bytearray((folder / name).read_bytes())
    content[len(content) // 2] ^= 1
    (folder / name).write_bytes(content)
    assert not run_folders([folder])[0].skipped
    assert (folder / name).read_bytes() == (RECORDED / name).read_bytes()
