"""Systems without file locks, process groups and some signals, as Windows: simulated."""

import subprocess
import sys

import pytest

# What Windows lacks of the standard library.
_PRELUDE = """
import fcntl, importlib.abc, os, shutil, signal, subprocess, sys

class Absent(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name in ("fcntl", "resource", "pwd", "grp", "termios", "tty"):
            raise ImportError(f"no module named {name}", name=name)

import pandas, scipy.linalg, matplotlib.figure, tempfile, rich.console  # they know their system
for name in ("fcntl", "resource", "pwd", "grp", "termios", "tty"):
    sys.modules.pop(name, None)
sys.meta_path.insert(0, Absent())
for name in ("killpg", "waitid", "WNOWAIT", "O_NOFOLLOW", "O_NONBLOCK", "O_DIRECTORY",
             "sched_getaffinity", "sysconf", "getuid", "fork"):
    if hasattr(os, name):
        delattr(os, name)

real_open, real_fsync, get_flags = os.open, os.fsync, fcntl.fcntl
real_stat, real_temporary, temporary_files = os.stat, tempfile.NamedTemporaryFile, []
GETFL, ACCESS = fcntl.F_GETFL, os.O_RDWR | os.O_WRONLY

def open_as_windows(path, flags, mode=0o777, *, dir_fd=None):
    if dir_fd is not None:
        raise NotImplementedError("dir_fd unavailable on this platform")
    if os.path.isdir(path):
        raise PermissionError(13, "Permission denied", str(path))
    if os.path.basename(path).endswith(".lock") and flags & ACCESS and is_of_fembridge():
        raise PermissionError(13, "Permission denied", str(path))  # its first byte is locked
    if any(not file.closed and file.name == str(path) for file in temporary_files):
        raise PermissionError(13, "Permission denied", str(path))  # it is opened once only
    return real_open(path, flags, mode)

def stat_as_windows(path, **how):
    if str(path).startswith("/proc"):
        raise FileNotFoundError(2, "No such file or directory", str(path))
    return real_stat(path, **how)

def temporary_as_windows(*words, **settings):
    temporary_files.append(real_temporary(*words, **settings))
    return temporary_files[-1]

def is_of_fembridge():
    return sys._getframe(2).f_globals["__name__"].startswith("fembridge.")

def fsync_as_windows(handle):
    if not get_flags(handle, GETFL) & ACCESS:
        raise OSError(9, "Bad file descriptor")
    real_fsync(handle)

os.open, os.fsync, shutil._use_fd_functions = open_as_windows, fsync_as_windows, False
os.stat, tempfile.NamedTemporaryFile = stat_as_windows, temporary_as_windows
del fcntl
for name in ("SIGHUP", "SIGKILL", "SIGXFSZ", "SIGPIPE", "SIGBUS", "SIGSYS"):
    if hasattr(signal, name):
        delattr(signal, name)
"""


def _run(code: str, *arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", _PRELUDE + code, *arguments],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_every_module_can_be_imported_without_what_windows_lacks():
    code = """
import importlib, pkgutil
import decks, fembridge, neural
count = 0
for package in (fembridge, decks, neural):
    for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        importlib.import_module(module.name)
        count += 1
print(count)
"""
    assert int(_run(code)) > 100


def test_a_touch_is_computed_and_written_without_locks(tmp_path):
    code = """
import fembridge as fb
touched = fb.touch(press_um=300, population="one_each", ridges="none")
touched.write(sys.argv[1])
again = fb.Touch.read(sys.argv[1])
assert again.spikes.equals(touched.spikes)
print(sorted(os.listdir(sys.argv[1])))
"""
    assert "spikes.csv" in _run(code, str(tmp_path / "touched"))


@pytest.mark.slow
def test_a_process_without_groups_is_ended_alone():
    code = """
from fembridge.host.process import HAS_GROUPS, stop
assert not HAS_GROUPS
process = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
stop(process, 5.0)
print(process.returncode)
"""
    assert int(_run(code)) != 0


@pytest.mark.slow
def test_a_result_file_is_read_without_flags_of_linux(tmp_path):
    code = """
from fembridge.cli import main
folder = sys.argv[1]
assert main(["sample", "frd", "-o", folder]) in (0, None)
assert main(["ingest", folder + "/job.frd", "-o", folder + "/traces.csv"]) in (0, None)
print(sorted(os.listdir(folder)))
"""
    assert "traces.csv" in _run(code, str(tmp_path / "sample"))


@pytest.mark.slow
def test_a_packed_result_file_is_read_where_a_temporary_file_is_opened_once_only(tmp_path):
    code = """
import gzip
from pathlib import Path
from fembridge.cli import main
folder = Path(sys.argv[1])
tempfile.tempdir = str(folder / "temporary")
(folder / "temporary").mkdir(parents=True)
assert main(["sample", "frd", "-o", str(folder / "run")]) in (0, None)
for name in ("job.frd", "job.dat"):
    content = (folder / "run" / name).read_bytes()
    (folder / name).write_bytes(content)
    (folder / f"{name}.gz").write_bytes(gzip.compress(content))
nodes = ["--node", "367", "--node", "461"]
for file, table in (("job.frd", "plain.csv"), ("job.frd.gz", "packed.csv")):
    assert main(["ingest", str(folder / file), *nodes, "-o", str(folder / table)]) in (0, None)
assert main(["ingest", "--list", str(folder / "job.dat.gz")]) in (0, None)
same = (folder / "plain.csv").read_bytes() == (folder / "packed.csv").read_bytes()
print("same", same, len(temporary_files))
"""
    assert "same True 2" in _run(code, str(tmp_path))
    assert list((tmp_path / "temporary").iterdir()) == []


@pytest.mark.slow
def test_a_locked_folder_is_worked_in_where_a_locked_file_cannot_be_written(tmp_path):
    code = """
import warnings
from pathlib import Path
warnings.filterwarnings("ignore", "only soft file lock")  # the stand-in for the one of Windows
from fembridge.errors import LockedError
from fembridge.host.store import folder_lock
folder = Path(sys.argv[1])
with folder_lock(folder, "run.lock", wait=False):
    try:
        with folder_lock(folder, "run.lock", wait=False):
            print("both are in")
    except LockedError as error:
        print(error)
"""
    assert "is at work here" in _run(code, str(tmp_path))


@pytest.mark.slow
def test_nothing_is_kept_in_a_cache_that_could_not_be_read_again(tmp_path):
    code = """
from pathlib import Path
from fembridge.host import cache
folder = Path(sys.argv[1])
os.environ["FEMBRIDGE_CACHE"] = str(folder / "cache")
(folder / "job.frd").write_text("result")
cache.keep("0" * 32, "a run", {}, [folder / "job.frd"])
print(sorted(os.listdir(folder)), cache.entries())
"""
    assert _run(code, str(tmp_path)) == "['job.frd'] []\n"
