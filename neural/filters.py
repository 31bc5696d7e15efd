"""Filters of the stress that drive each afferent: (1) to (4) of the paper, and ours.

The paper is Ishizuka et al., *Computational models for SA, RA, PC afferent*. Time
is always the first axis: stress is ``(T,)``, or ``(T, condition)`` for traces with a common
time axis, in Pa; the output of a filter has the same shape.

The paper leaves two points open:

*The scheme of* σ′ *and* σ″ is one of `DERIVATIVES`; σ″ is the scheme applied twice.
``backward`` is the default because it needs no future sample. For RA and PC
``forward`` gives the same series one or two samples earlier; ``central`` is smoother
and therefore weaker above about 200 Hz.

*The ends of a trace.* Outside the trace the probe is still: stress keeps the value
of that end, its derivative is 0, and the denominators remain the published ones.
Where a trace begins and ends unstressed, as the paper's sinusoids do, this equals
padding with zeros; on a pre-indented finger, zeros would mean no probe. A derivative
or difference that lacks one of its samples is 0: otherwise a waveform that starts at
full speed would have a jump that grows as dt shrinks, and fire RA and PC at onset.
After three still samples the rest is known, and the onset counts.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import accumulate

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import ParameterError, TraceError
from fembridge.typing import FloatArray
from neural.compiled import compiled

# Half-widths of the averages in samples, section 2.2: (1) looks M1 samples ahead
# and M2 behind, (2) looks M3 ahead and M4 behind. At 0.5 ms that is 4.5 ms ahead.
M1, M2, M3, M4 = 9, 9, 9, 8

# Poles of `corpuscle`: three high passes and two low passes. Recorded thresholds of Pacinian
# afferents fall up to 205 Hz, the highest frequency of Freeman & Johnson (1982).
CORPUSCLE_HIGH_HZ, CORPUSCLE_LOW_HZ = 500.0, 135.0
HIGH_PASSES, LOW_PASSES = 3, 2

# Exponent of the compression, and weight of negative values (decision 0056).
CORPUSCLE_POWER = 0.5
NEGATIVE_SHARE = 0.5

# Parts of a sustained stress to which the response of SA fades: share, and time constant in ms.
# The slowly inactivating currents of Merkel cells have about 200 ms and seconds (Gerling et al.
# 2018, PLoS Comput. Biol. 14, e1006264). Chosen by ramp-and-hold recordings (decision 0056).
FADES = ((0.8, 200.0), (0.04, 5000.0))

# Cutoff frequency of the response of SA to movement: of the tested values the best on a held-out
# frequency (decision 0032). Without it SA would fire 200 impulses/s at a strong 400 Hz.
SLOW_HZ = 100.0

# Up to this number of columns, a recursion in Python is faster than one in NumPy.
_FEW_COLUMNS = 10

# Added to the output of a recursion and taken away again, which leaves numbers above 1e-184 as they
# are and smaller ones as multiples of 1e-216: where a stress is held, filters would decay to
# denormal numbers, with which a processor is ten times as slow.
_FLUSH = 1e-200

# Numbers of samples before and after t that a derivative at t reads.
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

    Filter (3), ``|σ′(t) − σ′(t − dt)|``. The difference is not divided by dt and therefore
    proportional to it: parameters are valid only for the time step of their fit. With the
    backward scheme the first two samples are 0: they lack earlier samples.
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
        A scheme outside `DERIVATIVES`, or a time step that is not > 0.
    """
    stress = checked_stress(stress_pa, dt_ms, derivative)
    behind, ahead = _REACH[derivative]
    span = behind + ahead
    slope = np.zeros_like(stress)
    slope[behind : stress.shape[0] - ahead] = (stress[span:] - stress[:-span]) / (span * dt_ms)
    return slope


@dataclass(slots=True)
class Past:
    """State of a recursive filter between two parts of a trace.

    The filter reads a part with samples around it: the first `before` samples belong to the
    previous part, the next `count` are the part. `value` has input and output of the filter at the
    sample before the part; None at the start of the trace. `stages` are the states of the stages
    of a filter that has several.
    """

    before: int = 0
    count: int = 0
    value: FloatArray | None = None
    stages: list["Past"] = field(default_factory=list)

    def stage(self, number: int) -> "Past":
        """State of stage `number` from 0, for the same part."""
        if number == len(self.stages):
            self.stages.append(Past())
        stage = self.stages[number]
        stage.before, stage.count = self.before, self.count
        return stage


def slow_rate(
    stress_pa: ArrayLike, dt_ms: float, derivative: str = "backward", past: Past | None = None
) -> FloatArray:
    """Dynamic drive of SA in Pa/ms: σ′ through a one-pole low pass at `SLOW_HZ`.

    With `past`, `stress_pa` is a part of a trace, and outputs outside the part are 0.
    """
    return _low_passed(stress_rate(stress_pa, dt_ms, derivative), SLOW_HZ, dt_ms, past)


