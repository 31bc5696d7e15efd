"""The walk through a ``.frd``, from block to block.

Every block tells how many records it has and how long they are, so the walk
reads headers only and jumps over the rest. It never looks for markers inside
binary records, which may hold any byte. A block is whole when what has to
follow it does follow; counts are held against the size of the file before
anything trusts them. ASCII blocks end in a line `` -3``, which is where the
walk finds its feet again after records of unequal length or a cut.
"""

from dataclasses import dataclass, replace

from fembridge.errors import ResultError
from fembridge.results.byte_file import ByteFile
from fembridge.results.frd_format.block import FrdBlock, HeaderReader, read_mode, read_step
from fembridge.results.frd_format.mesh import MeshBlock, read_mesh_block

END_LINE = b" 9999"
_NEXT_STEP = b"    1PSTEP"
_AFTER_A_BLOCK = (b"    1P", END_LINE, b"  100C", b"    2C", b"    3C")


@dataclass(frozen=True, slots=True)
class FrdDamage:
    """A place that is not as it should be: what, where, in which block.

    `key` is the step and increment it falls into, where that is known;
    `records` counts the records of `block` that stand before the cut.
    """

    problem: str
    offset: int
    key: tuple[int, int] | None = None
    block: FrdBlock | None = None
    records: int = 0


