"""Designs of fingers: one parameter at a time, or all at once in a Latin hypercube.

A range is two values of a parameter, or words about its base value::

    skin.dermis_mm = [0.9, 1.3]                  # from, to
    skin.epidermis_mm = "20 %"                   # 20 % less to 20 % more
    materials.dermis.young_mpa = "factor 2"      # half of it to twice, logarithmic
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fembridge.errors import UsageError

ONE_AT_A_TIME = "one-at-a-time"
LATIN_HYPERCUBE = "latin-hypercube"

# Of a drawn value: enough for any size, and short to read.
_DIGITS = 6
# Chance correlations of more samples are small without it, and it takes its time.
_MOST_OPTIMISED = 200

_NUMBER = r"(\d+(?:\.\d+)?)"
_WORDS = re.compile(rf"(?:±|\+/?-)?\s*{_NUMBER}\s*%|factor\s+{_NUMBER}")


@dataclass(frozen=True, slots=True)
class Range:
    """From `low` to `high`, evenly, or evenly in the logarithm."""

    low: float
    high: float
    logarithmic: bool = False

    def at(self, share: float) -> float:
        """Value at `share` of the way, 0 to 1."""
        if self.logarithmic:
            return _rounded(self.low * (self.high / self.low) ** share)
        return _rounded(self.low + share * (self.high - self.low))


def range_of(asked: object, base: float | None) -> Range:
    """Range that the study asks for, of a parameter with the `base` value."""
    if isinstance(asked, list) and all(type(each) in (int, float) for each in asked):
        if len(asked) == 2 and -math.inf < asked[0] < asked[1] < math.inf:
            return Range(float(asked[0]), float(asked[1]))
    elif base is not None and base > 0 and (match := _WORDS.fullmatch(str(asked))):
        share, factor = float(match[1] or 0) / 100, float(match[2] or 0)
        if 0 < share < 1:
            return Range(_rounded(base * (1 - share)), _rounded(base * (1 + share)))
        if factor > 1:
            return Range(_rounded(base / factor), _rounded(base * factor), logarithmic=True)
    raise UsageError(
        f"{asked!r} of the base's {base}, expected [from, to], as [0.9, 1.3]; of a base above 0 "
        "also '20 %', below 100 %, or 'factor 2', above 1"
    )


def one_at_a_time(base: Mapping[str, float], ranges: Mapping[str, Range]) -> list[dict[str, float]]:
    """The base first, then each parameter low and high, the others as in the base.

    A value that is the base's own is left out: it is no other finger.
    """
    rows = [dict(base)]
    for name, span in ranges.items():
        rows += [{**base, name: value} for value in (span.low, span.high) if value != base[name]]
    return rows


def latin_hypercube(ranges: Mapping[str, Range], samples: int, seed: int) -> list[dict[str, float]]:
    """Fingers of which each of `samples` slices of each range has one.

    Of the ways to draw them, one in which parameters hardly go together is searched
    for (``random-cd`` of SciPy). The same seed draws the same fingers, as long as
    SciPy is the same.
    """
    from scipy.stats import qmc

    sampler = qmc.LatinHypercube(
        len(ranges),
        optimization="random-cd" if samples <= _MOST_OPTIMISED else None,
        seed=np.random.default_rng(seed),
    )
    return [
        {name: span.at(share) for (name, span), share in zip(ranges.items(), row, strict=True)}
        for row in sampler.random(samples).tolist()
    ]


def _rounded(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")
