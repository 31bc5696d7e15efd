"""Rates of the same stimuli from several sources, side by side."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fembridge.errors import UsageError
from fembridge.tables import AFFERENTS, Rate
from fembridge.typing import FloatArray

OBSERVED = "observed"
TOUCHSIM = "TouchSim"


@dataclass(frozen=True, slots=True, eq=False)
class ComparedRates:
    """Rates `rate_ips` ``(source, stimulus, afferent)``, NaN where one has none.

    `afferents` are SA, RA and PC.

    Raises
    ------
    UsageError
        An array of another shape, a name that stands twice, a rate that is negative
        or infinite.
    """

    sources: tuple[str, ...]
    stimuli: tuple[str, ...]
    rate_ips: FloatArray

    def __post_init__(self) -> None:
        rate_ips = np.array(self.rate_ips, dtype=np.float64)
        expected = (len(self.sources), len(self.stimuli), len(AFFERENTS))
        if rate_ips.shape != expected:
            raise UsageError(f"rates of shape {rate_ips.shape}, expected {expected}")
        for names in (self.sources, self.stimuli):
            twice = next((name for name in names if names.count(name) > 1), None)
            if twice is not None:
                raise UsageError(f"{twice} stands there twice")
        if (rate_ips < 0).any() or np.isinf(rate_ips).any():
            raise UsageError("a rate is negative or infinite")
        rate_ips.flags.writeable = False
        object.__setattr__(self, "rate_ips", rate_ips)

    def known(self, stimuli: Sequence[str]) -> tuple[str, ...]:
        """Give the sources that have a rate under at least one of `stimuli`."""
        rows = [self.stimuli.index(stimulus) for stimulus in stimuli]
        return tuple(
            source
            for source, rate_ips in zip(self.sources, self.rate_ips, strict=True)
            if np.isfinite(rate_ips[rows]).any()
        )

    def reference(self, stimuli: Sequence[str]) -> str:
        """Give what models are held against: observed rates, or else TouchSim's."""
        return OBSERVED if OBSERVED in self.known(stimuli) else TOUCHSIM

    def of(self, source: str, afferent: str, stimuli: Sequence[str]) -> FloatArray:
        """Rates ``(S,)`` of a source and class under `stimuli`, NaN where none is."""
        rows = [self.stimuli.index(stimulus) for stimulus in stimuli]
        column = AFFERENTS.index(afferent)
        found: FloatArray = self.rate_ips[self.sources.index(source), rows, column]
        return found


def compare_rates(stimuli: Sequence[str], sources: Mapping[str, Iterable[Rate]]) -> ComparedRates:
    """Put tables of rates beside each other; rates of other stimuli are left out."""
    row = {stimulus: place for place, stimulus in enumerate(stimuli)}
    rate_ips = np.full((len(sources), len(stimuli), len(AFFERENTS)), np.nan)
    for place, rates in enumerate(sources.values()):
        for rate in rates:
            if rate.stimulus in row:
                column = AFFERENTS.index(rate.afferent)
                rate_ips[place, row[rate.stimulus], column] = rate.rate_ips
    return ComparedRates(tuple(sources), tuple(stimuli), rate_ips)
