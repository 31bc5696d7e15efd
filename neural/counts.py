"""Spike counts of many parameter sets under many stimuli, for a fit.

The current of 10 000 candidates, 37 conditions and 500 steps would take 1.5 GB; here
it is computed row by row and block by block, and stays in the CPU cache. Counts equal the
number of spikes of `neural.lif.fire` exactly. With numba (the extra ``fast``) plain loops
are compiled, otherwise NumPy steps blocks of membranes.
"""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from multiprocessing import parent_process
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import ParameterError, TraceError
from fembridge.typing import FloatArray, IntArray
from neural.compiled import jit
from neural.lif import Membrane, State, spiking
from neural.models import Coefficients

# First row in which spikes are counted and the row after the last, ``(condition,)`` each
# or numbers.
Window: TypeAlias = tuple[ArrayLike, ArrayLike]

# Membranes stepped together: the 30 bytes of each that a step uses fit into a cache of
# 1 MiB, and the cost of a NumPy call is divided among many membranes.
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
    """Number of spikes of each candidate under each condition.

    Parameters
    ----------
    drives
        The filtered stress of one afferent class, ``(T, condition)`` each, one or
        two.
    coefficients
        Coefficients of the current; entries are ``(candidate,)`` or numbers shared by all
        candidates.
    membrane
        Membrane constants; `decay`, `jump` and `decay_of_jump` are ``(candidate,)`` or
        numbers, the others numbers.
    window
        Rows in which spikes are counted. Earlier rows are stepped, later rows are not.
        Default: all rows.
    single
        Step in single precision (default: False): twice as fast; a count may differ where
        a potential nearly equals its threshold. For a search, not for reported rates.

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
        drives_of, gains = [*filtered], [*per_drive]
        if len(gains) == 1:  # the compiled loop takes two drives: the second is 0
            drives_of, gains = (
                [*filtered, np.zeros_like(filtered[0])],
                [*gains, np.ones_like(alpha)],
            )
        limits = (
            0.0 if is_active else -np.inf for is_active in (membrane.clamped, membrane.until_turn)
        )
        numbers = membrane.threshold, *limits, membrane.fatigue, membrane.decay_of_fatigue
        arguments = (
            np.ascontiguousarray(np.abs(drives_of) if saturates else drives_of, dtype=kind),
            np.stack([*gains, alpha, decay, jump, decay_of_jump]),
            np.array(numbers, dtype=kind),
            int(np.asarray(membrane.refractory)),
            np.stack([first, end]),
            saturates,
        )
        longest_first = np.argsort(-end, kind="stable")
        threads = _threads()
        with ThreadPoolExecutor(threads) as pool:
            # All contiguous: numba compiles every other layout again, some seconds each.
            shares = [np.ascontiguousarray(longest_first[n::threads]) for n in range(threads)]
            list(pool.map(lambda share: step(share, *arguments, counts), shares))
        if counts.min(initial=0) < 0:
            raise TraceError(_NOT_FINITE)
        return counts
    # Conditions are grouped by the end of their window, and not stepped beyond it.
    for window_end in np.unique(end):
        (members,) = np.nonzero(end == window_end)
        # Candidates are on the last axis: a drive is one number there, and every operation
        # reads memory in order.
        columns = [np.asarray(drive[:, members, np.newaxis], dtype=kind) for drive in filtered]
        size = max(1, BLOCK // members.size)
        for start in range(0, candidates, size):
            block = slice(start, min(start + size, candidates))
            per_block = tuple(is_active[block] for is_active in per_drive)
            counts[block, members] = _tally(
                columns,
                Coefficients(alpha[block], halves=per_block)
                if saturates
                else Coefficients(kind(1.0), weights=per_block),
                replace(
                    membrane,
                    decay=decay[block],
                    jump=jump[block],
                    decay_of_jump=decay_of_jump[block],
                ),
                first[members, np.newaxis],
                int(window_end),
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
    """Spikes in rows `first` to `end` − 1 of a block of membranes ``(condition, candidate)``.

    `columns` are drives ``(T, condition, 1)``; the block has their precision.
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
    """Current of each row, in a reused buffer where that is faster."""
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
    elif current.dtype == np.float32:  # a matrix product, whose rounding differs
        rows, gains = np.concatenate(columns, axis=2), np.stack(coefficients.gains())
        for row in range(end):
            yield np.dot(rows[row], gains, out=current)
    else:
        for row in range(end):
            yield coefficients.current([column[row] for column in columns])


