"""The 82 stimuli of Ishizuka et al., appendices A to C, and the words that name them.

A word is an id (``sine_20_250``), the beginning of ids (``sine_20`` is twelve
stimuli, ``noise_25_250`` five, ``diharm`` twenty) or ``all``. A number that the
appendix does not have is welcome where the id is complete: ``sine_40_100``,
``noise_30_200_7``, and for a diharmonic both amplitudes, ``diharm_10_50_20_20``.
Ramp-and-hold is a family without a catalogue: ``ramp_300_100_200_100`` goes 300 um deep
in 100 ms, stays for 200 ms and comes back in 100 ms.
Numbers may be spelled in any way: ``sine_20_250.00``.

Ids join the family and the numbers without trailing zeros, and say all of a stimulus but
the seed of other noise. A diharmonic of Appendix B is named by its first amplitude,
``diharm_10_100_125``; any other one by both, ``diharm_10_100_125_125``.

Two of the sinusoids do not fit the geometric series that their neighbours make and are
taken for misprints. The printed numbers are kept, in the ids and in the waveforms, so
that tables made elsewhere still find their stimulus. No NumPy here: samples are made by
`decks.waveform`.
"""

import zlib
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from itertools import accumulate
from math import isfinite
from pathlib import Path
from typing import ClassVar, NoReturn, TypeAlias, get_args

from fembridge.errors import StimulusError

DT_MS = 0.5  # the time increment of the paper, section 2
DURATION_MS = 250.0  # section 3.2
NYQUIST_HZ = 500.0 / DT_MS

DECIMALS = 6
"""Decimals of an amplitude in um or a frequency in Hz; samples keep as many."""

# More than any id, and short enough for a message.
_LONGEST_NAME = 100

# Beyond this a number has no six decimals; another check refuses it.
_MOST = 1e9

MAX_AMPLITUDE_UM = 10_000.0
"""10 mm: more than the thickness of the pad; such a number is no um."""

MAX_SAMPLES = 200_001
"""100 s: a solver takes a day for as many increments."""

LONG_WINDOW_MS = (5.0, 250.0)
SHORT_WINDOW_MS = (100.0, 200.0)
SLOW_SINE_HZ = 50.0
"""Sinusoids below this are counted in the long window: 100 ms of them would hold
fewer than five periods. The appendix has 20 Hz on one side, 50 Hz on the other."""

REST_MS = 50.0
"""Before a ramp the probe stands for so long, behind it for twice as long."""

MIN_BAND_HZ = 1.0
"""Least low cutoff and least width of a noise band: less than that cannot be distinguished
from no noise at all in 250 ms."""

SINE_AMPLITUDES_UM: dict[float, tuple[float, ...]] = {
    20: (6.71, 9.32, 12.5, 18, 25, 34.74, 48.27, 67.07, 93.19, 129.49, 179.92, 250),
    50: (7.19, 10.66, 15.81, 23.46, 34.8, 51.62, 76.58, 113.6, 168.52, 250),
    100: (6.52, 10, 15.34, 23.54, 36.11, 55.39, 85.98, 130.37, 200),
    300: (4.59, 7.41, 11.94, 19.24, 31.02, 50),
}
"""Appendix A: amplitudes at each frequency."""

DIHARMONIC_AMPLITUDES_UM: dict[tuple[float, float], tuple[tuple[float, float], ...]] = {
    (10, 50): ((2, 2), (5.62, 5.62), (15.81, 15.81), (44.46, 44.46), (125, 125)),
    (10, 100): ((2, 2), (5.62, 5.32), (15.81, 14.14), (44.46, 37.61), (125, 100)),
    (50, 250): ((2, 1), (5.62, 2.48), (15.81, 6.12), (44.46, 15.15), (125, 37.5)),
    (50, 500): ((2, 0.25), (5.62, 0.74), (15.81, 2.17), (44.46, 6.37), (125, 18.75)),
}
"""Appendix B: amplitudes of both components at each pair of frequencies."""

NOISE_RMS_UM: dict[tuple[float, float], tuple[float, ...]] = {
    (5, 25): (0.5, 1, 5, 10, 50),
    (5, 100): (0.5, 1, 5, 10, 50),
    (25, 250): (0.25, 1, 5, 10, 20),
    (25, 500): (0.25, 1, 5, 10, 20),
    (50, 500): (0.13, 0.5, 1, 5, 10),
}
"""Appendix C: root-mean-square levels in each band, low and high cutoff."""

