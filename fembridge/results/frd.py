"""Results of CalculiX, ``.frd``: text or binary, read by seeking from header to header.

    1PSTEP                         2           1           1
  100CL  101 5.00000E-04          47                     0    1           1
 -4  STRESS      6    1
 -5  SXX         1    4    1    1
 -1         1 1.08234E-03 1.03144E-03 9.28155E-04-1.29059E-03 0.00000E+00 0.00000E+00
 -3

Flags, the last number of a ``100CL`` line: 0 text with ids of 5 characters, 1 text with 10, 2
float32, 3 float64. A block header has the number and length of its records, so the walk reads
headers and skips the records; only the records of requested nodes are read. Binary records may
contain any byte and are never searched for markers. A binary block is complete if a valid header
follows, a text block if its line `` -3`` follows; counts are compared with the size of the file
before they are used. The walk ends at the first incomplete block. Negative values leave no blank
between fields: fields are cut by columns, never split at blanks.

Stress at a node is the mean over its elements. On a layer boundary that mean belongs to neither
layer (0.011 MPa measured between 0.0005 and 0.022), so such a node is refused without
``across_materials``. Quantities are joined by step and increment, not by position: a run that
diverged has one more DISP than STRESS, from the increment that did not converge.

CalculiX has no units. The index and the records have the numbers of the file; `FrdSource` returns
mm, ms and Pa, for stress and energy density (1 Pa is 1 J/m³).
"""

import re
from array import array
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from decks.unit_system import UnitSystem, unit_system_in
from fembridge.errors import ResultError, UsageError
from fembridge.results.byte_file import (
    CHUNK_BYTES,
    ByteFile,
    Characters,
    fixed_floats,
    fixed_integers,
    in_words,
)
from fembridge.results.fields import (
    VERTEX,
    Field,
    FieldBlock,
    Key,
    Scene,
    SceneCells,
    distinct,
    is_in_sorted,
    numbers_near,
    rows_of,
)
from fembridge.results.history import (
    FREQUENCY,
    STRESS_FUNCTIONS,
    TIME,
    match_quantity,
    printed_digit_ms,
)
from fembridge.results.read_options import ReadOptions
from fembridge.results.source import FieldSource, make_field, not_finite_error
from fembridge.results.von_mises import OneSidedStress, clear_shear
from fembridge.trace import MS_PER_S, seconds_to_ms
from fembridge.typing import BoolArray, FloatArray, IntArray, Table

if TYPE_CHECKING:
    from fembridge.results.status import StaRow

STRESS, DISPLACEMENT = "STRESS", "DISP"
COMPONENTS = {
    STRESS: ("SXX", "SYY", "SZZ", "SXY", "SYZ", "SZX"),
    DISPLACEMENT: ("D1", "D2", "D3"),
}
_SIMILAR_NAMES = {
    *COMPONENTS,
    "STRPOS",
    "STRMID",
    "STRNEG",
    "ZZSTR",
    "STRESSI",
    "DISPI",
    "MSTRESS",
    "MDISP",
}
KIND_OF_TYPE = {
    1: "hex8", 2: "wedge6", 3: "tet4", 4: "hex20", 5: "wedge15", 6: "tet10",
    7: "tri3", 8: "tri6", 9: "quad4", 10: "quad8", 11: "line2", 12: "line3",
}  # fmt: skip
NODES_OF_TYPE = {number: int(re.sub(r"\D", "", kind)) for number, kind in KIND_OF_TYPE.items()}
UNKNOWN_MATERIAL = -1  # an old file has a word instead of the number

_MAX_CHANGES = 5  # of nodes, reported for a file
_CONTACT = re.compile("P?CONTACI?|CELS")  # of springs that open and close
_STEP, _END_LINE = b"    1PSTEP", b" 9999"
_AFTER_A_BLOCK = (b"    1P", _END_LINE, b"  100C", b"    2C", b"    3C")
_STEP_OF_ITERATIONS = re.compile(rb"STP *(\d+)INC *(\d+)")
_TIME = re.compile(rb"-?\d+\.\d*(?:[Ee][+-]\d{2,3})?")
_STATIC, _DYNAMIC, _FREQUENCY, _BUCKLING = 0, 1, 2, 4
_MAX_COMPONENTS = 10_000  # more in a header is damage
_VALUES_A_LINE, _FIELD, _MARK = 6, 12, 3  # of a record; E12.5; " -1"
_REALS = {2: "<f4", 3: "<f8"}  # by flag
# A field, perhaps with an exponent of three digits; after two digits the next number may begin
# without a blank: 3.067.
_LONG_FIELD = re.compile(
    rb" *[+-]?(?:\d\.\d{5}[Ee][+-](?:\d{3}(?!\.)|\d{2})"
    rb"|1\.#[A-Za-z]+|[Nn][Aa][Nn]|[Ii][Nn][Ff](?:inity)?)"
)
_LONG_FIELDS = re.compile(rb"(?:%s)+ *" % _LONG_FIELD.pattern)
_SHORT_FIELD = re.compile(rb"\d\.\d{5}[Ee][+-]\d{2}")  # its blank or sign is missing
_EXPONENT = re.compile(rb"[Ee][+-](?:(0)\d\d(?!\.)|\d\d(?!\d(?!\.)))")
_NO_LINE_END = bytes.maketrans(b"\r\0", b"  ")
_SEEK_BYTES = 1 << 16  # records within this range are read together
_FEW_NODES = 64  # up to this number, elements are searched as text first
_FLAT_TYPES = (7, 8, 9, 10)  # triangles and quadrilaterals
_LONGEST_ELEMENT_LINE = 400  # bytes; ten numbers of ten characters, and additions of other programs
_MESH_BYTES = 1 << 17  # of printed elements at a time
_TEXT_BYTES = 3 << 17  # of a block at a time
_HEADING_BYTES = 4096  # searched for the heading
# An array of this size is allocated and freed before fields are read: glibc then keeps memory of
# up to that size for the next field, instead of returning the pages and faulting them in again at
# each increment (benchmarks: half the time of a float64 file, a quarter of a text file). Without
# glibc it has no effect.
_KEPT_BYTES = 1 << 23
_NO_RECORDS = " has 0 records: no element has this quantity, or it is asked for at an NSET of a "
_NO_RECORDS += "plane model with OUTPUT=3D, for which CalculiX writes none (OUTPUT=2D writes them)"

_PA = "Pa"
# By quantity; a name that ends in I is the imaginary part. Decks are in mm, N and s; a quantity
# that is not listed keeps the numbers of the file and has the unit "".
_UNIT_OF_QUANTITY = {
    "DISP": "mm", "VELO": "mm/s", "FORC": "N",
    "STRESS": _PA, "STRPOS": _PA, "STRMID": _PA, "STRNEG": _PA, "ZZSTR": _PA,
    "MSTRESS": _PA, "ENER": _PA,
    "TOSTRAIN": "1", "MESTRAIN": "1", "PE": "1", "ERROR": "%",
}  # fmt: skip
# By component, in quantities with several units.
_UNIT_OF_COMPONENT = {
    "COPEN": "mm", "CSLIP1": "mm", "CSLIP2": "mm",
    "CPRESS": _PA, "CSHEAR1": _PA, "CSHEAR2": _PA,
}  # fmt: skip
_UNIT_OF_MAGNITUDE = {"PDISP": "mm", "PSTRESS": _PA}


@dataclass(frozen=True, slots=True, eq=False)
class RecordForm:
    """Storage of the records of a quantity, as text or binary, the same at every increment.

    `stored` are the components in file order (``ALL``, the length of a vector, is announced but
    not stored); `components` are sorted, those of `COMPONENTS` first, and `order` are their
    indices in `stored`. `head_bytes` precede the values and end with the node number of
    `id_width` bytes. `spans` are the byte ranges of the values in each line of a text record.
    """

    flag: int
    is_text: bool
    stored: tuple[str, ...]
    components: tuple[str, ...]
    units: tuple[str, ...]
    order: list[int]
    record_bytes: int
    head_bytes: int
    id_width: int
    spans: list[tuple[int, int]]
    line_end: int


