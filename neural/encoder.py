"""From the stress at an afferent to the times of its spikes.

Stress is ``(T,)``, or ``(T, condition)`` for traces that share one time axis; row 0
is at `start_ms`, where the membrane is at rest.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import ParameterError, TraceError
from fembridge.typing import BoolArray, FloatArray, IntArray
from neural.filters import checked_stress
from neural.lif import adaptation_constants, fire, membrane_constants
from neural.models import model_named, model_of
from neural.parameters import AfferentParameters, Parameters, quantiles

# Solvers print times with six digits or more; a step may be off by that much. At
# 250 ms that is 0.025 ms, a twentieth of a sample.
_STEP_TOLERANCE = 1.0e-4


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
    batches = [
        _membranes(checked_stress(stress), dt_ms, parameters[afferent], derivative)
        for afferent, stress in stress_pa.items()
    ]
    times_ms = _spike_times(batches, start_ms)
    ends = np.cumsum([batch.decay.size for batch in batches]).tolist()
    return {
        afferent: _by_condition(times_ms[end - batch.decay.size : end], batch.cells)
        for afferent, batch, end in zip(stress_pa, batches, ends, strict=True)
    }


def _by_condition(times_ms: list[FloatArray], cells: int) -> list[list[FloatArray]]:
    """Cells of each condition, of a list that runs over cells, then conditions."""
    conditions = len(times_ms) // cells
    return [times_ms[condition::conditions] for condition in range(conditions)]


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
    return model_named(model, afferent).filters(checked_stress(stress_pa), dt_ms, derivative)


@dataclass(frozen=True, slots=True, eq=False)
class _Membranes:
    """Membranes of one class: all conditions of the first cell, then of the next."""

    cells: int
    step_ms: float
    current: FloatArray
    decay: FloatArray
    threshold: FloatArray
    refractory: IntArray
    clamped: BoolArray
    jump: FloatArray
    decay_of_jump: FloatArray


def _membranes(
    stress: FloatArray, dt_ms: float, parameters: AfferentParameters, derivative: str
) -> _Membranes:
    """Currents of all cells beside each other, ``(T − 1, membrane)``.

    The current of the last sample would act after the trace: it is left out.
    """
    _check_step(dt_ms, parameters)
    model = model_of(parameters)
    filtered = model.filters(stress, parameters.dt_ms, derivative)
    values = {one.name: getattr(parameters, one.name) for one in fields(parameters)}
    coefficients = model.coefficients(values)
    needs = np.exp(parameters.spread * quantiles(parameters.cells))
    columns = [each[:-1].reshape(len(stress) - 1, -1) for each in filtered]
    rows, conditions = columns[0].shape
    current = np.empty((rows, needs.size, conditions))
    for cell, need in enumerate(needs):
        current[:, cell] = coefficients.for_need(need).current(columns)
    membranes = current[0].size
    step_ms = parameters.dt_ms
    decay, threshold, refractory = membrane_constants(
        parameters.tau_ms, membranes, step_ms, parameters.gap_mv, parameters.refractory_ms
    )
    jump, decay_of_jump = adaptation_constants(
        parameters.jump_mv, parameters.recovery_ms, membranes, step_ms
    )
    return _Membranes(
        cells=needs.size,
        step_ms=step_ms,
        current=current.reshape(len(current), membranes),
        decay=decay,
        threshold=np.full(membranes, threshold),
        refractory=np.full(membranes, refractory),
        clamped=np.full(membranes, model.clamped),
        jump=jump,
        decay_of_jump=decay_of_jump,
    )


def _spike_times(batches: Sequence[_Membranes], start_ms: float = 0.0) -> list[FloatArray]:
    """Spike times of each membrane, of one batch after the other.

    Raises
    ------
    TraceError
        Batches of unequal length.
    """
    lengths = {len(batch.current) for batch in batches}
    if len(lengths) != 1:
        raise TraceError(f"stress of {len(lengths)} lengths, expected one time axis")

    def all_of(name: str) -> FloatArray:
        return np.concatenate([getattr(batch, name) for batch in batches])

    rows, columns = fire(
        np.concatenate([batch.current for batch in batches], axis=1),
        all_of("decay"),
        all_of("threshold"),
        np.concatenate([batch.refractory for batch in batches]),
        np.concatenate([batch.clamped for batch in batches]),
        adaptation=_adaptation(batches),
    )
    # The step that row k feeds ends at sample k + 1.
    times_ms = np.asarray(start_ms + (rows + 1.0) * batches[0].step_ms)
    count = sum(batch.decay.size for batch in batches)
    ends = np.searchsorted(columns, np.arange(1, count + 1)).tolist()
    return [times_ms[first:end] for first, end in zip([0, *ends], ends, strict=False)]


def _adaptation(batches: Sequence[_Membranes]) -> tuple[FloatArray, FloatArray] | None:
    jump = np.concatenate([batch.jump for batch in batches])
    decay_of_jump = np.concatenate([batch.decay_of_jump for batch in batches])
    return (jump, decay_of_jump) if jump.any() else None


def _check_step(dt_ms: float, parameters: AfferentParameters) -> None:
    expected_ms = parameters.dt_ms
    if not abs(dt_ms - expected_ms) <= _STEP_TOLERANCE * expected_ms:
        raise ParameterError(
            f"{parameters.afferent}: the trace has a sample every {dt_ms:g} ms, its "
            f"parameters hold for {expected_ms:g} ms; resample the trace"
        )
