"""Stress histories: what a solver hands to an afferent."""

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge.errors import TraceError
from fembridge.typing import FloatArray

if TYPE_CHECKING:
    import pandas

PA_PER_MPA = 1.0e6
MS_PER_S = 1.0e3

AFFERENTS = ("SA", "RA", "PC")
AFFERENT_NAME = re.compile(r"[A-Z][A-Z0-9_]{0,39}")
"""Of a class: it becomes part of a set's name in a deck, and of a file's."""
UNIT_NAME = re.compile(r"[A-Za-z0-9_.:-]{1,60}")
"""Of a unit, where a class has several."""

# Solvers print times with six to ten digits; a step may be off by that much.
STEP_TOLERANCE = 1.0e-3
# A share of power, from which on a change of step is said to lose something.
_FOLDED_SHARE = 0.01
# Of a step: times that are rounded or jitter are within it.
_GAP_TOLERANCE = 0.25
# Share of odd steps in times that are even otherwise.
_FEW_GAPS = 0.1
_FFT_SAMPLES = 1 << 20  # of a spectrum; a longer history is the sum of several
# Resampled samples that take 1 GB, and those of one history whose spikes take 2 GB.
_MANY_SAMPLES, _LONG_HISTORY, _COARSE = 1 << 27, 8_000_000, 20
_MOST_SAMPLES = 10_000_000  # of a resampled history: 83 minutes of 0.5 ms


def afferent_key(afferent: str, unit: str = "") -> str:
    """Class and unit of an afferent as one name: ``SA``, or ``SA 12`` of several."""
    return f"{afferent} {unit}" if unit else afferent


def split_afferent_key(key: str) -> tuple[str, str]:
    """Class and unit of an `afferent_key`; the unit is "" without one."""
    afferent, _, unit = key.partition(" ")
    return afferent, unit


def seconds_to_ms(seconds: float) -> float:
    """A time of a file in ms.

    Raises
    ------
    ValueError
        It is NaN, infinite, or above 1.8e305 s, which float64 cannot hold in ms.
    """
    time_ms = seconds * MS_PER_S
    if not math.isfinite(time_ms):
        raise ValueError(f"a time of {seconds:g} s is no time")
    return time_ms


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class StressTrace:
    """Von Mises stress at one node over time, in even steps.

    Parameters
    ----------
    stress_pa
        Stress in Pa, ``(T,)``, T at least 2.
    dt_ms
        Time step in ms, more than 0.
    node
        Number of the node in the solver, from 1.
    afferent
        Class of the afferent at the node: ``"SA"``, ``"RA"`` or ``"PC"``. Default: None, a
        plain node.
    start_ms
        Time of the first sample in ms: `dt_ms` in a trace of solver increments without the
        rest state. Default: 0.
    unit
        Name of the unit, where a class has several. Default: ``""``.
    stimulus
        Name of the stimulus, where there are several. Default: ``""``.

    Raises
    ------
    TraceError
        Stress that is not finite or not ``(T,)``, or a step that is not more than 0.

    Examples
    --------
    >>> import numpy as np
    >>> import fembridge as fb
    >>> fb.StressTrace(np.linspace(0, 2e4, 501), dt_ms=0.5, node=461, afferent="SA")
    StressTrace(SA, node 461, 501 samples every 0.5 ms, peak 20000 Pa)
    """

    stress_pa: FloatArray
    dt_ms: float
    node: int
    afferent: str | None = None
    start_ms: float = 0.0
    unit: str = ""
    stimulus: str = ""

    def __post_init__(self) -> None:
        stress = np.array(self.stress_pa, dtype=np.float64)
        if stress.ndim != 1 or stress.size < 2:
            problem = f"of node {self.node} has shape {stress.shape}, expected (T,), T >= 2"
            raise TraceError(problem, argument="stress_pa", found=stress.shape)
        bad = np.flatnonzero(~np.isfinite(stress))
        if bad.size:
            problem = f"of node {self.node} is {stress[bad[0]]} at sample {bad[0]}"
            raise TraceError(problem, argument="stress_pa", found=float(stress[bad[0]]))
        if not (np.isfinite(self.dt_ms) and self.dt_ms > 0):
            raise TraceError(argument="dt_ms", found=self.dt_ms, expected="more than 0")
        if not np.isfinite(self.start_ms):
            raise TraceError(argument="start_ms", found=self.start_ms, expected="a finite number")
        stress.flags.writeable = False
        object.__setattr__(self, "stress_pa", stress)

    def _error(self, argument: str, finding: str, expected: str) -> TraceError:
        return TraceError(
            f"of node {self.node} {finding}, expected {expected}",
            argument=argument,
            found=getattr(self, argument),
            expected=expected,
        )

    def __repr__(self) -> str:
        who = f"{self.afferent}, " if self.afferent else ""
        return (
            f"StressTrace({who}node {self.node}, {self.stress_pa.size} samples every "
            f"{self.dt_ms:g} ms, peak {self.stress_pa.max():.6g} Pa)"
        )

    @property
    def times_ms(self) -> FloatArray:
        """Time of each sample, ``(T,)`` in ms."""
        steps: FloatArray = np.arange(self.stress_pa.size, dtype=np.float64)
        return self.start_ms + steps * self.dt_ms


