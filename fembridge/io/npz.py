"""Arrays of NPZ archives, whose shapes and sizes are known before an array is read.

``numpy.load`` takes the memory of an array, whatever size its header states, and reads
members that nobody asks for. Here the headers are read first, compared with the sizes in
the archive's directory and with the limit of memory, and only requested arrays are read.
"""

import io
import math
import warnings
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.lib import format as npy

from fembridge.errors import FembridgeError
from fembridge.host.memory import check_unpacked

MAX_MEMBERS = 10_000
COPIES = 4
"""Copies of an array that are in memory at once while its unit is converted."""

HEADER_BYTES = 1 << 16
_SUFFIX = ".npy"
_PROBLEM_LENGTH = 120


class ArrayHeader(NamedTuple):
    """Shape and type of an array, from the header of its member."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]


def read_array_header(stream: BinaryIO) -> ArrayHeader:
    """Shape and type of the array in an NPY `stream`, which then stands at its first number.

    Raises
    ------
    ValueError
        Not the header of an NPY of version 1.0 or 2.0.
    """
    version = npy.read_magic(stream)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"a header of version {version[0]}.{version[1]}")
    read_header = npy.read_array_header_1_0 if version[0] == 1 else npy.read_array_header_2_0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of a header that Python 2 wrote
        shape, _, dtype = read_header(stream)
    return ArrayHeader(shape, dtype)


class NpzFile(AbstractContextManager["NpzFile"]):
    """An open NPZ archive.

    Attributes
    ----------
    headers
        Shape and type of each array by name; None of a member that is no array.

    Raises
    ------
    FembridgeError
        The `error` of the caller: the file is no NPZ, is damaged, or states sizes that
        disagree.
    """

    def __init__(self, path: Path, error: Callable[[str], FembridgeError]) -> None:
        self._path, self._error = path, error
        self.headers: dict[str, ArrayHeader | None] = {}
        self._members: dict[str, zipfile.ZipInfo] = {}
        self._members_read: set[str] = set()
        with self._damage():
            self._packed_bytes = path.stat().st_size
            self._archive = zipfile.ZipFile(path)
        try:
            self._read_headers()
        except BaseException:
            self._archive.close()
            raise

    def __exit__(self, *error: object) -> None:
        self._archive.close()

    def read(self, name: str, copies: float = COPIES) -> np.ndarray[Any, Any]:
        """The array `name`.

        Arrays that are too large, together with those read before, are refused before their
        memory is taken; `copies` of them are in memory at once.
        """
        header, member = self.headers[name], self._members[name]
        if header is None:
            raise self._error(f"{name} is no array")
        if header.dtype.kind not in "biufcSU":
            raise self._error(f"{name} is of type {header.dtype}, expected numbers or texts")
        self._members_read.add(name)
        members = [self._members[other] for other in self._members_read]
        packed_bytes = min(sum(other.compress_size for other in members), self._packed_bytes)
        unpacked_bytes = sum(other.file_size for other in members)
        subject = ", ".join(sorted(self._members_read))
        check_unpacked(packed_bytes, unpacked_bytes, subject, self._error, copies=copies)
        with self._damage(name), self._archive.open(member) as stream:
            array: np.ndarray[Any, Any] = npy.read_array(stream, allow_pickle=False)
        return array

    def read_reals(self, name: str, copies: float = COPIES) -> np.ndarray[Any, np.dtype[Any]]:
        """The array `name` as float64; complex numbers, texts and objects are refused."""
        header = self.headers[name]
        if header is not None and header.dtype.kind not in "biuf":
            raise self._error(f"{name} is of type {header.dtype}, expected real numbers")
        return self.read(name, copies).astype(np.float64, copy=False)

    def read_texts(self, name: str) -> list[str]:
        """The texts ``(n,)`` of the array `name`."""
        header = self.headers[name]
        if header is not None and (header.dtype.kind not in "SU" or len(header.shape) != 1):
            raise self._error(
                f"{name} is of type {header.dtype} and shape {header.shape}, expected texts (n,)"
            )
        array = self.read(name)
        with self._damage(name):
            texts: list[str] = array.astype(np.str_).tolist()
        return texts

    def _read_headers(self) -> None:
        members = self._archive.infolist()
        if len(members) > MAX_MEMBERS:
            raise self._error(f"more than {MAX_MEMBERS} arrays")
        for member in members:
            name = member.filename.removesuffix(_SUFFIX)
            if name in self._members:
                raise self._error(f"two arrays {name}")
            self._members[name] = member
            with self._damage(name):
                self.headers[name] = self._header_of(member)

    def _header_of(self, member: zipfile.ZipInfo) -> ArrayHeader | None:
        with self._archive.open(member) as stream:
            start = io.BytesIO(stream.read(HEADER_BYTES))
        if not member.filename.endswith(_SUFFIX) or not start.getvalue().startswith(
            npy.MAGIC_PREFIX
        ):
            return None
        shape, dtype = read_array_header(start)
        count = math.prod(shape)
        expected_bytes = start.tell() + count * dtype.itemsize
        if not dtype.hasobject and expected_bytes != member.file_size:
            raise ValueError(
                f"shape {shape} of {dtype} takes {expected_bytes} bytes, it has {member.file_size}"
            )
        if count > member.file_size or min(shape, default=0) < 0:  # of a type of 0 bytes
            raise ValueError(f"shape {shape} of {dtype}")
        return ArrayHeader(shape, dtype)

    @contextmanager
    def _damage(self, name: str = "") -> Iterator[None]:
        """Turn whatever zipfile, zlib and NumPy raise for damage into one error."""
        try:
            yield
        except (FembridgeError, MemoryError):
            raise
        except Exception as error:
            problem = " ".join(str(error).split())[:_PROBLEM_LENGTH]
            subject = f"array {name}: " if name else ""
            raise self._error(f"no NPZ of numbers: {subject}{problem}") from error


def shapes_text(headers: Mapping[str, ArrayHeader | None]) -> dict[str, str]:
    """The shape of each array as text, for a description."""
    return {name: str(header.shape) if header else "no array" for name, header in headers.items()}