def faded(
    stress_pa: ArrayLike, dt_ms: float, derivative: str = "backward", past: Past | None = None
) -> FloatArray:
    """Sustained drive of SA in Pa: stress minus its faded parts.

    ``max(σ − Σ share s, 0)`` over the rows of `FADES`, where s follows σ with the time constant
    of its row and equals σ at the first sample: stress before the trace has faded. With `past`,
    `stress_pa` is a part of a trace, and outputs outside the part are undefined.
    """
    stress = checked_stress(stress_pa, dt_ms, derivative)
    remaining = stress.copy()
    for number, (share, fade_ms) in enumerate(FADES):
        kept = math.exp(-dt_ms / fade_ms)
        stage = None if past is None else past.stage(number)
        followed = _one_pole(stress, 1.0 - kept, 0.0, kept, stage)
        remaining -= np.multiply(share, followed, out=followed)
    return np.maximum(remaining, 0.0, out=remaining)


# Filters whose sum over any time, times dt, is at most the range of the stress; and filters whose
# output is at most the largest stress. No membrane behind them exceeds these (`neural.encoder`).
RISES, LEVELS = (stress_rate, slow_rate), (faded,)


def corpuscle(
    stress_pa: ArrayLike, dt_ms: float, derivative: str = "backward", past: Past | None = None
) -> FloatArray:
    """Drive of PC in Pa^p: stress filtered by a Pacinian corpuscle and compressed.

    ``max(y, 0)^p − NEGATIVE_SHARE max(−y, 0)^p`` with p `CORPUSCLE_POWER`: y is σ through three
    one-pole high passes at `CORPUSCLE_HIGH_HZ` and two low passes at `CORPUSCLE_LOW_HZ`, by the
    trapezoidal rule, which keeps the gain at low frequencies at any `dt_ms`. Stress before the
    trace is that of the first sample. With `past`, `stress_pa` is a part of a trace, and outputs
    outside the part are 0.
    """
    passed = checked_stress(stress_pa, dt_ms, derivative)
    follow = compiled(_follow_corpuscle) if CORPUSCLE_POWER == 0.5 else None
    if follow and not (past and past.stages):  # not begun without
        return _corpuscle_at_once(follow, passed, dt_ms, past or Past(count=len(passed)))
    for number in range(HIGH_PASSES + LOW_PASSES):
        stage = None if past is None else past.stage(number)
        if number < HIGH_PASSES:
            passed = passed - _low_passed(passed, CORPUSCLE_HIGH_HZ, dt_ms, stage)
        else:
            passed = _low_passed(passed, CORPUSCLE_LOW_HZ, dt_ms, stage)
    size = np.abs(passed) ** CORPUSCLE_POWER
    size[passed < 0] *= -NEGATIVE_SHARE
    return size


def _corpuscle_at_once(
    follow: Callable[..., None], stress: FloatArray, dt_ms: float, past: Past
) -> FloatArray:
    """`corpuscle` by the loop `follow` over all stages: each number is read and written once."""
    inputs = stress[past.before : past.before + past.count]
    flat = np.ascontiguousarray(inputs).reshape(len(inputs), -1)
    is_first = past.value is None
    if past.value is None:  # inputs and outputs of all stages
        past.value = np.zeros((2, HIGH_PASSES + LOW_PASSES, flat.shape[1]))
    poles = _low_pass(CORPUSCLE_HIGH_HZ, dt_ms), _low_pass(CORPUSCLE_LOW_HZ, dt_ms)
    outputs = np.zeros_like(stress)
    columns = outputs.reshape(len(outputs), -1)[past.before : past.before + len(inputs)]
    follow(flat, *poles[0], *poles[1], is_first, *past.value, columns)
    return outputs


def _low_pass(pole_hz: float, dt_ms: float) -> tuple[float, float]:
    """Share of the input, now and a step before, and of the output before (trapezoidal rule)."""
    half = math.pi * pole_hz * dt_ms / 1000.0
    return half / (1.0 + half), (1.0 - half) / (1.0 + half)


def _low_passed(values: FloatArray, pole_hz: float, dt_ms: float, past: Past | None) -> FloatArray:
    """`values` through a low pass of one pole (trapezoidal rule)."""
    share, kept = _low_pass(pole_hz, dt_ms)
    return _one_pole(values, share, share, kept, past)


