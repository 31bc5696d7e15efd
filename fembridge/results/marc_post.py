"""A post file of Marc, ``.t16`` (binary) or ``.t19`` (text): mesh, increments, values.

>>> with ByteFile(Path("job.t16")) as file:  # doctest: +SKIP
...     post = PostFile(file)
...     for increment in post.increments:
...         print(increment.time_s, post.nodal_values(increment.row, "Displacement"))

Opening walks from block to block and keeps where values are; values are read when they
are asked for, and only those. Numbers are the file's: a file names no units.

Both kinds have the same blocks of the same records. Between records are the words
``=beg=NNNNN (Name)`` (NNNNN is a block's number, and two digits of its revision),
``=end=``, ``****`` (an increment begins), ``----`` (it ends) and ``++++`` (the file ends).
In a ``.t16`` a record is its length, what it holds, and its length again: unformatted
sequential records of Fortran, with one character of a text in each word of four bytes. In
a ``.t19`` a record begins on a new line and has six numbers a line, I13 or E13.6; negative
numbers touch what is before them.

A block that is not known is skipped up to its ``=end=``, with a remark; so are values that
are damaged or not built as known, but then the file is not whole. An increment counts when
its ``----`` is there; at the first place that is cut or damaged elsewhere, or where a new
mesh comes (remeshing, which is not read), the walk ends, and what was whole before is what
the file has.

Source: real files of post revisions 12 and 14, of Marc 2020 to 2023.1; names of the
verification integers are Marc's. Reals of eight bytes and big-endian files are documented,
not seen.
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
_NEW_MESH = range(502, 515)  # blocks that an increment with a new mesh has
# Blocks that are skipped: real files have them, or they are documented.
_SKIPPED = (501, 504, 505, 510, 514, 515, 516, 519, 520, 529, *range(530, 537), *range(540, 544))
_SEEN_REVISIONS = (12, 14)

_SET_KINDS = {0: "element", 1: "node", 12: "edge", 13: "face", 18: "edge", 19: "face"}
_WITH_SIDES = (12, 13, 18, 19)
_COUNTED = {
    0: "values a point", 1: "nodes", 2: "elements", 4: "points an element",
    8: "coordinates a node", 9: "nodes an element",
}  # fmt: skip
_CODES_OF_A_LAYER = 1000
_VERIFICATION_WORDS, _INCREMENT_WORDS, _QUANTITY_WORDS = (18, 12), 12, 12
_ALL_NODES, _NO_NODES = -1, 0
_COMPLEX = (4, 5)
# Of a nodal quantity, and of one that is 0 at all nodes; real ones have up to six.
_MOST_COMPONENTS, _MOST_WITHOUT_DATA = 1000, 36

_WORD = _MARKER = 4  # bytes
_TITLE_WORDS, _LABEL_WORDS, _LONG_LABEL_WORDS = 70, 24, 48
_FIELD, _FIELDS_A_LINE = 13, 6  # characters of a number as text
_TEXT = np.dtype(f"S{_FIELD}")
_LONGEST_TEXT = 1 << 16
_READ_BYTES = 1 << 22  # at once
_GAP_BYTES = 1 << 12  # places nearer than that are read together
_SMALL_BYTES = 1 << 18  # an increment up to so many is read as a whole
_MOST_BLANKS = 1 << 16  # behind the end of a file
# What NumPy reads and a number of Fortran does not hold: 1_000, an early end.
_FOREIGN = np.frombuffer(b"_\0", dtype=np.uint8)
_REAL = re.compile(rb" *([+-]?(?:\d+\.?\d*|\.\d+))(?:[EeDd]?([+-]\d+))? *")

Fixed = tuple[tuple[int, bytes], ...]
"""Text that each row of a table has, by its place there."""


class PostDamageError(Exception):
    """Bytes that are not what has to be there; `at` is the first of them."""

    def __init__(self, problem: str, at: int) -> None:
        super().__init__(problem, at)
        self.problem, self.at = problem, at


@dataclass(frozen=True, slots=True)
class PostCode:
    """One value that is stored at each integration point.

    `code` is Marc's element post code (17 von Mises, 311 to 316 the stress tensor
    11 22 33 12 23 31); `layer` is 0 where the deck names none.
    """

    code: int
    layer: int
    label: str


@dataclass(frozen=True, slots=True, eq=False)
class PostSet:
    """A named set: `kind` is "node", "element", "edge", "face" or "type N".

    `members` ``(M,)`` are numbers of nodes, or of elements; of edges and faces those of
    their elements.
    """

    name: str
    kind: str
    members: IntArray


@dataclass(frozen=True, slots=True, eq=False)
class PostMesh:
    """A model: `node_ids` ``(N,)``, `coordinates_mm` ``(N, 3)``, elements.

    `element_ids` and `element_types` are ``(E,)``; `connectivity` ``(E, K)`` has numbers
    of nodes, 0 where an element has fewer. `extras` ``(E, X)`` are what block 50702 adds
    to an element: geometry, material and body ids by all signs. Pressure nodes of
    Herrmann elements are nodes too, with coordinates of zero.
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
    """A quantity at all nodes in one increment: without `numbers` all are zero.

    `is_complex` marks one with an imaginary part, which is not read.
    """

    name: str
    code: int
    components: int
    is_complex: bool
    numbers: "_Numbers | None"


