"""The table of readers of result files.

Suffix and first bytes decide which reader opens a file; its module is imported then. Another
package adds a `Reader` under the entry point group ``fembridge.readers``; it is tried after
the readers of this table.
"""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from fembridge.errors import ResultError, UsageError
from fembridge.results.byte_file import ByteFile, in_words, suffix_of
from fembridge.results.history import STRESS
from fembridge.results.read_options import ReadOptions
from fembridge.typing import FloatArray

if TYPE_CHECKING:
    from fembridge.results.source import Source

ENTRY_POINTS = "fembridge.readers"

_FIRST_BYTES = 64
PRINTS = {".dat": "ccx-dat", ".sta": "ccx-sta", ".cvg": "ccx-cvg", ".sts": "marc-sts"}
"""Format names of files that solvers print, by suffix."""
STATUS = PRINTS.keys() - {".dat"}
"""Suffixes of status files, which have no values at nodes or points."""
_KNOWN_STARTS = (
    (b"\x1f\x8b", "gzip: name it .frd.gz"),
    (b"PK\x03\x04", "zip: unpack it first"),
    (b"\x89HDF", "HDF5, which is not read; of a Marc job take the .t16 or .t19"),
    (b"<?xml", "XML"),
    (b"<VTKFile", "VTK"),
    (b"# vtk", "VTK"),
    (b"\xef\xbb\xbf", "text with a byte order mark, saved by another program"),
    (b"\xff\xfe", "UTF-16 text, saved by another program"),
    (b"*", "a solver deck without results"),
)


@dataclass(frozen=True, slots=True)
class Reader:
    """A format of result files and its reader.

    Parameters
    ----------
    name
        Name of the format.
    suffix
        Suffix of its files, with the point.
    first_bytes
        First bytes of its files, or a tuple of alternatives; empty for any text.
    target
        ``module:class`` of a `fembridge.results.source.Source`; it is called with the open
        file and the options.
    has_points
        Whether values are stored at integration points, so that a method of extrapolation
        applies. Default: False.
    needs_columns
        Whether the user names the columns. Default: False.
    """

    name: str
    suffix: str
    first_bytes: bytes | tuple[bytes, ...]
    target: str
    has_points: bool = False
    needs_columns: bool = False

    def takes(self, start: bytes) -> bool:
        """Whether a file that begins with `start` may be of this format.

        A format without first bytes takes any text that no other format takes.
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
    Reader("marc-t16", ".t16", _T16_STARTS, _MARC, has_points=True),
    Reader("marc-t19", ".t19", b"=beg=", _MARC, has_points=True),
    Reader("mentat-plot", ".txt", b"", "fembridge.results.mentat:PlotSource"),
    *(Reader(name, suffix, b"", f"{_PRINTED}:PrintSource") for suffix, name in PRINTS.items()),
    Reader("table", ".csv", b"", _COLUMNS, needs_columns=True),
    Reader("npz", ".npz", b"PK\x03\x04", _COLUMNS, needs_columns=True),
    *(
        Reader(f"vtk-series {suffix}", suffix, _XML_STARTS, _COLUMNS, needs_columns=True)
        for suffix in (".vtu", ".pvd", ".xdmf")
    ),
)


def open_source(path: Path, options: ReadOptions) -> "Source":
    """Open a result file, to be read with `options`."""
    with ExitStack() as stack:
        file = stack.enter_context(ByteFile(path))
        reader = find_reader(file)
        if not reader.has_points and (options.extrapolate or options.von_mises):
            option = "extrapolate" if options.extrapolate else "von_mises"
            raise UsageError(
                f"is for a Marc post file, not for {reader.name}", path, argument=option
            )
        if options.columns and not reader.needs_columns:
            raise UsageError("is for a .csv, .npz, .vtu, .pvd or .xdmf", path, argument="columns")
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
    """Times ``(T,)`` in ms and values ``(T, node, component)`` of a quantity at `nodes`."""
    with open_source(path, options or ReadOptions()) as source:
        history = source.history(nodes, quantity)
    if not history.over_time:
        raise ResultError(f"{history.form}, expected rows over time", source.path)
    return history.at, history.values


def find_reader(file: ByteFile) -> Reader:
    """The reader for `file`, by suffix and first bytes."""
    start, suffix = file.peek(0, _FIRST_BYTES), suffix_of(file.path)
    if not start and suffix not in PRINTS:  # of a run that has begun they are empty
        raise ResultError("empty: 0 bytes", file.path)
    for reader in READERS:
        if suffix == reader.suffix and reader.takes(start):
            return reader
    for reader in _plugin_readers(file.path):
        if suffix == reader.suffix and reader.takes(start):
            return reader
    raise ResultError(_foreign_problem(file.path, start), file.path)


def _foreign_problem(path: Path, start: bytes) -> str:
    kind = next((f", {kind}" for mark, kind in _KNOWN_STARTS if start.startswith(mark)), "")
    marked = [reader for reader in READERS if reader.first_bytes]
    for reader in () if kind else marked:
        if reader.takes(start):
            return (
                f"begins like {reader.name}, but has the suffix {path.suffix or 'none'}; "
                f"rename it to {reader.suffix}"
            )
    first_bytes = {
        reader.suffix: reader.first_bytes for reader in marked if not reader.needs_columns
    }
    expected = "; ".join(
        f"{suffix} begins with {in_words(first)}"
        if isinstance(first, bytes)
        else f"{suffix} is binary"
        for suffix, first in first_bytes.items()
    )
    return f"unknown result format: begins with {in_words(start[:12])}{kind}; expected: {expected}"


def _plugin_readers(path: Path) -> Iterator[Reader]:
    """Readers of other packages, loaded only if no reader of `READERS` takes the file."""
    from importlib.metadata import entry_points

    for point in entry_points(group=ENTRY_POINTS):
        prefix = f"reader {point.name} ({point.value})"
        try:
            reader = point.load()
        except Exception as error:  # whatever another package does wrong
            raise ResultError(f"{prefix} cannot be loaded: {error!r}", path) from error
        if not isinstance(reader, Reader):
            kind = type(reader).__name__
            raise ResultError(f"{prefix} is a {kind}, expected a fembridge.results.Reader", path)
        yield reader
