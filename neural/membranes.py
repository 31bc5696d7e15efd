"""Membranes of a class beside each other: what is fed into them, their constants."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from fembridge.errors import ParameterError, TraceError
from fembridge.typing import BoolArray, FloatArray, IntArray
from neural.coefficients import Coefficients
from neural.drive_model import Drive
from neural.drive_table import drive_of
from neural.firing import fire
from neural.lif import adaptation_constants, membrane_constants
from neural.parameters import AfferentParameters, quantiles

# Solvers print times with six digits or more; a step may be off by that much. At
# 250 ms that is 0.025 ms, a twentieth of a sample.
_STEP_TOLERANCE = 1.0e-4


@dataclass(frozen=True, slots=True, eq=False)
class Membranes:
    """Membranes of one class: all conditions of the first cell, then of the next."""

    cells: int
    step_ms: float
    current: FloatArray
    decay: FloatArray
    threshold: FloatArray
    pause: IntArray
    floored: BoolArray
    jump: FloatArray
    kept: FloatArray


def membranes(
    stress: FloatArray, dt_ms: float, parameters: AfferentParameters, derivative: str
) -> Membranes:
    """Put the currents of all cells beside each other, ``(T − 1, membrane)``.

    The current of the last sample would act after the trace: it is left out.
    """
    drive, filtered, coefficients = filtered_stress(stress, dt_ms, parameters, derivative)
    needs = np.exp(parameters.spread * quantiles(parameters.cells))
    columns = [each[:-1].reshape(len(stress) - 1, -1) for each in filtered]
    rows, conditions = columns[0].shape
    current = np.empty((rows, needs.size, conditions))
    for cell, need in enumerate(needs):
        current[:, cell] = coefficients.for_need(need).current(columns)
    membranes = current[0].size
    step_ms = parameters.dt_ms
    decay, threshold, pause = membrane_constants(
        parameters.tau_ms, membranes, step_ms, parameters.gap_mv, parameters.refractory_ms
    )
    jump, kept = adaptation_constants(
        parameters.jump_mv, parameters.recovery_ms, membranes, step_ms
    )
    return Membranes(
        cells=needs.size,
        step_ms=step_ms,
        current=current.reshape(len(current), membranes),
        decay=decay,
        threshold=np.full(membranes, threshold),
        pause=np.full(membranes, pause),
        floored=np.full(membranes, drive.floored),
        jump=jump,
        kept=kept,
    )


def spike_times_of(batches: Sequence[Membranes], start_ms: float = 0.0) -> list[FloatArray]:
    """Give the spike times of each membrane, of one batch after the other.

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
        np.concatenate([batch.pause for batch in batches]),
        np.concatenate([batch.floored for batch in batches]),
        adaptation=_adaptation(batches),
    )
    # The step that row k feeds ends at sample k + 1.
    times_ms = np.asarray(start_ms + (rows + 1.0) * batches[0].step_ms)
    count = sum(batch.decay.size for batch in batches)
    ends = np.searchsorted(columns, np.arange(1, count + 1)).tolist()
    return [times_ms[first:end] for first, end in zip([0, *ends], ends, strict=False)]


def _adaptation(batches: Sequence[Membranes]) -> tuple[FloatArray, FloatArray] | None:
    jump = np.concatenate([batch.jump for batch in batches])
    kept = np.concatenate([batch.kept for batch in batches])
    return (jump, kept) if jump.any() else None


def filtered_stress(
    stress: FloatArray, dt_ms: float, parameters: AfferentParameters, derivative: str
) -> tuple[Drive, tuple[FloatArray, ...], Coefficients]:
    """Give the drive of the parameters, its filtered stress, and its coefficients.

    Raises
    ------
    ParameterError
        A time step that the parameters were not made for.
    """
    _check_step(dt_ms, parameters)
    drive = drive_of(parameters)
    filtered = drive.filters(stress, parameters.dt_ms, derivative)
    values = {one.name: getattr(parameters, one.name) for one in fields(parameters)}
    return drive, filtered, drive.coefficients(values)


def _check_step(dt_ms: float, parameters: AfferentParameters) -> None:
    expected_ms = parameters.dt_ms
    if not abs(dt_ms - expected_ms) <= _STEP_TOLERANCE * expected_ms:
        raise ParameterError(
            f"{parameters.afferent}: the trace has a sample every {dt_ms:g} ms, its "
            f"parameters hold for {expected_ms:g} ms; resample the trace"
        )
