"""Many parameter sets against many stimuli: the counts that a fit compares.

The current of 10 000 candidates, 37 conditions and 500 steps would take 1.5 GB; here
it is made row by row, block by block, and never leaves the cache. Counts equal the
number of spikes that `neural.lif.fire` finds, to the last one. With numba (the extra
``fast``) plain loops are compiled, else NumPy steps blocks of membranes.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import ParameterError, TraceError
from fembridge.typing import BoolArray, FloatArray, IntArray
from neural.lif import Membrane, State, spiking
from neural.models import Coefficients

# First row in which spikes count and the row after the last, ``(condition,)`` each or
# numbers.
Window: TypeAlias = tuple[ArrayLike, ArrayLike]

# Membranes stepped together: the 30 bytes that a step touches of each stay in a
# cache of 1 MiB, and what NumPy costs a call is shared by many.
BLOCK = 16_384

_NOT_FINITE = "a current that is not finite reached a membrane"


def candidate_counts(
    drives: Sequence[ArrayLike],
    coefficients: Coefficients,
    membrane: Membrane,
    *,
    window: Window | None = None,
    single: bool = False,
) -> IntArray:
    """Count the spikes of each candidate under each condition.

    Parameters
    ----------
    drives
        The filtered stress of one afferent class, ``(T, condition)`` each, one or
        two.
    coefficients
        What makes them a current; its entries are a number a candidate, or numbers that
        all share.
    membrane
        Its `decay`, `jump` and `decay_of_jump` are so, too, all else are numbers.
    window
        The rows to count in: the rows before are stepped through, those after are not
        looked at.
    single
        Step in single precision: twice as fast, and where a potential grazes its
        threshold a count may differ. For a search, not for what is reported.

    Returns
    -------
    ndarray
        Counts, ``(candidate, condition)``.

    Raises
    ------
    ParameterError
        A window outside the rows.
    TraceError
        A current that is not finite.
    """
    filtered = [np.asarray(drive, dtype=np.float64) for drive in drives]
    if not all(np.isfinite(drive).all() for drive in filtered):
        raise TraceError(_NOT_FINITE)
    rows, conditions = filtered[0].shape
    first, end = (
        np.broadcast_to(edge, conditions) for edge in ((0, rows) if window is None else window)
    )
    if first.min() < 0 or (first > end).any() or end.max() > rows:
        raise ParameterError(
            f"windows from row {first.min()} to {end.max()}, expected inside 0 to {rows}"
        )
    kind: type[np.floating[Any]] = np.float32 if single else np.float64
    saturates = coefficients.halves is not None
    values = [
        np.asarray(value, dtype=np.float64).reshape(-1)
        for value in (
            coefficients.alpha_mv_per_ms,
            membrane.decay,
            membrane.jump,
            membrane.decay_of_jump,
            *(coefficients.halves or coefficients.gains()),
        )
    ]
    candidates = max(value.size for value in values)
    alpha, decay, jump, decay_of_jump, *per_drive = (
        np.broadcast_to(value, candidates).astype(kind) for value in values
    )
    counts = np.empty((candidates, conditions), dtype=np.int64)
    if step := compiled():
        drives_of, own = [*filtered], [*per_drive]
        if len(own) == 1:  # a second one without a share
            drives_of, own = [*filtered, np.zeros_like(filtered[0])], [*own, np.ones_like(alpha)]
        threshold = float(np.asarray(membrane.threshold))
        limits = (0.0 if one else -np.inf for one in (membrane.clamped, membrane.until_turn))
        step(
            (np.abs(drives_of) if saturates else np.stack(drives_of)).astype(kind),
            np.stack([*own, alpha, decay, jump, decay_of_jump]),
            np.logical_or(saturates or decay < 0.0, _may_reach(threshold, drives_of, own)),
            (kind(threshold), *map(kind, limits)),
            int(np.asarray(membrane.refractory)),
            np.stack([first, end]),
            saturates,
            counts,
        )
        if counts.min(initial=0) < 0:
            raise TraceError(_NOT_FINITE)
        return counts
    # Conditions whose window ends early are not stepped to the end of the others.
    for last in np.unique(end):
        (members,) = np.nonzero(end == last)
        # Candidates lie along the last axis: there a drive is one number, and every
        # operation runs over memory in its order.
        columns = [np.asarray(drive[:, members, np.newaxis], dtype=kind) for drive in filtered]
        size = max(1, BLOCK // members.size)
        for start in range(0, candidates, size):
            block = slice(start, min(start + size, candidates))
            each = tuple(one[block] for one in per_drive)
            counts[block, members] = _tally(
                columns,
                Coefficients(alpha[block], halves=each)
                if saturates
                else Coefficients(kind(1.0), weights=each),
                replace(
                    membrane,
                    decay=decay[block],
                    jump=jump[block],
                    decay_of_jump=decay_of_jump[block],
                ),
                first[members, np.newaxis],
                int(last),
                (members.size, block.stop - block.start),
            ).T
    return counts


def _tally(
    columns: Sequence[FloatArray],
    coefficients: Coefficients,
    membrane: Membrane,
    first: IntArray,
    end: int,
    shape: tuple[int, int],
) -> IntArray:
    """Spikes from row `first` on, before `end`, of a block of membranes ``(condition, candidate)``.

    `columns` are drives ``(T, condition, 1)``; the precision is theirs.
    """
    state = State.at_rest(shape, columns[0].dtype)
    so_far, before = np.zeros(shape, np.int32), np.zeros(shape, np.int32)
    starts = set(first.flat)
    currents = _currents(columns, coefficients, end, shape)
    for row, (_, spike) in enumerate(spiking(currents, membrane, state)):
        if row in starts:
            np.copyto(before, so_far, where=first == row)
        so_far += spike
    np.copyto(before, so_far, where=first == end)
    if not np.isfinite(state.potential).all():
        raise TraceError(_NOT_FINITE)
    return so_far - before


def _currents(
    columns: Sequence[FloatArray], coefficients: Coefficients, end: int, shape: tuple[int, int]
) -> Iterator[FloatArray]:
    """Current of row after row: in one buffer, where that is quicker."""
    current, share = np.empty((2, *shape), columns[0].dtype)
    if coefficients.halves is not None:
        sizes = [np.abs(column) for column in columns]
        for row in range(end):
            for size, half, out in zip(sizes, coefficients.halves, (current, share), strict=False):
                np.add(half, size[row], out=out)
                np.divide(size[row], out, out=out)
            if len(sizes) == 2:
                current += share
            yield np.multiply(current, coefficients.alpha_mv_per_ms, out=current)
    elif current.dtype == np.float32:  # a matrix product: it rounds in another way
        rows, gains = np.concatenate(columns, axis=2), np.stack(coefficients.gains())
        for row in range(end):
            yield np.dot(rows[row], gains, out=current)
    else:
        for row in range(end):
            yield coefficients.current([column[row] for column in columns])


@cache
def compiled() -> Callable[..., None] | None:
    """`_step_each` as machine code, kept on disk from then on; None without numba."""
    try:
        from numba import njit
    except ImportError:
        return None
    try:
        found: Callable[..., None] = njit(_step_each, cache=True, error_model="numpy")
    except RuntimeError:  # nowhere to write
        found = njit(_step_each, error_model="numpy")
    return found


def _may_reach(
    threshold: float, drives: Sequence[FloatArray], gains: Sequence[FloatArray]
) -> BoolArray:
    """Membranes ``(condition, candidate)`` that would reach a threshold without any leak.

    A potential is never above the largest rise of the summed current, of each drive for
    itself. A thousandth is left for rounding.
    """
    most: FloatArray = np.zeros((drives[0].shape[1], gains[0].size))
    for drive, gain in zip(drives, gains, strict=True):
        sums = np.cumsum(np.vstack([np.zeros(drive.shape[1]), drive]), axis=0)
        rise = (sums - np.minimum.accumulate(sums)).max(axis=0)
        fall = (np.maximum.accumulate(sums) - sums).max(axis=0)
        most += np.maximum(np.multiply.outer(rise, gain), np.multiply.outer(fall, -gain))
    return np.asarray(~(most < 0.999 * threshold))


def _step_each(
    drives: FloatArray,
    values: FloatArray,
    wanted: BoolArray,
    limits: tuple[FloatArray, FloatArray, FloatArray],
    refractory: int,
    window: IntArray,
    saturates: bool,
    counts: IntArray,
) -> None:
    """Plain loops over conditions, rows and those candidates that are `wanted`, into `counts`.

    `values` are rows of gains of both drives, alpha, decay, jump and its decay. `limits`
    are the threshold, where the potential is clamped, and below which the threshold
    comes back. A count is -1 where the potential is not finite in the end. The innermost
    loop has no branch but choices between two numbers: it becomes vector instructions.
    """
    threshold, lowest, turn = limits
    zero = values.dtype.type(0)
    none, one, rest = np.int32(0), np.int32(1), np.int32(refractory)
    for condition in range(drives.shape[2]):
        counts[:, condition] = 0
        which = np.flatnonzero(wanted[condition])
        of_x, of_y, alpha, decay, jump, decay_of_jump = values[:, which]
        potential, raised = np.zeros_like(decay), np.zeros_like(decay)
        silent, fired = np.zeros(which.size, np.int32), np.zeros(which.size, np.int32)
        adaptive = (jump != 0).any()
        first, end = window[0, condition], window[1, condition]
        for row in range(end):
            x, y = drives[0, row, condition], drives[1, row, condition]
            inside = np.int32(row >= first)
            for k in range(which.size):
                if saturates:
                    current = (x / (of_x[k] + x) + y / (of_y[k] + y)) * alpha[k]
                else:
                    current = of_x[k] * x + of_y[k] * y
                now, more, wait = potential[k] * decay[k] + current, zero, silent[k]
                now = zero if wait > none else now
                if adaptive:
                    more = raised[k]
                    more = zero if now < turn else more
                    more *= decay_of_jump[k]
                now = lowest if now < lowest else now
                spike = now > threshold + more
                potential[k] = zero if spike else now
                if adaptive:
                    raised[k] = more + (jump[k] if spike else zero)
                fired[k] += inside if spike else none
                silent[k] = rest if spike else wait - one
        for k in range(which.size):
            counts[which[k], condition] = fired[k] if np.isfinite(potential[k]) else -1
