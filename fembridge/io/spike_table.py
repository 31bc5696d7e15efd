"""Spikes and rates as CSV tables and DataFrames.

``spikes``  ``stimulus,afferent,cell,spike_time_ms``; a silent train has no row
``rates``   ``stimulus,afferent,rate_ips``

Where units have names, ``unit`` follows ``afferent``; trials are numbered in ``trial``. A table
of spikes may lack ``unit``, ``cell`` and ``trial``. Numbers are written with as many digits as
restore them exactly; lines end in LF.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fembridge.errors import TraceError, warn
from fembridge.io.text_table import TextTable, read_table, row_groups, write_table
from fembridge.trace import AFFERENTS
from fembridge.typing import FloatArray

if TYPE_CHECKING:
    import pandas as pd


SPIKE_COLUMNS = ("stimulus", "afferent", "spike_time_ms")
SPIKE_KEYS = ("unit", "cell", "trial")
"""Optional columns of a table of spikes, in their order."""
RATE_COLUMNS = ("stimulus", "afferent", "rate_ips")


@dataclass(frozen=True, slots=True, eq=False)
class SpikeTrain:
    """Spikes of one afferent under one stimulus: `times_ms` ``(spikes,)``, rising.

    `cell` numbers the cells of a model population, the most sensitive first, and `trial` the
    trials of one afferent, both from 1; 0: a single one. `unit` names an afferent on the skin.
    """

    stimulus: str
    afferent: str
    times_ms: FloatArray
    cell: int = 0
    unit: str = ""
    trial: int = 0

    def __post_init__(self) -> None:
        times = np.array(self.times_ms, dtype=np.float64)
        if times.ndim != 1 or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
            raise TraceError(
                f"{self.stimulus}, {self.afferent}, cell {self.cell}, trial {self.trial}: spike "
                "times must be (spikes,), finite and rising"
            )
        times.flags.writeable = False
        object.__setattr__(self, "times_ms", times)


@dataclass(frozen=True, slots=True)
class Rate:
    """Firing rate of one afferent under one stimulus."""

    stimulus: str
    afferent: str
    rate_ips: float
    unit: str = ""


def read_spikes(source: "Path | pd.DataFrame") -> list[SpikeTrain]:
    """Spike trains of a table; each train's spikes come back in rising order.

    Raises
    ------
    TableError
        A column that is missing, duplicate or misspelt, or a row that is no spike. Other columns
        are named in a `FembridgeWarning`.
    """
    import pandas as pd

    path = source if isinstance(source, Path) else Path("DataFrame")
    table = read_table(source, SPIKE_COLUMNS, SPIKE_KEYS, unused=partial(warn, path=path))
    spikes = pd.DataFrame(
        {
            "stimulus": table.words("stimulus"),
            "afferent": table.choices("afferent", AFFERENTS),
            "unit": table.column("unit") if "unit" in table.header else "",
            **{
                name: table.numbers(name, 0, int) if name in table.header else 0
                for name in ("cell", "trial")
            },
            "time_ms": table.numbers("spike_time_ms"),
        }
    )
    table.refuse_duplicates(spikes)
    times_ms = spikes.pop("time_ms").to_numpy()
    keys = {str(name): column.tolist() for name, column in spikes.items()}
    trains = []
    for rows in row_groups(spikes, [*keys], path):
        values = {name: column[rows[0]] for name, column in keys.items()}
        trains.append(SpikeTrain(times_ms=np.sort(times_ms[rows]), **values))
    return trains


def spikes_frame(trains: Sequence[SpikeTrain]) -> "pd.DataFrame":
    """Table of `trains`: ``stimulus``, ``afferent``, ``cell``, ``spike_time_ms``.

    Where units have names, ``unit`` follows ``afferent``; where trials are numbered, ``trial``
    follows ``cell``, or replaces it where no cell is numbered.
    """
    import pandas as pd

    keys = [name for name in SPIKE_KEYS if any(getattr(train, name) for train in trains)]
    if not {"cell", "trial"}.intersection(keys):
        keys.append("cell")
    columns = ["stimulus", "afferent", *keys]
    rows = [[getattr(train, name) for name in columns] for train in trains]
    numbers = {name: np.int64 for name in keys if name != "unit"}
    frame = pd.DataFrame(rows, columns=columns).astype(numbers)
    frame = frame.loc[frame.index.repeat([train.times_ms.size for train in trains])]
    times_ms = np.concatenate([np.zeros(0), *(train.times_ms for train in trains)])
    return frame.reset_index(drop=True).assign(spike_time_ms=times_ms)


def write_spikes(path: Path, trains: Iterable[SpikeTrain]) -> None:
    """Write a table of spikes, one train after the other."""
    frame = spikes_frame(list(trains))
    write_table(
        path, [*map(str, frame)], zip(*(frame[name].tolist() for name in frame), strict=True)
    )


def read_rates(source: "Path | TextTable") -> list[Rate]:
    """Rates of a table, a file or as it was read, in its order, to the last digit.

    Raises
    ------
    TableError
        A column that is missing, duplicate or misspelt, or a row that is no rate. Other columns
        of a file are named in a `FembridgeWarning`.
    """
    import pandas as pd

    table = (
        read_table(source, RATE_COLUMNS, ("unit",), unused=partial(warn, path=source))
        if isinstance(source, Path)
        else source
    )
    stimuli, afferents = table.words("stimulus"), table.choices("afferent", AFFERENTS)
    rates_ips = table.numbers("rate_ips", least=0).tolist()
    units = table.column("unit") if "unit" in table.header else [""] * len(rates_ips)
    labels = {"stimulus": stimuli, "afferent": afferents, "unit": units}
    table.refuse_duplicates(pd.DataFrame(labels))
    return [Rate(*row) for row in zip(stimuli, afferents, rates_ips, units, strict=True)]


def rates_frame(rates: Sequence[Rate]) -> "pd.DataFrame":
    """Table of `rates`: ``stimulus``, ``afferent``, ``unit`` of named units, ``rate_ips``."""
    import pandas as pd

    header = _rate_header(rates)
    rows = [[getattr(rate, name) for name in header] for rate in rates]
    return pd.DataFrame(rows, columns=header)


def write_rates(path: Path, rates: Iterable[Rate]) -> None:
    """Write a table of rates in the order given."""
    rates = list(rates)
    header = _rate_header(rates)
    write_table(path, header, ([getattr(rate, name) for name in header] for rate in rates))


def _rate_header(rates: Sequence[Rate]) -> list[str]:
    """Columns of a table of rates, with ``unit`` if units have names."""
    unit = ["unit"] if any(rate.unit for rate in rates) else []
    return [*RATE_COLUMNS[:2], *unit, *RATE_COLUMNS[2:]]
