"""The 82 stimuli as the paper's figures show them: families, and a panel a set.

A set is all levels at the same frequencies (``sine_20``, ``noise_25_250``). Its level
is the amplitude of a sinusoid, that of a diharmonic's first component, or the root
mean square of a noise.
"""

from dataclasses import dataclass
from itertools import groupby

from decks.stimuli import CATALOGUE, Diharmonic, Entry, Noise, Sine, number_text, set_name


@dataclass(frozen=True, slots=True)
class StimulusSet:
    """All levels at the same frequencies, the weakest first."""

    name: str
    title: str
    entries: tuple[Entry, ...]

    @property
    def stimuli(self) -> tuple[str, ...]:
        """Ids of its stimuli."""
        return tuple(entry.id for entry in self.entries)

    @property
    def level_um(self) -> tuple[float, ...]:
        """Level of each of its stimuli."""
        return tuple(entry.level_um for entry in self.entries)


@dataclass(frozen=True, slots=True)
class Family:
    """Sets of one kind of stimulus, and the words that name them on a page."""

    name: str
    title: str
    level_title: str
    figure: str
    table: str
    sets: tuple[StimulusSet, ...]

    @property
    def stimuli(self) -> tuple[str, ...]:
        """Ids of all its stimuli, set after set."""
        return tuple(id_ for one in self.sets for id_ in one.stimuli)


def _title(entry: Entry) -> str:
    numbers = [number_text(number) for number in entry.numbers().values()]
    match entry:
        case Sine():
            return f"{numbers[0]} Hz"
        case Diharmonic():
            return f"{numbers[0]} + {numbers[1]} Hz"
        case Noise():
            return f"{numbers[0]}–{numbers[1]} Hz"


def _family(name: str, title: str, level_title: str, figure: str, table: str) -> Family:
    mine = [entry for entry in CATALOGUE if entry.family == name]
    sets = []
    for set_, members in groupby(mine, key=set_name):
        entries = tuple(members)
        sets.append(StimulusSet(set_, _title(entries[0]), entries))
    return Family(name, title, level_title, figure, table, tuple(sets))


FAMILIES = (
    _family("sine", "Sinusoids", "Amplitude (µm)", "Fig. 3b", "Fig. 3c"),
    _family("diharm", "Diharmonics", "Amplitude of component 1 (µm)", "Fig. 4a–c", "Fig. 4d"),
    _family("noise", "Band-pass noises", "RMS amplitude (µm)", "Fig. 5a–c", "Fig. 5d"),
)
SINES = FAMILIES[0]


def family_of(name: str) -> Family:
    """Give the family called `name`."""
    [family] = [family for family in FAMILIES if family.name == name]
    return family
