"""The solver as a process of ours: it never outlives us, and it stops when told.

It leads a session of its own, so that Ctrl-C in a terminal reaches us alone and
we decide; all that it starts is in its group and ends with it. `guard` has the
system kill it when we are killed. That wish is bound to the *thread* that
starts it, so this thread has to stay until the solver has ended.
"""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import FrameType

from fembridge.solvers import guard

GRACE_S = 3.0
"""From the request to end until it is no longer a request."""

THREAD_VARIABLE = "OMP_NUM_THREADS"
THREAD_OVERRIDES = (
    "CCX_NPROC_EQUATION_SOLVER",
    "CCX_NPROC_RESULTS",
    "CCX_NPROC_STIFFNESS",
    "NUMBER_OF_CPUS",
)


def start(
    program: Path, words: Sequence[str], folder: Path, log: Path, threads: int | None = None
) -> subprocess.Popen[bytes]:
    """Start `program` in `folder`, with all it says going to the file `log`.

    Parameters
    ----------
    threads
        For the solver's OpenMP; None leaves the environment as it is.
    """
    command = [str(program), *words]
    if sys.executable:  # absent where Python is inside another program
        wish = [sys.executable, "-I", "-S", guard.__file__, str(os.getpid())]
        command = wish + command
    with log.open("wb") as out:
        return subprocess.Popen(
            command,
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=subprocess.STDOUT,
            env=_environment(os.environ, threads),
            start_new_session=True,
        )


def stop(process: subprocess.Popen[bytes], grace_s: float = GRACE_S) -> None:
    """End `process` and all it started: asked first, killed after `grace_s`.

    A second Ctrl-C during the grace kills at once. The process is not reaped
    before the last signal is sent, so its number cannot be another's by then.
    """
    if process.returncode is not None:
        return
    try:
        _signal_group(process.pid, signal.SIGTERM)
        until_s = time.monotonic() + grace_s
        while not _has_ended(process.pid) and time.monotonic() < until_s:
            time.sleep(0.02)
    finally:
        _signal_group(process.pid, signal.SIGKILL)
        process.wait()


@contextlib.contextmanager
def signals_as_exits() -> Iterator[None]:
    """Let SIGTERM and SIGHUP unwind the main thread, as Ctrl-C does.

    Left alone they end Python on the spot. Handlers that someone has set, and
    those of ``nohup``, are respected; other threads have none to set.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    ours = [
        number
        for number in (signal.SIGTERM, signal.SIGHUP)
        if signal.getsignal(number) is signal.SIG_DFL
    ]
    for number in ours:
        signal.signal(number, _exit_by_signal)
    try:
        yield
    finally:
        for number in ours:
            signal.signal(number, signal.SIG_DFL)


def _exit_by_signal(number: int, frame: FrameType | None) -> None:
    raise SystemExit(128 + number)


def _environment(inherited: Mapping[str, str], threads: int | None) -> dict[str, str]:
    if threads is None:
        return dict(inherited)
    kept = {k: v for k, v in inherited.items() if k not in THREAD_OVERRIDES}
    return kept | {THREAD_VARIABLE: str(threads)}


def _signal_group(leader: int, number: int) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(leader, number)


def _has_ended(pid: int) -> bool:
    """Whether a child is over, without reaping it."""
    flags = os.WEXITED | os.WNOHANG | os.WNOWAIT
    return os.waitid(os.P_PID, pid, flags) is not None
