"""How weak a sinusoid an afferent still answers, and where it fires once a cycle."""

import math
from dataclasses import dataclass

import numpy as np

from fembridge.tables import AFFERENTS
from fembridge.validation.compared_rates import ComparedRates
from fembridge.validation.family import SINES
from fembridge.validation.number_text import amplitude_text
from neural import Plateau, entrainment_plateau, entrainment_threshold_um, threshold_amplitude_um


@dataclass(frozen=True, slots=True)
class ThresholdRow:
    """Amplitudes of one source, class and frequency; see `neural.threshold`.

    Rates are known from `lowest_um` to `highest_um`. A threshold that equals the
    lowest may be lower, one that is infinite is above the highest.
    """

    source: str
    afferent: str
    frequency_hz: float
    lowest_um: float
    highest_um: float
    threshold_um: float
    entrainment_um: float
    plateau: Plateau | None

    def told(self, amplitude_um: float) -> str:
        """Give an amplitude as a reader needs it: ``≤ 6.71``, ``23.0``, ``> 250``."""
        if math.isinf(amplitude_um):
            return f"> {amplitude_text(self.highest_um)}"
        sign = "≤ " if amplitude_um <= self.lowest_um else ""
        return f"{sign}{amplitude_text(amplitude_um)}"


def times_apart(one: ThresholdRow, other: ThresholdRow) -> float:
    """Give how many times the higher of two thresholds is the lower one, >= 1.

    1 where neither was reached, infinite where one was not.
    """
    low_um, high_um = sorted((one.threshold_um, other.threshold_um))
    return 1.0 if math.isinf(low_um) else high_um / low_um


def threshold_rows(compared: ComparedRates) -> tuple[ThresholdRow, ...]:
    """Read thresholds off each rate curve of a sinusoid that has a rate at all."""
    rows = []
    for source in compared.sources:
        for afferent in AFFERENTS:
            for one in SINES.sets:
                rate_ips = compared.of(source, afferent, one.stimuli)
                there = np.isfinite(rate_ips)
                if not there.any():
                    continue
                amplitude_um, rate_ips = np.array(one.level_um)[there], rate_ips[there]
                frequency_hz = one.entries[0].numbers()["frequency_hz"]
                rows.append(
                    ThresholdRow(
                        source=source,
                        afferent=afferent,
                        frequency_hz=frequency_hz,
                        lowest_um=float(amplitude_um.min()),
                        highest_um=float(amplitude_um.max()),
                        threshold_um=threshold_amplitude_um(amplitude_um, rate_ips),
                        entrainment_um=entrainment_threshold_um(
                            amplitude_um, rate_ips, frequency_hz
                        ),
                        plateau=entrainment_plateau(amplitude_um, rate_ips, frequency_hz),
                    )
                )
    return tuple(rows)
