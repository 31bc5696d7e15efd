"""Many parameter sets against many stimuli: the counts that a fit compares.

The current of 10 000 candidates, 37 conditions and 500 steps would take 1.5 GB; here
it is made row by row, block by block, and never leaves the cache. Counts equal those
of `neural.coefficients` followed by `neural.lif`, to the last one.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import ParameterError, TraceError
from fembridge.typing import FloatArray, IntArray
from neural.coefficients import Coefficients
from neural.lif import adaptation_constants, membrane_constants, per_candidate
from neural.tally import EVERY_ROW, Window, blocks, tally, window_edges


def candidate_counts(
    drives: Sequence[ArrayLike],
    coefficients: Coefficients,
    tau_ms: ArrayLike,
    *,
    dt_ms: float,
    gap_mv: float,
    refractory_ms: float = 0.0,
    window: Window = EVERY_ROW,
    floored: bool = False,
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
        As in `neural.lif.spike_counts`.
    floored, jump_mv, recovery_ms
        As in `neural.lif.integrate`; the last two may be ``(candidate,)``.
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
        A number outside its meaning, arrays of unequal length, or a window
        outside the rows.
    TraceError
        Drives of unequal shape, or not finite.
    """
    filtered = _checked_drives(drives)
    saturates = coefficients.halves is not None
    each = coefficients.halves or coefficients.gains()
    if len(each) != len(filtered):
        raise ParameterError(f"{len(each)} coefficients for {len(filtered)} drives")
    if len(filtered) > 2:
        raise ParameterError(f"{len(filtered)} drives, expected one or two")
    alpha = coefficients.alpha_mv_per_ms
    sizes = [np.size(value) for value in (*each, alpha, tau_ms, jump_mv, recovery_ms)]
    candidates = max(sizes)
    name = "a half-saturation" if saturates else "a gain"
    per_drive = [per_candidate(name, value, candidates) for value in each]
    alpha = per_candidate("alpha_mv_per_ms", alpha, candidates)
    decay, threshold, pause = membrane_constants(tau_ms, candidates, dt_ms, gap_mv, refractory_ms)
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
                pause,
                floored=floored,
                adaptation=(jump[block], kept[block]) if jump.any() else None,
            ).T
    return counts


def _checked_drives(drives: Sequence[ArrayLike]) -> list[FloatArray]:
    filtered = [np.asarray(drive, dtype=np.float64) for drive in drives]
    shapes = {drive.shape for drive in filtered}
    if len(shapes) != 1 or filtered[0].ndim != 2 or not filtered[0].size:
        raise TraceError(
            f"drives of shape {', '.join(map(str, sorted(shapes))) or 'none'}, "
            "expected one (T, condition)"
        )
    if not all(np.isfinite(drive).all() for drive in filtered):
        raise TraceError("a drive is not finite everywhere")
    return filtered


def _saturating(
    columns: Sequence[FloatArray],
    halves: Sequence[FloatArray],
    alpha_mv_per_ms: FloatArray,
    shape: tuple[int, int],
) -> Callable[[int], FloatArray]:
    """Give a function that makes the current of one row, in one buffer."""
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
