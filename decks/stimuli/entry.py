"""A stimulus before it has samples: its family, its numbers, its window.

An entry is checked when made and its id tells all of it, so that an id from a
table is enough to have the stimulus again. Ids join the family and the numbers
without trailing zeros: ``sine_20_250``, ``noise_25_250_0.25``. A diharmonic of
Appendix B is named by its first amplitude, ``diharm_10_100_125``; any other one
by both, ``diharm_10_100_125_125``.
"""

import zlib
from dataclasses import dataclass
from math import isfinite
from typing import ClassVar, TypeAlias

from decks.stimuli.appendix import DIHARMONIC_AMPLITUDES_UM, NOISE_RMS_UM, SINE_AMPLITUDES_UM
from fembridge.errors import StimulusError

DT_MS = 0.5  # the time increment of the paper, section 2
DURATION_MS = 250.0  # section 3.2
NYQUIST_HZ = 500.0 / DT_MS

DECIMALS = 6
"""Decimals of an amplitude in um or a frequency in Hz; samples keep as many."""

# Beyond this a number has no six decimals; another check refuses it.
_MOST = 1e9

MAX_AMPLITUDE_UM = 10_000.0
"""10 mm: more than the thickness of the pad; such a number is no um."""

LONG_WINDOW_MS = (5.0, 250.0)
SHORT_WINDOW_MS = (100.0, 200.0)
SLOW_SINE_HZ = 50.0
"""Sinusoids below this are counted in the long window: 100 ms of them would hold
fewer than five periods. The appendix has 20 Hz on one side, 50 Hz on the other."""

MIN_BAND_HZ = 1.0
"""Least low cutoff and least width of a noise band: less than that cannot be told
from no noise at all in 250 ms."""


@dataclass(frozen=True, slots=True)
class Sine:
    """``A sin(2 pi f t)``: one frequency, zero-to-peak amplitude."""

    frequency_hz: float
    amplitude_um: float
    family: ClassVar[str] = "sine"

    def __post_init__(self) -> None:
        _check_frequency(self, "frequency_hz", self.frequency_hz)
        _check_amplitude(self, "amplitude_um", self.amplitude_um)

    @property
    def id(self) -> str:
        """Name that tells all of the stimulus."""
        return _id(self.family, self.frequency_hz, self.amplitude_um)

    @property
    def window_ms(self) -> tuple[float, float]:
        """Time in which spikes are counted."""
        slow = self.frequency_hz < SLOW_SINE_HZ
        return LONG_WINDOW_MS if slow else SHORT_WINDOW_MS

    @property
    def level_um(self) -> float:
        """How strong it is within its set."""
        return self.amplitude_um

    @property
    def in_appendix(self) -> bool:
        """Whether the paper lists this stimulus."""
        return self.amplitude_um in SINE_AMPLITUDES_UM.get(self.frequency_hz, ())

    def numbers(self) -> dict[str, float]:
        """Every number of the stimulus by its name, in the order of the id."""
        return {"frequency_hz": self.frequency_hz, "amplitude_um": self.amplitude_um}


@dataclass(frozen=True, slots=True)
class Diharmonic:
    """``A1 sin(2 pi f1 t) + A2 sin(2 pi f2 t)``: two sinusoids of phase 0."""

    frequency1_hz: float
    frequency2_hz: float
    amplitude1_um: float
    amplitude2_um: float
    family: ClassVar[str] = "diharm"
    window_ms: ClassVar[tuple[float, float]] = LONG_WINDOW_MS

    def __post_init__(self) -> None:
        _check_frequency(self, "frequency1_hz", self.frequency1_hz)
        _check_frequency(self, "frequency2_hz", self.frequency2_hz)
        _check_amplitude(self, "amplitude1_um", self.amplitude1_um)
        _check_amplitude(self, "amplitude2_um", self.amplitude2_um)

    @property
    def id(self) -> str:
        """Name that tells all of the stimulus."""
        numbers = tuple(self.numbers().values())
        return _id(self.family, *(numbers[:3] if self.in_appendix else numbers))

    @property
    def level_um(self) -> float:
        """How strong it is within its set."""
        return self.amplitude1_um

    @property
    def in_appendix(self) -> bool:
        """Whether the paper lists this stimulus."""
        pair = (self.frequency1_hz, self.frequency2_hz)
        levels = DIHARMONIC_AMPLITUDES_UM.get(pair, ())
        return (self.amplitude1_um, self.amplitude2_um) in levels

    def numbers(self) -> dict[str, float]:
        """Every number of the stimulus by its name, in the order of the id."""
        return {
            "frequency1_hz": self.frequency1_hz,
            "frequency2_hz": self.frequency2_hz,
            "amplitude1_um": self.amplitude1_um,
            "amplitude2_um": self.amplitude2_um,
        }