MISPRINTS_UM = {"sine_20_12.5": 12.95, "sine_100_85.98": 84.98}
"""Ids whose printed amplitude is doubtful, with the one that fits the series."""

MISPRINT_NOTE = "two amplitudes are kept as printed though their series says " + (
    " and ".join(f"{series} ({id_})" for id_, series in MISPRINTS_UM.items())
)
"""The sentence for a user about :data:`MISPRINTS_UM`."""


# ---- An entry: a stimulus before it has samples


@dataclass(frozen=True, slots=True)
class _Entry:
    """Numbers of a stimulus, checked when made; a class is a family.

    `title` heads its block of the catalogue, `words` is a stimulus in words, its numbers
    in their order.
    """

    family: ClassVar[str]
    example: ClassVar[str]
    title: ClassVar[str]
    words: ClassVar[str]

    def __post_init__(self) -> None:
        for name, number in self.numbers().items():
            what = f"{name} of a {self.family}"
            if not (isfinite(number) and number > 0):
                raise StimulusError(f"{what} must be > 0 and finite, got {number:g}")
            millionths = min(number, _MOST) * 10**DECIMALS
            if abs(millionths - round(millionths)) > 1e-3:
                raise StimulusError(f"{what} must have at most {DECIMALS} decimals, got {number!r}")
            if name.endswith("_hz") and not number < NYQUIST_HZ:
                raise StimulusError(
                    f"{what} must be below {NYQUIST_HZ:g}, half the "
                    f"sampling rate at {DT_MS:g} ms, got {number:g}"
                )
            if name.endswith("_um") and number > MAX_AMPLITUDE_UM:
                raise StimulusError(f"{what} must be at most {MAX_AMPLITUDE_UM:g}, got {number:g}")
            if name.endswith("_ms") and (number % DT_MS or number > MAX_SAMPLES * DT_MS):
                raise StimulusError(
                    f"{what} must be a multiple of {DT_MS:g} up to {MAX_SAMPLES * DT_MS:g}, "
                    f"got {number:g}"
                )
            object.__setattr__(self, name, round(float(number), DECIMALS))

    def numbers(self) -> dict[str, float]:
        """Every number of the stimulus by its name, in the order of the id."""
        return {one.name: getattr(self, one.name) for one in fields(self)}

    @property
    def id(self) -> str:
        """Name of the stimulus."""
        return _id(self.family, self.numbers().values())

    @property
    def window_ms(self) -> tuple[float, float]:
        """Time in which spikes are counted."""
        return LONG_WINDOW_MS

    @property
    def seed(self) -> int | None:
        """Seed of a stimulus that is drawn; None of one that is not."""
        return None

    @property
    def level_um(self) -> float:
        """How strong it is within its set: its first number in um."""
        return next(n for name, n in self.numbers().items() if name.endswith("_um"))

    @property
    def in_appendix(self) -> bool:
        """Whether the paper lists this stimulus."""
        return self in CATALOGUE


@dataclass(frozen=True, slots=True)
class Sine(_Entry):
    """``A sin(2 pi f t)``: one frequency, zero-to-peak amplitude."""

    frequency_hz: float
    amplitude_um: float
    family: ClassVar[str] = "sine"
    example: ClassVar[str] = "sine_FREQUENCY_AMPLITUDE, as in sine_40_100"
    title: ClassVar[str] = "Sinusoids ({}): zero-to-peak amplitudes in um"
    words: ClassVar[str] = "{} Hz, {} um"

    @property
    def window_ms(self) -> tuple[float, float]:
        """Time in which spikes are counted."""
        return LONG_WINDOW_MS if self.frequency_hz < SLOW_SINE_HZ else SHORT_WINDOW_MS


@dataclass(frozen=True, slots=True)
class Diharmonic(_Entry):
    """``A1 sin(2 pi f1 t) + A2 sin(2 pi f2 t)``: two sinusoids of phase 0."""

    frequency1_hz: float
    frequency2_hz: float
    amplitude1_um: float
    amplitude2_um: float
    family: ClassVar[str] = "diharm"
    example: ClassVar[str] = "diharm_F1_F2_A1_A2, as in diharm_10_50_20_20"
    title: ClassVar[str] = (
        "Diharmonics ({}): zero-to-peak amplitudes, component 1 + component 2 in um"
    )
    words: ClassVar[str] = "{} Hz + {} Hz, {} um + {} um"

    @property
    def id(self) -> str:
        """Name of the stimulus: by its first amplitude where the appendix has it."""
        numbers = tuple(self.numbers().values())
        return _id(self.family, numbers[:3] if self.in_appendix else numbers)


