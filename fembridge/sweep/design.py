"""Designs of fingers: one parameter at a time, or all at once in a Latin hypercube.

A range is two values of a parameter, named or told about its base value::

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
from fembridge.sweep.toml_value import number_of

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

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high)):
            raise UsageError(f"{self.low} to {self.high}, expected finite numbers")
        if not self.low < self.high:
            raise UsageError(f"from {self.low:g} to {self.high:g}, expected the lower value first")

    def at(self, share: float) -> float:
        """Give the value at `share` of the way, 0 to 1."""
        if self.logarithmic:
            value = self.low * (self.high / self.low) ** share
        else:
            value = self.low + share * (self.high - self.low)
        return float(f"{value:.{_DIGITS}g}")


def range_of(asked: object, base: float | None, where: str) -> Range:
    """Make a range of what the study says, about the parameter's `base` value.

    Raises
    ------
    UsageError
        Neither two numbers nor words about a base value that is there and > 0.
    """
    try:
        if isinstance(asked, list) and len(asked) == 2:
            low, high = (number_of(each, where) for each in asked)
            return Range(low, high)
        percent = _PERCENT.fullmatch(asked) if isinstance(asked, str) else None
        factor = _FACTOR.fullmatch(asked) if isinstance(asked, str) else None
        if percent is None and factor is None:
            raise UsageError(f"{asked!r}, expected [from, to], as [0.9, 1.3], '20 %' or 'factor 2'")
        if base is None or not base > 0:
            raise UsageError(
                f"{asked!r} of {'nothing' if base is None else f'{base:g}'}: expected [from, to]"
            )
        if percent is not None:
            share = float(percent[1]) / 100
            if not 0 < share < 1:
                raise UsageError(f"{asked!r}, expected more than 0 % and below 100 %")
            return Range(_short(base * (1 - share)), _short(base * (1 + share)))
        assert factor is not None
        times = float(factor[1])
        if not times > 1:
            raise UsageError(f"{asked!r}, expected a factor above 1")
        return Range(_short(base / times), _short(base * times), logarithmic=True)
    except UsageError as error:
        text = str(error)
        raise UsageError(text if text.startswith(where) else f"{where}: {text}") from (error)


def one_at_a_time(base: Mapping[str, float], ranges: Mapping[str, Range]) -> list[dict[str, float]]:
    """Give the base first, then each parameter low and high, the others at the base.

    A value that is the base's own is left out: it is no other finger.
    """
    start = dict(base)
    rows = [start]
    for name, span in ranges.items():
        rows += [{**start, name: value} for value in (span.low, span.high) if value != start[name]]
    return rows


def latin_hypercube(ranges: Mapping[str, Range], samples: int, seed: int) -> list[dict[str, float]]:
    """Draw fingers, so that each of `samples` slices of each range has one.

    Of the ways to do so, one in which parameters hardly go together is searched
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
    """Give shares of ranges in [0, 1), ``(sample, parameter)``."""
    from scipy.stats import qmc

    sampler = qmc.LatinHypercube(
        parameters,
        optimization="random-cd" if samples <= _MOST_OPTIMISED else None,
        seed=np.random.default_rng(seed),
    )
    shares: Sequence[Sequence[float]] = sampler.random(samples).tolist()
    return shares


def _short(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")
