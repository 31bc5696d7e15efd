"""A file read at offsets, and the lines of a text file.

Read and not mapped: a mapped file that another process cuts short kills the reader with
SIGBUS; here it is an error with words. The size is taken once, when the file is opened: a
run that is still writing does not move the end, and `change` says that it was.
"""

import os
import stat
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager
from difflib import get_close_matches
from functools import partial
from pathlib import Path

from fembridge.errors import ResultError

WINDOW_BYTES = 4096  # holds the header of a block with 100 components
CHUNK_BYTES = 1 << 20
LONGEST_LINE = 1 << 16


class ByteFile(AbstractContextManager["ByteFile"]):
    """The bytes of `path`, by offset; a context manager that closes it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        except FileNotFoundError as error:
            raise ResultError(f"no such file{_near(path)}", path) from error
        except OSError as error:
            raise ResultError(f"cannot be opened: {error.strerror}", path) from error
        about = os.fstat(handle)
        if not stat.S_ISREG(about.st_mode):
            os.close(handle)
            kind = "a folder" if stat.S_ISDIR(about.st_mode) else "a pipe or a device"
            raise ResultError(f"{kind}, expected a result file", path)
        self.size = about.st_size
        self.written_ns = about.st_mtime_ns
        self._file = os.fdopen(handle, "rb", WINDOW_BYTES)

    def __exit__(self, *error: object) -> None:
        self._file.close()

    def peek(self, offset: int, length: int) -> bytes:
        """Up to `length` bytes from `offset`; fewer at the end."""
        if not 0 <= offset < self.size or length <= 0:
            return b""
        try:
            self._file.seek(offset)
            return self._file.read(min(length, self.size - offset))
        except OSError as error:
            raise ResultError(f"cannot be read: {error.strerror}", self.path) from error

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

    def holds(self, offset: int, text: bytes) -> bool:
        """Whether `text` is at `offset`."""
        return self.peek(offset, len(text)) == text

    def line(self, offset: int) -> tuple[bytes, int] | None:
        """The line at `offset` without its end, and where the next begins.

        None when no line end follows within `WINDOW_BYTES`: `why_no_line` says
        whether the line is cut by the end of the file, or this is no text.
        """
        if not 0 <= offset < self.size:
            return None
        try:
            self._file.seek(offset)
            line = self._file.readline(min(WINDOW_BYTES, self.size - offset))
        except OSError as error:
            raise ResultError(f"cannot be read: {error.strerror}", self.path) from error
        if not line.endswith(b"\n"):
            return None
        return line[:-1].removesuffix(b"\r"), offset + len(line)

    def why_no_line(self, offset: int) -> str:
        """Why `line` found none at `offset`."""
        if self.size - offset > WINDOW_BYTES:
            return f"a line of more than {WINDOW_BYTES} bytes, which is no line"
        return "cut inside a line"

    @property
    def change(self) -> str | None:
        """How the file has changed since it was opened; None if it has not."""
        about = os.fstat(self._file.fileno())
        if (about.st_size, about.st_mtime_ns) == (self.size, self.written_ns):
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
            chunk = self.peek(offset, length + overlap)
            best: tuple[int, bytes] | None = None
            for marker in markers:
                if chunk.find(marker[:1].strip(b" ") or marker[-1:]) < 0:
                    continue  # a single byte is sought ten times as fast
                at = chunk.find(marker, 0, None if best is None else best[0] + len(marker))
                if at >= 0 and (best is None or at < best[0]):
                    best = at, marker
            if best is not None:
                return offset + best[0], best[1]
            offset += length
            length = min(4 * length, CHUNK_BYTES)
        return None

    def count(self, marker: bytes, offset: int, end: int) -> int:
        """How often `marker`, which does not overlap itself, is between `offset` and `end`."""
        overlap = len(marker) - 1
        return sum(
            self.peek(at, min(CHUNK_BYTES + overlap, end - at)).count(marker)
            for at in range(offset, end, CHUNK_BYTES)
        )

    def lines(self) -> Iterator[bytes]:
        """Lines with their ends, in pieces of at most `LONGEST_LINE` + 1 bytes."""
        try:
            yield from iter(partial(self._file.readline, LONGEST_LINE + 1), b"")
        except OSError as error:
            raise ResultError(f"cannot be read: {error.strerror}", self.path) from error


def text_lines(path: Path) -> Iterator[tuple[int, str, bool]]:
    """Number, text and whether a line end closes it, for each line, in bounded memory.

    Bytes are read as Latin-1. What has no line ends (something else under a known
    name, a hole that a full disk left) is refused after `LONGEST_LINE` bytes.
    """
    with ByteFile(path) as file:
        for number, line in enumerate(file.lines(), start=1):
            if line[-1:] == b"\n":
                yield number, line.decode("latin-1").rstrip("\r\n"), True
            elif len(line) <= LONGEST_LINE:
                yield number, line.decode("latin-1"), False
            else:
                raise ResultError(
                    f"a line of more than {LONGEST_LINE} bytes beginning with "
                    f"{line[:12]!r}: no text of a solver",
                    path,
                    number,
                )


def _near(path: Path) -> str:
    try:
        names = [other.name for other in path.parent.iterdir()]
    except OSError:
        return f": there is no folder {path.parent}"
    near = get_close_matches(path.name, names, n=3)
    return f"; near it: {', '.join(near)}" if near else ""
