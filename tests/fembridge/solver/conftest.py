"""A run folder, and a solver that plays the part which the folder's deck names."""

from pathlib import Path

import pytest

from fembridge.run_folder import RunFolder
from fembridge.store import sha256_of


@pytest.fixture
def fake_ccx(tmp_path, monkeypatch, python_program):
    text = Path(__file__).with_name("fake_ccx.py").read_text(encoding="utf-8")
    program = python_program(tmp_path / "bin" / "ccx", text)
    monkeypatch.setenv("FEMBRIDGE_CCX", str(program))
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    return program


@pytest.fixture
def make_run(tmp_path):
    def make(play="normal", name="run", deck=None, increments=4, solver="calculix"):
        folder = tmp_path / name
        folder.mkdir(exist_ok=True)
        path = folder / "job.inp"
        path.write_text(deck or f"** play {play}\n*HEADING\nNOPE, 1, 1\n*EL OUTPUT\n")
        run = RunFolder(folder, solver, increments, 0.5, 0.0, (), sha256_of(path))
        run.write()
        return folder

    return make


@pytest.fixture
def is_at_work():
    """Whether any process has `folder` as its working folder: the solver has."""

    def at_work(folder):
        for process in Path("/proc").glob("[0-9]*/cwd"):
            try:
                if process.readlink() == folder:
                    return True
            except (FileNotFoundError, PermissionError, ProcessLookupError):
                continue
        return False

    return at_work


@pytest.fixture
def pid_of(wait_until):
    """The number of the solver that is at work in a run folder."""

    def pid(folder):
        path = folder / "solving" / "job.pid"
        wait_until(lambda: path.exists() and path.read_text())
        return int(path.read_text())

    return pid
