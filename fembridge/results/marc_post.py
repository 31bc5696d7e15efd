"""Post files of Marc, ``.t16`` (binary) or ``.t19`` (text): mesh, increments, values.

>>> with ByteFile(Path("job.t16")) as file:  # doctest: +SKIP
...     post = PostFile(file)
...     for increment in post.increments:
...         print(increment.time_s, post.nodal_values(increment.row, "Displacement"))

Opening a file walks from block to block and stores the offsets of values; only requested values
are read. Numbers are as in the file, which has no units.

Both kinds have the same blocks and records. Between records are the marks ``=beg=NNNNN (Name)``
(NNNNN is a block number followed by two digits of its revision), ``=end=``, ``****`` (start of an
increment), ``----`` (end of an increment) and ``++++`` (end of the file). In a ``.t16`` a record
is its length, its content, and its length again: unformatted sequential records of Fortran, with
one character of a text in each word of four bytes. In a ``.t19`` a record begins on a new line and
has six numbers a line, I13 or E13.6, without separators.

An unknown block is skipped up to its ``=end=``, with a remark. Damaged values, or values of an
unknown structure, are skipped too, but the file then has a problem. An increment is complete with
its ``----``. The walk ends at any other damage, at the end of a cut file, or at a new mesh
(remeshing is not supported); the increments before it are read.

Source: real files of post revisions 12 and 14, of Marc 2020 to 2023.1; the names of the
verification integers are Marc's. Reals of eight bytes and big-endian files are documented, but no
such file was available.
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fembridge.errors import ResultError
from fembridge.results.byte_file import ByteFile
from fembridge.trace import seconds_to_ms
from fembridge.typing import FloatArray, IntArray

BEGIN, END = "=beg=", "=end="
INCREMENT, INCREMENT_END, FILE_END = "****", "----", "++++"
_MARKS = (INCREMENT, INCREMENT_END, FILE_END)
_INTEGERS, _SETS = 517, 513  # two of the blocks in `_MODEL` and `_INCREMENT`
_MESH_BLOCKS = range(502, 515)  # blocks that an increment with a new mesh has
# Blocks that are skipped without a remark: real files have them, or they are documented.
_SKIPPED_BLOCKS = (
    501,
    504,
    505,
    510,
    514,
    515,
    516,
    519,
    520,
    529,
    *range(530, 537),
    *range(540, 544),
)
_TESTED_REVISIONS = (12, 14)

_SET_KINDS = {0: "element", 1: "node", 12: "edge", 13: "face", 18: "edge", 19: "face"}
_SIDE_SET_KINDS = (12, 13, 18, 19)
_COUNT_NAMES = {
    0: "values a point", 1: "nodes", 2: "elements", 4: "points an element",
    8: "coordinates a node", 9: "nodes an element",
}  # fmt: skip
_CODES_OF_A_LAYER = 1000
_VERIFICATION_WORDS, _INCREMENT_WORDS, _QUANTITY_WORDS = (18, 12), 12, 12
_ALL_NODES, _NO_NODES = -1, 0
_COMPLEX_KINDS = (4, 5)
# Of a nodal quantity, and of one that is 0 at all nodes; real files have up to six.
_MAX_COMPONENTS, _MAX_COMPONENTS_WITHOUT_DATA = 1000, 36

_WORD_BYTES = _MARKER_BYTES = 4  # bytes
_TITLE_WORDS, _LABEL_WORDS, _LONG_LABEL_WORDS = 70, 24, 48
_FIELD_CHARACTERS, _LINE_FIELDS = 13, 6  # characters of a number as text
_TEXT = np.dtype(f"S{_FIELD_CHARACTERS}")
_MAX_TEXT_BYTES = 1 << 16
_CHUNK_BYTES = 1 << 22  # at once
_GAP_BYTES = 1 << 12  # places nearer than that are read together
_SMALL_INCREMENT_BYTES = 1 << 18  # smaller increments are read as a whole
_MAX_BLANK_BYTES = 1 << 16  # after the end of a file
# Bytes that NumPy accepts in a number and Fortran does not print: 1_000, an early end.
_FOREIGN_BYTES = np.frombuffer(b"_\0", dtype=np.uint8)
_REAL = re.compile(rb" *([+-]?(?:\d+\.?\d*|\.\d+))(?:[EeDd]?([+-]\d+))? *")

Fixed = tuple[tuple[int, bytes], ...]
"""Texts that each row of a table contains, with their offsets."""


class PostDamageError(Exception):
    """Damage that begins at byte `offset`."""

    def __init__(self, problem: str, offset: int) -> None:
        super().__init__(problem, offset)
        self.problem, self.offset = problem, offset


@dataclass(frozen=True, slots=True)
class PostCode:
    """A value that is stored at each integration point.

    `code` is Marc's element post code (17 von Mises, 311 to 316 the stress tensor 11 22 33 12 23
    31); `layer` is 0 if the deck names none.
    """

    code: int
    layer: int
    label: str


@dataclass(frozen=True, slots=True, eq=False)
class PostSet:
    """A named set: `kind` is "node", "element", "edge", "face" or "type N".

    `members` ``(M,)`` are numbers of nodes or elements; for edges and faces of their elements.
    """

    name: str
    kind: str
    members: IntArray


@dataclass(frozen=True, slots=True, eq=False)
class PostMesh:
    """A model: `node_ids` ``(N,)``, `coordinates_mm` ``(N, 3)``, elements.

    `element_ids` and `element_types` are ``(E,)``; `connectivity` ``(E, K)`` has node numbers,
    filled with 0. `extras` ``(E, X)`` are the additional numbers of block 50702, apparently
    geometry, material and body ids. Pressure nodes of Herrmann elements are nodes with
    coordinates of zero.
    """

    node_ids: IntArray
    coordinates_mm: FloatArray
    element_ids: IntArray
    element_types: IntArray
    connectivity: IntArray
    extras: IntArray
    sets: tuple[PostSet, ...] = ()


@dataclass(frozen=True, slots=True)
class NodalQuantity:
    """A quantity at all nodes in one increment; without `numbers` all values are zero.

    `is_complex` marks a quantity with an imaginary part, which is not read.
    """

    name: str
    code: int
    components: int
    is_complex: bool
    numbers: "_Numbers | None"


class PostIncrement(NamedTuple):
    """One increment: Marc's numbers, the solver's time in s, and the position of its values.

    `row` is the index of the increment in the file, from 0. `harmonic` is Marc's IHRESP, 0 for an
    increment over time; otherwise the increment has a `frequency`. Values are `offset` bytes
    after those of `layout`.
    """

    row: int
    increment: int
    sub_increment: int
    time_s: float
    harmonic: int
    frequency: float
    layout: "_Layout"
    offset: int

    @property
    def nodal(self) -> Sequence[NodalQuantity]:
        """Quantities at nodes."""
        return self.layout.nodal

    @property
    def has_element_values(self) -> bool:
        """Whether the increment has values at integration points."""
        return self.layout.element_values is not None


class PostFile:
    """An open ``.t16`` or ``.t19``.

    `kind` is "t16" or "t19", `byte_order` "little" or "big" ("little" for text), `precision`
    "single" or "double". `problem` says where the file is cut or damaged, or which values are
    left out; None for a complete file. The model has a title, a revision, counts (with Marc's
    names), and the positions of its tables.
    """

    title = ""
    revision = 0  # POSTRV
    values = 0  # INUM, at each point
    nodes = 0  # LNUM
    elements = 0  # MNUM
    points = 0  # NSTRES, of each element
    dimensions = 0  # NCRD, coordinates of a node
    corners = 0  # NNODMX, nodes of an element
    connectivity: "_Numbers | None" = None
    node_ids: "_Numbers | None" = None
    coordinates: "_Numbers | None" = None

    def __init__(self, file: ByteFile) -> None:
        self._file, self.path = file, file.path
        self.remarks: list[str] = []
        self.problem: str | None = None
        self.increments: list[PostIncrement] = []
        self.codes: tuple[PostCode, ...] = ()
        self.sets: list[tuple[str, int, _Numbers | None]] = []
        self._template: _Template | None = None
        self._context, self._location = "of the model", "at the beginning"
        self._block_numbers: dict[str, str] = {}  # of blocks, by their names
        self._left_out: list[str] = []  # values that are left out
        self._records = _open_records(file)
        self._walk()
        self.kind, self.byte_order = self._records.kind, self._records.byte_order
        self.precision = "double" if self._records.real_bytes == 8 else "single"

    @cached_property
    def mesh(self) -> PostMesh:
        """Model, read on first access; a damaged model raises a `ResultError`."""
        ids = self.node_ids
        if self.nodes and ids is None:
            raise ResultError(f"{self.nodes} nodes, but no node block", self.path)
        no_ids = np.empty(0, dtype=np.int64)
        table = np.empty((0, 3), dtype=np.int64)
        if self.connectivity is not None:
            table = self.connectivity.values(self._file)
        coordinates_mm = np.zeros((self.nodes, 3))
        if self.coordinates is not None:
            coordinates = self.coordinates.values(self._file)[:, :3]
            coordinates_mm[:, : coordinates.shape[1]] = coordinates
        corners, used = table[:, 3 : 3 + self.corners].copy(), table[:, 2]
        if used.size and (used.min() < 0 or used.max() > self.corners):
            bad = int(np.flatnonzero((used < 0) | (used > self.corners))[0])
            message = f"element {table[bad, 0]} announces {used[bad]} nodes"
            raise ResultError(f"{message}, expected up to {self.corners}", self.path)
        absent = np.arange(corners.shape[1]) >= used[:, None]
        corners[absent] = 0
        if (odd := np.argwhere((corners <= 0) & ~absent)).size:
            row, corner = odd[0].tolist()
            message = f"element {table[row, 0]} has node {corners[row, corner]}, expected 1 or more"
            raise ResultError(message, self.path)
        sets = []
        for name, number, members in self.sets:
            kind = _SET_KINDS.get(number, f"type {number}")
            sets.append(
                PostSet(name, kind, no_ids if members is None else members.values(self._file)[0])
            )
        return PostMesh(
            node_ids=no_ids if ids is None else self._check_unique(ids.values(self._file)[:, 0]),
            coordinates_mm=coordinates_mm,
            element_ids=table[:, 0].copy(),
            element_types=table[:, 1].copy(),
            connectivity=corners,
            extras=table[:, 3 + self.corners :].copy(),
            sets=tuple(sets),
        )

    def _check_unique(self, nodes: IntArray) -> IntArray:
        """`nodes` as they are; a duplicate raises a `ResultError`."""
        ids, counts = np.unique(nodes, return_counts=True)
        if (counts > 1).any():
            raise ResultError(f"node {ids[counts > 1][0]} is duplicate", self.path)
        return nodes

    def element_values(self, row: int, element_rows: IntArray) -> FloatArray:
        """Values of increment `row` at all points of elements, ``(K, points, codes)``.

        `element_rows` are rows of elements in the mesh. The increment must have element values.
        """
        increment = self.increments[row]
        numbers = increment.layout.element_values
        assert numbers is not None
        elements = np.asarray(element_rows, dtype=np.int64)
        records = (elements[:, None] * self.points + np.arange(self.points)).ravel()
        values: FloatArray = numbers.values(self._file, records, increment.offset)
        return values.reshape(elements.size, self.points, self.values)

    def nodal_values(self, row: int, name: str) -> FloatArray:
        """A nodal quantity of increment `row` at all nodes, ``(N, components)``.

        A quantity that the file marks as without data is zero.
        """
        increment = self.increments[row]
        quantity = next(candidate for candidate in increment.nodal if candidate.name == name)
        if quantity.numbers is None:
            return np.broadcast_to(0.0, (self.nodes, quantity.components))
        values: FloatArray = quantity.numbers.values(self._file, offset=increment.offset)
        return values

    def _walk(self) -> None:
        """Read all blocks up to the end or the first damage."""
        records = self._records
        try:
            self._read_blocks(_MODEL, self)
            if records.read_mark() not in (INCREMENT, FILE_END):
                raise self._unexpected_error(f"{BEGIN} or {INCREMENT}")
        except PostDamageError as damage:
            raise ResultError(f"incomplete model: {self._locate(damage)}", self.path) from damage
        if self.revision not in _TESTED_REVISIONS:
            message = f"post revision {self.revision} is untested; tested with files of 12 and 14"
            self.remarks.append(message)
        self._location = "before the first increment"
        try:
            while (mark := records.read_mark()) == INCREMENT:
                if self._template is not None and self._match_template(self._template):
                    continue
                self._read_increment()
            self._location = "at the end"
            if mark == FILE_END:
                records.skip_mark()
                rest = self._file.size - records.offset
                if self._file.peek(records.offset, min(rest, _MAX_BLANK_BYTES)).strip():
                    self.remarks.append(f"{rest} bytes after the end mark of the file")
            elif records.offset < self._file.size:
                raise self._unexpected_error(f"{INCREMENT} or {FILE_END}")
            else:
                self.problem = f"no end mark {FILE_END}: the run is in progress, or was stopped"
        except PostDamageError as damage:
            self.problem = self._locate(damage)
        if self._left_out:
            rest_text = f"; and {len(self._left_out) - 1} more" if len(self._left_out) > 1 else ""
            message = f"{self._left_out[0]}{rest_text}"
            self.problem = message if self.problem is None else f"{message}; {self.problem}"

    def _read_increment(self) -> None:
        records = self._records
        layout = _Layout(records.offset, self)
        records.free.clear()
        self._location = self._context = f"of the increment that begins at byte {layout.start}"
        records.skip_mark()
        self._read_blocks(_INCREMENT, layout)
        if records.read_mark() != INCREMENT_END:
            raise self._unexpected_error(f"{BEGIN} or {INCREMENT_END}")
        records.skip_mark()
        if layout.integers is None or layout.reals is None:
            raise PostDamageError("an increment without number and time", layout.start)
        self._template = _Template.from_increment(self._file, layout, records.offset, records.free)
        integers, reals = (part.values(self._file) for part in (layout.integers, layout.reals))
        self._add_increment(layout, 0, integers[0].tolist(), reals[0].tolist())

    def _match_template(self, template: "_Template") -> bool:
        """Add the next increments with the structure of `template`; False if there are none."""
        records, layout = self._records, template.layout
        matches = template.match(self._file, records.offset)
        for integers, reals in matches:
            self._add_increment(layout, records.offset - layout.start, integers, reals)
            records.offset += template.length
        return bool(matches)

    def _add_increment(
        self, layout: "_Layout", offset: int, integers: list[int], reals: list[float]
    ) -> None:
        number, sub_increment, harmonic = integers[1], integers[2], integers[6]
        try:
            seconds_to_ms(reals[0])
            if not math.isfinite(reals[1]):
                raise ValueError(f"frequency is {reals[1]:g}, expected a finite number")
        except ValueError as error:
            raise PostDamageError(str(error), layout.start + offset) from error
        if self.increments and number < (previous := self.increments[-1].increment):
            self.remarks.append(f"increment {number} follows increment {previous}")
        fields = (
            len(self.increments),
            number,
            sub_increment,
            reals[0],
            harmonic,
            reals[1],
            layout,
            offset,
        )
        self.increments.append(PostIncrement(*fields))

    def _read_blocks(
        self, readers: Mapping[int, "_ReadBlock"], target: "PostFile | _Layout"
    ) -> None:
        """Read the next blocks into `target`; skip blocks without a reader."""
        records = self._records
        while (mark := records.read_mark()).startswith(BEGIN):
            number = mark[len(BEGIN) :].split(" ", 1)[0]
            self._location = f"in block {number} {self._context}"
            if len(number) != 5 or not number.isdecimal():
                raise PostDamageError(f"{mark!r} without a block number", records.offset)
            base, records.revision = divmod(int(number), 100)
            if readers is _INCREMENT and base in _MESH_BLOCKS:
                raise PostDamageError("a new mesh (remeshing), not supported", records.offset)
            records.skip_mark()
            unknown = f"left out: unknown block {mark[len(BEGIN) :]}"
            name = mark.partition("(")[2]
            if name and self._block_numbers.setdefault(name, number) != number:
                message = f"({name} had number {self._block_numbers[name]} before"
                raise PostDamageError(f"{mark[len(BEGIN) :]}: {message}", records.offset)
            if base in readers:
                self._read_optional(base, readers[base], target)
            elif base not in _SKIPPED_BLOCKS and unknown not in self.remarks:
                self.remarks.append(unknown)
            records.skip_block()
            records.skip_mark()

    def _read_optional(
        self, base: int, read_block: "_ReadBlock", target: "PostFile | _Layout"
    ) -> None:
        """Read a block; leave out an optional block of unknown structure, with a note."""
        records = self._records
        start, free_count = records.offset, len(records.free)
        repeat_note = "" if target is self else ", also in increments of the same structure"
        notes = self._left_out if base in _VALUE_BLOCKS else self.remarks
        try:
            read_block(records, target)
            if records.read_mark() != END:
                notes.append(f"left out {self._location}: unknown content{repeat_note}")
        except PostDamageError as damage:
            if base not in _OPTIONAL_BLOCKS:
                raise
            records.offset = start
            del records.free[free_count:]
            try:
                records.skip_block()
            except PostDamageError:
                raise damage from None
            notes.append(f"left out: {self._locate(damage)}{repeat_note}")
        if isinstance(target, _Layout) and base == _INTEGERS and target.integers is not None:
            self._context = f"of increment {target.integers.values(self._file)[0, 1]}"

    def _unexpected_error(self, expected: str) -> PostDamageError:
        offset = self._records.offset
        actual = self._records.read_mark() or repr(self._file.peek(offset, 24))
        if offset >= self._file.size:
            actual = "nothing"
        return PostDamageError(f"{actual}, expected {expected}", offset)

    def _locate(self, damage: PostDamageError) -> str:
        return f"{damage.problem}, {self._location} (byte {damage.offset})"


# --- Tables of numbers in the file


@dataclass(frozen=True, slots=True, eq=False)
class _Numbers:
    """Position of a table: `rows` of `stride` bytes from byte `start`.

    The numbers of a row have type `dtype` (``S13`` is text) and are its bytes `cells`. Every row
    contains the texts `fixed`. A record of many numbers has the `shape` of a table; in a text
    file its lines are the rows, of which the last has `last_bytes`.
    """

    start: int
    rows: int
    stride: int
    cells: slice | NDArray[np.intp]
    dtype: "np.dtype[Any]"
    integer: bool = False
    fixed: Fixed = ()
    shape: tuple[int, int] | None = None
    last_bytes: int = 0

    def values(self, file: ByteFile, rows: IntArray | None = None, offset: int = 0) -> NDArray[Any]:
        """Rows of the table, or all, as int64 or float64, shifted by `offset` bytes."""
        try:
            fields = self._fields(file, np.arange(self.rows) if rows is None else rows, offset)
            if self.shape is not None:
                fields = fields.ravel()[: math.prod(self.shape)].reshape(self.shape)
            return self._convert(fields)
        except ValueError as error:
            first = self.start + offset
            message = f"cannot read bytes {first} to {first + self.rows * self.stride}: {error}"
            raise ResultError(message, file.path) from error

    def decode(self, raw: NDArray[np.uint8]) -> NDArray[Any]:
        """Numbers of rows in memory, ``(K, stride)``; an invalid number raises ValueError."""
        return self._convert(self._cut_cells(raw))

    def _fields(self, file: ByteFile, rows: IntArray, offset: int) -> NDArray[Any]:
        """Fields of `rows`, ``(k, fields)``; neighbouring rows are read together."""
        if not rows.size:
            return self._cut_cells(np.empty((0, self.stride), dtype=np.uint8))
        first, last = int(rows.min()), int(rows.max()) + 1
        if (last - first) * self.stride <= _GAP_BYTES:
            return self._cut_cells(self._read_rows(file, first, last, offset)[rows - first])
        unique_rows, inverse = np.unique(rows, return_inverse=True)
        chunk = unique_rows // max(1, _CHUNK_BYTES // self.stride)
        is_gap = (np.diff(unique_rows) * self.stride > _GAP_BYTES) | (np.diff(chunk) > 0)
        pieces = []
        for group in np.split(unique_rows, np.flatnonzero(is_gap) + 1):
            first, last = int(group[0]), int(group[-1]) + 1
            pieces.append(
                self._cut_cells(self._read_rows(file, first, last, offset)[group - first])
            )
        return np.concatenate(pieces)[inverse]

    def _read_rows(self, file: ByteFile, begin: int, end: int, offset: int) -> NDArray[np.uint8]:
        first_byte, length = self.start + offset + begin * self.stride, (end - begin) * self.stride
        if self.last_bytes and end == self.rows:  # a line of fewer numbers
            raw = file.take(first_byte, length - self.stride + self.last_bytes)
            raw = raw[:-1].ljust(length - 1) + raw[-1:]
        else:
            raw = file.take(first_byte, length)
        return np.frombuffer(raw, dtype=np.uint8).reshape(end - begin, self.stride)

    def _cut_cells(self, raw: NDArray[np.uint8]) -> NDArray[Any]:
        for column, expected in self.fixed:
            actual = raw[:, column : column + len(expected)]
            is_other = (actual != np.frombuffer(expected, dtype=np.uint8)).any(axis=1)
            if is_other.any():
                raise ValueError(f"{actual[is_other][0].tobytes()!r}, expected {expected!r}")
        return np.ascontiguousarray(raw[:, self.cells]).view(self.dtype)

    def _convert(self, fields: NDArray[Any]) -> NDArray[Any]:
        kind = np.int64 if self.integer else np.float64
        if self.dtype.kind != "S":
            with np.errstate(invalid="ignore"):  # of a signalling NaN
                return fields.astype(kind)
        packed = np.ascontiguousarray(fields)
        if np.isin(packed.view(np.uint8), _FOREIGN_BYTES).any():
            raise ValueError("a byte that no number contains")
        try:
            return packed.astype(kind)
        except ValueError:
            if self.integer:
                raise
            return np.array([_parse_real(text) for text in packed.ravel().tolist()]).reshape(
                packed.shape
            )


def _parse_real(text: bytes) -> float:
    """A real printed by Fortran; with an exponent of three digits it has no E: ``0.1-100``."""
    match = _REAL.fullmatch(text)
    if match:
        return float(match[1] + b"e" + (match[2] or b"0"))
    try:
        return float(text)  # NaN and Infinity
    except ValueError:
        raise ValueError(f"{text!r}, expected a real") from None


# --- Records of either kind
#
# The methods are documented at the binary class.

_Tables = tuple[_Numbers | None, _Numbers | None]


class _Cursor:
    """A position in the file, `offset`, that reading moves.

    `free` collects the ranges (first, last + 1) of values. The bytes between them are the same in
    all increments of the same structure.
    """

    def __init__(self, file: ByteFile) -> None:
        self.file, self.offset = file, 0
        self.real_bytes, self.revision = 4, 0  # revision of the block
        self.free: list[tuple[int, int]] = []

    def check(self, is_valid: bool, problem: str, offset: int | None = None) -> None:
        """Raise a `PostDamageError` at `offset`, or at the current one, unless `is_valid`."""
        if not is_valid:
            raise PostDamageError(problem, self.offset if offset is None else offset)

    def check_rows(self, start: int, rows: int, stride: int, ends: Fixed) -> None:
        """Raise a `PostDamageError` if a table is cut or its last row lacks the texts `ends`."""
        available = (self.file.size - start) // stride
        self.check(rows <= available, f"cut after {available} of {rows} records", self.file.size)
        last_row = start + (rows - 1) * stride
        for column, text in ends:
            message = f"expected {rows} records of {stride} bytes"
            self.check(self.file.holds(last_row + column, text), message, last_row + column)


class _BinaryRecords(_Cursor):
    kind = "t16"

    def __init__(self, file: ByteFile, byte_order: Literal["little", "big"]) -> None:
        super().__init__(file)
        self.byte_order = byte_order
        self._order = ">" if byte_order == "big" else "<"
        self._integer = np.dtype(f"{self._order}i{_WORD_BYTES}")

    def read_mark(self) -> str:
        """The mark at this offset; "" if there is none."""
        length = int.from_bytes(self.file.peek(self.offset, _MARKER_BYTES), self.byte_order)
        if length not in (_WORD_BYTES, _WORD_BYTES * len(END), _WORD_BYTES * _TITLE_WORDS):
            return ""
        raw = self.file.peek(self.offset + _MARKER_BYTES, length)
        return _parse_mark(raw if length == _WORD_BYTES else raw[::_WORD_BYTES])

    def skip_mark(self) -> None:
        """Move after the mark at this offset."""
        self.offset += self._record_bytes() + 2 * _MARKER_BYTES

    def text(self) -> str:
        """A record of text, without blanks at its ends."""
        return self._decode_text(self._payload())

    def label(self) -> tuple[list[int], str]:
        """A record of integers and a text: an element post code."""
        start, raw = self.offset, self._payload()
        word_count, rest = divmod(len(raw), _WORD_BYTES)
        letters = _LONG_LABEL_WORDS if word_count > _LONG_LABEL_WORDS else _LABEL_WORDS
        is_valid = rest == 0 and word_count - letters in (1, 2)
        self.check(is_valid, f"a post code in a record of {len(raw)} bytes", start)
        label_start = (word_count - letters) * _WORD_BYTES
        return np.frombuffer(raw[:label_start], dtype=self._integer).tolist(), self._decode_text(
            raw[label_start:]
        )

    def integers(self, *counts: int) -> list[int]:
        """Integers of the next records, which have `counts` integers."""
        numbers: list[int] = []
        for count in counts:
            start, raw = self.offset, self._payload()
            message = f"a record of {len(raw)} bytes, expected {count} integers"
            self.check(len(raw) == count * _WORD_BYTES, message, start)
            numbers += np.frombuffer(raw, dtype=self._integer).tolist()
        return numbers

    def table(self, rows: int, integers: int, reals: int) -> _Tables:
        """Positions of the `integers` and `reals` of `rows` equal records, which are skipped."""
        if rows == 0 or integers + reals == 0:
            return None, None
        start, payload = self.offset, self._record_bytes()
        reals_start, stride = _MARKER_BYTES + integers * _WORD_BYTES, payload + 2 * _MARKER_BYTES
        expected = f"{integers} integers and {reals} reals"
        real_type = self._real_type(payload, integers * _WORD_BYTES, reals, expected)
        marker = payload.to_bytes(_MARKER_BYTES, self.byte_order)
        fixed = ((0, marker), (stride - _MARKER_BYTES, marker))
        self.check_rows(start, rows, stride, fixed)
        self._skip(rows * stride - 2 * _MARKER_BYTES)
        integer_table = _Numbers(
            start, rows, stride, slice(_MARKER_BYTES, reals_start), self._integer, True, fixed
        )
        real_table = replace(
            integer_table,
            cells=slice(reals_start, stride - _MARKER_BYTES),
            dtype=real_type,
            integer=False,
        )
        return (integer_table if integers else None), (real_table if reals else None)

    def matrix(self, rows: int, columns: int) -> _Numbers:
        """Position of one record of `rows` times `columns` reals, which is skipped."""
        start, length = self.offset + _MARKER_BYTES, self._record_bytes()
        expected = f"{rows} times {columns} reals"
        real_type = self._real_type(length, 0, rows * columns, expected)
        self._skip(length)
        return _Numbers(start, 1, length, slice(None), real_type, shape=(rows, columns))

    def skip_empty(self) -> None:
        """Skip an empty record, if there is one."""
        if self.file.holds(self.offset, bytes(2 * _MARKER_BYTES)):
            self.offset += 2 * _MARKER_BYTES

    def skip_block(self) -> None:
        """Move to the ``=end=`` of the current block."""
        while (mark := self.read_mark()) != END:
            self.check(not mark, f"{mark!r} before the block's =end=")
            self._skip(self._record_bytes())

    def _record_bytes(self) -> int:
        """Length in bytes of the record at this offset, without its markers."""
        size = self.file.size
        self.check(self.offset + _MARKER_BYTES <= size, "cut", size)
        head = self.file.take(self.offset, _MARKER_BYTES)
        length = int.from_bytes(head, self.byte_order, signed=True)
        message = f"a record of length {length}; more than 2^31 bytes are not supported"
        self.check(length >= 0, message)
        end = self.offset + _MARKER_BYTES + length
        message = f"cut: the file ends at byte {size} in a record of {length} bytes"
        self.check(end + _MARKER_BYTES <= size, message)
        tail = self.file.take(end, _MARKER_BYTES)
        closing_length = int.from_bytes(tail, self.byte_order, signed=True)
        self.check(
            closing_length == length, f"a record of {length} bytes that ends in {closing_length}"
        )
        return length

    def _skip(self, length: int) -> None:
        """Skip `length` bytes between the first and the last marker."""
        self.free.append((self.offset + _MARKER_BYTES, self.offset + _MARKER_BYTES + length))
        self.offset += length + 2 * _MARKER_BYTES

    def _payload(self) -> bytes:
        start, length = self.offset + _MARKER_BYTES, self._record_bytes()
        self.check(length <= _MAX_TEXT_BYTES, f"a record of {length} bytes among short ones")
        self.offset += length + 2 * _MARKER_BYTES
        return self.file.take(start, length)

    def _decode_text(self, raw: bytes) -> str:
        return raw[::_WORD_BYTES].decode("latin-1").strip(" \0")

    def _real_type(
        self, length: int, head_bytes: int, reals: int, expected: str
    ) -> "np.dtype[Any]":
        """Type of `reals` numbers that fill a record of `length` bytes after `head_bytes`."""
        width = (length - head_bytes) // reals if reals else _WORD_BYTES
        is_valid = length == head_bytes + reals * width and width in (4, 8)
        self.check(is_valid, f"a record of {length} bytes, expected {expected}")
        self.real_bytes = max(self.real_bytes, width)
        return np.dtype(f"{self._order}f{width}")


class _TextRecords(_Cursor):
    kind = "t19"
    byte_order = "little"  # it has none

    def read_mark(self) -> str:
        self.skip_empty()
        line_and_next = self.file.line(self.offset)
        return _parse_mark(line_and_next[0] if line_and_next else self.file.peek(self.offset, 80))

    def skip_mark(self) -> None:
        line_and_next = self.file.line(self.offset)
        self.offset = (
            line_and_next[1] if line_and_next else self.file.size
        )  # the last mark has no line end

    def text(self) -> str:
        return self._line().decode("latin-1").strip()

    def label(self) -> tuple[list[int], str]:
        start, line = self.offset, self._line()
        numbers, rest = [_parse_integer(line[:_FIELD_CHARACTERS], start)], line[_FIELD_CHARACTERS:]
        if len(rest) >= _FIELD_CHARACTERS and rest[:_FIELD_CHARACTERS].strip().isdigit():
            numbers.append(int(rest[:_FIELD_CHARACTERS]))
            rest = rest[_FIELD_CHARACTERS:]
        return numbers, rest.decode("latin-1").strip()

    def integers(self, *counts: int) -> list[int]:
        """Integers of the next records; text records are not separated."""
        count = sum(counts)
        self._check_fields(count)
        numbers: list[int] = []
        while len(numbers) < count:
            start, line = self.offset, self._line().rstrip()
            fields = min(_LINE_FIELDS, count - len(numbers))
            message = f"{line[:80]!r}, expected {fields} integers"
            self.check(len(line) == fields * _FIELD_CHARACTERS, message, start)
            numbers += [
                _parse_integer(line[k : k + _FIELD_CHARACTERS], start)
                for k in range(0, len(line), _FIELD_CHARACTERS)
            ]
        return numbers

    def table(self, rows: int, integers: int, reals: int) -> _Tables:
        fields = integers + reals
        if rows == 0 or fields == 0:
            return None, None
        start = self.offset
        self._check_fields(rows * fields)
        ends = [end - start for end in self._record_ends(fields)]
        stride = ends[-1]
        fixed = tuple((end - 1, b"\n") for end in ends)
        self.check_rows(start, rows, stride, fixed)
        self.offset = start + rows * stride
        self.free.append((start, self.offset - 1))
        lines = zip([0, *ends], range(0, fields, _LINE_FIELDS), strict=False)
        cells = np.concatenate(
            [
                np.arange(begin, begin + _FIELD_CHARACTERS * min(_LINE_FIELDS, fields - first))
                for begin, first in lines
            ]
        )
        integer_characters = integers * _FIELD_CHARACTERS
        integer_table = _Numbers(
            start, rows, stride, cells[:integer_characters], _TEXT, True, fixed
        )
        real_table = replace(integer_table, cells=cells[integer_characters:], integer=False)
        return (integer_table if integers else None), (real_table if reals else None)

    def matrix(self, rows: int, columns: int) -> _Numbers:
        start, count = self.offset, rows * columns
        self._check_fields(count)
        if count == 0:
            self.skip_empty()
            return _Numbers(start, 1, 0, slice(None), _TEXT, shape=(rows, columns))
        full, rest = divmod(count, _LINE_FIELDS)
        line_count = min(count, _LINE_FIELDS)
        stride = self._record_ends(line_count)[0] - start
        fixed = ((stride - 1, b"\n"),)
        if full:
            self.check_rows(start, full, stride, fixed)
            self.offset = start + full * stride
            if rest:
                self._record_ends(rest)
        lines = full + (rest > 0)
        self.free.append((start, self.offset - 1))
        last_bytes = self.offset - start - (lines - 1) * stride
        numbers = _Numbers(
            start, lines, stride, slice(0, line_count * _FIELD_CHARACTERS), _TEXT, fixed=fixed
        )
        return replace(numbers, shape=(rows, columns), last_bytes=last_bytes)

    def skip_empty(self) -> None:
        while (line_and_next := self.file.line(self.offset)) is not None and not line_and_next[
            0
        ].strip():
            self.offset = line_and_next[1]

    def skip_block(self) -> None:
        start = self.offset
        while not (mark := self.read_mark()):
            line_end = self.file.find(b"\n=", self.offset)
            if line_end is None:
                raise PostDamageError("cut: no =end= follows", self.file.size)
            self.offset = line_end + 1
        self.check(mark == END, f"{mark!r} before the block's =end=")
        if self.offset > start:
            self.free.append((start, self.offset - 1))

    def _line(self) -> bytes:
        line_and_next = self.file.line(self.offset)
        if line_and_next is None:
            raise PostDamageError(self.file.line_problem(self.offset), self.offset)
        line, self.offset = line_and_next
        return line

    def _check_fields(self, fields: int) -> None:
        size = self.file.size
        message = f"expected {fields} numbers from byte {self.offset}, the file ends at byte {size}"
        self.check(fields * _FIELD_CHARACTERS <= size - self.offset, f"cut: {message}", size)

    def _record_ends(self, fields: int) -> list[int]:
        """Ends of the lines of one record of `fields` numbers, which is skipped."""
        ends = []
        for first in range(0, fields, _LINE_FIELDS):
            start, line = self.offset, self._line()
            count = min(_LINE_FIELDS, fields - first)
            characters = count * _FIELD_CHARACTERS
            message = f"{line[:80]!r}, expected {count} numbers of {_FIELD_CHARACTERS} characters"
            self.check(len(line) >= characters and not line[characters:].strip(), message, start)
            ends.append(self.offset)
        return ends


_Records = _BinaryRecords | _TextRecords


def _open_records(file: ByteFile) -> _Records:
    """Records of a binary file of either byte order or of a text file; else a `ResultError`."""
    length = _WORD_BYTES * _TITLE_WORDS
    head = file.peek(0, _MARKER_BYTES + length)
    if not head:
        raise ResultError("empty, expected a post file of Marc", file.path)
    if head.lstrip().startswith(BEGIN.encode()):
        return _TextRecords(file)
    orders: tuple[Literal["little", "big"], ...] = ("little", "big")
    for order in orders:
        if int.from_bytes(head[:_MARKER_BYTES], order) != length:
            continue
        text = head[_MARKER_BYTES::_WORD_BYTES]
        if text.startswith(BEGIN.encode()):
            return _BinaryRecords(file, order)
        if text.isascii() and text.decode("latin-1").isprintable():
            raise ResultError(
                "a post file without =beg= marks, of Marc K7 or older (revision 7 or older), is "
                "not supported; newer versions of Marc write newer revisions",
                file.path,
            )
    raise ResultError(
        f"begins with {head[:24]!r}, expected =beg=50100 of a post file of Marc, as text or in a "
        "record of 280 bytes",
        file.path,
    )


def _parse_mark(raw: bytes) -> str:
    text = raw.decode("latin-1").rstrip()
    return text if text in _MARKS or text == END or text.startswith(BEGIN) else ""


def _parse_integer(text: bytes, offset: int) -> int:
    if not text.strip().removeprefix(b"-").isdigit():
        raise PostDamageError(f"{text!r}, expected an integer", offset)
    return int(text)


# --- The model: blocks 50100 to 51302


_ReadBlock = Callable[[_Records, Any], None]
"""Reads a block into the model or the layout of an increment."""


def _read_title(records: _Records, post: PostFile) -> None:
    post.title = records.text()


def _read_domains(records: _Records, post: PostFile) -> None:
    domains, number = records.integers(2)
    if domains > 1:
        message = f"part {number} of a model solved in {domains} domains"
        post.remarks.append(message)


def _read_verification(records: _Records, post: PostFile) -> None:
    integers = records.integers(*_VERIFICATION_WORDS)
    for index, name in _COUNT_NAMES.items():
        if not 0 <= integers[index] <= records.file.size:
            raise PostDamageError(f"a model of {integers[index]} {name}", records.offset)
    post.values, post.nodes, post.elements, _, post.points = integers[:5]
    post.dimensions, post.corners, post.revision = integers[8], integers[9], integers[13]


def _read_codes(records: _Records, post: PostFile) -> None:
    """Read post codes; in Marc's Volume C the code of layer n is the code + 1000 n."""
    codes = []
    for _ in range(post.values):
        numbers, label = records.label()
        code, layer = numbers[0], sum(numbers[1:])
        if layer == 0 and code >= _CODES_OF_A_LAYER:
            layer, code = divmod(code, _CODES_OF_A_LAYER)
        codes.append(PostCode(code, layer, label))
    post.codes = tuple(codes)


