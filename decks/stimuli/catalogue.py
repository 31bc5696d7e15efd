"""The 82 stimuli of the paper, and the words that name them.

A word is an id (``sine_20_250``), the beginning of ids (``sine_20`` is twelve
stimuli, ``noise_25_250`` five, ``diharm`` twenty) or ``all``. A number that the
appendix does not have is welcome where the id tells all: ``sine_40_100``,
``noise_30_200_7``, and for a diharmonic both amplitudes,
``diharm_10_50_20_20``. Numbers may be spelled in any way: ``sine_20_250.00``.

Two of the ids keep an amplitude that is probably a misprint: ``sine_20_12.5``
and ``sine_100_85.98``, see :mod:`decks.stimuli.appendix`.
"""

from collections.abc import Callable, Iterable
from typing import NoReturn

from decks.stimuli.appendix import DIHARMONIC_AMPLITUDES_UM, NOISE_RMS_UM, SINE_AMPLITUDES_UM
from decks.stimuli.entry import Diharmonic, Entry, Noise, Sine, number_text
from fembridge.errors import StimulusError

CATALOGUE: tuple[Entry, ...] = (
    *(Sine(f, a) for f, levels in SINE_AMPLITUDES_UM.items() for a in levels),
    *(
        Diharmonic(f1, f2, a1, a2)
        for (f1, f2), levels in DIHARMONIC_AMPLITUDES_UM.items()
        for a1, a2 in levels
    ),
    *(Noise(low, high, a) for (low, high), levels in NOISE_RMS_UM.items() for a in levels),
)
"""Appendices A, B and C in the order they are printed."""

EVERY = "all"

_COMPLETE = {
    "sine": "sine_FREQUENCY_AMPLITUDE, as in sine_40_100",
    "diharm": "diharm_F1_F2_A1_A2, as in diharm_10_50_20_20",
    "noise": "noise_LOW_HIGH_RMS, as in noise_30_200_7",
}
_MOST_NUMBERS = {"sine": 2, "diharm": 4, "noise": 3}
_FAMILIES: dict[str, Callable[..., Entry]] = {"sine": Sine, "diharm": Diharmonic, "noise": Noise}


def resolve(words: str | Iterable[str]) -> tuple[Entry, ...]:
    """Stimuli that `words` name, in that order, each once.

    Parameters
    ----------
    words
        Ids or names of sets, one by one or with commas between them.

    Raises
    ------
    StimulusError
        A word that names nothing (the error tells the near ones), a number that
        no probe can do, or no word at all.
    """
    spoken = [words] if isinstance(words, str) else words
    names = [name.strip() for word in spoken for name in word.split(",")]
    names = [name for name in names if name]
    if not names:
        raise StimulusError("no stimulus named; expected an id, or 'all'")
    return tuple(dict.fromkeys(entry for name in names for entry in _named(name)))


def _named(name: str) -> tuple[Entry, ...]:
    if name.lower() == EVERY:
        return CATALOGUE
    family, *texts = name.lower().split("_")
    if family not in _COMPLETE:
        _refuse(name)
    try:
        numbers = tuple(float(text) for text in texts)
    except ValueError:
        _refuse(name)
    if len(numbers) > _MOST_NUMBERS[family]:
        raise StimulusError(f"{name!r} has too many numbers; expected {_COMPLETE[family]}")
    if len(numbers) == _MOST_NUMBERS[family]:
        try:
            return (_FAMILIES[family](*numbers),)
        except StimulusError as error:
            raise StimulusError(f"{name}: {error}") from error
    level = tuple(
        entry
        for entry in CATALOGUE
        if entry.family == family and tuple(entry.numbers().values())[: len(numbers)] == numbers
    )
    if not level:
        _refuse_incomplete(name, family, numbers)
    return level


def _refuse_incomplete(name: str, family: str, numbers: tuple[float, ...]) -> NoReturn:
    """Tell which numbers the appendix has at the place where it has not this one."""
    known = [tuple(entry.numbers().values()) for entry in CATALOGUE if entry.family == family]
    place = 0
    while any(row[: place + 1] == numbers[: place + 1] for row in known):
        place += 1
    there = dict.fromkeys(row[place] for row in known if row[:place] == numbers[:place])
    stem = "_".join([family, *map(number_text, numbers[:place])])
    choices = ", ".join(f"{stem}_{number_text(number)}" for number in there)
    raise StimulusError(
        f"no stimulus {name!r} in the catalogue, which has {choices}; "
        f"one of your own needs all its numbers: {_COMPLETE[family]}"
    )


def _refuse(name: str) -> NoReturn:
    from difflib import get_close_matches

    names = [EVERY, *_COMPLETE, *(entry.id for entry in CATALOGUE)]
    near = get_close_matches(name.lower(), dict.fromkeys([*names, *_sets()]), n=4)
    hint = (
        f"did you mean {', '.join(near)}?"
        if near
        else "`fembridge stimuli` lists them; 'sine', 'diharm', 'noise', 'all' are sets"
    )
    raise StimulusError(f"no stimulus {name!r}; {hint}")


def _sets() -> list[str]:
    """Names of the sets that hold all levels of one frequency, pair or band."""
    return list(dict.fromkeys(set_name(entry) for entry in CATALOGUE))


def set_name(entry: Entry) -> str:
    """Id without its level: the name of all levels at these frequencies."""
    numbers = tuple(entry.numbers().values())
    kept = numbers[:1] if isinstance(entry, Sine) else numbers[:2]
    return "_".join([entry.family, *map(number_text, kept)])