@dataclass(frozen=True, slots=True)
class Noise:
    """Gaussian noise between two cutoffs, scaled to a root mean square."""

    low_hz: float
    high_hz: float
    rms_um: float
    family: ClassVar[str] = "noise"
    window_ms: ClassVar[tuple[float, float]] = LONG_WINDOW_MS

    def __post_init__(self) -> None:
        _check_frequency(self, "low_hz", self.low_hz)
        _check_frequency(self, "high_hz", self.high_hz)
        _check_amplitude(self, "rms_um", self.rms_um)
        if not self.low_hz < self.high_hz:
            raise StimulusError(
                f"low_hz of a noise must be below its high_hz, "
                f"got {self.low_hz:g} and {self.high_hz:g}"
            )
        if self.low_hz < MIN_BAND_HZ or self.high_hz - self.low_hz < MIN_BAND_HZ:
            raise StimulusError(
                f"the band of a noise must start at {MIN_BAND_HZ:g} Hz or above "
                f"and be {MIN_BAND_HZ:g} Hz wide or more, "
                f"got {self.low_hz:g} to {self.high_hz:g} Hz"
            )

    @property
    def id(self) -> str:
        """Name that tells all of the stimulus but for the seed of its noise."""
        return _id(self.family, self.low_hz, self.high_hz, self.rms_um)

    @property
    def seed(self) -> int:
        """Seed of the noise unless another is asked for: CRC-32 of the id."""
        return zlib.crc32(self.id.encode("ascii"))

    @property
    def level_um(self) -> float:
        """How strong it is within its set."""
        return self.rms_um

    @property
    def in_appendix(self) -> bool:
        """Whether the paper lists this stimulus."""
        levels = NOISE_RMS_UM.get((self.low_hz, self.high_hz), ())
        return self.rms_um in levels

    def numbers(self) -> dict[str, float]:
        """Every number of the stimulus by its name, in the order of the id."""
        return {"low_hz": self.low_hz, "high_hz": self.high_hz, "rms_um": self.rms_um}


Entry: TypeAlias = Sine | Diharmonic | Noise


def number_text(number: float) -> str:
    """Write a number as ids do: no exponent, no trailing zeros."""
    return f"{number:.{DECIMALS}f}".rstrip("0").rstrip(".")


def _id(family: str, *numbers: float) -> str:
    return "_".join([family, *map(number_text, numbers)])


def _check_frequency(entry: Entry, name: str, frequency_hz: float) -> None:
    _check(entry, name, frequency_hz)
    if not frequency_hz < NYQUIST_HZ:
        raise StimulusError(
            f"{name} of a {entry.family} must be below {NYQUIST_HZ:g}, half the "
            f"sampling rate at {DT_MS:g} ms, got {frequency_hz:g}"
        )


def _check_amplitude(entry: Entry, name: str, amplitude_um: float) -> None:
    _check(entry, name, amplitude_um)
    if amplitude_um > MAX_AMPLITUDE_UM:
        raise StimulusError(
            f"{name} of a {entry.family} must be at most {MAX_AMPLITUDE_UM:g}, got {amplitude_um:g}"
        )


def _check(entry: Entry, name: str, number: float) -> None:
    if not (isfinite(number) and number > 0):
        raise StimulusError(f"{name} of a {entry.family} must be > 0 and finite, got {number:g}")
    millionths = min(number, _MOST) * 10**DECIMALS
    if abs(millionths - round(millionths)) > 1e-3:
        raise StimulusError(
            f"{name} of a {entry.family} must have at most {DECIMALS} decimals, got {number!r}"
        )
    object.__setattr__(entry, name, round(float(number), DECIMALS))
