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

and, *until the turn*, is all back at once as soon as a current drives v below rest.

Inside, v is kept in units of dt, which saves a product a sample. For a dt that is
a power of two, as 0.5 ms is, that is exact.
"""

import math
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from fembridge.errors import TraceError
from fembridge.typing import BoolArray, FloatArray, IntArray

# So many membranes and fewer are quicker one by one.
_FEW = 20


@dataclass(frozen=True, slots=True, eq=False)
class Membrane:
    """Constants of one membrane, or of many: numbers, or arrays that broadcast to them.

    `decay` is ``1 − dt/τ``; `threshold`, the gap, and `jump`, what a spike adds to it, are in
    units of dt; for `refractory` rows after a spike there is no current; `decay_of_jump` is
    the share of a jump that is left a row later.
    """

    decay: ArrayLike
    threshold: ArrayLike
    refractory: ArrayLike = 0
    clamped: ArrayLike = False
    jump: ArrayLike = 0.0
    decay_of_jump: ArrayLike = 1.0
    until_turn: ArrayLike = False

    @classmethod
    def of(
        cls,
        dt_ms: float,
        *,
        tau_ms: ArrayLike,
        gap_mv: ArrayLike,
        refractory_ms: ArrayLike = 0.0,
        clamped: ArrayLike = False,
        jump_mv: ArrayLike = 0.0,
        recovery_ms: ArrayLike = math.inf,
        until_turn: ArrayLike = False,
    ) -> "Membrane":
        """The constants at a time step; a part of a refractory step counts as a step."""
        rows = np.ceil(np.divide(refractory_ms, dt_ms) - 1e-9)  # 1e-9: 0.3 / 0.1 is 2.9999...
        return cls(
            decay=1.0 - np.divide(dt_ms, tau_ms),
            threshold=np.divide(gap_mv, dt_ms),
            refractory=rows.astype(np.int64),
            clamped=clamped,
            jump=np.divide(jump_mv, dt_ms),
            decay_of_jump=1.0 - np.divide(dt_ms, recovery_ms),
            until_turn=until_turn,
        )

    @classmethod
    def joined(cls, members: Sequence["Membrane"], counts: Sequence[int]) -> "Membrane":
        """So many of each of `members`, one after the other."""
        columns = zip(*(each.constants() for each in members), strict=True)
        return cls(*(np.repeat(column, counts) for column in columns))

    def constants(self) -> tuple[Any, ...]:
        """All of them, in the order of the class."""
        return tuple(getattr(self, one.name) for one in fields(self))


@dataclass(slots=True)
class State:
    """Where membranes stand between two rows, arrays of one shape.

    `potential` and what is `raised` of the threshold, both in units of dt, and for how
    many rows to come there is no current, `rest`.
    """

    potential: FloatArray
    raised: FloatArray
    rest: IntArray

    @classmethod
    def at_rest(cls, shape: int | tuple[int, ...], kind: DTypeLike = np.float64) -> "State":
        """So many before their first row; `kind` is the precision of their steps."""
        return cls(np.zeros(shape, kind), np.zeros(shape, kind), np.zeros(shape, dtype=np.int64))


def fire(
    current: FloatArray, membrane: Membrane, state: State | None = None
) -> tuple[IntArray, IntArray]:
    """Row and membrane of every step that ends in a spike, ``(spikes,)`` each.

    Parameters
    ----------
    current
        ``(T, ...)`` in mV/ms, a row a step.
    membrane
        Constants that broadcast to a row.
    state
        Of the membranes before the first row (None: at rest), ``(membrane,)``. It becomes
        that behind the last, so that a long current can come in parts.

    Returns
    -------
    rows, membranes
        In order of the membranes, places in a flattened row; of each in order of time.

    Raises
    ------
    TraceError
        A current that is not finite.
    """
    if not np.isfinite(current.sum()):
        raise TraceError("a current that is not finite reached the membrane")
    flat = current.reshape(len(current), -1)
    count = flat.shape[1]
    now = state or State.at_rest(count)
    each = Membrane(
        *(np.broadcast_to(one, current.shape[1:]).reshape(-1) for one in membrane.constants())
    )
    if count <= _FEW:
        return _fire_each(flat, each, now)
    found = [spikes for spikes, _ in spiking(flat, each, now)]
    sizes = [spikes.size for spikes in found]
    membranes = np.concatenate(found)
    order = np.argsort(membranes, kind="stable")
    return np.repeat(np.arange(len(found)), sizes)[order], membranes[order]


def spiking(
    rows: Iterable[FloatArray], membrane: Membrane, state: State
) -> Iterator[tuple[IntArray, BoolArray]]:
    """Which membranes spike, row by row of their current: places in a flattened row, and flags.

    One loop over time for all cells, classes and stimuli; rows have the shape of `state`. As
    a potential is at rest after a spike, it is enough to put it there again in the rows of
    the refractory period. With some hundred membranes most of the time goes into calling
    NumPy, so the loop calls it as seldom as it can.
    """
    potential, raised, shape = state.potential, state.raised, state.potential.shape
    kind = potential.dtype
    decay, threshold, left = (
        np.asarray(one, kind)
        for one in (membrane.decay, membrane.threshold, membrane.decay_of_jump)
    )
    jump, refractory, clamped, turns = (
        np.broadcast_to(one, shape).reshape(-1)
        for one in (membrane.jump, membrane.refractory, membrane.clamped, membrane.until_turn)
    )
    jump = jump.astype(kind)
    adapts, fades = bool(jump.any()), bool((left != 1.0).any())
    clamps, returns = bool(clamped.any()), bool(turns.any())
    # Arrays: NumPy takes four times as long to compare with a number.
    lowest, turn = (
        np.where(flags, 0.0, -np.inf).astype(kind).reshape(shape) for flags in (clamped, turns)
    )
    above, ahead = np.empty(shape, np.bool_), np.empty(shape, np.bool_)
    flat_potential, flat_raised, flat_above = (
        each.reshape(-1) for each in (potential, raised, above)
    )
    # Of each refractory period its membranes, and their spikes of so many rows before.
    rest = state.rest.reshape(-1)
    quiet = []
    for length in np.unique(refractory[refractory > 0]).tolist():
        mine = refractory == length
        before = [np.flatnonzero(mine & (rest == n + 1)) for n in range(length)]
        quiet.append((None if mine.all() else mine, deque(before, maxlen=length)))
    limit = threshold
    for fed in rows:
        np.multiply(potential, decay, out=potential)
        np.add(potential, fed, out=potential)
        for _, trains in quiet:
            for spikes in trains:
                if spikes.size:
                    flat_potential[spikes] = 0.0
        if returns:
            raised *= np.greater_equal(potential, turn, out=ahead)
        if clamps:
            np.maximum(potential, lowest, out=potential)
        if adapts:
            if fades:
                raised *= left
            limit = threshold + raised
        np.greater(potential, limit, out=above)
        (spikes,) = flat_above.nonzero()
        yield spikes, above
        flat_potential[spikes] = 0.0
        if adapts:
            flat_raised[spikes] += jump[spikes]
        for mine, trains in quiet:
            trains.append(spikes if mine is None else spikes[mine[spikes]])
    rest[:] = 0
    for _, trains in quiet:
        for n, spikes in enumerate(trains):
            rest[spikes] = n + 1


def _fire_each(current: FloatArray, membrane: Membrane, now: State) -> tuple[IntArray, IntArray]:
    """The same as `fire`, a membrane after the other: calling NumPy costs more than numbers."""
    constants = [one.tolist() for one in membrane.constants()]
    trains: list[list[int]] = []
    for k, (fed, *own) in enumerate(zip(current.T, *constants, strict=True)):
        leak, gap, quiet, clamped, jump, left, turns = own
        potential, raised = now.potential[k].item(), now.raised[k].item()
        until, spikes = now.rest[k].item(), list[int]()
        for row, one in enumerate(fed.tolist()):
            potential = potential * leak + (one if row >= until else 0.0)
            if turns and potential < 0.0:
                raised = 0.0
            if clamped and potential < 0.0:
                potential = 0.0
            if jump:
                raised *= left
            if potential > gap + raised:
                spikes.append(row)
                potential, until = 0.0, row + 1 + quiet
                raised += jump
        now.potential[k], now.raised[k] = potential, raised
        now.rest[k] = max(0, until - len(fed))
        trains.append(spikes)
    rows = np.array([row for train in trains for row in train], dtype=np.int64)
    return rows, np.repeat(np.arange(len(trains)), [len(train) for train in trains])
