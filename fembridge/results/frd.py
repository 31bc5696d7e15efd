"""Results of CalculiX, ``.frd``: text or binary, read by seeking from header to header.

    1PSTEP                         2           1           1
  100CL  101 5.00000E-04          47                     0    1           1
 -4  STRESS      6    1
 -5  SXX         1    4    1    1
 -1         1 1.08234E-03 1.03144E-03 9.28155E-04-1.29059E-03 0.00000E+00 0.00000E+00
 -3

Flags, the last number of a ``100CL`` line: 0 text with ids of 5 characters, 1 text with
10, 2 float32, 3 float64. A block says how many records it has and how long they are, so
the walk reads headers and jumps over the rest; of wanted nodes only their records are
read. Markers are never sought inside binary records, which may hold any byte. A block is
whole when what has to follow it does follow, a text block when its line `` -3`` does;
counts are compared with the size of the file before anything trusts them. The walk ends
at the first block that is not whole. Values touch when they are negative: a field is cut
by its columns, never split at blanks.

Stress at a node is the mean over the elements there. On a layer boundary that mean
belongs to neither layer (0.011 MPa measured between 0.0005 and 0.022), so such a node is
refused unless ``across_materials`` asks for it. Quantities are joined by step and
increment, never by position: a run that diverged has one more DISP than STRESS, and that
last one never converged.

CalculiX has no units. Lengths are taken as mm, times as s, and stress in
`ReadOptions.stress_unit`; what comes out is mm, ms and Pa.
"""

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.byte_file import (
    CHUNK_BYTES,
    ByteFile,
    Characters,
    fixed_floats,
    fixed_integers,
)
from fembridge.results.fields import Key, rows_of
from fembridge.results.printed import StaRow, read_sta
from fembridge.results.read_options import NotFiniteError, ReadOptions, in_pa
from fembridge.results.stress import von_mises_pa
from fembridge.trace import MS_PER_S, StressTrace
from fembridge.typing import BoolArray, FloatArray, IntArray, Table

STRESS, DISPLACEMENT = "STRESS", "DISP"
COMPONENTS = {
    STRESS: ("SXX", "SYY", "SZZ", "SXY", "SYZ", "SZX"),
    DISPLACEMENT: ("D1", "D2", "D3"),
}
# Nodes of each element type: he8 pe6 te4 he20 pe15 te10 tr3 tr6 qu4 qu8 be2 be3.
NODES_OF_TYPE = {
    1: 8, 2: 6, 3: 4, 4: 20, 5: 15, 6: 10, 7: 3, 8: 6, 9: 4, 10: 8, 11: 2, 12: 3,
}  # fmt: skip
UNKNOWN_MATERIAL = -1  # an old file has a word in place of the number

_FIRST_BYTES, _STEP, _END_LINE = b"    1C", b"    1PSTEP", b" 9999"
_AFTER_A_BLOCK = (b"    1P", _END_LINE, b"  100C", b"    2C", b"    3C")
_STEP_OF_ITERATIONS = re.compile(rb"STP *(\d+)INC *(\d+)")
_TIME = re.compile(rb"-?\d+\.\d*(?:[Ee][+-]\d{2,3})?")
_STATIC, _DYNAMIC, _FREQUENCY, _BUCKLING = 0, 1, 2, 4
_MOST_COMPONENTS = 10_000  # announced by a header; what is beyond is no header
_VALUES_A_LINE, _FIELD, _MARK = 6, 12, 3  # of a record; E12.5; " -1"
_REALS = {2: "<f4", 3: "<f8"}  # by flag
_NO_LINE_END = bytes.maketrans(b"\r\0", b"  ")
_SEEK_BYTES = 1 << 16  # records within so few bytes are read in one go
_FEW_NODES = 64  # whose elements are sought before they are converted
_MESH_BYTES = 1 << 17  # of printed elements at a time
_DEFAULTS = ReadOptions()

Output = dict[str, "FrdBlock"]  # blocks of one increment, by quantity


@dataclass(slots=True)
class FrdBlock:
    """One quantity at one increment, and where in the file its records are.

    `value` is the number that the ``100CL`` line holds: the total time over all steps in
    s, or the frequency of a mode, or its buckling factor. `components` are those stored
    (``ALL``, the length of a vector, is announced and not stored). `free` marks text
    records of unequal length (exponents of three digits). `modal` marks a mode of a
    frequency or buckling analysis: its `increment` is the number of the mode.

    `key` joins the blocks of one output. Records have `record_bytes` each and, unless
    they are `free`, reach to `end`; `spans` are the bytes of the values in each line of
    a text record. `over_time` says whether `value` is a time, as in static and dynamic
    steps alone, and `time_ms` that time over all steps.
    """

    name: str
    step: int
    increment: int
    value: float
    records: int
    components: tuple[str, ...]
    flag: int
    offset: int
    line_end: int = 1
    analysis: int = _STATIC
    modal: bool = False
    free: bool = False
    key: Key = field(init=False)
    time_ms: float = field(init=False)
    over_time: bool = field(init=False)
    record_bytes: int = field(init=False)
    end: int = field(init=False)
    spans: list[tuple[int, int]] = field(init=False)

    def __post_init__(self) -> None:
        self.key, self.time_ms = (self.step, self.increment), self.value * MS_PER_S
        self.over_time = not self.modal and self.analysis in (_STATIC, _DYNAMIC)
        self.record_bytes, self.spans = 0, []
        count = len(self.components)
        if self.flag >= 2:
            self.record_bytes = 4 + (4 if self.flag == 2 else 8) * count
        else:
            for first in range(0, count, _VALUES_A_LINE):
                start = self.record_bytes + _MARK + (10 if self.flag else 5)
                stop = start + _FIELD * min(_VALUES_A_LINE, count - first)
                self.spans.append((start, stop))
                self.record_bytes = stop + self.line_end
        self.end = self.offset + self.records * self.record_bytes

    @property
    def axis(self) -> str:
        """What `value` is."""
        if self.analysis == _BUCKLING:
            return "buckling factor"
        if self.modal:
            return "frequency in cycles per time"
        return "total time" if self.over_time else "number of the analysis"

    def __str__(self) -> str:
        if not self.step:  # the node block
            return self.name
        what = "mode" if self.modal else "increment"
        return f"{self.name} of step {self.step}, {what} {self.increment}"


class MeshBlock(NamedTuple):
    """Where the records of a node or element block are, and where it ends."""

    records: int
    flag: int
    offset: int
    end: int


