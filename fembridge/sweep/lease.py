"""Whose work a folder is: one owner at a time, over processes, machines and deaths.

Owners are numbered. ``.lease.1`` names the first; who takes over from a dead owner
makes ``.lease.2``, which the file system lets one process do and no other. The
highest number is the owner, an empty file a folder that was given back. The highest
file is never removed, so no number is given twice.

An owner on this machine is dead when no process of its number and start time is
there. One elsewhere is dead when its file has not been touched for `SILENCE_S` of
*our* time: clocks are never compared.
"""

import contextlib
import json
import os
import socket
import threading
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from fembridge.errors import OutputError
from fembridge.store import make_folder

PREFIX = ".lease."
HEARTBEAT_S = 15.0
SILENCE_S = 120.0
"""Longer than a file server keeps us from seeing another machine's touch (60 s)."""

FIRST_LOOK_S = 0.1
SLOWEST_LOOK_S = 2.0


@dataclass(frozen=True, slots=True)
class Owner:
    """A process, on a machine that has not been started again since."""

    machine: str
    pid: int
    start: str
    token: str

    @classmethod
    def here(cls) -> "Owner":
        """Give this process, with a word that no other owner has."""
        pid = os.getpid()
        return cls(_machine(), pid, _start_of(pid) or "", os.urandom(8).hex())

    @property
    def is_local(self) -> bool:
        """Whether its number means a process to us."""
        return self.machine == _machine()

    @property
    def is_gone(self) -> bool:
        """Whether it was here and is no more; elsewhere that cannot be told."""
        return self.is_local and _start_of(self.pid) != self.start


class BusyError(Exception):
    """Somebody alive owns the folder, and we were not to wait."""


class Lease:
    """A folder that is ours as long as nobody thought us dead."""

    def __init__(self, path: Path, owner: Owner) -> None:
        self._path, self._owner = path, owner
        self._over = threading.Event()

    def is_held(self) -> bool:
        """Whether it still is: asked before anything is published."""
        last = _last(self._path.parent)
        return last is not None and last == self._path and _read(last) == self._owner

    def keep(self, heartbeat_s: float) -> None:
        """Touch the file until `give_back`, from a thread of its own."""
        while not self._over.wait(heartbeat_s):
            with contextlib.suppress(OSError):
                os.utime(self._path)

    def give_back(self) -> None:
        """Empty the file: takes no room, so it works on a full disk too."""
        self._over.set()
        if self.is_held():
            with contextlib.suppress(OSError):
                os.truncate(self._path, 0)


@contextlib.contextmanager
def leased(
    folder: Path,
    *,
    patient: bool = True,
    heartbeat_s: float = HEARTBEAT_S,
    silence_s: float = SILENCE_S,
) -> Iterator[Lease]:
    """Own `folder`; wait as long as somebody alive does.

    Raises
    ------
    BusyError
        Somebody does, and we are not `patient`.
    OutputError
        The folder cannot be made or written.
    """
    make_folder(folder)
    owner = Owner.here()
    watch = _Watch(silence_s)
    pause_s = FIRST_LOOK_S
    while (lease := _take(folder, owner, watch)) is None:
        if not patient:
            raise BusyError
        time.sleep(pause_s)
        pause_s = min(1.5 * pause_s, SLOWEST_LOOK_S)
    threading.Thread(target=lease.keep, args=(heartbeat_s,), daemon=True).start()
    try:
        yield lease
    finally:
        lease.give_back()


class _Watch:
    """What was seen of an owner elsewhere, and since when by our own clock."""

    def __init__(self, silence_s: float) -> None:
        self._silence_s = silence_s
        self._seen: tuple[Path, int] | None = None
        self._since_s = 0.0

    def is_silent(self, path: Path) -> bool:
        try:
            stamp = path, path.stat().st_mtime_ns
        except OSError:  # taken over meanwhile
            return False
        if stamp != self._seen:
            self._seen, self._since_s = stamp, time.monotonic()
        return time.monotonic() - self._since_s > self._silence_s


def _take(folder: Path, owner: Owner, watch: _Watch) -> Lease | None:
    """Become the owner if nobody alive is; the first of several wins."""
    last = _last(folder)
    found = _read(last) if last is not None else None
    if last is not None and found is not None:
        is_dead = found.is_gone if found.is_local else watch.is_silent(last)
        if not is_dead:
            return None
    path = folder / f"{PREFIX}{_number(last) + 1}"
    if not _create(path, json.dumps(asdict(owner))):
        return None
    if _last(folder) != path:  # a number that was cleared away after we had looked
        path.unlink(missing_ok=True)
        return None
    for old in _all(folder)[:-1]:
        with contextlib.suppress(OSError):
            old.unlink()
    return Lease(path, owner)


def _create(path: Path, text: str) -> bool:
    """Make a file that is whole from its first moment; False: it is there already."""
    draft = path.with_name(f".draft.{os.urandom(8).hex()}")
    try:
        draft.write_text(text, encoding="utf-8")
        os.link(draft, path)
    except FileExistsError:
        return False
    except OSError as error:
        raise OutputError(f"cannot be claimed: {error.strerror}", path.parent) from error
    finally:
        draft.unlink(missing_ok=True)
    return True


def _all(folder: Path) -> list[Path]:
    """Give all lease files, the owner's last."""
    try:
        return sorted(filter(_number, folder.iterdir()), key=_number)
    except OSError:
        return []


def _last(folder: Path) -> Path | None:
    return next(iter(_all(folder)[::-1]), None)


def _number(path: Path | None) -> int:
    """Give the number of an owner; 0 for what is no lease file."""
    if path is None or not path.name.startswith(PREFIX):
        return 0
    word = path.name.removeprefix(PREFIX)
    return int(word) if word.isascii() and word.isdigit() else 0


def _read(path: Path) -> Owner | None:
    """Give the owner; None: given back, or no owner that we could have written."""
    try:
        return Owner(**json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return None


def _machine() -> str:
    """Name this machine since it was started, and where process numbers count."""
    words = [socket.gethostname()]
    with contextlib.suppress(OSError):
        words.append(Path("/proc/sys/kernel/random/boot_id").read_text().strip())
    with contextlib.suppress(OSError):
        words.append(os.readlink("/proc/self/ns/pid"))  # noqa: PTH115 - no path
    return " ".join(words)


def _start_of(pid: int) -> str | None:
    """Tell when a process began, in the system's own count; None: there is none."""
    if not Path("/proc/self/stat").exists():
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return None
        except PermissionError:
            return ""
        return ""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    state, *rest = stat.rpartition(")")[2].split()
    return None if state in "ZX" else rest[18]
