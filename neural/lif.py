"""Leaky integrate-and-fire membrane, equation (7), by forward Euler.

The potential is relative to rest. Row k of a current acts from time t to t + dt::

    v(t + dt) = (1 − dt/τ) v(t) + dt I'(t)

and a spike is at t + dt, never before its cause. "Exceeded a threshold" is taken
strictly: v > gap, where the gap is threshold minus rest. A spike resets v to rest; during
the refractory period after it the current is ignored and v stays at rest.

Two membranes extend the paper. A *clamped* one does not fall below rest: a negative
current only reduces the integrated potential. An *adaptive* one has a threshold that each
spike raises by a jump and that returns with its own time constant::

    θ(t + dt) = (1 − dt/τ_θ) θ(t),  then + jump if v(t + dt) > gap + θ(t + dt)

With *until the turn* θ returns to 0 as soon as a current drives v below rest. A membrane with
*fatigue* has a second rise of the threshold, which each spike sets to one value, whatever it was,
and which lasts across turns::

    φ(t + dt) = (1 − dt/τ_φ) φ(t),  then φ = fatigue if v(t + dt) > gap + θ(t + dt) + φ(t + dt)

Internally v is in units of dt, which saves a product per sample. This is exact where dt is
a power of two, such as 0.5 ms.
"""

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from fembridge.errors import TraceError
from fembridge.typing import BoolArray, FloatArray, IntArray
from neural.compiled import compiled

# Up to this number, membranes are faster one by one.
_MAX_ONE_BY_ONE = 20


@dataclass(frozen=True, slots=True, eq=False)
class Membrane:
    """Constants of one or many membranes: numbers, or arrays that broadcast to their shape.

    `decay` is ``1 − dt/τ``; `threshold` is the gap and `jump` the rise of the threshold by a
    spike, both in mV over dt in ms; for `refractory` rows after a spike there is no current;
    `decay_of_jump` is the share of a jump that remains one row later; `fatigue` is the second rise
    that a spike sets, in the unit of `jump`, and `decay_of_fatigue` its share one row later.
    """

    decay: ArrayLike
    threshold: ArrayLike
    refractory: ArrayLike = 0
    clamped: ArrayLike = False
    jump: ArrayLike = 0.0
    decay_of_jump: ArrayLike = 1.0
    until_turn: ArrayLike = False
    fatigue: ArrayLike = 0.0
    decay_of_fatigue: ArrayLike = 1.0

    @classmethod
    def from_times(
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
        fatigue_mv: ArrayLike = 0.0,
        fatigue_ms: ArrayLike = math.inf,
    ) -> "Membrane":
        """Constants at the time step `dt_ms`; the refractory period is rounded up to rows."""
        rows = np.ceil(np.divide(refractory_ms, dt_ms) - 1e-9)  # 1e-9: 0.3 / 0.1 is 2.9999...
        return cls(
            decay=1.0 - np.divide(dt_ms, tau_ms),
            threshold=np.divide(gap_mv, dt_ms),
            refractory=rows.astype(np.int64),
            clamped=clamped,
            jump=np.divide(jump_mv, dt_ms),
            decay_of_jump=1.0 - np.divide(dt_ms, recovery_ms),
            until_turn=until_turn,
            fatigue=np.divide(fatigue_mv, dt_ms),
            decay_of_fatigue=1.0 - np.divide(dt_ms, fatigue_ms),
        )

    @classmethod
    def joined(cls, members: Sequence["Membrane"], counts: Sequence[int]) -> "Membrane":
        """One membrane array with `counts` copies of each of `members`, in order."""
        columns = zip(*(member.constants() for member in members), strict=True)
        return cls(*(np.repeat(column, counts) for column in columns))

    def constants(self) -> tuple[Any, ...]:
        """Values of all constants, in the order of the fields."""
        return tuple(getattr(self, constant.name) for constant in fields(self))


@dataclass(slots=True)
class State:
    """State of membranes between two rows, arrays of one shape.

    `potential` and the rises of the threshold, `raised` by jumps and `tired` by fatigue, are in
    units of dt; `rest` is the number of following rows without current.
    """

    potential: FloatArray
    raised: FloatArray
    rest: IntArray
    tired: FloatArray

    @classmethod
    def at_rest(cls, shape: int | tuple[int, ...], kind: DTypeLike = np.float64) -> "State":
        """State of `shape` membranes before the first row; `kind` is the precision of steps."""
        potential, raised, tired = np.zeros((3, *np.atleast_1d(shape)), kind)
        return cls(potential, raised, np.zeros(shape, dtype=np.int64), tired)


