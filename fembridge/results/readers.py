"""The table of result formats: which reader takes a file.

Suffix and first bytes both decide; a reader's module is imported when a file asks for
it. Another package adds a row, a `Reader`, under the entry point group
``fembridge.readers``; it is asked when none of ours takes the file.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from decks.dialects import JOB
from decks.unit_system import LENGTH_UNITS, MM, unit_system_in
from fembridge.errors import ResultError
from fembridge.results.byte_file import ByteFile, suffix_of
from fembridge.run_folder import RUN_FILE, read_run_folder

ENTRY_POINTS = "fembridge.readers"

_FIRST_BYTES = 64
_HEADING_BYTES = 4096  # in which a heading is sought
PRINTS = {".dat": "ccx-dat", ".sta": "ccx-sta", ".cvg": "ccx-cvg", ".sts": "marc-sts"}
"""What solvers print beside their results: names of the formats, by suffix."""
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
    `target` is ``module:class`` of a `fembridge.results.source.Source`; `points` says that the
    file holds integration points, so that the way to a node can be chosen, `named` that its
    columns have to be named.
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
_COLUMNS = "fembridge.results.columns:ColumnSource"
_ABAQUS_MARKS = (b"1\n", b"1\r\n", b"1 ", b"\n   THE FOLLOWING", b"\r\n   THE FOLLOWING")
_XML_STARTS = (b"<?xml", b"<VTKFile", b"<Xdmf", b"<!DOCTYPE")
READERS = (
    Reader("ccx-frd", ".frd", b"    1C", "fembridge.results.frd_source:FrdSource"),
    Reader("marc-t16", ".t16", _T16_STARTS, _MARC, points=True),
    Reader("marc-t19", ".t19", b"=beg=", _MARC, points=True),
    Reader("mentat-plot", ".txt", b"", "fembridge.results.mentat:PlotSource"),
    Reader("abaqus-dat", ".dat", _ABAQUS_MARKS, "fembridge.results.abaqus_dat:AbaqusSource"),
    Reader("table", ".csv", b"", _COLUMNS, named=True),
    Reader("npz", ".npz", b"PK\x03\x04", _COLUMNS, named=True),
    *(
        Reader(f"vtk-series {suffix}", suffix, _XML_STARTS, _COLUMNS, named=True)
        for suffix in (".vtu", ".pvd", ".xdmf")
    ),
)


def reader_of(path: Path) -> Reader:
    """The reader for `path`, by suffix and first bytes."""
    with ByteFile(path) as file:
        start = file.peek(0, _FIRST_BYTES)
    if not start:
        raise ResultError("empty: 0 bytes", path)
    suffix = suffix_of(path)
    for reader in READERS:
        if suffix == reader.suffix and reader.takes(start):
            return reader
    for reader in _plugged(path):
        if suffix == reader.suffix and reader.takes(start):
            return reader
    raise ResultError(_foreign(path, start), path)


def result_file(path: Path | str) -> Path:
    """The result file that `path` is, or that the run folder `path` holds.

    Of a folder: what the solver in its ``run.toml`` writes, the binary file first;
    without a ``run.toml``, what is there.
    """
    path = Path(path)
    if not path.is_dir():
        return path
    if (path / RUN_FILE).exists():
        return read_run_folder(path).results
    places = [path / f"{JOB}{reader.suffix}" for reader in READERS]
    return next((place for place in places if place.exists()), places[0])


def units_of(
    path: Path,
    stress_unit: str | None,
    length_unit: str | None,
    log: Callable[[str], None] | None = None,
) -> tuple[str, str]:
    """Units of stress and length: as asked, as the heading says, MPa and mm.

    CalculiX copies the heading to the start of its results.
    """
    held, stated = LENGTH_UNITS.get(length_unit or "mm", MM), None
    if length_unit is None and suffix_of(path) == ".frd" and path.is_file():
        with ByteFile(path) as file:
            stated = unit_system_in(file.peek(0, _HEADING_BYTES).decode("latin-1"))
    held = stated or held
    if stated is not None and log is not None:
        log(f"the heading names the unit system {stated}")
    return stress_unit or held.stress_unit, length_unit or held.length_unit


def _foreign(path: Path, start: bytes) -> str:
    if suffix_of(path) in (".dat", ".sta", ".cvg"):
        return (
            "prints of CalculiX, no nodal results: fembridge ingest makes a table of "
            "them, and --point traces of a .dat's integration points"
        )
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