@cache
def _record_form(name: str, stored: tuple[str, ...], flag: int, line_end: int) -> RecordForm:
    standard = [component for component in COMPONENTS.get(name, ()) if component in stored]
    components = (*standard, *(component for component in stored if component not in standard))
    if name in _UNIT_OF_MAGNITUDE:
        unit_of_part = {"MAG": _UNIT_OF_MAGNITUDE[name], "PHA": "deg"}
        units = tuple(unit_of_part.get(component[:3], "") for component in components)
    else:
        plain = _UNIT_OF_QUANTITY.get(name.removesuffix("I"), "")
        plain = _UNIT_OF_QUANTITY.get(name, plain)
        units = tuple(_UNIT_OF_COMPONENT.get(component, plain) for component in components)
    is_text, spans = flag < 2, list[tuple[int, int]]()
    id_width = (5, 10, 4, 4)[flag]
    head_bytes = id_width + _MARK * is_text
    record_bytes = 0 if is_text else head_bytes + (4 if flag == 2 else 8) * len(stored)
    for first in range(0, len(stored) * is_text, _VALUES_A_LINE):
        start = record_bytes + head_bytes
        stop = start + _FIELD * min(_VALUES_A_LINE, len(stored) - first)
        spans.append((start, stop))
        record_bytes = stop + line_end
    order = [stored.index(component) for component in components]
    return RecordForm(
        flag, is_text, stored, components, units, order, record_bytes, head_bytes, id_width,
        spans, line_end,
    )  # fmt: skip


@dataclass(slots=True)
class FrdBlock(FieldBlock):
    """One quantity at one increment, and the position of its `records` in the file.

    `value` is the number in the ``100CL`` line: the total time over all steps in s, the frequency
    of a mode, or its buckling factor. `free` marks text records of unequal length (exponents of
    three digits). `modal` marks a mode of a frequency or buckling analysis: its increment is the
    number of the mode.
    """

    records: int
    form: RecordForm
    offset: int
    modal: bool = False
    free: bool = False

    @property
    def end(self) -> int:
        """End of the records, if they have equal length."""
        return self.offset + self.records * self.form.record_bytes

    @property
    def time_ms(self) -> float:
        """`value` as a time in ms."""
        return self.value * MS_PER_S

    def __str__(self) -> str:
        step, increment = self.key
        if not step:  # the node block
            return self.name
        return f"{self.name} of step {step}, {'mode' if self.modal else 'increment'} {increment}"


class ElementBlock(NamedTuple):
    """Number, format and position of the element records."""

    records: int
    flag: int
    offset: int
    end: int


class FrdDamageError(Exception):
    """Damage at `offset`; in `block`, if known, `records` are complete."""

    def __init__(
        self, problem: str, offset: int, block: FrdBlock | None = None, records: int = 0
    ) -> None:
        super().__init__(problem)
        self.problem, self.offset, self.block, self.records = problem, offset, block, records
        self.key: Key | None = None if block is None else block.key


