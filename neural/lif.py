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

or, *until the turn*, all at once as soon as a current drives v below rest.

Inside, v is kept in units of dt, which saves a product a sample. For a dt that is
a power of two, as 0.5 ms is, that is exact.
"""

import math
from dataclasses import dataclass

import numpy as np

from fembridge.errors import TraceError
from fembridge.typing import BoolArray, FloatArray, IntArray

# So many membranes and fewer are quicker one by one.
_FEW = 20


@dataclass(slots=True)
class Membranes:
    """Where membranes stand between two rows, ``(membrane,)`` each.

    `potential` and what is `raised` of the threshold, both in units of dt, and for how
    many rows to come there is no current, `rest`.
    """

    potential: FloatArray
    raised: FloatArray
    rest: IntArray

    @classmethod
    def at_rest(cls, count: int) -> "Membranes":
        """So many before their first row."""
        return cls(np.zeros(count), np.zeros(count), np.zeros(count, dtype=np.int64))


def fire(
    current: FloatArray,
    decay: FloatArray,
    threshold: FloatArray,
    refractory: IntArray,
    clamped: BoolArray,
    adaptation: tuple[FloatArray, FloatArray] | None = None,
    until_turn: BoolArray | None = None,
    state: Membranes | None = None,
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
    until_turn
        Whether the threshold comes back as soon as the potential is driven below rest.
    state
        Of the membranes before the first row (None: at rest). It becomes that behind the
        last, so that a long current can come in parts.

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
    now = state or Membranes.at_rest(current.shape[1])
    if current.shape[1] <= _FEW:
        turns = np.zeros(current.shape[1], np.bool_) if until_turn is None else until_turn
        return _fire_each(current, decay, threshold, refractory, clamped, adaptation, turns, now)
    potential, above = now.potential, np.empty(current.shape[1], np.bool_)
    for membrane in np.flatnonzero(now.rest):
        current[: now.rest[membrane], membrane] = 0.0
    clamp = np.where(clamped, 0.0, -np.inf) if clamped.any() else None
    longest = min(int(refractory.max(initial=0)), len(current))
    # Only membranes before this one rest longer than a row.
    long = int(np.flatnonzero(refractory > 1).max(initial=-1)) + 1
    always = not (refractory == 0).any()
    limit, raised = threshold, now.raised
    multiply, add, greater, clamp_at = np.multiply, np.add, np.greater, np.fmax
    found: list[IntArray] = []
    for row, fed in enumerate(current):
        multiply(potential, decay, potential)
        add(potential, fed, potential)
        if until_turn is not None:
            raised[until_turn & (potential < 0.0)] = 0.0
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
    np.maximum(now.rest - len(current), 0, out=now.rest)
    for ahead, spiking in enumerate(reversed(found[len(found) - longest :])):
        now.rest[spiking] = np.maximum(now.rest[spiking], refractory[spiking] - ahead)
    sizes = [spiking.size for spiking in found]
    membranes = np.concatenate(found)
    order = np.argsort(membranes, kind="stable")
    return np.repeat(np.arange(len(current)), sizes)[order], membranes[order]


def _fire_each(
    current: FloatArray,
    decay: FloatArray,
    threshold: FloatArray,
    refractory: IntArray,
    clamped: BoolArray,
    adaptation: tuple[FloatArray, FloatArray] | None,
    until_turn: BoolArray,
    now: Membranes,
) -> tuple[IntArray, IntArray]:
    """The same as `fire`, a membrane after the other: calling NumPy costs more than numbers."""
    jump, share = adaptation or (np.zeros_like(decay), np.ones_like(decay))
    trains: list[list[int]] = []
    for k, fed in enumerate(current.T):
        leak, gap, quiet, floored = (
            decay[k].item(),
            threshold[k].item(),
            refractory[k].item(),
            clamped[k],
        )
        more, left = jump[k].item(), share[k].item()
        potential, raised = now.potential[k].item(), now.raised[k].item()
        until, spikes = now.rest[k].item(), list[int]()
        turns = bool(until_turn[k])
        for row, one in enumerate(fed.tolist()):
            potential = potential * leak + (one if row >= until else 0.0)
            if turns and potential < 0.0:
                raised = 0.0
            if floored and potential < 0.0:
                potential = 0.0
            if more:
                raised *= left
            if potential > gap + raised:
                spikes.append(row)
                potential, until = 0.0, row + 1 + quiet
                raised += more
        now.potential[k], now.raised[k] = potential, raised
        now.rest[k] = max(0, until - len(fed))
        trains.append(spikes)
    rows = np.array([row for train in trains for row in train], dtype=np.int64)
    return rows, np.repeat(np.arange(len(trains)), [len(train) for train in trains])


def refractory_rows(refractory_ms: float, dt_ms: float) -> int:
    """Rows after a spike without current: a part of a step counts as a step."""
    return math.ceil(refractory_ms / dt_ms - 1e-9)  # 1e-9: 0.3 / 0.1 is 2.9999...
