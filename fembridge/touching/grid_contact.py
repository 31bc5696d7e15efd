"""Contact on a fine grid of ten thousand nodes: conjugate gradients on an active set.

The problem is that of `fembridge.touching.contact`; here the compliance is an operator, applied by
FFT (`GridCompliance`). As in Polonsky & Keer (1999, Wear 231:206) conjugate gradients improve the
forces on the nodes in contact; whenever these are ten times as near to the shape, nodes that
would be pulled leave and nodes inside the shape enter. A prescribed force is a constraint on the
steps, whose multiplier is the depth.

Soft tissue under a stiff skin makes long waves 1000 times as compliant as short ones, so
the gradients are preconditioned: a few hundred nodes in contact by their own compliance, so that
two steps are enough; more of them on two levels, each node by itself, and those of each block of
`_BLOCK` x `_BLOCK` as one.
"""

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
# Blocks are factorised anew where the counts of nodes in contact changed by more than this share.
_CHANGED_SHARE = 0.3
# A force this share off the prescribed one is corrected.
_SAME_FORCE = 1e-4
# So few nodes in contact are solved together instead of by blocks.
_FEW_NODES = 600
# Friction is that of the forces before; from no contact on it is taken so many times.
_FIRST_ROUNDS = 4
# From no contact on, skin so far from the shape is taken to touch under a force, and each node
# has so much force at least.
_FIRST_MM, _LEAST_N = 0.05, np.float32(1e-6)
# Weight of the compliance of single nodes beside that of blocks.
_LOCAL = 0.5


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
        self.steps = 0

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
        gap = np.full(self._shape, np.inf, dtype=np.float32)
        gap.flat[self._at] = gap_mm
        possible = np.isfinite(gap)
        if force_n is None:
            possible &= gap < 0
        if not possible.any():
            self._forces[:] = self._moved[:] = 0.0
            return np.zeros(gap_mm.size), 0.0
        gap[~np.isfinite(gap)] = 0.0
        forces, drag_moved_mm = self._forces, self._compliance.drag_moved_mm
        has_left = forces[~possible].any()
        forces[~possible] = 0.0
        is_first = not forces.any()
        if is_first:
            forces[:] = self._blocks.first_forces(gap, possible, force_n)
        if is_first or has_left:
            self._moved[:] = self._compliance.apply_mm(forces)
        if is_first:  # forces from which friction can be taken
            depth_mm = self._gradients(gap, possible, force_n)
        for _ in range(_FIRST_ROUNDS if is_first else 1):
            moved_by_drag = drag_moved_mm(forces)
            if moved_by_drag is not None:
                depth_mm = self._gradients(gap + moved_by_drag, possible, force_n)
            elif not is_first:
                depth_mm = self._gradients(gap, possible, force_n)
        pressed: FloatArray = forces.ravel()[self._at].astype(np.float64)
        if force_n is not None:
            pressed *= force_n / pressed.sum()
        return pressed, depth_mm

    def _gradients(self, gap: SingleArray, possible: BoolArray, force_n: float | None) -> float:
        """Improve the forces until all nodes are right; the depth where a force is prescribed."""
        forces, moved, blocks = self._forces, self._moved, self._blocks
        own_mm = self._compliance.own_mm
        active = forces > 0
        depth, total = 0.0, float(forces.sum(dtype=np.float64))
        for _ in range(_MOST_EXCHANGES):
            blocks.set_contact(active)
            if force_n is not None and abs(total - force_n) > _SAME_FORCE * force_n:
                even = blocks.even * ((force_n - total) / blocks.even_sum)
                forces += even
                moved += self._compliance.apply_mm(even)
            limit = _TOLERANCE * own_mm * (force_n or total or 1e-6) / int(active.sum())
            depth, worst = self._on_contact(gap, active, limit, force_n)
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
        self, gap: SingleArray, active: BoolArray, limit: float, force_n: float | None
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
                goal = max(limit, _INEXACT * worst)
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
