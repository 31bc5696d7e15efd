"""A file read at offsets, the lines of a text file, and its numbers in fields of fixed width.

Read and not mapped: a mapped file that another process cuts short kills the reader with
SIGBUS; here it is an error with words. The size is taken once, when the file is opened: a
run that is still writing does not move the end, and `change` says that it was.

A file named ``.gz`` is unpacked into a temporary one first, up to a bound.
"""

import gzip
import math
import os
import re
import stat
import zlib
from collections.abc import Iterator
from contextlib import AbstractContextManager, suppress
from difflib import get_close_matches
from fractions import Fraction
from functools import cache, lru_cache
from pathlib import Path
from tempfile import NamedTemporaryFile, TemporaryFile, gettempdir
from typing import IO

import numpy as np
from numpy.typing import NDArray

from fembridge.errors import ResultError
from fembridge.memory import MAX_RATIO, SMALL_BYTES
from fembridge.typing import BoolArray, FloatArray, IntArray

Characters = NDArray[np.uint8]  # of records of one length, ``(record, byte)``

WINDOW_BYTES = 4096  # holds the header of a block with 100 components
CHUNK_BYTES = 1 << 20
LONGEST_LINE = 1 << 16
_OPEN_FILES = Path("/proc/self/fd")
# Formats whose lines are read one by one: what unpacks without limit is less of them.
_READ_BY_LINES = (".dat", ".sta", ".cvg", ".sts", ".txt")
_LEAST_POWER, _MOST_POWER, _HEAD_BITS = -105, 94, 29  # of E-99 behind six decimals
_PLAIN = b" +-.0123456789E\n"
_BLANK = re.compile(rb"(?:[ \t\r]*\n)+")
_IS_PLAIN = np.isin(np.arange(256), np.frombuffer(_PLAIN[:-1], np.uint8))


class ByteFile(AbstractContextManager["ByteFile"]):
    """The bytes of `path`, by offset; a context manager that closes it.

    They are in the file `place`: `path` itself, or what it was unpacked to.
    """

    def __init__(self, path: Path) -> None:
        self.path = self.place = path
        if path.suffix.lower() == ".gz" and path.is_file():
            about = path.stat()
            self._kept = _unpacked(path, about.st_size, about.st_mtime_ns)
            self.place = self._kept.path
        try:
            handle = os.open(self.place, os.O_RDONLY | os.O_NONBLOCK)
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
        except ValueError as error:  # of a Python file that is closed
            raise ResultError(
                "closed: read it inside the `with` that opens it", self.path
            ) from error

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

    def find(self, marker: bytes, offset: int) -> int | None:
        """The first place from `offset` with `marker`."""
        length = WINDOW_BYTES  # the place is often near
        while offset < self.size:
            at = self.peek(offset, length + len(marker) - 1).find(marker)
            if at >= 0:
                return offset + at
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


def suffix_of(path: Path) -> str:
    """The suffix of `path`, in small letters; of ``job.frd.gz`` what comes out of it."""
    packed = path.suffix.lower() == ".gz"
    return Path(path.stem if packed else path).suffix.lower()


class _Unpacked:
    """The content of a gzip file in a temporary `file`, which goes with the last who has this.

    On Linux it has no name, so that a kill leaves nothing.
    """

    def __init__(self, file: IO[bytes]) -> None:
        self.file = file
        named = isinstance(file.name, str)
        self.path = Path(file.name) if named else _OPEN_FILES / str(file.fileno())

    def add(self, block: bytes, path: Path) -> None:
        """Append what came out of `path`."""
        try:
            self.file.write(block)
            self.file.flush()
        except OSError as error:
            folder = f"{gettempdir()}: {error.strerror}; TMPDIR names another folder"
            raise ResultError(f"cannot be unpacked into {folder}", path) from error

    def __del__(self) -> None:
        with suppress(OSError):  # of bytes for which there was no room
            self.file.close()


@lru_cache(maxsize=1)
def _unpacked(path: Path, size: int, written_ns: int) -> _Unpacked:
    """The content of a gzip file of `size` bytes."""
    small_bytes = SMALL_BYTES // (8 if suffix_of(path) in _READ_BY_LINES else 1)
    done = 0
    make = TemporaryFile if _OPEN_FILES.is_dir() else NamedTemporaryFile
    try:
        unpacked = _Unpacked(make(suffix=suffix_of(path)))
        with path.open("rb") as raw, gzip.GzipFile(fileobj=raw) as packed:
            while block := packed.read(CHUNK_BYTES):
                done += len(block)
                read_bytes = min(size, raw.tell() + CHUNK_BYTES)
                if done > max(small_bytes, MAX_RATIO * read_bytes):
                    words = f"unpacks to more than {MAX_RATIO} times its {size} bytes"
                    raise ResultError(f"{words}: no results", path)
                unpacked.add(block, path)
    except (OSError, EOFError, zlib.error) as error:
        raise ResultError(f"cannot be unpacked: {error}", path) from error
    return unpacked


def text_lines(path: Path) -> Iterator[tuple[int, str, bool]]:
    """Number, text and whether a line end closes it, for each line, in bounded memory.

    Bytes are read as Latin-1. What has no line ends (something else under a known
    name, a hole that a full disk left) is refused after `LONGEST_LINE` bytes.
    """
    for first, piece, ended in text_runs(path):
        lines = [piece] if isinstance(piece, str) else piece.tobytes().decode("ascii").splitlines()
        for number, line in enumerate(lines, start=first):
            yield number, line, ended


