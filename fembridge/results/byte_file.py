"""Random access to a file, lines of a text file, and numbers in fields of fixed width.

Files are read, not mapped: if another process truncates a mapped file, SIGBUS kills the reader;
here it raises an error. The size is taken when the file is opened, so a run that is still
writing does not move the end; `change` describes it.

A ``.gz`` file is first unpacked to a temporary file of limited size.
"""

import math
import os
import re
import stat
import zlib
from collections.abc import Iterator
from contextlib import AbstractContextManager, suppress
from functools import cache, lru_cache
from pathlib import Path
from typing import IO
from weakref import finalize

import numpy as np
from numpy.typing import NDArray

from fembridge.errors import ResultError
from fembridge.host.memory import MAX_RATIO, SMALL_BYTES
from fembridge.host.system import NO_WAIT
from fembridge.typing import BoolArray, FloatArray, IntArray

Characters = NDArray[np.uint8]  # of records of one length, ``(record, byte)``

WINDOW_BYTES = 4096  # holds the header of a block with 100 components
CHUNK_BYTES = 1 << 20
MAX_LINE_BYTES = 1 << 16
_OPEN_FILES = Path("/proc/self/fd")
# Formats that are read line by line, with a lower limit of the unpacked size.
_READ_BY_LINES = (".dat", ".sta", ".cvg", ".sts", ".txt")
_MIN_POWER, _MAX_POWER, _HEAD_BITS = -105, 94, 29  # of E-99 behind six decimals
_PLAIN = b" +-.0123456789E\n"
_BLANK = re.compile(rb"(?:[ \t\r]*\n)+")
_IS_PLAIN = np.isin(np.arange(256), np.frombuffer(_PLAIN[:-1], np.uint8))


