"""VTU files, and the PVD that lists them over time.

Only requested point arrays of a VTU are read, after their size is known: the number of values
follows from ``NumberOfPoints`` and ``NumberOfComponents``, and must equal that of the text, of the
bytes, or of the header of compressed blocks. Supported are text, base64 and appended data (raw or
base64), uncompressed or compressed by zlib or LZMA ("VTK XML Formats", docs.vtk.org, "Appended
data" and "Compressed data").
"""

import base64
import binascii
import lzma
import zlib
from collections.abc import Hashable, Sequence
from pathlib import Path
from typing import Literal, TypeAlias
from xml.etree.ElementTree import Element

import numpy as np

from fembridge.errors import FembridgeError, ResultError
from fembridge.host.memory import check_unpacked
from fembridge.host.store import read_bytes
from fembridge.io.number import parse_number, parse_whole_number
from fembridge.results.byte_file import ByteFile
from fembridge.results.series import Frame, Series, disk_bytes, inside, numbers_in
from fembridge.results.vtk_legacy import LegacyVtkFile
from fembridge.results.xml_tree import read_xml, refuse_text
from fembridge.typing import FloatArray

MAX_FILE_BYTES = 1 << 28
MAX_PVD_BYTES = 1 << 24
COPIES = 3
"""Copies of an array in memory while it is decoded: text or blocks, bytes, float64."""

_TYPES = {
    "Float32": "f4",
    "Float64": "f8",
    **{f"Int{8 * size}": f"i{size}" for size in (1, 2, 4, 8)},
    **{f"UInt{8 * size}": f"u{size}" for size in (1, 2, 4, 8)},
}
_HEADER_TYPES = ("UInt32", "UInt64")
_Order: TypeAlias = Literal["<", ">", "="]
_ORDERS: dict[str | None, _Order] = {"LittleEndian": "<", "BigEndian": ">", None: "="}
_COMPRESSORS = ("vtkZLibDataCompressor", "vtkLZMADataCompressor")
_LZMA_BYTES = 1 << 28
_APPENDED, _APPENDED_END = b"<AppendedData", b"</AppendedData>"
_TAG_BYTES, _TAIL_BYTES = 1 << 10, 1 << 12
_BLANKS = str.maketrans("", "", " \t\r\n")


class _Raw:
    """Raw appended bytes, from `begin` to `end` of a file."""

    def __init__(self, file: ByteFile, begin: int, end: int) -> None:
        self._file, self._begin, self.size = file, begin, end - begin

    def take(self, offset: int, size: int) -> tuple[bytes, int]:
        """`size` bytes from `offset`, and the offset after them."""
        if offset < 0 or offset + size > self.size:
            raise ValueError(f"{size} bytes expected at byte {offset} of {self.size}")
        return self._file.take(self._begin + offset, size), offset + size