def _read_connectivity(records: _Records, post: PostFile) -> None:
    extras = 0
    if records.revision >= 2:
        _, post.corners, extras = _read_counts(records, 3)
    post.connectivity, _ = records.table(post.elements, 3 + post.corners + extras, 0)
    _check_end(records, f"{post.elements} elements")


def _read_coordinates(records: _Records, post: PostFile) -> None:
    post.node_ids, post.coordinates = records.table(post.nodes, 1, post.dimensions)
    _check_end(records, f"{post.nodes} nodes")


def _read_sets(records: _Records, post: PostFile) -> None:
    (count,) = _read_counts(records, 1)
    sets: list[tuple[str, int, _Numbers | None]] = []
    while len(sets) < count:
        name = records.text()
        size, kind = _read_counts(records, 2)
        if records.revision >= 2:
            records.integers(4)
        if size == 0:
            records.skip_empty()
        members, _ = records.table(1, size, 0)
        if kind in _SIDE_SET_KINDS:
            records.table(1, size, 0)
        sets.append((name, kind, members))
    post.sets = sets


def _read_counts(records: _Records, number: int) -> list[int]:
    offset = records.offset
    counts = records.integers(number)
    if min(counts) < 0:
        raise PostDamageError(f"a count of {min(counts)}", offset)
    return counts


