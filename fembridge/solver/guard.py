"""Become the solver, after asking to be killed when the process that asked dies.

Started as a program, by path, before every solver: Linux then kills the solver
when the thread that started it ends, be it by ``kill -9``. A solver that is a
script hands this on when it ends in ``exec``. Elsewhere than on Linux there is
no such wish, and the solver is merely started.

A fork that sets this up inside the parent would run Python between fork and
exec, which may hang in a process with threads.
"""

import os
import signal
import sys

PR_SET_PDEATHSIG = 1  # linux/prctl.h
CANNOT_RUN = 127  # as shells have it


def main(parent: int, program: str, words: list[str]) -> int:
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
    sys.exit(main(int(sys.argv[1]), sys.argv[2], sys.argv[3:]))
