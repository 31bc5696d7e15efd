"""Observed firing rates: what a model is fitted to and measured against.

A user's own table, three columns ``stimulus,afferent,rate_ips`` and one row for each
stimulus and class of afferent. ``stimulus`` is an id of the catalogue, or a complete
one of the user's own (``sine_600_10``). Rates are impulses a second in the window of
the stimulus. Nothing is guessed: what does not fit is an error that names its line.
"""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np

from fembridge.errors import TableError, UsageError
from fembridge.observed_cells import afferent_of, check_header, check_units, rate_of, stimulus_of
from fembridge.table_rows import decoded, header_of, read_content, rows_of
from fembridge.tables import AFFERENTS, RATE_COLUMNS, Rate
from fembridge.typing import FloatArray

FAMILIES = ("sine", "diharm", "noise")

_Placed: TypeAlias = dict[tuple[str, str], tuple[float, int]]
"""Rate and line by stimulus and class."""


@dataclass(frozen=True, slots=True, eq=False)
class ObservedRates:
    """Rates `rate_ips` ``(stimulus, afferent)``, NaN where none was observed.

    `stimuli` are ids as the catalogue spells them, `afferents` names of classes.
    `sha256` is that of the file `path` the rates came from.

    Raises
    ------
    TableError
        Names that repeat, a rate that is negative or infinite, a stimulus without
        any, or an array of another shape.
    """

    stimuli: tuple[str, ...]
    afferents: tuple[str, ...]
    rate_ips: FloatArray
    path: Path
    sha256: str

    def __post_init__(self) -> None:
        rate_ips = np.array(self.rate_ips, dtype=np.float64)
        shape = (len(self.stimuli), len(self.afferents))
        if rate_ips.shape != shape or not rate_ips.size:
            raise TableError(
                f"rates of shape {rate_ips.shape}, expected one for each of "
                f"{shape[0]} stimuli and {shape[1]} classes of afferents",
                self.path,
            )
        for names in (self.stimuli, self.afferents):
            twice = next((name for name in names if names.count(name) > 1), None)
            if twice is not None:
                raise TableError(f"{twice} stands there twice", self.path)
        if unknown := sorted(set(self.afferents) - set(AFFERENTS)):
            raise TableError(
                f"afferent {unknown[0]!r}, expected one of {', '.join(AFFERENTS)}", self.path
            )
        if (rate_ips < 0).any() or np.isinf(rate_ips).any():
            raise TableError("a rate is negative or infinite", self.path)
        bare = np.flatnonzero(np.isnan(rate_ips).all(axis=1))
        if bare.size:
            raise TableError(f"no rate of {self.stimuli[bare[0]]}", self.path)
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
        """Give the rates of one family: ``sine``, ``diharm`` or ``noise``.

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
        """Give them one by one, as a table has them: stimulus after stimulus."""
        return [
            Rate(stimulus, afferent, rate_ips)
            for stimulus, row in zip(self.stimuli, self.rate_ips.tolist(), strict=True)
            for afferent, rate_ips in zip(self.afferents, row, strict=True)
            if rate_ips == rate_ips  # not NaN
        ]


def read_observed(
    path: Path, *, afferents: Iterable[str] | None = None, complete: bool = True
) -> ObservedRates:
    """Read a table of observed rates.

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
        Stimuli stand in the order in which they first appear.

    Raises
    ------
    TableError
        No CSV table in UTF-8, another header, an unknown stimulus or class, no rate
        in impulses a second, the same rate twice, or one that is missing.
    UsageError
        `afferents` names no class, or one that no model is for.
    """
    wanted = None if afferents is None else _checked(afferents)
    content = read_content(path)
    placed = _read_placed(decoded(content, path), path)
    there = dict.fromkeys(afferent for _, afferent in placed)
    if wanted is None:
        wanted = tuple(name for name in AFFERENTS if name in there)
    elif absent := [name for name in wanted if name not in there]:
        raise TableError(f"no rates of {', '.join(absent)}, only of {', '.join(there)}", path)
    placed = {names: rate for names, rate in placed.items() if names[1] in wanted}
    for name in wanted:
        check_units(name, [rate for (_, other), rate in placed.items() if other == name], path)
    stimuli = tuple(dict.fromkeys(stimulus for stimulus, _ in placed))
    if complete:
        _check_complete(placed, stimuli, wanted, path)
    missing = (np.nan, 0)
    rate_ips = np.array(
        [[placed.get((each, name), missing)[0] for name in wanted] for each in stimuli]
    )
    sha256 = hashlib.sha256(content).hexdigest()
    return ObservedRates(stimuli, wanted, rate_ips, path, sha256)


def _checked(afferents: Iterable[str]) -> tuple[str, ...]:
    names = [afferents] if isinstance(afferents, str) else afferents
    wanted = tuple(dict.fromkeys(names))
    for name in wanted:
        if name not in AFFERENTS:
            raise UsageError(f"afferent {name!r}, expected one of {', '.join(AFFERENTS)}")
    if not wanted:
        raise UsageError(f"no afferent, expected some of {', '.join(AFFERENTS)}")
    return wanted


def _read_placed(text: str, path: Path) -> _Placed:
    """Give each rate with its line, in the order of the file."""
    check_header(header_of(text, path, RATE_COLUMNS), path)
    placed: _Placed = {}
    for row in rows_of(text, path, RATE_COLUMNS):
        stimulus, afferent, rate_ips = stimulus_of(row), afferent_of(row), rate_of(row)
        _, first = placed.setdefault((stimulus, afferent), (rate_ips, row.line))
        if first != row.line:
            raise row.error(
                f"a second rate of {stimulus}, {afferent}; the first is on line {first}"
            )
    if not placed:
        raise TableError("a header and no rows, expected rates", path)
    return placed


def _check_complete(
    placed: Mapping[tuple[str, str], tuple[float, int]],
    stimuli: tuple[str, ...],
    afferents: tuple[str, ...],
    path: Path,
) -> None:
    """Refuse a stimulus that has a rate of one class and none of another."""
    missing = [
        (stimulus, afferent)
        for stimulus in stimuli
        for afferent in afferents
        if (stimulus, afferent) not in placed
    ]
    if not missing:
        return
    stimulus, afferent = missing[0]
    other, line = next(
        (name, placed[stimulus, name][1]) for name in afferents if (stimulus, name) in placed
    )
    more = f" ({len(missing)} rows are missing)" if missing[1:] else ""
    raise TableError(
        f"{stimulus} has a rate of {other} here and none of {afferent} anywhere, "
        f"expected one of {', '.join(afferents)} each{more}",
        path,
        line,
    )


def _family_of(stimulus: str) -> str:
    return stimulus.partition("_")[0]