def _check_end(records: _Records, expected: str) -> None:
    """Raise a `PostDamageError` if the block continues after its expected tables."""
    if records.read_mark() != END:
        raise PostDamageError(f"more than {expected}", records.offset)


_MODEL: dict[int, _ReadBlock] = {
    501: _read_title, 502: _read_verification, 505: _read_domains, 506: _read_codes,
    507: _read_connectivity,
    508: _read_coordinates, _SETS: _read_sets,
}  # fmt: skip


# --- An increment: blocks 51700 to 52401


@dataclass(slots=True, eq=False)
class _Layout:
    """Positions of the parts of an increment that begins at byte `start`.

    `integers` and `reals` are its verification data. Increments of a run differ only in their
    values and share one layout.
    """

    start: int
    post: PostFile
    integers: _Numbers | None = None
    reals: _Numbers | None = None
    element_values: _Numbers | None = None
    nodal: list[NodalQuantity] = field(default_factory=list)


def _read_integers(records: _Records, layout: _Layout) -> None:
    layout.integers, _ = records.table(1, _INCREMENT_WORDS, 0)


def _read_reals(records: _Records, layout: _Layout) -> None:
    (count,) = records.integers(1)
    records.check(count >= 2, f"{count} reals, expected time and frequency")
    layout.reals = records.matrix(1, count)