def compiled() -> Callable[..., None] | None:
    """`_step_each` compiled by numba and cached on disk; None without numba."""
    return jit(_step_each)


def _threads() -> int:
    """Number of threads: ``NUMBA_NUM_THREADS`` of numba, 1 in a worker process."""
    from numba import config

    return 1 if parent_process() else int(config.NUMBA_NUM_THREADS)


def _step_each(
    conditions: IntArray,
    drives: FloatArray,
    values: FloatArray,
    limits: FloatArray,
    refractory: int,
    window: IntArray,
    saturates: bool,
    counts: IntArray,
) -> None:
    """Loop over `conditions`, rows and candidates; writes the columns of `counts`.

    The rows of `values` are gains of both drives, alpha, decay, jump and decay of the jump.
    `limits` are the threshold, the lowest potential, the potential below which the threshold
    returns, the fatigue after a spike, and the share kept of it. A count is -1 where the final
    potential is not finite.

    Candidates that cannot reach the threshold are not stepped. Without leak a potential
    never exceeds the largest rise of the summed current; with leak it never exceeds the
    steady state of the largest current. Both bounds are computed per drive, with a
    thousandth for rounding. The innermost loop has no branches except choices between two
    numbers, so that it becomes vector instructions.
    """
    threshold, lowest, turn, fatigue, decay_of_fatigue = limits
    zero = values.dtype.type(0)
    zero_rows, unity, rest_rows = np.int32(0), np.int32(1), np.int32(refractory)
    for condition in conditions:
        counts[:, condition] = 0
        first, end = window[0, condition], window[1, condition]
        bound_without_leak, bound_with_leak = np.zeros(values.shape[1]), np.zeros(values.shape[1])
        for drive in range(drives.shape[0]):
            total, low, high, rise, fall = 0.0, 0.0, 0.0, 0.0, 0.0
            for row in range(end):
                total += drives[drive, row, condition]
                low, high = min(low, total), max(high, total)
                rise, fall = max(rise, total - low), max(fall, high - total)
            gain, condition_drive = values[drive], drives[drive, :, condition]
            bound_without_leak += np.maximum(rise * gain, -fall * gain)
            bound_with_leak += np.maximum(
                np.maximum(condition_drive.max() * gain, condition_drive.min() * gain), 0.0
            )
        leak = unity - values[3]
        reaches = ~(bound_without_leak < 0.999 * threshold) & ~(
            bound_with_leak < 0.999 * threshold * leak
        )
        stepped = np.flatnonzero(saturates | (leak > unity) | reaches)
        of_x, of_y, alpha, decay, jump, decay_of_jump = values[:, stepped]
        potential, raised = np.zeros_like(decay), np.zeros_like(decay)
        tired, tires = np.zeros_like(decay), fatigue != zero
        silent, fired = np.zeros(stepped.size, np.int32), np.zeros(stepped.size, np.int32)
        adaptive = (jump != 0).any()
        for row in range(end):
            x, y = drives[0, row, condition], drives[1, row, condition]
            counted = np.int32(row >= first)
            for k in range(stepped.size):
                if saturates:
                    current = (x / (of_x[k] + x) + y / (of_y[k] + y)) * alpha[k]
                else:
                    current = of_x[k] * x + of_y[k] * y
                next_potential, added_threshold, wait_rows = (
                    potential[k] * decay[k] + current,
                    zero,
                    silent[k],
                )
                next_potential = zero if wait_rows > zero_rows else next_potential
                if adaptive:
                    added_threshold = raised[k]
                    added_threshold = zero if next_potential < turn else added_threshold
                    added_threshold *= decay_of_jump[k]
                next_potential = lowest if next_potential < lowest else next_potential
                limit = threshold + added_threshold
                if tires:
                    tired[k] *= decay_of_fatigue
                    limit += tired[k]
                spike = next_potential > limit
                potential[k] = zero if spike else next_potential
                if adaptive:
                    raised[k] = added_threshold + (jump[k] if spike else zero)
                if tires:
                    tired[k] = fatigue if spike else tired[k]
                fired[k] += counted if spike else zero_rows
                silent[k] = rest_rows if spike else wait_rows - unity
        for k in range(stepped.size):
            counts[stepped[k], condition] = fired[k] if np.isfinite(potential[k]) else -1
