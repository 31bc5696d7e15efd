"""Studies in files, and a sweep in this process or in one of its own."""

from functools import partial
from pathlib import Path

import pytest

from fembridge import cli
from fembridge.host.machine import CCX_VARIABLE
from fembridge.sweeps.sweep import solver_version


@pytest.fixture(autouse=True)
def version_of_each_test():
    solver_version.cache_clear()


@pytest.fixture
def recorded_ccx(tmp_path, monkeypatch, replaying_ccx):
    """It keeps a ledger."""
    monkeypatch.setenv("REPLAY_LEDGER", str(tmp_path / "ledger"))
    return replaying_ccx


@pytest.fixture
def ledger(tmp_path):
    """What the solver has noted so far: ``(word, pid, parent, folder)``."""

    def read():
        path = tmp_path / "ledger"
        lines = path.read_text().splitlines() if path.exists() else []
        words = [line.split(" ", 3) for line in lines]
        return [(word, int(pid), int(up), Path(where)) for word, pid, up, where in words]

    return read


@pytest.fixture
def gate(tmp_path, monkeypatch):
    """A file that the solver waits for."""
    path = tmp_path / "gate"
    monkeypatch.setenv("REPLAY_GATE", str(path))
    return path


@pytest.fixture
def study_file(file):
    return partial(file, "study.toml")


@pytest.fixture
def dermis_study(study_file):
    """A study of `count` fingers of different dermis: each takes one solve."""

    def write(count=4, more=""):
        values = [round(0.04 + 0.005 * k, 3) for k in range(count)]
        return study_file(
            'stimuli = ["sine_20_250"]\n'
            f"{more}\n[[fingers]]\ngrid.materials.dermis.young_mpa = {values}\n"
        )

    return write


@pytest.fixture
def command():
    """Run the verb in this process."""
    return lambda *words: cli.main(["sweep", *map(str, words)])


@pytest.fixture
def start_sweep(begin):
    """Run the verb as a process of its own."""
    return lambda *words: begin("-m", "fembridge.cli", "sweep", *words)


@pytest.fixture
def here(monkeypatch, in_this_process):
    """No solver, no other process."""
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv(CCX_VARIABLE, raising=False)
    return in_this_process
