"""Published recordings of afferents, compared with the models; one small file per set.

Each file begins with a description and its source, in lines with a #. `read_evidence` reads
another table with the same columns as a set. The sets are

``thresholds_freeman_johnson_1982``   afferent, criterion, frequency_hz, amplitude_um
``timing_20hz``                       impulses a cycle and vector strengths, three amplitudes
``timing_20hz_phase``                 spikes in bins of 5 ms of the cycle
``impulses_a_cycle_johansson_1982``   afferent, frequency_hz, amplitude_um, impulses_per_cycle
``distance_johnson_1974``             distance_mm, amplitude_um
``ramp_and_hold``                     afferent, fact, source
``agreement_ouyang_2021``             family, afferent, stimuli, r_squared, rmse_ips: of a model

``touchsim`` has results of TouchSim, another model, for comparison: ``rates.csv`` under the 82
stimuli, and one table per further recorded set; its ``README.md`` describes how they were
computed.
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from decks.stimuli import resolve
from fembridge.errors import UsageError, warn
from fembridge.io.spike_table import RATE_COLUMNS, Rate
from fembridge.io.text_table import read_table
from fembridge.trace import AFFERENTS

if TYPE_CHECKING:
    import pandas

FOLDER = Path(__file__).parent
SETS = tuple(sorted(path.stem for path in FOLDER.glob("*.csv")))
THRESHOLDS = "thresholds_freeman_johnson_1982"
TIMING, PHASES = "timing_20hz", "timing_20hz_phase"
HUMAN, DISTANCE, RAMP = "impulses_a_cycle_johansson_1982", "distance_johnson_1974", "ramp_and_hold"
OUYANG = "agreement_ouyang_2021"
CRITERIA = ("absolute", "one_impulse_a_cycle")
LOWEST_HZ, HIGHEST_HZ = 2.0, 800.0
"""Range of the recorded frequencies of any class."""
TIMING_COLUMNS = (
    "afferent",
    "frequency_hz",
    "amplitude_um",
    "impulses_per_cycle",
    "strength_f",
    "strength_2f",
)
TOUCHSIM_TABLE = FOLDER / "touchsim/rates.csv"
TOUCHSIM_SETS = tuple(
    sorted(path.stem for path in TOUCHSIM_TABLE.parent.glob("*.csv") if path != TOUCHSIM_TABLE)
)
"""Tables of TouchSim for recorded sets other than the 82 stimuli."""
TOUCHSIM_MODELS = {"SA": 4, "RA": 9, "PC": 4}
"""Number of TouchSim models of each class; a rate is their mean."""

_CHOICES = {"afferent": AFFERENTS, "criterion": CRITERIA}
_MINIMA = {"frequency_hz": 2.0, "amplitude_um": 0.01}


@dataclass(frozen=True, slots=True, eq=False)
class Facts:
    """Table of a set, and a text with its description and source."""

    table: "pandas.DataFrame"
    source: str


def read_evidence(source: "Path | str | pandas.DataFrame", like: str) -> Facts:
    """Set of the name `source`, or a file or DataFrame with the columns of the set `like`.

    Raises
    ------
    TableError
        A missing file or column, or an invalid cell, with its line.
    """
    import pandas

    if isinstance(source, pandas.DataFrame):
        path, contents = Path("DataFrame"), source
    else:
        path = FOLDER / f"{source}.csv" if source in SETS else Path(source)
        contents = None
    names = list(published(like).table.columns)

    def unused(line: str) -> None:
        warn(line, path)

    table = read_table(path if contents is None else contents, names, (), unused=unused)
    columns = {
        name: table.choices(name, _CHOICES[name])
        if name in _CHOICES
        else table.numbers(name, _MINIMA.get(name, 0.0))
        for name in names
    }
    facts = pandas.DataFrame(columns)
    if (duplicates := facts.duplicated().to_numpy()).any():
        line = table.lines[int(duplicates.argmax())]
        warn("the same as an earlier row", path, line)
    citation = _citation(path) if contents is None else ""
    return Facts(facts, citation or f"Source: {path.name}.")


@cache
def published(name: str) -> Facts:
    """Set `name`, one of `SETS`; copy its table before changing it.

    Raises
    ------
    UsageError
        Unknown set.
    """
    import pandas

    if name not in SETS:
        raise UsageError(argument="name", found=name, expected=f"one of {', '.join(SETS)}")
    path = FOLDER / f"{name}.csv"
    return Facts(pandas.read_csv(path, comment="#", encoding="utf-8"), _citation(path))


def published_timing() -> "pandas.DataFrame":
    """Set ``timing_20hz`` with column names for any frequency.

    ``afferent, frequency_hz, amplitude_um, impulses_per_cycle, strength_f, strength_2f``.
    """
    table = published(TIMING).table.assign(frequency_hz=20.0)
    names = {"vector_strength_20hz": "strength_f", "vector_strength_40hz": "strength_2f"}
    return table.rename(columns=names)[list(TIMING_COLUMNS)]


def touchsim_rates(preindent_um: float = 0.0, *, whole_second: bool = False) -> list[Rate]:
    """TouchSim's rates under all 82 stimuli, in the order of the catalogue.

    Parameters
    ----------
    preindent_um
        Depth of the probe before the vibration in um, 0 (default) or 500.
    whole_second
        Count spikes in one second (default: in a window as long as the observed one, 245
        or 100 ms).

    Raises
    ------
    UsageError
        No rates for this depth.

    Examples
    --------
    >>> import fembridge as fb
    >>> len(fb.touchsim_rates())
    246
    """
    import pandas

    table = pandas.read_csv(TOUCHSIM_TABLE)
    if preindent_um not in set(table.preindent_um):
        raise UsageError(argument="preindent_um", found=preindent_um, expected="0 or 500")
    observed_ms = {name: np.ptp(resolve(name)[0].window_ms) for name in table.stimulus.unique()}
    window_ms = 1000.0 if whole_second else table.stimulus.map(observed_ms)
    table = table[(table.preindent_um == preindent_um) & (table.window_ms == window_ms)]
    columns = (table[name] for name in RATE_COLUMNS)
    return [Rate(*row) for row in zip(*columns, strict=True)]


@cache
def touchsim_table(name: str) -> "pandas.DataFrame":
    """TouchSim's table `name`, one of `TOUCHSIM_SETS`; copy it before changing it.

    Raises
    ------
    UsageError
        Unknown table.
    """
    import pandas

    if name not in TOUCHSIM_SETS:
        expected = f"one of {', '.join(TOUCHSIM_SETS)}"
        raise UsageError(argument="name", found=name, expected=expected)
    return pandas.read_csv(TOUCHSIM_TABLE.parent / f"{name}.csv")


def _citation(path: Path) -> str:
    lines = path.read_text(encoding="utf-8").splitlines()
    return " ".join(line[1:].strip() for line in lines if line.startswith("#"))
