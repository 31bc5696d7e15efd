"""How weak a vibration an afferent still answers, and how closely it follows one.

`vector_strength` judges spike times, all else curves: the rates of one afferent at the
amplitudes of one frequency. Between two amplitudes a curve is a straight line over the
logarithm of the amplitude, since the paper's amplitudes are spaced evenly there
(Appendix A).
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fembridge.errors import ParameterError
from fembridge.typing import BoolArray, FloatArray
from neural.agreement import EQUAL_IPS, checked_pair

# Section 3.2: 245 ms at 20 Hz, 100 ms else. One impulse in the longest of the paper's
# windows; in a shorter one a single impulse is above it.
CRITERION_IPS = 1000.0 / 245.0

# Impulses a cycle that pass for one to one.
PLATEAU = (0.9, 1.1)


@dataclass(frozen=True, slots=True)
class Plateau:
    """Amplitudes at which an afferent fires about once a cycle."""

    low_um: float
    high_um: float

    def __post_init__(self) -> None:
        if not 0 < self.low_um <= self.high_um < math.inf:
            raise ParameterError(
                f"plateau from {self.low_um} to {self.high_um} um, expected 0 < low <= high"
            )

    @property
    def decades(self) -> float:
        """Width of the plateau, in powers of ten of the amplitude."""
        return math.log10(self.high_um / self.low_um)


def threshold_amplitude_um(
    amplitude_um: ArrayLike, rate_ips: ArrayLike, criterion_ips: float = CRITERION_IPS
) -> float:
    """Lowest amplitude at which the rate reaches a criterion.

    Parameters
    ----------
    amplitude_um
        Amplitudes of one frequency, ``(N,)`` in µm, > 0, without duplicates, in any order.
    rate_ips
        The rate at each, ``(N,)``.
    criterion_ips
        Rate to be reached, > 0; by default one impulse in 245 ms.

    Returns
    -------
    float
        Amplitude in µm. A rate equal to the criterion has reached it, so an
        amplitude with that rate is given exactly. Where the curve falls again later,
        its first rise counts. Where the lowest amplitude already reaches the
        criterion, that amplitude: the threshold is there or below. Infinity where
        none does: it is above them all.

    Raises
    ------
    ParameterError
        Columns that are no curve, or a criterion that is not > 0.

    Examples
    --------
    >>> from neural.threshold import threshold_amplitude_um
    >>> round(threshold_amplitude_um([10, 1000], [0, 50], criterion_ips=25), 9)
    100.0
    """
    amplitude, rate = _checked_curve(amplitude_um, rate_ips)
    criterion = _positive(criterion_ips, "criterion_ips")
    reached = np.flatnonzero(rate >= criterion - EQUAL_IPS)
    if not reached.size:
        return math.inf
    row = int(reached[0])
    return _crossing_um(amplitude, rate, row, row - 1, criterion)


def entrainment_threshold_um(
    amplitude_um: ArrayLike, rate_ips: ArrayLike, frequency_hz: float
) -> float:
    """Lowest amplitude at which an afferent fires once a cycle.

    Arguments, result and errors are those of `threshold_amplitude_um`, with the
    frequency of the vibration in place of a criterion.

    Notes
    -----
    Also called the tuning threshold. Rates should come from windows of whole cycles:
    in 245 ms of 20 Hz, 4.9 cycles, a locked afferent fires 4 or 5 times, which is
    0.82 or 1.02 impulses a cycle.
    """
    frequency = _positive(frequency_hz, "frequency_hz")
    return threshold_amplitude_um(amplitude_um, rate_ips, criterion_ips=frequency)


def entrainment_plateau(
    amplitude_um: ArrayLike,
    rate_ips: ArrayLike,
    frequency_hz: float,
    impulses_per_cycle: tuple[float, float] = PLATEAU,
) -> Plateau | None:
    """Range of amplitudes in which an afferent fires about once a cycle.

    Parameters
    ----------
    amplitude_um, rate_ips
        As in `threshold_amplitude_um`.
    frequency_hz
        Of the vibration.
    impulses_per_cycle
        Least and most that pass for one to one; both belong to the range.

    Returns
    -------
    Plateau or None
        None where no amplitude of the curve is in the range: a curve that leaps
        across it was not locked there. Edges are where the curve crosses the range;
        an edge on the lowest or highest amplitude is as far as was tried, the plateau
        may go on. Of several, the one with the largest ratio of its edges.

    Raises
    ------
    ParameterError
        As `threshold_amplitude_um`, or a range that is none.

    Examples
    --------
    >>> from neural.threshold import entrainment_plateau
    >>> plateau = entrainment_plateau([1, 10, 100, 1000], [0, 50, 50, 100], 50)
    >>> round(plateau.low_um, 3), round(plateau.high_um, 3), round(plateau.decades, 9)
    (7.943, 125.893, 1.2)
    """
    amplitude, rate = _checked_curve(amplitude_um, rate_ips)
    frequency = _positive(frequency_hz, "frequency_hz")
    least, most = (edge * frequency for edge in impulses_per_cycle)
    if not 0 < least <= most < math.inf:
        raise ParameterError(
            f"impulses_per_cycle from {impulses_per_cycle[0]} to "
            f"{impulses_per_cycle[1]}, expected 0 < least <= most"
        )
    locked = (rate >= least - EQUAL_IPS) & (rate <= most + EQUAL_IPS)
    plateaus = [
        Plateau(
            low_um=_crossing_um(amplitude, rate, first, first - 1, least, most),
            high_um=_crossing_um(amplitude, rate, last, last + 1, least, most),
        )
        for first, last in _runs(locked)
    ]
    return max(plateaus, key=lambda plateau: plateau.decades, default=None)


def vector_strength(spike_times_ms: ArrayLike, frequency_hz: float) -> float:
    """How tightly spikes at ``(spike,)`` ms keep to one phase of a vibration.

    Returns
    -------
    float
        1 where all spikes stand at one phase, 0 where they are spread evenly; NaN
        without spikes. Few spikes look locked: one gives 1, and n at random phases
        about ``sqrt(0.8 / n)``.

    Raises
    ------
    ParameterError
        A time that is not finite, or a frequency that is not > 0.

    Notes
    -----
    Goldberg and Brown, J. Neurophysiol. 32, 613 (1969): the length of the mean of
    ``exp(2πi f t)``.
    """
    times_ms = np.sort(np.asarray(spike_times_ms, dtype=np.float64))
    if times_ms.ndim != 1 or not np.isfinite(times_ms).all():
        raise ParameterError("spike_times_ms must be (spike,) and finite")
    cycles = times_ms * (_positive(frequency_hz, "frequency_hz") / 1000.0)
    if not times_ms.size:
        return math.nan
    return min(1.0, float(np.abs(np.mean(np.exp(2j * np.pi * (cycles % 1.0))))))


def _checked_curve(amplitude_um: ArrayLike, rate_ips: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Both columns in order of amplitude."""
    amplitude, rate = checked_pair(amplitude_um, rate_ips, ("amplitude_um", "rate_ips"))
    order = np.argsort(amplitude)
    amplitude, rate = amplitude[order], rate[order]
    if not amplitude[0] > 0:
        raise ParameterError(f"amplitude_um must be > 0, got {amplitude[0]:g}")
    duplicate = np.flatnonzero(np.diff(amplitude) == 0)
    if duplicate.size:
        raise ParameterError(
            f"duplicate amplitude_um {amplitude[duplicate[0]]:g}; average its rates"
        )
    return amplitude, rate


