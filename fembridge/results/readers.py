"""Which reader takes a result file, and what may be asked of any of them.

Suffix and first bytes both decide; a reader's module is imported when a file asks for
it. Another package adds a row, a `Reader`, under the entry point group
``fembridge.readers``; it is asked when none of ours takes the file.
"""

from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from decks.unit_system import LENGTH_UNITS, UNIT_SYSTEMS
from fembridge.errors import ResultError, UsageError
from fembridge.results.byte_file import ByteFile, suffix_of
from fembridge.typing import FloatArray

if TYPE_CHECKING:
    from fembridge.results.source import Source

ENTRY_POINTS = "fembridge.readers"

_FIRST_BYTES = 64
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
PA_PER_UNIT = {one.stress_unit: one.stress_pa for one in UNIT_SYSTEMS.values()}
METHODS = ("linear", "translate", "average")  # see `fembridge.results.extrapolation`
VON_MISES = ("tensor", "scalar")


class NotFiniteError(ResultError):
    """A NaN or an infinite value, which a partial reading may leave out."""


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """How strictly to read, in which unit, and where remarks go.

    `partial` takes what is whole of a run that did not end well, and says to `log`
    what it dropped; without it such a file is refused. `across_materials` allows the
    stress of a node on a layer boundary. `stress_unit` is the unit of the file:
    CalculiX and Marc have none, the deck decides; N and mm give MPa. `length_unit` is that
    of its coordinates and displacements, "mm", "m" or "in".

    Of a file that holds integration points (Marc's): `extrapolate` is how their
    values are carried to nodes, one of `METHODS`, None for the first.
    `von_mises` "tensor" (None too) takes the von Mises stress of the nodal tensor,
    "scalar" that of the points, carried to the node as a number.

    `branches` says of nodes in relaxing skin how many branches their stress is the
    sum of: a ``.frd`` holds the mean, over elements of that many materials.

    `on_axis` are nodes on the axis of a half of a section, where there is no shear.

    `classes` are those of the nodes at which the run's afferents sit.

    `columns` are names in a table or series by what they are, see
    `fembridge.results.columns`.
    """

    partial: bool = False
    across_materials: bool = False
    stress_unit: str = "MPa"
    log: Callable[[str], None] | None = None
    extrapolate: str | None = None
    von_mises: str | None = None
    branches: Mapping[int, int] = field(default_factory=dict)
    on_axis: Collection[int] = ()
    classes: Mapping[int, str] = field(default_factory=dict)
    length_unit: str = "mm"
    columns: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for what, value, known in (
            ("stress unit", self.stress_unit, PA_PER_UNIT),
            ("length unit", self.length_unit, LENGTH_UNITS),
            ("extrapolation", self.extrapolate or METHODS[0], METHODS),
            ("von Mises of", self.von_mises or VON_MISES[0], VON_MISES),
        ):
            if value not in known:
                raise UsageError(f"{what} {value!r}, expected {', '.join(known)}")

    @property
    def method(self) -> str:
        """How values are carried from integration points to nodes."""
        return self.extrapolate or METHODS[0]

    @property
    def length_mm(self) -> float:
        """The file's unit of length."""
        return LENGTH_UNITS[self.length_unit].length_mm

    def scale(self, unit: str) -> float:
        """What a number of the file is times, to be in `unit`; 1 in one that has no dimension.

        A force is a stress times a length squared, Pa m² is N; of lengths in mm it is taken
        as N whatever the stress is in.
        """
        stress_pa, length_mm = PA_PER_UNIT[self.stress_unit], self.length_mm
        force_n = 1.0 if length_mm == 1.0 else stress_pa * (length_mm / 1000.0) ** 2
        scales = {
            "Pa": stress_pa,
            "mm": length_mm,
            "mm/s": length_mm,
            "mm/s2": length_mm,
            "N": force_n,
        }
        return scales.get(unit, 1.0)

    def note(self, words: str) -> None:
        """Pass the remark `words` on to `log`."""
        if self.log is not None:
            self.log(words)

    def refuse(
        self, words: str, path: Path, line: int | None = None, noted: str | None = None
    ) -> None:
        """Refuse a file for `words`; a partial reading notes them, or `noted`, and goes on."""
        if not self.partial:
            raise ResultError(f"{words}; --partial (partial=True) takes what is whole", path, line)
        self.note(noted or words)


def in_pa(stress: FloatArray, options: ReadOptions, path: Path) -> FloatArray:
    """Stress of a file in Pa; a number too large to be one is a `ResultError`."""
    with np.errstate(over="ignore"):
        stress_pa: FloatArray = stress * PA_PER_UNIT[options.stress_unit]
    if not np.isfinite(stress_pa).all():
        worst = float(stress.flat[np.abs(stress).argmax()])
        raise ResultError(f"a stress of {worst:g} {options.stress_unit}", path)
    return stress_pa


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


def open_source(path: Path, options: ReadOptions) -> "Source":
    """Open a result file, to be read with `options`."""
    with ExitStack() as stack:
        file = stack.enter_context(ByteFile(path))
        reader = reader_of(file)
        if not reader.points and (options.extrapolate or options.von_mises):
            raise UsageError(
                f"{path}: {reader.name} holds values at nodes; how they are extrapolated "
                "there is asked of a Marc post file"
            )
        if options.columns and not reader.named:
            raise UsageError(f"{path}: --columns is of a .csv, .npz, .vtu, .pvd or .xdmf")
        module, _, name = reader.target.partition(":")
        source: Source = getattr(import_module(module), name)(file, options)
        stack.pop_all()
    return source


def reader_of(file: ByteFile) -> Reader:
    """The reader for `file`, by suffix and first bytes."""
    start, suffix = file.peek(0, _FIRST_BYTES), suffix_of(file.path)
    if not start:
        raise ResultError("empty: 0 bytes", file.path)
    for reader in chain(READERS, _plugged(file.path)):
        if suffix == reader.suffix and reader.takes(start):
            return reader
    raise ResultError(_foreign(file.path, start), file.path)


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
