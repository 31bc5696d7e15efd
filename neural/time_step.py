"""Stress at the time step of the parameters, from a trace of another step.

A coarser trace is interpolated: between two samples by the polynomial of degree 5 through the
three samples before and the three after. Its error for a sinusoid of 300 Hz, sampled every
0.5 ms, is 0.2 %. Of a finer trace every n-th sample is read. The ratio of both steps must be a
whole number.
"""

import math
from collections.abc import Callable
from functools import cache
from typing import TypeAlias

import numpy as np

from fembridge.errors import ParameterError
from fembridge.typing import FloatArray
from neural.compiled import compiled
from neural.models import model_of
from neural.parameters import AfferentParameters

# Solvers print times with six digits or more, so a step may be off by this share. At
# 250 ms this is 0.025 ms, a twentieth of a sample.
STEP_TOLERANCE = 1.0e-4

# Samples before and after an interval that determine its polynomial.
BEFORE, AFTER = 3, 3

Reader: TypeAlias = Callable[[int, int], FloatArray]
"""Function of a first and an end sample that returns the stress ``(T, ...)``."""


def step_ratio(parameters: AfferentParameters, dt_ms: float) -> tuple[int, int]:
    """Samples of the parameters for each sample of the trace, and the reverse; one of both is 1.

    Raises
    ------
    ParameterError
        Neither `dt_ms` nor the step of the parameters is a multiple of the other, or the trace is
        coarser and the equation of the model contains the time step.
    """
    step_ms = parameters.dt_ms
    if 0 < dt_ms < math.inf:
        finer, coarser = max(1, round(dt_ms / step_ms)), max(1, round(step_ms / dt_ms))
        fits = abs(dt_ms * coarser - step_ms * finer) <= STEP_TOLERANCE * step_ms * finer
        if fits and (finer == 1 or model_of(parameters).any_step):
            return finer, coarser
    raise ParameterError(
        f"is {dt_ms:g} ms, but the parameters of {parameters.afferent} require {step_ms:g} ms; "
        "resample the trace",
        argument="dt_ms",
        found=dt_ms,
        expected=f"{step_ms:g}",
    )


def fits_step(parameters: AfferentParameters, dt_ms: float) -> bool:
    """Whether the encoder takes a trace of the step `dt_ms`."""
    try:
        step_ratio(parameters, dt_ms)
    except ParameterError:
        return False
    return True


def overshoot(parameters: AfferentParameters, dt_ms: float) -> float:
    """Range of the stress at the time step of the parameters over that of the trace, at most."""
    finer, _ = step_ratio(parameters, dt_ms)
    return float(np.abs(interpolation_weights(finer)).sum(axis=1).max())


def read_at_step(
    read: Reader, samples: int, parameters: AfferentParameters, dt_ms: float
) -> tuple[Reader, int]:
    """Reader of a trace at the time step of the parameters, and its number of samples.

    `read` reads the trace of `samples` samples every `dt_ms`. Errors are those of `step_ratio`.
    """
    finer, coarser = step_ratio(parameters, dt_ms)
    if finer > 1:
        return _interpolating(read, samples, finer), (samples - 1) * finer + 1
    if coarser > 1:
        return _skipping(read, coarser), (samples - 1) // coarser + 1
    return read, samples


def _skipping(read: Reader, every: int) -> Reader:
    return lambda first, end: read(first * every, (end - 1) * every + 1)[::every]


def _interpolating(read: Reader, samples: int, finer: int) -> Reader:
    weights = interpolation_weights(finer)

    def read_finer(first: int, end: int) -> FloatArray:
        """Before the first and after the last sample the stress is that sample's."""
        intervals = np.arange(first // finer, (end - 1) // finer + 1)
        begin = max(0, int(intervals[0]) - BEFORE + 1)
        stop = min(samples, int(intervals[-1]) + AFTER + 1)
        coarse = read(begin, stop)
        if interpolate := compiled(_interpolate):
            fine = np.empty((end - first, *coarse.shape[1:]))
            columns = np.ascontiguousarray(coarse, dtype=np.float64).reshape(len(coarse), -1)
            span = first - begin * finer, samples - 1 - begin
            interpolate(columns, weights, *span, fine.reshape(len(fine), -1))
            return fine
        base = coarse[intervals - begin]
        values = np.repeat(base, finer, axis=0).astype(np.float64, copy=False)
        shape = (len(intervals), finer, *coarse.shape[1:])
        values = values.reshape(shape)
        for column, offset in enumerate(range(1 - BEFORE, AFTER + 1)):
            if offset:
                rows = np.clip(intervals + offset, 0, samples - 1) - begin
                # Differences, so that a constant stress stays exactly constant.
                change = (coarse[rows] - base)[:, np.newaxis]
                values += weights[:, column].reshape(-1, *[1] * (coarse.ndim - 1)) * change
        flat = values.reshape(-1, *coarse.shape[1:])
        begin_fine = int(intervals[0]) * finer
        part: FloatArray = flat[first - begin_fine : end - begin_fine]
        return part

    return read_finer


def _interpolate(
    coarse: FloatArray, weights: FloatArray, first: int, last: int, fine: FloatArray
) -> None:
    """Values ``(T, column)`` from fine sample `first` on; row `last` of `coarse` ends the trace."""
    finer = weights.shape[0]
    for row in range(fine.shape[0]):
        interval, point = divmod(first + row, finer)
        a, b, c = max(interval - 2, 0), max(interval - 1, 0), min(interval, last)
        d, e, f = min(interval + 1, last), min(interval + 2, last), min(interval + 3, last)
        of_a, of_b, _, of_d, of_e, of_f = weights[point]
        for k in range(fine.shape[1]):
            base = coarse[c, k]
            value = base + of_a * (coarse[a, k] - base)
            value += of_b * (coarse[b, k] - base)
            value += of_d * (coarse[d, k] - base)
            value += of_e * (coarse[e, k] - base)
            fine[row, k] = value + of_f * (coarse[f, k] - base)


@cache
def interpolation_weights(finer: int) -> FloatArray:
    """Lagrange weights ``(finer, 6)`` of the samples around each point of an interval."""
    nodes = np.arange(1 - BEFORE, AFTER + 1, dtype=np.float64)
    points = np.arange(finer) / finer
    weights = np.ones((finer, nodes.size))
    for column, node in enumerate(nodes):
        for other in nodes[nodes != node]:
            weights[:, column] *= (points - other) / (node - other)
    return weights