def _crossing_um(
    amplitude_um: FloatArray,
    rate_ips: FloatArray,
    row: int,
    beside: int,
    least_ips: float,
    most_ips: float = math.inf,
) -> float:
    """Amplitude at which the curve comes into a range of rates between two rows.

    Its rate at `row` is in the range, at `beside` it is not; a row beside the curve
    makes `row` the end.
    """
    if not 0 <= beside < amplitude_um.size:
        return float(amplitude_um[row])
    inside_ips, outside_ips = float(rate_ips[row]), float(rate_ips[beside])
    edge_ips = least_ips if outside_ips < least_ips else most_ips
    share = (edge_ips - outside_ips) / (inside_ips - outside_ips)
    share = min(share, 1.0)  # a rate that equals the edge but for rounding
    return float(amplitude_um[row] ** share * amplitude_um[beside] ** (1.0 - share))


def _positive(value: float, name: str) -> float:
    if not (math.isfinite(value) and value > 0):
        raise ParameterError(f"{name} must be finite and > 0, got {value}")
    return float(value)


def _runs(locked: BoolArray) -> list[tuple[int, int]]:
    """First and last row of each run of true rows."""
    steps = np.diff(locked.astype(np.int64), prepend=0, append=0)
    firsts, ends = np.flatnonzero(steps == 1), np.flatnonzero(steps == -1)
    return [(int(first), int(end) - 1) for first, end in zip(firsts, ends, strict=True)]
