"""``kill -9`` of the solver, of us, of both, at every single moment; two of us in one folder."""

import os
import signal
import sys
import threading
from pathlib import Path

import pytest

from fembridge.host.store import filling, write_text

KILLED_AT = Path(__file__).with_name("killed_at.py")
LEAST = 10
"""File operations before each of which it is killed once."""


def test_a_solver_that_is_killed_is_said_and_leaves_no_result(fake_ccx, make_run, pid_of, refused):
    folder = make_run("hang")
    killer = threading.Thread(target=lambda: os.kill(pid_of(folder), signal.SIGKILL))
    killer.start()
    refused("run", folder)
    killer.join()
    assert {path.name for path in folder.iterdir()} == {"failed", "job.inp", "run.toml"}
    assert "killed from outside" in (folder / "failed" / "cause.txt").read_text()


@pytest.mark.parametrize("scene", ["outputs", pytest.param("results", marks=pytest.mark.slow)])
def test_killed_before_any_file_operation_no_half_stands_for_a_whole(
    tmp_path, monkeypatch, begin, scene
):
    """After each kill the same work is done again, and finds nothing in its way."""
    monkeypatch.setenv("FEMBRIDGE_CCX", sys.executable)  # found, never started
    done = begin(KILLED_AT, scene, tmp_path / "scene")
    out, err = done.communicate()
    assert done.returncode == 0, err
    assert int(out) >= LEAST


PATIENCE_S = 0.5
NAMES = ("a.csv", "b.csv", "record.toml")


def fill(folder, text):
    with filling(folder, last="record.toml") as draft:
        for name in NAMES:
            write_text(draft / name, text)


def test_files_of_two_that_write_into_one_folder_are_never_mixed(tmp_path, monkeypatch):
    """The second comes while the first has moved one file of three."""
    second = threading.Thread(target=fill, args=(tmp_path, "second"))
    replace = Path.replace

    def slow(self, target):
        moved = replace(self, target)
        if target == tmp_path / "a.csv" and second.ident is None:
            second.start()
            second.join(PATIENCE_S)
        return moved

    monkeypatch.setattr(Path, "replace", slow)
    fill(tmp_path, "first")
    second.join()

    found = {path.name: path.read_text() for path in tmp_path.iterdir()}
    assert found == dict.fromkeys(NAMES, "second")