class FrdIndex:
    """Content of a ``.frd`` and its positions, from one walk through `file`.

    `blocks` are the complete blocks in file order. `nodes` and `elements` are the mesh; the node
    block has three numbers for each node. `materials` are names by number. Blocks with an
    imaginary part are over frequency. `ended` says whether the line `` 9999`` closes the file;
    CalculiX writes it only if the job ends normally. `damage` is collected, not raised: the
    caller decides. `remarks` are harmless irregularities.
    """

    def __init__(self, file: ByteFile) -> None:
        self.file, self.size = file, file.size
        self.blocks: list[FrdBlock] = []
        self.nodes: FrdBlock | None = None
        self.elements: ElementBlock | None = None
        self.materials: dict[int, str] = {}
        self.ended = False
        self.damage: list[FrdDamageError] = []
        self.remarks: list[str] = []
        self._key: Key | None = None  # of the next block
        self._count: int | None = None  # of the previous block: CalculiX numbers all blocks
        self._mode: int | None = None
        # Of a buckling step: number of the output before mode 1, the state that buckles, factor 0.
        self._before_modes: dict[int, int] = {}
        self._is_order_noted = self._has_iterations = False
        # Text, name, components and line end of -4 and -5 lines, by the -4 line; they repeat at
        # every increment.
        self._names: dict[bytes, tuple[bytes, str, tuple[str, ...], int]] = {}
        self._at = 0  # start of the current block
        try:
            while not self.ended and self._at < file.size:
                self._at = self._next(self._at)
        except (FrdDamageError, ValueError) as error:
            harm = FrdDamageError(str(error), self._at)
            harm = error if isinstance(error, FrdDamageError) else harm
            if harm.block is None and self._key is not None:
                harm.key = self._key
                harm.problem = "header of step {}, increment {}: ".format(*self._key) + harm.problem
            self.damage.append(harm)
        for damage in self.damage:
            if damage.block is None:
                damage.problem += f" (byte {damage.offset} of {file.size})"
        self.remarks += self._contradictions()
        parts = {imaginary_name(block.name) for block in self.blocks}
        complex_ones = {block.key for block in self.blocks if block.name in parts}
        for block in self.blocks if complex_ones else ():
            if block.axis == TIME and block.key in complex_ones:
                block.axis = FREQUENCY

    def _contradictions(self) -> list[str]:
        """Contradictions between the headers of the blocks."""
        remarks: dict[str, str] = {}  # the first of a kind
        firsts: dict[str, FrdBlock] = {}
        for block in self.blocks:
            first = firsts.setdefault(block.name, block)
            stored = set(block.components)
            if block.form.stored != first.form.stored:
                remarks.setdefault("later", f"{block} has other components than {first}")
            expected = COMPONENTS.get(block.name)
            if expected and not stored & {"MAG1", *expected} >= set(expected) and block is first:
                message = f"{block} has components {', '.join(block.components)}"
                remarks.setdefault("components", f"{message}, expected {', '.join(expected)}")
            for name in COMPONENTS if block is first and block.name not in _SIMILAR_NAMES else ():
                if block.name != name and stored == set(COMPONENTS[name]):
                    message = f"unknown quantity {block.name} has the components of {name}"
                    remarks.setdefault("name", message)
        for before, block in pairwise(self.blocks):
            if block.key == before.key and block.value != before.value:
                message = f"{before} is at {before.value:g}, {block} at {block.value:g}"
                remarks.setdefault("value", message)
            rises = block.key >= before.key and (block.modal or block.value >= before.value)
            if not rises and not self._has_iterations:
                message = f"{block} at {block.value:g} follows {before} at {before.value:g}"
                remarks.setdefault("order", message)
        return list(remarks.values())

    def named(self, name: str) -> list[FrdBlock]:
        """Blocks of one quantity, in file order."""
        return [block for block in self.blocks if block.name == name]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the quantities, in order of first appearance."""
        return tuple(dict.fromkeys(block.name for block in self.blocks))

    def problem(self) -> str | None:
        """Message about an incomplete file; None if it is complete."""
        if self.ended and not self.damage:
            return None
        if not self.blocks and not self.damage:
            summary = f"header only ({self.size} bytes): the solver stopped before its first output"
            if self.nodes is not None:
                summary = "mesh only, no results: the solver stopped at its start"
            return f"{summary}; see the .sta file and the solver's log for the reason"
        problems = [harm.problem for harm in self.damage]
        blocks_by_key: dict[Key, dict[str, FrdBlock]] = {}
        for block in self.blocks:
            blocks_by_key.setdefault(block.key, {}).setdefault(block.name, block)
        damaged = {harm.key for harm in self.damage}
        whole_keys = [key for key in blocks_by_key if key not in damaged]
        if not self.ended:
            problems.append("no end line 9999: the run did not end normally")
            # The increment at which a run diverged has DISP but no STRESS; a cut one lacks its
            # last quantities.
            (before, last), lost = (
                whole_keys[-2:] if len(whole_keys) > 1 else ((0, 0), (0, 0)),
                set[str](),
            )
            if before[0] == last[0] != 0:
                lost = blocks_by_key[before].keys() - blocks_by_key[last].keys()
            if lost:
                whole_keys.pop()
            attempts = read_attempts(self.file.path)
            if attempts and (row := attempts[-1]).failed:
                problems.append(
                    f"increment {row.increment} of step {row.step} did not converge "
                    f"(.sta: attempt {row.attempt} failed)"
                )
            elif lost and not self.damage:
                problems.append(
                    f"increment {last[1]} of step {last[0]} has {', '.join(blocks_by_key[last])} "
                    f"but no {', '.join(sorted(lost))}: it did not converge"
                )
        if whole_keys:
            (step, increment), block = (
                whole_keys[-1],
                next(iter(blocks_by_key[whole_keys[-1]].values())),
            )
            problems.append(
                f"last complete increment: {increment} of step {step}, {block.time_ms:g} ms"
            )
        elif self.blocks:
            problems.append("no complete increment")
        return "; ".join(problems)

    def _line(self, at: int, prefix: str = "") -> tuple[bytes, int]:
        """The line at `at` without its line end, and the offset of the next line."""
        line_and_next = self.file.line(at)
        if line_and_next is None:
            raise FrdDamageError(f"{prefix}{self.file.line_problem(at)}", at)
        return line_and_next

    def _next(self, at: int) -> int:
        """Read the block or header line at `at`; return the offset of the next."""
        file = self.file
        start = file.peek(at, 80)
        if start.startswith(_END_LINE):
            self.ended = True
            if rest := start[len(_END_LINE) :].strip():
                raise ValueError(f"{in_words(rest[:12])} after the end line")
            return file.size
        line, after = self._line(at)
        if not line:  # some builds write one after the materials
            return after
        if line.startswith(b"  100C"):
            return self._block(line, after)
        if line.startswith((b"    2C", b"    3C")):
            return self._mesh(line, after)
        if not line.startswith(b"    1"):
            raise ValueError(f"{in_words(line[:24])}, expected a block")
        if line.startswith(_STEP):
            self._key = self._mode = None
            if iterations := _STEP_OF_ITERATIONS.match(line, 24):
                step, increment = int(iterations[1]), int(iterations[2])
            else:
                step, increment = _parse_counts(line, (48, 60), (36, 48))
                number, before = line[10:36].strip(), self._count
                self._count = int(number) if number.isdigit() else None
                out_of_order = before is not None and self._count not in (None, before + 1)
                if out_of_order and not self._is_order_noted:
                    self._is_order_noted = True
                    self.remarks.append(
                        "blocks are missing, duplicate or not in order: number "
                        f"{self._count}, of step {step}, increment {increment}, follows {before}"
                    )
            self._key = step, increment
            if line[24:27] == b"STP" and not self._has_iterations:
                self._has_iterations = True
                self.remarks.append(
                    f"iterations of increment {increment} of step {step}, "
                    "not a history (LAST ITERATIONS)"
                )
        elif line.startswith(b"    1PMODE"):
            [self._mode] = _parse_counts(line, (24, 36))
        elif line.startswith(b"    1UMAT") and line[9:14].strip().isdigit():
            self.materials.setdefault(int(line[9:14]), line[14:].decode("latin-1").strip())
        return after

    def _mesh(self, line: bytes, after: int) -> int:
        """Index the node or element block of a header line; return its end."""
        kind = "node" if line.startswith(b"    2C") else "element"
        text = line[73:75].strip() in (b"0", b"1")
        blank = text and not line[24:36].strip()
        announced, flag = (
            (-1, int(line[73:75])) if blank else _parse_counts(line, (24, 36), (73, 75))
        )
        if not text and (flag > 3 or after + 16 * announced > self.size):
            raise ValueError(f"{kind} block: cut: {announced} {kind}s announced")
        if kind == "element":
            return self._elements(announced, flag, after)
        form = _record_form("node block", ("x", "y", "z"), flag, after - self._at - len(line))
        block = FrdBlock(
            "node block", (0, 0), TIME, 0.0, form.components, form.units, announced, form, after
        )
        if text:
            block, end, problem = self._text_end(block)
            if problem:  # the mesh is unusable, the next blocks are not
                self.damage.append(FrdDamageError(problem, self._at))
                return end
        elif not self._boundary(end := block.end):
            raise ValueError("node block: wrong count of records")
        self.nodes = block
        return end

    def _elements(self, announced: int, flag: int, after: int) -> int:
        """Index the element block whose records begin at `after`; return its end."""
        file, block, present = self.file, "element block", announced
        if flag < 2:
            closed = file.find(b"\n -3", after - 1)
            last = None if closed is None else file.line(closed + 1)
            if closed is None or last is None:
                raise ValueError(f"{block}: cut: its end line -3 is missing")
            present, end = file.count(b"\n -1", after - 1, closed), last[1]
            odd = not announced or present < announced or present % announced
            if announced not in (-1, present) and odd:
                message = f"{block}: {announced} records announced, {present} present"
                self.damage.append(FrdDamageError(message, self._at))
                return end
        else:
            astray = f"{block}: wrong count of records"
            end, present = after, 0
            try:
                while announced and not (present and self._boundary(end)):  # a layer of composites
                    ends = (behind for _, behind in packed_elements(file, end, announced))
                    end = max([end, *ends])
                    present += announced
            except ResultError as error:
                raise ValueError(astray if present > announced else error.problem) from error
            if not self._boundary(end):
                raise ValueError(astray)
        if present > announced > 0:
            self.remarks.append(
                f"{block} announces {announced} elements and has {present // announced} times as "
                "many: layers of composite shells"
            )
        self.elements = ElementBlock(present, flag, after, end)
        return end

    def _block(self, line: bytes, after: int) -> int:
        """Index the result block of a ``100CL`` line; return its end."""
        if self._key is None:
            raise ValueError("100CL without a 1PSTEP line with step and increment")
        step, increment = self._key
        text, analysis_text = line[12:24].strip(), line[56:58].strip()
        if not _TIME.fullmatch(text):
            raise ValueError(f"{in_words(line[12:24])}, expected a time")
        seconds_to_ms(float(text))
        [flag] = _parse_counts(line, (73, 75))
        [analysis] = _parse_counts(line, (56, 58)) if analysis_text else [_STATIC]
        modal = analysis in (_FREQUENCY, _BUCKLING) or line[63:73].strip() == b"MODAL"
        axis = TIME if analysis in (_STATIC, _DYNAMIC) else "number of the analysis"
        if modal:
            [output] = _parse_counts(line, (58, 63))
            increment = output if self._mode is None else self._mode
            if analysis == _BUCKLING and self._mode is None:
                increment -= self._before_modes.setdefault(step, output - (float(text) != 0))
            axis = "buckling factor" if analysis == _BUCKLING else FREQUENCY
        if flag > 3:
            raise ValueError(f"format flag {flag}")
        blank = flag < 2 and not line[24:36].strip()
        [records] = [-1] if blank else _parse_counts(line, (24, 36))
        header, name, components, line_end = self._name_lines(after)
        form = _record_form(name, components, flag, line_end)
        block = FrdBlock(
            name, (step, increment), axis, float(text), form.components, form.units, records,
            form, after + len(header), modal,
        )  # fmt: skip
        self._key, end = None, block.end
        if flag < 2:
            block, end, problem = self._text_end(block)
            if problem:
                raise FrdDamageError(problem, end, block)
        elif end > self.size:
            raise self._cut(block, records)
        elif not self._boundary(end):
            raise FrdDamageError(
                f"{block} is followed by {in_words(self.file.peek(end, 12))} at byte {end}: its "
                f"count {records} is wrong, or bytes are missing",
                end,
                block,
            )
        self.blocks.append(block)
        return end

    def _name_lines(self, offset: int) -> tuple[bytes, str, tuple[str, ...], int]:
        """The ``-4`` and ``-5`` lines at `offset`: text, name, components, line end."""
        first, at = self._line(offset)
        cached = self._names.get(first)
        if cached is not None and self.file.peek(offset, len(cached[0])) == cached[0]:
            return cached
        name, [announced] = first[5:13].decode("ascii").strip(), _parse_counts(first, (13, 18))
        if not first.startswith(b" -4") or not name:
            raise ValueError(f"{in_words(first[:40])}, expected a name")
        if announced > _MAX_COMPONENTS:
            raise ValueError(f"{name} announces {announced} components")
        components: list[str] = []
        for _ in range(announced):
            start, (line, at) = at, self._line(at, f"{name} lines are ")
            if not line.startswith(b" -5"):
                raise ValueError(
                    f"{in_words(line[:40])}, expected {announced} components of {name}"
                )
            if line[33:38].strip() != b"1":
                components.append(line[5:13].decode("ascii").strip())
        if not components:
            raise ValueError(f"{name} without components")
        text = self.file.take(offset, at - offset)
        self._names[first] = text, name, tuple(components), at - start - len(line)
        return self._names[first]

    def _text_end(self, block: FrdBlock) -> tuple[FrdBlock, int, str]:
        """The block with its count and kind of records, its end, and a problem or ""."""
        closing = b"\n -3\r\n" if block.form.line_end == 2 else b"\n -3\n"
        if block.records >= 0 and self.file.peek(block.end - 1, len(closing)) == closing:
            return block, block.end - 1 + len(closing), ""
        marker_at = self.file.find(b"\n -3", block.offset - 1)
        last = None if marker_at is None else self.file.line(marker_at + 1)
        at = self.size if marker_at is None else marker_at
        begun = self.file.count(b"\n -1", block.offset - 1, at)
        if last is None:
            raise self._cut(block, begun)
        if block.records < 0:
            block = replace(block, records=begun)
        if block.end == at + 1:
            return block, last[1], ""
        if begun == block.records > 0:
            return replace(block, free=True), last[1], ""
        if begun == 0 and at + 1 == block.offset:  # of a fluid: closed, and empty
            self.remarks.append(f"{block} announces {block.records} records, but has none")
            return replace(block, records=0), last[1], ""
        return block, last[1], f"{block}: {block.records} records announced, {begun} present"

    def _cut(self, block: FrdBlock, begun: int) -> FrdDamageError:
        """Damage of a block that the end of the file cuts after at most `begun` records."""
        whole_records = min((self.size - block.offset) // block.form.record_bytes, begun)
        announced = "" if block.records < 0 else f"{block.records} "
        message = f"{block} is cut at byte {self.size}, after {whole_records} of {announced}records"
        return FrdDamageError(message, self.size, block, whole_records)

    def _boundary(self, at: int) -> bool:
        """Whether the header of a next block, or the end of the file, is at `at`."""
        start = self.file.peek(at, 6)
        return any(
            start.startswith(marker) or marker.startswith(start) for marker in _AFTER_A_BLOCK
        )


def node_ids(file: ByteFile, block: FrdBlock) -> IntArray:
    """Node numbers of `block`, in file order, ``(record,)``."""
    if block.free:
        return irregular_records(file, block)[0]
    if not block.records:
        return np.empty(0, dtype=np.int64)
    step = max(1, _TEXT_BYTES // block.form.record_bytes)
    return np.concatenate(
        [
            record_ids(file.path, [block], read_characters(file, block, first, step), first)
            for first in range(0, block.records, step)
        ]
    )


def block_table(file: ByteFile, block: FrdBlock) -> tuple[IntArray, FloatArray]:
    """Nodes ``(record,)`` and values ``(record, component)`` of a block, in file order.

    The records are read in pieces of some hundred kilobytes, so that the additional memory does
    not depend on the size of the block.
    """
    if block.free:
        nodes, values = irregular_records(file, block)
    else:
        nodes = np.empty(block.records, dtype=np.int64)
        values = np.empty((block.records, len(block.form.stored)), dtype=np.float64)
        step = max(1, _TEXT_BYTES // block.form.record_bytes)
        for first in range(0, block.records, step):
            characters = read_characters(file, block, first, step)
            nodes[first : first + step] = record_ids(file.path, [block], characters, first)
            values[first : first + step] = record_values(file.path, [block], characters)
    return nodes, values if block.components == block.form.stored else values[:, block.form.order]


def read_characters(file: ByteFile, block: FrdBlock, first: int, max_count: int) -> Characters:
    """Bytes of at most `max_count` records from number `first` on, ``(record, byte)``."""
    count, length = min(max_count, block.records - first), block.form.record_bytes
    raw = file.take(block.offset + first * length, count * length)
    return np.frombuffer(raw, dtype=np.uint8).reshape(count, length)


def record_ids(
    path: Path, blocks: Sequence[FrdBlock], characters: Characters, first: int = 0
) -> IntArray:
    """Node of each record; all `blocks` have the same form and number of records.

    `first` is the number of the first record in its block.
    """
    form = blocks[0].form
    if not form.is_text:
        ids: IntArray = np.ascontiguousarray(characters[:, :4]).view("<i4")[:, 0].astype(np.int64)
        is_valid: BoolArray = ids > 0
    else:
        marker, head_end = b" -1", form.head_bytes
        ids, is_valid = fixed_integers(characters[:, _MARK:head_end])
        for start, end in form.spans:
            for column, character in enumerate(marker, start=start - head_end):
                is_valid &= characters[:, column] == character
            is_valid &= characters[:, end + form.line_end - 1] == ord("\n")
            marker = b" -2"  # on every line but the first
    if not is_valid.all():
        row = int(np.argmin(is_valid))
        block_index, number = divmod(row, len(characters) // len(blocks))
        raise ResultError(
            f"{blocks[block_index]}: record {first + number + 1} of {blocks[block_index].records} "
            f"begins with {in_words(bytes(characters[row, : _MARK + 10]))}, or has another length",
            path,
        )
    return ids


def record_values(path: Path, blocks: Sequence[FrdBlock], characters: Characters) -> FloatArray:
    """Values ``(record, component)`` in the type of the file; float32 is not converted."""
    form, count = blocks[0].form, len(blocks[0].form.stored)
    if not form.is_text:
        # Copied as one void: faster than value by value.
        packed = np.dtype([("node", "<i4"), ("values", f"V{form.record_bytes - 4}")])
        voids = characters.reshape(-1).view(packed)["values"]
        packed_values: FloatArray = np.ascontiguousarray(voids).view(_REALS[form.flag])
        return packed_values.reshape(-1, count)
    fields = np.concatenate([characters[:, start:end] for start, end in form.spans], axis=1)
    try:
        return _parse_floats(fields.reshape(-1, count, _FIELD))
    except ValueError as error:
        row, column, problem = error.args
        node = record_ids(path, blocks[:1], characters[row : row + 1])[0]
        block = blocks[row * len(blocks) // len(characters)]
        where = f"{block}, node {node}, {form.stored[column]}"
        raise ResultError(f"{where}: {problem}", path) from error


def irregular_records(file: ByteFile, block: FrdBlock) -> tuple[IntArray, FloatArray]:
    """Nodes and values of a text block with lines of unequal length.

    Some builds print exponents of three digits, ``-5.28012E-003``, which overflow the field and
    shift all others. Fields are then recognised by the form of a number, with or without a blank
    or sign before it.
    """
    closing_at = file.find(b"\n -3", block.offset - 1)
    offset, end = block.offset, file.size if closing_at is None else closing_at + 1
    head, nodes, values = block.form.head_bytes, array("q"), array("d")
    width = len(block.form.stored)
    counts: set[int] = set()  # of values in complete records
    exponents: set[bool] = set()  # whether exponents are padded to three digits: all or none
    while offset < end:
        text = file.take(offset, min(_TEXT_BYTES, end - offset))
        text = text if offset + len(text) == end else text[: text.rfind(b"\n") + 1]
        if not text:
            raise ResultError(f"{block}: no line at byte {offset}", file.path)
        offset += len(text)
        for number, line in enumerate(text.splitlines()):
            mark, prefix, rest = line[:_MARK], line[_MARK:head].strip(), line[head:]
            if mark == b" -1" and prefix.isdigit():
                if nodes:
                    counts.add(len(values) - width * (len(nodes) - 1))
                nodes.append(int(prefix))
                mark, prefix = b" -2", b""
            is_whole = (mark, prefix) == (b" -2", b"") and nodes and counts <= {width}
            fields = _LONG_FIELD.findall(rest)
            is_whole = is_whole and _LONG_FIELDS.fullmatch(rest) is not None
            if not is_whole or any(map(_SHORT_FIELD.fullmatch, fields)):
                before = text.splitlines(keepends=True)[:number]
                at = offset - len(text) + sum(map(len, before))
                message = f"record {len(nodes)} of {block.records}, at byte {at}, is "
                message += f"{in_words(line[:24])}, expected {width} numbers of a node"
                raise ResultError(f"{block}: {message}", file.path)
            values.extend(map(_parse_number, fields))
            exponents.update(map(bool, _EXPONENT.findall(rest)))
    if len(nodes) != block.records or len(values) != width * len(nodes):
        message = f"{len(nodes)} of {block.records} records, {len(values)} values"
        raise ResultError(f"{block}: {message}", file.path)
    if len(exponents) > 1:
        raise ResultError(f"{block}: exponents of two and of three digits, as E-030", file.path)
    return np.array(nodes, dtype=np.int64), np.array(values).reshape(-1, width)


def _parse_floats(fields: Characters) -> FloatArray:
    """E12.5 fields, ``(row, column, 12)`` -> ``(row, column)``, with NaN and infinity.

    Raises
    ------
    ValueError
        A field is not a number; arguments: row, column, message.
    """
    values, parsed = fixed_floats(fields.reshape(-1, _FIELD))
    for row in np.flatnonzero(~parsed).tolist():
        try:
            values[row] = _parse_number(fields.reshape(-1, _FIELD)[row].tobytes())
        except ValueError as error:
            raise ValueError(*divmod(row, fields.shape[1]), str(error)) from error
    return values.reshape(fields.shape[:2])


class ElementRows(NamedTuple):
    """Elements of one type: `ids` and `material` ``(M,)``, `corners` ``(M, k)``.

    Nodes are in file order: corners, then mid-sides; for hex20 and wedge15 the mid-sides of the
    bottom, of the vertical edges, and of the top (deck nodes 1-12, 17-20, 13-16; 1-9, 13-15,
    10-12).
    """

    type: int
    ids: IntArray
    material: IntArray
    corners: IntArray


def element_rows(
    file: ByteFile, elements: ElementBlock, nodes: Collection[int] = ()
) -> Iterator[ElementRows]:
    """Elements in tables of one type; an invalid record raises a `ResultError`.

    With `nodes`, at least the elements that have one of them.
    """
    if elements.flag >= 2:
        yield from (rows for rows, _ in packed_elements(file, elements.offset, elements.records))
        return
    width, offset = 5 if elements.flag == 0 else 10, elements.offset
    node_fields = [b"%*d" % (width, node) for node in nodes]
    while offset < elements.end:
        text = file.take(offset, min(_MESH_BYTES, elements.end - offset))
        if offset + len(text) < elements.end:  # a chunk ends before the head of an element
            text = text[: text.rfind(b"\n -1") + 1]
        if not text:
            raise ResultError(f"element block: no element at byte {offset}", file.path)
        offset += len(text)
        if not node_fields or any(node in text for node in node_fields):
            lines = text.split(b"\n")[: -2 if offset == elements.end else -1]  # without -3
            if lines:
                yield from _elements_of_lines(lines, width, file.path, offset - len(text))


def packed_elements(file: ByteFile, offset: int, records: int) -> Iterator[tuple[ElementRows, int]]:
    """Binary elements, and the offset after them.

    Consecutive elements of one type have equal length and are read together.
    """
    position, read_count = offset, 0
    while read_count < records:
        head = file.peek(position, 8)
        kind = int.from_bytes(head[4:], "little")
        if len(head) == 8 and kind not in NODES_OF_TYPE:
            raise ResultError(f"element type {kind} at byte {position} is unknown", file.path)
        width = 4 * (4 + NODES_OF_TYPE.get(kind, 0))  # id, type, 0, material
        if position + width > file.size:
            raise ResultError(f"element block: cut: {records} elements announced", file.path)
        look_ahead, same_count = 16, 1
        while same_count and read_count < records and position + width <= file.size:
            count = min(
                look_ahead,
                records - read_count,
                CHUNK_BYTES // width,
                (file.size - position) // width,
            )
            table = np.frombuffer(file.take(position, count * width), "<i4").reshape(count, -1)
            of_kind = table[:, 1] == kind
            same_count = count if of_kind.all() else int(np.argmin(of_kind))
            if same_count:
                rows = table[:same_count].astype(np.int64)
                position, read_count = position + same_count * width, read_count + same_count
                yield ElementRows(kind, rows[:, 0], rows[:, 3], rows[:, 4:]), position
            look_ahead *= 4


def _elements_of_lines(
    lines: list[bytes], width: int, path: Path, offset: int
) -> Iterator[ElementRows]:
    """Text elements from `offset`: `` -1`` with id, type, group, material; `` -2`` with nodes."""
    longest = max(map(len, lines))
    if longest > _LONGEST_ELEMENT_LINE:
        raise ResultError(f"element block: a line of {longest} bytes", path)
    table = np.array(lines)
    size = max(table.itemsize, _MARK + max(width + 15, 10 * width))
    characters = table.astype(f"S{size}").view(np.uint8).reshape(-1, size)
    marks = table.astype(f"S{_MARK}")
    heads, tails = marks == b" -1", marks == b" -2"
    at_type = _MARK + width
    ids, ids_ok = fixed_integers(characters[heads, _MARK:at_type])
    kind, kinds_ok = fixed_integers(characters[heads, at_type : at_type + 5])
    material, has_material = fixed_integers(characters[heads, at_type + 10 : at_type + 15])
    material[~has_material] = UNKNOWN_MATERIAL
    # Non-blank fields of a line, and the element of each.
    fields = characters[tails, _MARK : _MARK + 10 * width].reshape(-1, width)
    text = fields.tobytes().translate(_NO_LINE_END)
    filled = np.frombuffer(text, f"S{width}") != b" " * width
    nodes, nodes_ok = fixed_integers(fields[filled])
    element = np.repeat(np.cumsum(heads)[tails] - 1, 10)[filled]
    counts = np.bincount(element[element >= 0], minlength=kind.size)
    checks = (heads[:1], heads | tails, ids_ok, kinds_ok, nodes_ok, counts > 0)
    if not all(check.all() for check in checks):
        is_odd = ~(heads | tails)
        is_odd[np.flatnonzero(heads)[~(ids_ok & kinds_ok & (counts > 0))]] = True
        is_odd[np.repeat(np.flatnonzero(tails), 10)[filled][~nodes_ok]] = True
        is_odd[0] |= not heads[0]
        odd = int(np.argmax(is_odd))
        at = offset + sum(len(line) + 1 for line in lines[:odd])
        found = f"{in_words(lines[odd][:80])} at byte {at}"
        raise ResultError(f"element block: {found}, expected an element", path)
    for kind_and_count in dict.fromkeys(zip(kind.tolist(), counts.tolist(), strict=True)):
        rows = (kind == kind_and_count[0]) & (counts == kind_and_count[1])
        corners = nodes[rows[element]].reshape(-1, kind_and_count[1])
        yield ElementRows(kind_and_count[0], ids[rows], material[rows], corners)


def values_at(
    file: ByteFile,
    blocks: Sequence[FrdBlock],
    nodes: Sequence[int],
    check: Callable[[FrdBlock, IntArray], object] = lambda *_: None,
) -> FloatArray:
    """Values of `blocks` of one quantity at `nodes`, ``(T, node, component)``.

    Nodes are in the order of the deck's set: not sorted, with duplicates. The rows of the requested
    nodes are found once and tried on the next block; the id of each record shows whether they
    still match, else they are searched again. Blocks of one form are converted together. `check`
    is called with each block whose nodes are all read.
    """
    requested = np.array(nodes, dtype=np.int64)
    values = np.empty((len(blocks), requested.size, len(blocks[0].components)))
    rows = np.empty(0, dtype=np.int64)
    heads = np.empty((0, 0), dtype=np.uint8)
    form: RecordForm | None = None
    by_form: dict[RecordForm, list[tuple[int, Characters]]] = {}
    for index, block in enumerate(blocks):
        before, form, gathered = form, block.form, None
        if form is before and not block.free and rows.max() < block.records:
            gathered = _gather(file, block, rows)
        if gathered is None or not np.array_equal(gathered[:, : form.head_bytes], heads):
            ids = node_ids(file, block)
            check(block, ids)
            rows = rows_of(requested, ids)
            if (rows < 0).any():
                absent, available = requested[int(np.argmin(rows))], np.unique(ids)
                message = (
                    f"{absent} has no record in {block}: {available.size} nodes, {available[0]} to "
                )
                message += f"{available[-1]}; nearest {numbers_near(available, absent)}"
                raise ResultError(f"node {message}", file.path)
            if block.free:
                values[index] = irregular_records(file, block)[1][rows][:, block.form.order]
                continue
            gathered = _gather(file, block, rows)
            heads = gathered[:, : form.head_bytes]
        by_form.setdefault(form, []).append((index, gathered))
    for entries in by_form.values():
        places, tables = zip(*entries, strict=True)
        form_blocks = [blocks[index] for index in places]
        characters = np.concatenate(tables)
        if (
            record_ids(file.path, form_blocks, characters) != np.tile(requested, len(form_blocks))
        ).any():
            raise ResultError(f"{form_blocks[0]}: records changed while read", file.path)
        values_of_form = record_values(file.path, form_blocks, characters)[
            :, form_blocks[0].form.order
        ]
        values[list(places)] = values_of_form.reshape(len(form_blocks), requested.size, -1)
    return values


def _gather(file: ByteFile, block: FrdBlock, rows: IntArray) -> Characters:
    """Records at `rows`, in that order, ``(record, byte)``."""
    first, last = int(rows.min()), int(rows.max())
    if (last - first + 1) * block.form.record_bytes <= max(
        _SEEK_BYTES, 4 * rows.size * block.form.record_bytes
    ):
        return read_characters(file, block, first, last - first + 1)[rows - first]
    return np.concatenate([read_characters(file, block, row, 1) for row in rows.tolist()])


def find_materials(index: FrdIndex, nodes: Sequence[int] | IntArray) -> IntArray:
    """Pairs of node and material of its elements, ``(M, 2)``, sorted, for all `nodes`."""
    pairs = [np.empty((0, 2), dtype=np.int64)]
    requested = distinct(np.asarray(nodes, dtype=np.int64))
    if index.elements is not None and requested.size:
        few = requested.tolist() if requested.size <= _FEW_NODES else ()
        for rows in element_rows(index.file, index.elements, few):
            element, corner = np.nonzero(np.isin(rows.corners, requested))
            pairs.append(np.stack([rows.corners[element, corner], rows.material[element]], 1))
    return distinct(np.concatenate(pairs), axis=0)


def read_attempts(path: Path) -> "list[StaRow]":
    """Attempts at increments in the ``.sta`` of the same name; none if it cannot be read."""
    sta_path = path.with_suffix(".sta")
    if not sta_path.exists():
        return []
    from fembridge.results.status import read_sta

    try:
        return read_sta(sta_path)
    except (ResultError, OSError):
        return []


def imaginary_name(name: str) -> str:
    """Name of the imaginary part of a quantity; CalculiX prints eight letters."""
    return f"{name[:7]}I"


def _parse_counts(line: bytes, *places: tuple[int, int]) -> list[int]:
    """Counts at `places` of a header; Python's other forms, such as ``1_0``, raise ValueError."""
    for start, end in places:
        if not line[start:end].strip().isdigit():
            raise ValueError(
                f"{in_words(line[start:end])}, expected a count in {in_words(line[:6])}"
            )
    return [int(line[start:end]) for start, end in places]


