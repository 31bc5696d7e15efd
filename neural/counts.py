"""Many parameter sets against many stimuli: the counts that a fit compares.

The current of 10 000 candidates, 37 conditions and 500 steps would take 1.5 GB; here
it is made row by row, block by block, and never leaves the cache. Counts equal the
number of spikes that `neural.lif.fire` finds, to the last one. With numba (the extra
``fast``) plain loops are compiled, else NumPy steps blocks of membranes.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import ParameterError, TraceError
from fembridge.typing import BoolArray, FloatArray, IntArray
from neural.lif import refractory_rows
from neural.models import Coefficients

# First row in which spikes count and the row after the last, ``(condition,)`` each or
# numbers.
Window: TypeAlias = tuple[ArrayLike, ArrayLike]

# Membranes stepped together: the 30 bytes that a step touches of each stay in a
# cache of 1 MiB, and what NumPy costs a call is shared by many.
BLOCK = 16_384

_NOT_FINITE = "a current that is not finite reached a membrane"

# Bytes are added to the counts before one of them can overflow: 255 is the most.
_BYTE_ROWS = 255


def candidate_counts(
    drives: Sequence[ArrayLike],
    coefficients: Coefficients,
    tau_ms: ArrayLike,
    *,
    dt_ms: float,
    gap_mv: float,
    refractory_ms: float = 0.0,
    window: Window | None = None,
    clamped: bool = False,
    jump_mv: ArrayLike = 0.0,
    recovery_ms: ArrayLike = math.inf,
    until_turn: bool = False,
    single: bool = False,
) -> IntArray:
    """Count the spikes of each candidate under each condition.

    Parameters
    ----------
    drives
        The filtered stress of one afferent class, ``(T, condition)`` each, one or
        two.
    coefficients
        What makes them a current; its entries are ``(candidate,)``, or numbers that
        all share.
    tau_ms
        Time constant of the membrane: ``(candidate,)``, or a number.
    dt_ms, gap_mv, refractory_ms, window
        Time step, threshold minus rest, time after a spike without current (a part of a
        step counts as a step), and the rows to count in: the rows before are stepped
        through, those after are not looked at.
    clamped, jump_mv, recovery_ms
        Whether the potential stays at or above rest; what a spike adds to the threshold
        and the time constant of its return, numbers or ``(candidate,)``.
    until_turn
        Whether the threshold comes back as soon as the potential is driven below rest.
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
        np.asarray(value, dtype=np.float64)
        for value in (
            coefficients.alpha_mv_per_ms,
            1.0 - dt_ms / np.asarray(tau_ms),
            np.asarray(jump_mv) / dt_ms,
            1.0 - dt_ms / np.asarray(recovery_ms),
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
        threshold, rest = gap_mv / dt_ms, refractory_rows(refractory_ms, dt_ms)
        step(
            (np.abs(drives_of) if saturates else np.stack(drives_of)).astype(kind),
            np.stack([*own, alpha, decay, jump, decay_of_jump]),
            np.logical_or(saturates or decay < 0.0, _may_reach(threshold, drives_of, own)),
            (kind(threshold), *(kind(0.0 if one else -np.inf) for one in (clamped, until_turn))),
            rest,
            np.stack([first, end]),
            saturates,
            counts,
        )
        if counts.min(initial=0) < 0:
            raise TraceError(_NOT_FINITE)
        return counts
    current = _saturating if saturates else _dot if single else _linear
    # Conditions whose window ends early are not stepped to the end of the others.
    for last in np.unique(end):
        (members,) = np.nonzero(end == last)
        # Candidates lie along the last axis: there a drive is one number, and every
        # operation runs over memory in its order.
        columns = [np.asarray(drive[:, members, np.newaxis], dtype=kind) for drive in filtered]
        size = max(1, BLOCK // members.size)
        for start in range(0, candidates, size):
            block = slice(start, min(start + size, candidates))
            shape = (members.size, block.stop - block.start)
            counts[block, members] = _tally(
                current(columns, [a[block] for a in per_drive], alpha[block], shape),
                shape,
                (first[members, np.newaxis], end[members, np.newaxis]),
                decay[block],
                gap_mv / dt_ms,
                refractory_rows(refractory_ms, dt_ms),
                clamped=clamped,
                adaptation=(jump[block], decay_of_jump[block]) if jump.any() else None,
                until_turn=until_turn,
            ).T
    return counts


def _saturating(
    columns: Sequence[FloatArray],
    halves: Sequence[FloatArray],
    alpha_mv_per_ms: FloatArray,
    shape: tuple[int, int],
) -> Callable[[int], FloatArray]:
    """Function that makes the current of one row, in one buffer."""
    columns = [np.abs(column) for column in columns]
    current, share = (np.empty(shape, alpha_mv_per_ms.dtype) for _ in range(2))

    def current_at(row: int) -> FloatArray:
        out = current
        for column, half in zip(columns, halves, strict=True):
            np.add(half, column[row], out=out)
            np.divide(column[row], out, out=out)
            out = share
        if len(columns) == 2:
            np.add(current, share, out=current)
        return np.multiply(current, alpha_mv_per_ms, out=current)

    return current_at


def _linear(
    columns: Sequence[FloatArray],
    gains: Sequence[FloatArray],
    alpha_mv_per_ms: FloatArray,
    shape: tuple[int, int],
) -> Callable[[int], FloatArray]:
    """As `_saturating`, of weighted sums; the gains have alpha in them."""
    current, share = (np.empty(shape, alpha_mv_per_ms.dtype) for _ in range(2))

    def current_at(row: int) -> FloatArray:
        np.multiply(gains[0], columns[0][row], out=current)
        if len(columns) == 2:
            np.multiply(gains[1], columns[1][row], out=share)
            np.add(current, share, out=current)
        return current

    return current_at


def _dot(
    columns: Sequence[FloatArray],
    gains: Sequence[FloatArray],
    alpha_mv_per_ms: FloatArray,
    shape: tuple[int, int],
) -> Callable[[int], FloatArray]:
    """As `_linear`, by a matrix product: quicker, and rounded in another way."""
    rows = np.ascontiguousarray(np.concatenate(columns, axis=2))
    matrix = np.ascontiguousarray(np.stack(gains))
    current = np.empty(shape, matrix.dtype)
    return lambda row: np.dot(rows[row], matrix, out=current)


def _tally(
    current_at: Callable[[int], FloatArray],
    shape: tuple[int, int],
    window: tuple[IntArray, IntArray],
    decay: FloatArray,
    threshold: float,
    refractory: int,
    *,
    clamped: bool,
    adaptation: tuple[FloatArray, FloatArray] | None,
    until_turn: bool,
) -> IntArray:
    """Spikes inside their windows of a block of membranes, of `shape`.

    `current_at` makes the current of a row in mV/ms; `window`, `decay` and `adaptation`
    broadcast to `shape`; the precision is that of `decay`. The rest is as in
    `neural.lif.fire`.
    """
    first, end = window
    edges = {*first.flat, *end.flat}
    kind = decay.dtype
    potential, fired = np.zeros(shape, kind), np.empty(shape, dtype=np.bool_)
    flat_potential, flat_fired = potential.reshape(-1), fired.reshape(-1)
    recent, so_far = np.zeros(shape, np.uint8), np.zeros(shape, np.int64)
    before, until = np.zeros(shape, np.int64), np.zeros(shape, np.int64)
    silent: deque[IntArray] = deque(maxlen=refractory)
    raised = np.zeros(shape if adaptation else 0, kind)
    # An array: NumPy takes four times as long to compare with a number.
    clamp = np.zeros(shape if clamped else 0, kind)
    ahead = np.empty(shape if adaptation and until_turn else 0, np.bool_)
    zero, fades = kind.type(0.0), adaptation is not None and bool((adaptation[1] != 1.0).any())
    last = max(edges, default=0)
    for row in range(last + 1):
        if row in edges or row % _BYTE_ROWS == 0:
            so_far += recent
            recent[...] = 0
            np.copyto(before, so_far, where=first == row)
            np.copyto(until, so_far, where=end == row)
        if row == last:
            break
        potential *= decay
        potential += current_at(row)
        for membranes in silent:
            flat_potential[membranes] = 0.0
        if ahead.size:
            raised *= np.greater_equal(potential, zero, out=ahead)
        if clamped:
            np.maximum(potential, clamp, out=potential)
        if adaptation and fades:
            raised *= adaptation[1]
        np.greater(potential, threshold + raised if adaptation else threshold, out=fired)
        (spiking,) = flat_fired.nonzero()
        if adaptation:
            raised.reshape(-1)[spiking] += adaptation[0][spiking % shape[1]]
        flat_potential[spiking] = 0.0
        silent.append(spiking)
        recent += fired.view(np.uint8)
    if not np.isfinite(potential).all():
        raise TraceError(_NOT_FINITE)
    return until - before


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
