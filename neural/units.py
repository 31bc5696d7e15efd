"""Spikes of many units at once, each with its own stress and its own sensitivity.

A unit is one afferent fibre of a population. Units of a class share the parameters of
that class; a unit of deviate q needs ``exp(spread q)`` times the stress of the median
one, where spread is the class's own: what the cells of `neural.encoder.encode_cells` are
at fixed quantiles.

Trials differ by noise: a random step is added to the membrane's potential every sample,
so that it grows as the square root of time, and leaks with the potential.
"""

from dataclasses import dataclass, fields

import numpy as np

from fembridge.errors import ParameterError, TraceError
from fembridge.typing import FloatArray, IntArray
from neural.encoder import check_step
from neural.filters import checked_stress
from neural.lif import fire, refractory_rows
from neural.models import model_of
from neural.parameters import AfferentParameters, Parameters

# Membranes that are stepped together: their currents fill some 60 MB a second of touch.
_BLOCK = 4_096


@dataclass(frozen=True, slots=True, eq=False)
class UnitSpikes:
    """Spikes in order of unit, then of trial, then of time: ``(spike,)`` each.

    `unit` counts the units from 0, `trial` from 1.
    """

    unit: IntArray
    trial: IntArray
    time_ms: FloatArray


def encode_units(
    stress_pa: FloatArray,
    afferent: list[str],
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

    Parameters
    ----------
    stress_pa
        Von Mises stress at each unit, ``(T, unit)`` in Pa.
    afferent
        Class of each unit.
    dt_ms
        Time between two samples, the one that the parameters were fitted at.
    parameters
        Of each class.
    deviate
        ``(unit,)``: how much less sensitive than the median, see the module; None: 0.
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
    stress = checked_stress(stress_pa)
    names = np.array(afferent, dtype=object)
    if stress.ndim != 2 or stress.shape[1] != names.size:
        raise TraceError(f"stress {stress.shape}, expected (T, {names.size})")
    if unknown := sorted(set(afferent) - set(parameters)):
        raise ParameterError(f"no parameters of {', '.join(unknown)}")
    if not (noise_mv >= 0 and np.isfinite(noise_mv)):
        raise ParameterError(f"noise_mv is {noise_mv}, expected 0 or more")
    if noise_mv and rng is None:
        raise ParameterError("noise takes a random generator")
    needs = np.zeros(names.size) if deviate is None else np.asarray(deviate, dtype=np.float64)
    parts: list[tuple[IntArray, IntArray, FloatArray]] = []
    for name in dict.fromkeys(afferent):
        one = parameters[name]
        check_step(one, dt_ms)
        units = np.flatnonzero(names == name)
        width = max(1, _BLOCK // trials)
        for first in range(0, units.size, width):
            mine = units[first : first + width]
            current = _currents(stress[:, mine], needs[mine], one, derivative)
            if trials > 1:
                current = np.tile(current, (1, trials))
            if noise_mv and rng is not None:
                step = noise_mv / np.sqrt(one.dt_ms)
                current = current + step * rng.standard_normal(current.shape)
            rows, membranes = _fired(current, one)
            times_ms = start_ms + (rows + 1.0) * one.dt_ms
            trial = membranes // (current.shape[1] // trials) + 1
            parts.append((mine[membranes % mine.size], trial, np.asarray(times_ms)))
    if not parts:
        return UnitSpikes(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))
    unit, trial, time_ms = (np.concatenate(each) for each in zip(*parts, strict=True))
    order = np.lexsort((time_ms, trial, unit))
    return UnitSpikes(unit[order], trial[order], time_ms[order])


def _currents(
    stress: FloatArray, deviate: FloatArray, parameters: AfferentParameters, derivative: str
) -> FloatArray:
    """Current ``(T - 1, membrane)`` in mV/ms; that of the last sample would act after the trace.

    All first membranes of a two-way model, unit by unit, then all second ones.
    """
    model = model_of(parameters)
    if model.quantity != "von_mises":
        raise ParameterError(
            f"model {parameters.drive!r} of {parameters.afferent} reads {model.quantity}, "
            "expected one that reads von Mises stress"
        )
    filtered = model.filtered(stress, parameters.dt_ms, derivative)
    values = {one.name: getattr(parameters, one.name) for one in fields(parameters)}
    needs = np.exp(parameters.spread * deviate)
    columns = [each[:-1] for each in filtered]
    ways = model.membranes(model.coefficients(values), values)
    return np.concatenate([own.for_need(needs).current(columns) for own in ways], axis=1)


def _fired(current: FloatArray, one: AfferentParameters) -> tuple[IntArray, IntArray]:
    count, model = current.shape[1], model_of(one)
    decay_of_jump = 1.0 if model.until_turn else 1.0 - one.dt_ms / one.recovery_ms
    adaptation = np.full(count, one.jump_mv / one.dt_ms), np.full(count, decay_of_jump)
    return fire(
        np.array(current),
        np.full(count, 1.0 - one.dt_ms / one.tau_ms),
        np.full(count, one.gap_mv / one.dt_ms),
        np.full(count, refractory_rows(one.refractory_ms, one.dt_ms)),
        np.full(count, model.clamped),
        adaptation=adaptation if one.jump_mv > 0 else None,
        until_turn=np.full(count, True) if model.until_turn else None,
    )
