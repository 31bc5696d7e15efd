"""One run at a time in a folder, on this machine and across processes."""

import contextlib
import errno
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path

from fembridge.errors import OutputError
from fembridge.solvers.outcome import Cause, Failure

LOCK_FILE = ".solver.lock"
_NO_LOCKS_HERE = {errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP}


@contextlib.contextmanager
def folder_lock(folder: Path) -> Iterator[Failure | None]:
    """Hold `folder`; give the failure to report when another run holds it.

    The lock is the kernel's, so a process that dies in any way gives it up; its
    file, which names the holder, is gone after an orderly end. A file system
    without locks is used without.

    Raises
    ------
    OutputError
        The folder cannot be written.
    """
    path = folder / LOCK_FILE
    handle = _take(path)
    if isinstance(handle, Failure):
        yield handle
        return
    try:
        yield None
    finally:
        path.unlink(missing_ok=True)
        os.close(handle)


def _take(path: Path) -> int | Failure:
    while True:
        try:
            handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        except OSError as error:
            raise OutputError(f"cannot write here: {error.strerror}", path.parent) from (error)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.read(handle, 20).decode("ascii", "replace").strip()
            os.close(handle)
            who = f"process {holder}" if holder else "a process that just began"
            return Failure(Cause.BUSY, f"{who} holds it", "wait for it, or end it")
        except OSError as error:
            if error.errno not in _NO_LOCKS_HERE:
                os.close(handle)
                raise OutputError(f"cannot be locked: {error.strerror}", path) from error
        if _is_still(handle, path):
            os.truncate(handle, 0)
            os.write(handle, f"{os.getpid()}\n".encode("ascii"))
            return handle
        os.close(handle)  # its last holder took the file away meanwhile


def _is_still(handle: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(handle), path.stat())
    except FileNotFoundError:
        return False