@dataclass(frozen=True, slots=True)
class Noise(_Entry):
    """Gaussian noise between two cutoffs, scaled to a root mean square."""

    low_hz: float
    high_hz: float
    rms_um: float
    family: ClassVar[str] = "noise"
    example: ClassVar[str] = "noise_LOW_HIGH_RMS, as in noise_30_200_7"
    title: ClassVar[str] = "Band-pass noises ({}): root-mean-square levels in um"
    words: ClassVar[str] = "{} to {} Hz, {} um RMS"

    def __post_init__(self) -> None:
        _Entry.__post_init__(self)
        if self.low_hz < MIN_BAND_HZ or self.high_hz - self.low_hz < MIN_BAND_HZ:
            raise StimulusError(
                f"the band of a noise must begin at {MIN_BAND_HZ:g} Hz or above and end at least "
                f"{MIN_BAND_HZ:g} Hz higher, got {self.low_hz:g} to {self.high_hz:g} Hz"
            )

    @property
    def seed(self) -> int:
        """Seed of the noise unless another is asked for: CRC-32 of the id."""
        return zlib.crc32(self.id.encode("ascii"))


@dataclass(frozen=True, slots=True)
class Ramp(_Entry):
    """Ramp and hold: into the skin at one speed, held, and back at another.

    Before it are `REST_MS` of rest and behind it twice as much: the filters see the
    onset, and what fires late is in the samples.
    """

    depth_um: float
    up_ms: float
    hold_ms: float
    down_ms: float
    family: ClassVar[str] = "ramp"
    example: ClassVar[str] = "ramp_DEPTH_UP_HOLD_DOWN, as in ramp_300_100_200_100 (um and ms)"
    title: ClassVar[str] = "Ramps and holds ({}): depths in um"
    words: ClassVar[str] = "{} um deep in {} ms, held for {} ms, back in {} ms"

    def __post_init__(self) -> None:
        _Entry.__post_init__(self)
        if self.window_ms[1] > (MAX_SAMPLES - 1) * DT_MS:
            raise StimulusError(
                f"a ramp must end within {(MAX_SAMPLES - 1) * DT_MS:g} ms with its rests, "
                f"got {self.window_ms[1]:g} ms"
            )

    @property
    def corners_ms(self) -> tuple[float, ...]:
        """When the probe starts, stops, starts back and is back."""
        return tuple(accumulate((REST_MS, self.up_ms, self.hold_ms, self.down_ms)))

    @property
    def window_ms(self) -> tuple[float, float]:
        """Time in which spikes are counted: all of it."""
        return 0.0, self.corners_ms[-1] + 2 * REST_MS


Entry: TypeAlias = Sine | Diharmonic | Noise | Ramp
_FAMILIES: dict[str, type[Entry]] = {kind.family: kind for kind in get_args(Entry)}


def number_text(number: float) -> str:
    """A number as ids have it: no exponent, no trailing zeros."""
    return f"{number:.{DECIMALS}f}".rstrip("0").rstrip(".")


def _id(family: str, numbers: Iterable[float]) -> str:
    return "_".join([family, *map(number_text, numbers)])


# ---- The catalogue

CATALOGUE: tuple[Entry, ...] = (
    *(Sine(f, a) for f, levels in SINE_AMPLITUDES_UM.items() for a in levels),
    *(Diharmonic(*pair, *a) for pair, levels in DIHARMONIC_AMPLITUDES_UM.items() for a in levels),
    *(Noise(*band, a) for band, levels in NOISE_RMS_UM.items() for a in levels),
)
"""Appendices A, B and C in the order they are printed."""

EVERY = "all"
WAVEFORMS = (".csv", ".wav", ".npy", ".dat")
"""Suffixes of files that hold a waveform; no id ends in one."""


