"""From the stress at an afferent to the times of its spikes.

Stress is ``(T,)``, or ``(T, condition)`` for traces that share one time axis; row 0
is at `start_ms`, where the membrane is at rest. `encode_cells` has the cells that stand for
a class, at fixed quantiles of its sensitivity, under one stress. `encode_units` has the
fibres of a population, each with its own stress and its own deviate.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import ParameterError, TraceError
from fembridge.typing import FloatArray, IntArray
from neural.filters import Past, checked_stress
from neural.lif import Membrane, State, fire
from neural.models import model_of
from neural.parameters import AfferentParameters, Parameters, quantiles

# Solvers print times with six digits or more; a step may be off by that much. At
# 250 ms that is 0.025 ms, a twentieth of a sample.
_STEP_TOLERANCE = 1.0e-4

# How many membranes are computed at once, and how many numbers of their currents and rows: of a
# trace of an hour, or of a hundred thousand membranes, little is in memory beside the spikes.
_MEMBRANES, _NUMBERS, _ROWS = 1 << 12, 1 << 21, 1 << 16
_LEAST_ROWS = 64
# ... of units, whose stress may take some time for each part.
_UNIT_NUMBERS = 1 << 23


class StressOfUnits(Protocol):
    """Stress at units ``(T, unit)`` in Pa that is made a part at a time."""

    @property
    def samples(self) -> int:
        """T, two or more."""
        ...

    def of(self, rows: IntArray) -> Callable[[int, int], FloatArray]:
        """What makes the stress of the units `rows` from one sample up to another."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class _Whole:
    """An array as `StressOfUnits`."""

    stress_pa: FloatArray

    @property
    def samples(self) -> int:
        return len(self.stress_pa)

    def of(self, rows: IntArray) -> Callable[[int, int], FloatArray]:
        return lambda first, last: self.stress_pa[first:last, rows]


def encode(
    stress_pa: ArrayLike,
    dt_ms: float,
    parameters: AfferentParameters,
    start_ms: float = 0.0,
    derivative: str = "backward",
) -> list[FloatArray]:
    """Spike times of one afferent.

    Parameters
    ----------
    stress_pa
        Stress at the afferent, ``(T,)`` or ``(T, condition)`` in Pa: von Mises
        stress, or what the model of the parameters reads.
    dt_ms
        Time between two samples; the one that the parameters were fitted at.
    parameters
        Of one class and one cell, such as ``PUBLISHED["RA"]``; `encode_cells` is for
        more.
    start_ms
        Time of the first sample.
    derivative
        Scheme of σ′ and σ″, one of `neural.filters.DERIVATIVES`.

    Returns
    -------
    list of ndarray
        Spike times in ms, one array a condition (one for ``(T,)``). A spike stands
        on a sample of the trace, never on the first.

    Raises
    ------
    ParameterError
        A time step that is not the parameters', an unknown scheme, or more than one
        cell.
    TraceError
        Samples that are not a stress history.

    Examples
    --------
    >>> import numpy as np
    >>> from neural import PUBLISHED, encode
    >>> held_pa = np.full(501, 5000.0)
    >>> [times_ms] = encode(held_pa, 0.5, PUBLISHED["SA"])
    >>> times_ms[:3]
    array([14.5, 30. , 45.5])
    """
    if parameters.cells != 1:
        raise ParameterError(
            f"{parameters.afferent}: {parameters.cells} cells, expected one; "
            "encode_cells gives the spikes of each"
        )
    return [cells[0] for cells in encode_cells(stress_pa, dt_ms, parameters, start_ms, derivative)]


def encode_cells(
    stress_pa: ArrayLike,
    dt_ms: float,
    parameters: AfferentParameters,
    start_ms: float = 0.0,
    derivative: str = "backward",
) -> list[list[FloatArray]]:
    """Spike times of each cell of a population, the most sensitive first.

    Arguments and errors are those of `encode`. The list has an entry a condition,
    each a list of one array a cell; the rate of the population is their mean.
    """
    chosen = {parameters.afferent: parameters}
    stress = {parameters.afferent: stress_pa}
    [cells] = encode_afferents(stress, dt_ms, chosen, start_ms, derivative).values()
    return cells


def encode_afferents(
    stress_pa: Mapping[str, ArrayLike],
    dt_ms: float,
    parameters: Parameters,
    start_ms: float = 0.0,
    derivative: str = "backward",
) -> dict[str, list[list[FloatArray]]]:
    """Spike times of several classes at once: one loop over time for all.

    `stress_pa` is by class, ``(T,)`` or ``(T, condition)`` with one T; the other
    arguments and the errors are those of `encode`, the entries of the result those
    of `encode_cells`.
    """
    checked = {name: checked_stress(stress) for name, stress in stress_pa.items()}
    if len({len(stress) for stress in checked.values()}) != 1:
        raise TraceError("stress of unequal lengths, expected one time axis")
    found: dict[str, list[list[FloatArray]]] = {name: [] for name in checked}
    for some in _batches(checked, parameters):
        for name, cells in _encoded(some, dt_ms, parameters, start_ms, derivative).items():
            found[name] += cells
    return found


