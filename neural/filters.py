"""Filtered stress: what drives each afferent, filters (1) to (4) of the paper, and ours.

The paper is Ishizuka et al., *Computational models for SA, RA, PC afferent*. Time
is the first axis everywhere: stress is ``(T,)``, or ``(T, condition)`` for many traces
that share one time axis, in Pa; a filter's result has that shape.

Two things are open in the paper; this is how they are taken here.

*The scheme of* σ′ *and* σ″. One of `DERIVATIVES`; σ″ is the scheme applied twice.
``backward`` is the default because it needs no sample from the future. For RA and
PC ``forward`` is the same series one or two samples earlier; ``central`` is smoother
and so weaker above some 200 Hz.

*The ends of a trace.* Outside the trace the probe stands still: stress keeps the
value it has at that end, its derivative is 0, and the denominators stay the
published ones. Where a trace begins and ends unstressed, as the paper's sinusoids
do, that is the same as padding with zeros; on a pre-indented finger zeros would
stand for a probe that was never there. A derivative or difference that lacks one
of its samples is 0: the jump of a waveform that starts at full speed would grow as
dt shrinks, and fire RA and PC at onset. A trace that starts with three still
samples has a known rest, and then its onset counts.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import ParameterError, TraceError
from fembridge.typing import FloatArray

# Half-widths of the averages in samples, section 2.2: (1) looks M1 samples ahead
# and M2 behind, (2) looks M3 ahead and M4 behind. At 0.5 ms that is 4.5 ms ahead.
M1, M2, M3, M4 = 9, 9, 9, 8

# Where `corpuscle` passes most. Recorded thresholds of Pacinian afferents fall up to 205 Hz,
# the highest frequency of Freeman & Johnson (1982); the membrane, which sums each swing, is
# keener at lower frequencies than what it is fed.
CORPUSCLE_HZ = 300.0

# How the answer grows with what it passes, and how much the other side of it counts: of those
# tried the best on thresholds, and among the best on a frequency that was left out (decision 0041).
CORPUSCLE_POWER = 0.6
OTHER_SIDE = 0.85

# What is left of the step response of `corpuscle` where it is cut off.
_CORPUSCLE_LEFT = 1.0e-14

# How fast the response of SA to a held stress fades: the slowly inactivating current of
# Merkel cells has some 200 ms (Gerling et al. 2018, PLoS Comput. Biol. 14, e1006264).
FADE_MS = 200.0

# Share of a held stress that fades away with it.
FADING_SHARE = 0.5

# Where the answer of SA to movement falls off: of those tried the best on a frequency that was
# left out (decision 0032). Without it SA would follow a loud 400 Hz with 200 impulses/s.
SLOW_HZ = 100.0

# Samples after which the step response of `corpuscle` is cut off at the latest.
_LONGEST = 1 << 20

# So many columns and fewer are filtered one by one, so many samples at once.
_FEW, _BLOCK = 20, 65_536

# How many samples behind and ahead of t a derivative at t looks.
_REACH = {"backward": (1, 0), "central": (1, 1), "forward": (0, 1)}

DERIVATIVES = tuple(_REACH)


def sa_level(stress_pa: ArrayLike) -> FloatArray:
    """The sustained part of what drives SA in Pa: stress averaged over a moving window.

    Filter (1): the mean of |σ| over samples t − 9 to t + 9.
    """
    return _windowed_mean(np.abs(checked_stress(stress_pa)), M1, M2, "edge")


def sa_rate(stress_pa: ArrayLike, dt_ms: float, derivative: str = "backward") -> FloatArray:
    """The dynamic part of what drives SA in Pa/ms: stress rate over a moving window.

    Filter (2): the mean of |σ′| over samples t − 8 to t + 9.
    """
    rate = stress_rate(stress_pa, dt_ms, derivative)
    return _windowed_mean(np.abs(rate), M3, M4, "constant")


def rate_change(stress_pa: ArrayLike, dt_ms: float, derivative: str = "backward") -> FloatArray:
    """Change of the stress rate in Pa/ms: what drives RA.

    Filter (3), ``|σ′(t) − σ′(t − dt)|``. The difference is not divided by dt, so its
    size goes with dt: parameters hold for the step they were fitted at. With the
    backward scheme the first two samples are 0: they have no complete past.
    """
    return _change(stress_rate(stress_pa, dt_ms, derivative), 1, derivative)


def acceleration_change(
    stress_pa: ArrayLike, dt_ms: float, derivative: str = "backward"
) -> FloatArray:
    """Change of the stress acceleration in Pa/ms²: what drives PC.

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


@dataclass(slots=True)
class Past:
    """What a recursive filter keeps from one part of a trace to the next.

    The filter gets a part with samples around it: `before` of them come first and were filtered
    with the last part, the next `count` are the part. `value` is the output of its recursion at
    the sample before the part, None at the beginning of the trace.
    """

    before: int = 0
    count: int = 0
    value: FloatArray | None = None


