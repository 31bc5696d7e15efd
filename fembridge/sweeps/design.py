"""Designs of fingers: one parameter at a time, or all at once in a Latin hypercube.

A range is two values of a parameter, or words about its base value::

    skin.dermis_mm = [0.9, 1.3]                  # from, to
    skin.epidermis_mm = "20 %"                   # 20 % less to 20 % more
    materials.dermis.young_mpa = "factor 2"      # half of it to twice, logarithmic
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fembridge.errors import UsageError

ONE_AT_A_TIME = "one-at-a-time"
LATIN_HYPERCUBE = "latin-hypercube"
DESIGNS = (ONE_AT_A_TIME, LATIN_HYPERCUBE)

# Of a drawn value: enough for any size, and short to read.
_DIGITS = 6
# Chance correlations of more samples are small without it, and it takes its time.
_MOST_OPTIMISED = 200

_PERCENT = re.compile(r"(?:±|\+/?-)?\s*(\d+(?:\.\d+)?)\s*%")
_FACTOR = re.compile(r"factor\s+(\d+(?:\.\d+)?)")


@dataclass(frozen=True, slots=True)
class Range:
    """From `low` to `high`, evenly, or evenly in the logarithm."""

    low: float
    high: float
    logarithmic: bool = False

    def at(self, share: float) -> float:
        """Value at `share` of the way, 0 to 1."""
        if self.logarithmic:
            value = self.low * (self.high / self.low) ** share
        else:
            value = self.low + share * (self.high - self.low)
        return _rounded(value)


def range_of(asked: object, base: float | None) -> Range:
    """Range that the study asks for, of a parameter with the `base` value.

    Raises
    ------
    UsageError
        Neither two numbers nor words about a base value that is there and > 0.
    """
    if isinstance(asked, list) and len(asked) == 2:
        low, high = (_number(each) for each in asked)
        if not low < high:
            raise UsageError(f"from {low:g} to {high:g}, expected the lower value first")
        return Range(low, high)
    word = asked if isinstance(asked, str) else ""
    percent, factor = _PERCENT.fullmatch(word), _FACTOR.fullmatch(word)
    if percent is None and factor is None:
        raise UsageError(f"{asked!r}, expected [from, to], as [0.9, 1.3], '20 %' or 'factor 2'")
    if base is None or not base > 0:
        of = "nothing" if base is None else f"{base:g}"
        raise UsageError(f"{asked!r} of {of}: expected [from, to]")
    if percent is not None:
        share = float(percent[1]) / 100
        if not 0 < share < 1:
            raise UsageError(f"{asked!r}, expected more than 0 % and below 100 %")
        return Range(_rounded(base * (1 - share)), _rounded(base * (1 + share)))
    assert factor is not None
    times = float(factor[1])
    if not times > 1:
        raise UsageError(f"{asked!r}, expected a factor above 1")
    return Range(_rounded(base / times), _rounded(base * times), logarithmic=True)


def one_at_a_time(base: Mapping[str, float], ranges: Mapping[str, Range]) -> list[dict[str, float]]:
    """The base first, then each parameter low and high, the others as in the base.

    A value that is the base's own is left out: it is no other finger.
    """
    start = dict(base)
    rows = [start]
    for name, span in ranges.items():
        rows += [{**start, name: value} for value in (span.low, span.high) if value != start[name]]
    return rows


def latin_hypercube(ranges: Mapping[str, Range], samples: int, seed: int) -> list[dict[str, float]]:
    """Fingers of which each of `samples` slices of each range has one.

    Of the ways to draw them, one in which parameters hardly go together is searched
    for (``random-cd`` of SciPy). The same seed draws the same fingers, as long as
    SciPy is the same.
    """
    shares = hypercube_shares(len(ranges), samples, seed)
    return [
        {
            name: span.at(float(share))
            for (name, span), share in zip(ranges.items(), row, strict=True)
        }
        for row in shares
    ]


def hypercube_shares(parameters: int, samples: int, seed: int) -> Sequence[Sequence[float]]:
    """Shares of ranges in [0, 1), ``(sample, parameter)``."""
    from scipy.stats import qmc

    sampler = qmc.LatinHypercube(
        parameters,
        optimization="random-cd" if samples <= _MOST_OPTIMISED else None,
        seed=np.random.default_rng(seed),
    )
    shares: Sequence[Sequence[float]] = sampler.random(samples).tolist()
    return shares


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise UsageError(f"{value!r}, expected a finite number")
    return float(value)


def _rounded(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")
