"""Published facts about real afferents, a small file each: what a model is held against.

Each file begins with what it holds and its source. The sets are

``thresholds_freeman_johnson_1982``   afferent, criterion, frequency_hz, amplitude_um
``timing_20hz``                       impulses a cycle and vector strengths, three amplitudes
``timing_20hz_phase``                 spikes in bins of 5 ms of the cycle
``impulses_a_cycle_johansson_1982``   afferent, frequency_hz, amplitude_um, impulses_per_cycle
``distance_johnson_1974``             distance_mm, amplitude_um
``ramp_and_hold``                     afferent, fact, source
"""

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from fembridge.errors import UsageError

if TYPE_CHECKING:
    import pandas

FOLDER = Path(__file__).parent
SETS = tuple(sorted(path.stem for path in FOLDER.glob("*.csv")))
THRESHOLDS = "thresholds_freeman_johnson_1982"
TIMING_COLUMNS = (
    "afferent",
    "frequency_hz",
    "amplitude_um",
    "impulses_per_cycle",
    "strength_f",
    "strength_2f",
)


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
    table = evidence("timing_20hz").assign(frequency_hz=20.0)
    names = {"vector_strength_20hz": "strength_f", "vector_strength_40hz": "strength_2f"}
    return table.rename(columns=names)[list(TIMING_COLUMNS)]


def citation(name: str) -> str:
    """What the set `name` holds, and its source."""
    lines = _path(name).read_text(encoding="utf-8").splitlines()
    return " ".join(line[1:].strip() for line in lines if line.startswith("#"))


def _path(name: str) -> Path:
    if name not in SETS:
        raise UsageError(f"no evidence {name!r}, expected one of {', '.join(SETS)}")
    return FOLDER / f"{name}.csv"
