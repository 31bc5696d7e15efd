"""Observed firing rates: what a model is fitted to and measured against.

A user's own table, three columns ``stimulus,afferent,rate_ips`` and one row for each
stimulus and class of afferent. ``stimulus`` is an id of the catalogue, or a complete
one of the user's own (``sine_600_10``). Rates are impulses a second in the window of
the stimulus. Such tables come out of spreadsheets and figure digitisers: nothing is
guessed, each check answers a way in which they go wrong, and the error names the line.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from decks.stimuli import resolve
from fembridge.errors import StimulusError, TableError, UsageError
from fembridge.store import sha256_of
from fembridge.tables import AFFERENTS, RATE_COLUMNS, Rate, TextTable, read_table
from fembridge.typing import FloatArray

if TYPE_CHECKING:
    import pandas as pd

FAMILIES = ("sine", "diharm", "noise")

MAX_RATE_IPS = 2000.0
"""One impulse each 0.5 ms, the shortest refractory period of Table 2's afferents."""

LEAST_TOP_RATE_IPS = 0.5
"""A class with nothing above this is taken to be in impulses a ms, where it would be
500 ips: more than the paper's stimuli drive out of any afferent."""

_RATE_WORDS = re.compile(r"rate|freq|spike|impulse|ips|hz|sps")
_NOT_MEASURED = ("", "nan", "na", "n/a", "#n/a", "null", "none", "nil", "-", "--", "?")
_NAMES_ELSEWHERE = {
    "SA1": "SA",
    "MERKEL": "SA",
    "RA1": "RA",
    "FA": "RA",
    "FA1": "RA",
    "QA": "RA",
    "MEISSNER": "RA",
    "RA2": "PC",
    "FA2": "PC",
    "PACINI": "PC",
    "PACINIAN": "PC",
}
"""Classes of afferents as other papers name them, without blanks and signs."""


@dataclass(frozen=True, slots=True, eq=False)
class ObservedRates:
    """Rates `rate_ips` ``(stimulus, afferent)``, NaN where none was observed.

    `stimuli` are ids as the catalogue spells them, `afferents` names of classes.
    `sha256` is that of the file `path` the rates came from.
    """

    stimuli: tuple[str, ...]
    afferents: tuple[str, ...]
    rate_ips: FloatArray
    path: Path
    sha256: str

    def __post_init__(self) -> None:
        rate_ips = np.array(self.rate_ips, dtype=np.float64)
        rate_ips.flags.writeable = False
        object.__setattr__(self, "rate_ips", rate_ips)

    @property
    def families(self) -> tuple[str, ...]:
        """Families that have a stimulus here, in the catalogue's order."""
        there = {_family_of(stimulus) for stimulus in self.stimuli}
        return tuple(family for family in FAMILIES if family in there)

    def of(self, afferent: str) -> tuple[tuple[str, ...], FloatArray]:
        """Stimuli with an observed rate of `afferent`, and the rates ``(S,)`` in ips.

        Raises
        ------
        UsageError
            There is no such class here.
        """
        if afferent not in self.afferents:
            raise UsageError(
                f"no observed rates of {afferent!r}, only of "
                f"{', '.join(self.afferents)}: {self.path}"
            )
        rate_ips = self.rate_ips[:, self.afferents.index(afferent)]
        there = np.flatnonzero(~np.isnan(rate_ips))
        return tuple(self.stimuli[row] for row in there), rate_ips[there]

    def family(self, name: str) -> "ObservedRates":
        """Rates of one family: ``sine``, ``diharm`` or ``noise``.

        Raises
        ------
        UsageError
            No stimulus here is of that family.
        """
        rows = [row for row, stimulus in enumerate(self.stimuli) if _family_of(stimulus) == name]
        if not rows:
            raise UsageError(
                f"no observed rates of family {name!r}, only of "
                f"{', '.join(self.families)}: {self.path}"
            )
        stimuli = tuple(self.stimuli[row] for row in rows)
        return replace(self, stimuli=stimuli, rate_ips=self.rate_ips[rows])

    def rates(self) -> list[Rate]:
        """All rates one by one, as a table has them: stimulus after stimulus."""
        return [
            Rate(stimulus, afferent, rate_ips)
            for stimulus, row in zip(self.stimuli, self.rate_ips.tolist(), strict=True)
            for afferent, rate_ips in zip(self.afferents, row, strict=True)
            if rate_ips == rate_ips  # not NaN
        ]


