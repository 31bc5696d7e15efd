"""From the stress at an afferent to the times of its spikes.

Stress is ``(T,)``, or ``(T, condition)`` for traces that share one time axis; row 0
is at `start_ms`, where the membrane is at rest.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import ParameterError
from fembridge.typing import FloatArray
from neural.drive import checked_stress
from neural.drive_table import drive_named, drive_of
from neural.lif import integrate
from neural.membranes import filtered_stress, membranes, spike_times_of
from neural.parameters import AfferentParameters, Parameters


def encode(
    stress_pa: ArrayLike,
    dt_ms: float,
    parameters: AfferentParameters,
    start_ms: float = 0.0,
    derivative: str = "backward",
) -> list[FloatArray]:
    """Give the spike times of one afferent.

    Parameters
    ----------
    stress_pa
        Stress at the afferent, ``(T,)`` or ``(T, condition)`` in Pa: von Mises
        stress, or what the drive of the parameters reads.
    dt_ms
        Time between two samples; the one that the parameters were fitted at.
    parameters
        Of one class and one cell, such as ``PUBLISHED["RA"]``; `encode_cells` is for
        more.
    start_ms
        Time of the first sample.
    derivative
        Scheme of σ′ and σ″, one of `neural.drive.DERIVATIVES`.

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
    """Give the spike times of each cell of a population, the most sensitive first.

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
    """Give the spike times of several classes at once: one loop over time for all.

    `stress_pa` is by class, ``(T,)`` or ``(T, condition)`` with one T; the other
    arguments and the errors are those of `encode`, the entries of the result those
    of `encode_cells`.
    """
    batches = [
        membranes(checked_stress(stress), dt_ms, parameters[afferent], derivative)
        for afferent, stress in stress_pa.items()
    ]
    times_ms = spike_times_of(batches, start_ms)
    ends = np.cumsum([batch.decay.size for batch in batches]).tolist()
    return {
        afferent: _by_condition(times_ms[end - batch.decay.size : end], batch.cells)
        for afferent, batch, end in zip(stress_pa, batches, ends, strict=True)
    }


def _by_condition(times_ms: list[FloatArray], cells: int) -> list[list[FloatArray]]:
    """Turn a list that runs over cells, then conditions, into one a condition."""
    conditions = len(times_ms) // cells
    return [times_ms[condition::conditions] for condition in range(conditions)]


def membrane_potential(
    stress_pa: ArrayLike, dt_ms: float, parameters: AfferentParameters, derivative: str = "backward"
) -> FloatArray:
    """Give the membrane potential in mV at each sample, of the median cell.

    Arguments are those of `encode`, the shape is that of `stress_pa`. A sample on
    which a spike stands is back at rest; the spike itself has no height.
    """
    current = membrane_current(stress_pa, dt_ms, parameters, derivative)
    potential_mv = np.full_like(current, parameters.rest_mv)
    potential_mv[1:] += integrate(
        current[:-1],
        parameters.tau_ms,
        parameters.dt_ms,
        parameters.gap_mv,
        parameters.refractory_ms,
        floored=drive_of(parameters).floored,
        jump_mv=parameters.jump_mv,
        recovery_ms=parameters.recovery_ms,
    )[0]
    return potential_mv


def membrane_current(
    stress_pa: ArrayLike, dt_ms: float, parameters: AfferentParameters, derivative: str = "backward"
) -> FloatArray:
    """Give the current I' in mV/ms at each sample, before any spike.

    Arguments are those of `encode`, the shape is that of `stress_pa`; of a population
    it is the current of the median cell.
    """
    stress = checked_stress(stress_pa)
    _, filtered, coefficients = filtered_stress(stress, dt_ms, parameters, derivative)
    return coefficients.current(filtered)


def afferent_drives(
    afferent: str,
    stress_pa: ArrayLike,
    dt_ms: float,
    derivative: str = "backward",
    drive: str = "published",
) -> tuple[FloatArray, ...]:
    """Give the filtered stress of a class, one array a filter of the drive.

    The arrays have the shape of `stress_pa`; they do not depend on parameters, so a
    fit makes them once and hands them to `neural.candidates.candidate_counts`.
    """
    row = drive_named(drive, afferent)
    return row.filters(checked_stress(stress_pa), dt_ms, derivative)
