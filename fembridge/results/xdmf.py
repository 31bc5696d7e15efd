"""Temporal collections of XDMF 3, with arrays in HDF5, in raw files or in the XML.

The HDF5 files must be in the folder of the XDMF, and an array in the file that the XDMF names:
external links, external storage and virtual datasets are refused, and arrays that unpack to more
than the limits of `fembridge.host.memory`. The shape of an array comes from HDF5, or from
``Dimensions`` (xdmf.org, "XDMF Model and Format").
"""

import math
import zlib
from collections.abc import Hashable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from fembridge.errors import FembridgeError, MissingError, ResultError
from fembridge.host.memory import SMALL_BYTES, check_memory, check_unpacked
from fembridge.host.store import read_bytes
from fembridge.io.number import parse_number, parse_whole_number
from fembridge.results.series import Frame, Series, disk_bytes, inside, numbers_in
from fembridge.results.xml_tree import read_xml, refuse_text
from fembridge.typing import FloatArray

MAX_XML_BYTES = 1 << 28
COPIES = 3

_KINDS = {"Float": "f", "Int": "i", "UInt": "u", "Char": "i", "UChar": "u"}
_ORDERS = {"Little": "<", "Big": ">", "Native": "="}
_HDF5_TYPES = tuple(
    f"{kind}{bits}{order}"
    for kind, sizes in (
        ("IEEE_F", (16, 32, 64)),
        ("STD_I", (8, 16, 32, 64)),
        ("STD_U", (8, 16, 32, 64)),
    )
    for bits in sizes
    for order in ("LE", "BE")
)
_MAX_LINKS = 16
_MAX_DEFLATE = 1032
"""Highest compression ratio of deflate."""
_CHUNK_MARGIN_BYTES = 1 << 12


