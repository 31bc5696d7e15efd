"""Counting spikes in bulk: the loop over time, and the blocks it is cut into."""

from collections import deque
from collections.abc import Callable, Iterator
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import ParameterError, TraceError
from fembridge.typing import FloatArray, IntArray

# Rows of a current in which spikes count: one slice for all conditions, or the
# first row and the row after the last, ``(condition,)`` each.
Window: TypeAlias = slice | tuple[ArrayLike, ArrayLike]

EVERY_ROW = slice(None)

# Membranes stepped together: the 30 bytes that a step touches of each stay in a
# cache of 1 MiB, and what NumPy costs a call is shared by many.
BLOCK = 16_384

# Bytes are added to the counts before one of them can overflow: 255 is the most.
_BYTE_ROWS = 255


def tally(
    current_at: Callable[[int], FloatArray],
    shape: tuple[int, int],
    window: tuple[IntArray, IntArray],
    decay: FloatArray,
    threshold: float,
    pause: int,
    *,
    floored: bool = False,
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
    pause
        Rows after a spike without current.
    floored
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
    resting: deque[IntArray] = deque(maxlen=pause)
    raised = np.zeros(shape if adaptation else 0, kind)
    # An array: NumPy takes four times as long to compare with a number.
    floor = np.zeros(shape if floored else 0, kind)
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
        for membranes in resting:
            flat_potential[membranes] = 0.0
        if floored:
            np.maximum(potential, floor, out=potential)
        if adaptation:
            raised *= adaptation[1]
            np.greater(potential, threshold + raised, out=fired)
            raised += adaptation[0] * fired
        else:
            np.greater(potential, threshold, out=fired)
        (spiking,) = flat_fired.nonzero()
        flat_potential[spiking] = 0.0
        resting.append(spiking)
        recent += fired.view(np.uint8)
    if not np.isfinite(potential).all():
        raise TraceError("a current that is not finite reached a membrane")
    return until - before


def blocks(candidates: int, conditions: int) -> Iterator[slice]:
    """Cut the candidates so that a block holds about `BLOCK` membranes."""
    size = max(1, BLOCK // max(1, conditions))
    for start in range(0, candidates, size):
        yield slice(start, min(start + size, candidates))


def window_edges(window: Window, rows: int, conditions: int) -> tuple[IntArray, IntArray]:
    """Give first and end row of each condition's window, ``(condition,)`` each.

    Raises
    ------
    ParameterError
        A window that is not inside the rows, or not one a condition.
    """
    if isinstance(window, slice):
        first, end, step = window.indices(rows)
        if step != 1:
            raise ParameterError(f"{window} has a step, expected none")
        window = (first, max(first, end))
    try:
        firsts, ends = (np.broadcast_to(edge, (conditions,)) for edge in window)
    except ValueError as error:
        raise ParameterError(
            f"windows for {' and '.join(str(np.size(edge)) for edge in window)} "
            f"conditions, expected {conditions}"
        ) from error
    if not {firsts.dtype.kind, ends.dtype.kind} <= set("iu"):
        raise ParameterError("the edges of windows must be whole row numbers")
    bad = np.flatnonzero((firsts < 0) | (firsts > ends) | (ends > rows))
    if bad.size:
        raise ParameterError(
            f"condition {bad[0]}: window from row {firsts[bad[0]]} to "
            f"{ends[bad[0]]} is not inside 0 to {rows}"
        )
    return firsts.astype(np.int64), ends.astype(np.int64)