def fire(
    current: FloatArray, membrane: Membrane, state: State | None = None
) -> tuple[IntArray, IntArray]:
    """Row and membrane of every spike, ``(spikes,)`` each.

    Parameters
    ----------
    current
        ``(T, ...)`` in mV/ms, one row per time step.
    membrane
        Constants that broadcast to a row.
    state
        State ``(membrane,)`` before the first row (default: at rest). It is replaced by the
        state after the last row, so that a long current can be passed in parts.

    Returns
    -------
    rows, membranes
        Sorted by membrane, an index into a flattened row, then by time.

    Raises
    ------
    TraceError
        A current that is not finite.
    """
    if not np.isfinite(current.sum()):
        raise TraceError("a current that is not finite reached the membrane")
    flat = current.reshape(len(current), -1)
    count = flat.shape[1]
    current_state = state or State.at_rest(count)
    if step := compiled(_fire_rows):
        return _fire_compiled(step, flat, membrane, current_state, current.shape[1:])
    constants = Membrane(
        *(
            np.broadcast_to(constant, current.shape[1:]).reshape(-1)
            for constant in membrane.constants()
        )
    )
    if count <= _MAX_ONE_BY_ONE:
        return _fire_each(flat, constants, current_state)
    spikes_by_row = [spikes for spikes, _ in spiking(flat, constants, current_state)]
    sizes = [spikes.size for spikes in spikes_by_row]
    membranes = np.concatenate(spikes_by_row)
    order = np.argsort(membranes, kind="stable")
    return np.repeat(np.arange(len(spikes_by_row)), sizes)[order], membranes[order]


def spiking(
    rows: Iterable[FloatArray], membrane: Membrane, state: State
) -> Iterator[tuple[IntArray, BoolArray]]:
    """Spiking membranes of each row: indices into a flattened row, and flags.

    One loop over time for all cells, classes and stimuli; rows have the shape of `state`.
    During the refractory period the potential is reset to rest in each row. With some
    hundred membranes most of the time is the overhead of NumPy calls, so the loop has few.
    """
    potential, raised, tired = state.potential, state.raised, state.tired
    shape, kind = potential.shape, potential.dtype
    decay, threshold, kept_share, kept_fatigue = (
        np.asarray(constant, kind)
        for constant in (
            membrane.decay,
            membrane.threshold,
            membrane.decay_of_jump,
            membrane.decay_of_fatigue,
        )
    )
    jump, fatigue, refractory, clamped, turns = (
        np.broadcast_to(constant, shape).reshape(-1)
        for constant in (
            membrane.jump,
            membrane.fatigue,
            membrane.refractory,
            membrane.clamped,
            membrane.until_turn,
        )
    )
    jump, fatigue = jump.astype(kind), fatigue.astype(kind)
    adapts, fades = bool(jump.any()), bool((kept_share != 1.0).any())
    clamps, returns, tires = bool(clamped.any()), bool(turns.any()), bool(fatigue.any())
    # Arrays, since NumPy compares with a scalar four times as slowly.
    lowest, turn = (
        np.where(flags, 0.0, -np.inf).astype(kind).reshape(shape) for flags in (clamped, turns)
    )
    above, ahead = np.empty(shape, np.bool_), np.empty(shape, np.bool_)
    flat_potential, flat_raised, flat_tired, flat_above = (
        array.reshape(-1) for array in (potential, raised, tired, above)
    )
    # For each refractory period: its membranes, and their spikes in that many previous rows.
    rest = state.rest.reshape(-1)
    refractory_groups = []
    for length in np.unique(refractory[refractory > 0]).tolist():
        members = refractory == length
        before = [np.flatnonzero(members & (rest == n + 1)) for n in range(length)]
        refractory_groups.append((None if members.all() else members, deque(before, maxlen=length)))
    for current in rows:
        limit = threshold
        np.multiply(potential, decay, out=potential)
        np.add(potential, current, out=potential)
        for _, recent_spikes in refractory_groups:
            for spikes in recent_spikes:
                if spikes.size:
                    flat_potential[spikes] = 0.0
        if returns:
            raised *= np.greater_equal(potential, turn, out=ahead)
        if clamps:
            np.maximum(potential, lowest, out=potential)
        if adapts:
            if fades:
                raised *= kept_share
            limit = threshold + raised
        if tires:
            tired *= kept_fatigue
            limit = limit + tired
        np.greater(potential, limit, out=above)
        (spikes,) = flat_above.nonzero()
        yield spikes, above
        flat_potential[spikes] = 0.0
        if adapts:
            flat_raised[spikes] += jump[spikes]
        if tires:
            flat_tired[spikes] = fatigue[spikes]
        for members, recent_spikes in refractory_groups:
            recent_spikes.append(spikes if members is None else spikes[members[spikes]])
    rest[:] = 0
    for _, recent_spikes in refractory_groups:
        for n, spikes in enumerate(recent_spikes):
            rest[spikes] = n + 1


