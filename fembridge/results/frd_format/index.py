"""What a ``.frd`` holds and where: the mesh, the blocks, and what is damaged."""

from dataclasses import dataclass, field

from fembridge.errors import ResultError
from fembridge.results.byte_file import ByteFile
from fembridge.results.frd_format.block import FrdBlock
from fembridge.results.frd_format.mesh import MeshBlock
from fembridge.results.frd_format.walk import END_LINE, FrdDamage, FrdWalk

FIRST_BYTES = b"    1C"

__all__ = ["END_LINE", "FIRST_BYTES", "FrdDamage", "FrdIndex", "index_frd"]


@dataclass(frozen=True, slots=True)
class FrdIndex:
    """Whole blocks in file order, the mesh, and what is damaged.

    `ended` tells whether the line `` 9999`` closes the file: CalculiX writes it
    only when the job ends normally. `materials` names material numbers.
    `remarks` are oddities that do no harm.
    """

    size: int
    blocks: tuple[FrdBlock, ...]
    nodes: MeshBlock | None
    elements: MeshBlock | None
    materials: dict[int, str] = field(default_factory=dict)
    ended: bool = False
    damage: tuple[FrdDamage, ...] = ()
    remarks: tuple[str, ...] = ()

    def named(self, name: str) -> list[FrdBlock]:
        """Blocks of one quantity, in file order."""
        return [block for block in self.blocks if block.name == name]

    @property
    def last_whole(self) -> FrdBlock | None:
        """A block of the last increment that has all that the one before has.

        None if there is none. The increment at which a run diverged has DISP
        and no STRESS; one that was cut lacks what was not written yet.
        """
        names = self._blocks_of
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
    def unconverged(self) -> FrdBlock | None:
        """A block of an increment at which the run diverged; None if none shows.

        It is the file's last, whole, without the end line behind it, and has
        displacements where the increment before it also has stress.
        """
        whole = self.last_whole
        if self.ended or self.damage or whole is None or not self.blocks:
            return None
        last = self.blocks[-1]
        return last if last.key != whole.key else None

    @property
    def names(self) -> tuple[str, ...]:
        """Quantities held, in order of first appearance."""
        return tuple(dict.fromkeys(block.name for block in self.blocks))

    @property
    def _blocks_of(self) -> dict[tuple[int, int], dict[str, FrdBlock]]:
        names: dict[tuple[int, int], dict[str, FrdBlock]] = {}
        for block in self.blocks:
            names.setdefault(block.key, {})[block.name] = block
        return names


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
        raise ResultError(f"no .frd: begins with {start!r}, expected {FIRST_BYTES!r}", file.path)
    walk = FrdWalk(file)
    walk.run()
    return FrdIndex(
        size=file.size,
        blocks=tuple(walk.blocks),
        nodes=walk.nodes,
        elements=walk.elements,
        materials=walk.materials,
        ended=walk.ended,
        damage=tuple(walk.damage),
        remarks=tuple(walk.remarks),
    )
