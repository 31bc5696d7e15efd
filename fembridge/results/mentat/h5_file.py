"""An HDF5 file, through h5py: its arrays, their shapes, attributes of its groups."""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from fembridge.errors import MissingError, ResultError
from fembridge.results.byte_file import ByteFile

FIRST_BYTES = b"\x89HDF\r\n\x1a\n"
_INSTALL = 'no h5py to read it with: pip install "fembridge[h5]"'


class H5Array(Protocol):
    """An array in the file, read piece by piece."""

    name: str
    shape: tuple[int, ...]
    dtype: "np.dtype[Any]"

    def __getitem__(self, key: object) -> NDArray[Any]:
        """Read a piece."""
        ...


class _Attributes(Protocol):
    def get(self, name: str) -> object: ...


class _Handle(Protocol):
    attrs: _Attributes

    def get(self, place: str) -> Any: ...  # noqa: ANN401 - a group or an array
    def visititems(self, look: object) -> object: ...


class H5File:
    """The open file at `path`; see `opened`."""

    def __init__(self, path: Path, handle: _Handle) -> None:
        self.path = path
        self._handle = handle

    def array(self, place: str) -> H5Array | None:
        """Give the array at `place`; None where there is none."""
        found = self._handle.get(place)
        if not hasattr(found, "shape"):
            return None
        array: H5Array = found
        return array

    def attribute(self, place: str, name: str) -> object:
        """Give an attribute; of one that is an array, its first value."""
        group: _Handle | None = self._handle.get(place)
        value = None if group is None else group.attrs.get(name)
        if isinstance(value, np.ndarray):
            value = value.flat[0] if value.size else None
        return value.decode("utf-8", "replace") if isinstance(value, bytes) else value

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Give the shape of every array, by its place."""
        found: dict[str, tuple[int, ...]] = {}

        def look(name: str, item: object) -> None:
            shape = getattr(item, "shape", None)
            if shape is not None:
                found[name] = tuple(shape)

        self._handle.visititems(look)
        return found


@contextmanager
def opened(path: Path) -> Iterator[H5File]:
    """Open an HDF5 file; what h5py finds wrong with it becomes our error.

    Raises
    ------
    MissingError
        h5py is not installed.
    ResultError
        No such file, no HDF5, or a damaged one.
    """
    with ByteFile(path) as file:  # says what is wrong with a path
        if not file.holds(0, FIRST_BYTES):
            raise ResultError(f"no HDF5: begins with {file.peek(0, 8)!r}", path)
    try:
        h5py = import_module("h5py")
    except ImportError as error:
        raise MissingError(f"{path}: {_INSTALL}") from error
    try:
        with h5py.File(path, "r") as handle:
            yield H5File(path, handle)
    except (OSError, KeyError, RuntimeError, ValueError, TypeError) as error:
        raise ResultError(f"damaged, or still being written: {error}", path) from error