class ByteFile(AbstractContextManager["ByteFile"]):
    """The bytes of `path` by offset; a context manager that closes the file.

    `data_path` is the file that is read: `path` itself, or its unpacked content.
    """

    def __init__(self, path: Path) -> None:
        self.path = self.data_path = path
        if path.suffix.lower() == ".gz" and path.is_file():
            status = path.stat()
            self._unpacked_content = _unpacked(path, status.st_size, status.st_mtime_ns)
            self.data_path = self._unpacked_content.path
        try:
            handle = os.open(self.data_path, os.O_RDONLY | NO_WAIT)
        except FileNotFoundError as error:
            raise ResultError(f"no such file{_near_names(path)}", path) from error
        except OSError as error:
            raise ResultError(f"cannot be opened: {error.strerror}", path) from error
        status = os.fstat(handle)
        if not stat.S_ISREG(status.st_mode):
            os.close(handle)
            kind = "a folder" if stat.S_ISDIR(status.st_mode) else "a pipe or a device"
            raise ResultError(f"{kind}, expected a result file", path)
        self.size = status.st_size
        self.written_ns = status.st_mtime_ns
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
                "the file is closed; read it inside the `with` block that opens it", self.path
            ) from error

    def take(self, offset: int, length: int) -> bytes:
        """Exactly `length` bytes from `offset`; fewer raise a `ResultError`."""
        if offset < 0 or length < 0 or offset + length > self.size:
            raise ResultError(
                f"{length} bytes expected at byte {offset}, the file has {self.size}", self.path
            )
        content = self.peek(offset, length)
        if len(content) < length:
            raise ResultError(
                f"ends at byte {offset + len(content)}, but had {self.size} bytes when it was "
                "opened: another process is writing it",
                self.path,
            )
        return content

    def holds(self, offset: int, text: bytes) -> bool:
        """Whether `text` is at `offset`."""
        return self.peek(offset, len(text)) == text

    def line(self, offset: int) -> tuple[bytes, int] | None:
        """The line at `offset` without its line end, and the offset of the next line.

        None if no line end follows within `WINDOW_BYTES`; `line_problem` then says whether the
        end of the file cuts the line or the content is not text.
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

    def line_problem(self, offset: int) -> str:
        """Message for an offset without a complete line."""
        if self.size - offset > WINDOW_BYTES:
            return f"no line end in {WINDOW_BYTES} bytes"
        return "cut inside a line"

    @property
    def change(self) -> str | None:
        """Message if the file has changed since it was opened; None if it has not."""
        status = os.fstat(self._file.fileno())
        if (status.st_size, status.st_mtime_ns) == (self.size, self.written_ns):
            return None
        if status.st_size == self.size:
            return "the file was overwritten while it was read"
        verb = "grew" if status.st_size > self.size else "shrank"
        return (
            f"the file {verb} from {self.size} to {status.st_size} bytes while it was read: "
            "another process is writing it"
        )

    def find(self, marker: bytes, offset: int) -> int | None:
        """The first offset of `marker` from `offset` on; None if it does not occur."""
        length = WINDOW_BYTES  # the marker is often near
        while offset < self.size:
            position = self.peek(offset, length + len(marker) - 1).find(marker)
            if position >= 0:
                return offset + position
            offset += length
            length = min(4 * length, CHUNK_BYTES)
        return None

    def count(self, marker: bytes, offset: int, end: int) -> int:
        """Number of `marker`, which does not overlap itself, from `offset` to `end`."""
        overlap = len(marker) - 1
        return sum(
            self.peek(at, min(CHUNK_BYTES + overlap, end - at)).count(marker)
            for at in range(offset, end, CHUNK_BYTES)
        )


def suffix_of(path: Path) -> str:
    """Suffix of `path` in lower case, without ``.gz``: ".frd" of ``job.frd.gz``."""
    packed = path.suffix.lower() == ".gz"
    return Path(path.stem if packed else path).suffix.lower()


class _Unpacked:
    """Content of a gzip file in a temporary file, removed with the last reference.

    On Linux the file has no name, so that a killed process leaves nothing. Elsewhere it is closed
    before it is read: Windows opens no temporary file a second time.
    """

    def __init__(self, suffix: str) -> None:
        from tempfile import NamedTemporaryFile, TemporaryFile

        self._has_name = not _OPEN_FILES.is_dir()
        self._file: IO[bytes]
        if self._has_name:
            self._file = NamedTemporaryFile(suffix=suffix, delete=False)  # noqa: SIM115 - closed later
            self.path = Path(self._file.name)
            finalize(self, _remove, self._file, self.path)
        else:
            self._file = TemporaryFile(suffix=suffix)  # noqa: SIM115 - closed later
            self.path = _OPEN_FILES / str(self._file.fileno())
            finalize(self, _close, self._file)

    def add(self, block: bytes, path: Path) -> None:
        """Append unpacked content of `path`."""
        try:
            self._file.write(block)
            self._file.flush()
        except OSError as error:
            from tempfile import gettempdir

            folder = f"{gettempdir()}: {error.strerror}; TMPDIR names another folder"
            raise ResultError(f"cannot be unpacked into {folder}", path) from error

    def finish(self) -> None:
        """All content is added: another handle may read it."""
        if self._has_name:
            self._file.close()


def _close(file: IO[bytes]) -> None:
    with suppress(OSError):  # unwritten bytes on a full disk
        file.close()


def _remove(file: IO[bytes], path: Path) -> None:
    _close(file)
    with suppress(OSError):  # Windows removes no file that is open
        path.unlink()


@lru_cache(maxsize=1)
def _unpacked(path: Path, size: int, written_ns: int) -> _Unpacked:
    """Content of a gzip file of `size` bytes."""
    import gzip

    small_bytes = SMALL_BYTES // (8 if suffix_of(path) in _READ_BY_LINES else 1)
    done = 0
    try:
        unpacked = _Unpacked(suffix_of(path))
        with path.open("rb") as raw, gzip.GzipFile(fileobj=raw) as packed:
            while block := packed.read(CHUNK_BYTES):
                done += len(block)
                read_bytes = min(size, raw.tell() + CHUNK_BYTES)
                if done > max(small_bytes, MAX_RATIO * read_bytes):
                    message = f"unpacks to more than {MAX_RATIO} times its {size} bytes"
                    raise ResultError(f"{message}: no results", path)
                unpacked.add(block, path)
        unpacked.finish()
    except (OSError, EOFError, zlib.error) as error:
        raise ResultError(f"cannot be unpacked: {error}", path) from error
    return unpacked


def text_lines(path: Path) -> Iterator[tuple[int, str, bool]]:
    """Number and text of each line, and whether it has a line end, in bounded memory.

    Bytes are decoded as Latin-1. `MAX_LINE_BYTES` without a line end (another format, a hole
    that a full disk left) raise a `ResultError`.
    """
    for first, piece, closed in text_runs(path):
        lines = [piece] if isinstance(piece, str) else piece.tobytes().decode("ascii").splitlines()
        for number, line in enumerate(lines, start=first):
            yield number, line, closed


def text_runs(path: Path) -> Iterator[tuple[int, str | Characters, bool]]:
    """As `text_lines`, but lines of plain numbers of equal length are yielded together.

    Such a group is an array ``(line, byte)`` with line ends, and the number of its first line.
    Of a run of blank lines only the first and the last are yielded, with their numbers.
    """
    with ByteFile(path) as file:
        text, position, text_offset, number = b"", 0, 0, 1  # `begin` is the offset of `text`
        while text_offset + position < file.size:
            end = text.find(b"\n", position, position + MAX_LINE_BYTES + 1)
            if (
                end < 0
                and text_offset + len(text) < file.size
                and len(text) - position <= MAX_LINE_BYTES
            ):
                text_offset += position
                text, position = (
                    file.take(text_offset, min(CHUNK_BYTES, file.size - text_offset)),
                    0,
                )
                continue
            if end < 0:
                if len(text) - position > MAX_LINE_BYTES:
                    raise ResultError(
                        f"a line of more than {MAX_LINE_BYTES} bytes, beginning with "
                        f"{in_words(text[position : position + 12])}: not a text file of a solver",
                        path,
                        number,
                    )
                yield number, text[position:].decode("latin-1"), False
                return
            line = text[position:end]
            yield number, line.decode("latin-1").rstrip("\r"), True
            size, position, number, look_ahead = end + 1 - position, end + 1, number + 1, 16
            if not line.strip() and (blank := _BLANK.match(text, position)):  # yield two of many
                number += text.count(b"\n", position, blank.end())
                position = blank.end()
                yield number - 1, "", True
                continue
            if text[position : position + size - 1].translate(None, _PLAIN):
                continue  # the next line has other characters
            while text[position + size - 1 : position + size] == b"\n" and size > 1:
                count = min(look_ahead, (len(text) - position) // size)
                block, plain_count = text[position : position + count * size], count
                table = np.frombuffer(block, np.uint8).reshape(count, size)
                ends = table[:, -1] == ord("\n")
                if not ends.all() or block.count(b"\n") > count or block.translate(None, _PLAIN):
                    is_plain = _IS_PLAIN[table[:, :-1]].all(axis=1) & ends
                    plain_count = count if is_plain.all() else int(np.argmin(is_plain))
                if plain_count:
                    yield number, table[:plain_count], True
                position, number, look_ahead = (
                    position + plain_count * size,
                    number + plain_count,
                    look_ahead * 4,
                )
                if plain_count < count:
                    break


def in_words(content: bytes) -> str:
    """`content` of a file for a message: quoted text, or how many bytes are no text."""
    if not content:
        return "the end of the file"
    if not content.strip(b"\0"):
        return f"{len(content)} zero bytes"
    text = content.strip(b"\r\n")
    if not text.strip():
        return "a blank line"
    shown = "".join(chr(byte) if 32 <= byte < 127 else "\N{MIDDLE DOT}" for byte in text)
    strange = shown.count("\N{MIDDLE DOT}")
    if 2 * strange > len(text):
        return f"{len(content)} bytes that are no text"
    return f"{shown!r}, {strange} of it no text" if strange else repr(shown)


def fixed_integers(characters: Characters) -> tuple[IntArray, BoolArray]:
    """Right-justified integers ≥ 0, ``(row, width)`` -> ``(row,)``, and which rows are valid."""
    value = np.zeros(len(characters), dtype=np.int64)
    begun = np.zeros(len(characters), dtype=np.bool_)
    is_valid = np.ones(len(characters), dtype=np.bool_)
    columns = np.ascontiguousarray(characters.T)
    for column in columns[(columns != ord(" ")).any(axis=1).argmax() :]:
        number = column - ord("0")  # wraps below 0
        digit = number < 10
        is_valid &= digit | (column == ord(" ")) & ~begun
        begun |= digit
        value *= 10
        value += np.where(digit, number, 0)
    return value, is_valid & begun


def fixed_floats(fields: Characters) -> tuple[FloatArray, BoolArray]:
    """Numbers such as E12.5 and E13.6, ``(field, width)`` -> ``(field,)``, and which are valid.

    A valid field is a sign or blank, a digit, a point, up to six digits, E, a sign, two digits.
    """
    decimals = fields.shape[1] - 7
    columns = np.ascontiguousarray(fields.T)
    sign, exponent_sign = columns[0], columns[-3]
    digits = columns[[1, *range(3, 3 + decimals), -2, -1]] - ord("0")  # wraps below 0
    parsed = (digits < 10).all(axis=0) & (columns[2] == ord(".")) & (columns[-4] | 32 == ord("e"))
    parsed &= (sign == ord(" ")) | (sign == ord("+")) | (sign == ord("-"))
    parsed &= (exponent_sign == ord("+")) | (exponent_sign == ord("-"))
    mantissa = digits[0].astype(np.float64)
    for digit in digits[1:-2]:
        mantissa = 10.0 * mantissa + digit
    power = (10 * digits[-2] + digits[-1]).astype(np.int64)
    power = np.where(exponent_sign == ord("-"), -power, power) - decimals
    # Seven digits times the head of a power are exact; its tail leaves one rounding.
    head, tail = _powers_of_ten()
    index = np.where(parsed, power, 0) - _MIN_POWER
    values: FloatArray = mantissa * head[index] + mantissa * tail[index]
    values[sign == ord("-")] *= -1.0
    return values, parsed


@cache
def _powers_of_ten() -> tuple[FloatArray, FloatArray]:
    """Powers of ten from `_MIN_POWER` on, as sums of a head of few bits and a tail."""
    heads, tails = [], []
    for exponent in range(_MIN_POWER, _MAX_POWER + 1):
        over, under = 10 ** max(exponent, 0), 10 ** max(-exponent, 0)
        part, bits = math.frexp(over / under)
        head = math.ldexp(math.floor(math.ldexp(part, _HEAD_BITS)), bits - _HEAD_BITS)
        head_over, head_under = head.as_integer_ratio()
        heads.append(head)
        # Division of whole numbers rounds once.
        tails.append((over * head_under - under * head_over) / (under * head_under))
    return np.array(heads), np.array(tails)


def _near_names(path: Path) -> str:
    try:
        names = [other.name for other in path.parent.iterdir()]
    except OSError:
        return f": no folder {path.parent}"
    from difflib import get_close_matches

    near = get_close_matches(path.name, names, n=3)
    return f"; similar names: {', '.join(near)}" if near else ""
