"""From the stress at an afferent to the times of its spikes.

Stress is ``(T,)``, or ``(T, condition)`` for traces that share one time axis; row 0
is at `start_ms`, where the membrane is at rest. `encode_cells` encodes one stress by the cells
of a class, at fixed quantiles of its sensitivity. `encode_units` encodes a population of
units, each with its own stress and deviate.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import ParameterError, TraceError
from fembridge.host.progress import advance
from fembridge.typing import BoolArray, FloatArray, IntArray
from neural.compiled import compile_for, compiled
from neural.filters import LEVELS, RISES, Past, checked_stress, stress_rate
from neural.lif import Membrane, State, fire
from neural.models import SAMPLES_AROUND, model_of
from neural.parameters import AfferentParameters, Parameters, quantiles
from neural.time_step import overshoot, read_at_step, step_ratio

# Numbers of membranes, of values of their currents and of rows that are computed at once. They
# limit the memory for a trace of an hour, or for a hundred thousand membranes.
_MEMBRANES, _NUMBERS, _ROWS = 1 << 12, 1 << 21, 1 << 16
_LEAST_ROWS = 64
# Numbers of the stress of units read at once; many, since each part of it has a fixed cost.
_UNIT_NUMBERS = 1 << 23
# Membranes of units, and values of their currents, computed at once: these stay in the cache.
_BLOCK_MEMBRANES, _BLOCK_NUMBERS = 64, 1 << 16
# A bound on a potential below this share of the threshold is below it after rounding.
_SURELY = 0.999


class UnitStress(Protocol):
    """Stress at units, ``(T, unit)`` in Pa, computed part by part."""

    @property
    def samples(self) -> int:
        """T, two or more."""
        ...

    def reader(self, rows: IntArray) -> Callable[[int, int], FloatArray]:
        """Function of a first and an end sample that returns the stress of the units `rows`."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class _StressArray:
    """An array as `UnitStress`."""

    stress_pa: FloatArray

    @property
    def samples(self) -> int:
        return len(self.stress_pa)

    def reader(self, rows: IntArray) -> Callable[[int, int], FloatArray]:
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
        stress, or the quantity that the model of the parameters reads.
    dt_ms
        Time between two samples in ms: that of the parameters, or a multiple or divisor of it.
        Parameters whose equation contains the time step take no coarser trace.
    parameters
        Parameters of one class with one cell, such as ``PUBLISHED["RA"]``. For several
        cells use `encode_cells`.
    start_ms
        Time of the first sample in ms. Default: 0.
    derivative
        Scheme of σ′ and σ″, one of `neural.filters.DERIVATIVES`. Default: ``backward``.

    Returns
    -------
    list of ndarray
        Spike times in ms, one array per condition (one for ``(T,)``). A spike is at
        the time of a sample, never of the first.

    Raises
    ------
    ParameterError
        A time step that does not fit that of the parameters, an unknown scheme, or more
        than one cell.
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
            f"has {parameters.cells} cells, expected one; encode_cells encodes several",
            argument="parameters",
            found=parameters.cells,
            expected="one cell",
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

    Arguments and errors are those of `encode`. The list has one entry per condition,
    a list with one array per cell. The rate of the population is the mean over cells.

    Examples
    --------
    >>> import numpy as np
    >>> from neural import encode_cells, parameter_set
    >>> stress_pa = 20e3 * (1 - np.cos(0.3 * np.arange(0, 200, 0.1)))
    >>> (cells_ms,) = encode_cells(stress_pa, 0.1, parameter_set("fitted").parameters["RA"])
    >>> len(cells_ms), cells_ms[0].size > cells_ms[-1].size
    (10, True)
    """
    class_parameters = {parameters.afferent: parameters}
    stress = {parameters.afferent: stress_pa}
    [cells] = encode_afferents(stress, dt_ms, class_parameters, start_ms, derivative).values()
    return cells


def encode_afferents(
    stress_pa: Mapping[str, ArrayLike],
    dt_ms: float,
    parameters: Parameters,
    start_ms: float = 0.0,
    derivative: str = "backward",
) -> dict[str, list[list[FloatArray]]]:
    """Spike times of several classes, in one loop over time.

    `stress_pa` has the stress of each class, ``(T,)`` or ``(T, condition)`` with the same T.
    The other arguments and the errors are those of `encode`; the result has one entry per
    class, as `encode_cells` returns it.

    Examples
    --------
    >>> import numpy as np
    >>> from neural import PUBLISHED, encode_afferents
    >>> stress_pa = 5e3 * (1 - np.cos(0.3 * np.arange(0, 200, 0.5)))
    >>> spikes_ms = encode_afferents({"SA": stress_pa, "RA": stress_pa}, 0.5, PUBLISHED)
    >>> len(spikes_ms["SA"]), len(spikes_ms["SA"][0])
    (1, 1)
    """
    checked = {name: checked_stress(stress) for name, stress in stress_pa.items()}
    if len({len(stress) for stress in checked.values()}) != 1:
        raise TraceError("stress of unequal lengths, expected one time axis")
    spikes: dict[str, list[list[FloatArray]]] = {name: [] for name in checked}
    for step_ms in dict.fromkeys(parameters[name].dt_ms for name in checked):
        of_step = {k: stress for k, stress in checked.items() if parameters[k].dt_ms == step_ms}
        for batch in _batches(of_step, parameters):
            for name, cells in _encoded(batch, dt_ms, parameters, start_ms, derivative).items():
                spikes[name] += cells
    return spikes


def _batches(
    stress: Mapping[str, FloatArray], parameters: Parameters
) -> Iterator[Mapping[str, FloatArray]]:
    """Parts of `stress` with at most `_MEMBRANES` membranes; one part where all fit."""
    columns = {name: columns_pa.reshape(len(columns_pa), -1) for name, columns_pa in stress.items()}
    cells = {name: parameters[name].cells for name in stress}
    if sum(cells[name] * columns[name].shape[1] for name in stress) <= _MEMBRANES:
        yield stress
        return
    for name, columns_pa in columns.items():
        step = max(1, _MEMBRANES // cells[name])
        for first in range(0, columns_pa.shape[1], step):
            yield {name: columns_pa[:, first : first + step]}


def _encoded(
    stress: Mapping[str, FloatArray],
    dt_ms: float,
    parameters: Parameters,
    start_ms: float,
    derivative: str,
) -> dict[str, list[list[FloatArray]]]:
    """Spike times as in `encode_afferents`, computed part by part in time.

    All classes have one time step. A filter also reads samples around a part; the state of a
    membrane continues in the next.
    """
    class_parameters = {name: parameters[name] for name in stress}
    readers = {
        name: read_at_step(partial(_rows_of, stress[name]), len(stress[name]), values, dt_ms)
        for name, values in class_parameters.items()
    }
    stress_factors = [
        np.exp(values.spread * quantiles(values.cells)) for values in class_parameters.values()
    ]
    shapes = [
        (1 + model_of(values).two_way, values.cells, stress[name].size // len(stress[name]))
        for name, values in class_parameters.items()
    ]
    sizes = [math.prod(shape) for shape in shapes]
    membrane = Membrane.joined([_membrane(values) for values in class_parameters.values()], sizes)
    step_ms = next(iter(class_parameters.values())).dt_ms
    step = max(_LEAST_ROWS, min(_ROWS, _NUMBERS // sum(sizes)))
    state = State.at_rest(sum(sizes))
    currents = [
        _currents(*readers[name], values, derivative, factors, step)
        for (name, values), factors in zip(class_parameters.items(), stress_factors, strict=True)
    ]
    no_spikes = np.zeros(0, np.int64)
    parts = [(no_spikes, no_spikes)]  # two samples of a finer trace are one sample, without any
    first = 0
    for part_currents in zip(*currents, strict=True):
        rows, membranes = fire(np.concatenate(part_currents, axis=1), membrane, state)
        parts.append((rows + first, membranes))
        first += len(part_currents[0])
    rows, membranes = map(np.concatenate, zip(*parts, strict=True))
    order = np.argsort(membranes, kind="stable")
    # The current of row k acts until sample k + 1.
    times_ms = start_ms + (rows[order] + 1.0) * step_ms
    trains = np.split(times_ms, np.searchsorted(membranes[order], np.arange(1, sum(sizes))))
    spikes: dict[str, list[list[FloatArray]]] = {}
    for name, (membranes_per_cell, cells, conditions), end in zip(
        class_parameters, shapes, np.cumsum(sizes).tolist(), strict=True
    ):
        class_trains = trains[end - membranes_per_cell * cells * conditions : end]
        if membranes_per_cell == 2:
            half = cells * conditions
            pairs = zip(class_trains[:half], class_trains[half:], strict=True)
            class_trains = [np.sort(np.concatenate(pair)) for pair in pairs]
        spikes[name] = [class_trains[condition::conditions] for condition in range(conditions)]
    return spikes


@dataclass(frozen=True, slots=True, eq=False)
class UnitSpikes:
    """Spikes sorted by unit, trial and time, ``(spike,)`` each.

    `unit` is an index from 0, `trial` a number from 1.
    """

    unit: IntArray
    trial: IntArray
    time_ms: FloatArray


def encode_units(
    stress_pa: FloatArray | UnitStress,
    afferent: Sequence[str],
    dt_ms: float,
    parameters: Parameters,
    deviate: FloatArray | None = None,
    *,
    sign: FloatArray | None = None,
    start_ms: float = 0.0,
    trials: int = 1,
    noise_mv: float = 0.0,
    rng: np.random.Generator | None = None,
    derivative: str = "backward",
) -> UnitSpikes:
    """Spikes of units of several classes.

    Trials differ by noise: at each sample a random step is added to the potential of a
    membrane. Without leak, the standard deviation grows with the square root of time.

    Parameters
    ----------
    stress_pa
        Von Mises stress at each unit, ``(T, unit)`` in Pa, or a `UnitStress`.
    afferent
        Class of each unit.
    dt_ms
        Time between two samples in ms, as of `encode`.
    parameters
        Parameters of each class.
    deviate
        Deviates ``(unit,)``: a unit with deviate q needs ``exp(spread q)`` times the stress
        of the median unit, with the spread of its class. Default: 0.
    sign
        Signs ``(unit,)``, 1 or −1, by which the stress is multiplied where the drive of a class
        has a sign (``AfferentModel.is_signed``). Default: 1.
    start_ms
        Time of the first sample in ms. Default: 0.
    trials
        Number of trials. Default: 1.
    noise_mv
        Standard deviation in mV of the potential after 1 ms of noise without leak. Default:
        0, which makes all trials equal.
    rng
        Random generator, required with noise. Default: None.
    derivative
        Scheme of σ′ and σ″, one of `neural.filters.DERIVATIVES`. Default: ``backward``.

    Raises
    ------
    ParameterError
        A class without parameters, another time step, noise without an `rng`.
    TraceError
        Samples that are not a stress history.
    """
    names = np.array(afferent, dtype=object)
    stress: UnitStress
    if isinstance(stress_pa, np.ndarray):
        array = checked_stress(stress_pa)
        if array.ndim != 2 or array.shape[1] != names.size:
            expected = f"(T, {names.size})"
            problem = f"has shape {array.shape}, expected {expected}"
            raise TraceError(problem, argument="stress_pa", found=array.shape, expected=expected)
        stress = _StressArray(array)
    else:
        stress = stress_pa
    if unknown := sorted(set(afferent) - set(parameters)):
        problem = f"has {', '.join(unknown)}, without parameters"
        raise ParameterError(problem, argument="afferent", found=unknown[0])
    if not (noise_mv >= 0 and np.isfinite(noise_mv)):
        raise ParameterError(argument="noise_mv", found=noise_mv, expected="0 or more")
    if noise_mv and rng is None:
        raise ParameterError("noise requires a random generator", argument="rng")
    deviates = np.zeros(names.size) if deviate is None else np.asarray(deviate, dtype=np.float64)
    signs = np.ones(names.size) if sign is None else np.asarray(sign, dtype=np.float64)
    if signs.shape != names.shape or not np.isin(signs, (-1.0, 1.0)).all():
        wrong: object = signs.shape
        if signs.shape == names.shape:
            wrong = float(signs[np.abs(signs) != 1.0][0])
        expected = f"({names.size},) of 1 or -1"
        raise ParameterError(argument="sign", found=wrong, expected=expected)
    parts: list[tuple[IntArray, IntArray, FloatArray]] = []
    for name in dict.fromkeys(afferent):
        values = parameters[name]
        step_ratio(values, dt_ms)
        model, stress_factors = model_of(values), np.exp(values.spread * deviates)
        if model.quantity != "von_mises":
            raise ParameterError(
                f"model {values.drive!r} of {name} reads {model.quantity}, expected a model of "
                "von Mises stress"
            )
        membrane = _membrane(values)
        units = np.flatnonzero(names == name)
        width = max(1, _MEMBRANES // trials)
        finer, coarser = step_ratio(values, dt_ms)
        for first in range(0, units.size, width):
            batch_units = units[first : first + width]
            read = _read_ahead(stress.reader(batch_units), stress.samples, batch_units.size)
            if model.is_signed and (signs[batch_units] < 0).any():
                read = partial(_times, read, signs[batch_units])
            columns = np.arange(batch_units.size)
            if not noise_mv and stress.samples * batch_units.size <= _UNIT_NUMBERS:
                may_fire = _may_fire(
                    read(0, stress.samples), values, dt_ms, stress_factors[batch_units]
                )
                columns, batch_units = columns[may_fire], batch_units[may_fire]
                if not columns.size:
                    continue
            # Noise is drawn for all units at once, whatever the size of a block.
            is_compiled = compile_for(columns.size * trials * (stress.samples * finer // coarser))
            in_blocks = is_compiled and not noise_mv
            size = max(1, _BLOCK_MEMBRANES // trials) if in_blocks else columns.size
            blocks = [slice(start, start + size) for start in range(0, columns.size, size)]
            members = 1 + model.two_way
            numbers = _BLOCK_NUMBERS if in_blocks else _UNIT_NUMBERS
            largest = trials * members * batch_units[blocks[0]].size
            step = max(_LEAST_ROWS, min(_ROWS, numbers // largest))
            states = [State.at_rest(trials * members * batch_units[block].size) for block in blocks]
            currents = [
                _currents(
                    *read_at_step(
                        partial(_columns_of, read, columns[block]), stress.samples, values, dt_ms
                    ),
                    values,
                    derivative,
                    stress_factors[np.newaxis, batch_units[block]],
                    step,
                )
                for block in blocks
            ]
            done = first / units.size
            for part, part_currents in enumerate(zip(*currents, strict=True)):
                share = part * step * coarser / (stress.samples * finer)
                advance(f"spikes of {name}", done + share * batch_units.size / units.size)
                for block, state, fed in zip(blocks, states, part_currents, strict=True):
                    block_units = batch_units[block]
                    current = np.tile(fed, (1, trials)) if trials > 1 else fed
                    if noise_mv and rng is not None:
                        size_mv = noise_mv / np.sqrt(values.dt_ms)
                        current = current + size_mv * rng.standard_normal(current.shape)
                    rows, membranes = fire(current, membrane, state)
                    times_ms = start_ms + (part * step + rows + 1.0) * values.dt_ms
                    trial = membranes // (current.shape[1] // trials) + 1
                    parts.append(
                        (block_units[membranes % block_units.size], trial, np.asarray(times_ms))
                    )
        advance(f"spikes of {name}", 1.0)
    if not parts:
        return UnitSpikes(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))
    unit, trial, time_ms = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    order = np.lexsort((time_ms, trial, unit))
    return UnitSpikes(unit[order], trial[order], time_ms[order])


def _read_ahead(
    read: Callable[[int, int], FloatArray], samples: int, units: int
) -> Callable[[int, int], FloatArray]:
    """`read` of stress, more samples at a time: each call of it has a fixed cost."""
    ahead = max(_LEAST_ROWS, _UNIT_NUMBERS // units)
    begin, values = 0, np.empty((0, units))

    def part(first: int, last: int) -> FloatArray:
        nonlocal begin, values
        if not begin <= first <= last <= begin + len(values):
            begin = first
            values = read(first, min(max(last, first + ahead), samples))
        return values[first - begin : last - begin]

    return part


def _times(
    read: Callable[[int, int], FloatArray], sign: FloatArray, first: int, last: int
) -> FloatArray:
    return read(first, last) * sign


def _columns_of(
    read: Callable[[int, int], FloatArray], columns: IntArray, first: int, last: int
) -> FloatArray:
    return read(first, last)[:, columns]


def _may_fire(
    stress_pa: FloatArray,
    parameters: AfferentParameters,
    dt_ms: float,
    stress_factors: FloatArray,
) -> BoolArray:
    """Units that are not known to be silent, ``(unit,)``, from their stress ``(T, unit)``.

    Without a leak a potential is at most the largest rise of the summed current, with it at most
    the steady state of the largest current: where the sum of both bounds is below the threshold,
    nothing fires.
    """
    model = model_of(parameters)
    [coefficients, *_] = model.membrane_coefficients(parameters.by_name())
    filters = model.filters
    if coefficients.halves is not None or coefficients.degree != 1.0:
        return np.ones(stress_factors.size, dtype=bool)
    if not all(filter_ in (*RISES, *LEVELS) for filter_ in filters):
        return np.ones(stress_factors.size, dtype=bool)
    low, high = stress_pa.min(axis=0), stress_pa.max(axis=0)
    range_pa = overshoot(parameters, dt_ms) * (high - low)
    bound_mv = np.zeros(stress_factors.size)
    for filter_, gain in zip(filters, coefficients.gains(), strict=True):
        of_level = parameters.tau_ms * (low + range_pa)
        bound_mv += np.abs(gain) * (range_pa if filter_ in RISES else of_level)
    gap_mv = parameters.threshold_mv - parameters.rest_mv
    # Only a sum that is not finite is reported by the membrane.
    silent: BoolArray = bound_mv < _SURELY * gap_mv * stress_factors
    return ~silent


def _rows_of(stress: FloatArray, first: int, last: int) -> FloatArray:
    return stress[first:last]


def _currents(
    stress_at: Callable[[int, int], FloatArray],
    samples: int,
    parameters: AfferentParameters,
    derivative: str,
    stress_factors: FloatArray,
    step: int,
) -> Iterator[FloatArray]:
    """Currents ``(step, membrane)`` in mV/ms, part by part of a trace.

    `stress_at` returns the stress from a first up to an end sample. A filter also reads
    samples around a part; the state of a recursive filter continues in the next part. The
    current of the last sample is omitted: it would act after the trace.
    """
    model = model_of(parameters)
    pasts = [Past() for _ in model.filters]
    for first in range(0, samples - 1, step):
        last = min(first + step, samples - 1)
        begin, end = max(0, first - SAMPLES_AROUND), min(samples, last + 1 + SAMPLES_AROUND)
        for past in pasts:
            past.before, past.count = first - begin, last - first
        current = membrane_currents(
            stress_at(begin, end), parameters, derivative, stress_factors, pasts
        )
        yield current[first - begin : last - begin].reshape(last - first, -1)


def membrane_currents(
    stress: FloatArray,
    parameters: AfferentParameters,
    derivative: str,
    stress_factors: FloatArray,
    pasts: Sequence[Past] | None = None,
) -> FloatArray:
    """Current ``(T, membrane of a cell, cell, condition)`` in mV/ms.

    `stress` is ``(T,)`` or ``(T, condition)``. A cell needs its entry of `stress_factors` times
    the stress of the median cell for the same current; they are ``(cell,)``, or ``(1, unit)``
    for units of one cell each.
    """
    model = model_of(parameters)
    if (
        model.filters == (stress_rate,)
        and derivative == "backward"
        and stress.ndim == 2
        and np.shape(stress_factors) == (1, *stress.shape[1:])
        and (multiply := compiled(_multiply_rises))
    ):
        of_membranes = model.membrane_coefficients(parameters.by_name())
        scaled = [each.scaled_for_cell(stress_factors[0]) for each in of_membranes]
        if all(each.halves is None for each in scaled):
            gains = np.stack([each.gains()[0] for each in scaled])
            rises = checked_stress(stress, parameters.dt_ms)
            current = np.empty((len(stress), len(gains), 1, stress.shape[1]))
            multiply(np.ascontiguousarray(rises), parameters.dt_ms, gains, current[:, :, 0])
            return current
    filtered = model.filtered(stress, parameters.dt_ms, derivative, pasts)
    columns = [quantity.reshape(len(quantity), -1) for quantity in filtered]
    membrane_coefficients = model.membrane_coefficients(parameters.by_name())
    current = np.empty(
        (len(stress), len(membrane_coefficients), len(stress_factors), columns[0].shape[1])
    )
    for membrane, coefficients in enumerate(membrane_coefficients):
        for cell, stress_factor in enumerate(stress_factors):
            current[:, membrane, cell] = coefficients.scaled_for_cell(stress_factor).current(
                columns
            )
    return current


def _multiply_rises(
    stress: FloatArray, dt_ms: float, gains: FloatArray, current: FloatArray
) -> None:
    """`stress_rate` ``(T, unit)`` times `gains` ``(membrane, unit)``: the current of each."""
    current[0] = 0.0 * gains
    for row in range(1, stress.shape[0]):
        for membrane in range(gains.shape[0]):
            for k in range(stress.shape[1]):
                rise = (stress[row, k] - stress[row - 1, k]) / dt_ms
                current[row, membrane, k] = gains[membrane, k] * rise


def _membrane(parameters: AfferentParameters) -> Membrane:
    return model_of(parameters).membrane(parameters.by_name(), parameters.dt_ms)
