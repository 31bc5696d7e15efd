"""Contact on a fine grid of ten thousand nodes: conjugate gradients, or factors of few nodes.

The problem is that of `fembridge.touching.contact`; here the compliance is an operator, applied by
FFT (`GridCompliance`). From no contact on, and with many nodes in contact, as in Polonsky & Keer
(1999, Wear 231:206) conjugate gradients improve the
forces on the nodes in contact; whenever these are ten times as near to the shape, nodes that
would be pulled leave and nodes inside the shape enter. A prescribed force is a constraint on the
steps, whose multiplier is the depth.

Soft tissue under a stiff skin makes long waves 1000 times as compliant as short ones, so
the gradients are preconditioned: a few hundred nodes in contact by their own compliance, so that
two steps are enough; more of them on two levels, each node by itself, and those of each block of
`_BLOCK` x `_BLOCK` as one.

From one state of a touch to the next, a few hundred nodes in contact are solved directly
(`_NearNodes`): a shape meets only the tops of ridges, so the compliance among all nodes that were
ever in contact is a small matrix.
"""

from typing import NamedTuple

import numpy as np

from fembridge.errors import UsageError
from fembridge.touching.compliance import GridCompliance
from fembridge.typing import BoolArray, FloatArray, IntArray, SingleArray

# Nodes of a block along both axes.
_BLOCK = 8
# Nodes in contact may be off the shape, and others inside it, by this share of how far a node
# goes under the mean force of the nodes in contact.
_TOLERANCE = 0.02
# Steps of the conjugate gradients, and exchanges of nodes, at most.
_MOST_STEPS, _MOST_EXCHANGES = 60, 200
# Forces on the nodes in contact are improved by this factor before nodes enter or leave.
_INEXACT = 0.1
# After so many exchanges, which may then go round in circles under a wide plate on ridges, they
# are improved by more.
_PATIENCE, _LESS_INEXACT = 8, 0.02
# Blocks are factorised anew where the counts of nodes in contact changed by more than this share.
_CHANGED_SHARE = 0.3
# A force this share off the prescribed one is corrected.
_SAME_FORCE = 1e-4
# So few nodes in contact are solved together instead of by blocks.
_FEW_NODES = 600
# Friction is that of the forces before; from no contact on it is taken so many times.
_FIRST_ROUNDS = 4
# From no contact on, so many nodes touch at first, so many enter then, and so many touch at most.
_FIRST_NODES, _FIRST_ENTRIES, _FIRST_MOST = 200, 64, 1_000
# Then skin so far from the shape is taken to touch under a force, and each node
# has so much force at least.
_FIRST_MM, _LEAST_N = 0.05, np.float32(1e-6)
# Weight of the compliance of single nodes beside that of blocks.
_LOCAL = 0.5
# Of few nodes: that share of a displacement, and the share of the mean force that is none.
_NEAR_TOLERANCE, _NO_FORCE = 0.005, 0.0025
# Exchanges of few nodes before conjugate gradients take over.
_MOST_DIRECT = 30
# A factor is bordered for so many nodes that entered or left, or this share of its nodes.
_BORDER, _BORDER_SHARE, _BORDER_ROOM = 8, 0.25, 0.5
# Factors and states that are kept.
_MOST_FACTORS, _MOST_STATES = 24, 128
# Where states are compared, gaps above this count as it, and one node of so many counts.
_FAR_MM, _COMPARED = np.float32(0.2), 3
# Nodes so near to the shape become near nodes; of more than so many only those in contact stay.
_NEAR_MM, _MOST_NEAR = 0.02, 1_200
# Nodes that may have come near, from which on the displacements of all are computed.
_MANY_UNSURE = 100
# Nodes of a block along both axes, of which one is a sample of displacements.
_SAMPLE = 4