class FrdWalk:
    """The state of one walk: where it is and what it has met."""

    def __init__(self, file: ByteFile) -> None:
        self.file = file
        self.blocks: list[FrdBlock] = []
        self.nodes: MeshBlock | None = None
        self.elements: MeshBlock | None = None
        self.materials: dict[int, str] = {}
        self.ended = False
        self.damage: list[FrdDamage] = []
        self.remarks: list[str] = []
        self._headers = HeaderReader(file)
        self._key: tuple[int, int] | None = None
        self._mode: int | None = None
        self._seen_binary = False

    def run(self) -> None:
        """Walk to the end, or as far as the file can be understood."""
        at: int | None = 0
        while at is not None and at < self.file.size:
            at = self._one(at)

    def _one(self, at: int) -> int | None:
        found = self.file.line(at)
        line, after = found or (self.file.peek(at, 80), self.file.size)
        if line.startswith(END_LINE):
            self.ended = True
            rest = self.file.peek(at, 80)[len(END_LINE) :].strip()
            if rest:
                self._harm(f"bytes after the end line: {rest[:12]!r}", at)
            return None
        if found is None:
            self._harm(self.file.why_no_line(at), at)
            return None
        if line.startswith(b"  100C"):
            return self._block(at)
        if line.startswith(_NEXT_STEP):
            return self._step(line, at, after)
        if line.startswith(b"    1"):
            self._note(line, at)
            return after
        if line.startswith((b"    2C", b"    3C")):
            return self._mesh(line, at, after)
        self._harm(f"{line[:24]!r} where a block should begin", at)
        return self._resume(at)

    def _step(self, line: bytes, at: int, after: int) -> int:
        self._mode = None
        try:
            self._key = read_step(line)
            if line[24:27] == b"STP" and not self.remarks:
                self.remarks.append(
                    f"iterations of increment {self._key[1]} of step {self._key[0]}, "
                    "no history (LAST ITERATIONS)"
                )
        except ValueError as error:
            self._key = None
            self._harm(f"1PSTEP line cannot be read: {error}", at)
        return after

    def _note(self, line: bytes, at: int) -> None:
        if line.startswith(b"    1UMAT"):
            number = line[9:14].strip()
            if number.isdigit():
                name = line[14:].decode("latin-1").strip()
                self.materials.setdefault(int(number), name)
        elif line.startswith(b"    1PMODE"):
            try:
                self._mode = read_mode(line)
            except ValueError as error:
                self._harm(f"1PMODE line cannot be read: {error}", at)

    def _mesh(self, line: bytes, at: int, after: int) -> int | None:
        kind = "node" if line.startswith(b"    2C") else "element"
        try:
            block = read_mesh_block(self.file, line, after)
        except ResultError as error:
            return self._odd_mesh(kind, line, at, after, error.problem)
        if kind == "node":
            self.nodes = block
        else:
            self.elements = block
        if block.binary and not self._boundary(block.end):
            self._harm(f"{kind} block: its count does not lead to its end", at)
            return None
        return block.end

    def _odd_mesh(self, kind: str, line: bytes, at: int, after: int, problem: str) -> int | None:
        """Take layers of a composite shell, which the count does not count.

        Of other ASCII blocks whose count lies the mesh is not used; the walk
        goes on behind their end line.
        """
        flag = line[73:75].strip()
        end = self.file.find((b"\n -3",), after - 1) if flag in (b"0", b"1") else None
        last = None if end is None else self.file.line(end[0] + 1)
        if end is None or last is None or last[0].strip() != b"-3":
            self._harm(f"{kind} block: {problem}", at)
            return None
        present = self.file.count(b"\n -1", after - 1, end[0])
        count = line[24:36].strip()
        announced = int(count) if count.isdigit() else 0
        layers, rest = divmod(present, announced) if announced else (0, 1)
        if kind == "element" and layers > 1 and rest == 0:
            self.elements = MeshBlock(present, int(flag), after, last[1])
            self.remarks.append(
                f"element block announces {announced} elements and holds {layers} "
                "times as many: layers of composite shells"
            )
        else:
            self._harm(f"{kind} block: {problem}", at)
        return last[1]

    def _block(self, at: int) -> int | None:
        if self._key is None:
            self._harm("100CL without a 1PSTEP line that tells step and increment", at)
            return self._resume(at)
        try:
            block = self._headers.read(at, self._key, self._mode)
        except ResultError as error:
            self._harm(error.problem, at)
            return None
        finally:
            self._key = None
        return self._binary(block) if block.binary else self._text(block)

    def _binary(self, block: FrdBlock) -> int | None:
        self._seen_binary = True
        if block.end > self.file.size:
            whole = (self.file.size - block.offset) // block.record_bytes
            self._cut(block, whole, self.file.size)
            return None
        if not self._boundary(block.end):
            found = self.file.peek(block.end, 12)
            self._harm(
                f"{block} is followed by {found!r} at byte {block.end}: its count, "
                f"{block.records}, is wrong or bytes are missing",
                block.end,
                block,
            )
            return None
        self.blocks.append(block)
        return block.end

    def _text(self, block: FrdBlock) -> int | None:
        closing = b"\n -3\r\n" if block.line_end == 2 else b"\n -3\n"
        if block.records >= 0 and self.file.holds(block.end - 1, closing):
            self.blocks.append(block)
            return block.end - 1 + len(closing)
        markers = (b"\n -3", _NEXT_STEP, b"\n" + END_LINE)
        found = self.file.find(markers, block.offset - 1)
        at, marker = found or (self.file.size, b"")
        after = None
        if marker == b"\n -3":
            line = self.file.line(at + 1)
            after = line[1] if line else None
            records = self.file.count(b"\n -1", block.offset - 1, at)
            if block.records < 0:
                block = replace(block, records=records)
                if after is not None and block.end == at + 1:
                    self.blocks.append(block)
                    return after
            if after is not None and records == block.records > 0:
                self.blocks.append(replace(block, free=True))
                return after
            if after is not None:
                self._harm(
                    f"{block} announces {block.records} records and has {records}",
                    at,
                    block,
                    records,
                )
                return after
        last = at if block.records < 0 else min(at, block.end)
        begun = self.file.count(b"\n -1", block.offset - 1, last)
        whole = min((at - block.offset) // block.record_bytes, begun)
        self._cut(block, whole if block.records < 0 else min(whole, block.records), at)
        if marker == _NEXT_STEP:
            return at
        return at + 1 if marker.endswith(END_LINE) else None

    def _boundary(self, at: int) -> bool:
        found = self.file.peek(at, 6)
        return any(
            found.startswith(marker) or marker.startswith(found) for marker in _AFTER_A_BLOCK
        )

    def _resume(self, at: int) -> int | None:
        """Find the next step in text; among binary records it is not sought."""
        if self._seen_binary or (self.nodes is not None and self.nodes.binary):
            return None
        found = self.file.find((_NEXT_STEP,), at + 1)
        return None if found is None else found[0]

    def _cut(self, block: FrdBlock, records: int, at: int) -> None:
        of = "" if block.records < 0 else f"{block.records} "
        self._harm(
            f"{block} is cut at byte {at}, after {records} of {of}records", at, block, records
        )

    def _harm(self, problem: str, at: int, block: FrdBlock | None = None, records: int = 0) -> None:
        if block is None and "byte" not in problem:
            problem = f"{problem} (byte {at} of {self.file.size})"
        key = self._key if block is None else block.key
        self.damage.append(FrdDamage(problem, at, key, block, records))
