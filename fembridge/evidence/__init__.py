"""Published facts about real afferents, a small file each: what a model is held against.

Each file begins with what it holds and its source, in lines with a #. A user's own table
stands in the place of a set with `read_evidence`. The sets are

``thresholds_freeman_johnson_1982``   afferent, criterion, frequency_hz, amplitude_um
``timing_20hz``                       impulses a cycle and vector strengths, three amplitudes
``timing_20hz_phase``                 spikes in bins of 5 ms of the cycle
``impulses_a_cycle_johansson_1982``   afferent, frequency_hz, amplitude_um, impulses_per_cycle
``distance_johnson_1974``             distance_mm, amplitude_um
``ramp_and_hold``                     afferent, fact, source
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from fembridge.errors import UsageError
from fembridge.tables import AFFERENTS, read_table

if TYPE_CHECKING:
    import pandas

FOLDER = Path(__file__).parent
SETS = tuple(sorted(path.stem for path in FOLDER.glob("*.csv")))
THRESHOLDS = "thresholds_freeman_johnson_1982"
TIMING, PHASES = "timing_20hz", "timing_20hz_phase"
MAN, DISTANCE, RAMP = "impulses_a_cycle_johansson_1982", "distance_johnson_1974", "ramp_and_hold"
CRITERIA = ("absolute", "one_impulse_a_cycle")
TIMING_COLUMNS = (
    "afferent",
    "frequency_hz",
    "amplitude_um",
    "impulses_per_cycle",
    "strength_f",
    "strength_2f",
)
_CHOICES = {"afferent": AFFERENTS, "criterion": CRITERIA}
_LEAST = {"frequency_hz": 2.0, "amplitude_um": 0.01}


@dataclass(frozen=True, slots=True, eq=False)
class Facts:
    """A table, and in words what it holds and where it is from."""

    table: "pandas.DataFrame"
    source: str


def read_evidence(source: Path | str, like: str) -> Facts:
    """The set of that name, or a file in the place of the set `like`: the same columns.

    Raises
    ------
    TableError
        No such file or column, or a cell that cannot be, with its line.
    """
    import pandas

    path = FOLDER / f"{source}.csv" if source in SETS else Path(source)
    names = list(evidence(like).columns)
    table = read_table(path, names)
    columns = {
        name: table.choices(name, _CHOICES[name])
        if name in _CHOICES
        else table.numbers(name, _LEAST.get(name, 0.0))
        for name in names
    }
    return Facts(pandas.DataFrame(columns), _citation(path) or f"Source: {path.name}.")


@cache
def evidence(name: str) -> "pandas.DataFrame":
    """Table of the set `name`, one of `SETS`; copy it before you change it.

    Raises
    ------
    UsageError
        No such set.
    """
    import pandas

    return pandas.read_csv(_path(name), comment="#", encoding="utf-8")


def published_timing() -> "pandas.DataFrame":
    """Set ``timing_20hz`` with columns that hold at any frequency.

    ``afferent, frequency_hz, amplitude_um, impulses_per_cycle, strength_f, strength_2f``.
    """
    table = evidence(TIMING).assign(frequency_hz=20.0)
    names = {"vector_strength_20hz": "strength_f", "vector_strength_40hz": "strength_2f"}
    return table.rename(columns=names)[list(TIMING_COLUMNS)]


def citation(name: str) -> str:
    """What the set `name` holds, and its source."""
    return _citation(_path(name))


def _citation(path: Path) -> str:
    lines = path.read_text(encoding="utf-8").splitlines()
    return " ".join(line[1:].strip() for line in lines if line.startswith("#"))


def _path(name: str) -> Path:
    if name not in SETS:
        raise UsageError(f"no evidence {name!r}, expected one of {', '.join(SETS)}")
    return FOLDER / f"{name}.csv"
