"""Where operating systems differ: locks of open folders, flags of opening, signals.

Linux and macOS have all of it. Windows opens no folders, so that a folder is not locked there;
it writes to disk only what is open for writing, and keeps others from the bytes of a locked file.
"""

import os
import signal
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment] # a module elsewhere

# Flags of `os.open`, 0 where the system has none: no link, no waiting for a pipe, a folder only.
NO_LINK: int = getattr(os, "O_NOFOLLOW", 0)
NO_WAIT: int = getattr(os, "O_NONBLOCK", 0)
FOLDER_ONLY: int = getattr(os, "O_DIRECTORY", 0)


OPENS_FOLDERS: bool = fcntl is not None
"""Whether a folder has a handle, for names in it and for its lock."""
LOCKS_ARE_ADVISORY: bool = fcntl is not None
"""Whether a locked file can be read and written by those who ask for no lock."""


def flush_to_disk(path: Path) -> None:
    """Wait until the content of the file `path` is on the disk."""
    with path.open("rb" if fcntl else "r+b") as file:
        os.fsync(file.fileno())


def open_folder(folder: Path, flags: int = 0) -> int | None:
    """Handle of `folder`, None on a system that opens none; to be closed by `close_folder`."""
    return os.open(folder, os.O_RDONLY | flags) if fcntl else None


def lock_folder(handle: int | None, *, wait: bool = True) -> None:
    """Lock an open folder until its handle is closed.

    Raises
    ------
    OSError
        Another process has it and `wait` is false, or the file system has no locks.
    """
    if fcntl is None or handle is None:
        raise OSError("no locks of folders on this system")
    fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))


def close_folder(handle: int | None) -> None:
    """Close a handle of `open_folder`, which also unlocks it."""
    if handle is not None:
        os.close(handle)


def signal_numbers(*names: str) -> tuple[int, ...]:
    """Numbers of the signals `names` that this system has."""
    return tuple(getattr(signal, name) for name in names if hasattr(signal, name))


def children_s() -> float:
    """Processor time of all finished child processes in s."""
    used = os.times()
    return used.children_user + used.children_system
