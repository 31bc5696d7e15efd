"""A file read at offsets, and the lines of a text file.

``pread`` and not ``mmap``: a mapped file that another process cuts short kills
the reader with SIGBUS; here it is an error with words. The size is taken once,
when the file is opened: a run that is still writing does not move the end, and
`change` says that it was.
"""

import os
import stat
from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from pathlib import Path
from types import TracebackType

from fembridge.errors import ResultError

WINDOW_BYTES = 4096  # holds the header of a block with 100 components
CHUNK_BYTES = 1 << 20
LONGEST_LINE = 1 << 16
_SMALL_BYTES = 1024  # up to so many, look into the window first
_BLOCK_BYTES = 1 << 18


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
        self._stamp = about.st_size, about.st_mtime_ns
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
        """Exactly `length` bytes from `offset`, which the file must have."""
        if offset < 0 or length < 0 or offset + length > self.size:
            raise ResultError(
                f"{length} bytes expected at byte {offset}, the file has {self.size}", self.path
            )
        found = self.peek(offset, length)
        if len(found) < length:
            raise ResultError(
                f"ends at byte {offset + len(found)}, it had {self.size} bytes when "
                "it was opened: something else is writing it",
                self.path,
            )
        return found

    def peek(self, offset: int, length: int) -> bytes:
        """Up to `length` bytes from `offset`; fewer at the end."""
        length = max(0, min(length, self.size - offset))
        if length > _SMALL_BYTES:
            return self._pread(offset, length)
        start = offset - self._window_at
        if start < 0 or start + length > len(self._window):
            self._open_window(offset)
            start = 0
        return self._window[start : start + length]

    def holds(self, offset: int, text: bytes) -> bool:
        """Whether `text` is at `offset`."""
        start = offset - self._window_at
        if start < 0 or start + len(text) > len(self._window):
            return self.peek(offset, len(text)) == text
        return self._window.startswith(text, start)

    def line(self, offset: int) -> tuple[bytes, int] | None:
        """The line at `offset` without its end, and where the next begins.

        None when no line end follows within `WINDOW_BYTES`: `why_no_line` says
        whether the line is cut by the end of the file, or this is no text.
        """
        end = -1
        if self._window_at <= offset:
            end = self._window.find(b"\n", offset - self._window_at)
        if end < 0:
            self._open_window(offset)
            end = self._window.find(b"\n")
        if end < 0:
            return None
        line = self._window[offset - self._window_at : end]
        return line.removesuffix(b"\r"), self._window_at + end + 1

    def why_no_line(self, offset: int) -> str:
        """Why `line` found none at `offset`."""
        if self.size - offset > WINDOW_BYTES:
            return f"a line of more than {WINDOW_BYTES} bytes, which is no line"
        return "cut inside a line"

    @property
    def change(self) -> str | None:
        """How the file has changed since it was opened; None if it has not."""
        about = os.fstat(self._handle)
        if (about.st_size, about.st_mtime_ns) == self._stamp:
            return None
        if about.st_size == self.size:
            return "it was written to while it was read"
        word = "grew" if about.st_size > self.size else "shrank"
        return (
            f"it {word} from {self.size} to {about.st_size} bytes while it was read: "
            "something is still writing it"
        )

    def find(self, markers: Sequence[bytes], offset: int) -> tuple[int, bytes] | None:
        """The first place from `offset` with one of `markers`, and which."""
        overlap = max(map(len, markers)) - 1
        length = WINDOW_BYTES  # the place is often near
        while offset < self.size:
            chunk = self._pread(offset, min(length + overlap, self.size - offset))
            best: tuple[int, bytes] | None = None
            for marker in markers:
                if chunk.find(marker[:1].strip(b" ") or marker[-1:]) < 0:
                    continue  # a single byte is sought ten times as fast
                stop = len(chunk) if best is None else best[0] + len(marker)
                at = chunk.find(marker, 0, stop)
                if at >= 0 and (best is None or at < best[0]):
                    best = at, marker
            if best is not None:
                return offset + best[0], best[1]
            offset += length
            length = min(4 * length, CHUNK_BYTES)
        return None

    def count(self, marker: bytes, offset: int, end: int) -> int:
        """How often `marker`, which does not overlap itself, is between `offset` and `end`."""
        total, overlap = 0, len(marker) - 1
        while offset < end:
            length = min(CHUNK_BYTES + overlap, end - offset)
            total += self.peek(offset, length).count(marker)
            offset += CHUNK_BYTES
        return total

    def _open_window(self, offset: int) -> None:
        length = max(0, min(WINDOW_BYTES, self.size - offset))
        self._window, self._window_at = self._pread(offset, length), offset

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


def text_lines(path: Path) -> Iterator[tuple[int, str, bool]]:
    """Number, text and whether a line end closes it, for each line, in bounded memory.

    Bytes are read as Latin-1. What has no line ends (something else under a known
    name, a hole that a full disk left) is refused after `LONGEST_LINE` bytes.
    """
    with ByteFile(path) as file:
        number, rest = 0, b""
        for at in range(0, file.size, _BLOCK_BYTES):
            block = rest + file.take(at, min(_BLOCK_BYTES, file.size - at))
            *lines, rest = block.split(b"\n")
            for place, line in enumerate((*lines, rest), start=number + 1):
                if len(line) > LONGEST_LINE:
                    raise ResultError(
                        f"a line of more than {LONGEST_LINE} bytes beginning with "
                        f"{line[:12]!r}: no text of a solver",
                        path,
                        place,
                    )
            for line in lines:
                number += 1
                yield number, line.decode("latin-1").rstrip("\r"), True
        if rest:
            yield number + 1, rest.decode("latin-1"), False


def _near(path: Path) -> str:
    try:
        names = [other.name for other in path.parent.iterdir()]
    except OSError:
        return f": there is no folder {path.parent}"
    near = get_close_matches(path.name, names, n=3)
    return f"; near it: {', '.join(near)}" if near else ""
