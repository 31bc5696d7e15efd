"""From the stress at an afferent to the times of its spikes, as published.

Stress is ``(T,)``, or ``(T, condition)`` for traces that share one time axis; row 0
is at `start_ms`, where the membrane is at rest.
"""

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import ParameterError
from fembridge.typing import BoolArray, FloatArray
from neural.current import pc_current, ra_current, sa_current
from neural.drive import checked_stress, pc_drive, ra_drive, sa_level, sa_rate
from neural.lif import integrate
from neural.parameters import (
    AfferentParameters,
    PcParameters,
    RaParameters,
    SaParameters,
)

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
    """Give the spike times of one afferent class.

    Parameters
    ----------
    stress_pa
        Von Mises stress at the afferent, ``(T,)`` or ``(T, condition)`` in Pa.
    dt_ms
        Time between two samples; the one that the parameters were fitted at.
    parameters
        Of one class, such as ``PUBLISHED["RA"]``; its type chooses the filters.
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
        A time step that is not the parameters', or an unknown scheme.
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
    fired = _run(stress_pa, dt_ms, parameters, derivative)[1]
    return [
        start_ms + np.flatnonzero(run).astype(np.float64) * parameters.dt_ms
        for run in np.atleast_2d(fired.T)
    ]


def membrane_potential(
    stress_pa: ArrayLike,
    dt_ms: float,
    parameters: AfferentParameters,
    derivative: str = "backward",
) -> FloatArray:
    """Give the membrane potential in mV at each sample of a trace.

    Arguments are those of `encode`, the shape is that of `stress_pa`. A sample on
    which a spike stands is back at rest; the spike itself has no height.
    """
    above_rest = _run(stress_pa, dt_ms, parameters, derivative)[0]
    return parameters.rest_mv + above_rest


def membrane_current(
    stress_pa: ArrayLike,
    dt_ms: float,
    parameters: AfferentParameters,
    derivative: str = "backward",
) -> FloatArray:
    """Give the current I' in mV/ms at each sample of a trace, before any spike.

    Arguments are those of `encode`, the shape is that of `stress_pa`.
    """
    _check_step(dt_ms, parameters)
    drives = afferent_drives(
        parameters.afferent, stress_pa, parameters.dt_ms, derivative
    )
    alpha = parameters.alpha_mv_per_ms
    match parameters:
        case SaParameters(a1_pa=a1, a2_pa_per_ms=a2):
            return sa_current(*drives, a1_pa=a1, a2_pa_per_ms=a2, alpha_mv_per_ms=alpha)
        case RaParameters(a3_pa_per_ms=a3):
            return ra_current(*drives, a3_pa_per_ms=a3, alpha_mv_per_ms=alpha)
        case PcParameters(a4_pa_per_ms2=a4):
            return pc_current(*drives, a4_pa_per_ms2=a4, alpha_mv_per_ms=alpha)
    raise ParameterError(f"no current for parameters of {type(parameters).__name__}")


def afferent_drives(
    afferent: str, stress_pa: ArrayLike, dt_ms: float, derivative: str = "backward"
) -> tuple[FloatArray, ...]:
    """Give the filtered stress of a class: level and rate for SA, else one drive.

    The arrays have the shape of `stress_pa`; they do not depend on parameters, so a
    fit makes them once and hands them to `neural.candidates.candidate_counts`.
    """
    match afferent:
        case "SA":
            return sa_level(stress_pa), sa_rate(stress_pa, dt_ms, derivative)
        case "RA":
            return (ra_drive(stress_pa, dt_ms, derivative),)
        case "PC":
            return (pc_drive(stress_pa, dt_ms, derivative),)
    raise ParameterError(f"afferent {afferent!r}, expected SA, RA or PC")


def _run(
    stress_pa: ArrayLike,
    dt_ms: float,
    parameters: AfferentParameters,
    derivative: str,
) -> tuple[FloatArray, BoolArray]:
    """Potential above rest and spikes at each sample; the first is at rest.

    The current of the last sample would act after the trace: it is left out.
    """
    stress = checked_stress(stress_pa)
    current = membrane_current(stress, dt_ms, parameters, derivative)
    potential_mv, fired = np.zeros_like(stress), np.zeros(stress.shape, dtype=np.bool_)
    potential_mv[1:], fired[1:] = integrate(
        current[:-1],
        parameters.tau_ms,
        parameters.dt_ms,
        parameters.gap_mv,
        parameters.refractory_ms,
    )
    return potential_mv, fired


def _check_step(dt_ms: float, parameters: AfferentParameters) -> None:
    expected_ms = parameters.dt_ms
    if not abs(dt_ms - expected_ms) <= _STEP_TOLERANCE * expected_ms:
        raise ParameterError(
            f"{parameters.afferent}: the trace has a sample every {dt_ms:g} ms, its "
            f"parameters hold for {expected_ms:g} ms; resample the trace"
        )