def _parse_number(field: bytes) -> float:
    """A number that may be NaN, infinite or have a long exponent."""
    if re.fullmatch(rb" *[+-]?\d\.\d{5}[Ee][+-]\d{2,3} *", field):
        return float(field)
    if re.fullmatch(rb" *[+-]?(nan.*|1\.#(ind|qnan|snan).*)", field, re.IGNORECASE):
        return float("nan")
    infinite = re.fullmatch(rb" *([+-]?)(inf|infinity|1\.#inf.*) *", field, re.IGNORECASE)
    if infinite:
        return float(infinite[1] + b"inf")
    raise ValueError(f"{in_words(field)}, expected a number")


Outputs = Sequence[dict[str, FrdBlock]]


class FrdSource(FieldSource[FrdBlock]):
    """An open ``.frd``."""

    def __init__(self, file: ByteFile, options: ReadOptions) -> None:
        super().__init__(file, options)
        self._index = FrdIndex(file)
        self._previous_nodes: dict[str, tuple[FrdBlock, IntArray]] = {}  # by quantity
        self._changes = 0  # of nodes, within a step

    def unit_system(self) -> UnitSystem | None:
        """Unit system in the deck's heading, which CalculiX copies to the results."""
        return unit_system_in(self.file.peek(0, _HEADING_BYTES).decode("latin-1"))

    def describe(self) -> Table:
        """Mesh, quantities, increments, defects, and the sets of the deck of the same name."""
        from fembridge.results.nodes import describe_deck_sets

        index = self._index
        problems = (self.file.change, index.problem())
        storage = ("ASCII", "ASCII", "float32", "float64")
        quantities = []
        for name in index.names:
            first, *_ = blocks = index.named(name)
            kind = storage[first.form.flag]
            quantities.append(self.quantity_table(name, blocks, self._nodes_of(first), kind))
        return super().describe() | {
            "mesh_nodes": None if index.nodes is None else index.nodes.records,
            "elements": None if index.elements is None else index.elements.records,
            "materials": dict(sorted(index.materials.items())),
            "sets": describe_deck_sets(self.path),
            "quantities": quantities,
            "remarks": list(index.remarks),
            "problem": "; ".join(problem for problem in problems if problem) or None,
        }

    def element_corners(self, elements: Sequence[int]) -> Mapping[int, Sequence[int]]:
        """Nodes of each of `elements`, in file order."""
        index = self._index
        if index.elements is None:
            return {}
        return {
            int(rows.ids[row]): rows.corners[row].tolist()
            for rows in element_rows(index.file, index.elements, ())
            for row in np.flatnonzero(np.isin(rows.ids, elements))
        }

    def shell_node(self, nodes: Sequence[int]) -> int | None:
        """The first of `nodes` in a shell that was not expanded, as of OUTPUT=2D.

        Such an element is flat like a plane one. The deck beside the file tells them apart, and
        without it nodes that differ in z.
        """
        index = self._index
        if index.elements is None or not nodes:
            return None
        flat: dict[int, set[int]] = {}  # nodes of the flat elements at each of `nodes`
        few = list(nodes) if len(nodes) <= _FEW_NODES else ()
        for rows in element_rows(index.file, index.elements, few):
            if rows.type in _FLAT_TYPES:
                for row in np.flatnonzero(np.isin(rows.corners, nodes).any(axis=1)).tolist():
                    corners = set(rows.corners[row].tolist())
                    for node in corners.intersection(nodes):
                        flat.setdefault(node, set()).update(corners)
        if not flat:
            return None
        from fembridge.results.nodes import shell_nodes

        first = min(flat)
        if (known := shell_nodes(self.path.with_suffix(".inp"), flat)) is not None:
            return min(known, default=None)
        numbers, at_mm = self._coordinates()
        z_mm = at_mm[np.isin(numbers, list(set().union(*flat.values()))), 2]
        return first if z_mm.size and np.ptp(z_mm) > 0 else None

    def _nodes_of(self, block: FrdBlock) -> IntArray:
        """Distinct nodes of `block`; blocks of the whole mesh share one array."""
        nodes = self._index.nodes
        covers_mesh = nodes is not None and nodes.records == block.records and not block.free
        return self._mesh_nodes if covers_mesh else np.unique(node_ids(self.file, block))

    @cached_property
    def _sorted_mesh_nodes(self) -> IntArray:
        return np.sort(self._mesh_nodes)

    @cached_property
    def _mesh_nodes(self) -> IntArray:
        nodes = self._index.nodes
        return np.empty(0, dtype=np.int64) if nodes is None else node_ids(self.file, nodes)

    def outputs(self) -> list[dict[str, FrdBlock]]:
        """Blocks of each converged output, in file order.

        An output has consecutive blocks of the same step and increment, or of one mode. The last
        output of a run that did not end normally may not have converged. CalculiX writes stress
        only of converged increments, so a STRESS block shows convergence; else the ``.sta`` does.
        """
        index, options = self._index, self.options
        problem = index.problem()
        for remark in index.remarks:
            options.note(remark)
        if problem is not None:
            message = "; ".join(filter(None, (self.file.change, *index.remarks, problem)))
            if not index.blocks:
                raise ResultError(message, self.path)
            options.refuse(message, self.path)
        outputs: list[dict[str, FrdBlock]] = []
        last_key = (0, 0)
        for block in index.blocks:
            if not outputs or block.name in outputs[-1] or block.key != last_key:
                outputs.append({})
            outputs[-1][block.name], last_key = block, block.key
        if outputs and not index.ended:
            failed = {(row.step, row.increment): row.failed for row in read_attempts(self.path)}
            if failed.get(last_key, STRESS not in outputs[-1]):
                options.note(
                    f"left out: step {last_key[0]}, increment {last_key[1]} (not converged)"
                )
                outputs.pop()
        if not outputs:
            message = "no complete, converged increment"
            if not index.blocks:  # although the run ended normally
                message = "a mesh without results: the deck has no *NODE FILE or *EL FILE; printed "
                message += f"results, if requested, are in {self.path.stem}.dat"
            raise ResultError(message, self.path)
        return self._with_records(outputs)

    def _with_records(self, outputs: Outputs) -> list[dict[str, FrdBlock]]:
        nonempty = [
            {name: block for name, block in output.items() if block.records} for output in outputs
        ]
        empty: dict[str, FrdBlock] = {}
        for name, block in ((name, block) for output in outputs for name, block in output.items()):
            if not block.records:
                empty.setdefault(name, block)  # the first
        for name, block in empty.items():
            # In a file without records name all quantities, the requested one among them.
            message = str(block) if any(nonempty) else str(block).replace(name, ", ".join(empty), 1)
            message += _NO_RECORDS
            if not any(nonempty):
                raise ResultError(message, self.path)
            self.options.note(f"left out: {message}")
        return [output for output in nonempty if output]

    def select_outputs(self, outputs: Outputs, names: Sequence[str]) -> list[dict[str, FrdBlock]]:
        """Outputs that have all quantities `names`, reduced to these.

        Raises
        ------
        ResultError
            Without `partial`: an output has some of the quantities but not all, or lacks stress or
            displacement after an output of the same step that has it.
        """
        steps_with_names, steps_without_names = set[int](), set[int]()
        selected = []
        for output in outputs:
            step, increment = next(iter(output.values())).key
            absent = [name for name in names if name not in output]
            lost = step in steps_with_names and not COMPONENTS.keys().isdisjoint(names)
            if len(absent) < len(names):
                steps_with_names.add(step)
            if not absent:
                selected.append({name: output[name] for name in names})
            elif len(absent) < len(names) or lost:
                # CalculiX writes them at every output of a step after the first that has them.
                message = f"step {step}, increment {increment} has no {absent[0]}"
                self.options.refuse(message, self.path, partial_note=f"left out: {message}")
            else:
                steps_without_names.add(step)
        if steps_without_names:
            steps_text = ", ".join(map(str, sorted(steps_without_names)))
            self.options.note(
                f"left out: outputs without {' and '.join(names)} in step {steps_text}"
            )
        if not selected:
            raise ResultError(f"no increment has all of {', '.join(names)}", self.path)
        return selected

    def choose_name(self, available: Sequence[str], quantity: str | None) -> str:
        """Stress unless it is complex, else displacement, else the first quantity."""
        stress = self._index.named(STRESS)[:1]
        tensor = stress and set(COMPONENTS[STRESS]) <= set(stress[0].components)
        if quantity in STRESS_FUNCTIONS or (
            quantity is None
            and tensor
            and STRESS in available
            and imaginary_name(STRESS) not in available
        ):
            quantity = STRESS
        name = self.match_name(available, quantity)
        for real in available:
            if (part := imaginary_name(real)) in available and name in (real, part):
                message = f"{real} is the real part of amplitudes, {part} the imaginary"
                self.options.note(message)
        return name

    def match_name(self, available: Sequence[str], quantity: str | None) -> str:
        """Name of `quantity`, one of `available`; a quantity without records raises."""
        blocks = self._index.blocks
        empty = {b.name: b for b in reversed(blocks) if not b.records and b.name not in available}
        name = match_quantity(
            available if quantity is None else [*available, *empty], quantity, self.path
        )
        if name in empty:
            raise ResultError(f"{empty[name]}{_NO_RECORDS}", self.path)
        return name

    def node_values(self, blocks: Sequence[FrdBlock], nodes: Sequence[int]) -> FloatArray:
        """Values of one quantity, ``(T, node, component)``; stress inside one material."""
        values = values_at(self.file, blocks, nodes, self._check_nodes)
        if blocks[0].name == STRESS and not (inside := self._inside_material(nodes, values)).all():
            node, names = nodes[int(np.argmin(inside))], self._index.materials
            met = find_materials(self._index, [node])[:, 1].tolist()
            layers = " and ".join(names.get(material, f"material {material}") for material in met)
            raise ResultError(
                f"node {node} is between {layers}, where the mean stress belongs to neither: take "
                "a node inside one layer, or the mean with --across-materials "
                "(across_materials=True)",
                self.path,
            )
        with np.errstate(over="ignore"):
            values *= [self.options.scale(unit) for unit in blocks[0].units]
        return values

    def all_node_values(self, blocks: Sequence[FrdBlock]) -> tuple[IntArray, FloatArray]:
        """All nodes of `blocks` and their values, without stress between materials."""
        nodes, values = super().all_node_values(blocks)
        if blocks[0].name != STRESS or (inside := self._inside_material(nodes, values)).all():
            return nodes, values
        if not inside.any():
            raise ResultError("no node with stress is inside one material", self.path)
        self.options.note(
            f"left out: {(~inside).sum()} of {inside.size} nodes, between materials; "
            "--across-materials (across_materials=True) takes their mean stress"
        )
        return nodes[inside], values[:, inside]

    def _inside_material(self, nodes: Sequence[int] | IntArray, stress: FloatArray) -> BoolArray:
        """Whether each of `nodes` is inside one material, or accepted between materials.

        Changes `stress` in place: the sum over branches of relaxing skin, and no shear on the axis
        of a half section.
        """
        options, numbers = self.options, np.asarray(nodes, dtype=np.int64)
        branches = np.array([options.branches.get(node, 1) for node in numbers.tolist()])
        stress *= branches[:, None]
        if options.on_axis:
            clear_shear(stress, numbers.tolist(), options.on_axis)
        if options.across_materials:
            return np.ones(numbers.size, dtype=np.bool_)
        element_nodes, met = np.unique(
            find_materials(self._index, numbers)[:, 0], return_counts=True
        )
        inside: BoolArray = (
            np.append(met, 0)[rows_of(numbers, element_nodes)] <= branches
        )  # -1: no element
        return inside

    def read_field(self, block: FrdBlock, known_nodes: IntArray | None = None) -> Field:
        """Field of `block`; equal node numbers reuse the array `known_nodes`."""
        if known_nodes is None:
            np.empty(_KEPT_BYTES, dtype=np.uint8)
        nodes, values = block_table(self.file, block)
        scales = [self.options.scale(unit) for unit in block.units]
        with np.errstate(over="ignore"):  # an overflow is infinite
            if set(scales) != {1.0}:
                values *= scales if len(set(scales)) > 1 else scales[0]
        is_same = known_nodes is not None and np.array_equal(nodes, known_nodes)
        if not is_same:
            inside = self._check_nodes(block, nodes, values)
            if not inside.all():
                nodes, values = nodes[inside], values[inside]
        return make_field(
            block, known_nodes if is_same and known_nodes is not None else nodes, values, self.path
        )

    def _check_nodes(
        self, block: FrdBlock, nodes: IntArray, values: FloatArray | None = None
    ) -> BoolArray:
        """Whether each of the `nodes` of `block` is in the mesh; a contradiction is refused.

        Duplicate nodes must have equal `values` (None reads them). Within a step all blocks of a
        quantity except contact have the same nodes; a change is noted.
        """
        mesh = self._mesh_nodes
        inside: BoolArray = np.ones(nodes.size, dtype=np.bool_)
        before = self._previous_nodes.get(block.name) or self._neighbour(block)
        self._previous_nodes[block.name] = block, nodes
        if self._index.nodes is not None and not np.array_equal(nodes, mesh):
            inside = is_in_sorted(nodes, self._sorted_mesh_nodes)
            if not inside.all():
                message = f"{block} has node {nodes[~inside][0]}, which is not in the mesh"
                count = int((~inside).sum())
                message += f", and {count - 1} more" * (count > 1)
                if self._must_be_in_mesh(block, nodes[~inside], before):
                    self.options.refuse(message, self.path, partial_note=f"left out: {message}")
                else:  # CalculiX: nodes of elements that *MODEL CHANGE removed, of a coil's domain
                    self.options.note(message)
                    inside[:] = True
            if (node := self._contradictory_node(block, nodes, values)) is not None:
                self.options.refuse(f"{block} has two values at node {node}", self.path)
        if before is None or _CONTACT.match(block.name):
            return inside
        previous, last_nodes = before
        if previous.key[0] == block.key[0] and last_nodes.size == nodes.size:
            changed = np.flatnonzero(last_nodes != nodes)
            if changed.size:
                row = changed[0]
                message = f"{block} has node {nodes[row]}, {previous} has {last_nodes[row]}"
                suffix = f", and {changed.size - 1} other changes" * (changed.size > 1)
                self._changes += 1
                if self._changes <= _MAX_CHANGES:
                    self.options.note(f"{message}{suffix}: the nodes change within a step")
        return inside

    def _must_be_in_mesh(
        self, block: FrdBlock, absent: IntArray, before: tuple[FrdBlock, IntArray] | None
    ) -> bool:
        """Whether nodes `absent` from the mesh contradict the mesh or the block `before`.

        A block with as many records as the mesh has exactly its nodes. An output of a part of the
        mesh has the same nodes in each block of a step.
        """
        mesh = self._index.nodes
        if mesh is not None and block.records == mesh.records:
            return True
        if before is None or before[0].key[0] != block.key[0] or len(before[1]) != block.records:
            return False
        return not np.isin(absent, before[1]).all()

    def _neighbour(self, block: FrdBlock) -> tuple[FrdBlock, IntArray] | None:
        """Another block of the same quantity, step and count, and its nodes; not of all nodes."""
        mesh = self._index.nodes
        if mesh is None or block.records == mesh.records or _CONTACT.match(block.name):
            return None
        alike = block.name, block.key[0], block.records
        for other in self._index.named(block.name):
            if other is not block and (other.name, other.key[0], other.records) == alike:
                return other, node_ids(self.file, other)
        return None

    def _contradictory_node(
        self, block: FrdBlock, nodes: IntArray, values: FloatArray | None
    ) -> int | None:
        """A duplicate node of `block` with different values; None if there is none."""
        order = np.argsort(nodes, kind="stable")
        again = np.flatnonzero(np.diff(nodes[order]) == 0)
        if not again.size:
            return None
        table = block_table(self.file, block)[1] if values is None else values
        first, second = table[order[again]], table[order[again + 1]]
        other = ((first != second) & ~(np.isnan(first) & np.isnan(second))).any(axis=1)
        return int(nodes[order[again[np.argmax(other)]]]) if other.any() else None

    def last_digit_ms(self, times_ms: FloatArray) -> FloatArray:
        """Last digit of times: a ``.frd`` has six digits below one second, ten above."""
        return printed_digit_ms(times_ms, np.where(times_ms < MS_PER_S, 6, 10))

    def node_positions(self) -> tuple[IntArray, FloatArray, BoolArray]:
        """Nodes ``(n,)``, coordinates ``(n, 3)`` in mm, whether each has results ``(n,)``.

        Results are stress, if the file has stress, else any quantity.
        """
        index = self._index
        blocks = [block for block in index.named(STRESS) or index.blocks if block.records]
        if not blocks:
            names = ", ".join(index.names) or "nothing"
            raise ResultError(f"no results at nodes; the file has {names}", self.path)
        nodes_with_results = np.unique(node_ids(self.file, blocks[0]))
        nodes, at_mm = self._coordinates()
        return nodes, at_mm, np.isin(nodes, nodes_with_results)

    def sides(self, node: int, set_name: str = "") -> tuple[OneSidedStress, ...]:
        """Stress at `node` in each material, lowest number first.

        A ``.frd`` has one stress at a node, the mean over all its elements. The ``.dat`` of the
        same name has the stress at the integration points of the element set `set_name`
        (``*EL PRINT, ELSET=...`` with S). It is extrapolated to the node, element by element, and
        averaged over the elements of each material.

        The points of an element are those of the brick that CalculiX makes of it: x fastest, then
        y, then z. In a plane element the layers through the thickness are equal except for
        rounding, and their mean is used. Values are in the element's local system if it has one
        (``*ORIENTATION``), else global.
        """
        from fembridge.results.extrapolation import brick_weights
        from fembridge.results.printed import read_point_stress

        if not set_name:
            raise UsageError(
                "needs the name of an element set that is printed in the .dat of the same name",
                self.path,
                argument="one_sided",
            )
        mesh, dat_path = self.mesh(), self.path.with_suffix(".dat")
        around = [
            (int(cells.ids[row]), int(cells.material[row]), cells.kind, corner)
            for cells in mesh.cells
            for row, corner in np.argwhere(mesh.nodes[cells.rows] == node).tolist()
        ]
        if not around:
            raise ResultError(f"node {node} is at no element of the mesh", self.path)
        times_ms, points, tensor_pa = read_point_stress(dat_path, set_name, self.options)
        sides: dict[int, list[tuple[int, FloatArray]]] = {}
        for element, material, kind, corner in around:
            rows = np.flatnonzero(points[:, 0] == element)
            if not rows.size:
                raise ResultError(
                    f"set {set_name} has no stress of element {element}, which is at node {node}",
                    dat_path,
                )
            order = points[rows, 1]
            try:
                if not np.array_equal(np.sort(order), np.arange(1, order.size + 1)):
                    raise ValueError(f"points {', '.join(map(str, order))}, expected all from 1")
                weights = brick_weights(kind, order.size, corner)[order - 1]
            except ValueError as error:
                raise ResultError(f"element {element}: {error}", dat_path) from error
            node_stress_pa = np.einsum("p,tpc->tc", weights, tensor_pa[:, rows])
            sides.setdefault(material, []).append((element, node_stress_pa))
        return tuple(
            OneSidedStress(
                node=node,
                material=material,
                name=mesh.materials.get(material, f"material {material}"),
                elements=tuple(element for element, _ in sides[material]),
                times_ms=times_ms,
                tensor_pa=np.mean([tensor for _, tensor in sides[material]], axis=0),
            )
            for material in sorted(sides)
        )

    def scene(self, outputs: Outputs) -> tuple[Outputs, Scene]:
        """Outputs with values at most nodes, and the mesh, or only its nodes with values."""
        outputs = _select_fullest(outputs, self.options)
        scene = self._cut_to_values(outputs, self.mesh())
        between = int((scene.material_count > 1).sum())
        if between:
            self.options.note(
                f"{between} nodes are between materials ('materials' is 2 or more there), where "
                "nodal stress and strain are means that belong to none"
            )
        return outputs, scene

    def mesh(self) -> Scene:
        """Mesh with nodes in file order and elements by kind; plane elements have z 0."""
        index, file = self._index, self.file
        if index.nodes is None or index.elements is None:
            kind = "node" if index.nodes is None else "element"
            problems = "; ".join(harm.problem for harm in index.damage)
            raise ResultError(f"no complete {kind} block{problems and ': '}{problems}", file.path)
        if not index.nodes.records:
            raise ResultError("node block: no nodes", file.path)
        nodes, points_mm = self._coordinates()
        if np.unique(nodes).size != nodes.size:
            raise ResultError("node block: a node is duplicate", file.path)
        parts: dict[int, list[tuple[IntArray, IntArray, IntArray]]] = {}
        for elements in element_rows(file, index.elements):
            expected = NODES_OF_TYPE.get(elements.type)
            if expected != elements.corners.shape[1]:
                raise ResultError(
                    f"element {elements.ids[0]} of type {elements.type} has "
                    f"{elements.corners.shape[1]} nodes, expected {expected or 'another type'}",
                    file.path,
                )
            rows = rows_of(elements.corners, nodes)
            if (rows < 0).any():
                absent = elements.corners[rows < 0][0]
                raise ResultError(
                    f"an element has node {absent}, which is not in the mesh", file.path
                )
            parts.setdefault(elements.type, []).append((elements.ids, elements.material, rows))
        cells = tuple(
            SceneCells(KIND_OF_TYPE[kind], *map(np.concatenate, zip(*parts[kind], strict=True)))
            for kind in sorted(parts)
        )
        # 1 material inside a layer, 2 on its boundary, 0 at a node without elements.
        met = np.zeros(nodes.size, dtype=np.int64)
        for number in {number for group in cells for number in np.unique(group.material)}:
            touched = [group.rows[group.material == number].ravel() for group in cells]
            met[np.unique(np.concatenate(touched))] += 1
        return Scene(points_mm, nodes, cells, met, dict(index.materials))

    def _coordinates(self) -> tuple[IntArray, FloatArray]:
        """Node numbers and coordinates in mm, in file order."""
        block, path = self._index.nodes, self.path
        if block is None or not block.records:
            raise ResultError("no node block, so no coordinates", path)
        nodes, points_mm = block_table(self.file, block)
        if not np.isfinite(points_mm).all():
            raise not_finite_error(block, nodes, points_mm, path)
        return nodes, points_mm * self.options.length_mm

    def _cut_to_values(self, outputs: Outputs, scene: Scene) -> Scene:
        """`scene`, or only its nodes with values if no element has values at all its nodes.

        Nodes that are left out or have no value are noted once for the file.
        """
        blocks: dict[tuple[str, int], FrdBlock] = {}
        for output in outputs:
            for name, block in output.items():
                blocks.setdefault((name, block.records), block)
        ids_by_block = {key: node_ids(self.file, block) for key, block in blocks.items()}
        masks = [np.isin(scene.nodes, ids) for ids in ids_by_block.values()]
        has_any = np.logical_or.reduce([np.zeros(scene.nodes.size, dtype=np.bool_), *masks])
        note, size = self.options.note, scene.nodes.size
        for (name, _), ids in ids_by_block.items():
            strange = ids[~np.isin(ids, scene.nodes)]
            if strange.size:
                note(
                    f"left out: {strange.size} nodes of {name} that are not in the mesh, such as "
                    f"{strange[0]}"
                )
        if has_any.any() and not any(
            has_any[cells.rows].all(axis=1).any() for cells in scene.cells
        ):
            note(f"values at {has_any.sum()} of {size} nodes, at no complete element: nodes only")
            ids = np.arange(has_any.sum())
            cells = SceneCells(VERTEX, ids, np.full(ids.size, UNKNOWN_MATERIAL), ids[:, None])
            at_mm, nodes, met = (
                scene.points_mm[has_any],
                scene.nodes[has_any],
                scene.material_count[has_any],
            )
            return Scene(at_mm, nodes, (cells,), met, {})
        for (name, _), mask in zip(ids_by_block, masks, strict=True):
            if not mask.all():
                note(f"{name} has values at {mask.sum()} of {size} nodes; the others are NaN")
        return scene


def _select_fullest(outputs: Outputs, options: ReadOptions) -> Outputs:
    """Outputs with the highest number of nodes for any quantity.

    These are the full fields of a file that has them at some outputs, else the afferents' nodes.
    """
    most_records: dict[str, int] = {}
    for output in outputs:
        for name, block in output.items():
            most_records[name] = max(block.records, most_records.get(name, 0))
    fullest = [
        output
        for output in outputs
        if any(block.records == most_records[name] for name, block in output.items())
    ]
    if len(fullest) < len(outputs):
        dropped = len(outputs) - len(fullest)
        options.note(
            f"left out: {dropped} of {len(outputs)} increments, at fewer nodes than the others"
        )
    return fullest
