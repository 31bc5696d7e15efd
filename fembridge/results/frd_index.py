"""What a ``.frd`` holds and where: the walk from block to block.

Every block tells how many records it has and how long they are, so the walk
reads headers only and jumps over the rest. It never looks for markers inside
binary records, which may hold any byte. A block is whole when what has to
follow it does follow; counts are held against the size of the file before
anything trusts them. ASCII blocks end in a line `` -3``, which is where the
walk finds its feet again after records of unequal length or a cut.
"""

from dataclasses import dataclass, field, replace

from fembridge.errors import ResultError
from fembridge.results.byte_file import ByteFile
from fembridge.results.frd_block import FrdBlock, read_header, read_step
from fembridge.results.frd_mesh import MeshBlock, read_mesh_block

FIRST_BYTES = b"    1C"
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


@dataclass(frozen=True, slots=True)
class FrdIndex:
    """Whole blocks in file order, the mesh, and what is damaged.

    `ended` tells whether the line `` 9999`` closes the file: CalculiX writes it
    only when the job ends normally. `materials` names material numbers.
    """

    size: int
    blocks: tuple[FrdBlock, ...]
    nodes: MeshBlock | None
    elements: MeshBlock | None
    materials: dict[int, str] = field(default_factory=dict)
    ended: bool = False
    damage: tuple[FrdDamage, ...] = ()

    def named(self, name: str) -> list[FrdBlock]:
        """Blocks of one quantity, in file order."""
        return [block for block in self.blocks if block.name == name]

    @property
    def last_whole(self) -> FrdBlock | None:
        """A block of the last increment that has all that the one before has.

        None if there is none. The increment at which a run diverged has DISP
        and no STRESS; one that was cut lacks what was not written yet.
        """
        names: dict[tuple[int, int], dict[str, FrdBlock]] = {}
        for block in self.blocks:
            names.setdefault(block.key, {})[block.name] = block
        for harm in self.damage:
            if harm.key is not None:
                names.pop(harm.key, None)
        if not names:
            return None
        before, last = list(names)[-2:][0], list(names)[-1]
        if not self.ended and before[0] == last[0]:
            last = last if names[before].keys() <= names[last].keys() else before
        return next(iter(names[last].values()))

    @property
    def names(self) -> tuple[str, ...]:
        """Quantities held, in order of first appearance."""
        return tuple(dict.fromkeys(block.name for block in self.blocks))


def index_frd(file: ByteFile) -> FrdIndex:
    """Walk through `file` once.

    Raises
    ------
    ResultError
        The file is empty or no ``.frd``. Damage further on is told by the
        index, not raised: who reads decides what to do about it.
    """
    if file.size == 0:
        raise ResultError("empty: 0 bytes", file.path)
    start = file.peek(0, len(FIRST_BYTES))
    if start != FIRST_BYTES:
        raise ResultError(
            f"no .frd: begins with {start!r}, expected {FIRST_BYTES!r}", file.path
        )
    walk = _Walk(file)
    walk.run()
    return FrdIndex(
        size=file.size,
        blocks=tuple(walk.blocks),
        nodes=walk.nodes,
        elements=walk.elements,
        materials=walk.materials,
        ended=walk.ended,
        damage=tuple(walk.damage),
    )


class _Walk:
    """The state of one walk: where it is and what it has met."""

    def __init__(self, file: ByteFile) -> None:
        self.file = file
        self.blocks: list[FrdBlock] = []
        self.nodes: MeshBlock | None = None
        self.elements: MeshBlock | None = None
        self.materials: dict[int, str] = {}
        self.ended = False
        self.damage: list[FrdDamage] = []
        self._key: tuple[int, int] | None = None

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
            self._harm("cut inside a line", at)
            return None
        if line.startswith(_NEXT_STEP):
            return self._step(line, at, after)
        if line.startswith(b"    1"):
            if line.startswith(b"    1UMAT"):
                self._material(line)
            return after
        if line.startswith((b"    2C", b"    3C")):
            return self._mesh(line, at, after)
        if line.startswith(b"  100C"):
            return self._block(at)
        self._harm(f"{line[:24]!r} where a block should begin", at)
        return self._resume(at)

    def _step(self, line: bytes, at: int, after: int) -> int:
        try:
            self._key = read_step(line)
        except ValueError as error:
            self._key = None
            self._harm(f"1PSTEP line cannot be read: {error}", at)
        return after

    def _material(self, line: bytes) -> None:
        number = line[9:14].strip()
        if number.isdigit():
            name = line[14:].decode("latin-1").strip()
            self.materials.setdefault(int(number), name)

    def _mesh(self, line: bytes, at: int, after: int) -> int | None:
        kind = "node" if line.startswith(b"    2C") else "element"
        try:
            block = read_mesh_block(self.file, line, after)
        except ResultError as error:
            self._harm(f"{kind} block: {error.problem}", at)
            return None
        if kind == "node":
            self.nodes = block
        else:
            self.elements = block
        if block.binary and not self._boundary(block.end):
            self._harm(f"{kind} block: its count does not lead to its end", at)
            return None
        return block.end

    def _block(self, at: int) -> int | None:
        if self._key is None:
            self._harm("100CL without a 1PSTEP line that tells step and increment", at)
            return self._resume(at)
        try:
            block = read_header(self.file, at, self._key)
        except ResultError as error:
            self._harm(error.problem, at)
            return None
        finally:
            self._key = None
        return self._binary(block) if block.binary else self._text(block)

    def _binary(self, block: FrdBlock) -> int | None:
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
        if self.file.peek(block.end - 1, len(closing)) == closing:
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
        whole = min((at - block.offset) // block.record_bytes, block.records)
        self._cut(block, whole, at)
        if marker == _NEXT_STEP:
            return at
        return at + 1 if marker.endswith(END_LINE) else None

    def _boundary(self, at: int) -> bool:
        found = self.file.peek(at, 6)
        return any(
            found.startswith(marker) or marker.startswith(found)
            for marker in _AFTER_A_BLOCK
        )

    def _resume(self, at: int) -> int | None:
        """Find the next step in text; among binary records it is not sought."""
        binary = any(block.binary for block in self.blocks)
        if binary or (self.nodes is not None and self.nodes.binary):
            return None
        found = self.file.find((_NEXT_STEP,), at + 1)
        return None if found is None else found[0]

    def _cut(self, block: FrdBlock, records: int, at: int) -> None:
        self._harm(
            f"{block} is cut at byte {at}, after {records} of {block.records} records",
            at,
            block,
            records,
        )

    def _harm(
        self, problem: str, at: int, block: FrdBlock | None = None, records: int = 0
    ) -> None:
        if block is None and "byte" not in problem:
            problem = f"{problem} (byte {at} of {self.file.size})"
        key = self._key if block is None else block.key
        self.damage.append(FrdDamage(problem, at, key, block, records))
