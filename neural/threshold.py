"""Threshold amplitude of an afferent, and amplitudes at which it fires once per cycle.

A curve is the rates of one afferent at the amplitudes of one frequency, ``(N,)`` each, in
any order, with amplitudes > 0 and without duplicates. Between two amplitudes it is linear in
the logarithm of the amplitude, in which the paper's amplitudes are evenly spaced
(Appendix A).
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fembridge.typing import BoolArray, FloatArray
from neural.agreement import EQUAL_IPS

# One impulse in the longest window of the paper (section 3.2: 245 ms at 20 Hz, 100 ms
# otherwise); in a shorter window a single impulse exceeds the criterion.
CRITERION_IPS = 1000.0 / 245.0

# Impulses per cycle that count as one to one.
PLATEAU = (0.9, 1.1)


@dataclass(frozen=True, slots=True)
class Plateau:
    """Range of amplitudes in um at which an afferent fires about once per cycle."""

    low_um: float
    high_um: float

    @property
    def decades(self) -> float:
        """Width of the plateau, in powers of ten of the amplitude."""
        return math.log10(self.high_um / self.low_um)


def threshold_amplitude_um(
    amplitude_um: ArrayLike, rate_ips: ArrayLike, criterion_ips: float = CRITERION_IPS
) -> float:
    """Lowest amplitude at which the rate reaches a criterion, by default one impulse in 245 ms.

    With the frequency as criterion, the result is the amplitude of one impulse per cycle,
    also called the tuning threshold. Windows should then be whole cycles: in 245 ms of
    20 Hz (4.9 cycles) a locked afferent fires 4 or 5 times, 0.82 or 1.02 impulses per cycle.

    Returns
    -------
    float
        Amplitude in µm. A rate equal to the criterion reaches it. Where the curve falls
        again later, its first rise counts. The lowest amplitude where that already reaches
        the criterion (the threshold is there or below); infinity where no amplitude does.

    Examples
    --------
    >>> from neural.threshold import threshold_amplitude_um
    >>> round(threshold_amplitude_um([10, 1000], [0, 50], criterion_ips=25), 9)
    100.0
    """
    amplitude, rate = _sort_by_amplitude(amplitude_um, rate_ips)
    reached = np.flatnonzero(rate >= criterion_ips - EQUAL_IPS)
    if not reached.size:
        return math.inf
    row = int(reached[0])
    return _crossing_um(amplitude, rate, row, row - 1, criterion_ips)


def entrainment_plateau(
    amplitude_um: ArrayLike,
    rate_ips: ArrayLike,
    frequency_hz: float,
    impulses_per_cycle: tuple[float, float] = PLATEAU,
) -> Plateau | None:
    """Range of amplitudes in which an afferent fires about once per cycle.

    `impulses_per_cycle` (default: 0.9 to 1.1) is the range that counts, ends included.

    Returns
    -------
    Plateau or None
        None where no amplitude of the curve is in the range. The edges are interpolated;
        an edge at the lowest or highest amplitude is only a bound. Of several plateaus
        the one with the largest ratio of its edges.

    Examples
    --------
    >>> from neural.threshold import entrainment_plateau
    >>> plateau = entrainment_plateau([1, 10, 100, 1000], [0, 50, 50, 100], 50)
    >>> round(plateau.low_um, 3), round(plateau.high_um, 3), round(plateau.decades, 9)
    (7.943, 125.893, 1.2)
    """
    amplitude, rate = _sort_by_amplitude(amplitude_um, rate_ips)
    least, most = (edge * frequency_hz for edge in impulses_per_cycle)
    locked = (rate >= least - EQUAL_IPS) & (rate <= most + EQUAL_IPS)
    plateaus = [
        Plateau(
            low_um=_crossing_um(amplitude, rate, first, first - 1, least, most),
            high_um=_crossing_um(amplitude, rate, last, last + 1, least, most),
        )
        for first, last in _runs(locked)
    ]
    return max(plateaus, key=lambda plateau: plateau.decades, default=None)


def _sort_by_amplitude(
    amplitude_um: ArrayLike, rate_ips: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Both columns in order of amplitude."""
    amplitude, rate = (np.asarray(column, dtype=np.float64) for column in (amplitude_um, rate_ips))
    order = np.argsort(amplitude)
    return amplitude[order], rate[order]


def _crossing_um(
    amplitude_um: FloatArray,
    rate_ips: FloatArray,
    row: int,
    neighbour: int,
    least_ips: float,
    most_ips: float = math.inf,
) -> float:
    """Amplitude at which the curve enters a range of rates between two rows.

    The rate at `row` is in the range, that at `neighbour` is not. Where `neighbour` is
    outside the curve, the amplitude at `row`.
    """
    if not 0 <= neighbour < amplitude_um.size:
        return float(amplitude_um[row])
    inside_ips, outside_ips = float(rate_ips[row]), float(rate_ips[neighbour])
    edge_ips = least_ips if outside_ips < least_ips else most_ips
    share = (edge_ips - outside_ips) / (inside_ips - outside_ips)
    share = min(share, 1.0)  # a rate that equals the edge but for rounding
    return float(amplitude_um[row] ** share * amplitude_um[neighbour] ** (1.0 - share))


def _runs(locked: BoolArray) -> list[tuple[int, int]]:
    """First and last row of each run of true rows."""
    steps = np.diff(locked.astype(np.int64), prepend=0, append=0)
    firsts, ends = np.flatnonzero(steps == 1), np.flatnonzero(steps == -1)
    return [(int(first), int(end) - 1) for first, end in zip(firsts, ends, strict=True)]