def text_runs(path: Path) -> Iterator[tuple[int, str | Characters, bool]]:
    """As `text_lines`; but lines of plain numbers, as long as the one before, come together.

    Of more than two blank lines the first and the last come, under their own numbers.
    They are a table ``(line, byte)``, line ends among them, with the number of the first.
    """
    with ByteFile(path) as file:
        text, at, begin, number = b"", 0, 0, 1  # `begin` is the offset of `text`
        while begin + at < file.size:
            end = text.find(b"\n", at, at + LONGEST_LINE + 1)
            if end < 0 and begin + len(text) < file.size and len(text) - at <= LONGEST_LINE:
                begin += at
                text, at = file.take(begin, min(CHUNK_BYTES, file.size - begin)), 0
                continue
            if end < 0:
                if len(text) - at > LONGEST_LINE:
                    raise ResultError(
                        f"a line of more than {LONGEST_LINE} bytes beginning with "
                        f"{text[at : at + 12]!r}: no text of a solver",
                        path,
                        number,
                    )
                yield number, text[at:].decode("latin-1"), False
                return
            line = text[at:end]
            yield number, line.decode("latin-1").rstrip("\r"), True
            size, at, number, look = end + 1 - at, end + 1, number + 1, 16
            if not line.strip() and (blank := _BLANK.match(text, at)):  # of many, two are given
                number += text.count(b"\n", at, blank.end())
                at = blank.end()
                yield number - 1, "", True
                continue
            if text[at : at + size - 1].translate(None, _PLAIN):
                continue  # the next line is no plain one
            while text[at + size - 1 : at + size] == b"\n" and size > 1:
                some = min(look, (len(text) - at) // size)
                block, same = text[at : at + some * size], some
                table = np.frombuffer(block, np.uint8).reshape(some, size)
                ends = table[:, -1] == ord("\n")
                if not ends.all() or block.count(b"\n") > some or block.translate(None, _PLAIN):
                    fine = _IS_PLAIN[table[:, :-1]].all(axis=1) & ends
                    same = some if fine.all() else int(np.argmin(fine))
                if same:
                    yield number, table[:same], True
                at, number, look = at + same * size, number + same, look * 4
                if same < some:
                    break


def fixed_integers(characters: Characters) -> tuple[IntArray, BoolArray]:
    """Right-justified integers ≥ 0, ``(row, width)`` -> ``(row,)``, and which rows are such."""
    value = np.zeros(len(characters), dtype=np.int64)
    begun = np.zeros(len(characters), dtype=np.bool_)
    fine = np.ones(len(characters), dtype=np.bool_)
    columns = np.ascontiguousarray(characters.T)
    for column in columns[(columns != ord(" ")).any(axis=1).argmax() :]:
        number = column - ord("0")  # wraps below 0
        digit = number < 10
        fine &= digit | (column == ord(" ")) & ~begun
        begun |= digit
        value *= 10
        value += np.where(digit, number, 0)
    return value, fine & begun


def fixed_floats(fields: Characters) -> tuple[FloatArray, BoolArray]:
    """E12.5, E13.6 and the like, ``(field, width)`` -> ``(field,)``, and which are of that form.

    The form is a sign or a blank, a digit, a point, at most six digits, E, a sign, two digits.
    """
    decimals = fields.shape[1] - 7
    columns = np.ascontiguousarray(fields.T)
    sign, turn = columns[0], columns[-3]
    digits = columns[[1, *range(3, 3 + decimals), -2, -1]] - ord("0")  # wraps below 0
    usual = (digits < 10).all(axis=0) & (columns[2] == ord(".")) & (columns[-4] | 32 == ord("e"))
    usual &= (sign == ord(" ")) | (sign == ord("+")) | (sign == ord("-"))
    usual &= (turn == ord("+")) | (turn == ord("-"))
    whole = digits[0].astype(np.float64)
    for digit in digits[1:-2]:
        whole = 10.0 * whole + digit
    power = (10 * digits[-2] + digits[-1]).astype(np.int64)
    power = np.where(turn == ord("-"), -power, power) - decimals
    # Seven digits times the head of a power are exact; its tail leaves one rounding.
    head, tail = _powers_of_ten()
    place = np.where(usual, power, 0) - _LEAST_POWER
    values: FloatArray = whole * head[place] + whole * tail[place]
    values[sign == ord("-")] *= -1.0
    return values, usual


@cache
def _powers_of_ten() -> tuple[FloatArray, FloatArray]:
    """Powers from `_LEAST_POWER` on as sums of a head of few bits and a tail."""
    powers = [Fraction(10) ** k for k in range(_LEAST_POWER, _MOST_POWER + 1)]
    parts = [math.frexp(float(power)) for power in powers]
    heads = [math.ldexp(math.floor(math.ldexp(x, _HEAD_BITS)), e - _HEAD_BITS) for x, e in parts]
    tails = [float(power - Fraction(head)) for power, head in zip(powers, heads, strict=True)]
    return np.array(heads), np.array(tails)


def _near(path: Path) -> str:
    try:
        names = [other.name for other in path.parent.iterdir()]
    except OSError:
        return f": there is no folder {path.parent}"
    near = get_close_matches(path.name, names, n=3)
    return f"; near it: {', '.join(near)}" if near else ""
