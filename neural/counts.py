"""Many parameter sets against many stimuli: the counts that a fit compares.

The current of 10 000 candidates, 37 conditions and 500 steps would take 1.5 GB; here
it is made row by row, block by block, and never leaves the cache. Counts equal the
number of spikes that `neural.lif.fire` finds, to the last one. With numba (the extra
``fast``) plain loops are compiled, else NumPy steps blocks of membranes.
"""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from multiprocessing import parent_process
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import ParameterError, TraceError
from fembridge.typing import FloatArray, IntArray
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
        limits = (0.0 if one else -np.inf for one in (membrane.clamped, membrane.until_turn))
        threshold = np.asarray(membrane.threshold)
        given = (
            np.ascontiguousarray(np.abs(drives_of) if saturates else drives_of, dtype=kind),
            np.stack([*own, alpha, decay, jump, decay_of_jump]),
            (kind(threshold), *map(kind, limits)),
            int(np.asarray(membrane.refractory)),
            np.stack([first, end]),
            saturates,
        )
        longest_first = np.argsort(-end, kind="stable")
        threads = _threads()
        with ThreadPoolExecutor(threads) as pool:
            # Of one layout: another would be compiled anew, some seconds each.
            shares = [np.ascontiguousarray(longest_first[n::threads]) for n in range(threads)]
            list(pool.map(lambda share: step(share, *given, counts), shares))
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
        found: Callable[..., None] = njit(_step_each, cache=True, error_model="numpy", nogil=True)
    except RuntimeError:  # nowhere to write
        found = njit(_step_each, error_model="numpy", nogil=True)
    return found


def _threads() -> int:
    """As many as numba may take of the cores, ``NUMBA_NUM_THREADS``; of a worker process, one."""
    from numba import config

    return 1 if parent_process() else int(config.NUMBA_NUM_THREADS)


def _step_each(
    conditions: IntArray,
    drives: FloatArray,
    values: FloatArray,
    limits: tuple[FloatArray, FloatArray, FloatArray],
    refractory: int,
    window: IntArray,
    saturates: bool,
    counts: IntArray,
) -> None:
    """Plain loops over `conditions`, rows and candidates, into their columns of `counts`.

    `values` are rows of gains of both drives, alpha, decay, jump and its decay. `limits`
    are the threshold, where the potential is clamped, and below which the threshold
    comes back. A count is -1 where the potential is not finite in the end.

    Candidates that cannot reach the threshold are not stepped: without any leak a potential
    is never above the largest rise of the summed current, nor, with it, above what the
    largest current would hold for ever, of each drive for itself. A thousandth is left for
    rounding. The innermost loop has no branch but choices between two numbers: it becomes
    vector instructions.
    """
    threshold, lowest, turn = limits
    zero = values.dtype.type(0)
    none, one, rest = np.int32(0), np.int32(1), np.int32(refractory)
    for condition in conditions:
        counts[:, condition] = 0
        first, end = window[0, condition], window[1, condition]
        whole, most = np.zeros(values.shape[1]), np.zeros(values.shape[1])
        for drive in range(drives.shape[0]):
            total, low, high, rise, fall = 0.0, 0.0, 0.0, 0.0, 0.0
            for row in range(end):
                total += drives[drive, row, condition]
                low, high = min(low, total), max(high, total)
                rise, fall = max(rise, total - low), max(fall, high - total)
            gain, own = values[drive], drives[drive, :, condition]
            whole += np.maximum(rise * gain, -fall * gain)
            most += np.maximum(np.maximum(own.max() * gain, own.min() * gain), 0.0)
        leak = one - values[3]
        reaches = ~(whole < 0.999 * threshold) & ~(most < 0.999 * threshold * leak)
        which = np.flatnonzero(saturates | (leak > one) | reaches)
        of_x, of_y, alpha, decay, jump, decay_of_jump = values[:, which]
        potential, raised = np.zeros_like(decay), np.zeros_like(decay)
        silent, fired = np.zeros(which.size, np.int32), np.zeros(which.size, np.int32)
        adaptive = (jump != 0).any()
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