class PostIncrement(NamedTuple):
    """One increment: Marc's numbers, the solver's time in s, what it holds.

    `row` counts increments in the file from 0. `harmonic` is Marc's IHRESP, 0 where the
    increment is one of time; elsewhere `frequency` belongs to it. Its values are where
    `layout` has them, `offset` bytes further on.
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
        """Whether there are values at integration points."""
        return self.layout.element_values is not None


class PostFile:
    """An open ``.t16`` or ``.t19``.

    `kind` is "t16" or "t19", `byte_order` "little" or "big" ("little" for text),
    `precision` "single" or "double". `problem` says where the file is cut or damaged, or which
    values of it are left out; None when it is whole. Of the model it has title, revision and
    counts (Marc's names beside them), and where its tables are.
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
        self._of, self._where = "of the model", "at the beginning"
        self._numbers: dict[str, str] = {}  # of blocks, by their names
        self._lost: list[str] = []  # what is left out of the values
        self._records = _records_of(file)
        self._walk()
        self.kind, self.byte_order = self._records.kind, self._records.byte_order
        self.precision = "double" if self._records.real_bytes == 8 else "single"

    @cached_property
    def mesh(self) -> PostMesh:
        """The model, read when it is first asked for; ResultError where it cannot be."""
        ids = self.node_ids
        if self.nodes and ids is None:
            raise ResultError(f"{self.nodes} nodes and no block of them", self.path)
        nothing = np.empty(0, dtype=np.int64)
        table = np.empty((0, 3), dtype=np.int64)
        if self.connectivity is not None:
            table = self.connectivity.values(self._file)
        mm = np.zeros((self.nodes, 3))
        if self.coordinates is not None:
            found = self.coordinates.values(self._file)[:, :3]
            mm[:, : found.shape[1]] = found
        corners, used = table[:, 3 : 3 + self.corners].copy(), table[:, 2]
        if used.size and (used.min() < 0 or used.max() > self.corners):
            bad = int(np.flatnonzero((used < 0) | (used > self.corners))[0])
            words = f"element {table[bad, 0]} announces {used[bad]} nodes, the model has up to"
            raise ResultError(f"{words} {self.corners}", self.path)
        absent = np.arange(corners.shape[1]) >= used[:, None]
        corners[absent] = 0
        if (odd := np.argwhere((corners <= 0) & ~absent)).size:
            row, corner = odd[0].tolist()
            words = f"element {table[row, 0]} has node {corners[row, corner]}, expected 1 or more"
            raise ResultError(words, self.path)
        sets = []
        for name, number, members in self.sets:
            kind = _SET_KINDS.get(number, f"type {number}")
            sets.append(
                PostSet(name, kind, nothing if members is None else members.values(self._file)[0])
            )
        return PostMesh(
            node_ids=nothing if ids is None else self._once_each(ids.values(self._file)[:, 0]),
            coordinates_mm=mm,
            element_ids=table[:, 0].copy(),
            element_types=table[:, 1].copy(),
            connectivity=corners,
            extras=table[:, 3 + self.corners :].copy(),
            sets=tuple(sets),
        )

    def _once_each(self, nodes: IntArray) -> IntArray:
        """The numbers of the nodes; one that is there twice is a ResultError."""
        ids, counts = np.unique(nodes, return_counts=True)
        if (counts > 1).any():
            raise ResultError(f"node {ids[counts > 1][0]} is duplicate", self.path)
        return nodes

    def element_values(self, row: int, element_rows: IntArray) -> FloatArray:
        """Values of increment `row`, which has some, at all points of elements.

        ``(K, points, codes)``; `element_rows` count elements as the mesh has them.
        """
        one = self.increments[row]
        numbers = one.layout.element_values
        assert numbers is not None
        elements = np.asarray(element_rows, dtype=np.int64)
        records = (elements[:, None] * self.points + np.arange(self.points)).ravel()
        found: FloatArray = numbers.values(self._file, records, one.offset)
        return found.reshape(elements.size, self.points, self.values)

    def nodal_values(self, row: int, name: str) -> FloatArray:
        """A nodal quantity of increment `row` at all nodes, ``(N, components)``.

        Where the file says that there is no data all is zero.
        """
        one = self.increments[row]
        quantity = next(held for held in one.nodal if held.name == name)
        if quantity.numbers is None:
            return np.broadcast_to(0.0, (self.nodes, quantity.components))
        found: FloatArray = quantity.numbers.values(self._file, offset=one.offset)
        return found

    def _walk(self) -> None:
        """Go to the end, or as far as the file can be understood."""
        records = self._records
        try:
            self._blocks(_MODEL, self)
            if records.word() not in (INCREMENT, FILE_END):
                raise self._unexpected(f"{BEGIN} or {INCREMENT}")
        except PostDamageError as damage:
            raise ResultError(f"no whole model: {self._located(damage)}", self.path) from damage
        if self.revision not in _SEEN_REVISIONS:
            words = f"post revision {self.revision}: real files of 12 and 14 were seen"
            self.remarks.append(words)
        self._where = "before the first increment"
        try:
            while (word := records.word()) == INCREMENT:
                if self._template is not None and self._repeats(self._template):
                    continue
                self._increment()
            self._where = "at the end"
            if word == FILE_END:
                records.skip_word()
                rest = self._file.size - records.at
                if self._file.peek(records.at, min(rest, _MOST_BLANKS)).strip():
                    self.remarks.append(f"{rest} bytes behind the end of the file")
            elif records.at < self._file.size:
                raise self._unexpected(f"{INCREMENT} or {FILE_END}")
            else:
                self.problem = f"no {FILE_END} at the end: the run is going on, or was stopped"
        except PostDamageError as damage:
            self.problem = self._located(damage)
        if self._lost:
            more = f"; and {len(self._lost) - 1} more" if len(self._lost) > 1 else ""
            words = f"{self._lost[0]}{more}"
            self.problem = words if self.problem is None else f"{words}; {self.problem}"

    def _increment(self) -> None:
        records = self._records
        layout = _Layout(records.at, self)
        records.free.clear()
        self._where = self._of = f"of the increment that begins at byte {layout.start}"
        records.skip_word()
        self._blocks(_INCREMENT, layout)
        if records.word() != INCREMENT_END:
            raise self._unexpected(f"{BEGIN} or {INCREMENT_END}")
        records.skip_word()
        if layout.integers is None or layout.reals is None:
            raise PostDamageError("an increment without its number and time", layout.start)
        self._template = _Template.of(self._file, layout, records.at, records.free)
        integers, reals = (part.values(self._file) for part in (layout.integers, layout.reals))
        self._append(layout, 0, integers[0].tolist(), reals[0].tolist())

    def _repeats(self, template: "_Template") -> bool:
        """Take the increments here that are built as `template`; False if none is."""
        records, layout = self._records, template.layout
        found = template.match(self._file, records.at)
        for words, reals in found:
            self._append(layout, records.at - layout.start, words, reals)
            records.at += template.length
        return bool(found)

    def _append(self, layout: "_Layout", offset: int, words: list[int], reals: list[float]) -> None:
        number, sub, harmonic = words[1], words[2], words[6]
        try:
            seconds_to_ms(reals[0])
            if not math.isfinite(reals[1]):
                raise ValueError(f"a frequency of {reals[1]:g} is no frequency")
        except ValueError as error:
            raise PostDamageError(str(error), layout.start + offset) from error
        if self.increments and number < (before := self.increments[-1].increment):
            self.remarks.append(f"increment {number} comes after increment {before}")
        one = (len(self.increments), number, sub, reals[0], harmonic, reals[1], layout, offset)
        self.increments.append(PostIncrement(*one))

    def _blocks(self, readers: Mapping[int, "_ReadBlock"], target: "PostFile | _Layout") -> None:
        """Read the blocks that follow into `target`; skip those that `readers` lack."""
        records = self._records
        while (word := records.word()).startswith(BEGIN):
            number = word[len(BEGIN) :].split(" ", 1)[0]
            self._where = f"in block {number} {self._of}"
            if len(number) != 5 or not number.isdecimal():
                raise PostDamageError(f"{word!r} has no number", records.at)
            base, records.revision = divmod(int(number), 100)
            if readers is _INCREMENT and base in _NEW_MESH:
                raise PostDamageError("a new mesh (remeshing), which is not read", records.at)
            records.skip_word()
            unknown = f"block {word[len(BEGIN) :]} is not known: skipped"
            name = word.partition("(")[2]
            if name and self._numbers.setdefault(name, number) != number:
                was = f"the number of ({name} was {self._numbers[name]} before"
                raise PostDamageError(f"{word[len(BEGIN) :]}: {was}", records.at)
            if base in readers:
                self._read(base, readers[base], target)
            elif base not in _SKIPPED and unknown not in self.remarks:
                self.remarks.append(unknown)
            records.skip_block()
            records.skip_word()

    def _read(self, base: int, read: "_ReadBlock", target: "PostFile | _Layout") -> None:
        """Read a block; one that can be left out and is not built as known is, and said."""
        records = self._records
        start, kept = records.at, len(records.free)
        also = "" if target is self else ", also in increments built in the same way"
        said = self._lost if base in _VALUES else self.remarks
        try:
            read(records, target)
            if records.word() != END:
                said.append(f"{self._where}: more than is known, left out{also}")
        except PostDamageError as damage:
            if base not in _LEFT_OUT:
                raise
            records.at = start
            del records.free[kept:]
            try:
                records.skip_block()
            except PostDamageError:
                raise damage from None
            said.append(f"{self._located(damage)}: left out{also}")
        if isinstance(target, _Layout) and base == _INTEGERS and target.integers is not None:
            self._of = f"of increment {target.integers.values(self._file)[0, 1]}"

    def _unexpected(self, expected: str) -> PostDamageError:
        at = self._records.at
        found = self._records.word() or repr(self._file.peek(at, 24))
        if at >= self._file.size:
            found = "nothing"
        return PostDamageError(f"{found} where {expected} is expected", at)

    def _located(self, damage: PostDamageError) -> str:
        return f"{damage.problem}, {self._where} (byte {damage.at})"


# --- Tables of numbers in the file


@dataclass(frozen=True, slots=True, eq=False)
class _Numbers:
    """Where a table is: `rows` of `stride` bytes from byte `start`.

    The numbers of a row, of type `dtype` (``S13`` is text), are its bytes `cells`; `fixed`
    (byte, text) is in every row. A record of many numbers has the `shape` of a table; as text
    it fills lines, which are the rows here, of which the last has `last_bytes`.
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
        """Rows of the table, or all, in int64 or float64; `offset` bytes on in the file."""
        try:
            fields = self._fields(file, np.arange(self.rows) if rows is None else rows, offset)
            if self.shape is not None:
                fields = fields.ravel()[: math.prod(self.shape)].reshape(self.shape)
            return self._converted(fields)
        except ValueError as error:
            first = self.start + offset
            words = f"bytes {first} to {first + self.rows * self.stride} cannot be read: {error}"
            raise ResultError(words, file.path) from error

    def decode(self, raw: NDArray[np.uint8]) -> NDArray[Any]:
        """Numbers of rows in memory, ``(K, stride)``; ValueError where one is none."""
        return self._converted(self._cut(raw))

    def _fields(self, file: ByteFile, rows: IntArray, offset: int) -> NDArray[Any]:
        """Fields of `rows`, ``(k, fields)``; those near each other are read together."""
        if not rows.size:
            return self._cut(np.empty((0, self.stride), dtype=np.uint8))
        first, last = int(rows.min()), int(rows.max()) + 1
        if (last - first) * self.stride <= _GAP_BYTES:
            return self._cut(self._take(file, first, last, offset)[rows - first])
        wanted, back = np.unique(rows, return_inverse=True)
        chunk = wanted // max(1, _READ_BYTES // self.stride)
        apart = (np.diff(wanted) * self.stride > _GAP_BYTES) | (np.diff(chunk) > 0)
        pieces = []
        for some in np.split(wanted, np.flatnonzero(apart) + 1):
            first, last = int(some[0]), int(some[-1]) + 1
            pieces.append(self._cut(self._take(file, first, last, offset)[some - first]))
        return np.concatenate(pieces)[back]

    def _take(self, file: ByteFile, begin: int, end: int, offset: int) -> NDArray[np.uint8]:
        at, length = self.start + offset + begin * self.stride, (end - begin) * self.stride
        if self.last_bytes and end == self.rows:  # a line of fewer numbers
            raw = file.take(at, length - self.stride + self.last_bytes)
            raw = raw[:-1].ljust(length - 1) + raw[-1:]
        else:
            raw = file.take(at, length)
        return np.frombuffer(raw, dtype=np.uint8).reshape(end - begin, self.stride)

    def _cut(self, raw: NDArray[np.uint8]) -> NDArray[Any]:
        for at, expected in self.fixed:
            found = raw[:, at : at + len(expected)]
            odd = (found != np.frombuffer(expected, dtype=np.uint8)).any(axis=1)
            if odd.any():
                raise ValueError(f"{found[odd][0].tobytes()!r} where {expected!r} is expected")
        return np.ascontiguousarray(raw[:, self.cells]).view(self.dtype)

    def _converted(self, fields: NDArray[Any]) -> NDArray[Any]:
        kind = np.int64 if self.integer else np.float64
        if self.dtype.kind != "S":
            with np.errstate(invalid="ignore"):  # of a signalling NaN
                return fields.astype(kind)
        packed = np.ascontiguousarray(fields)
        if np.isin(packed.view(np.uint8), _FOREIGN).any():
            raise ValueError("bytes that belong to no number among numbers")
        try:
            return packed.astype(kind)
        except ValueError:
            if self.integer:
                raise
            return np.array([_real(one) for one in packed.ravel().tolist()]).reshape(packed.shape)


def _real(text: bytes) -> float:
    """A real of Fortran: an exponent of three digits has no letter, ``0.1-100``."""
    match = _REAL.fullmatch(text)
    if match:
        return float(match[1] + b"e" + (match[2] or b"0"))
    try:
        return float(text)  # NaN and Infinity
    except ValueError:
        raise ValueError(f"{text!r} where a real is expected") from None


# --- Records of either kind
#
# What a method does is said at the binary one.

_Tables = tuple[_Numbers | None, _Numbers | None]


class _Place:
    """A place `at` in the file, moved on by what is read there.

    `free` collects the stretches (first, last + 1) that hold values: what is between them is
    the same in all increments that are built in the same way.
    """

    def __init__(self, file: ByteFile) -> None:
        self.file, self.at = file, 0
        self.real_bytes, self.revision = 4, 0  # the latter is that of the block
        self.free: list[tuple[int, int]] = []

    def check(self, good: bool, problem: str, at: int | None = None) -> None:
        """Refuse the file, at byte `at` or here, where it is not `good`."""
        if not good:
            raise PostDamageError(problem, self.at if at is None else at)

    def check_rows(self, start: int, rows: int, stride: int, ends: Fixed) -> None:
        """Refuse a table that is cut, or whose last row has not `ends` at their places."""
        whole = (self.file.size - start) // stride
        self.check(rows <= whole, f"cut after {whole} of {rows} records", self.file.size)
        last = start + (rows - 1) * stride
        for place, text in ends:
            words = f"{rows} records of {stride} bytes: not so"
            self.check(self.file.holds(last + place, text), words, last + place)


class _BinaryRecords(_Place):
    kind = "t16"

    def __init__(self, file: ByteFile, byte_order: Literal["little", "big"]) -> None:
        super().__init__(file)
        self.byte_order = byte_order
        self._order = ">" if byte_order == "big" else "<"
        self._integer = np.dtype(f"{self._order}i{_WORD}")

    def word(self) -> str:
        """The word that is here; "" if none is, or the file ends."""
        length = int.from_bytes(self.file.peek(self.at, _MARKER), self.byte_order)
        if length not in (_WORD, _WORD * len(END), _WORD * _TITLE_WORDS):
            return ""
        raw = self.file.peek(self.at + _MARKER, length)
        return _known_word(raw if length == _WORD else raw[::_WORD])

    def skip_word(self) -> None:
        """Go behind the word that is here."""
        self.at += self._record() + 2 * _MARKER

    def text(self) -> str:
        """A record of text, without blanks at its ends."""
        return self._decoded(self._payload())

    def label(self) -> tuple[list[int], str]:
        """A record of integers and a text: an element post code."""
        start, raw = self.at, self._payload()
        words, rest = divmod(len(raw), _WORD)
        letters = _LONG_LABEL_WORDS if words > _LONG_LABEL_WORDS else _LABEL_WORDS
        good = rest == 0 and words - letters in (1, 2)
        self.check(good, f"a post code in a record of {len(raw)} bytes", start)
        cut = (words - letters) * _WORD
        return np.frombuffer(raw[:cut], dtype=self._integer).tolist(), self._decoded(raw[cut:])

    def integers(self, *counts: int) -> list[int]:
        """Records of so many integers each."""
        found: list[int] = []
        for count in counts:
            start, raw = self.at, self._payload()
            words = f"a record of {len(raw)} bytes where {count} integers are expected"
            self.check(len(raw) == count * _WORD, words, start)
            found += np.frombuffer(raw, dtype=self._integer).tolist()
        return found

    def table(self, rows: int, integers: int, reals: int) -> _Tables:
        """Skip `rows` equal records: where their `integers` and `reals` are; None for none."""
        if rows == 0 or integers + reals == 0:
            return None, None
        start, payload = self.at, self._record()
        cut, stride = _MARKER + integers * _WORD, payload + 2 * _MARKER
        words = f"{integers} integers and {reals} reals are expected"
        kind = self._reals(payload, integers * _WORD, reals, words)
        marker = payload.to_bytes(_MARKER, self.byte_order)
        fixed = ((0, marker), (stride - _MARKER, marker))
        self.check_rows(start, rows, stride, fixed)
        self._skip(rows * stride - 2 * _MARKER)
        found = _Numbers(start, rows, stride, slice(_MARKER, cut), self._integer, True, fixed)
        real = replace(found, cells=slice(cut, stride - _MARKER), dtype=kind, integer=False)
        return (found if integers else None), (real if reals else None)

    def flow(self, rows: int, columns: int) -> _Numbers:
        """Skip one record of `rows` times `columns` reals."""
        start, length = self.at + _MARKER, self._record()
        words = f"{rows} times {columns} reals are expected"
        kind = self._reals(length, 0, rows * columns, words)
        self._skip(length)
        return _Numbers(start, 1, length, slice(None), kind, shape=(rows, columns))

    def skip_empty(self) -> None:
        """Skip a record of nothing, if one is here."""
        if self.file.holds(self.at, bytes(2 * _MARKER)):
            self.at += 2 * _MARKER

    def skip_block(self) -> None:
        """Go to the ``=end=`` of the block that we are in."""
        while (word := self.word()) != END:
            self.check(not word, f"{word!r} before the block's =end=")
            self._skip(self._record())

    def _record(self) -> int:
        """Bytes of the record here, without its lengths."""
        size = self.file.size
        self.check(self.at + _MARKER <= size, "cut", size)
        head = self.file.take(self.at, _MARKER)
        length = int.from_bytes(head, self.byte_order, signed=True)
        words = f"a record of length {length}: one of more than 2^31 bytes, in pieces, is not read"
        self.check(length >= 0, words)
        end = self.at + _MARKER + length
        words = f"cut: a record of {length} bytes begins here and the file ends at byte {size}"
        self.check(end + _MARKER <= size, words)
        tail = self.file.take(end, _MARKER)
        after = int.from_bytes(tail, self.byte_order, signed=True)
        self.check(after == length, f"a record of {length} bytes that ends in {after}")
        return length

    def _skip(self, length: int) -> None:
        """Go behind what is here, `length` bytes between the first and the last marker."""
        self.free.append((self.at + _MARKER, self.at + _MARKER + length))
        self.at += length + 2 * _MARKER

    def _payload(self) -> bytes:
        start, length = self.at + _MARKER, self._record()
        self.check(length <= _LONGEST_TEXT, f"a record of {length} bytes among short ones")
        self.at += length + 2 * _MARKER
        return self.file.take(start, length)

    def _decoded(self, raw: bytes) -> str:
        return raw[::_WORD].decode("latin-1").strip(" \0")

    def _reals(self, length: int, before: int, reals: int, words: str) -> "np.dtype[Any]":
        """The type of so many reals that fill a record of `length` bytes but for those `before`."""
        width = (length - before) // reals if reals else _WORD
        good = length == before + reals * width and width in (4, 8)
        self.check(good, f"a record of {length} bytes where {words}")
        self.real_bytes = max(self.real_bytes, width)
        return np.dtype(f"{self._order}f{width}")


class _TextRecords(_Place):
    kind = "t19"
    byte_order = "little"  # it has none

    def word(self) -> str:
        self.skip_empty()
        found = self.file.line(self.at)
        return _known_word(found[0] if found else self.file.peek(self.at, 80))

    def skip_word(self) -> None:
        found = self.file.line(self.at)
        self.at = found[1] if found else self.file.size  # no end behind the last word

    def text(self) -> str:
        return self._line().decode("latin-1").strip()

    def label(self) -> tuple[list[int], str]:
        start, line = self.at, self._line()
        numbers, rest = [_integer(line[:_FIELD], start)], line[_FIELD:]
        if len(rest) >= _FIELD and rest[:_FIELD].strip().isdigit():
            numbers.append(int(rest[:_FIELD]))
            rest = rest[_FIELD:]
        return numbers, rest.decode("latin-1").strip()

    def integers(self, *counts: int) -> list[int]:
        """Integers; text does not part the records of so many each."""
        count = sum(counts)
        self._check_fields(count)
        numbers: list[int] = []
        while len(numbers) < count:
            start, line = self.at, self._line().rstrip()
            fields = min(_FIELDS_A_LINE, count - len(numbers))
            words = f"{line[:80]!r} where {fields} integers are expected"
            self.check(len(line) == fields * _FIELD, words, start)
            numbers += [_integer(line[k : k + _FIELD], start) for k in range(0, len(line), _FIELD)]
        return numbers

    def table(self, rows: int, integers: int, reals: int) -> _Tables:
        fields = integers + reals
        if rows == 0 or fields == 0:
            return None, None
        start = self.at
        self._check_fields(rows * fields)
        ends = [end - start for end in self._one_record(fields)]
        stride = ends[-1]
        fixed = tuple((end - 1, b"\n") for end in ends)
        self.check_rows(start, rows, stride, fixed)
        self.at = start + rows * stride
        self.free.append((start, self.at - 1))
        lines = zip([0, *ends], range(0, fields, _FIELDS_A_LINE), strict=False)
        cells = np.concatenate(
            [
                np.arange(begin, begin + _FIELD * min(_FIELDS_A_LINE, fields - first))
                for begin, first in lines
            ]
        )
        before = integers * _FIELD
        found = _Numbers(start, rows, stride, cells[:before], _TEXT, True, fixed)
        real = replace(found, cells=cells[before:], integer=False)
        return (found if integers else None), (real if reals else None)

    def flow(self, rows: int, columns: int) -> _Numbers:
        start, count = self.at, rows * columns
        self._check_fields(count)
        if count == 0:
            self.skip_empty()
            return _Numbers(start, 1, 0, slice(None), _TEXT, shape=(rows, columns))
        full, rest = divmod(count, _FIELDS_A_LINE)
        a_line = min(count, _FIELDS_A_LINE)
        stride = self._one_record(a_line)[0] - start
        fixed = ((stride - 1, b"\n"),)
        if full:
            self.check_rows(start, full, stride, fixed)
            self.at = start + full * stride
            if rest:
                self._one_record(rest)
        lines = full + (rest > 0)
        self.free.append((start, self.at - 1))
        last_bytes = self.at - start - (lines - 1) * stride
        found = _Numbers(start, lines, stride, slice(0, a_line * _FIELD), _TEXT, fixed=fixed)
        return replace(found, shape=(rows, columns), last_bytes=last_bytes)

    def skip_empty(self) -> None:
        while (found := self.file.line(self.at)) is not None and not found[0].strip():
            self.at = found[1]

    def skip_block(self) -> None:
        start = self.at
        while not (word := self.word()):
            found = self.file.find(b"\n=", self.at)
            if found is None:
                raise PostDamageError("cut: no =end= follows", self.file.size)
            self.at = found + 1
        self.check(word == END, f"{word!r} before the block's =end=")
        if self.at > start:
            self.free.append((start, self.at - 1))

    def _line(self) -> bytes:
        found = self.file.line(self.at)
        if found is None:
            raise PostDamageError(self.file.why_no_line(self.at), self.at)
        line, self.at = found
        return line

    def _check_fields(self, fields: int) -> None:
        size = self.file.size
        words = f"{fields} numbers expected from byte {self.at} and the file ends at byte {size}"
        self.check(fields * _FIELD <= size - self.at, f"cut: {words}", size)

    def _one_record(self, fields: int) -> list[int]:
        """Skip one record of `fields` numbers: where each of its lines ends."""
        ends = []
        for first in range(0, fields, _FIELDS_A_LINE):
            start, line = self.at, self._line()
            count = min(_FIELDS_A_LINE, fields - first)
            wanted = count * _FIELD
            words = f"{line[:80]!r} where {count} numbers of {_FIELD} characters are expected"
            self.check(len(line) >= wanted and not line[wanted:].strip(), words, start)
            ends.append(self.at)
        return ends


_Records = _BinaryRecords | _TextRecords


def _records_of(file: ByteFile) -> _Records:
    """Records of a binary file of either byte order, or of text; ResultError of no post file."""
    length = _WORD * _TITLE_WORDS
    head = file.peek(0, _MARKER + length)
    if not head:
        raise ResultError("empty, expected a post file of Marc", file.path)
    if head.lstrip().startswith(BEGIN.encode()):
        return _TextRecords(file)
    orders: tuple[Literal["little", "big"], ...] = ("little", "big")
    for order in orders:
        if int.from_bytes(head[:_MARKER], order) != length:
            continue
        text = head[_MARKER::_WORD]
        if text.startswith(BEGIN.encode()):
            return _BinaryRecords(file, order)
        if text.isascii() and text.decode("latin-1").isprintable():
            raise ResultError(
                "a post file without =beg= marks, of Marc K7 or before (revision 7 or older), "
                "which is not read; Marc writes newer ones",
                file.path,
            )
    raise ResultError(
        f"begins with {head[:24]!r}, which no post file of Marc does: expected =beg=50100, as "
        "text or in a record of 280 bytes",
        file.path,
    )


def _known_word(raw: bytes) -> str:
    text = raw.decode("latin-1").rstrip()
    return text if text in _MARKS or text == END or text.startswith(BEGIN) else ""


def _integer(text: bytes, at: int) -> int:
    if not text.strip().removeprefix(b"-").isdigit():
        raise PostDamageError(f"{text!r} where an integer is expected", at)
    return int(text)


# --- The model: blocks 50100 to 51302


_ReadBlock = Callable[[_Records, Any], None]
"""Puts what a block holds into the model, or the layout of an increment."""


def _title(records: _Records, post: PostFile) -> None:
    post.title = records.text()


def _domains(records: _Records, post: PostFile) -> None:
    domains, number = records.integers(2)
    if domains > 1:
        words = f"part {number} of a model that was solved in {domains} domains"
        post.remarks.append(words)


def _verification(records: _Records, post: PostFile) -> None:
    words = records.integers(*_VERIFICATION_WORDS)
    for place, name in _COUNTED.items():
        if not 0 <= words[place] <= records.file.size:
            raise PostDamageError(f"a model of {words[place]} {name}", records.at)
    post.values, post.nodes, post.elements, _, post.points = words[:5]
    post.dimensions, post.corners, post.revision = words[8], words[9], words[13]


def _codes(records: _Records, post: PostFile) -> None:
    """Post codes; Marc's Volume C has one of layer n as the code + 1000 n."""
    codes = []
    for _ in range(post.values):
        numbers, label = records.label()
        code, layer = numbers[0], sum(numbers[1:])
        if layer == 0 and code >= _CODES_OF_A_LAYER:
            layer, code = divmod(code, _CODES_OF_A_LAYER)
        codes.append(PostCode(code, layer, label))
    post.codes = tuple(codes)


def _connectivity(records: _Records, post: PostFile) -> None:
    extras = 0
    if records.revision >= 2:
        _, post.corners, extras = _counts(records, 3)
    post.connectivity, _ = records.table(post.elements, 3 + post.corners + extras, 0)
    _check_end(records, f"{post.elements} elements")


def _coordinates(records: _Records, post: PostFile) -> None:
    post.node_ids, post.coordinates = records.table(post.nodes, 1, post.dimensions)
    _check_end(records, f"{post.nodes} nodes")


def _sets(records: _Records, post: PostFile) -> None:
    (count,) = _counts(records, 1)
    sets: list[tuple[str, int, _Numbers | None]] = []
    while len(sets) < count:
        name = records.text()
        size, kind = _counts(records, 2)
        if records.revision >= 2:
            records.integers(4)
        if size == 0:
            records.skip_empty()
        members, _ = records.table(1, size, 0)
        if kind in _WITH_SIDES:
            records.table(1, size, 0)
        sets.append((name, kind, members))
    post.sets = sets


def _counts(records: _Records, number: int) -> list[int]:
    at = records.at
    counts = records.integers(number)
    if min(counts) < 0:
        raise PostDamageError(f"a count of {min(counts)}", at)
    return counts


def _check_end(records: _Records, what: str) -> None:
    """Refuse a block that goes on: its tables are not as long as was thought."""
    if records.word() != END:
        raise PostDamageError(f"more than {what}", records.at)


_MODEL: dict[int, _ReadBlock] = {
    501: _title, 502: _verification, 505: _domains, 506: _codes, 507: _connectivity,
    508: _coordinates, _SETS: _sets,
}  # fmt: skip


# --- An increment: blocks 51700 to 52401


@dataclass(slots=True, eq=False)
class _Layout:
    """Where the parts of an increment are that begins at byte `start`.

    `integers` and `reals` are its verification data. Increments of a run are equal to the byte,
    but for their values: one layout serves all.
    """

    start: int
    post: PostFile
    integers: _Numbers | None = None
    reals: _Numbers | None = None
    element_values: _Numbers | None = None
    nodal: list[NodalQuantity] = field(default_factory=list)


def _integers(records: _Records, layout: _Layout) -> None:
    layout.integers, _ = records.table(1, _INCREMENT_WORDS, 0)


def _reals(records: _Records, layout: _Layout) -> None:
    (count,) = records.integers(1)
    records.check(count >= 2, f"{count} reals, which leaves no time")
    layout.reals = records.flow(1, count)


def _element_values(records: _Records, layout: _Layout) -> None:
    post = layout.post
    _, values = records.table(post.elements * post.points, 0, post.values)
    _check_end(records, f"{post.elements} elements of {post.points} points")
    layout.element_values = values


def _nodal(records: _Records, layout: _Layout) -> None:
    found = []
    count, _ = records.integers(2)
    for _ in range(count):
        name, at = records.text(), records.at
        words = records.integers(_QUANTITY_WORDS)
        components, flag, is_complex = words[3], words[6], words[5] in _COMPLEX
        most = _MOST_COMPONENTS if flag == _ALL_NODES else _MOST_WITHOUT_DATA
        known = flag in (_ALL_NODES, _NO_NODES) and 0 <= components <= most
        records.check(known, f"{name!r} of {components} components with flag {flag}", at)
        place = None
        if flag == _ALL_NODES:
            place = records.flow(layout.post.nodes, components)
            if is_complex:
                records.flow(layout.post.nodes, components)
        found.append(NodalQuantity(name, words[0], components, is_complex, place))
    layout.nodal = found


_INCREMENT: dict[int, _ReadBlock] = {
    _INTEGERS: _integers, 518: _reals, 523: _element_values, 524: _nodal,
}  # fmt: skip
_VALUES = (523, 524)
_LEFT_OUT = (_SETS, *_VALUES)  # blocks that a file can be read without


# --- Increments that look like one before, found without walking through them
#
# Between the values of an increment are names, counts and lengths of records. If the bytes
# of all these are those of an increment that was walked through, at the same distances,
# its records are where that one's are. So a file of 100 000 small increments is opened by
# comparing arrays, and a large increment by looking at a few places of it.


class _Part(NamedTuple):
    """`length` bytes at `offset`, of which those at `places` are `expected`."""

    offset: int
    length: int
    places: NDArray[np.intp]
    expected: NDArray[np.uint8]

    def compared(
        self, file: ByteFile, at: int, count: int
    ) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
        """So many of them from byte `at`, a row each, and whether each is as expected."""
        raw = file.take(at + self.offset, self.length * count)
        rows = np.frombuffer(raw, dtype=np.uint8).reshape(count, self.length)
        return rows, (rows[:, self.places] == self.expected).all(axis=1)


@dataclass(slots=True, eq=False)
class _Template:
    """The increment that was walked through last, of `length` bytes, and what is fixed in it."""

    layout: _Layout
    length: int
    parts: list[_Part]
    at_once: int = 1

    @classmethod
    def of(
        cls, file: ByteFile, layout: _Layout, end: int, free: list[tuple[int, int]]
    ) -> "_Template | None":
        """The increment that ends before byte `end` and has its values at `free`."""
        start, at = layout.start, layout.start
        groups: list[list[tuple[int, int]]] = []
        for first, last in [*sorted(free), (end, end)]:
            if first > at:
                far = end - start > _SMALL_BYTES and groups and at - groups[-1][-1][1] > _GAP_BYTES
                if far or not groups:
                    groups.append([])
                groups[-1].append((at, first))
            at = max(at, last)
        parts = []
        for group in groups:
            first, last = group[0][0], group[-1][1]
            places = np.concatenate([np.arange(*span) for span in group]) - first
            raw = np.frombuffer(file.take(first, last - first), dtype=np.uint8)
            parts.append(_Part(first - start, last - first, places, raw[places]))
        head = max(n.start + n.stride for n in (layout.integers, layout.reals) if n is not None)
        return cls(layout, end - start, parts) if head <= start + parts[0].length else None

    def match(self, file: ByteFile, at: int) -> list[tuple[list[int], list[float]]]:
        """Verification data, integers and reals, of the increments from `at` built like it."""
        count = max(1, min(self.at_once, _READ_BYTES // self.length)) if len(self.parts) == 1 else 1
        count = min(count, (file.size - at) // self.length)
        if count == 0:
            return []
        first, same = self.parts[0].compared(file, at, count)
        count = count if same.all() else int(np.argmin(same))
        if count == 0 or not all(part.compared(file, at, 1)[1][0] for part in self.parts[1:]):
            return []
        layout, found = self.layout, []
        assert layout.integers is not None and layout.reals is not None  # as the walk saw to
        for numbers in (layout.integers, layout.reals):
            begin = numbers.start - layout.start
            try:
                found.append(numbers.decode(first[:count, begin : begin + numbers.stride]).tolist())
            except ValueError:
                return []  # the walk will say what is wrong
        self.at_once = min(2 * self.at_once, _READ_BYTES)
        return list(zip(*found, strict=True))