def slow_rate(
    stress_pa: ArrayLike, dt_ms: float, derivative: str = "backward", past: Past | None = None
) -> FloatArray:
    """σ′ through a low pass of one pole at `SLOW_HZ`, in Pa/ms: the movement that drives SA.

    With `past` of a part of a trace: outputs before the part are 0.
    """
    rate = stress_rate(stress_pa, dt_ms, derivative)
    fed, kept = _low_pass(SLOW_HZ, dt_ms)
    fed_in = np.zeros_like(rate)
    fed_in[1:] = fed * (rate[1:] + rate[:-1])
    return _from_sample_to_sample(fed_in, lambda passed, now: kept * passed + now, past)


def faded(
    stress_pa: ArrayLike, dt_ms: float, derivative: str = "backward", past: Past | None = None
) -> FloatArray:
    """Stress less what has faded of it in Pa: the sustained part of what drives SA.

    ``max(σ − FADING_SHARE s, 0)``, where s follows σ with `FADE_MS` and is σ at the
    first sample: what was held before the trace has faded. With `past` of a part of a trace:
    outputs before the part mean nothing.
    """
    stress = checked_stress(stress_pa, dt_ms, derivative)
    gain = -math.expm1(-dt_ms / FADE_MS)
    followed = _from_sample_to_sample(
        stress, lambda before, now: before + gain * (now - before), past
    )
    left: FloatArray = np.maximum(stress - FADING_SHARE * followed, 0.0)
    return left


def corpuscle(stress_pa: ArrayLike, dt_ms: float, derivative: str = "backward") -> FloatArray:
    """Stress through a Pacinian corpuscle, compressed, in Pa^0.6.

    ``max(y, 0)^p − OTHER_SIDE max(−y, 0)^p`` with p `CORPUSCLE_POWER`: y is σ through
    three high and three low passes of one pole, all at `CORPUSCLE_HZ`: ``(r / (1 + r²))³``
    at r times that frequency. A constant stress leaves nothing, at any `dt_ms`.

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


def corpuscle_reach(dt_ms: float) -> int:
    """How many samples before one count for `corpuscle` there."""
    return len(_corpuscle_response(dt_ms, _LONGEST)) + 1


def _corpuscle_response(dt_ms: float, longest: int) -> list[float]:
    """Step response of the passes of `corpuscle`, as far as it matters.

    A pass is ``1 / (1 + s τ)`` or the rest of it by the trapezoidal rule, which keeps
    the gain at low frequencies at any `dt_ms`.
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


def _from_sample_to_sample(
    samples: FloatArray, step: Callable[[Any, Any], Any], past: Past | None = None
) -> FloatArray:
    """`step` of what came before and the next sample, from the first sample on.

    With a `past` that has a value, from the first sample of its part on.
    """
    found = np.empty_like(samples)
    start, held = 0, None
    if past is not None and past.value is not None:
        start, held = past.before, past.value
        found[:start] = 0.0
    if samples.ndim == 2 and samples.shape[1] > _FEW:
        rows = accumulate(samples[start:], step, initial=held)
        for row, now in enumerate(rows, start - (held is not None)):
            if row >= start:
                found[row] = now
    else:
        # Plain numbers are several times as fast as rows of a few.
        for column in np.ndindex(samples.shape[1:]):
            before = None if held is None else held[column].item()
            for first in range(start, len(samples), _BLOCK):
                part = (slice(first, first + _BLOCK), *column)
                block = accumulate(samples[part].tolist(), step, initial=before)
                values = list(block)[before is not None :]
                found[part] = values
                before = values[-1]
    if past is not None:
        past.value = np.array(found[past.before + past.count - 1])
    return found


def _low_pass(pole_hz: float, dt_ms: float) -> tuple[float, float]:
    """Shares of two inputs, and of the output before, in that of a low pass (trapezoidal rule)."""
    half = math.pi * pole_hz * dt_ms / 1000.0
    return half / (1.0 + half), (1.0 - half) / (1.0 + half)


def checked_stress(
    stress_pa: ArrayLike, dt_ms: float = 1.0, derivative: str = "backward"
) -> FloatArray:
    """`stress_pa` as float64 ``(T,)`` or ``(T, condition)``, or an error as `stress_rate`."""
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
    """Mean over samples t − `behind` to t + `ahead`; each t sums in the same order.

    A running sum would be quicker and leave a rounding residue of all that came
    before, so that a still finger after a loud stimulus would not be still.
    """
    width = behind + ahead + 1
    beside = ((behind, ahead), *[(0, 0)] * (values.ndim - 1))
    padded = np.pad(values, beside, mode="edge" if outside == "edge" else "constant")
    total = np.zeros_like(values)
    for shift in range(width):
        total += padded[shift : shift + values.shape[0]]
    total /= width
    return total
