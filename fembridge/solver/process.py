"""A solver as a process of its own, which ends when we do, however we end.

This file is also a program, started by path before every solver: it asks to be killed when
the process that started it dies, and becomes the solver. Linux then kills the solver when
the thread that started it ends, be it by ``kill -9``. A solver that is a script hands this
on when it ends in ``exec``. Elsewhere than on Linux there is no such wish, and the solver is
merely started. (A fork that sets this up inside the parent would run Python between fork and
exec, which may hang in a process with threads.) So little is imported here.
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
"""From the request to end until it is no longer a request."""
THREAD_VARIABLE = "OMP_NUM_THREADS"
THREAD_OVERRIDES = (
    "CCX_NPROC_EQUATION_SOLVER",
    "CCX_NPROC_RESULTS",
    "CCX_NPROC_STIFFNESS",
    "NUMBER_OF_CPUS",
)
PR_SET_PDEATHSIG = 1  # linux/prctl.h
CANNOT_RUN = 127  # as shells have it


def start(
    program: "Path", words: "Sequence[str]", folder: "Path", log: "Path", threads: int | None = None
) -> "Popen[bytes]":
    """Start `program` in `folder`, with all its output going to the file `log`.

    It leads a session of its own, so that Ctrl-C in a terminal reaches us alone and
    we decide; all that it starts is in its group and ends with it. The system's wish to kill
    it when we are killed is bound to the *thread* that starts it, so this thread has to stay
    until the solver has ended.
    """
    import subprocess

    command = [str(program), *words]
    if sys.executable:  # absent where Python is inside another program
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
    """End `process` and all it started: asked first, killed after `grace_s`.

    A second Ctrl-C during the grace kills at once. The process is not reaped
    before the last signal is sent, so its number cannot be another's by then.
    """
    import time

    if process.returncode is not None:
        return
    still_running = os.WEXITED | os.WNOHANG | os.WNOWAIT
    try:
        os.waitid(os.P_PID, process.pid, still_running)
    except ChildProcessError:  # reaped by a wait that Ctrl-C broke off: its number is free
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
    """Let SIGTERM and SIGHUP unwind the main thread, as Ctrl-C does.

    Left alone they end Python on the spot. Handlers that someone has set, and
    those of ``nohup``, are respected; other threads have none to set.
    """
    import threading

    ours = []
    if threading.current_thread() is threading.main_thread():
        numbers = (signal.SIGTERM, signal.SIGHUP)
        ours = [number for number in numbers if signal.getsignal(number) is signal.SIG_DFL]
    for number in ours:
        signal.signal(number, _exit_by_signal)
    try:
        yield
    finally:
        for number in ours:
            signal.signal(number, signal.SIG_DFL)


def _exit_by_signal(number: int, frame: "FrameType | None") -> None:
    raise SystemExit(128 + number)


def _signal_group(leader: int, number: int) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(leader, number)


def become(parent: int, program: str, words: list[str]) -> int:
    """Replace this process by `program`; come back only when that fails."""
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it died before the wish was made
        return CANNOT_RUN
    for number in (signal.SIGPIPE, signal.SIGXFSZ):  # which Python ignores
        signal.signal(number, signal.SIG_DFL)
    try:
        os.execv(program, [program, *words])
    except OSError as error:
        print(f"{program} cannot be run: {error.strerror}", file=sys.stderr)
        return CANNOT_RUN


if __name__ == "__main__":
    sys.exit(become(int(sys.argv[1]), sys.argv[2], sys.argv[3:]))