def _batches(
    stress: Mapping[str, FloatArray], parameters: Parameters
) -> Iterator[Mapping[str, FloatArray]]:
    """All of `stress`, or where that is more than some thousand membranes, parts of it."""
    columns = {name: each.reshape(len(each), -1) for name, each in stress.items()}
    cells = {name: parameters[name].cells for name in stress}
    if sum(cells[name] * columns[name].shape[1] for name in stress) <= _MEMBRANES:
        yield stress
        return
    for name, each in columns.items():
        step = max(1, _MEMBRANES // cells[name])
        for first in range(0, each.shape[1], step):
            yield {name: each[:, first : first + step]}


def _encoded(
    stress: Mapping[str, FloatArray],
    dt_ms: float,
    parameters: Parameters,
    start_ms: float,
    derivative: str,
) -> dict[str, list[list[FloatArray]]]:
    """Spike times as of `encode_afferents`, part by part of the time.

    Of a part a filter sees what is around it, too; what a membrane holds goes on to the next.
    """
    chosen = {name: parameters[name] for name in stress}
    for one in chosen.values():
        check_step(one, dt_ms)
    needs = [np.exp(one.spread * quantiles(one.cells)) for one in chosen.values()]
    shapes = [
        (1 + model_of(one).two_way, one.cells, stress[name].size // len(stress[name]))
        for name, one in chosen.items()
    ]
    sizes = [math.prod(shape) for shape in shapes]
    membrane = Membrane.joined([_membrane(one) for one in chosen.values()], sizes)
    samples = len(next(iter(stress.values())))
    step_ms = next(iter(chosen.values())).dt_ms
    step = max(_LEAST_ROWS, min(_ROWS, _NUMBERS // sum(sizes)))
    state = State.at_rest(sum(sizes))
    currents = [
        _currents(partial(_rows_of, stress[name]), samples, one, derivative, need, step)
        for (name, one), need in zip(chosen.items(), needs, strict=True)
    ]
    parts = []
    first = 0
    for together in zip(*currents, strict=True):
        rows, membranes = fire(np.concatenate(together, axis=1), membrane, state)
        parts.append((rows + first, membranes))
        first += len(together[0])
    rows, membranes = map(np.concatenate, zip(*parts, strict=True))
    order = np.argsort(membranes, kind="stable")
    # The step that row k feeds ends at sample k + 1.
    times_ms = start_ms + (rows[order] + 1.0) * step_ms
    trains = np.split(times_ms, np.searchsorted(membranes[order], np.arange(1, sum(sizes))))
    found: dict[str, list[list[FloatArray]]] = {}
    for name, (ways, cells, conditions), end in zip(
        chosen, shapes, np.cumsum(sizes).tolist(), strict=True
    ):
        mine = trains[end - ways * cells * conditions : end]
        if ways == 2:
            half = cells * conditions
            pairs = zip(mine[:half], mine[half:], strict=True)
            mine = [np.sort(np.concatenate(pair)) for pair in pairs]
        found[name] = [mine[condition::conditions] for condition in range(conditions)]
    return found


@dataclass(frozen=True, slots=True, eq=False)
class UnitSpikes:
    """Spikes in order of unit, then of trial, then of time: ``(spike,)`` each.

    `unit` counts the units from 0, `trial` from 1.
    """

    unit: IntArray
    trial: IntArray
    time_ms: FloatArray


def encode_units(
    stress_pa: FloatArray | StressOfUnits,
    afferent: Sequence[str],
    dt_ms: float,
    parameters: Parameters,
    deviate: FloatArray | None = None,
    *,
    start_ms: float = 0.0,
    trials: int = 1,
    noise_mv: float = 0.0,
    rng: np.random.Generator | None = None,
    derivative: str = "backward",
) -> UnitSpikes:
    """Spikes of units of several classes in one pass.

    Trials differ by noise: a random step is added to a membrane's potential every sample,
    so that it grows as the square root of time, and leaks with the potential.

    Parameters
    ----------
    stress_pa
        Von Mises stress at each unit, ``(T, unit)`` in Pa, or what makes parts of it.
    afferent
        Class of each unit.
    dt_ms
        Time between two samples, the one that the parameters were fitted at.
    parameters
        Of each class.
    deviate
        ``(unit,)``: one of deviate q needs ``exp(spread q)`` times the stress of the median
        unit, where spread is its class's; None: 0.
    trials, noise_mv, rng
        How often, with how much noise: the standard deviation that it would give the
        potential in 1 ms without leak. 0 makes all trials equal.

    Raises
    ------
    ParameterError
        A class without parameters, another time step, noise without an `rng`.
    TraceError
        Samples that are not a stress history.
    """
    names = np.array(afferent, dtype=object)
    stress: StressOfUnits
    if isinstance(stress_pa, np.ndarray):
        array = checked_stress(stress_pa)
        if array.ndim != 2 or array.shape[1] != names.size:
            raise TraceError(f"stress {array.shape}, expected (T, {names.size})")
        stress = _Whole(array)
    else:
        stress = stress_pa
    if unknown := sorted(set(afferent) - set(parameters)):
        raise ParameterError(f"no parameters of {', '.join(unknown)}")
    if not (noise_mv >= 0 and np.isfinite(noise_mv)):
        raise ParameterError(f"noise_mv is {noise_mv}, expected 0 or more")
    if noise_mv and rng is None:
        raise ParameterError("noise takes a random generator")
    deviates = np.zeros(names.size) if deviate is None else np.asarray(deviate, dtype=np.float64)
    parts: list[tuple[IntArray, IntArray, FloatArray]] = []
    for name in dict.fromkeys(afferent):
        one = parameters[name]
        check_step(one, dt_ms)
        model, needs = model_of(one), np.exp(one.spread * deviates)
        if model.quantity != "von_mises":
            raise ParameterError(
                f"model {one.drive!r} of {name} reads {model.quantity}, expected one that reads "
                "von Mises stress"
            )
        membrane = _membrane(one)
        units = np.flatnonzero(names == name)
        width = max(1, _MEMBRANES // trials)
        for first in range(0, units.size, width):
            mine = units[first : first + width]
            count = trials * mine.size * (1 + model.two_way)
            state = State.at_rest(count)
            step = max(_LEAST_ROWS, min(_ROWS, _UNIT_NUMBERS // count))
            currents = _currents(
                stress.of(mine), stress.samples, one, derivative, needs[np.newaxis, mine], step
            )
            for part, fed in enumerate(currents):
                current = np.tile(fed, (1, trials)) if trials > 1 else fed
                if noise_mv and rng is not None:
                    size_mv = noise_mv / np.sqrt(one.dt_ms)
                    current = current + size_mv * rng.standard_normal(current.shape)
                rows, membranes = fire(current, membrane, state)
                times_ms = start_ms + (part * step + rows + 1.0) * one.dt_ms
                trial = membranes // (count // trials) + 1
                parts.append((mine[membranes % mine.size], trial, np.asarray(times_ms)))
    if not parts:
        return UnitSpikes(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))
    unit, trial, time_ms = (np.concatenate(each) for each in zip(*parts, strict=True))
    order = np.lexsort((time_ms, trial, unit))
    return UnitSpikes(unit[order], trial[order], time_ms[order])


def _rows_of(stress: FloatArray, first: int, last: int) -> FloatArray:
    return stress[first:last]


def _currents(
    stress_at: Callable[[int, int], FloatArray],
    samples: int,
    parameters: AfferentParameters,
    derivative: str,
    needs: FloatArray,
    step: int,
) -> Iterator[FloatArray]:
    """Currents ``(step, membrane)`` in mV/ms of one part of a trace after the other.

    `stress_at` makes the stress from one sample up to another. Of a part a filter sees what is
    around it, too; what a recursive filter holds goes on to the next part. The current of the
    last sample would act after the trace: it is left out.
    """
    model = model_of(parameters)
    around = model.samples_around(parameters.dt_ms)
    pasts = [Past() for _ in model.filters]
    for first in range(0, samples - 1, step):
        last = min(first + step, samples - 1)
        begin, end = max(0, first - around), min(samples, last + 1 + around)
        for past in pasts:
            past.before, past.count = first - begin, last - first
        current = _current(stress_at(begin, end), parameters, derivative, needs, pasts)
        yield current[first - begin : last - begin].reshape(last - first, -1)


def check_step(parameters: AfferentParameters, dt_ms: float) -> None:
    """Refuse a time step that `parameters` do not hold for."""
    step_ms = parameters.dt_ms
    if not abs(dt_ms - step_ms) <= _STEP_TOLERANCE * step_ms:
        raise ParameterError(
            f"{parameters.afferent}: the trace has a sample every {dt_ms:g} ms, its "
            f"parameters hold for {step_ms:g} ms; resample the trace"
        )


def _current(
    stress: FloatArray,
    parameters: AfferentParameters,
    derivative: str,
    needs: FloatArray,
    pasts: Sequence[Past] | None = None,
) -> FloatArray:
    """Current ``(T, way, cell, condition)`` in mV/ms of membranes that need `needs` times as much.

    Of a two-way model those of all first membranes, then of all second ones. `stress` is
    ``(T,)`` or ``(T, condition)``, `needs` ``(cell,)``, or of units, one cell each, ``(1, unit)``.
    """
    model = model_of(parameters)
    filtered = model.filtered(stress, parameters.dt_ms, derivative, pasts)
    columns = [each.reshape(len(each), -1) for each in filtered]
    ways = model.ways(parameters.by_name())
    current = np.empty((len(stress), len(ways), len(needs), columns[0].shape[1]))
    for way, own in enumerate(ways):
        for cell, need in enumerate(needs):
            current[:, way, cell] = own.for_need(need).current(columns)
    return current


def _membrane(parameters: AfferentParameters) -> Membrane:
    return model_of(parameters).membrane(parameters.by_name(), parameters.dt_ms)
