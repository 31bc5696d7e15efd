"""When many membranes fire: one loop over time for all cells, classes and stimuli.

Same arithmetic as `neural.lif.integrate`, to the last spike, without the potentials.
A spike cuts the current of the rows in its refractory period; as the potential is at
rest then, nothing else is to be remembered. With some hundred membranes most of the
time goes into calling NumPy, so the loop calls it as seldom as it can.
"""

import numpy as np

from fembridge.errors import TraceError
from fembridge.typing import BoolArray, FloatArray, IntArray


def fire(
    current: FloatArray,
    decay: FloatArray,
    threshold: FloatArray,
    pause: IntArray,
    floored: BoolArray,
    adaptation: tuple[FloatArray, FloatArray] | None = None,
) -> tuple[IntArray, IntArray]:
    """Give row and membrane of every step that ends in a spike, ``(spikes,)`` each.

    Parameters
    ----------
    current
        ``(T, membrane)`` in mV/ms, a row a step; it is used up.
    decay, threshold, pause, floored
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
    floor = np.where(floored, 0.0, -np.inf) if floored.any() else None
    longest = min(int(pause.max(initial=0)), len(current))
    # Only membranes before this one rest longer than a row.
    patient = int(np.flatnonzero(pause > 1).max(initial=-1)) + 1
    brisk = not (pause == 0).any()
    limit, raised = threshold, np.zeros_like(potential)
    multiply, add, greater, floor_at = np.multiply, np.add, np.greater, np.fmax
    found: list[IntArray] = []
    for row, fed in enumerate(current):
        multiply(potential, decay, potential)
        add(potential, fed, potential)
        if floor is not None:
            floor_at(potential, floor, potential)
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
        if brisk and row + 1 < len(current):
            current[row + 1][spiking] = 0.0
        if not brisk or spiking[0] < patient:
            for ahead in range(2 if brisk else 1, longest + 1):
                if row + ahead < len(current):
                    resting = spiking[pause[spiking] >= ahead]
                    current[row + ahead][resting] = 0.0
    sizes = [spiking.size for spiking in found]
    membranes = np.concatenate(found)
    order = np.argsort(membranes, kind="stable")
    return np.repeat(np.arange(len(current)), sizes)[order], membranes[order]