def read_observed(
    path: Path, *, afferents: Iterable[str] | None = None, complete: bool = True
) -> ObservedRates:
    """Observed rates of a table.

    Parameters
    ----------
    afferents
        Classes to take, in this order; rows of others are checked and left out. By
        default those that the table has, in the order SA, RA, PC.
    complete
        Whether each stimulus must have a rate of each class. If not, the missing
        ones are NaN.

    Returns
    -------
    ObservedRates
        Stimuli in the order in which they first appear.

    Raises
    ------
    TableError
        No CSV table in UTF-8, another header, an unknown stimulus or class, no rate
        in impulses a second, a duplicate rate, or one that is missing.
    UsageError
        `afferents` names no class, or one that no model is for.
    """
    import pandas as pd

    wanted = None if afferents is None else _checked(afferents)
    table = read_table(path)
    _check_header(table)
    if not table.size:
        raise TableError("a header and no rows, expected rates", path)
    rates = pd.DataFrame(
        {
            "stimulus": _stimuli(table),
            "afferent": _afferents(table),
            "rate_ips": _rates(table),
        }
    )
    table.refuse_duplicates(rates[["stimulus", "afferent"]])
    there = tuple(rates["afferent"].unique())
    if wanted is None:
        wanted = tuple(name for name in AFFERENTS if name in there)
    elif absent := [name for name in wanted if name not in there]:
        raise TableError(f"no rates of {', '.join(absent)}, only of {', '.join(there)}", path)
    rates = rates[rates["afferent"].isin(wanted)]
    for name in wanted:
        _check_unit(name, rates.loc[rates["afferent"] == name, "rate_ips"], table)
    stimuli = tuple(rates["stimulus"].unique())
    rate_ips = np.full((len(stimuli), len(wanted)), np.nan)
    for stimulus, afferent, rate in rates.itertuples(index=False):
        rate_ips[stimuli.index(stimulus), wanted.index(afferent)] = rate
    missing = np.argwhere(np.isnan(rate_ips))
    if complete and missing.size:
        stimulus, lacking = stimuli[missing[0, 0]], wanted[missing[0, 1]]
        first = rates[rates["stimulus"] == stimulus].iloc[0]
        raise table.error(
            first.name,
            f"{stimulus} has a rate of {first['afferent']} and none of {lacking}, expected "
            f"one of {', '.join(wanted)} each ({len(missing)} missing in all)",
        )
    return ObservedRates(stimuli, wanted, rate_ips, path, sha256_of(path))


def _checked(afferents: Iterable[str]) -> tuple[str, ...]:
    names = [afferents] if isinstance(afferents, str) else afferents
    wanted = tuple(dict.fromkeys(names))
    for name in wanted:
        if name not in AFFERENTS:
            raise UsageError(f"afferent {name!r}, expected one of {', '.join(AFFERENTS)}")
    if not wanted:
        raise UsageError(f"no afferent, expected some of {', '.join(AFFERENTS)}")
    return wanted


def _check_header(table: TextTable) -> None:
    """Refuse what is not the three columns, with the likely reason."""
    header, path = table.header, table.path
    expected = ",".join(RATE_COLUMNS)
    missing = [name for name in RATE_COLUMNS if name not in header]
    extra = [name or "without a name" for name in header if name not in RATE_COLUMNS]
    found = ",".join(header)
    classes = [name for name in extra if _class_of(name)]
    if "afferent" in missing and len(classes) > 1:
        found = f"one column a class ({', '.join(classes)})"
        raise TableError(f"{found}, expected one row a rate: {expected}", path, 1)
    for name in missing:
        for other in extra:
            is_rate = name == "rate_ips" and _RATE_WORDS.search(other.lower())
            if is_rate or other.lower() == name:
                unit = ", impulses a second" if name == "rate_ips" else ""
                raise TableError(f"column {other}, expected {name}{unit}", path, 1)
    if missing:
        raise TableError(
            f"no column {', '.join(missing)} in {found!r}, expected {expected} on the first line",
            path,
            1,
        )
    if extra:
        raise TableError(
            f"column {', '.join(extra)} in {found!r}, expected {expected} and no other", path, 1
        )
    if len(header) > len(RATE_COLUMNS):
        raise TableError(f"duplicate column in {found!r}, expected {expected}", path, 1)


