"""Filtered stress that drives each afferent: filters (1) to (4) of the paper, and others.

The paper is Ishizuka et al., *Computational models for SA, RA, PC afferent*. Time is the
first axis: stress is ``(T,)``, or ``(T, condition)`` for traces with a common time axis,
in Pa; the result of a filter has the same shape.

Two points that the paper leaves open are decided as follows.

*The scheme of* σ′ *and* σ″. One of `DERIVATIVES`; σ″ is the scheme applied twice.
``backward`` is the default because it needs no sample from the future. For RA and
PC ``forward`` is the same series one or two samples earlier; ``central`` is smoother
and so weaker above some 200 Hz.

*The ends of a trace.* Outside the trace the probe does not move: stress keeps its
first or last value, its derivative is 0, and the denominators are the published ones.
Where a trace begins and ends unstressed, as the paper's sinusoids do, this equals padding
with zeros; on a pre-indented finger zeros would mean that the probe was absent. A
derivative or difference that lacks one of its samples is 0. Otherwise the jump of a
waveform that starts at full speed would grow as dt shrinks, and fire RA and PC at onset.
A trace that starts with three equal samples has a known rest state, so its onset counts.
"""

import math
from collections.abc import Callable
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import ParameterError, TraceError
from fembridge.typing import FloatArray

# Half-widths of the averages in samples, section 2.2: (1) looks M1 samples ahead
# and M2 behind, (2) looks M3 ahead and M4 behind. At 0.5 ms that is 4.5 ms ahead.
M1, M2, M3, M4 = 9, 9, 9, 8

# Frequency of the largest gain of `corpuscle`. Recorded thresholds of Pacinian afferents fall
# up to 205 Hz, the highest frequency of Freeman & Johnson (1982); the membrane, which sums
# each half cycle, is more sensitive at lower frequencies than its input.
CORPUSCLE_HZ = 300.0

# Power of the filtered stress, and weight of its negative part: the best of those tried on
# thresholds, and among the best on a frequency that was left out (decision 0041).
CORPUSCLE_POWER = 0.6
OTHER_SIDE = 0.85

# The step response of `corpuscle` is cut off below this value.
_CORPUSCLE_LEFT = 1.0e-14

# Time constant of the fading response of SA to a held stress: the slowly inactivating current
# of Merkel cells has some 200 ms (Gerling et al. 2018, PLoS Comput. Biol. 14, e1006264).
FADE_MS = 200.0

# Share of a held stress that fades.
FADING_SHARE = 0.5

# Corner frequency of the response of SA to movement: the best of those tried on a frequency
# that was left out (decision 0032). Without it SA would follow a strong 400 Hz vibration with
# 200 impulses/s.
SLOW_HZ = 100.0

# Largest number of columns that are filtered one by one, and samples per block.
_FEW, _BLOCK = 20, 65_536

# Samples before and after t that a derivative at t uses.
_REACH = {"backward": (1, 0), "central": (1, 1), "forward": (0, 1)}

DERIVATIVES = tuple(_REACH)


def sa_level(stress_pa: ArrayLike) -> FloatArray:
    """Sustained drive of SA in Pa: stress averaged over a moving window.

    Filter (1): the mean of |σ| over samples t − 9 to t + 9.
    """
    return _windowed_mean(np.abs(checked_stress(stress_pa)), M1, M2, "edge")


def sa_rate(stress_pa: ArrayLike, dt_ms: float, derivative: str = "backward") -> FloatArray:
    """Dynamic drive of SA in Pa/ms: stress rate averaged over a moving window.

    Filter (2): the mean of |σ′| over samples t − 8 to t + 9.
    """
    rate = stress_rate(stress_pa, dt_ms, derivative)
    return _windowed_mean(np.abs(rate), M3, M4, "constant")


def rate_change(stress_pa: ArrayLike, dt_ms: float, derivative: str = "backward") -> FloatArray:
    """Drive of RA in Pa/ms: change of the stress rate.

    Filter (3), ``|σ′(t) − σ′(t − dt)|``. The difference is not divided by dt, so it is
    proportional to dt: parameters are valid at the time step of their fit. With the
    backward scheme the first two samples are 0, since they lack earlier samples.
    """
    return _change(stress_rate(stress_pa, dt_ms, derivative), 1, derivative)


