"""Many parameter sets against many stimuli: the counts that a fit compares.

The current of 10 000 candidates, 37 conditions and 500 steps would take 1.5 GB; here
it is made row by row, block by block, and never leaves the cache. Counts equal the
number of spikes that `neural.lif.fire` finds, to the last one.
"""

import math
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import ParameterError, TraceError
from fembridge.typing import FloatArray, IntArray
from neural.lif import adaptation_constants, membrane_constants, per_candidate
from neural.models import Coefficients

# Rows of a current in which spikes count: one slice for all conditions, or the
# first row and the row after the last, ``(condition,)`` each.
Window: TypeAlias = slice | tuple[ArrayLike, ArrayLike]

EVERY_ROW = slice(None)

# Membranes stepped together: the 30 bytes that a step touches of each stay in a
# cache of 1 MiB, and what NumPy costs a call is shared by many.
BLOCK = 16_384

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
    window: Window = EVERY_ROW,
    clamped: bool = False,
    jump_mv: ArrayLike = 0.0,
    recovery_ms: ArrayLike = math.inf,
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
        A number outside its meaning, or a window outside the rows.
    TraceError
        Drives of unequal shape, or not finite.
    """
    filtered = [np.asarray(drive, dtype=np.float64) for drive in drives]
    if filtered[0].ndim != 2 or len({drive.shape for drive in filtered}) != 1:
        raise TraceError(
            f"drives of shape {', '.join(str(drive.shape) for drive in filtered)}, "
            "expected one (T, condition)"
        )
    if not all(np.isfinite(drive).all() for drive in filtered):
        raise TraceError("a drive is not finite everywhere")
    saturates = coefficients.halves is not None
    each = coefficients.halves or coefficients.gains()
    alpha = coefficients.alpha_mv_per_ms
    sizes = [np.size(value) for value in (*each, alpha, tau_ms, jump_mv, recovery_ms)]
    candidates = max(sizes)
    name = "a half-saturation" if saturates else "a gain"
    per_drive = [per_candidate(name, value, candidates) for value in each]
    alpha = per_candidate("alpha_mv_per_ms", alpha, candidates)
    decay, threshold, refractory = membrane_constants(
        tau_ms, candidates, dt_ms, gap_mv, refractory_ms
    )
    jump, kept = adaptation_constants(jump_mv, recovery_ms, candidates, dt_ms)
    kind: type[np.floating[Any]] = np.float32 if single else np.float64
    per_drive = [np.asarray(values, dtype=kind) for values in per_drive]
    alpha, decay = np.asarray(alpha, dtype=kind), np.asarray(decay, dtype=kind)
    jump, kept = np.asarray(jump, dtype=kind), np.asarray(kept, dtype=kind)
    rows, conditions = filtered[0].shape
    first, end = window_edges(window, rows, conditions)
    counts = np.empty((candidates, conditions), dtype=np.int64)
    current = _saturating if saturates else _dot if single else _linear
    # Conditions whose window ends early are not stepped to the end of the others.
    for last in np.unique(end):
        (members,) = np.nonzero(end == last)
        # Candidates lie along the last axis: there a drive is one number, and every
        # operation runs over memory in its order.
        columns = [np.asarray(drive[:, members, np.newaxis], dtype=kind) for drive in filtered]
        for block in blocks(candidates, members.size):
            shape = (members.size, block.stop - block.start)
            counts[block, members] = tally(
                current(columns, [a[block] for a in per_drive], alpha[block], shape),
                shape,
                (first[members, np.newaxis], end[members, np.newaxis]),
                decay[block],
                threshold,
                refractory,
                clamped=clamped,
                adaptation=(jump[block], kept[block]) if jump.any() else None,
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


def tally(
    current_at: Callable[[int], FloatArray],
    shape: tuple[int, int],
    window: tuple[IntArray, IntArray],
    decay: FloatArray,
    threshold: float,
    refractory: int,
    *,
    clamped: bool = False,
    adaptation: tuple[FloatArray, FloatArray] | None = None,
) -> IntArray:
    """Step a block of membranes through time and count their spikes.

    Parameters
    ----------
    current_at
        Gives the current of a row in mV/ms, an array of `shape`.
    shape
        The two axes of the block.
    window
        First row to count in and row to stop at; they broadcast to `shape`.
    decay
        ``1 − dt/τ``; broadcasts to `shape`. Its precision is that of the potentials.
    threshold
        The gap in units of dt, so in mV/ms.
    refractory
        Rows after a spike without current.
    clamped
        The potential does not fall below rest.
    adaptation
        What a spike adds to the threshold, in its unit, and the share of that which
        is left after a row; both broadcast to `shape`.

    Returns
    -------
    ndarray
        Counts of `shape`.

    Raises
    ------
    TraceError
        A current that is not finite reached a membrane.
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
        if clamped:
            np.maximum(potential, clamp, out=potential)
        if adaptation:
            raised *= adaptation[1]
            np.greater(potential, threshold + raised, out=fired)
            raised += adaptation[0] * fired
        else:
            np.greater(potential, threshold, out=fired)
        (spiking,) = flat_fired.nonzero()
        flat_potential[spiking] = 0.0
        silent.append(spiking)
        recent += fired.view(np.uint8)
    if not np.isfinite(potential).all():
        raise TraceError("a current that is not finite reached a membrane")
    return until - before


def blocks(candidates: int, conditions: int) -> Iterator[slice]:
    """Slices of the candidates so that a block holds about `BLOCK` membranes."""
    size = max(1, BLOCK // max(1, conditions))
    for start in range(0, candidates, size):
        yield slice(start, min(start + size, candidates))


def window_edges(window: Window, rows: int, conditions: int) -> tuple[IntArray, IntArray]:
    """First and end row of each condition's window, ``(condition,)`` each.

    Raises
    ------
    ParameterError
        A window that is not inside the rows.
    """
    if isinstance(window, slice):
        first, end, _ = window.indices(rows)
        window = (first, max(first, end))
    firsts, ends = (np.broadcast_to(edge, (conditions,)).astype(np.int64) for edge in window)
    bad = np.flatnonzero((firsts < 0) | (firsts > ends) | (ends > rows))
    if bad.size:
        raise ParameterError(
            f"condition {bad[0]}: window from row {firsts[bad[0]]} to "
            f"{ends[bad[0]]} is not inside 0 to {rows}"
        )
    return firsts, ends
