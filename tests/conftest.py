"""What all tests share: how much a run tries, and no solver where there is none.

``CI=true`` is the run before a change lands: more examples, every cut, every slow
test. A person's run tries a part of them and is done in a minute or two.
"""

import gc
import importlib.util
import logging
import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from hypothesis import settings

from fembridge.errors import MissingError
from fembridge.host.machine import find_ccx
from fembridge.host.store import sha256_of
from fembridge.io.run_folder import RunFolder, read_run_folder
from fembridge.solver.ccx import run_ccx
from fembridge.solver.settings import Solver

ROOT = Path(__file__).parents[1]
CI = os.environ.get("CI") == "true"
if os.environ.pop("PYTHONDONTWRITEBYTECODE", None):  # else every process would compile us anew
    sys.dont_write_bytecode = False
# Matrices here are small: threads of BLAS wait longer for each other than they compute.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read when NumPy is loaded, below
PATIENCE_S = 300.0
settings.register_profile("fembridge", deadline=None, max_examples=100 if CI else 12)
settings.register_profile("costly", deadline=None, max_examples=120 if CI else 6)
settings.load_profile("fembridge")

PATCH = """*HEADING
One square millimetre of skin, stretched
*NODE, NSET=ALL
1, 0., 0.
2, 1., 0.
3, 1., 1.
4, 0., 1.
*ELEMENT, TYPE=CPE4, ELSET=SKIN
1, {nodes}
*MATERIAL, NAME=DERMIS
*ELASTIC
0.05, 0.3
*SOLID SECTION, ELSET=SKIN, MATERIAL=DERMIS
1.
{model}
*BOUNDARY
1, 1, 2
2, 2, 2
*STEP, NLGEOM, INC={most}
*STATIC, DIRECT{solver}
0.0005, {end_s}
{load}
*NODE OUTPUT, NSET={set}
U
*ELEMENT OUTPUT, NSET=ALL, DOUBLE
S
{request}
*END STEP
"""
PATCH_PARTS = {
    "nodes": "1, 2, 3, 4",
    "model": "** no more",
    "most": 1000000,
    "solver": "",
    "end_s": 0.002,
    "load": "*BOUNDARY\n3, 2, 2, 0.01\n4, 2, 2, 0.01",
    "set": "ALL",
    "request": "** no more",
}


def pytest_addoption(parser):
    parser.addoption("--slow", action="store_true", help="run the slow tests too, as CI=true does")


def pytest_configure(config):
    """A worker that is killed ends the run, red: with its one test left over, a new one waits."""
    if getattr(config.option, "maxworkerrestart", "") is None:
        config.option.maxworkerrestart = "0"


def pytest_collection_finish(session):
    """Thousands of tests live until the end: the collector of garbage need not look at them."""
    gc.collect()
    gc.freeze()


def pytest_collection_modifyitems(config, items):
    skip_marked(items, "solver", "ccx is not on the PATH", unless=solver_is_here)
    skip_marked(
        items,
        "slow",
        "slow: runs with --slow or CI=true",
        unless=lambda: CI or config.getoption("slow"),
    )


def skip_marked(items, mark, reason, unless):
    marked = [item for item in items if item.get_closest_marker(mark)]
    if marked and not unless():
        for item in marked:
            item.add_marker(pytest.mark.skip(reason=reason))


def solver_is_here():
    try:
        return find_ccx() is not None
    except MissingError:  # FEMBRIDGE_CCX names something that is no program
        return False


@pytest.fixture(scope="session", autouse=True)
def _ctrl_c_reaches_children():
    """Under ``&`` or nohup a shell has us ignore it, and children inherit that."""
    ignored = signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    if ignored:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    if ignored:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


@pytest.fixture(scope="session", autouse=True)
def _no_cache():
    """What another test or a person solved before is no answer here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("FEMBRIDGE_CACHE", "off")
        yield


@pytest.fixture(scope="session", autouse=True)
def _no_power_cut():
    """A person's run does not wait until the disk has what was written."""
    with pytest.MonkeyPatch.context() as patch:
        if not CI:
            patch.setattr(os, "fsync", lambda handle: None)
        yield