def resolve(words: str | Iterable[str]) -> tuple[Entry, ...]:
    """Stimuli that `words` name, in that order, each once.

    Parameters
    ----------
    words
        Ids or names of sets, one by one or with commas between them.

    Raises
    ------
    StimulusError
        A word that names nothing (the error has the near ones), a number that
        no probe can do, or no word at all.
    """
    spoken = [words] if isinstance(words, str) else words
    names = [name.strip() for word in spoken for name in word.split(",")]
    names = [name for name in names if name]
    if not names:
        raise StimulusError("no stimulus named; expected an id, or 'all'")
    return tuple(dict.fromkeys(entry for name in names for entry in _named(name)))


def named(words: Sequence[str | Path]) -> tuple[Sequence[Path], Sequence[Entry]]:
    """Files and stimuli of the catalogue that `words` name, each once.

    A word is a path if it has the suffix of a waveform, a folder, or is there: no id is.
    """
    found: dict[str | Path, None] = {}
    for word in words:
        whole = isinstance(word, Path) or _is_file(word)
        for part in [str(word)] if whole else str(word).split(","):
            path = Path(part.strip())
            is_path = whole or path.suffix.lower() in WAVEFORMS or len(path.parts) > 1
            found[path if is_path or _is_file(path) else part] = None
    files = [one for one in found if isinstance(one, Path)]
    ids = [one for one in found if isinstance(one, str)]
    return files, resolve(ids) if any(map(str.strip, ids)) or not files else ()


def set_name(entry: Entry) -> str:
    """Id without its level: the name of all levels at these frequencies."""
    return _id(entry.family, (n for name, n in entry.numbers().items() if name.endswith("_hz")))


def set_title(entry: Entry) -> str:
    """Frequencies or band of a set: ``20 Hz``, ``10 + 50 Hz``, ``5–100 Hz``."""
    between = " + " if isinstance(entry, Diharmonic) else "–"
    numbers = [number_text(n) for name, n in entry.numbers().items() if name.endswith("_hz")]
    return f"{between.join(numbers)} Hz"


def _is_file(word: str | Path) -> bool:
    """Whether a file has this name; a name that is too long is none."""
    with suppress(OSError):
        return Path(word).is_file()
    return False


def _named(name: str) -> tuple[Entry, ...]:
    if len(name) > _LONGEST_NAME:
        _refuse(f"{name[: _LONGEST_NAME - 3]}...")
    if name.lower() == EVERY:
        return CATALOGUE
    family, *texts = name.lower().split("_")
    kind = _FAMILIES.get(family)
    if kind is None or not name.isascii():  # float() reads the digits of every script
        _refuse(name)
    try:
        numbers = tuple(float(text) for text in texts)
    except ValueError:
        _refuse(name)
    most = len(fields(kind))
    if len(numbers) > most:
        raise StimulusError(f"{name!r} has too many numbers; expected {kind.example}")
    if len(numbers) == most:
        try:
            return (kind(*numbers),)
        except StimulusError as error:
            raise StimulusError(f"{name}: {error}") from error
    mine = [entry for entry in CATALOGUE if isinstance(entry, kind)]
    if not mine:
        raise StimulusError(f"{name!r} needs all its numbers: {kind.example}")
    known = {entry: tuple(entry.numbers().values()) for entry in mine}
    level = tuple(entry for entry, row in known.items() if row[: len(numbers)] == numbers)
    if not level:  # name the numbers that there are at the place where this one is not
        place, rows = 0, list(known.values())
        while any(row[: place + 1] == numbers[: place + 1] for row in rows):
            place += 1
        there = dict.fromkeys(row[place] for row in rows if row[:place] == numbers[:place])
        choices = ", ".join(_id(family, (*numbers[:place], number)) for number in there)
        raise StimulusError(
            f"no stimulus {name!r} in the catalogue, which has {choices}; "
            f"one of your own needs all its numbers: {kind.example}"
        )
    return level


def _refuse(name: str) -> NoReturn:
    from difflib import get_close_matches

    names = [EVERY, *_FAMILIES, *(entry.id for entry in CATALOGUE), *map(set_name, CATALOGUE)]
    near = get_close_matches(name.lower(), dict.fromkeys(names), n=4)
    near = near or get_close_matches(name.lower().partition("_")[0], _FAMILIES)
    hint = (
        f"did you mean {', '.join(near)}?"
        if near
        else "`fembridge stimuli` lists them; 'sine', 'diharm', 'noise', 'all' are sets"
    )
    raise StimulusError(f"no stimulus {name!r}; {hint}")
