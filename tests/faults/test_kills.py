"""``kill -9`` of the solver, of us, of both, and of us at every single moment."""

import os
import signal
import sys
import threading
from pathlib import Path

import pytest

from fembridge.run_folder import read_run_folder
from fembridge.solver.ccx import run_ccx

KILLED_AT = Path(__file__).with_name("killed_at.py")
LEAST = 10
"""File operations before each of which it is killed once."""


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_solver_that_is_killed_is_said_and_leaves_no_result(fake_ccx, make_run, pid_of, refused):
    folder = make_run("hang")
    killer = threading.Thread(target=lambda: os.kill(pid_of(folder), signal.SIGKILL))
    killer.start()

    refused("run", folder)

    killer.join()
    assert names_in(folder) == ["failed", "job.inp", "run.toml"]
    assert "killed from outside" in (folder / "failed" / "cause.txt").read_text()


def test_both_killed_leave_a_folder_that_runs_again(
    fake_ccx, begin, make_run, pid_of, is_alive, wait_until
):
    folder = make_run("hang")
    child = begin("-m", "fembridge.cli", "run", folder)
    solver = pid_of(folder)
    for number in (solver, child.pid):
        os.kill(number, signal.SIGKILL)
    child.wait()
    wait_until(lambda: not is_alive(solver))
    assert not (folder / "job.frd").exists()
    make_run("normal")

    assert run_ccx(read_run_folder(folder)).accepted
    assert not {"failed", "solving", ".solver.lock"} & set(names_in(folder))


@pytest.mark.parametrize("scene", ["outputs", "results"])
def test_killed_before_any_file_operation_no_half_stands_for_a_whole(
    tmp_path, monkeypatch, begin, scene
):
    """After each kill the same work is done again, and finds nothing in its way."""
    monkeypatch.setenv("FEMBRIDGE_CCX", sys.executable)  # found, never started

    done = begin(KILLED_AT, scene, tmp_path / "scene")
    out, err = done.communicate()

    assert done.returncode == 0, err
    assert int(out) >= LEAST