class GridContactSolver:
    """Contact on a `GridCompliance`, solved time after time from the last forces.

    `steps` counts steps of the conjugate gradients.
    """

    def __init__(self, compliance: GridCompliance) -> None:
        self._compliance = compliance
        self._shape, self._at = compliance.shape, compliance.at
        # Forces on the window, and the displacements under them.
        self._forces = np.zeros(self._shape, dtype=np.float32)
        self._moved = np.zeros(self._shape, dtype=np.float32)
        self._blocks = _Blocks(compliance)
        self._near = _NearNodes(compliance)
        self._has_moved = True
        self.steps = 0

    @property
    def nodes_at_once(self) -> int:
        """Most nodes that are solved together, for `fembridge.touching.contact.blas_threads`."""
        return _FIRST_MOST

    def press_by(
        self, gap_mm: FloatArray, level: float, *, by_force: bool
    ) -> tuple[FloatArray, float]:
        """Forces ``(n,)`` in N and depth in mm, as those of `ContactSolver.press_by`."""
        if by_force:
            return self.press_with(gap_mm, level)
        return self.press(1e-3 * level - gap_mm), 1e-3 * level

    def press(self, overlap_mm: FloatArray) -> FloatArray:
        """Forces ``(n,)`` in N where the shape is `overlap_mm` ``(n,)`` into the skin."""
        return self._solve(-overlap_mm, None)[0]

    def press_with(self, gap_mm: FloatArray, force_n: float) -> tuple[FloatArray, float]:
        """Forces ``(n,)`` in N of a shape pressed with `force_n`, and its depth in mm."""
        if force_n <= 0:
            return np.zeros(gap_mm.size), 0.0
        return self._solve(gap_mm, float(force_n))

    def moved_mm(self, force: FloatArray) -> FloatArray:
        """How far each node goes into the skin under `force` ``(n,)`` of any sign, in mm."""
        return self._compliance.moved_mm(np.arange(force.size), force)

    def _solve(self, gap_mm: FloatArray, force_n: float | None) -> tuple[FloatArray, float]:
        gap: SingleArray = np.asarray(gap_mm, dtype=np.float32)
        possible = np.isfinite(gap)
        if not possible.all():
            gap = np.where(possible, gap, np.float32(0))
        if force_n is None:
            possible &= gap < 0
        if not possible.any():
            self._forces[:] = self._moved[:] = 0.0
            self._near.clear()
            return np.zeros(gap.size), 0.0
        near = self._near
        begin = near.solve if near.is_loaded or self._forces.any() else near.start
        depth_mm = begin(gap, possible, force_n)
        if depth_mm is not None:
            self._has_moved = False
            pressed = self._near.pressed_n()
        else:
            if self._near.is_loaded:
                self._forces.flat[self._at] = self._near.pressed_n()
            pressed, depth_mm = self._improve(gap, possible, force_n)
            self._near.restart(self._forces, self._moved)
        if force_n is not None:
            pressed *= force_n / pressed.sum()
        return pressed, depth_mm

    def _improve(
        self, gap_mm: SingleArray, possible_nodes: BoolArray, force_n: float | None
    ) -> tuple[FloatArray, float]:
        """Forces by conjugate gradients, and the depth."""
        gap = np.zeros(self._shape, dtype=np.float32)
        possible = np.zeros(self._shape, dtype=bool)
        gap.flat[self._at], possible.flat[self._at] = gap_mm, possible_nodes
        forces, drag_moved_mm = self._forces, self._compliance.drag_moved_mm
        has_left = forces[~possible].any()
        forces[~possible] = 0.0
        is_first = not forces.any()
        if is_first:
            forces[:] = self._blocks.first_forces(gap, possible, force_n)
        if is_first or has_left or not self._has_moved:
            self._moved[:] = self._compliance.apply_mm(forces)
            self._has_moved = True
        depth_mm = 0.0
        if is_first:  # forces from which friction can be taken
            depth_mm = self._gradients(gap, possible, force_n)
        for _ in range(_FIRST_ROUNDS if is_first else 1):
            moved_by_drag = drag_moved_mm(forces)
            if moved_by_drag is not None:
                depth_mm = self._gradients(gap + moved_by_drag, possible, force_n)
            elif not is_first:
                depth_mm = self._gradients(gap, possible, force_n)
        pressed: FloatArray = forces.ravel()[self._at].astype(np.float64)
        return pressed, depth_mm

    def _gradients(self, gap: SingleArray, possible: BoolArray, force_n: float | None) -> float:
        """Improve the forces until all nodes are right; the depth where a force is prescribed."""
        forces, moved, blocks = self._forces, self._moved, self._blocks
        own_mm = self._compliance.own_mm
        active = forces > 0
        depth, total = 0.0, float(forces.sum(dtype=np.float64))
        for number in range(_MOST_EXCHANGES):
            blocks.set_contact(active)
            if force_n is not None and abs(total - force_n) > _SAME_FORCE * force_n:
                even = blocks.even * ((force_n - total) / blocks.even_sum)
                forces += even
                moved += self._compliance.apply_mm(even)
            limit = _TOLERANCE * own_mm * (force_n or total or 1e-6) / int(active.sum())
            inexact = _INEXACT if number < _PATIENCE else _LESS_INEXACT
            depth, worst = self._on_contact(gap, active, limit, force_n, inexact)
            leaving = forces < 0
            inside = possible & ~active & (moved + gap < depth - limit)
            if not (leaving.any() or inside.any()) and worst <= limit:
                return depth
            if leaving.any():
                forces[leaving] = 0.0
                moved[:] = self._compliance.apply_mm(forces)
            active = (active & ~leaving) | inside
            if not active.any():
                return depth
            total = float(forces.sum(dtype=np.float64))
        raise UsageError("the contact did not settle: take a finer pad or less friction")

    def _on_contact(
        self,
        gap: SingleArray,
        active: BoolArray,
        limit: float,
        force_n: float | None,
        inexact: float,
    ) -> tuple[float, float]:
        """Conjugate gradients on nodes in contact, of any sign; depth, and the last residual."""
        forces, moved, blocks = self._forces, self._moved, self._blocks
        depth, last, worst, goal = 0.0, 0.0, 0.0, limit
        direction = np.zeros_like(forces)
        for number in range(_MOST_STEPS):
            residual = np.where(active, -(moved + gap), np.float32(0))
            steep = blocks.precondition(residual, active)
            if force_n is not None:
                depth = -float(np.vdot(residual, blocks.even)) / blocks.even_sum
                steep += depth * blocks.even
                residual = np.where(active, residual + depth, np.float32(0))
            worst = float(np.abs(residual).max())
            if number == 0:
                goal = max(limit, inexact * worst)
            if worst <= goal:
                break
            self.steps += 1
            product = float(np.vdot(residual, steep))
            direction *= product / last if last else 0.0
            direction += steep
            last = product
            change = self._compliance.apply_mm(direction)
            rate = product / float(np.vdot(direction, change))
            forces += rate * direction
            moved += rate * change
        return depth, worst