def _fire_compiled(
    step: Callable[..., tuple[IntArray, IntArray]],
    current: FloatArray,
    membrane: Membrane,
    state: State,
    shape: tuple[int, ...],
) -> tuple[IntArray, IntArray]:
    """`fire` by the compiled loop `step`; constants broadcast to `shape`."""
    decay, threshold, refractory, clamped, jump, kept_share, turns, *fatigue = membrane.constants()
    lowest, turn = (np.where(flags, 0.0, -np.inf) for flags in (clamped, turns))
    values = np.empty((8, *shape))
    for row, constant in zip(
        values, (decay, threshold, jump, kept_share, lowest, turn, *fatigue), strict=True
    ):
        row[...] = constant
    rests = np.empty(shape, np.int64)
    rests[...] = refractory
    rows, membranes = step(
        np.ascontiguousarray(current, dtype=np.float64),
        values.reshape(len(values), -1),
        rests.reshape(-1),
        state.potential,
        state.raised,
        state.rest,
        state.tired,
    )
    order = np.argsort(membranes, kind="stable")
    return rows[order], membranes[order]


def _fire_rows(
    current: FloatArray,
    values: FloatArray,
    refractory: IntArray,
    potential: FloatArray,
    raised: FloatArray,
    rest: IntArray,
    tired: FloatArray,
) -> tuple[IntArray, IntArray]:
    """Row and membrane of every spike, by time; the state is changed to that after the last row.

    The rows of `values` are decay, threshold, jump, share kept of it, lowest potential, the
    potential below which the threshold returns, fatigue, and share kept of it. The inner loop has
    no branches but choices between two numbers, so that it becomes vector instructions.
    """
    decay, threshold, jump, kept_share, lowest, turn, fatigue, kept_fatigue = values
    count = decay.size
    fired = np.zeros(count, np.float64)
    spikes, room = 0, 1024
    at_row, at_membrane = np.empty(room, np.int64), np.empty(room, np.int64)
    # In double precision as all else: a row is one kind of vector.
    waiting = rest.astype(np.float64)
    for row in range(current.shape[0]):
        fed, total = current[row], 0.0
        for k in range(count):
            next_potential = potential[k] * decay[k] + fed[k]
            next_potential = 0.0 if waiting[k] > 0.0 else next_potential
            added = 0.0 if next_potential < turn[k] else raised[k]
            added *= kept_share[k]
            next_potential = lowest[k] if next_potential < lowest[k] else next_potential
            fatigued = tired[k] * kept_fatigue[k]
            spike = 1.0 if next_potential > threshold[k] + added + fatigued else 0.0
            potential[k] = 0.0 if spike > 0.0 else next_potential
            raised[k] = added
            tired[k] = fatigued
            waiting[k] = max(waiting[k] - 1.0, 0.0)
            fired[k] = spike
            total += spike
        if total > 0.0:
            for k in range(count):
                if fired[k] > 0.0:
                    raised[k] += jump[k]
                    tired[k] = fatigue[k]
                    waiting[k] = refractory[k]
                    if spikes == room:
                        room *= 2
                        more_rows, more_membranes = (
                            np.empty(room, np.int64),
                            np.empty(room, np.int64),
                        )
                        more_rows[:spikes], more_membranes[:spikes] = at_row, at_membrane
                        at_row, at_membrane = more_rows, more_membranes
                    at_row[spikes], at_membrane[spikes] = row, k
                    spikes += 1
    for k in range(count):
        rest[k] = np.int64(waiting[k])
    return at_row[:spikes], at_membrane[:spikes]


def _fire_each(current: FloatArray, membrane: Membrane, state: State) -> tuple[IntArray, IntArray]:
    """`fire` for few membranes, one after the other, without NumPy in the loop over time."""
    constants = [constant.tolist() for constant in membrane.constants()]
    trains: list[list[int]] = []
    for k, (fed, *own_constants) in enumerate(zip(current.T, *constants, strict=True)):
        leak, gap, refractory_rows, clamped, jump, kept_share, resets_at_turn = own_constants[:7]
        fatigue, kept_fatigue = own_constants[7:]
        potential, raised = state.potential[k].item(), state.raised[k].item()
        tired = state.tired[k].item()
        first_fed_row, spikes = state.rest[k].item(), list[int]()
        for row, sample in enumerate(fed.tolist()):
            potential = potential * leak + (sample if row >= first_fed_row else 0.0)
            if resets_at_turn and potential < 0.0:
                raised = 0.0
            if clamped and potential < 0.0:
                potential = 0.0
            if jump:
                raised *= kept_share
            if fatigue:
                tired *= kept_fatigue
            if potential > gap + raised + tired:
                spikes.append(row)
                potential, first_fed_row = 0.0, row + 1 + refractory_rows
                raised += jump
                tired = fatigue
        state.potential[k], state.raised[k], state.tired[k] = potential, raised, tired
        state.rest[k] = max(0, first_fed_row - len(fed))
        trains.append(spikes)
    rows = np.array([row for train in trains for row in train], dtype=np.int64)
    return rows, np.repeat(np.arange(len(trains)), [len(train) for train in trains])
