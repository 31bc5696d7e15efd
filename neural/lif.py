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

from fembridge.errors import TraceError
from fembridge.typing import BoolArray, FloatArray, IntArray


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
        What a spike adds to the threshold, and the share that is left of it a row later.

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


def refractory_rows(refractory_ms: float, dt_ms: float) -> int:
    """Rows after a spike without current: a part of a step counts as a step."""
    return math.ceil(refractory_ms / dt_ms - 1e-9)  # 1e-9: 0.3 / 0.1 is 2.9999...