class _NearNodes:
    """Nodes that were in contact or near it, with the compliance among them; solved directly.

    A primal-dual active set: the nodes in contact follow the shape exactly, by the Cholesky factor
    of their compliance; those that would be pulled leave, those inside the shape enter. For a few
    that entered or left the factor is bordered instead of made anew.

    Other nodes, the far ones, are not solved in each step. A far node has risen, since the
    operator was last applied to all nodes, by no more than the near nodes and samples within a
    block of it: a sample is a node in each block of `_SAMPLE` x `_SAMPLE`. Where that does not show
    that it is off the shape, it becomes a near one; for many, the operator is applied again first.
    """

    def __init__(self, compliance: GridCompliance) -> None:
        self._compliance = compliance
        block = np.stack(np.divmod(compliance.at, compliance.shape[1])) // _SAMPLE + 1
        counts = block.max(axis=1) + 2  # with a margin around
        self._block: IntArray = block[0] * counts[1] + block[1]
        self._counts = int(counts[0]), int(counts[1])
        self._samples = np.unique(self._block, return_index=True)[1]
        # Compliance of near nodes, with room for more, and with friction its displacements:
        # (force, node), and of the samples (force, sample).
        kinds = 2 if compliance.has_drag else 1
        self._store: SingleArray = np.empty((kinds, 0, 0), dtype=np.float32)
        self._sample_store: SingleArray = np.empty((kinds, 0, self._samples.size), dtype=np.float32)
        self.clear()

    def clear(self) -> None:
        """Forget all nodes: nothing is in contact."""
        empty = np.zeros(0, dtype=np.float32)
        self._rows: IntArray = np.zeros(0, dtype=np.int64)
        self._is_far: BoolArray = np.ones(self._compliance.size, dtype=bool)
        self._force = self._moved = empty
        self._factors, self._states = _Factors(), _States()
        # Displacements of all nodes when they were last computed.
        self._all_mm = empty
        self._limit_mm = 0.0
        self.is_loaded = False

    def restart(self, forces: SingleArray, moved: SingleArray) -> None:
        """Take `forces` on the window, and displacements under them, for the next step."""
        self.clear()
        at = self._compliance.at
        on_nodes = forces.ravel()[at]
        rows = np.flatnonzero(on_nodes > 0)
        if not 0 < rows.size <= _FEW_NODES:
            return
        self._add(rows)
        self._force[:] = on_nodes[rows]
        self._all_mm = self._with_drag(moved, forces).ravel()[at]
        self.is_loaded = True

    def start(self, gap: SingleArray, possible: BoolArray, force_n: float | None) -> float | None:
        """Depth in mm of the first state, as of `solve`.

        The nodes nearest to the shape are taken to touch; of those that are then inside the shape
        the deepest enter, more each time (decision 0045).
        """
        self.clear()
        least_mm = float(gap[possible].min())
        reach_mm = least_mm + _FIRST_MM if force_n is not None else 0.5 * least_mm
        rows = np.flatnonzero(possible & (gap < reach_mm))
        self._add(_least(rows, gap, _FIRST_NODES))
        self._force[:] = 1.0
        last, most, depth = np.zeros_like(self._force), _FIRST_ENTRIES, 0.0
        for _ in range(_FIRST_ROUNDS if self._compliance.has_drag else 1):
            for _ in range(_MOST_DIRECT):
                drag_mm = self._dragged_mm(last)
                near_gap = gap[self._rows] + drag_mm
                solved = self._exchange(near_gap, possible[self._rows], force_n, _FIRST_MOST)
                if solved is None:
                    self.clear()
                    return None
                depth = solved
                self._move_all(last)
                away_mm = self._all_mm + gap - np.float32(depth)
                rows = np.flatnonzero(possible & self._is_far & (away_mm < -self._limit_mm))
                if not rows.size:
                    break
                last = np.append(last, self._add(_least(rows, away_mm, most)))
                most += most // 2
            last = self._force.copy()
        self.is_loaded = True
        return depth

    def pressed_n(self) -> FloatArray:
        """Forces on all nodes in N, ``(n,)``."""
        pressed = np.zeros(self._compliance.size)
        pressed[self._rows] = self._force
        return pressed

    def solve(self, gap: SingleArray, possible: BoolArray, force_n: float | None) -> float | None:
        """Depth in mm of the next state; None if it has to be solved by conjugate gradients.

        `gap` is ``(n,)``. Forces are then those before.
        """
        if not self.is_loaded:
            return None
        if self._rows.size > _MOST_NEAR:
            self._focus()
        last = self._force.copy()
        for _ in range(_MOST_DIRECT):
            drag_mm = self._dragged_mm(last)
            near_gap = gap[self._rows] + drag_mm
            depth = self._exchange(near_gap, possible[self._rows], force_n)
            if depth is None:
                break
            far = possible & self._is_far
            rows = np.flatnonzero(
                far & (self._all_mm + gap < depth + self._risen_mm(drag_mm, last))
            )
            if rows.size > _MANY_UNSURE:
                self._move_all(last)
                rows = np.flatnonzero(far & (self._all_mm + gap < depth + _NEAR_MM))
            if not rows.size:
                return depth
            last = np.append(last, self._add(rows))
            moved = self._entries[-rows.size :] @ self._force
            self._moved = np.append(self._moved, moved)
            if self._compliance.has_drag:
                moved = moved + self._dragged_mm(last)[-rows.size :]
            if (moved + gap[rows] >= depth - self._limit_mm).all():
                return depth
        self._force = last[: self._force.size]
        return None

    def _risen_mm(self, drag_mm: SingleArray, last: SingleArray) -> SingleArray:
        """How far each node has risen at most since all were computed, about, ``(n,)``."""
        of_samples = _by_forces(self._force, self._sample_store[0])
        if self._compliance.has_drag:
            of_samples += _by_forces(last, self._sample_store[1])
        risen = np.zeros(self._counts, dtype=np.float32)
        risen.flat[self._block[self._samples]] = self._all_mm[self._samples] - of_samples
        of_near = self._all_mm[self._rows] - (self._moved + drag_mm)
        np.maximum.at(risen.reshape(-1), self._block[self._rows], of_near)
        for axis in range(2):  # the largest of each block and those around it
            around = np.swapaxes(risen, 0, axis)
            middle = np.maximum(around[:-2], around[2:])
            np.maximum(around[1:-1], middle, out=around[1:-1])
        return risen.ravel()[self._block]

    def _exchange(
        self,
        gap: SingleArray,
        possible: BoolArray,
        force_n: float | None,
        most: int = _FEW_NODES,
    ) -> float | None:
        """Solve the near nodes; their depth, None if more than `most` touch, or none."""
        force, own_mm = self._force, self._compliance.own_mm
        active = possible & (force > 0)
        if alike := self._states.nearest(gap):
            count = alike.force_n.size  # nodes that came near since then are as they were last
            predicted = possible[:count] & alike.predicted(gap[:count], own_mm)
            if predicted.any():
                active[:count] = predicted
        for _ in range(_MOST_DIRECT):
            rows = np.flatnonzero(active)
            if not 0 < rows.size <= most:
                return None
            solved = self._factors.solve(self._entries, rows, gap, force_n)
            if solved is None:
                return None
            force[:], self._moved, depth = solved
            mean_n = (float(force.sum()) if force_n is None else force_n) / rows.size
            self._limit_mm = _NEAR_TOLERANCE * own_mm * max(mean_n, 1e-9)
            leaving = force < -_NO_FORCE * mean_n
            inside = possible & ~active & (self._moved + gap < depth - self._limit_mm)
            if not (leaving.any() or inside.any()):
                np.maximum(force, 0.0, out=force)
                self._states.keep(gap, _State(force.copy(), self._moved, depth, self._limit_mm))
                return depth
            active = (active & (force > 0)) | inside
        return None

    def _add(self, rows: IntArray) -> SingleArray:
        """Take further nodes in; their forces, 0."""
        compliance, first, end = self._compliance, self._rows.size, self._rows.size + rows.size
        self._is_far[rows] = False
        self._rows = np.concatenate([self._rows, rows])
        self._reserve(end)
        pairs = [(compliance.entries_mm, self._store[0], self._sample_store[0])]
        if compliance.has_drag:
            pairs.append((compliance.drag_entries_mm, self._store[1], self._sample_store[1]))
        for entries_mm, table, of_samples in pairs:
            table[:end, first:end] = entries_mm(rows, self._rows).T
            table[first:end, :first] = entries_mm(self._rows[:first], rows).T
            of_samples[first:end] = entries_mm(self._samples, rows).T
        none = np.zeros(rows.size, dtype=np.float32)
        self._force = np.concatenate([self._force, none])
        return none

    def _reserve(self, count: int) -> None:
        """Make room for tables of `count` near nodes."""
        room = self._store.shape[1]
        if count > room:
            larger, kinds = max(count, 3 * room // 2), len(self._store)
            store = np.empty((kinds, larger, larger), dtype=np.float32)
            store[:, :room, :room] = self._store
            of_samples = np.empty((kinds, larger, self._samples.size), dtype=np.float32)
            of_samples[:, :room] = self._sample_store
            self._store, self._sample_store = store, of_samples

    @property
    def _entries(self) -> SingleArray:
        """Compliance of the near nodes, ``(force, node)``."""
        return self._store[0, : self._rows.size, : self._rows.size]

    def _dragged_mm(self, force: SingleArray) -> SingleArray:
        """Displacement of the near nodes by the friction of forces on them."""
        if not self._compliance.has_drag:
            return np.zeros(self._rows.size, dtype=np.float32)
        return _by_forces(force, self._store[1, :, : self._rows.size])

    def _focus(self) -> None:
        """Let all nodes go that are not in contact."""
        self._move_all(self._force)
        all_mm, in_contact = self._all_mm, self._force > 0
        rows, force = self._rows[in_contact], self._force[in_contact]
        self.clear()
        self._add(rows)
        self._force[:], self._all_mm, self.is_loaded = force, all_mm, True

    def _move_all(self, last: SingleArray) -> None:
        """Displacements of all nodes, with friction by the forces before."""
        compliance = self._compliance
        now, before = np.zeros((2, *compliance.shape), dtype=np.float32)
        now.flat[compliance.at[self._rows]] = self._force
        before.flat[compliance.at[self._rows]] = last
        moved = self._with_drag(compliance.apply_mm(now), before)
        self._all_mm = moved.ravel()[compliance.at]

    def _with_drag(self, moved: SingleArray, forces: SingleArray) -> SingleArray:
        by_drag = self._compliance.drag_moved_mm(forces)
        return moved if by_drag is None else moved + by_drag


def _by_forces(force: SingleArray, entries: SingleArray) -> SingleArray:
    """Sum of the rows of `entries` by the forces, most of which are 0."""
    (rows,) = force.nonzero()
    return force[rows] @ entries[rows]


def _least(rows: IntArray, values: SingleArray, most: int) -> IntArray:
    """Those `rows` whose `values` are least, `most` at most."""
    if rows.size <= most:
        return rows
    return rows[np.argpartition(values[rows], most)[:most]]


class _Factors:
    """Factors of the compliance of sets of near nodes, of which the nearest set is bordered.

    A texture that repeats meets the skin in sets of nodes that it met a period before.
    """

    def __init__(self) -> None:
        self._factors: list[_BorderedFactor] = []
        self._is_known: BoolArray = np.zeros((_MOST_FACTORS, 0), dtype=bool)
        self._next = 0

    def solve(
        self, entries: SingleArray, rows: IntArray, gap: SingleArray, force_n: float | None
    ) -> tuple[SingleArray, SingleArray, float] | None:
        """Forces of all nodes that take `rows` to the shape, displacements, and the depth.

        `entries` is the compliance of all near nodes, ``(force, node)``. None if that of `rows` is
        not positive. The depth is 0 where no force is prescribed.
        """
        if further := len(entries) - self._is_known.shape[1]:
            none = np.zeros((_MOST_FACTORS, further), dtype=bool)
            self._is_known = np.hstack([self._is_known, none])
        is_active = np.zeros(len(entries), dtype=bool)
        is_active[rows] = True
        if self._factors:
            differs = self._is_known[: len(self._factors)] != is_active
            nearest = int(np.count_nonzero(differs, axis=1).argmin())
            factor, changed = self._factors[nearest], np.flatnonzero(differs[nearest])
            if factor.takes(changed, len(entries)):
                return factor.solve(entries, changed, gap, force_n)
        return self._another(entries, rows, gap, force_n)

    def _another(
        self, entries: SingleArray, rows: IntArray, gap: SingleArray, force_n: float | None
    ) -> tuple[SingleArray, SingleArray, float] | None:
        from scipy.linalg.lapack import spotrf

        across = entries[rows]
        triangle, problem = spotrf(across[:, rows].T, lower=1, overwrite_a=1)
        if problem:
            return None
        factor = _BorderedFactor(triangle, across, rows)
        if len(self._factors) < _MOST_FACTORS:
            self._factors.append(factor)
        else:
            self._factors[self._next] = factor
        self._is_known[self._next] = False
        self._is_known[self._next, rows] = True
        self._next = (self._next + 1) % _MOST_FACTORS
        return factor.solve(entries, rows[:0], gap, force_n)


class _BorderedFactor:
    """Cholesky factor of the compliance of some nodes, bordered for others.

    Nodes that entered are further unknowns; a node that left has a force that makes its own 0::

        C f + J y = b,   J' f + D y = c

    J has the columns of nodes that entered, and a unit vector for each that left. The columns of
    C^-1 J and of J' C^-1 J - D are kept for each node that ever entered or left, so that a further
    exchange costs what it adds.
    """

    def __init__(self, triangle: SingleArray, across: SingleArray, rows: IntArray) -> None:
        count = across.shape[1]
        self._triangle, self._across, self._rows = triangle, across, rows
        self._is_known: BoolArray = np.zeros(count, dtype=bool)
        self._is_known[rows] = True
        self._place = np.full(count, -1)  # in `rows`
        self._place[rows] = np.arange(rows.size)
        self._column = np.full(count, -1)  # of a node that entered or left
        room = max(_BORDER, int(_BORDER_ROOM * rows.size))
        self._solved: SingleArray = np.empty((rows.size, room), dtype=np.float32, order="F")
        self._corner: SingleArray = np.empty((room, room), dtype=np.float32)
        self._count = 0

    def takes(self, changed: IntArray, count: int) -> bool:
        """Whether bordering for nodes that `changed`, of `count`, costs less than a factor."""
        if further := count - self._is_known.size:
            self._is_known = np.append(self._is_known, np.zeros(further, dtype=bool))
            self._place = np.append(self._place, np.full(further, -1))
            self._column = np.append(self._column, np.full(further, -1))
        added = int((self._column[changed] < 0).sum())
        return (
            changed.size <= max(_BORDER, _BORDER_SHARE * self._rows.size)
            and self._count + added <= self._solved.shape[1]
        )

    def solve(
        self, entries: SingleArray, changed: IntArray, gap: SingleArray, force_n: float | None
    ) -> tuple[SingleArray, SingleArray, float]:
        """Forces and displacements as those of `_Factors`, with the border of `changed`."""
        from scipy.linalg.lapack import sgesv, spotrs

        rows, reach = self._rows, self._across.shape[1]
        if reach < len(entries):
            self._across = np.hstack([self._across, entries[rows, reach:]])
        columns = 1 if force_n is None else 2
        right = np.ones((rows.size, columns), dtype=np.float32, order="F")
        right[:, 0] = -gap[rows]
        solved, _ = spotrs(self._triangle, right, lower=1, overwrite_b=1)
        forces = np.zeros((columns, len(entries)), dtype=np.float32)
        entering = changed
        if changed.size:
            self._border(entries, changed[self._column[changed] < 0])
            column, has_entered = self._column[changed], ~self._is_known[changed]
            entering, left = changed[has_entered], self._place[changed[~has_entered]]
            beyond = np.empty((changed.size, columns), dtype=np.float32)
            beyond[has_entered] = self._across[:, entering].T @ solved
            beyond[has_entered, 0] += gap[entering]
            beyond[has_entered, 1:] -= np.float32(1)
            beyond[~has_entered] = solved[left]
            _, _, further_n, _ = sgesv(self._corner[column][:, column], beyond)
            solved -= self._solved[:, column] @ further_n
            solved[left] = 0.0
            forces[:, entering] = further_n[has_entered].T
        forces[:, rows] = solved.T
        depth = 0.0
        if force_n is not None:
            of_gap, of_depth = forces.sum(axis=1, dtype=np.float64)
            depth = float((force_n - of_gap) / of_depth)
            forces[0] += np.float32(depth) * forces[1]
        force = forces[0]
        moved: SingleArray = force[rows] @ self._across
        if entering.size:
            moved += force[entering] @ entries[entering]
        return force, moved, depth

    def _border(self, entries: SingleArray, added: IntArray) -> None:
        """Take further nodes that entered or left into the border."""
        from scipy.linalg.lapack import spotrs

        if not added.size:
            return
        first, end = self._count, self._count + added.size
        has_entered = ~self._is_known[added]
        entering, left = added[has_entered], self._place[added[~has_entered]]
        columns = np.zeros((self._rows.size, added.size), dtype=np.float32, order="F")
        columns[:, has_entered] = self._across[:, entering]
        columns[left, np.flatnonzero(~has_entered)] = 1.0
        self._solved[:, first:end], _ = spotrs(self._triangle, columns, lower=1)
        self._column[added] = np.arange(first, end)
        corner = columns.T @ self._solved[:, :end]
        earlier = np.flatnonzero((self._column >= 0) & ~self._is_known)
        corner[np.ix_(has_entered, self._column[earlier])] -= entries[entering][:, earlier]
        self._corner[first:end, :end] = corner
        self._corner[:first, first:end] = corner[:, :first].T
        self._count = end


class _States:
    """States of the near nodes that were solved, to begin the next from the one most like it."""

    def __init__(self) -> None:
        self._gap: SingleArray = np.zeros((_MOST_STATES, 0), dtype=np.float32)
        self._solved: list[_State] = []
        self._next = 0

    def keep(self, gap: SingleArray, state: "_State") -> None:
        """Keep a state under the gaps of the near nodes."""
        gap = self._compared(gap)
        if further := gap.size - self._gap.shape[1]:
            far = np.full((_MOST_STATES, further), _FAR_MM, dtype=np.float32)
            self._gap = np.hstack([self._gap, far])
        if len(self._solved) < _MOST_STATES:
            self._solved.append(state)
        else:
            self._solved[self._next] = state
        self._gap[self._next] = gap
        self._next = (self._next + 1) % _MOST_STATES

    def nearest(self, gap: SingleArray) -> "_State | None":
        """The state whose gaps differ least, in sum of absolute differences."""
        if not self._solved:
            return None
        gap = self._compared(gap)[: self._gap.shape[1]]
        differs = np.abs(self._gap[: len(self._solved)] - gap).sum(axis=1)
        return self._solved[int(differs.argmin())]

    def _compared(self, gap: SingleArray) -> SingleArray:
        some: SingleArray = np.minimum(gap[::_COMPARED], _FAR_MM)
        return some


class _State(NamedTuple):
    """Forces and displacements of the near nodes, ``(node,)``, depth, and tolerance in mm."""

    force_n: SingleArray
    moved_mm: SingleArray
    depth_mm: float
    limit_mm: float

    def predicted(self, gap: SingleArray, own_mm: float) -> BoolArray:
        """Nodes in contact at other gaps ``(node,)``, as if each moved by itself.

        That finds the nodes where an edge of the shape has come or gone.
        """
        away_mm = self.moved_mm + gap - np.float32(self.depth_mm)
        pushed_n = self.force_n - away_mm / own_mm
        predicted: BoolArray = pushed_n > self.limit_mm / own_mm * (self.force_n <= 0)
        return predicted


class _Blocks:
    """The preconditioner: blocks of nodes of the window, and the factor over those in contact."""

    def __init__(self, compliance: GridCompliance) -> None:
        self._shape = compliance.shape
        self._counts = tuple(-(-count // _BLOCK) for count in self._shape)
        self._compliance = compliance
        self._compliance_mm = compliance.between_blocks_mm(_BLOCK)
        self._node_at = np.zeros(np.prod(self._shape), dtype=np.int64)
        self._node_at[compliance.at] = np.arange(compliance.size)
        self._direct: SingleArray | None = None
        self._rows: IntArray = np.zeros(0, dtype=np.int64)
        self._own_mm = compliance.own_mm
        self._in_contact: SingleArray = np.zeros(0, dtype=np.float32)
        self._used: IntArray = np.zeros(0, dtype=np.int64)
        self._inverse: SingleArray = np.zeros((0, 0), dtype=np.float32)
        self._touching: BoolArray | None = None
        self.even: SingleArray = np.zeros(0, dtype=np.float32)
        self.even_sum = 0.0
        self.factors = 0

    def set_contact(self, touching: BoolArray) -> None:
        """Take the nodes in contact; the factor is kept if their counts changed little."""
        if self._touching is not None and np.array_equal(touching, self._touching):
            return
        self._touching = touching
        self._direct = None
        if touching.sum() <= _FEW_NODES:
            self._factorise_nodes(touching)
        else:
            self._count_blocks(touching)
        self.even = self.precondition(touching.astype(np.float32), touching)
        self.even_sum = float(self.even.sum(dtype=np.float64))

    def _factorise_nodes(self, touching: BoolArray) -> None:
        from scipy.linalg.lapack import spotrf

        self.factors += 1
        self._rows = np.flatnonzero(touching)
        nodes = self._node_at[self._rows]
        factor, problem = spotrf(self._compliance.entries_mm(nodes, nodes), lower=1, overwrite_a=1)
        if problem:
            raise ValueError("the compliance of the nodes in contact is not positive")
        self._direct = factor

    def _count_blocks(self, touching: BoolArray) -> None:
        counts = self._sums(touching.astype(np.float32)).ravel()
        total = counts.sum()
        if (
            self._in_contact.size != counts.size
            or np.abs(counts - self._in_contact).sum() > _CHANGED_SHARE * total
        ):
            self._factorise(counts)

    def _factorise(self, counts: SingleArray) -> None:
        from scipy.linalg.lapack import spotrf, spotri

        self.factors += 1
        self._in_contact = counts
        self._used = np.flatnonzero(counts)
        used = counts[self._used].astype(np.float64)
        between = self._compliance_mm[np.ix_(self._used, self._used)] * np.outer(used, used)
        within = self._own_mm - self._compliance_mm[0, 0]
        between[np.diag_indices_from(between)] += used * max(within, 0.0)
        factor, problem = spotrf(between.astype(np.float32), lower=1)
        inverse, _ = spotri(factor, lower=1)
        if problem:
            raise ValueError("the compliance between blocks is not positive")
        self._inverse = np.tril(inverse) + np.tril(inverse, -1).T

    def precondition(self, residual: SingleArray, touching: BoolArray) -> SingleArray:
        """Forces that about undo `residual` on the nodes in contact."""
        if self._direct is not None:
            from scipy.linalg.lapack import spotrs

            solved = np.zeros_like(residual)
            solved.flat[self._rows], _ = spotrs(self._direct, residual.flat[self._rows], lower=1)
            return solved
        sums = self._sums(residual).ravel()
        on_blocks = np.zeros(sums.size, dtype=np.float32)
        on_blocks[self._used] = self._inverse @ sums[self._used]
        spread = np.repeat(np.repeat(on_blocks.reshape(self._counts), _BLOCK, 0), _BLOCK, 1)[
            : self._shape[0], : self._shape[1]
        ]
        forces = np.where(touching, spread + residual * (_LOCAL / self._own_mm), 0.0)
        return np.asarray(forces, dtype=np.float32)

    def first_forces(
        self, gap: SingleArray, possible: BoolArray, force_n: float | None
    ) -> SingleArray:
        """Forces to start from: on nodes nearest to the shape, or half as deep as it or more."""
        least_mm = float(gap[possible].min())
        if force_n is not None:
            near = possible & (gap < least_mm + _FIRST_MM)
            return np.where(near, np.float32(force_n / near.sum()), np.float32(0))
        deep = possible & (gap < 0.5 * least_mm)
        self.set_contact(deep)
        forces = self.precondition(np.where(deep, -gap, np.float32(0)), deep)
        return np.where(deep, np.maximum(forces, _LEAST_N), np.float32(0))

    def _sums(self, values: SingleArray) -> SingleArray:
        padded = np.zeros(tuple(_BLOCK * count for count in self._counts), dtype=np.float32)
        padded[: self._shape[0], : self._shape[1]] = values
        columns, rows = self._counts
        sums: SingleArray = padded.reshape(columns, _BLOCK, rows, _BLOCK).sum(axis=(1, 3))
        return sums
