"""Forces between a rigid shape and the skin: unilateral contact on the pad's compliance.

Node n of the skin is pressed by ``f_n >= 0`` and goes ``(C f)_n`` down; the shape would
have it at least `overlap_n` down, which is how deep the shape is less the gap at first::

    w = C f - overlap >= 0,   f >= 0,   f w = 0

That is a linear complementarity problem. It is solved by an active set: nodes in contact
follow the shape exactly, those that would be pulled leave, those inside the shape enter,
all at once while that helps and one at a time where it does not (block principal
pivoting, Júdice & Pires 1994). From one step of a touch to the next few nodes change, so
the inverse over the nodes in contact is kept and changed by them alone.

Where skin slips along a shape that moves over it, friction drags each node by ``mu f_n``
in that direction, and C is that of both: no longer symmetric, solved in the same way.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, cached_property
from threading import Lock
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from fembridge.errors import UsageError
from fembridge.host.memory import check_memory
from fembridge.host.progress import advance
from fembridge.touching.compliance import Compliance, DenseCompliance, GridCompliance
from fembridge.touching.grid_contact import GridContactSolver
from fembridge.touching.pad import Pad, SkinNodes
from fembridge.touching.shape import Shape
from fembridge.typing import BoolArray, FloatArray, IntArray, SingleArray

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from threadpoolctl import ThreadpoolController

# Forces below this share of the largest are rounding; nodes may be inside the shape by
# this share of its depth, a nanometre or so: what single precision resolves.
_TOLERANCE = 1e-10
_INSIDE = 1e-5
# Under a force, so many nodes are first taken to touch: those nearest the shape.
_FIRST_NODES = 24
# Exchanges of all nodes at once that may fail to help before they go one by one.
_PATIENCE = 5
_MOST_EXCHANGES = 2_000
# From no contact on, so many nodes enter at most in the first exchange, twice as many in the
# next, and so on: a few nodes that carry all of a force go so deep that a thousand would enter,
# and most of them would leave again.
_FIRST_ENTRIES = 48
# Where more than this share of the nodes in contact leave, or more than this share enter, an
# inverse made anew takes less time than a change of the last one.
_MOST_LEAVE, _MOST_ENTER = 0.35, 1.0
# ... and after so many changes it is made anew for rounding.
_FRESH_CHANGES = 2_000
# Under a force, skin so far from the shape is first taken to be all that touches.
_FIRST_REACH_MM = 0.25
# ... of so many steps of a way, and that of the largest force.
_TRIED_STEPS = 3
# The deepest that superposition of small strains is meant for, and the deepest and the strongest
# touch with large strain (`fembridge.touching.large_strain`).
MOST_UM = 2_000.0
DEEPEST_UM, STRONGEST_N = 4_000.0, 5.0
MM_PER_UM = 1.0e-3
# So many steps of a way are in memory with the gaps of all nodes.
_STEPS_AT_ONCE = 256
# From so many nodes on that may touch, linear algebra takes all threads of the BLAS. Of fewer it
# waits for its threads for longer than they work: 1 s of a grating pressed with 0.5 N took
# twice the processor time, and on a busy machine several times the seconds (decision 0045).
_NODES_FOR_THREADS = 3_000
# More nodes than this are not solved as one dense problem.
MOST_NODES = 6_000


PressBy: TypeAlias = Callable[..., tuple[FloatArray, float]]
"""A contact that is solved time after time, as `ContactSolver.press_by`."""

GapsAt: TypeAlias = Callable[[IntArray, IntArray], FloatArray | SingleArray]
"""Ways down ``(step, n)`` in mm to some nodes, counted from 0, at some steps."""

ReachedBy: TypeAlias = Callable[[float], BoolArray]
"""Nodes ``(n,)`` that a depth in mm reaches."""


def press_to(
    pad: Pad, shape: Shape, level: FloatArray, *, by_force: bool = False
) -> tuple[SkinNodes, FloatArray, FloatArray]:
    """Nodes that `shape` touches, forces ``(S, node)`` in N and depths ``(S,)`` in um.

    `level` ``(S,)`` are depths in um from first touch, or with `by_force` forces.

    Raises
    ------
    UsageError
        A shape beside the pad, pressed too deep, or with too many nodes in contact.
    """
    nodes = pad.skin_nodes()
    gap_mm = nodes.gaps_mm(shape) - pad.first_touch_mm(shape)
    most = float(level.max())
    reach_mm = depth_of_force_mm(nodes, gap_mm, most) if by_force else most * MM_PER_UM
    reached = np.asarray(gap_mm < reach_mm)
    nodes, gap_mm = nodes.subset(reached), gap_mm[reached]
    forces = np.empty((level.size, gap_mm.size))
    depth_um = np.array(level, dtype=np.float64)
    contact = ContactSolver.on_nodes(nodes)
    with blas_threads(contact.nodes_at_once):
        for step, pressed in enumerate(level.tolist()):
            forces[step], depth_mm = contact.press_by(gap_mm, pressed, by_force=by_force)
            depth_um[step] = max(depth_mm / MM_PER_UM, 0.0) if by_force else pressed
            advance("contact", (step + 1) / level.size)
    return nodes, forces, depth_um


@dataclass(frozen=True, slots=True, eq=False)
class PressedSteps:
    """Contact step by step: single precision forces ``(S, node)`` in N on the `nodes` pressed.

    `total_n` and `depth_um` ``(S,)`` are those of the shape.
    """

    nodes: SkinNodes
    forces_n: SingleArray
    total_n: FloatArray
    depth_um: FloatArray


def press_steps(
    nodes: SkinNodes,
    gaps_at: GapsAt,
    reached_by: ReachedBy,
    level: FloatArray,
    *,
    by_force: bool = False,
    drag: tuple[float, float] = (0.0, 0.0),
    over_time: "Callable[[ContactSolver | GridContactSolver], PressBy] | None" = None,
    lasting_share: float = 1.0,
) -> PressedSteps:
    """Contact of a shape that moves over `nodes`, a part of the steps after the other.

    Parameters
    ----------
    gaps_at
        Makes the gaps ``(step, n)`` of some nodes at some steps.
    reached_by
        Which nodes have a gap below a depth in mm at any step.
    level
        ``(S,)``: depths in um from where the gaps are 0, or with `by_force` forces in N.
    drag
        The force along x and z that comes with 1 N into the skin.
    over_time
        Makes the contact of skin that has a memory from that of elastic skin.
    lasting_share
        Share of its stiffness that such skin keeps: under a force it yields so much more.

    Raises
    ------
    UsageError
        Pressed too deep, too many nodes in contact, or too many of them over too many steps
        for the memory (`fembridge.host.memory`).
    """
    all_rows = np.arange(nodes.size)
    if by_force:
        evenly = np.linspace(0, level.size - 1, _TRIED_STEPS).round().astype(int)
        tried = np.unique([*evenly, int(level.argmax())])
        reach_mm, above_first_mm = 0.0, _FIRST_REACH_MM
        for step, gap in zip(tried, gaps_at(all_rows, tried), strict=True):
            if level[step] > 0 and np.isfinite(gap).any():
                force_n = float(level[step]) / lasting_share
                depth_mm = depth_of_force_mm(nodes, gap.astype(np.float64), force_n, above_first_mm)
                above_first_mm = max(above_first_mm, 1.1 * (depth_mm - float(gap.min())))
                reach_mm = max(reach_mm, depth_mm)
    else:
        reach_mm = float(level.max()) * MM_PER_UM
    while True:
        steps, deepest_mm = _press_reached(
            nodes,
            gaps_at,
            all_rows[reached_by(reach_mm)],
            reach_mm,
            level,
            by_force,
            drag,
            over_time,
        )
        if steps is not None:
            return steps
        reach_mm = max(1.2 * deepest_mm, 1.5 * reach_mm)  # at none of the tried steps so deep


def _press_reached(
    all_nodes: SkinNodes,
    gaps_at: GapsAt,
    reached: IntArray,
    reach_mm: float,
    level: FloatArray,
    by_force: bool,
    drag: tuple[float, float],
    over_time: "Callable[[ContactSolver | GridContactSolver], PressBy] | None",
) -> tuple[PressedSteps | None, float]:
    """`press_steps` on the nodes that are `reached`, and the depth in mm.

    None where a force presses deeper than `reach_mm`, so that other nodes may touch.
    """
    nodes, count = all_nodes.subset(reached), reached.size
    subject = f"contact of {level.size} steps on up to {count} nodes"
    total_n, depth_um = np.empty(level.size), np.array(level, dtype=np.float64)
    parts: list[tuple[IntArray, SingleArray]] = []  # the nodes pressed, and their forces
    held_bytes = 0
    contact = ContactSolver.on_nodes(nodes, drag)
    with blas_threads(contact.nodes_at_once):
        press_by = contact.press_by if over_time is None else over_time(contact)
        for first in range(0, level.size, _STEPS_AT_ONCE):
            steps = np.arange(first, min(first + _STEPS_AT_ONCE, level.size))
            forces = np.empty((steps.size, count), dtype=np.float32)
            for step, row, gap in zip(steps, forces, gaps_at(reached, steps), strict=True):
                advance("contact", int(step) / level.size)
                force, depth_mm = press_by(
                    gap.astype(np.float64), float(level[step]), by_force=by_force
                )
                row[:], total_n[step] = force, force.sum()
                if by_force:
                    depth_um[step] = depth_mm / MM_PER_UM
                    if not depth_um[step] <= MOST_UM:
                        raise _too_deep(float(level[step]))
                    if depth_mm > reach_mm and count < all_nodes.size:
                        return None, depth_mm
            columns = np.flatnonzero(forces.any(axis=0))
            parts.append((columns, forces[:, columns]))
            held_bytes += parts[-1][1].nbytes
            check_memory(2 * held_bytes, subject, UsageError)
    pressed = np.zeros(count, dtype=bool)
    advance("contact", 1.0)
    for columns, _ in parts:
        pressed[columns] = True
    at = np.cumsum(pressed) - 1
    check_memory(held_bytes + 4 * level.size * int(pressed.sum()), subject, UsageError)
    forces_n = np.zeros((level.size, int(pressed.sum())), dtype=np.float32)
    for first in range(0, level.size, _STEPS_AT_ONCE):
        columns, forces = parts.pop(0)
        forces_n[first : first + len(forces), at[columns]] = forces
    return PressedSteps(nodes.subset(pressed), forces_n, total_n, depth_um), reach_mm


def depth_of_force_mm(
    nodes: SkinNodes, gap_mm: FloatArray, force_n: float, reach_mm: float = _FIRST_REACH_MM
) -> float:
    """Depth at which `force_n` is reached, with a margin; gaps may be anything >= 0.

    Skin up to `reach_mm` from the shape is first taken to be all that touches.
    """
    first_mm = float(gap_mm.min())
    while reach_mm < 2 * MOST_UM * MM_PER_UM:
        near = gap_mm < first_mm + reach_mm
        contact = ContactSolver.on_nodes(nodes.subset(near))
        with blas_threads(contact.nodes_at_once):
            _, depth_mm = contact.press_with(gap_mm[near] - first_mm, force_n)
        if depth_mm < 0.8 * reach_mm:
            return first_mm + 1.2 * depth_mm
        reach_mm = max(2 * reach_mm, 1.3 * depth_mm) if depth_mm < MOST_UM else np.inf
    raise _too_deep(force_n)


def _too_deep(force_n: float) -> UsageError:
    return UsageError(
        f"{force_n:g} N presses the shape deeper than {MOST_UM:g} um, expected less force"
    )


@contextmanager
def blas_threads(nodes: int = 0) -> Iterator[None]:
    """One thread of the BLAS while fewer than `_NODES_FOR_THREADS` `nodes` are solved together.

    The limit is that of the process: while several Python threads are inside, the first one
    sets it and the last one takes it back.
    """
    if nodes >= _NODES_FOR_THREADS:
        yield
        return
    _one_thread.enter()
    try:
        yield
    finally:
        _one_thread.leave()


class _OneThread:
    """The limit of `blas_threads`, and how many are inside."""

    def __init__(self) -> None:
        self._lock, self._inside = Lock(), 0
        self._limit: AbstractContextManager[object] | None = None

    def enter(self) -> None:
        """Set the limit, unless it is set."""
        with self._lock:
            self._inside += 1
            if self._inside == 1:
                self._limit = _blas_libraries().limit(limits=1, user_api="blas")

    def leave(self) -> None:
        """Take the limit back once nobody is inside."""
        with self._lock:
            self._inside -= 1
            if self._limit is not None and not self._inside:
                self._limit.__exit__(None, None, None)
                self._limit = None


_one_thread = _OneThread()


@cache
def _blas_libraries() -> "ThreadpoolController":
    """The libraries of NumPy and SciPy with threads; finding them takes 6 ms, so once."""
    import scipy.linalg  # noqa: F401 - its library is then loaded
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


class ContactSolver:
    """Contact on a compliance, solved time after time from the last.

    `exchanges` counts how often nodes entered or left.
    """

    def __init__(self, compliance: Compliance) -> None:
        self._compliance = compliance
        self._set = _ActiveSet(compliance)
        self.exchanges = 0

    @property
    def nodes_at_once(self) -> int:
        """Most nodes that are solved together, for `blas_threads`."""
        return self._compliance.size

    @classmethod
    def on_nodes(
        cls, nodes: SkinNodes, drag: tuple[float, float] = (0.0, 0.0)
    ) -> "ContactSolver | GridContactSolver":
        """Contact of `nodes` of a pad; on a fine grid by conjugate gradients.

        Raises
        ------
        UsageError
            More than `MOST_NODES` that are not on a grid.
        """
        if not nodes.size:
            return cls(DenseCompliance(np.zeros((0, 0))))
        compliance = nodes.compliance(drag)
        if isinstance(compliance, GridCompliance):
            return GridContactSolver(compliance)
        if nodes.size > MOST_NODES:
            raise UsageError(
                f"{nodes.size} nodes may touch, expected at most {MOST_NODES}: "
                "take a smaller shape, less depth or a coarser pad"
            )
        return cls(compliance)

    def press_by(
        self, gap_mm: FloatArray, level: float, *, by_force: bool
    ) -> tuple[FloatArray, float]:
        """Forces ``(n,)`` in N and depth in mm, by `level` um or with `by_force` by `level` N."""
        if by_force:
            return self.press_with(gap_mm, level)
        return self.press(level * MM_PER_UM - gap_mm), level * MM_PER_UM

    def press(self, overlap_mm: FloatArray) -> FloatArray:
        """Forces ``(n,)`` in N where the shape is `overlap_mm` ``(n,)`` into the skin.

        An overlap of ``-inf`` is a node that no shape is over.
        """
        return self._solve(overlap_mm, None)[0]

    def press_with(self, gap_mm: FloatArray, force_n: float) -> tuple[FloatArray, float]:
        """Forces ``(n,)`` in N of a shape pressed with `force_n`, and its depth in mm."""
        if force_n <= 0:
            return np.zeros(gap_mm.size), 0.0
        return self._solve(-gap_mm, force_n)

    def moved_mm(self, force: FloatArray) -> FloatArray:
        """How far each node goes into the skin under `force` ``(n,)`` of any sign, in mm."""
        moved: FloatArray = self._matrix @ force
        return moved

    @cached_property
    def _matrix(self) -> FloatArray:
        """The compliance in double precision, ``(n, n)``."""
        return self._compliance.matrix

    def _solve(self, overlap_mm: FloatArray, force_n: float | None) -> tuple[FloatArray, float]:
        active = self._set
        count = overlap_mm.size
        most_entries = count if active.rows.size else _FIRST_ENTRIES
        possible = np.isfinite(overlap_mm)
        if not possible.any():
            active.keep(possible)
            return np.zeros(count), 0.0
        overlap = np.where(possible, overlap_mm, 0.0)
        if force_n is None:
            scale = max(float(overlap.max(initial=0.0)), 1e-12)
            if not (overlap > 0).any():
                active.keep(np.zeros(count, dtype=bool))
                return np.zeros(count), 0.0
            possible &= overlap > 0
            if not active.rows.size:  # of a round shape the skin follows about so far
                active.enter(np.flatnonzero(overlap > 0.5 * scale))
        elif not active.rows.size:
            active.enter(np.argsort(overlap_mm)[-_FIRST_NODES:])
        active.keep(possible)
        depth_mm, best, patience = 0.0, count + 1, _PATIENCE
        for _ in range(_MOST_EXCHANGES):
            rows = active.rows
            force = np.zeros(count)
            if force_n is None:
                force[rows] = active.inverse @ overlap[rows]
            else:
                solution = active.inverse @ np.stack([np.ones(rows.size), overlap[rows]], -1)
                depth_mm = (force_n - solution[:, 1].sum()) / solution[:, 0].sum()
                force[rows] = solution[:, 1] + depth_mm * solution[:, 0]
                scale = abs(depth_mm) + 1e-12
            inside_mm = overlap + depth_mm - self._compliance.moved_mm(rows, force)
            inside_mm[rows] = 0.0
            enter = possible & (inside_mm > _INSIDE * scale)
            leave = force < -_TOLERANCE * float(np.abs(force).max(initial=0.0))
            wrong = int(enter.sum() + leave.sum())
            if not wrong:
                return np.maximum(force, 0.0), depth_mm
            self.exchanges += 1
            if wrong < best:
                best, patience = wrong, _PATIENCE
            else:
                patience -= 1
            if patience < 0:  # one at a time, the last of all: this cannot cycle
                last = int(np.flatnonzero(enter | leave)[-1])
                enter, leave = (
                    (np.arange(count) == last) & enter,
                    (np.arange(count) == last) & leave,
                )
            if enter.sum() > most_entries:
                deepest = np.argpartition(np.where(enter, -inside_mm, np.inf), most_entries)
                enter[deepest[most_entries:]] = False
            most_entries *= 2
            if leave.sum() == rows.size and not enter.any():  # never none at all by force
                leave[rows[force[rows].argmax()]] = False
            active.exchange(enter, leave)
        raise UsageError("the contact did not settle: take a finer pad or less friction")


class _ActiveSet:
    """Nodes in contact, `rows` in any order, and the inverse of the compliance over them.

    The inverse is the upper left part of a buffer in which it shrinks and grows: what is
    taken out is first swapped to the end.
    """

    def __init__(self, compliance: Compliance) -> None:
        self.compliance = compliance
        self._buffer = np.empty((compliance.size, compliance.size))
        self.rows: IntArray = np.zeros(0, dtype=np.int64)
        self._changes = 0

    @property
    def inverse(self) -> FloatArray:
        """Inverse ``(rows, rows)`` of the compliance."""
        return self._buffer[: self.rows.size, : self.rows.size]

    def keep(self, possible: BoolArray) -> None:
        """Let those go that are not `possible`."""
        gone = np.zeros(possible.size, dtype=bool)
        gone[self.rows] = ~possible[self.rows]
        if gone.any():
            self.exchange(np.zeros_like(gone), gone)

    def enter(self, rows: IntArray) -> None:
        """Take further `rows` in."""
        is_entering = np.zeros(self.compliance.size, dtype=bool)
        is_entering[rows] = True
        self.exchange(is_entering, np.zeros_like(is_entering))

    def exchange(self, enter: BoolArray, leave: BoolArray) -> None:
        """Take nodes in and out ``(n,)``."""
        new = np.flatnonzero(enter)
        out = np.flatnonzero(leave[self.rows])
        self._changes += new.size + out.size
        stay = self.rows.size - out.size
        if (
            out.size > _MOST_LEAVE * self.rows.size
            or new.size > _MOST_ENTER * stay
            or self._changes > _FRESH_CHANGES
        ):
            self.rows = np.concatenate([np.delete(self.rows, out), new])
            self.inverse[:] = np.linalg.inv(self.compliance.block(self.rows, self.rows))
            self._changes = 0
            return
        if out.size:
            self._shrink(out)
        if new.size:
            self._grow(new)

    def _shrink(self, out: IntArray) -> None:
        stay = self.rows.size - out.size
        # Those to go that stand before `stay`, with those to stay that stand after it.
        hole = out[out < stay]
        tail = np.setdiff1d(np.arange(stay, self.rows.size), out)
        before, after = np.concatenate([hole, tail]), np.concatenate([tail, hole])
        inverse = self.inverse
        self.rows[before] = self.rows[after]
        inverse[before] = inverse[after]
        inverse[:, before] = inverse[:, after]
        block = np.linalg.solve(inverse[stay:, stay:], inverse[stay:, :stay])
        inverse[:stay, :stay] -= inverse[:stay, stay:] @ block
        self.rows = self.rows[:stay]

    def _grow(self, new: IntArray) -> None:
        old, size = self.rows, self.rows.size
        inverse = self.inverse
        block = self.compliance.block
        right, beside = inverse @ block(old, new), block(new, old)
        below = beside @ inverse
        corner = np.linalg.inv(block(new, new) - beside @ right)
        side = right @ corner
        inverse += side @ below
        self.rows = np.concatenate([old, new])
        grown = self.inverse
        grown[:size, size:] = -side
        grown[size:, :size] = -corner @ below
        grown[size:, size:] = corner