def _read_element_values(records: _Records, layout: _Layout) -> None:
    post = layout.post
    _, values = records.table(post.elements * post.points, 0, post.values)
    _check_end(records, f"{post.elements} elements of {post.points} points")
    layout.element_values = values


def _read_nodal(records: _Records, layout: _Layout) -> None:
    quantities = []
    count, _ = records.integers(2)
    for _ in range(count):
        name, offset = records.text(), records.offset
        integers = records.integers(_QUANTITY_WORDS)
        components, flag, is_complex = integers[3], integers[6], integers[5] in _COMPLEX_KINDS
        max_components = _MAX_COMPONENTS if flag == _ALL_NODES else _MAX_COMPONENTS_WITHOUT_DATA
        is_plausible = flag in (_ALL_NODES, _NO_NODES) and 0 <= components <= max_components
        records.check(is_plausible, f"{name!r} of {components} components with flag {flag}", offset)
        numbers = None
        if flag == _ALL_NODES:
            numbers = records.matrix(layout.post.nodes, components)
            if is_complex:
                records.matrix(layout.post.nodes, components)
        quantities.append(NodalQuantity(name, integers[0], components, is_complex, numbers))
    layout.nodal = quantities


_INCREMENT: dict[int, _ReadBlock] = {
    _INTEGERS: _read_integers, 518: _read_reals, 523: _read_element_values, 524: _read_nodal,
}  # fmt: skip
_VALUE_BLOCKS = (523, 524)
_OPTIONAL_BLOCKS = (_SETS, *_VALUE_BLOCKS)  # blocks that can be left out


