"""Observed firing rates: what a model is fitted to and measured against.

A user's own table, three columns ``stimulus,afferent,rate_ips`` and one row for each
stimulus and class of afferent. ``stimulus`` is an id of the catalogue, or a complete
one of the user's own (``sine_600_10``). Rates are impulses a second in the window of
the stimulus. Such tables come out of spreadsheets and figure digitisers: nothing is
guessed, and an error names the line.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from decks.stimuli import resolve
from fembridge.errors import StimulusError, TableError, UsageError
from fembridge.host.store import sha256_of
from fembridge.io.spike_table import RATE_COLUMNS, Rate
from fembridge.io.text_table import TextTable, read_table
from fembridge.trace import AFFERENTS
from fembridge.typing import FloatArray

if TYPE_CHECKING:
    import pandas as pd

FAMILIES = ("sine", "diharm", "noise")

MAX_RATE_IPS = 2000.0
"""One impulse each 0.5 ms, the shortest refractory period of Table 2's afferents."""

LEAST_TOP_RATE_IPS = 0.5
"""A class with nothing above this is taken to be in impulses a ms, where it would be
500 ips: more than the paper's stimuli drive out of any afferent."""


@dataclass(frozen=True, slots=True, eq=False)
class ObservedRates:
    """Rates `rate_ips` ``(stimulus, afferent)``, NaN where none was observed.

    `stimuli` are ids as the catalogue spells them, `afferents` names of classes.
    `sha256` is that of the file `path` the rates came from, "" of a DataFrame.
    """

    stimuli: tuple[str, ...]
    afferents: tuple[str, ...]
    rate_ips: FloatArray
    path: Path
    sha256: str

    def rates_of(self, afferent: str) -> tuple[tuple[str, ...], FloatArray]:
        """Stimuli with an observed rate of `afferent`, and the rates ``(S,)`` in ips.

        Raises UsageError: there is no such class here.
        """
        if afferent not in self.afferents:
            available = ", ".join(self.afferents)
            problem = f"no observed rates of {afferent!r}, only of {available}"
            raise UsageError(problem, self.path, found=afferent, expected=available)
        rate_ips = self.rate_ips[:, self.afferents.index(afferent)]
        rows = np.flatnonzero(~np.isnan(rate_ips))
        return tuple(self.stimuli[row] for row in rows), rate_ips[rows]

    def rates(self) -> list[Rate]:
        """All rates one by one, as a table has them: stimulus after stimulus."""
        return [
            Rate(stimulus, afferent, rate_ips)
            for stimulus, row in zip(self.stimuli, self.rate_ips.tolist(), strict=True)
            for afferent, rate_ips in zip(self.afferents, row, strict=True)
            if rate_ips == rate_ips  # not NaN
        ]


def read_observed(source: "str | Path | pd.DataFrame", *, complete: bool = True) -> ObservedRates:
    """Observed rates of a table, stimuli in the order of the table.

    Parameters
    ----------
    source
        Path of a CSV table ``stimulus,afferent,rate_ips`` in UTF-8, or a DataFrame with these
        columns; one row per stimulus and class, rates in impulses/s.
    complete
        Whether each stimulus must have a rate of each class; if not, missing rates are NaN.
        Default: True.

    Returns
    -------
    ObservedRates
        ``rate_ips`` is ``(stimulus, afferent)``.

    Raises
    ------
    TableError
        No such table, an unknown stimulus or class, a rate in another unit, a duplicate or
        missing rate; with its line.

    Examples
    --------
    >>> import fembridge as fb
    >>> observed = fb.read_observed(fb.sample("rates"))
    >>> observed.rate_ips.shape
    (37, 3)
    """
    import pandas as pd

    if isinstance(source, str):
        source = Path(source)
    table = read_table(source, RATE_COLUMNS, ())
    if not table.size:
        raise TableError("a header and no rates", table.path)
    stimuli, afferents = _stimuli(table), table.choices("afferent", AFFERENTS)
    rates = pd.DataFrame({"stimulus": stimuli, "afferent": afferents})
    table.refuse_duplicates(rates)
    rates["rate_ips"] = table.numbers("rate_ips", least=0)
    for name, class_rates in rates.groupby("afferent")["rate_ips"]:
        highest = class_rates.max()
        if highest > MAX_RATE_IPS or 0 < highest <= LEAST_TOP_RATE_IPS:
            raise table.error(
                int(class_rates.index[int(class_rates.argmax())]),
                f"rate_ips is {highest:g}, the highest of {name}: expected impulses a second, "
                f"{LEAST_TOP_RATE_IPS:g} to {MAX_RATE_IPS:g}",
            )
    order = list(dict.fromkeys(stimuli))
    classes = [name for name in AFFERENTS if name in afferents]
    wide = rates.pivot_table(index="stimulus", columns="afferent", values="rate_ips")
    rate_ips = wide.loc[order, classes].to_numpy(dtype=np.float64, copy=True)
    missing = np.argwhere(np.isnan(rate_ips))
    if complete and missing.size:
        stimulus, column = missing[0].tolist()
        raise table.error(
            stimuli.index(order[stimulus]),
            f"{order[stimulus]} has no rate of {classes[column]}, which other stimuli have",
        )
    rate_ips.flags.writeable = False
    digest = sha256_of(source) if isinstance(source, Path) else ""
    return ObservedRates(tuple(order), tuple(classes), rate_ips, table.path, digest)


def _stimuli(table: TextTable) -> list[str]:
    """Id of the stimulus of each row, as the catalogue spells it."""
    texts = table.words("stimulus")
    spelled: dict[str, str] = {}
    for row, text in enumerate(texts):
        if text in spelled:
            continue
        try:
            [spelled[text], *others] = [entry.id for entry in resolve(text)]
        except StimulusError as error:
            raise table.error(row, str(error)) from error
        if others:
            message = f"{text!r} names {len(others) + 1} stimuli"
            raise table.error(row, f"{message}, expected one row a level")
    return [spelled[text] for text in texts]