def _stimuli(table: TextTable) -> list[str]:
    """Id of the stimulus of each row, as the catalogue spells it."""
    words = table.words("stimulus")
    spelled: dict[str, str] = {}
    for row, word in enumerate(words):
        if word in spelled:
            continue
        if len(word.split()) > 1:
            raise table.error(row, f"stimulus {word!r} has a blank in it, expected as sine_20_250")
        try:
            entries = resolve(word)
        except StimulusError as error:
            raise table.error(row, str(error)) from error
        if len(entries) > 1:
            some = ", ".join(entry.id for entry in entries[:3])
            raise table.error(
                row,
                f"stimulus {word!r} names {len(entries)} stimuli, expected one row a level: "
                f"{some}{', ...' if len(entries) > 3 else ''}",
            )
        spelled[word] = entries[0].id
    return [spelled[word] for word in words]


def _afferents(table: TextTable) -> list[str]:
    """Class of each row; an error says which class another paper's word is here."""
    words: list[str] = table.column("afferent").tolist()
    for row, word in enumerate(words):
        if word in AFFERENTS:
            continue
        hint = ""
        if near := _class_of(word):
            hint = f"; {word} is {near} here"
        elif _plain(word) == "SA2":
            hint = "; there is no model of SA2, SA is SA1"
        raise table.error(
            row, f"afferent is {word!r}, expected one of {', '.join(AFFERENTS)}{hint}"
        )
    return words


def _class_of(word: str) -> str | None:
    plain = _plain(word)
    return plain if plain in AFFERENTS else _NAMES_ELSEWHERE.get(plain)


def _plain(word: str) -> str:
    """A class without blanks and signs, its type as a digit."""
    letters = re.sub(r"[\s_.-]", "", word).upper()
    letters = re.sub(r"^(SA|RA|FA)II$", r"\g<1>2", letters)
    return re.sub(r"^(SA|RA|FA)I$", r"\g<1>1", letters)


def _rates(table: TextTable) -> FloatArray:
    """Rate of each row in impulses a second."""
    for row, cell in enumerate(table.column("rate_ips")):
        if cell.lower() in _NOT_MEASURED:
            raise table.error(
                row,
                f"rate_ips is {cell!r}, expected a number; a rate that was not measured has no row",
            )
        if "%" in cell:
            raise table.error(row, f"rate_ips is {cell!r}, a share; expected impulses a second")
        if "," in cell:
            raise table.error(row, f"rate_ips is {cell!r}, expected a number with a decimal point")
    rate_ips = table.numbers("rate_ips", least=0)
    table.refuse(
        rate_ips > MAX_RATE_IPS,
        lambda row: (
            f"rate_ips is {rate_ips[row]:g}, expected impulses a second: an afferent that "
            f"rests 0.5 ms after each has at most {MAX_RATE_IPS:g}"
        ),
    )
    return rate_ips


def _check_unit(afferent: str, rate_ips: "pd.Series[float]", table: TextTable) -> None:
    """Refuse rates of one class that by their size are impulses a millisecond."""
    if 0 < rate_ips.max() <= LEAST_TOP_RATE_IPS:
        raise table.error(
            rate_ips.index.to_numpy()[rate_ips.argmax()],
            f"the highest rate of {afferent} is {rate_ips.max():g}, as if in impulses a ms; "
            f"expected impulses a second (if it is right, leave {afferent} out)",
        )


def _family_of(stimulus: str) -> str:
    return stimulus.partition("_")[0]
