"""The leaky integrate-and-fire membrane, equation (7), by forward Euler.

The potential is counted from rest. Row k of a current acts from its time t to
t + dt::

    v(t + dt) = (1 − dt/τ) v(t) + dt I'(t)

and a spike stands at t + dt, so never before its cause. "Exceeded a threshold" is
read strictly: v > gap, where the gap is threshold minus rest. A spike puts v to
rest; for the refractory period after it no current is fed in, while the leak goes
on, so v stays at rest.

Two membranes of our own differ. A *clamped* one does not fall below rest: a negative
current only removes what was integrated. An *adaptive* one has a threshold
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

# A refractory period that no stimulus outlasts is a mistake.
LONGEST_REFRACTORY_MS = 1.0e5


def fire(
    current: FloatArray,
    decay: FloatArray,
    threshold: FloatArray,
    refractory: IntArray,
    clamped: BoolArray,
    adaptation: tuple[FloatArray, FloatArray] | None = None,
) -> tuple[IntArray, IntArray]:
    """Row and membrane of every step that ends in a spike, ``(spikes,)`` each.

    One loop over time for all cells, classes and stimuli. A spike cuts the current of the
    rows in its refractory period; as the potential is at rest then, nothing else has
    to be stored. With some hundred membranes most of the time goes into calling
    NumPy, so the loop calls it as seldom as it can.

    Parameters
    ----------
    current
        ``(T, membrane)`` in mV/ms, a row a step; it is used up.
    decay, threshold, refractory, clamped
        Of each membrane, ``(membrane,)``: ``1 − dt/τ``, the gap in units of dt, rows
        after a spike without current, and whether it stays at or above rest.
    adaptation
        What a spike adds to the threshold, and the share kept a row.

    Returns
    -------
    rows, membranes
        In order of the membranes, of each in order of time.

    Raises
    ------
    TraceError
        A current that is not finite.
    """
    if not np.isfinite(current.sum()):
        raise TraceError("a current that is not finite reached the membrane")
    potential, above = np.zeros(current.shape[1]), np.empty(current.shape[1], np.bool_)
    clamp = np.where(clamped, 0.0, -np.inf) if clamped.any() else None
    longest = min(int(refractory.max(initial=0)), len(current))
    # Only membranes before this one rest longer than a row.
    long = int(np.flatnonzero(refractory > 1).max(initial=-1)) + 1
    always = not (refractory == 0).any()
    limit, raised = threshold, np.zeros_like(potential)
    multiply, add, greater, clamp_at = np.multiply, np.add, np.greater, np.fmax
    found: list[IntArray] = []
    for row, fed in enumerate(current):
        multiply(potential, decay, potential)
        add(potential, fed, potential)
        if clamp is not None:
            clamp_at(potential, clamp, potential)
        if adaptation:
            multiply(raised, adaptation[1], raised)
            limit = threshold + raised
        (spiking,) = greater(potential, limit, above).nonzero()
        found.append(spiking)
        if not spiking.size:
            continue
        potential[spiking] = 0.0
        if adaptation:
            raised[spiking] += adaptation[0][spiking]
        if always and row + 1 < len(current):
            current[row + 1][spiking] = 0.0
        if not always or spiking[0] < long:
            for ahead in range(2 if always else 1, longest + 1):
                if row + ahead < len(current):
                    silent = spiking[refractory[spiking] >= ahead]
                    current[row + ahead][silent] = 0.0
    sizes = [spiking.size for spiking in found]
    membranes = np.concatenate(found)
    order = np.argsort(membranes, kind="stable")
    return np.repeat(np.arange(len(current)), sizes)[order], membranes[order]


def membrane_constants(
    tau_ms: ArrayLike, candidates: int, dt_ms: float, gap_mv: float, refractory_ms: float
) -> tuple[FloatArray, float, int]:
    """Decay ``(candidate,)``, threshold in units of dt, and refractory period in rows.

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
    if refractory_ms > LONGEST_REFRACTORY_MS:
        raise ParameterError(
            f"refractory_ms must be at most {LONGEST_REFRACTORY_MS:g}, got {refractory_ms:g}"
        )
    refractory = math.ceil(refractory_ms / dt_ms - 1e-9)  # 1e-9: 0.3 / 0.1 is 2.9999...
    return 1.0 - dt_ms / tau, gap_mv / dt_ms, max(refractory, 0)


def adaptation_constants(
    jump_mv: ArrayLike, recovery_ms: ArrayLike, candidates: int, dt_ms: float
) -> tuple[FloatArray, FloatArray]:
    """Jump in units of dt and the share that decays to in a row, ``(candidate,)`` each.

    Raises
    ------
    ParameterError
        A jump below 0, or a recovery shorter than a step.
    """
    jump = np.broadcast_to(np.asarray(jump_mv, dtype=np.float64), (candidates,))
    recovery = np.broadcast_to(np.asarray(recovery_ms, dtype=np.float64), (candidates,))
    if not (np.isfinite(jump).all() and (jump >= 0).all()):
        raise ParameterError(f"jump_mv must be >= 0, got {jump.min():g}")
    if not (recovery >= dt_ms).all():
        raise ParameterError(
            f"recovery_ms must be at least dt_ms, {dt_ms:g}, got {recovery.min():g}"
        )
    return jump / dt_ms, 1.0 - dt_ms / recovery


def per_candidate(name: str, value: ArrayLike, candidates: int) -> FloatArray:
    """`value` as ``(candidate,)``: finite and > 0, or a `ParameterError`."""
    values = np.asarray(value, dtype=np.float64)
    if values.shape not in ((), (candidates,)):
        raise ParameterError(
            f"{name} of shape {values.shape}, expected a number or ({candidates},)"
        )
    bad = values[~(np.isfinite(values) & (values > 0))]
    if bad.size:
        raise ParameterError(f"{name} must be > 0, got {bad[0]}")
    return np.broadcast_to(values, (candidates,))