def acceleration_change(
    stress_pa: ArrayLike, dt_ms: float, derivative: str = "backward"
) -> FloatArray:
    """Drive of PC in Pa/ms²: change of the stress acceleration.

    Filter (4), ``|σ″(t) − σ″(t − dt)|``, the scheme of σ′ applied twice. With the
    backward scheme the first three samples are 0.
    """
    rate = stress_rate(stress_pa, dt_ms, derivative)
    return _change(stress_rate(rate, dt_ms, derivative), 2, derivative)


def stress_rate(stress_pa: ArrayLike, dt_ms: float, derivative: str = "backward") -> FloatArray:
    """First derivative of the stress, σ′ in Pa/ms; 0 where a sample is missing.

    Raises
    ------
    TraceError
        Not ``(T,)`` or ``(T, condition)``, or a sample that is not finite.
    ParameterError
        A scheme that is not in `DERIVATIVES`, or a time step that is not > 0.
    """
    stress = checked_stress(stress_pa, dt_ms, derivative)
    behind, ahead = _REACH[derivative]
    span = behind + ahead
    slope = np.zeros_like(stress)
    slope[behind : stress.shape[0] - ahead] = (stress[span:] - stress[:-span]) / (span * dt_ms)
    return slope


def slow_rate(stress_pa: ArrayLike, dt_ms: float, derivative: str = "backward") -> FloatArray:
    """Drive of SA by movement in Pa/ms: σ′ through a one-pole low pass at `SLOW_HZ`."""
    rate = stress_rate(stress_pa, dt_ms, derivative)
    fed_share, kept_share = _low_pass(SLOW_HZ, dt_ms)
    fed_in = np.zeros_like(rate)
    fed_in[1:] = fed_share * (rate[1:] + rate[:-1])
    return _from_sample_to_sample(fed_in, lambda passed, sample: kept_share * passed + sample)


def faded(stress_pa: ArrayLike, dt_ms: float, derivative: str = "backward") -> FloatArray:
    """Sustained drive of SA in Pa: stress minus its faded share.

    ``max(σ − FADING_SHARE s, 0)``, where s follows σ with the time constant `FADE_MS` and
    equals σ at the first sample: stress held before the trace has faded.
    """
    stress = checked_stress(stress_pa, dt_ms, derivative)
    gain = -math.expm1(-dt_ms / FADE_MS)
    followed = _from_sample_to_sample(
        stress, lambda previous, sample: previous + gain * (sample - previous)
    )
    remaining: FloatArray = np.maximum(stress - FADING_SHARE * followed, 0.0)
    return remaining


def corpuscle(stress_pa: ArrayLike, dt_ms: float, derivative: str = "backward") -> FloatArray:
    """Stress through a Pacinian corpuscle, compressed, in Pa^0.6.

    ``max(y, 0)^p − OTHER_SIDE max(−y, 0)^p`` with p = `CORPUSCLE_POWER`; y is σ through
    three high and three low passes of one pole, all at `CORPUSCLE_HZ`: the gain is
    ``(r / (1 + r²))³`` at r times that frequency. A constant stress gives 0 at any `dt_ms`.

    Notes
    -----
    Written as ``y(t) = Σ h(k) (σ(t − k dt) − σ(t − (k + 1) dt))`` with the step response
    h of the passes, so that a still finger gives 0 exactly.
    """
    stress = checked_stress(stress_pa, dt_ms, derivative)
    passed = np.zeros_like(stress)
    change = np.diff(stress, axis=0)
    for lag, share in enumerate(_corpuscle_response(dt_ms, len(stress) - 1)):
        passed[lag + 1 :] += share * change[: len(change) - lag]
    size = np.abs(passed) ** CORPUSCLE_POWER
    compressed: FloatArray = np.where(passed > 0, size, -OTHER_SIDE * size)
    return compressed