@pytest.fixture
def here(tmp_path, monkeypatch):
    """Work in the empty folder of the test."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def file(tmp_path):
    """Write a text or bytes to a file of this name, and give its path."""

    def write(name, content):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


@pytest.fixture
def python_program():
    """Write a program in Python; a ``#!`` line could not name ours where its path has blanks."""

    def write(path, text):
        path.parent.mkdir(exist_ok=True)
        start = f"""'''exec' {shlex.quote(sys.executable)} -IS "$0" "$@"\n' '''"""
        path.write_text(f"#!/bin/sh\n{start}\n{text}", encoding="utf-8")
        path.chmod(0o755)
        return path

    return write


@pytest.fixture
def begin():
    """Start a Python of its own; it does not outlive the test."""
    begun = []

    def start(*words):
        process = subprocess.Popen(
            [sys.executable, "-P", *map(str, words)],
            env=os.environ | {"PYTHONPATH": str(ROOT)},  # a checkout need not be installed
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        begun.append(process)
        return process

    yield start
    for process in begun:
        process.kill()
        if not process.stderr.closed:
            print(process.communicate()[1])


@pytest.fixture
def wait_until():
    """Wait for what another process does, however busy the machine is."""

    def wait(holds):
        until_s = time.monotonic() + PATIENCE_S
        while not holds():
            assert time.monotonic() < until_s, "it did not happen"
            time.sleep(0.01)

    return wait


@pytest.fixture
def is_alive():
    """Whether a process is at work; a zombie waits for its parent only."""

    def alive(pid):
        try:
            stat = Path(f"/proc/{pid}/stat").read_text()
        except (FileNotFoundError, ProcessLookupError):
            return False
        return stat.rpartition(")")[2].split()[0] not in "ZX"

    return alive


@pytest.fixture
def fake_ccx(tmp_path, monkeypatch, python_program):
    text = Path(__file__).with_name("fake_ccx.py").read_text(encoding="utf-8")
    program = python_program(tmp_path / "bin" / "ccx", text)
    monkeypatch.setenv("FEMBRIDGE_CCX", str(program))
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    return program


@pytest.fixture
def replaying_ccx(tmp_path, monkeypatch, python_program):
    """A solver that leaves the recorded indentation of `quick`: see ``replaying_ccx.py``."""
    text = Path(__file__).with_name("replaying_ccx.py").read_text(encoding="utf-8")
    program = python_program(tmp_path / "bin" / "ccx", text)
    monkeypatch.setenv("FEMBRIDGE_CCX", str(program))
    monkeypatch.setenv("REPLAYED", str(ROOT / "fixtures" / "response_quick"))
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
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
def solve():
    """Run the deck of a folder of `make_run`."""

    def run(folder, halt=None, **settings):
        return run_ccx(read_run_folder(folder), Solver(**settings), halt)

    return run


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


@pytest.fixture
def patch():
    """The deck of one stretched element, for CalculiX; what is named replaces a part of it."""
    return lambda **parts: PATCH.format(**PATCH_PARTS | parts)


class _LineHandler(logging.Handler):
    def __init__(self):
        super().__init__(logging.INFO)
        self.lines = []

    def emit(self, record):
        self.lines.append(getattr(record, "remark", record.getMessage()))


@pytest.fixture
def logged():
    """Lines that the package logs during a test, without the path of the file that is read."""
    logger, handler = logging.getLogger("fembridge"), _LineHandler()
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    yield handler.lines
    logger.removeHandler(handler)
    logger.setLevel(level)


@pytest.fixture(scope="session")
def chromium():
    """A headless Chromium, started once; its `open` loads a page."""
    spec = importlib.util.spec_from_file_location("chromium", ROOT / "tests/chromium.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    if module.find_chromium() is None:
        pytest.skip("no Chromium")
    with module.Chromium() as browser:
        yield browser
