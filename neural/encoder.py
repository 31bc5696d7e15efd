"""From the stress at an afferent to the times of its spikes.

Stress is ``(T,)``, or ``(T, condition)`` for traces that share one time axis; row 0
is at `start_ms`, where the membrane is at rest.
"""

from collections.abc import Iterator, Mapping
from dataclasses import fields

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import ParameterError, TraceError
from fembridge.typing import FloatArray
from neural.filters import LAG_MS, checked_stress
from neural.lif import Membranes, fire, refractory_rows
from neural.models import model_named, model_of
from neural.parameters import AfferentParameters, Parameters, quantiles

# Solvers print times with six digits or more; a step may be off by that much. At
# 250 ms that is 0.025 ms, a twentieth of a sample.
_STEP_TOLERANCE = 1.0e-4

# How many membranes are computed at once, how many numbers of their currents and rows, and
# how many samples around one a filter may see beside `LAG_MS`: of a trace of an hour, or of
# a hundred thousand membranes, little is in memory beside the stress and the spikes.
_MEMBRANES, _NUMBERS, _ROWS, _SAMPLES_AROUND = 1 << 12, 1 << 21, 1 << 16, 64


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
    chosen = [parameters[name] for name in stress]
    conditions = [each.size // len(each) for each in stress.values()]
    ways = [1 + model_of(one).two_way for one in chosen]
    sizes = [
        way * one.cells * count for way, one, count in zip(ways, chosen, conditions, strict=True)
    ]
    constants = (
        (
            1.0 - one.dt_ms / one.tau_ms,
            one.gap_mv / one.dt_ms,
            refractory_rows(one.refractory_ms, one.dt_ms),
            model_of(one).clamped,
            one.jump_mv / one.dt_ms,
            1.0 if model_of(one).until_turn else 1.0 - one.dt_ms / one.recovery_ms,
            model_of(one).until_turn,
        )
        for one in chosen
    )
    decay, threshold, refractory, clamped, jump, decay_of_jump, until_turn = (
        np.repeat(each, sizes) for each in zip(*constants, strict=True)
    )
    samples = len(next(iter(stress.values())))
    reach = int(min(samples, _SAMPLES_AROUND + 3.0 * LAG_MS / chosen[0].dt_ms))
    step = max(reach, min(_ROWS, _NUMBERS // sum(sizes)))
    if any(model_of(one).whole for one in chosen):
        step = samples
    state = Membranes.at_rest(sum(sizes))
    parts = []
    # The current of the last sample would act after the trace: it is left out.
    for first in range(0, samples - 1, step):
        last = min(first + step, samples - 1)
        begin, end = max(0, first - reach), min(samples, last + 1 + reach)
        currents = [
            _current(each[begin:end], dt_ms, one, derivative)[first - begin : last - begin]
            for one, each in zip(chosen, stress.values(), strict=True)
        ]
        rows, membranes = fire(
            np.concatenate(currents, axis=1),
            decay,
            threshold,
            refractory,
            clamped,
            adaptation=(jump, decay_of_jump) if jump.any() else None,
            until_turn=until_turn if until_turn.any() else None,
            state=state,
        )
        parts.append((rows + first, membranes))
    rows, membranes = map(np.concatenate, zip(*parts, strict=True))
    order = np.argsort(membranes, kind="stable")
    # The step that row k feeds ends at sample k + 1.
    times_ms = start_ms + (rows[order] + 1.0) * chosen[0].dt_ms
    trains = np.split(times_ms, np.searchsorted(membranes[order], np.arange(1, sum(sizes))))
    found: dict[str, list[list[FloatArray]]] = {}
    for name, count, begin, size, way in zip(
        stress, conditions, np.cumsum([0, *sizes]).tolist(), sizes, ways, strict=False
    ):
        mine = trains[begin : begin + size]
        if way == 2:
            pairs = zip(mine[: size // 2], mine[size // 2 :], strict=True)
            mine = [np.sort(np.concatenate(pair)) for pair in pairs]
        found[name] = [mine[condition::count] for condition in range(count)]
    return found


def afferent_drives(
    afferent: str,
    stress_pa: ArrayLike,
    dt_ms: float,
    derivative: str = "backward",
    model: str = "published",
) -> tuple[FloatArray, ...]:
    """Filtered stress of a class, one array a filter of the `model`.

    The arrays have the shape of `stress_pa`; they do not depend on parameters, so a
    fit makes them once and passes them to `neural.counts.candidate_counts`.
    """
    return model_named(model, afferent).filtered(checked_stress(stress_pa), dt_ms, derivative)


def check_step(parameters: AfferentParameters, dt_ms: float) -> None:
    """Refuse a time step that `parameters` do not hold for."""
    step_ms = parameters.dt_ms
    if not abs(dt_ms - step_ms) <= _STEP_TOLERANCE * step_ms:
        raise ParameterError(
            f"{parameters.afferent}: the trace has a sample every {dt_ms:g} ms, its "
            f"parameters hold for {step_ms:g} ms; resample the trace"
        )


def _current(
    stress: FloatArray, dt_ms: float, parameters: AfferentParameters, derivative: str
) -> FloatArray:
    """Currents ``(T, membrane)``: all conditions of the first cell, then of the next.

    Where a model is two-way, those of all first membranes, then of all second ones.
    """
    check_step(parameters, dt_ms)
    step_ms = parameters.dt_ms
    model = model_of(parameters)
    filtered = model.filtered(stress, step_ms, derivative)
    columns = [each.reshape(len(stress), -1) for each in filtered]
    values = {one.name: getattr(parameters, one.name) for one in fields(parameters)}
    coefficients = model.coefficients(values)
    needs = np.exp(parameters.spread * quantiles(parameters.cells))
    rows, conditions = columns[0].shape
    ways = model.membranes(coefficients, values)
    current = np.empty((rows, len(ways), needs.size, conditions))
    for way, own in enumerate(ways):
        for cell, need in enumerate(needs):
            current[:, way, cell] = own.for_need(need).current(columns)
    return current.reshape(rows, -1)
