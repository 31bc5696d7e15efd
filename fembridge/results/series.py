"""A series of outputs on one mesh, from VTK or XDMF files.

A series lists the shapes of its arrays before it reads one, so that their size in memory is known
first. Files that a series names must be in its folder: another path, also through a symbolic
link, is refused before it is opened.
"""

import warnings
from collections.abc import Hashable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Self

import numpy as np

from fembridge.errors import ResultError
from fembridge.typing import FloatArray

_SHORTEST_NUMBER = 2  # a digit and a blank


class Frame:
    """The arrays at the points of one output; a context manager that closes it.

    Attributes
    ----------
    shapes
        Shape of each array by name, points first.
    """

    def __init__(self, shapes: Mapping[str, tuple[int, ...]]) -> None:
        self.shapes = shapes

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        return None

    def read(self, name: str) -> FloatArray:
        """The array `name` in the units of the file."""
        raise NotImplementedError


class Series(AbstractContextManager["Series"]):
    """An open series.

    Attributes
    ----------
    times
        Time of each output as the file has it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.times: Sequence[float] = ()

    def __exit__(self, *error: object) -> None:
        return None

    def count(self) -> int:
        """Number of points of the first output."""
        raise NotImplementedError

    def points(self) -> FloatArray:
        """Coordinates ``(P, 2)`` or ``(P, 3)`` of the first output."""
        raise NotImplementedError

    def frame(self, output: int) -> Frame:
        """The output of number `output`, from 0."""
        raise NotImplementedError

    def key(self, output: int, names: Sequence[str]) -> Hashable:
        """Storage of arrays of an output: outputs with equal keys have the same numbers."""
        raise NotImplementedError

    def doubts(self, names: Sequence[str]) -> list[str]:
        """Warnings about the arrays `names`."""
        return []

    def packed_bytes(self) -> int:
        """Size of the files on disk, in bytes."""
        raise NotImplementedError


def inside(folder: Path, name: str, path: Path) -> Path:
    """The file `name` in `folder`, which the file `path` names.

    Raises
    ------
    ResultError
        `name` is outside the folder, or is not a file.
    """
    file = folder / name
    try:
        is_inside = file.resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError) as error:  # a loop of links, a NUL
        raise ResultError(f"{name[:60]!r}, expected a file name: {error}", path) from error
    if not is_inside:
        raise ResultError(f"{file.name} is outside the folder of this file", path)
    if not name or not file.is_file():
        raise ResultError(f"no file {name[:60]!r} in the folder of this file", path)
    return file


def numbers_in(text: str, count: int, dtype: np.dtype[np.generic], problem: str) -> FloatArray:
    """The `count` numbers in `text`, ``(count,)`` as float64.

    Raises
    ------
    ValueError
        Another count, or text that is not a number in ASCII digits; the message begins with
        `problem`.
    """
    if len(text) + 1 < _SHORTEST_NUMBER * count:
        raise ValueError(f"{problem} has fewer than {count} numbers")
    if not text.strip():
        numbers: FloatArray = np.empty(0)
    else:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # NumPy warns if it stops before the end
            try:
                numbers = np.fromstring(text, dtype=dtype, sep=" ").astype(np.float64)
            except (DeprecationWarning, UnicodeError, OverflowError, ValueError) as error:
                raise ValueError(f"{problem} contains text that is not a number") from error
    if numbers.size != count:
        raise ValueError(f"{problem} has {numbers.size} numbers, expected {count}")
    return numbers


def disk_bytes(files: Iterable[Path]) -> int:
    """Size of `files` on disk in bytes, without duplicates."""
    return sum(file.stat().st_size for file in {file.resolve() for file in files} if file.is_file())
