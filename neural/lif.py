"""The leaky integrate-and-fire membrane, equation (7), by forward Euler.

The potential is counted from rest. Row k of a current acts from its time t to
t + dt::

    v(t + dt) = (1 − dt/τ) v(t) + dt I'(t)

and a spike stands at t + dt, so never before its cause. "Exceeded a threshold" is
read strictly: v > gap, where the gap is threshold minus rest. A spike puts v to
rest; for the refractory period after it no current is fed in, while the leak goes
on, so v stays at rest.

Two membranes of our own differ. A *floored* one does not fall below rest: a current
that takes away only empties what has gathered. An *adaptive* one has a threshold
that each spike raises by a jump, and that comes back with its own time constant::

    θ(t + dt) = (1 − dt/τ_θ) θ(t),  then + jump if v(t + dt) > gap + θ(t + dt)

Inside, v is kept in units of dt, which saves a product a sample. For a dt that is
a power of two, as 0.5 ms is, that is exact.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import ParameterError, TraceError
from fembridge.typing import BoolArray, FloatArray, IntArray
from neural.tally import EVERY_ROW, Window, blocks, tally, window_edges

# A refractory period that no stimulus outlasts is a mistake.
LONGEST_REST_MS = 1.0e5


def spike_counts(
    current_mv_per_ms: ArrayLike,
    tau_ms: ArrayLike,
    dt_ms: float,
    gap_mv: float,
    refractory_ms: float = 0.0,
    window: Window = EVERY_ROW,
) -> IntArray:
    """Count the spikes of many membranes at once.

    Parameters
    ----------
    current_mv_per_ms
        ``(T,)``, ``(T, condition)`` or ``(T, candidate, condition)``.
    tau_ms
        Membrane time constant: a number, or ``(candidate,)``.
    dt_ms
        Time step.
    gap_mv
        Threshold minus rest.
    refractory_ms
        Time after a spike without current; a part of a step counts as a step.
    window
        Rows to count in: one slice, or first and end row of each condition. The
        rows before are stepped through; those after are not looked at.

    Returns
    -------
    ndarray
        Counts, the shape of the current without its time.

    Raises
    ------
    ParameterError
        A number outside its meaning, or a window outside the rows.
    TraceError
        A current of another shape, or not finite.
    """
    current = np.asarray(current_mv_per_ms, dtype=np.float64)
    if current.ndim not in (1, 2, 3) or not current.size:
        raise TraceError(
            f"current of shape {current.shape}, expected (T,), (T, condition) or "
            "(T, candidate, condition)"
        )
    if not np.isfinite(current).all():
        raise TraceError("a current that is not finite reached a membrane")
    rows = current.shape[0]
    candidates = current.shape[1] if current.ndim == 3 else 1
    cells = current.reshape(rows, candidates, -1)
    conditions = cells.shape[2]
    decay, threshold, pause = membrane_constants(tau_ms, candidates, dt_ms, gap_mv, refractory_ms)
    edges = window_edges(window, rows, conditions)
    counts = np.empty((candidates, conditions), dtype=np.int64)
    for block in blocks(candidates, conditions):
        counts[block] = tally(
            cells[:, block].__getitem__,
            counts[block].shape,
            edges,
            decay[block, np.newaxis],
            threshold,
            pause,
        )
    return counts.reshape(current.shape[1:])


def spike_mask(
    current_mv_per_ms: ArrayLike,
    tau_ms: float,
    dt_ms: float,
    gap_mv: float,
    refractory_ms: float = 0.0,
) -> BoolArray:
    """Tell for each row whether the step that it feeds ends in a spike.

    `current_mv_per_ms` is ``(T,)`` or ``(T, condition)``, the mask has its shape.
    """
    return integrate(current_mv_per_ms, tau_ms, dt_ms, gap_mv, refractory_ms)[1]


def spike_times(
    current_mv_per_ms: ArrayLike,
    tau_ms: float,
    dt_ms: float,
    gap_mv: float,
    refractory_ms: float = 0.0,
    start_ms: float = 0.0,
) -> FloatArray:
    """Give the spike times of one run ``(T,)`` in ms; its row 0 is at `start_ms`."""
    fired = spike_mask(current_mv_per_ms, tau_ms, dt_ms, gap_mv, refractory_ms)
    if fired.ndim != 1:
        raise TraceError(f"current of shape {fired.shape}, expected one run (T,)")
    steps = np.flatnonzero(fired).astype(np.float64) + 1.0
    return start_ms + steps * dt_ms


def integrate(
    current_mv_per_ms: ArrayLike,
    tau_ms: float,
    dt_ms: float,
    gap_mv: float,
    refractory_ms: float = 0.0,
    *,
    floored: bool = False,
    jump_mv: float = 0.0,
    recovery_ms: float = math.inf,
) -> tuple[FloatArray, BoolArray]:
    """Follow the membrane potential through a whole run.

    Parameters
    ----------
    current_mv_per_ms
        ``(T,)`` or ``(T, condition)``.
    tau_ms, dt_ms, gap_mv, refractory_ms
        As in `spike_counts`, one number each.
    floored
        The potential does not fall below rest.
    jump_mv, recovery_ms
        What a spike adds to the threshold, and the time constant of its return.

    Returns
    -------
    potential_mv
        Potential above rest at the end of each step, of the current's shape; a
        step that ends in a spike is already back at rest.
    fired
        Where a step ends in a spike, of the same shape.
    """
    current = np.asarray(current_mv_per_ms, dtype=np.float64)
    if current.ndim not in (1, 2):
        raise TraceError(f"current of shape {current.shape}, expected (T,) or (T, condition)")
    if not np.isfinite(current).all():
        raise TraceError("a current that is not finite reached the membrane")
    decay, threshold, pause = membrane_constants(tau_ms, 1, dt_ms, gap_mv, refractory_ms)
    potential, fired = np.zeros_like(current), np.zeros(current.shape, dtype=np.bool_)
    [jump], [kept] = adaptation_constants(jump_mv, recovery_ms, 1, dt_ms)
    now: FloatArray = np.zeros(current.shape[1:])
    raised: FloatArray = np.zeros_like(now)
    since = np.full(current.shape[1:], pause)  # rows since the last spike
    for row, fed in enumerate(current):
        now = np.where(since < pause, 0.0, now * decay[0] + fed)
        if floored:
            now = np.maximum(now, 0.0)
        raised = raised * kept
        fired[row] = now > threshold + raised
        raised = raised + jump * fired[row]
        now = np.where(fired[row], 0.0, now)
        since = np.where(fired[row], 0, since + 1)
        potential[row] = now * dt_ms
    return potential, fired


def membrane_constants(
    tau_ms: ArrayLike, candidates: int, dt_ms: float, gap_mv: float, refractory_ms: float
) -> tuple[FloatArray, float, int]:
    """Give decay ``(candidate,)``, threshold in units of dt, and pause in rows.

    Raises
    ------
    ParameterError
        A number outside its meaning; a τ below dt would make v change its sign.
    """
    for name, value in (("dt_ms", dt_ms), ("gap_mv", gap_mv)):
        if not (math.isfinite(value) and value > 0):
            raise ParameterError(f"{name} must be > 0, got {value}")
    if not (math.isfinite(refractory_ms) and refractory_ms >= 0):
        raise ParameterError(f"refractory_ms must be >= 0, got {refractory_ms}")
    tau = per_candidate("tau_ms", tau_ms, candidates)
    if not (tau >= dt_ms).all():
        raise ParameterError(f"tau_ms must be at least dt_ms, {dt_ms:g}, got {tau.min():g}")
    if refractory_ms > LONGEST_REST_MS:
        raise ParameterError(
            f"refractory_ms must be at most {LONGEST_REST_MS:g}, got {refractory_ms:g}"
        )
    pause = math.ceil(refractory_ms / dt_ms - 1e-9)  # 1e-9: 0.3 / 0.1 is 2.9999...
    return 1.0 - dt_ms / tau, gap_mv / dt_ms, max(pause, 0)


def adaptation_constants(
    jump_mv: ArrayLike, recovery_ms: ArrayLike, candidates: int, dt_ms: float
) -> tuple[FloatArray, FloatArray]:
    """Give the jump in units of dt and the share kept a row, ``(candidate,)`` each.

    Raises
    ------
    ParameterError
        A jump below 0, or a recovery shorter than a step.
    """
    try:
        jump = np.broadcast_to(np.asarray(jump_mv, dtype=np.float64), (candidates,))
        recovery = np.broadcast_to(np.asarray(recovery_ms, dtype=np.float64), (candidates,))
    except ValueError as error:
        raise ParameterError(
            f"{np.size(jump_mv)} jumps and {np.size(recovery_ms)} recoveries, expected "
            f"one of each, or {candidates}"
        ) from error
    if not (np.isfinite(jump).all() and (jump >= 0).all()):
        raise ParameterError(f"jump_mv must be >= 0, got {jump.min():g}")
    if not (recovery >= dt_ms).all():
        raise ParameterError(
            f"recovery_ms must be at least dt_ms, {dt_ms:g}, got {recovery.min():g}"
        )
    return jump / dt_ms, 1.0 - dt_ms / recovery


def per_candidate(name: str, value: ArrayLike, candidates: int) -> FloatArray:
    """Give `value` as ``(candidate,)``: finite and > 0, or a `ParameterError`."""
    values = np.asarray(value, dtype=np.float64)
    if values.shape not in ((), (candidates,)):
        raise ParameterError(
            f"{name} of shape {values.shape}, expected a number or ({candidates},)"
        )
    bad = values[~(np.isfinite(values) & (values > 0))]
    if bad.size:
        raise ParameterError(f"{name} must be > 0, got {bad[0]}")
    return np.broadcast_to(values, (candidates,))
