"""When many membranes fire: one loop over time for all cells, classes and stimuli.

Same arithmetic as `neural.lif.integrate`, to the last spike, without the potentials.
A spike cuts the current of the rows in its refractory period; as the potential is at
rest then, nothing else is to be remembered.
"""

import numpy as np

from fembridge.errors import TraceError
from fembridge.typing import BoolArray, FloatArray, IntArray

_SET = b"\x01"


def fire(
    current: FloatArray,
    decay: FloatArray,
    threshold: FloatArray,
    pause: IntArray,
    floored: BoolArray,
    adaptation: tuple[FloatArray, FloatArray] | None = None,
) -> BoolArray:
    """Tell for each row and membrane whether the step that it feeds ends in a spike.

    Parameters
    ----------
    current
        ``(T, membrane)`` in mV/ms; it is used up.
    decay, threshold, pause, floored
        Of each membrane, ``(membrane,)``: ``1 − dt/τ``, the gap in units of dt, rows
        after a spike without current, and whether it stays at or above rest.
    adaptation
        What a spike adds to the threshold, and the share kept a row.

    Raises
    ------
    TraceError
        A current that is not finite.
    """
    if not np.isfinite(current.sum()):
        raise TraceError("a current that is not finite reached the membrane")
    fired = np.empty(current.shape, dtype=np.bool_)
    potential = np.zeros(current.shape[1])
    floor = np.where(floored, 0.0, -np.inf) if floored.any() else None
    # Membranes whose refractory period lasts to the row of that place.
    lasting = [pause >= ahead for ahead in range(1, int(pause.max(initial=0)) + 1)]
    cut = [None if all_of.all() else all_of for all_of in lasting]
    limit, raised = threshold, np.zeros_like(potential)
    multiply, add, greater = np.multiply, np.add, np.greater
    for row, (fed, now) in enumerate(zip(current, fired, strict=True)):
        multiply(potential, decay, potential)
        add(potential, fed, potential)
        if floor is not None:
            np.fmax(potential, floor, potential)  # np.maximum takes three times as long
        if adaptation:
            raised *= adaptation[1]
            limit = threshold + raised
        greater(potential, limit, now)
        if _SET not in now.tobytes():  # a tenth of the time of now.any()
            continue
        np.copyto(potential, 0.0, where=now)
        if adaptation:
            raised += adaptation[0] * now
        for ahead, some in enumerate(cut[: len(current) - row - 1], start=1):
            where = now if some is None else now & some
            np.copyto(current[row + ahead], 0.0, where=where)
    return fired
