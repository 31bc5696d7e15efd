"""The 82 stimuli of Ishizuka et al., appendices A to C, and their ids.

A selection is an id (``sine_20_250``), the beginning of ids (``sine_20`` selects twelve
stimuli, ``noise_25_250`` five, ``diharm`` twenty) or ``all``. Numbers outside the appendix
are accepted in a complete id: ``sine_40_100``, ``noise_30_200_7``, and for a diharmonic
with both amplitudes, ``diharm_10_50_20_20``. Ramp-and-hold is a family without a catalogue:
``ramp_300_100_200_100`` indents by 300 um in 100 ms, holds for 200 ms and retracts in 100 ms.
Any spelling of a number is accepted: ``sine_20_250.00``.

An id joins the family and the numbers without trailing zeros. It defines the stimulus, except
for noise with another seed. The id of a diharmonic of Appendix B has its first amplitude only,
``diharm_10_100_125``; the id of any other diharmonic has both, ``diharm_10_100_125_125``.

Two sinusoids do not fit the geometric series of their neighbours and are probably misprints.
Ids and waveforms keep the printed numbers, so that stimuli in other tables are still found.
This module does not import NumPy: `decks.synthesis` makes the samples.
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

# Larger numbers are clipped for the check of decimals; another check refuses them.
_LARGEST_CHECKED = 1e9

MAX_AMPLITUDE_UM = 10_000.0
"""10 mm: more than the thickness of the pad; a larger number is not in um."""

MAX_SAMPLES = 200_001
"""100 s: a solver takes a day for as many increments."""

LONG_WINDOW_MS = (5.0, 250.0)
SHORT_WINDOW_MS = (100.0, 200.0)
SLOW_SINE_HZ = 50.0
"""Spikes of slower sinusoids are counted in the long window: 100 ms would contain fewer
than five periods. In the appendix, 20 Hz is below this limit and 50 Hz is not."""

REST_MS = 50.0
"""Rest before a ramp; the rest after it is twice as long."""

MIN_BAND_HZ = 1.0
"""Minimum low cutoff and minimum width of a noise band: in 250 ms, noise below these limits
cannot be distinguished from no noise."""

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
"""Ids with a doubtful printed amplitude, and the amplitude that fits the series."""

MISPRINT_NOTE = "two amplitudes are kept as printed though their series says " + (
    " and ".join(f"{series} ({id_})" for id_, series in MISPRINTS_UM.items())
)
"""The sentence for a user about :data:`MISPRINTS_UM`."""


# ---- An entry: a stimulus before it has samples


@dataclass(frozen=True, slots=True)
class _Entry:
    """Numbers of a stimulus, checked when made; each family is a class.

    `title` is the heading of the family in the catalogue; `description_format` is the format of a
    description of one stimulus, which takes its numbers in order.
    """

    family: ClassVar[str]
    example: ClassVar[str]
    title: ClassVar[str]
    description_format: ClassVar[str]

    def __post_init__(self) -> None:
        for name, number in self.numbers().items():
            expected = ""
            millionths = min(number, _LARGEST_CHECKED) * 10**DECIMALS
            if not (isfinite(number) and number > 0):
                expected = "a finite number > 0"
            elif abs(millionths - round(millionths)) > 1e-3:
                expected = f"at most {DECIMALS} decimals"
            elif name.endswith("_hz") and not number < NYQUIST_HZ:
                rate = f"half the sampling rate at {DT_MS:g} ms"
                expected = f"less than {NYQUIST_HZ:g}, {rate}"
            elif name.endswith("_um") and number > MAX_AMPLITUDE_UM:
                expected = f"at most {MAX_AMPLITUDE_UM:g}"
            elif name.endswith("_ms") and (number % DT_MS or number > MAX_SAMPLES * DT_MS):
                expected = f"a multiple of {DT_MS:g} up to {MAX_SAMPLES * DT_MS:g}"
            if expected:
                raise StimulusError(argument=name, found=number, expected=expected)
            object.__setattr__(self, name, round(float(number), DECIMALS))

    def numbers(self) -> dict[str, float]:
        """Numbers of the stimulus by name, in the order of the id."""
        return {item.name: getattr(self, item.name) for item in fields(self)}

    @property
    def id(self) -> str:
        """Name of the stimulus."""
        return _id(self.family, self.numbers().values())

    @property
    def window_ms(self) -> tuple[float, float]:
        """Start and end of the window in which spikes are counted."""
        return LONG_WINDOW_MS

    @property
    def seed(self) -> int | None:
        """Seed of noise; None for other families."""
        return None

    @property
    def level_um(self) -> float:
        """Level within its set: the first number in um."""
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
    description_format: ClassVar[str] = "{} Hz, {} um"

    @property
    def window_ms(self) -> tuple[float, float]:
        """Start and end of the window in which spikes are counted."""
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
    description_format: ClassVar[str] = "{} Hz + {} Hz, {} um + {} um"

    @property
    def id(self) -> str:
        """Name of the stimulus: with the first amplitude only if it is in the appendix."""
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
    description_format: ClassVar[str] = "{} to {} Hz, {} um RMS"

    def __post_init__(self) -> None:
        _Entry.__post_init__(self)
        if self.low_hz < MIN_BAND_HZ or self.high_hz - self.low_hz < MIN_BAND_HZ:
            is_low = self.low_hz < MIN_BAND_HZ
            least_hz = MIN_BAND_HZ if is_low else self.low_hz + MIN_BAND_HZ
            raise StimulusError(
                argument="low_hz" if is_low else "high_hz",
                found=self.low_hz if is_low else self.high_hz,
                expected=f"{least_hz:g} or more",
            )

    @property
    def seed(self) -> int:
        """Default seed of the noise: CRC-32 of the id."""
        return zlib.crc32(self.id.encode("ascii"))


@dataclass(frozen=True, slots=True)
class Ramp(_Entry):
    """Ramp and hold: indentation at one speed, hold, and retraction at another.

    A rest of `REST_MS` before the ramp lets the filters see the onset; a rest twice as long
    after it includes late spikes.
    """

    depth_um: float
    up_ms: float
    hold_ms: float
    down_ms: float
    family: ClassVar[str] = "ramp"
    example: ClassVar[str] = "ramp_DEPTH_UP_HOLD_DOWN, as in ramp_300_100_200_100 (um and ms)"
    title: ClassVar[str] = "Ramps and holds ({}): depths in um"
    description_format: ClassVar[str] = "{} um deep in {} ms, held for {} ms, back in {} ms"

    def __post_init__(self) -> None:
        _Entry.__post_init__(self)
        if self.window_ms[1] > (MAX_SAMPLES - 1) * DT_MS:
            expected = f"at most {(MAX_SAMPLES - 1) * DT_MS:g} ms"
            raise StimulusError(
                f"a ramp of {self.window_ms[1]:g} ms with its rests, expected {expected}",
                found=self.window_ms[1],
                expected=expected,
            )

    @property
    def corners_ms(self) -> tuple[float, ...]:
        """Times at which indentation starts and ends, and retraction starts and ends."""
        return tuple(accumulate((REST_MS, self.up_ms, self.hold_ms, self.down_ms)))

    @property
    def window_ms(self) -> tuple[float, float]:
        """Start and end of the window in which spikes are counted: the whole stimulus."""
        return 0.0, self.corners_ms[-1] + 2 * REST_MS


Entry: TypeAlias = Sine | Diharmonic | Noise | Ramp
_FAMILIES: dict[str, type[Entry]] = {kind.family: kind for kind in get_args(Entry)}


def number_text(number: float) -> str:
    """Text of a number in an id: no exponent, no trailing zeros."""
    return f"{number:.{DECIMALS}f}".rstrip("0").rstrip(".")


def _id(family: str, numbers: Iterable[float]) -> str:
    return "_".join([family, *map(number_text, numbers)])


# ---- The catalogue

CATALOGUE: tuple[Entry, ...] = (
    *(Sine(f, a) for f, levels in SINE_AMPLITUDES_UM.items() for a in levels),
    *(Diharmonic(*pair, *a) for pair, levels in DIHARMONIC_AMPLITUDES_UM.items() for a in levels),
    *(Noise(*band, a) for band, levels in NOISE_RMS_UM.items() for a in levels),
)
"""Appendices A, B and C in printed order."""

ALL = "all"
WAVEFORMS = (".csv", ".wav", ".npy", ".dat")
"""Suffixes of waveform files; no id ends in one."""


def resolve(selection: str | Iterable[str]) -> tuple[Entry, ...]:
    """Stimuli of `selection`, in that order, without duplicates.

    Parameters
    ----------
    selection
        Ids or names of sets, as a sequence or separated by commas.

    Raises
    ------
    StimulusError
        A selection that is empty or no text, an unknown name (the message lists similar names),
        or a number outside its range.

    Examples
    --------
    >>> import fembridge as fb
    >>> len(fb.resolve("all")), [entry.id for entry in fb.resolve("noise_5_25")][:2]
    (82, ['noise_5_25_0.5', 'noise_5_25_1'])
    """
    texts = [selection] if isinstance(selection, str) else selection
    if not (isinstance(texts, Iterable) and all(isinstance(text, str) for text in texts)):
        raise StimulusError(
            argument="selection", found=selection, expected="an id, or a list of ids"
        )
    names = [name.strip() for text in texts for name in text.split(",")]
    names = [name for name in names if name]
    if not names:
        raise StimulusError(
            "no stimulus named, expected an id or 'all'", found=selection, expected="an id or 'all'"
        )
    return tuple(dict.fromkeys(entry for name in names for entry in _find_entries(name)))


def named(selection: Sequence[str | Path]) -> tuple[Sequence[Path], Sequence[Entry]]:
    """Files and stimuli of `selection`, without duplicates.

    An item is a path if it has the suffix of a waveform file or a folder, or if that file
    exists.
    """
    selected: dict[str | Path, None] = {}
    for item in selection:
        is_file = isinstance(item, Path) or _is_file(item)
        for part in [str(item)] if is_file else str(item).split(","):
            path = Path(part.strip())
            is_path = is_file or path.suffix.lower() in WAVEFORMS or len(path.parts) > 1
            selected[path if is_path or _is_file(path) else part] = None
    files = [item for item in selected if isinstance(item, Path)]
    ids = [item for item in selected if isinstance(item, str)]
    return files, resolve(ids) if any(map(str.strip, ids)) or not files else ()


def set_name(entry: Entry) -> str:
    """Id without the level: the name of the set of all levels at these frequencies."""
    return _id(entry.family, (n for name, n in entry.numbers().items() if name.endswith("_hz")))


def set_title(entry: Entry) -> str:
    """Frequencies or band of a set: ``20 Hz``, ``10 + 50 Hz``, ``5–100 Hz``."""
    between = " + " if isinstance(entry, Diharmonic) else "–"
    numbers = [number_text(n) for name, n in entry.numbers().items() if name.endswith("_hz")]
    return f"{between.join(numbers)} Hz"


def _is_file(name: str | Path) -> bool:
    """Whether a file has this name; a name that is too long is none."""
    with suppress(OSError):
        return Path(name).is_file()
    return False


def _find_entries(name: str) -> tuple[Entry, ...]:
    if len(name) > _LONGEST_NAME:
        _raise_unknown(f"{name[: _LONGEST_NAME - 3]}...")
    if name.lower() == ALL:
        return CATALOGUE
    family, *texts = name.lower().split("_")
    kind = _FAMILIES.get(family)
    if kind is None or not name.isascii():  # float() accepts the digits of every script
        _raise_unknown(name)
    try:
        numbers = tuple(float(text) for text in texts)
    except ValueError:
        _raise_unknown(name)
    count = len(fields(kind))
    if len(numbers) > count:
        raise StimulusError(
            f"{name!r} has too many numbers, expected {kind.example}",
            found=name,
            expected=kind.example,
        )
    if len(numbers) == count:
        try:
            return (kind(*numbers),)
        except StimulusError as error:
            problem = f"{name}: {error}"
            raise StimulusError(problem, found=name, expected=error.expected) from error
    entries = [entry for entry in CATALOGUE if isinstance(entry, kind)]
    if not entries:
        raise StimulusError(
            f"{name!r} lacks numbers, expected {kind.example}", found=name, expected=kind.example
        )
    numbers_of = {entry: tuple(entry.numbers().values()) for entry in entries}
    matches = tuple(entry for entry, row in numbers_of.items() if row[: len(numbers)] == numbers)
    if not matches:  # list the available numbers at the first index that does not match
        index, rows = 0, list(numbers_of.values())
        while any(row[: index + 1] == numbers[: index + 1] for row in rows):
            index += 1
        available = dict.fromkeys(row[index] for row in rows if row[:index] == numbers[:index])
        choices = ", ".join(_id(family, (*numbers[:index], number)) for number in available)
        raise StimulusError(
            f"no stimulus {name!r} in the catalogue, which has {choices}; "
            f"a stimulus outside the catalogue needs all its numbers: {kind.example}",
            found=name,
            expected=choices,
        )
    return matches


def _raise_unknown(name: str) -> NoReturn:
    from difflib import get_close_matches

    names = [ALL, *_FAMILIES, *(entry.id for entry in CATALOGUE), *map(set_name, CATALOGUE)]
    near = get_close_matches(name.lower(), dict.fromkeys(names), n=4)
    near = near or get_close_matches(name.lower().partition("_")[0], _FAMILIES)
    hint = (
        f"did you mean {', '.join(near)}?"
        if near
        else "`fembridge stimuli` lists them; 'sine', 'diharm', 'noise', 'all' are sets"
    )
    raise StimulusError(f"no stimulus {name!r}; {hint}", found=name)
