"""``kill -9`` of the solver, of us, of both, and of us at every single moment."""

import os
import signal
import sys
import threading
from pathlib import Path

import pytest

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
