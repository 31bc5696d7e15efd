"""Which reader takes a result file.

Suffix and first bytes both decide; a reader's module is imported when a file asks for
it. Another package adds a row, a `Reader`, under the entry point group
``fembridge.readers``; it is asked when none of ours takes the file.
"""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from fembridge.errors import ResultError, UsageError
from fembridge.results.byte_file import ByteFile, suffix_of
from fembridge.results.history import STRESS
from fembridge.results.read_options import ReadOptions
from fembridge.typing import FloatArray

if TYPE_CHECKING:
    from fembridge.results.source import Source

ENTRY_POINTS = "fembridge.readers"

_FIRST_BYTES = 64
PRINTS = {".dat": "ccx-dat", ".sta": "ccx-sta", ".cvg": "ccx-cvg", ".sts": "marc-sts"}
"""What solvers print beside their results: names of the formats, by suffix."""
STATUS = PRINTS.keys() - {".dat"}
"""Those without a number at a node or a point: no result of a folder."""
_KNOWN_STARTS = (
    (b"\x1f\x8b", "gzip: name it .frd.gz"),
    (b"PK\x03\x04", "zip: unpack it first"),
    (b"\x89HDF", "HDF5, which is not read; of a Marc job take the .t16 or .t19"),
    (b"<?xml", "XML"),
    (b"<VTKFile", "VTK"),
    (b"# vtk", "VTK"),
    (b"\xef\xbb\xbf", "text with a byte order mark: saved again by another program"),
    (b"\xff\xfe", "UTF-16 text: saved again by another program"),
    (b"*", "a solver deck, no results"),
)


@dataclass(frozen=True, slots=True)
class Reader:
    """A format: its `suffix`, its `first_bytes`, and where it is read.

    `first_bytes` may be several, of which a file has one, or none: any text.
    `target` is ``module:class`` of a `fembridge.results.source.Source`, which is called with
    the open file and the options; `points` says that the file holds integration points, so that
    the way to a node can be chosen, `named` that its columns have to be named.
    """

    name: str
    suffix: str
    first_bytes: bytes | tuple[bytes, ...]
    target: str
    points: bool = False
    named: bool = False

    def takes(self, start: bytes) -> bool:
        """Whether a file that begins with `start` may be of this format.

        Of one without first bytes, any that is text and begins as no other.
        """
        if self.first_bytes:
            return start.startswith(self.first_bytes)
        others = [other for other in READERS if other.first_bytes]
        return b"\0" not in start and not any(other.takes(start) for other in others)


# A binary post file of Marc begins with the length of its first record, 70 words of 4
# bytes, least byte first or last.
_T16_STARTS = ((280).to_bytes(4, "little"), (280).to_bytes(4, "big"))
_MARC = "fembridge.results.marc:MarcSource"
_PRINTED = "fembridge.results.printed"
_COLUMNS = "fembridge.results.columns:ColumnSource"
_XML_STARTS = (b"<?xml", b"<VTKFile", b"<Xdmf", b"<!DOCTYPE")
READERS = (
    Reader("ccx-frd", ".frd", b"    1C", "fembridge.results.frd:FrdSource"),
    Reader("marc-t16", ".t16", _T16_STARTS, _MARC, points=True),
    Reader("marc-t19", ".t19", b"=beg=", _MARC, points=True),
    Reader("mentat-plot", ".txt", b"", "fembridge.results.mentat:PlotSource"),
    *(Reader(name, suffix, b"", f"{_PRINTED}:PrintSource") for suffix, name in PRINTS.items()),
    Reader("table", ".csv", b"", _COLUMNS, named=True),
    Reader("npz", ".npz", b"PK\x03\x04", _COLUMNS, named=True),
    *(
        Reader(f"vtk-series {suffix}", suffix, _XML_STARTS, _COLUMNS, named=True)
        for suffix in (".vtu", ".pvd", ".xdmf")
    ),
)


def open_source(path: Path, options: ReadOptions) -> "Source":
    """Open a result file, to be read with `options`."""
    with ExitStack() as stack:
        file = stack.enter_context(ByteFile(path))
        reader = reader_of(file)
        if not reader.points and (options.extrapolate or options.von_mises):
            raise UsageError(
                f"{path}: {reader.name}: how values are extrapolated to nodes is asked of a Marc "
                "post file alone"
            )
        if options.columns and not reader.named:
            raise UsageError(f"{path}: --columns is of a .csv, .npz, .vtu, .pvd or .xdmf")
        module, _, name = reader.target.partition(":")
        source: Source = getattr(import_module(module), name)(file, options)
        source.format = reader.name
        stack.pop_all()
    return source


def read_values(
    path: Path,
    nodes: Sequence[int],
    options: ReadOptions | None = None,
    *,
    quantity: str = STRESS,
) -> tuple[FloatArray, FloatArray]:
    """A quantity at `nodes`, in that order: times ``(T,)`` in ms, ``(T, node, component)``."""
    with open_source(path, options or ReadOptions()) as source:
        found = source.history(nodes, quantity)
    if not found.over_time:
        raise ResultError(f"{found.form}, expected rows over time", source.path)
    return found.at, found.values


def reader_of(file: ByteFile) -> Reader:
    """The reader for `file`, by suffix and first bytes."""
    start, suffix = file.peek(0, _FIRST_BYTES), suffix_of(file.path)
    if not start and suffix not in PRINTS:  # of a run that has begun they are empty
        raise ResultError("empty: 0 bytes", file.path)
    for reader in READERS:
        if suffix == reader.suffix and reader.takes(start):
            return reader
    for reader in _plugged(file.path):
        if suffix == reader.suffix and reader.takes(start):
            return reader
    raise ResultError(_foreign(file.path, start), file.path)


def _foreign(path: Path, start: bytes) -> str:
    kind = next((f", {kind}" for mark, kind in _KNOWN_STARTS if start.startswith(mark)), "")
    marked = [reader for reader in READERS if reader.first_bytes]
    for reader in () if kind else marked:
        if reader.takes(start):
            return (
                f"begins like {reader.name} and is named {path.suffix or 'nothing'}: "
                f"rename it to {reader.suffix}"
            )
    firsts = {one.suffix: one.first_bytes for one in marked if not one.named}
    wanted = "; ".join(
        f"{suffix} begins with {(first if isinstance(first, bytes) else first[0])!r}"
        for suffix, first in firsts.items()
    )
    return f"no result file we read: begins with {start[:12]!r}{kind}; {wanted}"


def _plugged(path: Path) -> Iterator[Reader]:
    """Readers of other packages; none is loaded as long as one of ours takes the file."""
    from importlib.metadata import entry_points

    for point in entry_points(group=ENTRY_POINTS):
        where = f"reader {point.name} ({point.value})"
        try:
            reader = point.load()
        except Exception as error:  # whatever another package does wrong
            raise ResultError(f"{where} cannot be loaded: {error!r}", path) from error
        if not isinstance(reader, Reader):
            kind = type(reader).__name__
            raise ResultError(f"{where} is a {kind}, expected a fembridge.results.Reader", path)
        yield reader