# --- Increments with the structure of an earlier one, without a walk
#
# Between the values of an increment are names, counts and lengths of records. If all these bytes
# equal those of an increment that was walked through, at the same distances, its records have the
# same positions. A file of 100 000 small increments is therefore opened by comparing arrays, and a
# large increment by comparing a few parts of it.


class _Part(NamedTuple):
    """`length` bytes at `offset`, of which those at `columns` are `expected`."""

    offset: int
    length: int
    columns: NDArray[np.intp]
    expected: NDArray[np.uint8]

    def read_and_compare(
        self, file: ByteFile, offset_of_first: int, count: int
    ) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
        """Bytes of `count` increments from `offset_of_first`, and whether each is as expected."""
        raw = file.take(offset_of_first + self.offset, self.length * count)
        rows = np.frombuffer(raw, dtype=np.uint8).reshape(count, self.length)
        return rows, (rows[:, self.columns] == self.expected).all(axis=1)


@dataclass(slots=True, eq=False)
class _Template:
    """The last increment that was walked through, of `length` bytes, and its fixed parts."""

    layout: _Layout
    length: int
    parts: list[_Part]
    batch_size: int = 1

    @classmethod
    def from_increment(
        cls, file: ByteFile, layout: _Layout, end: int, free: list[tuple[int, int]]
    ) -> "_Template | None":
        """Template of the increment that ends before byte `end` with values at `free`."""
        start, offset = layout.start, layout.start
        groups: list[list[tuple[int, int]]] = []
        for first, last in [*sorted(free), (end, end)]:
            if first > offset:
                is_far = (
                    end - start > _SMALL_INCREMENT_BYTES
                    and groups
                    and offset - groups[-1][-1][1] > _GAP_BYTES
                )
                if is_far or not groups:
                    groups.append([])
                groups[-1].append((offset, first))
            offset = max(offset, last)
        parts = []
        for group in groups:
            first, last = group[0][0], group[-1][1]
            columns = np.concatenate([np.arange(*span) for span in group]) - first
            raw = np.frombuffer(file.take(first, last - first), dtype=np.uint8)
            parts.append(_Part(first - start, last - first, columns, raw[columns]))
        head = max(n.start + n.stride for n in (layout.integers, layout.reals) if n is not None)
        return cls(layout, end - start, parts) if head <= start + parts[0].length else None

    def match(self, file: ByteFile, offset: int) -> list[tuple[list[int], list[float]]]:
        """Integers and reals of the verification data of matching increments from `offset`."""
        count = (
            max(1, min(self.batch_size, _CHUNK_BYTES // self.length)) if len(self.parts) == 1 else 1
        )
        count = min(count, (file.size - offset) // self.length)
        if count == 0:
            return []
        first, is_same = self.parts[0].read_and_compare(file, offset, count)
        count = count if is_same.all() else int(np.argmin(is_same))
        if count == 0 or not all(
            part.read_and_compare(file, offset, 1)[1][0] for part in self.parts[1:]
        ):
            return []
        layout, columns = self.layout, []
        assert layout.integers is not None and layout.reals is not None  # checked by the walk
        for numbers in (layout.integers, layout.reals):
            begin = numbers.start - layout.start
            try:
                columns.append(
                    numbers.decode(first[:count, begin : begin + numbers.stride]).tolist()
                )
            except ValueError:
                return []  # the walk reports the problem
        self.batch_size = min(2 * self.batch_size, _CHUNK_BYTES)
        return list(zip(*columns, strict=True))