class _Base64:
    """Base64 `text` of separately encoded parts."""

    def __init__(self, text: bytes) -> None:
        self._text, self.size = text, len(text)

    def take(self, offset: int, size: int) -> tuple[bytes, int]:
        """`size` bytes of the part at `offset`, and the offset after their last character."""
        end = offset + -(-size // 3) * 4
        if offset < 0 or end > self.size:
            raise ValueError(f"{size} bytes expected at character {offset} of {self.size}")
        content = base64.b64decode(self._text[offset:end], validate=True)
        if len(content) < size:
            raise ValueError(f"{len(content)} bytes at character {offset}, expected {size}")
        return content[:size], end

    def is_joined(self, offset: int, size: int) -> bool:
        """Whether a header of `size` bytes is encoded together with the data after it."""
        end = offset + -(-size // 3) * 4
        return len(base64.b64decode(self._text[offset:end], validate=True)) > size


class VtuFile(Frame):
    """An open VTU file; arrays of its pieces are concatenated."""

    def __init__(self, path: Path) -> None:
        super().__init__({})
        self.path = path
        self._file = ByteFile(path)
        try:
            self._open()
        except FembridgeError:
            self._file.__exit__()
            raise
        except (ValueError, KeyError, TypeError, binascii.Error) as error:
            self._file.__exit__()
            raise _damage(error, path) from error
        except BaseException:
            self._file.__exit__()
            raise

    def __exit__(self, *error: object) -> None:
        self._file.__exit__(*error)

    def count(self) -> int:
        """Number of points of all pieces."""
        return sum(piece.count for piece in self._pieces)

    def points(self) -> FloatArray:
        """Coordinates ``(P, 3)``."""
        pieces = [self._checked(piece, piece.points, "points") for piece in self._pieces]
        points = np.concatenate(pieces)
        if not np.isfinite(points).all():
            raise ResultError("a coordinate is not finite", self.path)
        return points

    def read(self, name: str) -> FloatArray:
        """The array `name` at the points of all pieces."""
        return np.concatenate(
            [self._checked(piece, piece.arrays[name], name) for piece in self._pieces]
        )

    def _open(self) -> None:
        file = self._file
        if file.size > MAX_FILE_BYTES:
            raise ResultError(f"larger than the limit of {MAX_FILE_BYTES} bytes", self.path)
        at = file.find(_APPENDED, 0)
        head = file.take(0, file.size if at is None else at)
        tag = b"" if at is None else file.peek(at, _TAG_BYTES).partition(b">")[0] + b">"
        closed = b"" if at is None or tag.endswith(b"/>") else _APPENDED_END
        root = read_xml(head + (b"" if at is None else tag + closed + b"</VTKFile>"), self.path)
        if root.tag != "VTKFile" or root.get("type") != "UnstructuredGrid":
            kind = root.get("type", root.tag)
            raise ResultError(f"a VTK file of {kind}, expected an UnstructuredGrid", self.path)
        order = _ORDERS[root.get("byte_order")]
        self._order = order
        header_type = root.get("header_type", _HEADER_TYPES[0])
        if header_type not in _HEADER_TYPES:
            raise ValueError(f"header_type {header_type}")
        self._header = np.dtype(_TYPES[header_type]).newbyteorder(order)
        self._compressor = root.get("compressor")
        if self._compressor not in (None, *_COMPRESSORS):
            expected = " or ".join(_COMPRESSORS)
            raise ResultError(f"compressed by {self._compressor}, expected {expected}", self.path)
        if names := {child.tag for child in root} - {"UnstructuredGrid", "AppendedData"}:
            raise ValueError(f"unknown element {min(names)}")
        [grid] = root.findall("UnstructuredGrid")
        self._appended: _Raw | _Base64 | None = None
        if at is not None:
            [appended] = root.findall("AppendedData")
            self._appended = self._appended_at(at + len(tag), appended.get("encoding", "base64"))
        if names := {child.tag for child in grid} - {"Piece", "FieldData"}:
            raise ValueError(f"unknown element {min(names)}")
        self._pieces = [_Piece(piece) for piece in grid.findall("Piece")]
        if not self._pieces:
            raise ValueError("no Piece")
        self._offsets = np.sort(
            [
                parse_whole_number(array.get("offset", ""))
                for array in grid.iter("DataArray")
                if array.get("format") == "appended"
            ]
        )
        self.shapes = self._shapes()

    def _shapes(self) -> dict[str, tuple[int, ...]]:
        first, *others = self._pieces
        shapes = {}
        for name, array in first.arrays.items():
            rest = _components(array)
            if all(
                name in piece.arrays and _components(piece.arrays[name]) == rest for piece in others
            ):
                shapes[name] = (self.count(), *rest)
        return shapes

    def _appended_at(self, begin: int, encoding: str) -> _Raw | _Base64:
        """Appended data, which begin after the tag that ends at `begin` and an underscore."""
        file = self._file
        tail_at = max(begin, file.size - _TAIL_BYTES)
        end = file.peek(tail_at, _TAIL_BYTES).rfind(_APPENDED_END)
        if end < 0 or file.peek(tail_at + end, _TAIL_BYTES).count(b"</VTKFile>") != 1:
            raise ValueError("cut: the appended data have no end")
        start = file.find(b"_", begin)
        if start is None or start >= tail_at + end or file.take(begin, start - begin).strip():
            raise ValueError("the appended data do not begin with an underscore")
        if encoding == "raw":
            return _Raw(file, start + 1, tail_at + end)
        if encoding != "base64":
            raise ValueError(f"appended data in {encoding!r}, expected raw or base64")
        return _Base64(file.take(start + 1, tail_at + end - start - 1).rstrip())

    def _checked(self, piece: "_Piece", array: Element, name: str) -> FloatArray:
        try:
            return self._decoded(piece, array, name)
        except (
            ValueError,
            KeyError,
            TypeError,
            EOFError,
            binascii.Error,
            zlib.error,
            lzma.LZMAError,
        ) as error:
            raise _damage(error, self.path) from error

    def _decoded(self, piece: "_Piece", array: Element, name: str) -> FloatArray:
        rest = _components(array) or ((3,) if array is piece.points else ())
        count = piece.count * (rest[0] if rest else 1)
        dtype = np.dtype(_TYPES[array.attrib["type"]]).newbyteorder(self._order)
        storage = array.get("format", "ascii")
        text = "".join([array.text or "", *(key.tail or "" for key in array)])
        if storage == "ascii":
            values = numbers_in(text, count, dtype.newbyteorder("="), name)
        else:
            if storage == "appended":
                source, offset = self._appended, parse_whole_number(array.attrib["offset"])
                if source is None:
                    raise ValueError("no appended data")
            elif storage == "binary":
                source, offset = _Base64(text.translate(_BLANKS).encode("ascii")), 0
            else:
                raise ValueError(f"format {storage!r} of {name}")
            content, end = self._bytes_of(source, offset, count * dtype.itemsize, name)
            if storage == "appended":
                inner = np.searchsorted(self._offsets, [offset, end])
                if inner[1] - inner[0] > 1:
                    raise ValueError(f"{name} and another array share bytes")
            elif end != source.size:
                raise ValueError(f"{name} has more than its {count} values")
            values = np.frombuffer(content, dtype).astype(np.float64)
        return values.reshape(piece.count, *rest)

    def _bytes_of(
        self, source: _Raw | _Base64, offset: int, size: int, name: str
    ) -> tuple[bytes, int]:
        """The `size` bytes of an array, unpacked, and the offset after them."""
        if self._compressor is not None:
            return self._unpacked(source, offset, size, name)
        header_size = self._header.itemsize
        header, behind = source.take(offset, header_size)
        [stated] = np.frombuffer(header, self._header).tolist()
        if stated != size:
            raise ValueError(f"{name} has {stated} bytes, expected {size}")
        if isinstance(source, _Base64) and source.is_joined(offset, header_size):
            content, end = source.take(offset, header_size + size)
            return content[header_size:], end
        return source.take(behind, size)

    def _unpacked(
        self, source: _Raw | _Base64, offset: int, size: int, name: str
    ) -> tuple[bytes, int]:
        """As `_bytes_of`, for compressed blocks.

        Their header is the number of blocks, the size of a full block and of a partial last one
        (0: the last block is full), and the compressed size of each.
        """
        item = self._header.itemsize
        content, _ = source.take(offset, 3 * item)
        blocks, block_size, last_size = np.frombuffer(content, self._header).tolist()
        if blocks * item > source.size:
            raise ValueError(f"{name} has {blocks} blocks, more than its bytes")
        content, begin = source.take(offset, (3 + blocks) * item)
        packed_sizes = np.frombuffer(content, self._header)[3:].tolist()
        sizes = [block_size] * blocks
        if blocks and last_size:
            sizes[-1] = last_size
        if sum(sizes) != size:
            raise ValueError(f"{name} unpacks to {sum(sizes)} bytes, expected {size}")
        error = ResultError.at(self.path)
        packed_size = sum(packed_sizes)
        check_unpacked(packed_size, size, name, error, copies=COPIES)
        packed, end = source.take(begin, packed_size)
        parts, at = [], 0
        for packed_block, block in zip(packed_sizes, sizes, strict=True):
            parts.append(self._inflated(packed[at : at + packed_block], block))
            at += packed_block
        return b"".join(parts), end

    def _inflated(self, packed: bytes, size: int) -> bytes:
        """A block of exactly `size` bytes."""
        if self._compressor == _COMPRESSORS[0]:
            inflate = zlib.decompressobj()
            content = inflate.decompress(packed, size + 1)
            complete = inflate.eof
        else:
            unpack = lzma.LZMADecompressor(memlimit=_LZMA_BYTES)
            content = unpack.decompress(packed, size + 1)
            complete = unpack.eof
        if len(content) != size or not complete:
            raise ValueError(f"a block unpacks to {len(content)} bytes, expected {size}")
        return content


class _Piece:
    """A piece of a VTU: its number of points and its point arrays by name."""

    def __init__(self, piece: Element) -> None:
        self.count = parse_whole_number(piece.attrib["NumberOfPoints"])
        if self.count < 0:
            raise ValueError(f"{self.count} points")
        expected = {"Points", "Cells", "PointData", "CellData"}
        if names := {child.tag for child in piece} - expected:
            raise ValueError(f"unknown element {min(names)}")
        [points] = piece.findall("Points")
        [self.points] = points.findall("DataArray")
        self.arrays: dict[str, Element] = {}
        for array in piece.iterfind("PointData/DataArray"):
            name = array.attrib["Name"]
            if name in self.arrays:
                raise ValueError(f"two arrays {name} at the points")
            self.arrays[name] = array


def _components(array: Element) -> tuple[int, ...]:
    """``(count,)`` with the number of components; () if the file names none."""
    text = array.get("NumberOfComponents")
    if not text:  # Firedrake writes it empty
        return ()
    count = parse_whole_number(text)
    if count < 1:
        raise ValueError(f"{count} components")
    return (count,)


def _damage(error: Exception, path: Path) -> ResultError:
    problem = f"{error} is missing" if isinstance(error, KeyError) else str(error)
    return ResultError(f"invalid VTU: {problem[:120]}", path)


class VtuSeries(Series):
    """A PVD and its VTU or legacy VTK files, or one VTU at time 0."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        entries = _entries(path) if path.suffix.lower() == ".pvd" else [(0.0, path)]
        self.times = [time for time, _ in entries]
        self._data_files = [file for _, file in entries]

    def count(self) -> int:
        """Number of points of the first file."""
        with self.frame(0) as first:
            return first.count()

    def points(self) -> FloatArray:
        """Coordinates ``(P, 3)`` of the first file."""
        with self.frame(0) as first:
            return first.points()

    def frame(self, output: int) -> VtuFile | LegacyVtkFile:
        """The file of an output, opened."""
        file = self._data_files[output]
        return LegacyVtkFile(file) if file.suffix.lower() == ".vtk" else VtuFile(file)

    def key(self, output: int, names: Sequence[str]) -> Hashable:
        """The file of an output."""
        return self._data_files[output].resolve()

    def packed_bytes(self) -> int:
        """Size of the PVD and its files on disk, in bytes."""
        return disk_bytes([self.path, *self._data_files])


def _entries(path: Path) -> list[tuple[float, Path]]:
    """Time and file of each entry of a PVD."""
    root = read_xml(read_bytes(path, MAX_PVD_BYTES, ResultError.at(path)), path)
    collections = root.findall("Collection")
    if root.tag != "VTKFile" or len(collections) != 1:
        raise ResultError("invalid PVD: expected a VTKFile with one Collection", path)
    refuse_text(root, path)
    refuse_text(collections[0], path)
    sets = list(collections[0])
    if not sets:
        raise ResultError("no DataSet", path)
    timed = [item for item in sets if item.get("timestep") is not None]
    if timed and len(timed) != len(sets):
        raise ResultError(f"{len(sets) - len(timed)} of {len(sets)} entries have no timestep", path)
    entries, files = [], {}
    for item in sets:
        if item.tag != "DataSet":
            raise ResultError(f"element {item.tag}, expected DataSet", path)
        name = item.get("file", "")
        if name not in files:
            files[name] = inside(path.parent, name, path)
            if files[name].suffix.lower() not in (".vtu", ".vtk"):
                raise ResultError(f"lists {files[name].name}, expected .vtu or .vtk files", path)
        try:
            entries.append((parse_number(item.get("timestep", "0")), files[name]))
        except ValueError as error:
            raise ResultError(f"timestep of {name}: {error}", path) from error
    return entries
