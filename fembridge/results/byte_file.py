"""A file read at offsets: what a walk from block to block needs.

``pread`` and not ``mmap``: a mapped file that another process cuts short kills
the reader with SIGBUS; here it is an error with words. The size is taken once,
when the file is opened: a run that is still writing does not move the end.
"""

import os
import stat
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from types import TracebackType

from fembridge.errors import ResultError

WINDOW_BYTES = 4096  # holds the header of a block with 100 components
CHUNK_BYTES = 1 << 20


class ByteFile:
    """The bytes of `path`, by offset; a context manager that closes it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        except FileNotFoundError as error:
            raise ResultError(f"no such file{_near(path)}", path) from error
        except OSError as error:
            raise ResultError(f"cannot be opened: {error.strerror}", path) from error
        about = os.fstat(self._handle)
        if not stat.S_ISREG(about.st_mode):
            os.close(self._handle)
            kind = "a folder" if stat.S_ISDIR(about.st_mode) else "a pipe or a device"
            raise ResultError(f"{kind}, expected a result file", path)
        self.size = about.st_size
        self._window, self._window_at = b"", 0

    def __enter__(self) -> "ByteFile":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        os.close(self._handle)

    def take(self, offset: int, length: int) -> bytes:
        """Give exactly `length` bytes from `offset`.

        Raises
        ------
        ResultError
            The file has no such bytes, or has become shorter since it was opened.
        """
        if offset < 0 or length < 0 or offset + length > self.size:
            raise ResultError(
                f"{length} bytes expected at byte {offset}, the file has {self.size}",
                self.path,
            )
        found = self._pread(offset, length)
        if len(found) < length:
            raise ResultError(
                f"ends at byte {offset + len(found)}, it had {self.size} bytes when "
                "it was opened: something else is writing it",
                self.path,
            )
        return found

    def peek(self, offset: int, length: int) -> bytes:
        """Give up to `length` bytes from `offset`; fewer at the end."""
        return self._pread(offset, max(0, min(length, self.size - offset)))

    def line(self, offset: int) -> tuple[bytes, int] | None:
        """Give the line at `offset` without its end, and where the next begins.

        None when no line end follows within `WINDOW_BYTES`: the line is cut by
        the end of the file, or this is no text.
        """
        end = -1
        if self._window_at <= offset:
            end = self._window.find(b"\n", offset - self._window_at)
        if end < 0:
            self._window, self._window_at = self.peek(offset, WINDOW_BYTES), offset
            end = self._window.find(b"\n")
        if end < 0:
            return None
        line = self._window[offset - self._window_at : end]
        return line.removesuffix(b"\r"), self._window_at + end + 1

    def find(self, markers: Sequence[bytes], offset: int) -> tuple[int, bytes] | None:
        """Give the first place from `offset` where one of `markers` stands."""
        overlap = max(map(len, markers)) - 1
        while offset < self.size:
            chunk = self.peek(offset, CHUNK_BYTES + overlap)
            hits = [(chunk.find(marker), marker) for marker in markers]
            hits = [(at, marker) for at, marker in hits if at >= 0]
            if hits:
                at, marker = min(hits)
                return offset + at, marker
            offset += CHUNK_BYTES
        return None

    def count(self, marker: bytes, offset: int, end: int) -> int:
        """Count `marker` from `offset` to `end`; it must not overlap itself."""
        total, overlap = 0, len(marker) - 1
        while offset < end:
            length = min(CHUNK_BYTES + overlap, end - offset)
            total += self.peek(offset, length).count(marker)
            offset += CHUNK_BYTES
        return total

    def _pread(self, offset: int, length: int) -> bytes:
        try:
            found = os.pread(self._handle, length, offset)
            while len(found) < length:  # a signal or a network disk may give less
                more = os.pread(self._handle, length - len(found), offset + len(found))
                if not more:
                    break
                found += more
        except OSError as error:
            raise ResultError(f"cannot be read: {error.strerror}", self.path) from error
        return found


def _near(path: Path) -> str:
    try:
        names = [other.name for other in path.parent.iterdir()]
    except OSError:
        return f": there is no folder {path.parent}"
    near = get_close_matches(path.name, names, n=3)
    return f"; near it: {', '.join(near)}" if near else ""
