"""Studies in files, and a solver that gives the recorded response of `quick`.

The solver keeps a ledger: a line when it begins and a line when it has solved. What
it does with a deck is shown by environment variables, which workers inherit.
"""

from concurrent.futures import Executor, Future
from pathlib import Path

import pytest

import fembridge
from fembridge import cli
from fembridge.machine import CCX_VARIABLE
from fembridge.sweeps import sweep
from fembridge.sweeps.work import solver_version

ROOT = Path(fembridge.__file__).parents[1]
RECORDED = ROOT / "fixtures" / "response_quick"

SOLVER = """
import os, shutil, sys, time
if sys.argv[1] == "-v":
    print("This is Version 2.20"); sys.exit(201)
def note(word):
    line = f"{word} {os.getpid()} {os.getppid()} {os.getcwd()}\\n"
    handle = os.open(os.environ["SWEEP_LEDGER"], os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    os.write(handle, line.encode()); os.close(handle)
job = sys.argv[2]
deck = open(job + ".inp").read()
print("CalculiX Version 2.20, Copyright(C) 1998-2022 Guido Dhondt", flush=True)
note("begin")
if os.environ.get("SWEEP_REFUSES", "no such text") in deck:
    print(" *ERROR reading *ELASTIC: the moon is full\\n"); sys.exit(201)
gate = os.environ.get("SWEEP_GATE")
while gate and not os.path.exists(gate):
    time.sleep(0.02)
for suffix in (".cvg", ".sta", ".dat", ".frd"):
    shutil.copyfile(os.environ["SWEEP_RECORDED"] + "/job" + suffix, job + suffix)
print(" Job finished", flush=True)
note("end")
"""


@pytest.fixture(autouse=True)
def version_of_each_test():
    solver_version.cache_clear()


@pytest.fixture
def recorded_ccx(tmp_path, monkeypatch, python_program):
    program = python_program(tmp_path / "bin" / "ccx", SOLVER)
    monkeypatch.setenv(CCX_VARIABLE, str(program))
    monkeypatch.setenv("SWEEP_LEDGER", str(tmp_path / "ledger"))
    monkeypatch.setenv("SWEEP_RECORDED", str(RECORDED))
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    return program


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
    monkeypatch.setenv("SWEEP_GATE", str(path))
    return path


@pytest.fixture
def study_file(tmp_path):
    def write(text, name="study.toml"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write


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


class Here(Executor):
    """Does each task in this process, at once; `done` are their names."""

    done: tuple = ()

    def __init__(self, jobs, on_message):
        Here.done = []

    def submit(self, function, task, *args, **options):
        Here.done.append(str(task))
        future = Future()
        future.set_result(function(task, *args, **options))
        return future


@pytest.fixture
def here(monkeypatch):
    """No solver, no other process."""
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv(CCX_VARIABLE, raising=False)
    monkeypatch.setattr(sweep, "LocalExecutor", Here)
    return Here