def _one_pole(
    values: FloatArray, share: float, share_before: float, kept: float, past: Past | None
) -> FloatArray:
    """Y with ``y(t) = share x(t) + share_before x(t − dt) + kept y(t − dt)`` for x `values`.

    Before the trace x is its first sample, and y has settled. Outputs outside the part of `past`
    are 0.
    """
    part = slice(None) if past is None else slice(past.before, past.before + past.count)
    inputs = values[part]
    if past is None or past.value is None:
        settled = (share + share_before) / (1.0 - kept)
        before, output_before = inputs[0], settled * inputs[0]
    else:
        before, output_before = past.value
    outputs = np.zeros_like(values)
    if follow := compiled(_follow):
        begin = 0 if past is None else past.before
        columns = outputs.reshape(len(outputs), -1)[begin : begin + len(inputs)]
        flat = np.ascontiguousarray(inputs).reshape(len(inputs), -1)
        state = (np.atleast_1d(value) for value in (before, output_before))
        follow(flat, share, share_before, kept, *state, columns)
    else:
        outputs[part] = _followed(inputs, share, share_before, kept, before, output_before)
    if past is not None:
        past.value = np.stack([inputs[-1], outputs[part][-1]])
    return outputs


def _followed(
    inputs: FloatArray,
    share: float,
    share_before: float,
    kept: float,
    before: FloatArray,
    output_before: FloatArray,
) -> FloatArray:
    """The recursion of `_follow` to the last bit, row by row, or column by column where few."""
    fed = share * inputs
    fed[0] += share_before * before
    if share_before:
        fed[1:] += share_before * inputs[:-1]
    if fed[0].size > _FEW_COLUMNS:
        previous, kept_part = output_before, np.empty_like(fed[0])
        for row in fed:
            row += np.multiply(previous, kept, out=kept_part)
            row += _FLUSH
            row -= _FLUSH
            previous = row
        return fed
    columns, settled = fed.reshape(len(fed), -1), np.atleast_1d(output_before)
    for column, first in enumerate(settled.tolist()):
        values = accumulate(
            columns[:, column].tolist(),
            lambda output, x: (x + kept * output + _FLUSH) - _FLUSH,
            initial=first,
        )
        columns[:, column] = list(values)[1:]
    return columns.reshape(fed.shape)


def _follow(
    inputs: FloatArray,
    share: float,
    share_before: float,
    kept: float,
    before: FloatArray,
    output_before: FloatArray,
    outputs: FloatArray,
) -> None:
    """The recursion as a loop; `inputs` and `outputs` are ``(T, column)``."""
    for k in range(inputs.shape[1]):
        fed = share * inputs[0, k] + share_before * before[k]
        outputs[0, k] = (fed + kept * output_before[k] + _FLUSH) - _FLUSH
    for row in range(1, inputs.shape[0]):
        for k in range(inputs.shape[1]):
            fed = share * inputs[row, k] + share_before * inputs[row - 1, k]
            outputs[row, k] = (fed + kept * outputs[row - 1, k] + _FLUSH) - _FLUSH


def _follow_corpuscle(
    inputs: FloatArray,
    high_share: float,
    high_kept: float,
    low_share: float,
    low_kept: float,
    is_first: bool,
    before: FloatArray,
    output_before: FloatArray,
    outputs: FloatArray,
) -> None:
    """The stages of `corpuscle` as a loop; `inputs` and `outputs` are ``(T, column)``.

    `before` and `output_before` ``(stage, column)`` are changed to those of the last row; at the
    first row of a trace they are made.
    """
    stages, count = before.shape
    passed = np.empty(count)
    for row in range(inputs.shape[0]):
        for k in range(count):
            passed[k] = inputs[row, k]
        for stage in range(stages):
            is_high = stage < HIGH_PASSES
            share = high_share if is_high else low_share
            kept = high_kept if is_high else low_kept
            if is_first and row == 0:
                settled = (share + share) / (1.0 - kept)
                for k in range(count):
                    before[stage, k] = passed[k]
                    output_before[stage, k] = settled * passed[k]
            for k in range(count):
                fed = share * passed[k] + share * before[stage, k]
                output = (fed + kept * output_before[stage, k] + _FLUSH) - _FLUSH
                before[stage, k] = passed[k]
                output_before[stage, k] = output
                passed[k] = passed[k] - output if is_high else output
        for k in range(count):
            root = np.sqrt(np.abs(passed[k]))
            outputs[row, k] = -NEGATIVE_SHARE * root if passed[k] < 0.0 else root


def checked_stress(
    stress_pa: ArrayLike, dt_ms: float = 1.0, derivative: str = "backward"
) -> FloatArray:
    """`stress_pa` as float64 ``(T,)`` or ``(T, condition)``; raises the errors of `stress_rate`."""
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
        raise ParameterError(argument="dt_ms", found=dt_ms, expected="a finite number > 0")
    if derivative not in _REACH:
        raise ParameterError(
            argument="derivative", found=derivative, expected=f"one of {', '.join(DERIVATIVES)}"
        )
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

    A running sum would be faster, but leave a rounding residue of earlier samples: the
    output of a still finger after a strong stimulus would not be constant.
    """
    width = behind + ahead + 1
    pad_widths = ((behind, ahead), *[(0, 0)] * (values.ndim - 1))
    padded = np.pad(values, pad_widths, mode="edge" if outside == "edge" else "constant")
    total = np.zeros_like(values)
    for shift in range(width):
        total += padded[shift : shift + values.shape[0]]
    total /= width
    return total