class FrdDamageError(Exception):
    """What is wrong at `offset`; of `block`, where known, `records` are whole."""

    def __init__(
        self, problem: str, offset: int, block: FrdBlock | None = None, records: int = 0
    ) -> None:
        super().__init__(problem)
        self.problem, self.offset, self.block, self.records = problem, offset, block, records
        self.key: Key | None = None if block is None else block.key


class FrdIndex:
    """What a ``.frd`` holds and where: one walk through `file`.

    `blocks` are the whole ones in file order, `nodes` and `elements` the mesh,
    `materials` names by number. `ended` says whether the line `` 9999`` closes the file:
    CalculiX writes it only when the job ends normally. `damage` is noted, not raised:
    who reads decides what to do about it. `remarks` are oddities that do no harm.
    """

    def __init__(self, file: ByteFile) -> None:
        start = file.peek(0, len(_FIRST_BYTES))
        if start != _FIRST_BYTES:
            problem = f"no .frd: begins with {start!r}, expected {_FIRST_BYTES!r}"
            raise ResultError(problem if start else "empty: 0 bytes", file.path)
        self.file, self.size = file, file.size
        self.blocks: list[FrdBlock] = []
        self.nodes: MeshBlock | None = None
        self.elements: MeshBlock | None = None
        self.materials: dict[int, str] = {}
        self.ended = False
        self.damage: list[FrdDamageError] = []
        self.remarks: list[str] = []
        self._key: Key | None = None  # of the block that has to follow
        self._count: int | None = None  # of the block before: CalculiX counts them all
        self._mode: int | None = None
        # Text, name, components and line end of -4 and -5 lines, by the -4 line: every
        # increment repeats them.
        self._names: dict[bytes, tuple[bytes, str, tuple[str, ...], int]] = {}
        at = 0
        try:
            while not self.ended and at < file.size:
                at = self._next(at)
        except (FrdDamageError, ValueError) as error:
            harm = error if isinstance(error, FrdDamageError) else FrdDamageError(str(error), at)
            if harm.block is None and self._key is not None:
                harm.key = self._key
                harm.problem = "header of step {}, increment {}: ".format(*self._key) + harm.problem
            self.damage.append(harm)
        for one in self.damage:
            if one.block is None:
                one.problem += f" (byte {one.offset} of {file.size})"

    def named(self, name: str) -> list[FrdBlock]:
        """Blocks of one quantity, in file order."""
        return [block for block in self.blocks if block.name == name]

    @property
    def names(self) -> tuple[str, ...]:
        """Quantities held, in order of first appearance."""
        return tuple(dict.fromkeys(block.name for block in self.blocks))

    def problem(self) -> str | None:
        """What is wrong with a file that is not whole; None if it is whole."""
        if self.ended and not self.damage:
            return None
        if not self.blocks and not self.damage:
            what = f"header only ({self.size} bytes): the solver stopped before its first output"
            if self.nodes is not None:
                what = "mesh only, no results: the solver stopped at its start"
            return f"{what}; look in the .sta file and the solver's log for its reason"
        words = [harm.problem for harm in self.damage]
        held: dict[Key, dict[str, FrdBlock]] = {}
        for block in self.blocks:
            held.setdefault(block.key, {}).setdefault(block.name, block)
        damaged = {harm.key for harm in self.damage}
        whole = [key for key in held if key not in damaged]
        if not self.ended:
            words.append("no end line 9999: the run did not end normally")
            # The increment at which a run diverged has DISP and no STRESS; one that was
            # cut lacks what was not written yet.
            (before, last), lost = whole[-2:] if len(whole) > 1 else ((0, 0), (0, 0)), set[str]()
            if before[0] == last[0] != 0:
                lost = held[before].keys() - held[last].keys()
            if lost:
                whole.pop()
            attempts = _attempts(self.file.path)
            if attempts and (row := attempts[-1]).failed:
                words.append(
                    f"increment {row.increment} of step {row.step} did not converge "
                    f"(.sta: attempt {row.attempt} failed)"
                )
            elif lost and not self.damage:
                words.append(
                    f"increment {last[1]} of step {last[0]} has {', '.join(held[last])} "
                    f"and no {', '.join(sorted(lost))}: it did not converge"
                )
        if whole:
            (step, increment), block = whole[-1], next(iter(held[whole[-1]].values()))
            words.append(f"last whole increment: {increment} of step {step}, {block.time_ms:g} ms")
        elif self.blocks:
            words.append("no whole increment")
        return "; ".join(words)

    def _line(self, at: int, of: str = "") -> tuple[bytes, int]:
        """The line at `at` without its end, and where the next begins."""
        found = self.file.line(at)
        if found is None:
            raise FrdDamageError(f"{of}{self.file.why_no_line(at)}", at)
        return found

    def _next(self, at: int) -> int:
        """Read what begins at `at`; where the next begins."""
        file = self.file
        start = file.peek(at, 80)
        if start.startswith(_END_LINE):
            self.ended = True
            if rest := start[len(_END_LINE) :].strip():
                raise FrdDamageError(f"bytes after the end line: {rest[:12]!r}", at)
            return file.size
        line, after = self._line(at)
        if not line:  # some builds leave one behind the materials
            return after
        if line.startswith(b"  100C"):
            return self._block(line, at, after)
        if line.startswith((b"    2C", b"    3C")):
            return self._mesh(line, at, after)
        if not line.startswith(b"    1"):
            raise FrdDamageError(f"{line[:24]!r} where a block should begin", at)
        if line.startswith(_STEP):
            self._key = self._mode = None
            if iterations := _STEP_OF_ITERATIONS.match(line, 24):
                step, increment = int(iterations[1]), int(iterations[2])
            else:
                step, increment = _counts(line, (48, 60), (36, 48))
                self._follow(line[10:36].strip(), step, increment)
            self._key = step, increment
            if line[24:27] == b"STP" and not self.remarks:
                self.remarks.append(
                    f"iterations of increment {increment} of step {step}, "
                    "no history (LAST ITERATIONS)"
                )
        elif line.startswith(b"    1PMODE"):
            [self._mode] = _counts(line, (24, 36))
        elif line.startswith(b"    1UMAT") and line[9:14].strip().isdigit():
            self.materials.setdefault(int(line[9:14]), line[14:].decode("latin-1").strip())
        return after

    def _follow(self, number: bytes, step: int, increment: int) -> None:
        """Remark, once, that a block does not have the `number` after the last one's."""
        before, self._count = self._count, int(number) if number.isdigit() else None
        if None in (before, self._count) or self._count == before + 1:  # type: ignore[operator]
            return
        words = "blocks are missing, duplicate or not in order: number "
        if not any(remark.startswith(words) for remark in self.remarks):
            words += f"{self._count}, of step {step}, increment {increment}, comes after {before}"
            self.remarks.append(words)

    def _mesh(self, line: bytes, at: int, after: int) -> int:
        """Note a node or element block and find its end."""
        file, kind = self.file, "node" if line.startswith(b"    2C") else "element"
        text = line[73:75].strip() in (b"0", b"1")
        blank = text and not line[24:36].strip()
        announced, flag = (-1, int(line[73:75])) if blank else _counts(line, (24, 36), (73, 75))
        problem, present = "", announced
        if text:
            closed = file.find((b"\n -3",), after - 1)
            last = None if closed is None else file.line(closed[0] + 1)
            if closed is None or last is None:
                raise FrdDamageError(f"{kind} block: cut: its end line -3 is missing", at)
            present, end = file.count(b"\n -1", after - 1, closed[0]), last[1]
            layers = present // announced if kind == "element" and announced > 0 else 0
            if announced not in (-1, present) and present != layers * announced:
                problem = f"{announced} records announced, {present} present"
        elif flag > 3 or after + 16 * announced > file.size:
            raise FrdDamageError(f"{kind} block: cut: {announced} {kind}s announced", at)
        else:
            end = after + announced * (28 if flag == 3 else 16)
            if kind == "element":
                try:
                    end = packed_end(file, after, announced)
                    while announced and not self._boundary(end):  # one more layer of composites
                        end, present = packed_end(file, end, announced), present + announced
                except ResultError as error:
                    if present > announced:
                        words = f"{kind} block: its count does not lead to its end"
                        raise FrdDamageError(words, at) from error
                    raise FrdDamageError(error.problem, at) from error
            if not self._boundary(end):
                raise FrdDamageError(f"{kind} block: its count does not lead to its end", at)
        if kind == "element" and not problem and present > announced > 0:
            self.remarks.append(
                f"element block announces {announced} elements and holds "
                f"{present // announced} times as many: layers of composite shells"
            )
        if problem:  # the mesh cannot be used, what follows can
            self.damage.append(FrdDamageError(f"{kind} block: {problem}", at))
        elif kind == "node":
            self.nodes = MeshBlock(present, flag, after, end)
        else:
            self.elements = MeshBlock(present, flag, after, end)
        return end

    def _block(self, line: bytes, at: int, after: int) -> int:
        """Note the result block of a ``100CL`` line and find its end."""
        if self._key is None:
            raise FrdDamageError("100CL without a 1PSTEP line that gives step and increment", at)
        step, increment = self._key
        text, word = line[12:24].strip(), line[56:58].strip()
        if not _TIME.fullmatch(text):
            raise ValueError(f"time {line[12:24]!r}")
        [flag] = _counts(line, (73, 75))
        [analysis] = _counts(line, (56, 58)) if word else [_STATIC]
        modal = analysis in (_FREQUENCY, _BUCKLING) or line[63:73].strip() == b"MODAL"
        if modal:
            increment = _counts(line, (58, 63))[0] if self._mode is None else self._mode
        if flag > 3:
            raise ValueError(f"format flag {flag}")
        blank = flag < 2 and not line[24:36].strip()
        [records] = [-1] if blank else _counts(line, (24, 36))
        header, name, components, line_end = self._name_lines(after)
        block = FrdBlock(
            name, step, increment, float(text), records, components, flag,
            after + len(header), line_end, analysis, modal,
        )  # fmt: skip
        self._key, end = None, block.end
        if flag < 2:
            block, end = self._text_end(block)
        elif end > self.size:
            raise self._cut(block, records)
        elif not self._boundary(end):
            raise FrdDamageError(
                f"{block} is followed by {self.file.peek(end, 12)!r} at byte {end}: its "
                f"count, {records}, is wrong or bytes are missing",
                end,
                block,
            )
        self.blocks.append(block)
        return end

    def _name_lines(self, offset: int) -> tuple[bytes, str, tuple[str, ...], int]:
        """The ``-4`` and ``-5`` lines at `offset`: text, name, components, line end."""
        first, at = self._line(offset)
        known = self._names.get(first)
        if known is not None and self.file.peek(offset, len(known[0])) == known[0]:
            return known
        name, [announced] = first[5:13].decode("ascii").strip(), _counts(first, (13, 18))
        if not first.startswith(b" -4") or not name:
            raise ValueError(f"{first[:40]!r} where a name is expected")
        if announced > _MOST_COMPONENTS:
            raise ValueError(f"{name} announces {announced} components")
        components: list[str] = []
        for _ in range(announced):
            start, (line, at) = at, self._line(at, f"{name} lines are ")
            if not line.startswith(b" -5"):
                raise ValueError(f"{name} announces {announced} components, then {line[:40]!r}")
            if line[33:38].strip() != b"1":
                components.append(line[5:13].decode("ascii").strip())
        if not components:
            raise ValueError(f"{name} without components")
        text = self.file.take(offset, at - offset)
        self._names[first] = text, name, tuple(components), at - start - len(line)
        return self._names[first]

    def _text_end(self, block: FrdBlock) -> tuple[FrdBlock, int]:
        """The block with its count and its kind of records, and where it ends."""
        closing = b"\n -3\r\n" if block.line_end == 2 else b"\n -3\n"
        if block.records >= 0 and self.file.peek(block.end - 1, len(closing)) == closing:
            return block, block.end - 1 + len(closing)
        found = self.file.find((b"\n -3",), block.offset - 1)
        last = None if found is None else self.file.line(found[0] + 1)
        at = self.size if found is None else found[0]
        begun = self.file.count(b"\n -1", block.offset - 1, at)
        if last is None:
            raise self._cut(block, begun)
        if block.records < 0:
            block = replace(block, records=begun)
        if block.end == at + 1:
            return block, last[1]
        if begun == block.records > 0:
            return replace(block, free=True), last[1]
        if begun == 0 and at + 1 == block.offset:  # of a fluid: closed, and empty
            self.remarks.append(f"{block} announces {block.records} records and has none")
            return replace(block, records=0), last[1]
        words = f"{block} announces {block.records} records and has {begun}"
        raise FrdDamageError(words, at, block, begun)

    def _cut(self, block: FrdBlock, begun: int) -> FrdDamageError:
        """The damage of a block that the file ends in, after `begun` records at most."""
        whole = min((self.size - block.offset) // block.record_bytes, begun)
        of = "" if block.records < 0 else f"{block.records} "
        words = f"{block} is cut at byte {self.size}, after {whole} of {of}records"
        return FrdDamageError(words, self.size, block, whole)

    def _boundary(self, at: int) -> bool:
        """Whether what follows a block begins at `at`, or the file ends there."""
        found = self.file.peek(at, 6)
        return any(found.startswith(one) or one.startswith(found) for one in _AFTER_A_BLOCK)


def read(path: Path, nodes: Sequence[int], options: ReadOptions = _DEFAULTS) -> list[StressTrace]:
    """Von Mises stress at `nodes`, in that order.

    A trace begins with the first increment of the file; what came before it,
    the rest state among it, a ``.frd`` does not hold.
    """
    times_ms, values = read_history(path, {STRESS: nodes}, options)
    kept = options.kept(times_ms)
    times_ms = unrounded(times_ms[kept])
    with np.errstate(over="ignore"):  # a trace refuses what is not finite
        stress_pa = von_mises_pa(values[STRESS][kept])
    return [
        StressTrace.on_grid(node, np.stack([times_ms, column], -1), path)
        for node, column in zip(nodes, stress_pa.T, strict=True)
    ]


def read_stress_tensor(
    path: Path, nodes: Sequence[int], options: ReadOptions = _DEFAULTS
) -> tuple[FloatArray, FloatArray]:
    """Cauchy stress at `nodes`: ``(T,)`` in ms and ``(T, node, 6)`` in Pa.

    The order of components is xx yy zz xy yz zx.

    Raises
    ------
    ResultError
        The file is absent, empty, foreign or cut; the run did not end normally;
        no STRESS in it; a node has none, or is between two materials; a value
        is no finite number.
    """
    times_ms, values = read_history(path, {STRESS: nodes}, options)
    return times_ms, values[STRESS]


def read_displacement(
    path: Path, nodes: Sequence[int], options: ReadOptions = _DEFAULTS
) -> tuple[FloatArray, FloatArray]:
    """Displacement of `nodes`: ``(T,)`` in ms and ``(T, node, 3)`` in mm."""
    times_ms, values = read_history(path, {DISPLACEMENT: nodes}, options)
    return times_ms, values[DISPLACEMENT]


class StressAndDisplacement(NamedTuple):
    """Both at the same increments, each in the order in which its nodes were asked for.

    `times_ms` is ``(T,)``, `tensor_pa` ``(T, node, 6)``, `displacement_mm`
    ``(T, node, 3)``.
    """

    times_ms: FloatArray
    tensor_pa: FloatArray
    displacement_mm: FloatArray


def read_stress_and_displacement(
    path: Path,
    stress_nodes: Sequence[int],
    displacement_nodes: Sequence[int],
    options: ReadOptions = _DEFAULTS,
) -> StressAndDisplacement:
    """Both, joined by step and increment."""
    wanted = {STRESS: stress_nodes, DISPLACEMENT: displacement_nodes}
    times_ms, values = read_history(path, wanted, options)
    return StressAndDisplacement(times_ms, values[STRESS], values[DISPLACEMENT])


def read_history(
    path: Path, nodes_of: Mapping[str, Sequence[int]], options: ReadOptions = _DEFAULTS
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """STRESS or DISP or both, at the increments that have all of them.

    Returns
    -------
    times_ms, values
        ``(T,)``; by quantity ``(T, node, component)``, in Pa and in mm, in the order of
        its nodes.

    Raises
    ------
    ResultError
        As for `read_stress_tensor`; also an increment that has only one of two
        (`options.partial` leaves it out).
    """
    with ByteFile(path) as file:
        index = FrdIndex(file)
        outputs = _over_time(index, outputs_of(index, options), tuple(nodes_of), options)
        outputs, values = values_at(index, outputs, nodes_of, options)
        firsts = [next(iter(output.values())) for output in outputs]
        times_ms = np.array([block.time_ms for block in firsts])
        back = np.flatnonzero(~(np.diff(times_ms) > 0))
        if back.size:
            row = int(back[0]) + 1
            raise ResultError(
                f"step {firsts[row].step}, increment {firsts[row].increment} at "
                f"{times_ms[row]:g} ms comes after {times_ms[row - 1]:g} ms: times do not rise",
                path,
            )
        return times_ms, values


def values_at(
    index: FrdIndex,
    outputs: Sequence[Output],
    nodes_of: Mapping[str, Sequence[int]],
    options: ReadOptions,
    components: Sequence[str] = (),
) -> tuple[list[Output], dict[str, FloatArray]]:
    """Those `outputs` that are finite at the nodes of each quantity, and their values there.

    STRESS in Pa, DISP in mm, others as the file has them; of `components`, without any those of
    `COMPONENTS`.
    """
    file = index.file
    values = {
        name: _at_nodes(file, [output[name] for output in outputs], nodes, components)
        for name, nodes in nodes_of.items()
    }
    if not all(np.isfinite(found).all() for found in values.values()):
        keep = _finite(file.path, outputs, values, nodes_of, options, components)
        outputs = [output for output, fine in zip(outputs, keep, strict=True) if fine]
        values = {name: found[keep] for name, found in values.items()}
    if not outputs:
        raise ResultError("no whole, converged increment is left", file.path)
    check_unchanged(file, options)
    if STRESS in nodes_of:
        nodes = [int(node) for node in nodes_of[STRESS]]
        if not options.across_materials:
            _check_materials(index, nodes, options.branches)
        # In relaxing skin the sum over branches, not their mean; on the axis of a
        # half no shear: see `ReadOptions`.
        branches = np.array([options.branches.get(node, 1) for node in nodes], dtype=np.float64)
        summed = values[STRESS] * branches[:, None]
        if options.on_axis:
            summed[:, [node in options.on_axis for node in nodes], 3] = 0.0
        values[STRESS] = in_pa(summed, options, file.path)
    if DISPLACEMENT in nodes_of:
        values[DISPLACEMENT] *= options.length_mm
    return list(outputs), values


def describe(path: Path) -> Table:
    """What the file holds: mesh, quantities, increments, what is wrong."""
    with ByteFile(path) as file:
        index = FrdIndex(file)
        words = (file.change, index.problem())
        return {
            "format": "ccx-frd",
            "bytes": index.size,
            "mesh_nodes": None if index.nodes is None else index.nodes.records,
            "elements": None if index.elements is None else index.elements.records,
            "materials": dict(sorted(index.materials.items())),
            "quantities": [_quantity(index, name) for name in index.names],
            "remarks": list(index.remarks),
            "problem": "; ".join(word for word in words if word) or None,
        }


def unrounded(times_ms: FloatArray) -> FloatArray:
    """An even time axis, ``(T,)``, without the rounding of the print.

    Below one second a ``.frd`` prints six digits, above it ten: an even step of
    1/3 ms looks uneven. Times that are not all even within their last printed digit
    stay as they are.
    """
    if times_ms.size < 2:
        return times_ms
    even: FloatArray = np.linspace(times_ms[0], times_ms[-1], times_ms.size)
    times_s = np.maximum(times_ms / MS_PER_S, np.finfo(np.float64).tiny)
    digits = np.where(times_s < 1.0, 5, 9)
    last_digit_ms = 10.0 ** (np.floor(np.log10(times_s)) - digits) * MS_PER_S
    rounding_ms = last_digit_ms + last_digit_ms[-1] * times_s / times_s[-1]
    return even if (np.abs(even - times_ms) <= rounding_ms).all() else times_ms


def outputs_of(index: FrdIndex, options: ReadOptions) -> list[Output]:
    """Blocks of each output that counts, in file order.

    An output is what CalculiX writes at one increment (or of one mode): blocks with the
    same step and increment that follow each other. A run that did not end well may close
    with one that never converged: stress is written of converged increments alone, so a
    STRESS block shows convergence; without one the ``.sta`` file has to.

    Raises
    ------
    ResultError
        The run did not end well and `options.partial` is not set, or the file
        holds no results.
    """
    file, problem = index.file, index.problem()
    for remark in index.remarks:
        options.note(remark)
    if problem is not None:
        words = "; ".join(filter(None, (file.change, *index.remarks, problem)))
        if not (options.partial and index.blocks):
            hint = "; --partial (partial=True) reads what is whole" if index.blocks else ""
            raise ResultError(words + hint, file.path)
        options.note(words)
    outputs: list[Output] = []
    last = (0, 0)
    for block in index.blocks:
        if not outputs or block.name in outputs[-1] or block.key != last:
            outputs.append({})
        outputs[-1][block.name], last = block, block.key
    if outputs and not index.ended:
        failed = {(row.step, row.increment): row.failed for row in _attempts(file.path)}
        if failed.get(last, STRESS not in outputs[-1]):
            options.note(f"dropped step {last[0]}, increment {last[1]}: not converged")
            outputs.pop()
    if not outputs:
        words = "no whole, converged increment in it"
        if not index.blocks:  # and yet it ended well
            words = "a mesh and no results: the deck has no *NODE FILE or *EL FILE; its prints, "
            words += f"where it asks for any, are in {file.path.stem}.dat"
        raise ResultError(words, file.path)
    return outputs


def having(
    index: FrdIndex, outputs: Sequence[Output], names: Sequence[str], options: ReadOptions
) -> list[Output]:
    """Outputs that have all quantities `names`, and these alone.

    Raises
    ------
    ResultError
        No output has one of them; or one has some and not all, or stress or displacement
        is gone after an output of the same step that has it, and `options.partial` is not set.
    """
    path, held = index.file.path, dict.fromkeys(name for output in outputs for name in output)
    keys = [next((block.key for block in output.values()), (0, 0)) for output in outputs]
    had, others = set[int](), set[int]()
    for name in names:
        if name not in held:
            raise ResultError(f"no {name} in it, it holds {', '.join(held) or 'nothing'}", path)
    found = []
    for (step, increment), output in zip(keys, outputs, strict=True):
        absent = [name for name in names if name not in output]
        lost = step in had and not COMPONENTS.keys().isdisjoint(names)
        if len(absent) < len(names):
            had.add(step)
        if not absent:
            found.append({name: output[name] for name in names})
        elif len(absent) < len(names) or lost:
            # CalculiX writes them at every output of a step from the first that has them.
            words = f"step {step}, increment {increment} has no {absent[0]}"
            if not options.partial:
                raise ResultError(words, path)
            options.note(f"dropped: {words}")
        elif output:
            others.add(step)
    if others:
        left = ", ".join(map(str, sorted(others)))
        options.note(f"left out: outputs without {' and '.join(names)} in step {left}")
    if not found:
        raise ResultError(f"no increment has all of {', '.join(names)}", path)
    return found


def check_unchanged(file: ByteFile, options: ReadOptions) -> None:
    """Refuse, or with `partial` note, a file that changed while it was read."""
    change = file.change
    if change is not None and not options.partial:
        raise ResultError(f"{change}; read it again when the run has ended", file.path)
    if change is not None:
        options.note(change)


def no_records(block: FrdBlock, path: Path) -> ResultError:
    """The error of a block without a record."""
    return ResultError(
        f"{block} has 0 records: with OUTPUT=3D CalculiX writes none for an "
        "NSET of a plane model; use OUTPUT=2D",
        path,
    )


def node_ids(file: ByteFile, block: FrdBlock) -> IntArray:
    """Numbers of the nodes of `block`, in its order, ``(record,)``."""
    if block.free:
        return irregular_records(file, block)[0]
    if block.records == 0:
        raise no_records(block, file.path)
    step = max(1, 4 * CHUNK_BYTES // block.record_bytes)
    return np.concatenate(
        [
            record_ids(file.path, [block], characters_of(file, block, first, step), first)
            for first in range(0, block.records, step)
        ]
    )


def characters_of(file: ByteFile, block: FrdBlock, first: int, most: int) -> Characters:
    """The bytes of at most `most` records from number `first` on, ``(record, byte)``."""
    count, length = min(most, block.records - first), block.record_bytes
    raw = file.take(block.offset + first * length, count * length)
    return np.frombuffer(raw, dtype=np.uint8).reshape(count, length)


def record_ids(
    path: Path, blocks: Sequence[FrdBlock], characters: Characters, first: int = 0
) -> IntArray:
    """The node of each record; as many records of each of `blocks`, which are of one form.

    `first` is the number of the first record in its block.

    Raises
    ------
    ResultError
        A record does not begin like one, or is not as long as the others.
    """
    block = blocks[0]
    if block.flag >= 2:
        ids: IntArray = np.ascontiguousarray(characters[:, :4]).view("<i4")[:, 0].astype(np.int64)
        fine: BoolArray = ids > 0
    else:
        width, mark = 10 if block.flag else 5, b" -1"
        ids, fine = fixed_integers(characters[:, _MARK : _MARK + width])
        for start, end in block.spans:
            for place, character in enumerate(mark, start=start - width - _MARK):
                fine &= characters[:, place] == character
            fine &= characters[:, end + block.line_end - 1] == ord("\n")
            mark = b" -2"  # on every line but the first
    if not fine.all():
        row = int(np.argmin(fine))
        which, number = divmod(row, len(characters) // len(blocks))
        raise ResultError(
            f"{blocks[which]}: record {first + number + 1} of {block.records} begins with "
            f"{characters[row, : _MARK + 10].tobytes()!r}, or is not as long as the others",
            path,
        )
    return ids


def record_values(path: Path, blocks: Sequence[FrdBlock], characters: Characters) -> FloatArray:
    """Values, ``(record, component)``, as the file has them: float32 stays so.

    Raises
    ------
    ResultError
        A field is no number. NaN and infinite values are values.
    """
    block, count = blocks[0], len(blocks[0].components)
    if block.flag >= 2:
        # Copied as one void: faster than value by value.
        packed = np.dtype([("node", "<i4"), ("values", f"V{block.record_bytes - 4}")])
        voids = characters.reshape(-1).view(packed)["values"]
        packed_values: FloatArray = np.ascontiguousarray(voids).view(_REALS[block.flag])
        return packed_values.reshape(-1, count)
    fields = np.concatenate([characters[:, start:end] for start, end in block.spans], axis=1)
    try:
        return _floats(fields.reshape(-1, count, _FIELD))
    except ValueError as error:
        row, column, problem = error.args
        node = record_ids(path, [block], characters[row : row + 1])[0]
        block = blocks[row * len(blocks) // len(characters)]
        where = f"{block}, node {node}, {block.components[column]}"
        raise ResultError(f"{where}: {problem}", path) from error


def irregular_records(file: ByteFile, block: FrdBlock) -> tuple[IntArray, FloatArray]:
    """Nodes and values of a text block whose lines are of unequal length.

    Some builds print exponents of three digits, ``-5.28012E-003``: one character too
    many for the field, so that nothing is where it should be. A field then is what has
    the form of a number; there is a blank or a sign in front of it, or nothing.
    """
    found = file.find((b"\n -3",), block.offset - 1)
    text = file.take(block.offset, (file.size if found is None else found[0] + 1) - block.offset)
    # Two digits may be followed by the next number, which begins with a digit: 3.067.
    number_field = (
        rb"(?: *[+-]?\d\.\d{5}[Ee][+-](?:\d{3}(?!\.)|\d{2})"
        rb"| *[+-]?(?:1\.#[A-Za-z]+|[Nn][Aa][Nn]|[Ii][Nn][Ff](?:inity)?))"
    )
    width, count, record = 10 if block.flag else 5, len(block.components), b""
    for first in range(0, count, _VALUES_A_LINE):
        record += b" -2" + b" " * width if first else b" -1([ 0-9]{%d})" % width
        record += number_field + b"{%d} *\r?\n" % min(_VALUES_A_LINE, count - first)
    nodes, fields, place = [], list[bytes](), 0
    for match in re.finditer(record, text):
        if match.start() != place or not match[1].strip().isdigit():
            break
        nodes.append(int(match[1]))
        fields += re.findall(number_field, match[0][_MARK + width :])
        place = match.end()
    if place != len(text) or len(nodes) != block.records:
        raise ResultError(
            f"{block}: record {len(nodes) + 1} of {block.records} begins with "
            f"{text[place : place + 24]!r}",
            file.path,
        )
    values = np.array([_number(one) for one in fields], dtype=np.float64)
    return np.array(nodes, dtype=np.int64), values.reshape(-1, count)


def _floats(fields: Characters) -> FloatArray:
    """E12.5 fields, ``(row, column, 12)`` -> ``(row, column)``; NaN and INF are read as such.

    Raises
    ------
    ValueError
        A field is no number: its row, its column, and what it is.
    """
    values, usual = fixed_floats(fields.reshape(-1, _FIELD))
    for row in np.flatnonzero(~usual).tolist():
        try:
            values[row] = _number(fields.reshape(-1, _FIELD)[row].tobytes())
        except ValueError as error:
            raise ValueError(*divmod(row, fields.shape[1]), str(error)) from error
    return values.reshape(fields.shape[:2])


class ElementRows(NamedTuple):
    """Elements of one type: `ids` and `material` ``(M,)``, `corners` ``(M, k)``.

    Nodes are in the order of the file: corners, then mid-sides; he20 and pe15 have the
    mid-sides of the bottom, the ones between, and then those of the top (deck nodes
    1-12, 17-20, 13-16; 1-9, 13-15, 10-12).
    """

    type: int
    ids: IntArray
    material: IntArray
    corners: IntArray


def element_rows(
    file: ByteFile, elements: MeshBlock, nodes: Collection[int] = ()
) -> Iterator[ElementRows]:
    """The elements, in tables of one type; a record that is none is a `ResultError`.

    Of `nodes`, where there are any, at least those that have one of them.
    """
    if elements.flag >= 2:
        yield from (rows for rows, _ in packed_elements(file, elements.offset, elements.records))
        return
    width, at = 5 if elements.flag == 0 else 10, elements.offset
    wanted = [b"%*d" % (width, node) for node in nodes]
    while at < elements.end:
        text = file.take(at, min(_MESH_BYTES, elements.end - at))
        if at + len(text) < elements.end:  # a chunk ends before the head of an element
            text = text[: text.rfind(b"\n -1") + 1]
        if not text:
            raise ResultError(f"element block: no element at byte {at}", file.path)
        at += len(text)
        if not wanted or any(node in text for node in wanted):
            lines = text.split(b"\n")[: -2 if at == elements.end else -1]  # without -3
            if lines:
                yield from _elements_of_lines(lines, width, file.path)


def packed_elements(file: ByteFile, offset: int, records: int) -> Iterator[tuple[ElementRows, int]]:
    """Packed elements, and the offset behind them.

    Elements of one type are together and have one length: the run grows as long as the
    types agree.
    """
    at, done = offset, 0
    while done < records:
        head = file.peek(at, 8)
        kind = int.from_bytes(head[4:], "little")
        if len(head) == 8 and kind not in NODES_OF_TYPE:
            raise ResultError(f"element type {kind} at byte {at} is unknown", file.path)
        width = 4 * (4 + NODES_OF_TYPE.get(kind, 0))  # id, type, 0, material
        if at + width > file.size:
            raise ResultError(f"element block: cut: {records} elements announced", file.path)
        look, same = 16, 1
        while same and done < records and at + width <= file.size:
            some = min(look, records - done, CHUNK_BYTES // width, (file.size - at) // width)
            words = np.frombuffer(file.take(at, some * width), "<i4").reshape(some, -1)
            of_kind = words[:, 1] == kind
            same = some if of_kind.all() else int(np.argmin(of_kind))
            if same:
                rows = words[:same].astype(np.int64)
                at, done = at + same * width, done + same
                yield ElementRows(kind, rows[:, 0], rows[:, 3], rows[:, 4:]), at
            look *= 4


def packed_end(file: ByteFile, offset: int, records: int) -> int:
    """The offset behind packed elements."""
    return max([offset, *(end for _, end in packed_elements(file, offset, records))])


def _elements_of_lines(lines: list[bytes], width: int, path: Path) -> Iterator[ElementRows]:
    """Printed elements: a line `` -1`` of id, type, group, material; lines `` -2`` of nodes."""
    table = np.array(lines)
    size = max(table.itemsize, _MARK + max(width + 15, 10 * width))
    characters = table.astype(f"S{size}").view(np.uint8).reshape(-1, size)
    marks = table.astype(f"S{_MARK}")
    heads, tails = marks == b" -1", marks == b" -2"
    at_type = _MARK + width
    ids, fine = fixed_integers(characters[heads, _MARK:at_type])
    kind, good = fixed_integers(characters[heads, at_type : at_type + 5])
    material, known = fixed_integers(characters[heads, at_type + 10 : at_type + 15])
    material[~known] = UNKNOWN_MATERIAL
    # Fields of a line that are not blank, and to which element they belong.
    fields = characters[tails, _MARK : _MARK + 10 * width].reshape(-1, width)
    text = fields.tobytes().translate(_NO_LINE_END)
    filled = np.frombuffer(text, f"S{width}") != b" " * width
    nodes, whole = fixed_integers(fields[filled])
    element = np.repeat(np.cumsum(heads)[tails] - 1, 10)[filled]
    counts = np.bincount(element[element >= 0], minlength=kind.size)
    checks = (heads[:1], heads | tails, fine, good, whole, counts > 0)
    if not all(one.all() for one in checks):
        odd = int(np.argmin(heads | tails))
        raise ResultError(f"element block: {lines[odd][:80]!r} is no element", path)
    for one in dict.fromkeys(zip(kind.tolist(), counts.tolist(), strict=True)):
        rows = (kind == one[0]) & (counts == one[1])
        corners = nodes[rows[element]].reshape(-1, one[1])
        yield ElementRows(one[0], ids[rows], material[rows], corners)


def _over_time(
    index: FrdIndex, outputs: Sequence[Output], names: Sequence[str], options: ReadOptions
) -> list[Output]:
    """Outputs of static and dynamic steps that have all of `names`: modes have no time."""
    path = index.file.path
    for name in names:
        blocks = [output[name] for output in outputs if name in output]
        others = [block for block in blocks if not block.over_time]
        if others:
            first, last = others[0], others[-1]
            what = "results of another kind than static or dynamic"
            if first.modal:
                what = f"{len(others)} modes ({first.axis} {first.value:g}"
                what += f" to {last.value:g})" if last.value != first.value else ")"
            words = f"{name} of step {first.step} holds {what}, no history over time"
            if len(others) == len(blocks):
                raise ResultError(f"{words}: there is no trace to take", path)
            options.note(f"left out: {words}")
        if any(f"{name}I" in out for out in outputs if name in out and out[name].over_time):
            raise ResultError(
                f"{name} has an imaginary part, {name}I: amplitudes over frequency, no "
                "history over time; there is no trace to take",
                path,
            )
    timed = [{n: block for n, block in out.items() if block.over_time} for out in outputs]
    found = having(index, timed, names, options)
    seen: set[Key] = set()
    for output in found:
        for name, block in output.items():
            absent = [one for one in COMPONENTS[name] if one not in block.components]
            if absent:
                held = ", ".join(block.components)
                raise ResultError(f"{block} has no component {absent[0]}: it holds {held}", path)
            if block.key in seen:
                raise ResultError(
                    f"{block} is duplicate: iterations, not increments, or two runs in one file",
                    path,
                )
        seen.add(block.key)
    return found


def _at_nodes(
    file: ByteFile,
    blocks: Sequence[FrdBlock],
    nodes: Sequence[int],
    names: Sequence[str] = (),
) -> FloatArray:
    """Values of the components `names` of one quantity at `nodes`, ``(T, node, component)``.

    Nodes are in the order of the deck's set: not sorted, some duplicate. The rows of the
    wanted nodes are found once and tried on the next block; the id in front of each
    record says whether they are still right, and if not they are sought again. Blocks of
    one form are converted together.
    """
    wanted = np.array([int(node) for node in nodes], dtype=np.int64)
    names = names or COMPONENTS[blocks[0].name]
    values = np.empty((len(blocks), wanted.size, len(names)))
    if not wanted.size:
        return values
    rows = np.empty(0, dtype=np.int64)
    heads = np.empty((0, 0), dtype=np.uint8)
    form: tuple[object, ...] = ()
    by_form: dict[tuple[object, ...], list[tuple[int, Characters]]] = {}
    for at, block in enumerate(blocks):
        before, form = form, (block.flag, block.record_bytes, block.components, block.free)
        columns = [block.components.index(name) for name in names]
        head = 4 if block.flag >= 2 else block.spans[0][0]
        found = None
        if form == before and not block.free and rows.max() < block.records:
            found = _gather(file, block, rows)
        if found is None or not np.array_equal(found[:, :head], heads):
            ids = node_ids(file, block)
            rows = rows_of(wanted, ids)
            if (rows < 0).any():
                _refuse_absent(file.path, block, ids, wanted[int(np.argmin(rows))])
            if block.free:
                values[at] = irregular_records(file, block)[1][rows][:, columns]
                continue
            found = _gather(file, block, rows)
            heads = found[:, :head]
        by_form.setdefault(form, []).append((at, found))
    for taken in by_form.values():
        places, tables = zip(*taken, strict=True)
        of = [blocks[at] for at in places]
        columns = [of[0].components.index(name) for name in names]
        characters = np.concatenate(tables)
        if (record_ids(file.path, of, characters) != np.tile(wanted, len(of))).any():
            raise ResultError(f"{of[0]}: records changed while read", file.path)
        found_values = record_values(file.path, of, characters)[:, columns]
        values[list(places)] = found_values.reshape(len(of), wanted.size, -1)
    return values


def _gather(file: ByteFile, block: FrdBlock, rows: IntArray) -> Characters:
    """The records at `rows`, in that order, ``(record, byte)``."""
    first, last = int(rows.min()), int(rows.max())
    if (last - first + 1) * block.record_bytes <= max(
        _SEEK_BYTES, 4 * rows.size * block.record_bytes
    ):
        return characters_of(file, block, first, last - first + 1)[rows - first]
    return np.concatenate([characters_of(file, block, row, 1) for row in rows.tolist()])


def _refuse_absent(path: Path, block: FrdBlock, ids: IntArray, absent: int) -> None:
    held = np.unique(ids)
    near = held[np.argsort(np.abs(held - absent), kind="stable")[:3]]
    raise ResultError(
        f"node {absent} has no record in {block}: {held.size} nodes, "
        f"{held[0]} to {held[-1]}; nearest {', '.join(map(str, np.sort(near)))}",
        path,
    )


def _finite(
    path: Path,
    outputs: Sequence[Output],
    values: Mapping[str, FloatArray],
    nodes_of: Mapping[str, Sequence[int]],
    options: ReadOptions,
    components: Sequence[str] = (),
) -> BoolArray:
    """Which `outputs` hold finite values alone; without `partial` the others are refused."""
    keep = np.ones(len(outputs), dtype=np.bool_)
    for name, found in values.items():
        for row, node, column in np.argwhere(~np.isfinite(found)).tolist():
            block = outputs[row][name]
            problem = (
                f"node {nodes_of[name][node]} at {block.time_ms:g} ms: {name} "
                f"{(components or COMPONENTS[name])[column]} is {found[row, node, column]}"
            )
            if not options.partial:
                raise NotFiniteError(problem, path)
            if keep[row]:
                options.note(f"dropped step {block.step}, increment {block.increment}: {problem}")
            keep[row] = False
    return keep


def _check_materials(index: FrdIndex, nodes: Collection[int], branches: Mapping[int, int]) -> None:
    """Refuse nodes with elements of more materials than their stress has branches."""
    met = materials_at(index, nodes)
    held, counts = np.unique(met[:, 0], return_counts=True)
    for node in held[counts > 1].tolist():
        if (numbers := met[met[:, 0] == node, 1]).size > branches.get(node, 1):
            names = " and ".join(
                index.materials.get(number, f"material {number}") for number in numbers.tolist()
            )
            raise ResultError(
                f"node {node} is between {names}: its stress is a mean over both "
                "and belongs to neither; take a node inside one layer, or ask for "
                "it with --across-materials (across_materials=True)",
                index.file.path,
            )


def materials_at(index: FrdIndex, nodes: Collection[int]) -> IntArray:
    """Each of `nodes` with each material of an element there, ``(M, 2)``, rising."""
    pairs = [np.empty((0, 2), dtype=np.int64)]
    wanted = np.unique(np.array(list(nodes), dtype=np.int64))
    if index.elements is not None and wanted.size:
        few = wanted.tolist() if wanted.size <= _FEW_NODES else ()
        for rows in element_rows(index.file, index.elements, few):
            element, corner = np.nonzero(np.isin(rows.corners, wanted))
            pairs.append(np.stack([rows.corners[element, corner], rows.material[element]], 1))
    return np.unique(np.concatenate(pairs), axis=0)


def _quantity(index: FrdIndex, name: str) -> Table:
    """One quantity of a description; outputs of modes and steady states have no time."""
    blocks = index.named(name)
    complex_parts = {name, f"{name}I", name.removesuffix("I")} & set(index.names)
    timed = [block for block in blocks if block.over_time and len(complex_parts) == 1]
    others = blocks if not timed else [block for block in blocks if not block.over_time]
    axis = "total time"
    if others:
        axis = "frequency in cycles per time" if others[0].over_time else others[0].axis
    lowest, highest, nodes = _span(index, blocks[0])
    return {
        "name": name,
        "components": list(blocks[0].components),
        "increments": len(timed),
        "first_ms": timed[0].time_ms if timed else None,
        "last_ms": timed[-1].time_ms if timed else None,
        "modes": len(others),
        "axis": axis,
        "first_value": others[0].value if others else None,
        "last_value": others[-1].value if others else None,
        "steps": sorted({block.step for block in blocks}),
        "nodes": nodes,
        "lowest_node": lowest,
        "highest_node": highest,
        "storage": ("ASCII", "ASCII", "float32", "float64")[blocks[0].flag],
    }


def _span(index: FrdIndex, block: FrdBlock) -> tuple[int | None, int | None, int]:
    """Lowest and highest node and their count, with little reading.

    A block of the whole mesh ascends, so its ends are enough; one of a set is in the
    order of the deck, with duplicates, and is read.
    """
    if not block.records:
        return None, None, 0
    if not block.free and index.nodes is not None and block.records == index.nodes.records:
        ends = _gather(index.file, block, np.array([0, block.records - 1]))
        lowest, highest = record_ids(index.file.path, [block], ends).tolist()
        if lowest <= highest:
            return lowest, highest, block.records
    ids = np.unique(node_ids(index.file, block))
    return int(ids[0]), int(ids[-1]), ids.size


def _attempts(path: Path) -> list[StaRow]:
    """Attempts at increments in the ``.sta`` beside; none where it cannot be read."""
    beside = path.with_suffix(".sta")
    try:
        return read_sta(beside) if beside.exists() else []
    except (ResultError, OSError):
        return []


def _counts(line: bytes, *places: tuple[int, int]) -> list[int]:
    """The counts at `places` of a header; not what Python calls an integer, as ``1_0``."""
    for start, end in places:
        if not line[start:end].strip().isdigit():
            found = line[start:end].decode("latin-1")
            raise ValueError(f"{found!r} where a count is expected in {line[:12].strip()!r}")
    return [int(line[start:end]) for start, end in places]


def _number(field: bytes) -> float:
    """One field that may be a NaN, infinite or with a long exponent."""
    if re.fullmatch(rb" *[+-]?\d\.\d{5}[Ee][+-]\d{2,3} *", field):
        return float(field)
    if re.fullmatch(rb" *[+-]?(nan.*|1\.#(ind|qnan|snan).*)", field, re.IGNORECASE):
        return float("nan")
    infinite = re.fullmatch(rb" *([+-]?)(inf|infinity|1\.#inf.*) *", field, re.IGNORECASE)
    if infinite:
        return float(infinite[1] + b"inf")
    raise ValueError(f"{field.decode('latin-1')!r} is no number")