def _corpuscle_response(dt_ms: float, longest: int) -> list[float]:
    """Step response of the high and low passes of `corpuscle`, cut off near 0.

    A low pass is ``1 / (1 + s τ)`` by the trapezoidal rule, which keeps the gain at low
    frequencies at any `dt_ms`; a high pass is the input minus its low pass.
    """
    fed, kept = _low_pass(CORPUSCLE_HZ, dt_ms)
    before, lows = [0.0] * 6, [0.0] * 6
    response: list[float] = []
    while len(response) < longest:
        value = 1.0
        for stage, low in enumerate(lows):
            lows[stage] = kept * low + fed * (value + before[stage])
            before[stage] = value
            value = value - lows[stage] if stage < 3 else lows[stage]
        response.append(value)
        if max(map(abs, lows[1:])) < _CORPUSCLE_LEFT and len(response) > 1:
            break
    return response


def _from_sample_to_sample(samples: FloatArray, step: Callable[[Any, Any], Any]) -> FloatArray:
    """Recursion over samples: each result is `step` of the previous result and the sample."""
    results = np.empty_like(samples)
    if samples.ndim == 2 and samples.shape[1] > _FEW:
        for row, sample in enumerate(accumulate(samples, step)):
            results[row] = sample
        return results
    # With few columns, Python floats are several times as fast as NumPy rows.
    for column in np.ndindex(samples.shape[1:]):
        previous = None
        for first in range(0, len(samples), _BLOCK):
            rows = (slice(first, first + _BLOCK), *column)
            block = accumulate(samples[rows].tolist(), step, initial=previous)
            values = list(block)[previous is not None :]
            results[rows] = values
            previous = values[-1]
    return results


def _low_pass(pole_hz: float, dt_ms: float) -> tuple[float, float]:
    """Weights of two inputs and of the previous output in a low pass (trapezoidal rule)."""
    half = math.pi * pole_hz * dt_ms / 1000.0
    return half / (1.0 + half), (1.0 - half) / (1.0 + half)


def checked_stress(
    stress_pa: ArrayLike, dt_ms: float = 1.0, derivative: str = "backward"
) -> FloatArray:
    """`stress_pa` as float64 ``(T,)`` or ``(T, condition)``; raises as `stress_rate`."""
    stress = np.asarray(stress_pa, dtype=np.float64)
    if stress.ndim not in (1, 2) or stress.shape[0] < 2:
        raise TraceError(
            f"stress of shape {stress.shape}, expected (T,) or (T, condition) "
            "with two samples or more"
        )
    if not np.isfinite(stress).all():
        bad = np.argwhere(~np.isfinite(stress))[0]
        raise TraceError(f"stress is {stress[tuple(bad)]} at sample {', '.join(map(str, bad))}")
    if not (math.isfinite(dt_ms) and dt_ms > 0):
        raise ParameterError(f"dt_ms must be > 0, got {dt_ms}")
    if derivative not in _REACH:
        raise ParameterError(f"derivative {derivative!r}, expected one of {', '.join(DERIVATIVES)}")
    return stress


def _change(slope: FloatArray, order: int, derivative: str) -> FloatArray:
    """``|slope(t) − slope(t − dt)|``, 0 where the stencil leaves the trace."""
    behind, ahead = _REACH[derivative]
    change = np.zeros_like(slope)
    change[1:] = np.abs(np.diff(slope, axis=0))
    change[: behind * order + 1] = 0.0
    change[max(slope.shape[0] - ahead * order, 0) :] = 0.0
    return change


def _windowed_mean(values: FloatArray, ahead: int, behind: int, outside: str) -> FloatArray:
    """Mean over samples t − `behind` to t + `ahead`, summed in the same order at each t.

    A running sum would be faster but keep rounding residues of earlier samples, so that a
    finger at rest after a strong stimulus would not give 0.
    """
    width = behind + ahead + 1
    pad_widths = ((behind, ahead), *[(0, 0)] * (values.ndim - 1))
    padded = np.pad(values, pad_widths, mode="edge" if outside == "edge" else "constant")
    total = np.zeros_like(values)
    for shift in range(width):
        total += padded[shift : shift + values.shape[0]]
    total /= width
    return total