class XdmfSeries(Series):
    """An open XDMF file."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.folder = path.resolve().parent
        self._stack = ExitStack()
        self._hdf5: dict[Path, Any] = {}
        with _damage(path):
            root = read_xml(read_bytes(path, MAX_XML_BYTES, ResultError.at(path)), path)
            if root.tag != "Xdmf" or root.get("Version", "").split(".")[0] != "3":
                version = root.get("Version", "none")
                raise ResultError(f"XDMF of version {version}, expected 3", path)
            _refuse_includes(root, path)
            [domain] = list(root)
            grids = domain.findall("Grid")
            collections = [grid for grid in grids if grid.get("GridType") == "Collection"]
            if domain.tag != "Domain" or not collections:
                raise ResultError("not a series: expected a Grid with GridType Collection", path)
            collection = collections[-1]
            if collection.get("CollectionType") != "Temporal":
                raise ResultError("the collection is not over time (Temporal)", path)
            if names := {child.tag for child in collection} - {"Grid", "Information"}:
                raise ResultError(f"{min(names)} in the collection, expected Grid", path)
            self._grids = collection.findall("Grid")
            self.times = [_time_of(grid) for grid in self._grids]
            for element in (root, domain, collection, *self._grids):
                refuse_text(element, path)
            uniform = [grid for grid in grids if grid.get("GridType") == "Uniform"]
            uniform = uniform[-1:] or [
                grid for grid in self._grids if grid.get("GridType") == "Uniform"
            ]
            geometry = uniform[0].findall("Geometry") if uniform else []
            if len(geometry) != 1:
                raise ResultError("no mesh: expected a Grid with a Geometry", path)
            kind = geometry[0].get("GeometryType", geometry[0].get("Type", "XYZ"))
            if kind not in ("XY", "XYZ"):
                raise ResultError(f"a geometry of type {kind}, expected XY or XYZ", path)
            self._geometry = _item_of(geometry[0])

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def points(self) -> FloatArray:
        """Coordinates ``(P, 3)``."""
        with _damage(self.path):
            points = self.read(self._geometry, "the geometry")
            if points.ndim != 2 or points.shape[1] not in (2, 3) or not np.isfinite(points).all():
                shape = points.shape
                raise ValueError(f"points of shape {shape}, expected finite (P, 2) or (P, 3)")
        return points

    def count(self) -> int:
        """Number of points."""
        with _damage(self.path):
            return self.shape(self._geometry)[0]

    def frame(self, output: int) -> "XdmfFrame":
        """The arrays of an output."""
        return XdmfFrame(self, output)

    def items(self, output: int) -> dict[str, Element]:
        """Items of an output with arrays at nodes, by name."""
        items: dict[str, Element] = {}
        with _damage(self.path):
            for attribute in self._grids[output].findall("Attribute"):
                center, name = attribute.get("Center", "Node"), attribute.attrib["Name"]
                if center not in ("Node", "Cell", "Grid"):
                    raise ValueError(f"an array at {center}, expected Node or Cell")
                if center != "Node":
                    continue
                if name in items:
                    raise ValueError(f"two arrays {name} at the nodes")
                items[name] = _item_of(attribute)
        return items

    def key(self, output: int, names: Sequence[str]) -> Hashable:
        """Names of the datasets or raw files of an output; its number for arrays in the XML."""
        items = self.items(output)
        return tuple(
            output
            if items[name].get("Format", "XML") == "XML"
            else (items[name].text or "").strip()
            for name in names
            if name in items
        )

    def doubts(self, names: Sequence[str]) -> list[str]:
        """Warnings about arrays `names` that share storage with another array."""
        names_of: dict[str, set[str]] = {}
        for output in range(len(self._grids)):
            for name, item in self.items(output).items():
                if item.get("Format", "XML") != "XML":
                    names_of.setdefault((item.text or "").strip(), set()).add(name)
        return [
            f"{source} is both {' and '.join(sorted(shared))}"
            for source, shared in names_of.items()
            if len(shared) > 1 and shared & set(names)
        ]

    def packed_bytes(self) -> int:
        """Size in bytes of the XDMF and of the files with its arrays."""
        files = {self.path}
        for grid in self._grids:
            for item in grid.iter("DataItem"):
                text = (item.text or "").strip()
                if item.get("Format") == "HDF":
                    files.add(self.folder / text.rpartition(":")[0])
                elif item.get("Format") == "Binary":
                    files.add(self.folder / text)
        return disk_bytes(files)

    def shape(self, item: Element) -> tuple[int, ...]:
        """Shape of an array, from its header."""
        if item.get("Format") == "HDF":
            return tuple(self._dataset(item).shape)
        return _dimensions(item)

    def read(self, item: Element, name: str) -> FloatArray:
        """The array of a ``DataItem`` as float64."""
        storage, shape, error = (
            item.get("Format", "XML"),
            self.shape(item),
            ResultError.at(self.path),
        )
        size = math.prod(shape)
        check_memory(COPIES * 8.0 * size, name, error)
        if storage == "HDF":
            dataset = self._dataset(item)
            if size != math.prod(_dimensions(item)):
                raise ValueError(f"{name} has shape {shape}, not {item.get('Dimensions')}")
            stated = item.get("DataType", item.get("NumberType"))
            if stated and (_KINDS[stated] == "f") != (dataset.dtype.kind == "f"):
                raise ValueError(f"{name} is of type {dataset.dtype}, not {stated}")
            self._check_dataset(dataset, name)
            return np.asarray(dataset[()], dtype=np.float64)
        dtype = _type_of(item)
        text = item.text or ""
        if storage == "XML":
            return numbers_in(text, size, dtype.newbyteorder("="), name).reshape(shape)
        if storage != "Binary":
            raise ValueError(f"format {storage!r}, expected HDF, XML or Binary")
        if item.get("Compression", "Raw") != "Raw":
            raise ValueError(f"binary data compressed by {item.get('Compression')}")
        file = inside(self.folder, text.strip(), self.path)
        seek, file_bytes = parse_whole_number(item.get("Seek", "0")), file.stat().st_size
        end = seek + size * dtype.itemsize
        if seek < 0 or end > file_bytes or (not seek and end < file_bytes):
            raise ValueError(f"{file.name} has {file_bytes} bytes, expected {end}")
        return np.fromfile(file, dtype, size, offset=seek).astype(np.float64).reshape(shape)

    def _dataset(self, item: Element) -> Any:  # noqa: ANN401 - h5py has no types
        name, _, inner = (item.text or "").strip().rpartition(":")
        file = inside(self.folder, name, self.path)
        if file not in self._hdf5:
            h5py = _h5py()
            self._hdf5[file] = self._stack.enter_context(h5py.File(file, "r"))
        return _linked(self._hdf5[file], inner, self.path)

    def _check_dataset(self, dataset: Any, name: str) -> None:  # noqa: ANN401
        """Raise an error if the chunks of a dataset unpack to more than the limits."""
        error = ResultError.at(self.path)
        packed_bytes = dataset.id.get_storage_size()
        check_unpacked(packed_bytes, dataset.nbytes, name, error, copies=COPIES)
        if dataset.chunks is None:
            return
        chunk_bytes = math.prod(dataset.chunks) * dataset.dtype.itemsize
        check_unpacked(packed_bytes, chunk_bytes, f"a chunk of {name}", error)
        most = chunk_bytes + chunk_bytes // 100 + _CHUNK_MARGIN_BYTES

        def check(chunk: Any) -> None:  # noqa: ANN401
            if chunk.size > most:
                raise ValueError(f"a chunk of {name} has {chunk.size} bytes, expected {most}")
            if chunk.size * _MAX_DEFLATE > SMALL_BYTES:
                large.append(chunk.chunk_offset)

        large: list[tuple[int, ...]] = []
        if packed_bytes * _MAX_DEFLATE > SMALL_BYTES:
            dataset.id.chunk_iter(check)
        if dataset.compression != "gzip":
            return
        for offset in large:  # HDF5 unpacks a chunk without a limit
            _, packed = dataset.id.read_direct_chunk(offset)
            if len(zlib.decompressobj().decompress(packed, most + 1)) > most:
                raise ValueError(f"a chunk of {name} unpacks to more than {most} bytes")


class XdmfFrame(Frame):
    """One output of an XDMF file: its arrays at nodes."""

    def __init__(self, series: XdmfSeries, output: int) -> None:
        self._series, self._items = series, series.items(output)
        super().__init__(_LazyShapes(series, self._items))

    def read(self, name: str) -> FloatArray:
        """The array `name` at the nodes."""
        with _damage(self._series.path):
            return self._series.read(self._items[name], name)


class _LazyShapes(Mapping[str, tuple[int, ...]]):
    """Shapes by name, each read from its header on access."""

    def __init__(self, series: XdmfSeries, items: Mapping[str, Element]) -> None:
        self._series, self._items = series, items

    def __getitem__(self, name: str) -> tuple[int, ...]:
        with _damage(self._series.path):
            return self._series.shape(self._items[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def __contains__(self, name: object) -> bool:
        return name in self._items


def _h5py() -> Any:  # noqa: ANN401 - an extra without types
    try:
        import h5py
    except ImportError as error:
        raise MissingError("h5py is missing, needed to read HDF5: pip install h5py") from error
    return h5py


def _linked(file: Any, name: str, path: Path) -> Any:  # noqa: ANN401
    """The dataset `name` of an HDF5 file, through hard and soft links in that file only."""
    h5py = _h5py()
    parts, node, links = [part for part in name.split("/") if part], file, 0
    while parts:
        part = parts.pop(0)
        link = node.get(part, getlink=True) if isinstance(node, h5py.Group) else None
        if isinstance(link, h5py.SoftLink):
            links += 1
            if links > _MAX_LINKS:
                raise ResultError(f"circular links of {name[:60]}", path)
            node = file if link.path.startswith("/") else node
            parts = [step for step in link.path.split("/") if step] + parts
        elif isinstance(link, h5py.HardLink):
            node = node[part]
        elif link is None:
            raise ResultError(f"no dataset {name[:60]} in the HDF5 file", path)
        else:
            raise ResultError(f"{name[:60]} is a link to another file, not supported", path)
    if not isinstance(node, h5py.Dataset):
        raise ResultError(f"{name[:60]} is not a dataset of the HDF5 file", path)
    if node.is_virtual or node.external:
        raise ResultError(f"{name[:60]} is stored in another file, not supported", path)
    types = [getattr(h5py.h5t, name) for name in _HDF5_TYPES]
    if node.shape is None or not any(node.id.get_type().equal(kind) for kind in types):
        raise ResultError(f"{name[:60]} is of type {node.dtype}, expected real numbers", path)
    return node


def _refuse_includes(root: Element, path: Path) -> None:
    for element in root.iter():
        if element.tag.rpartition(":")[2] == "include" and element.get("href"):
            raise ResultError(f"includes {element.get('href')!r}, not supported", path)


def _time_of(grid: Element) -> float:
    times = grid.findall("Time")
    if len(times) != 1:
        raise ValueError(f"{len(times)} times of an output, expected one")
    return parse_number(times[0].attrib["Value"])


def _item_of(element: Element) -> Element:
    items = list(element)
    if len(items) != 1 or items[0].tag != "DataItem":
        raise ValueError(f"{len(items)} items in {element.tag}, expected one DataItem")
    if items[0].get("ItemType", "Uniform") != "Uniform" or "Reference" in items[0].attrib:
        raise ValueError("a DataItem that refers to others, not supported")
    return items[0]


def _dimensions(item: Element) -> tuple[int, ...]:
    shape = tuple(map(parse_whole_number, item.attrib["Dimensions"].split()))
    if not shape or min(shape) < 0:
        raise ValueError(f"dimensions {item.get('Dimensions')!r}")
    return shape


def _type_of(item: Element) -> np.dtype[Any]:
    kind = _KINDS[item.get("DataType", item.get("NumberType", "Float"))]
    size = 1 if item.get("DataType", item.get("NumberType")) in ("Char", "UChar") else 4
    size = parse_whole_number(item.get("Precision", str(size)))
    if size not in ((4, 8) if kind == "f" else (1, 2, 4, 8)):
        raise ValueError(f"precision {size} of {kind}")
    return np.dtype(f"{_ORDERS[item.get('Endian', 'Native')]}{kind}{size}")


@contextmanager
def _damage(path: Path) -> Iterator[None]:
    """Turn any error of h5py and the parser about damage into a `ResultError`."""
    try:
        yield
    except (FembridgeError, MemoryError):
        raise
    except Exception as error:
        problem = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        problem = " ".join(problem.split())[:120]
        raise ResultError(f"invalid XDMF: {problem}", path) from error
