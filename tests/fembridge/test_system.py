"""Systems without file locks, process groups and some signals, as Windows: simulated."""

import subprocess
import sys

# What Windows lacks of the standard library.
_PRELUDE = """
import importlib.abc, os, signal, subprocess, sys

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


def test_a_process_without_groups_is_ended_alone():
    code = """
from fembridge.host.process import HAS_GROUPS, stop
assert not HAS_GROUPS
process = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
stop(process, 5.0)
print(process.returncode)
"""
    assert int(_run(code)) != 0