def middle_step(steps_ms: FloatArray) -> float:
    """The middle of all steps, the larger of two; `numpy.median` imports `numpy.ma` for it."""
    return float(np.sort(steps_ms)[steps_ms.size // 2])


def mean_step(times_ms: FloatArray) -> tuple[float, int | None]:
    """Mean step of `times_ms` ``(T,)``; where it is not every step, the row before an odd one."""
    steps_ms = np.diff(times_ms)
    mean_ms = float((times_ms[-1] - times_ms[0]) / steps_ms.size)
    if mean_ms > 0 and (np.abs(steps_ms - mean_ms) <= STEP_TOLERANCE * mean_ms).all():
        return mean_ms, None
    usual_ms = middle_step(steps_ms)
    even = np.abs(steps_ms - usual_ms) <= STEP_TOLERANCE * usual_ms
    return mean_ms, int(even.argmin())


def doubt_of_gaps(times_ms: FloatArray) -> str | None:
    """Which samples seem to be missing from rising times ``(T,)``; None: none.

    Times that are even but for a few steps had a sample in each of them.
    """
    steps_ms = np.diff(times_ms)
    usual_ms = middle_step(steps_ms)
    odd = np.abs(steps_ms - usual_ms) > _GAP_TOLERANCE * usual_ms
    if not 0 < odd.sum() <= _FEW_GAPS * steps_ms.size:
        return None
    first = int(odd.argmax())
    return (
        f"{odd.sum()} of {steps_ms.size} steps are not {usual_ms:g} ms, the first from "
        f"{times_ms[first]:g} to {times_ms[first + 1]:g} ms: samples lost, or times changed?"
    )


def resample(
    times_ms: FloatArray,
    values: FloatArray,
    dt_ms: float,
    log: Callable[[str], None] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """An uneven history on an even grid: times ``(N,)`` every `dt_ms`, and values ``(N, ...)``.

    PCHIP through the samples: cubic between two of them, and never beyond them. The grid
    begins at the first sample and ends at the last or less than a step before it, so
    nothing is extrapolated. `log` gets a line: step, range, and the gaps that are longer
    than a step.

    Parameters
    ----------
    times_ms, values
        ``(T,)``, rising, and ``(T, ...)``, two samples or more, all finite.

    Raises
    ------
    TraceError
        Samples that are no such history; a step that is longer than it, or so short
        that ten million samples are not enough.
    """
    times_ms, values = np.asarray(times_ms, dtype=np.float64), np.asarray(values)
    if times_ms.ndim != 1 or times_ms.size < 2 or len(values) != times_ms.size:
        plural = "" if times_ms.size == 1 else "s"
        raise TraceError(f"{times_ms.size} sample{plural}, expected two or more to resample")
    if not (np.isfinite(times_ms).all() and np.isfinite(values).all()):
        raise TraceError("samples that are not finite cannot be resampled")
    gaps_ms = np.diff(times_ms)
    if not (gaps_ms > 0).all():
        row = int(np.argmin(gaps_ms > 0))
        raise TraceError(
            f"{times_ms[row + 1]:g} ms comes after {times_ms[row]:g} ms, expected rising times"
        )
    first_ms, last_ms = float(times_ms[0]), float(times_ms[-1])
    span_ms = last_ms - first_ms
    if not (0 < dt_ms <= span_ms * (1 + STEP_TOLERANCE) and span_ms / dt_ms < _MOST_SAMPLES):
        raise TraceError(
            f"a step of {dt_ms:g} ms to resample {first_ms:g} to {last_ms:g} ms, expected "
            f"{span_ms / _MOST_SAMPLES:g} to {span_ms:g}"
        )
    steps = int(span_ms / dt_ms + STEP_TOLERANCE)
    even_ms = np.minimum(first_ms + np.arange(steps + 1) * dt_ms, last_ms)
    if log is not None:
        end_text = f"{even_ms[-1]:g} ms"
        if last_ms - even_ms[-1] > STEP_TOLERANCE * dt_ms:
            end_text += f" (of {last_ms:g})"
        line = f"resampled every {dt_ms:g} ms from {first_ms:g} to {end_text}"
        widest = int(gaps_ms.argmax())
        if (count := int((gaps_ms > dt_ms * (1 + STEP_TOLERANCE)).sum())) > 0:
            line += (
                f", through {count} of {gaps_ms.size} intervals that are longer, up to "
                f"{gaps_ms[widest]:g} ms at {times_ms[widest]:g} ms"
            )
        log(line)
    from scipy.interpolate import PchipInterpolator  # slow to import

    # A value depends on two samples on each side of it: of a fine history most are not needed.
    before = np.clip(np.searchsorted(times_ms, even_ms, "right") - 1, 0, times_ms.size - 2)
    rows = np.unique(np.clip(before[:, None] + np.arange(-1, 3), 0, times_ms.size - 1))
    if rows.size < times_ms.size:
        times_ms, values = times_ms[rows], values[rows]
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # of 1e200
            resampled: FloatArray = PchipInterpolator(times_ms, values, axis=0)(even_ms)
    except ValueError as error:  # of 1e308, whose slope is not finite
        raise TraceError(f"values too large to resample: {np.abs(values).max():g}") from error
    return even_ms, resampled


def check_growth(samples: int, resampled: int, longest: int) -> None:
    """Refuse a few samples that would become gigabytes on a finer step.

    `samples` are those of all histories, `resampled` what they become, `longest` what the
    longest of them becomes. No hand is felt for so long so coarsely: times are in another unit.

    Raises
    ------
    TraceError
        More than `_MANY_SAMPLES`, or `_LONG_HISTORY` in one, of a step `_COARSE` times longer.
    """
    if resampled <= _COARSE * samples:
        return
    if resampled > _MANY_SAMPLES or longest > _LONG_HISTORY:
        raise TraceError(
            f"{samples} samples would become {resampled} by resampling: are times in another unit?"
        )


def doubt_of_step(values: FloatArray, dt_ms: float, step_ms: float) -> str | None:
    """What is lost of a history ``(T, ...)`` every `dt_ms` that goes on a step of `step_ms`.

    What is above half the rate of a longer step folds; of a shorter one PCHIP smooths
    what is above a tenth of the rate there was. None: neither holds 1 % of the power.
    """
    if abs(dt_ms - step_ms) <= STEP_TOLERANCE * step_ms:
        return None
    finer = dt_ms < step_ms
    limit_hz = MS_PER_S / (2 * step_ms if finer else 10 * dt_ms)
    above = total = 0.0
    for begin in range(0, len(values), _FFT_SAMPLES):
        block = values[begin : begin + _FFT_SAMPLES]
        count = len(block)
        # The window takes away the jump from end to start, which has power everywhere.
        with np.errstate(over="ignore", invalid="ignore"):  # of 1e200
            windowed = ((block - block.mean(axis=0)).T * np.hanning(count)).reshape(-1, count)
            power = (np.abs(np.fft.rfft(windowed)) ** 2).sum(axis=0)
            total += power.sum()
            above += power[np.fft.rfftfreq(count, dt_ms / MS_PER_S) > limit_hz].sum()
    share = float(above) / float(total) if total else 0.0
    if not share > _FOLDED_SHARE:  # nor where it is not a number
        return None
    loss = f"{100 * share:.0f} % of its power is above {limit_hz:g} Hz: "
    return loss + ("filter it first" if finer else "rates may be off: sample it every 0.5 ms")


def stacked(rows: Sequence[FloatArray]) -> FloatArray:
    """Histories ``(T,)`` of any lengths as ``(S, T)``, NaN behind the end of a shorter one."""
    most = max(row.size for row in rows)
    padded = [np.pad(row, (0, most - row.size), constant_values=np.nan) for row in rows]
    return np.array(padded)


@dataclass(frozen=True, slots=True)
class Origin:
    """The run that traces come from: defaults of `fembridge.encode`.

    `window_ms` is the counting window of spikes, `preindent_um` the depth of the probe before
    time 0, `parameters` a table of `neural.ParameterSet.to_table`, and `finger` has ``name``
    and ``sha256`` of the model; {} if unknown.
    """

    stimulus: str
    window_ms: tuple[float, ...]
    preindent_um: float = 0.0
    parameters: dict[str, Any] = field(default_factory=dict)
    finger: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if len(self.window_ms) != 2:
            raise TraceError(argument="window_ms", found=self.window_ms, expected="two numbers")


def finger_id(table: Mapping[str, Any]) -> dict[str, str]:
    """Name and digest of a finger from its `table` (`decks.presets.finger_table`)."""
    from fembridge.host.store import digest

    return {"name": str(table.get("name", "")), "sha256": digest(table)}


def model_id(origin: Mapping[str, Any]) -> dict[str, str]:
    """Name and checksum of the finger or the deck of a response map, from its `origin`.

    A map of a probe on a pad also has the pad and its ridges. Empty where the origin has nothing.
    """
    mechanics = origin.get("mechanics")
    if isinstance(mechanics, Mapping):
        return {str(key): str(value) for key, value in mechanics.items()}
    finger, base = origin.get("finger"), origin.get("base_deck")
    if isinstance(finger, Mapping):
        return finger_id(finger)
    if isinstance(base, Mapping):
        return {"name": str(base.get("file", "")), "sha256": str(base.get("sha256", ""))}
    return {}


class Traces(list[StressTrace]):
    """Stress histories, as `fembridge.read` gives them: a list that can become a table.

    `origin` is the run that they come from, None if unknown; `windows_ms` has the known counting
    windows by stimulus.
    """

    def __init__(
        self,
        traces: Iterable[StressTrace] = (),
        origin: Origin | None = None,
        windows_ms: Mapping[str, tuple[float, ...]] | None = None,
    ) -> None:
        super().__init__(traces)
        self.origin = origin
        of_origin = {} if origin is None else {origin.stimulus: origin.window_ms}
        self.windows_ms = of_origin if windows_ms is None else dict(windows_ms)

    def to_frame(self) -> "pandas.DataFrame":
        """Table ``time_ms, afferent, node, von_mises_pa``, a row a sample, trace by trace.

        Columns ``stimulus`` and ``unit`` come first, if traces have them.
        """
        import pandas

        named = [
            name for name in ("stimulus", "unit") if any(getattr(trace, name) for trace in self)
        ]
        frames = [
            pandas.DataFrame(
                {
                    **{name: getattr(trace, name) for name in named},
                    "time_ms": trace.times_ms,
                    "afferent": trace.afferent,
                    "node": trace.node,
                    "von_mises_pa": trace.stress_pa,
                }
            )
            for trace in self
        ]
        return pandas.concat(frames, ignore_index=True)
