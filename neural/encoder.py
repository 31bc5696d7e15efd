"""From the stress at an afferent to the times of its spikes.

Stress is ``(T,)``, or ``(T, condition)`` for traces that share one time axis; row 0
is at `start_ms`, where the membrane is at rest.
"""

from dataclasses import fields

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import ParameterError
from fembridge.typing import BoolArray, FloatArray
from neural.drive import checked_stress
from neural.drive_table import drive_named, drive_of
from neural.lif import integrate
from neural.parameters import AfferentParameters, quantiles

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
    return [
        cells[0]
        for cells in encode_cells(stress_pa, dt_ms, parameters, start_ms, derivative)
    ]


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
    stress = checked_stress(stress_pa)
    masks = [
        np.atleast_2d(_run(stress, dt_ms, parameters, derivative, need)[1].T)
        for need in np.exp(parameters.spread * quantiles(parameters.cells))
    ]
    return [
        [
            start_ms + np.flatnonzero(mask[row]).astype(np.float64) * parameters.dt_ms
            for mask in masks
        ]
        for row in range(masks[0].shape[0])
    ]


def membrane_potential(
    stress_pa: ArrayLike,
    dt_ms: float,
    parameters: AfferentParameters,
    derivative: str = "backward",
) -> FloatArray:
    """Give the membrane potential in mV at each sample, of the median cell.

    Arguments are those of `encode`, the shape is that of `stress_pa`. A sample on
    which a spike stands is back at rest; the spike itself has no height.
    """
    above_rest = _run(checked_stress(stress_pa), dt_ms, parameters, derivative)[0]
    return parameters.rest_mv + above_rest


def membrane_current(
    stress_pa: ArrayLike,
    dt_ms: float,
    parameters: AfferentParameters,
    derivative: str = "backward",
) -> FloatArray:
    """Give the current I' in mV/ms at each sample, before any spike.

    Arguments are those of `encode`, the shape is that of `stress_pa`; of a population
    it is the current of the median cell.
    """
    return _current(checked_stress(stress_pa), dt_ms, parameters, derivative, 1.0)


def _current(
    stress: FloatArray,
    dt_ms: float,
    parameters: AfferentParameters,
    derivative: str,
    need: float,
) -> FloatArray:
    _check_step(dt_ms, parameters)
    drive = drive_of(parameters)
    filtered = drive.filters(stress, parameters.dt_ms, derivative)
    values = {one.name: getattr(parameters, one.name) for one in fields(parameters)}
    return drive.coefficients(values).for_need(need).current(filtered)


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


def _run(
    stress: FloatArray,
    dt_ms: float,
    parameters: AfferentParameters,
    derivative: str,
    need: float = 1.0,
) -> tuple[FloatArray, BoolArray]:
    """Potential above rest and spikes at each sample; the first is at rest.

    The current of the last sample would act after the trace: it is left out.
    """
    current = _current(stress, dt_ms, parameters, derivative, need)
    potential_mv, fired = np.zeros_like(stress), np.zeros(stress.shape, dtype=np.bool_)
    potential_mv[1:], fired[1:] = integrate(
        current[:-1],
        parameters.tau_ms,
        parameters.dt_ms,
        parameters.gap_mv,
        parameters.refractory_ms,
        floored=drive_of(parameters).floored,
        jump_mv=parameters.jump_mv,
        recovery_ms=parameters.recovery_ms,
    )
    return potential_mv, fired


def _check_step(dt_ms: float, parameters: AfferentParameters) -> None:
    expected_ms = parameters.dt_ms
    if not abs(dt_ms - expected_ms) <= _STEP_TOLERANCE * expected_ms:
        raise ParameterError(
            f"{parameters.afferent}: the trace has a sample every {dt_ms:g} ms, its "
            f"parameters hold for {expected_ms:g} ms; resample the trace"
        )
