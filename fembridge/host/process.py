"""A solver in a separate process that ends with its parent, even after ``kill -9``.

This file is also a program, started by path before every solver: it requests a signal for
the death of its parent (Linux ``PR_SET_PDEATHSIG``) and replaces itself by the solver. Linux
then kills the solver when the thread that started it ends. A solver script keeps the request
if it ends in ``exec``. On other systems the solver is started without this request. (Code
between fork and exec in the parent could hang in a process with threads.) Imports are few,
since this program runs before every solver.
"""

import contextlib
import os
import signal
import sys

TYPE_CHECKING = False  # `typing` would be a third of what this takes before every solver
if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path
    from subprocess import Popen
    from types import FrameType

GRACE_S = 3.0
"""Seconds from SIGTERM to SIGKILL."""
THREAD_VARIABLE = "OMP_NUM_THREADS"
THREAD_OVERRIDES = (
    "CCX_NPROC_EQUATION_SOLVER",
    "CCX_NPROC_RESULTS",
    "CCX_NPROC_STIFFNESS",
    "NUMBER_OF_CPUS",
)
PR_SET_PDEATHSIG = 1  # linux/prctl.h
HAS_GROUPS = hasattr(os, "killpg") and hasattr(os, "waitid")
"""Whether a process can lead a group that ends with it: on Linux and macOS, not on Windows."""
CANNOT_RUN = 127  # exit code of shells for a command that cannot be run


def start(
    program: "Path",
    arguments: "Sequence[str]",
    folder: "Path",
    log: "Path",
    threads: int | None = None,
) -> "Popen[bytes]":
    """Process of `program`, started in `folder` with all its output in the file `log`.

    It leads its own session, so that Ctrl-C in a terminal reaches fembridge only; all its
    child processes are in its group and end with it. Linux kills it when the *thread* that
    starts it ends, so this thread must live until the solver has ended.
    """
    import subprocess

    command = [str(program), *arguments]
    if sys.executable and HAS_GROUPS:  # absent where Python is inside another program
        command = [sys.executable, "-I", "-S", __file__, str(os.getpid()), *command]
    environment = dict(os.environ)
    if threads is not None:
        environment = {k: v for k, v in environment.items() if k not in THREAD_OVERRIDES}
        environment[THREAD_VARIABLE] = str(threads)
    with log.open("wb") as out:
        return subprocess.Popen(
            command,
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=subprocess.STDOUT,
            env=environment,
            start_new_session=True,
        )


def stop(process: "Popen[bytes]", grace_s: float = GRACE_S) -> None:
    """End `process` and its children: SIGTERM first, SIGKILL after `grace_s` seconds.

    A second Ctrl-C during this time kills at once. The process is not reaped before the
    last signal is sent, so no other process can have its number. A system without process groups
    (Windows) ends `process` alone.
    """
    import subprocess
    import time

    if process.returncode is not None:
        return
    if not HAS_GROUPS:
        process.terminate()
        try:
            process.wait(grace_s)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        return
    still_running = os.WEXITED | os.WNOHANG | os.WNOWAIT
    try:
        os.waitid(os.P_PID, process.pid, still_running)
    except ChildProcessError:  # reaped by a wait that Ctrl-C interrupted: its number is free
        process.wait()
        return
    try:
        _signal_group(process.pid, signal.SIGTERM)
        until_s = time.monotonic() + grace_s
        while time.monotonic() < until_s:
            if os.waitid(os.P_PID, process.pid, still_running) is not None:
                break
            time.sleep(0.02)
    finally:
        _signal_group(process.pid, signal.SIGKILL)
        process.wait()


@contextlib.contextmanager
def signals_as_exits() -> "Iterator[None]":
    """Let SIGTERM and SIGHUP raise SystemExit in the main thread, as Ctrl-C raises its error.

    By default they end Python at once. Other handlers, such as those of ``nohup``, are
    kept; threads other than the main one set none.
    """
    import threading

    replaced = []
    if threading.current_thread() is threading.main_thread():
        from fembridge.host.system import signal_numbers

        numbers = signal_numbers("SIGTERM", "SIGHUP")
        replaced = [number for number in numbers if signal.getsignal(number) is signal.SIG_DFL]
    for number in replaced:
        signal.signal(number, _exit_by_signal)
    try:
        yield
    finally:
        for number in replaced:
            signal.signal(number, signal.SIG_DFL)


def _exit_by_signal(number: int, frame: "FrameType | None") -> None:
    raise SystemExit(128 + number)


def _signal_group(leader: int, number: int) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(leader, number)


def become_solver(parent: int, program: str, arguments: list[str]) -> int:
    """Replace this process by `program`; the exit code where that fails."""
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # the parent died before the request
        return CANNOT_RUN
    for number in (signal.SIGPIPE, signal.SIGXFSZ):  # which Python ignores
        signal.signal(number, signal.SIG_DFL)
    try:
        os.execv(program, [program, *arguments])
    except OSError as error:
        print(f"{program} cannot be run: {error.strerror}", file=sys.stderr)
        return CANNOT_RUN


if __name__ == "__main__":
    sys.exit(become_solver(int(sys.argv[1]), sys.argv[2], sys.argv[3:]))
