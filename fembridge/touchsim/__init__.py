"""The rates of TouchSim under the 82 stimuli: the model to set one's own beside.

``rates.csv`` in this folder; what made it, and what is not known of that, is told in
the ``README.md`` beside it.
"""

from dataclasses import dataclass
from pathlib import Path

from decks.stimuli import resolve
from fembridge.errors import UsageError
from fembridge.table_rows import read_rows
from fembridge.tables import AFFERENTS, Rate

TABLE = Path(__file__).parent / "rates.csv"

MODELS = {"SA": 4, "RA": 9, "PC": 4}
"""Afferents of each class that TouchSim has models of; a rate is their mean."""

WHOLE_SECOND_MS = 1000.0

_COLUMNS = ("stimulus", "afferent", "preindent_um", "window_ms", "rate_ips", "rate_sd_ips")


@dataclass(frozen=True, slots=True)
class TouchsimRate(Rate):
    """Mean rate of TouchSim's models of one class, `sd_ips` among them."""

    sd_ips: float


def touchsim_rates(preindent_um: float = 0.0, *, whole_second: bool = False) -> list[TouchsimRate]:
    """Give TouchSim's rates under all 82 stimuli, in the order of the catalogue.

    Parameters
    ----------
    preindent_um
        Depth of the probe before the vibration, 0 or 500.
    whole_second
        Count the spikes of a second, not of the stimulus' own window. By default a
        rate is from a window as long as the observed one: 245 or 100 ms.

    Returns
    -------
    list of TouchsimRate
        SA, RA and PC of the first stimulus, then of the next; rates in impulses a
        second.

    Raises
    ------
    UsageError
        Nothing was computed for that depth.
    TableError
        The stored table is altered.
    """
    depths_um: set[float] = set()
    rates = []
    for row in read_rows(TABLE, _COLUMNS):
        stimulus = row.text("stimulus")
        depth_um = row.number("preindent_um", least=0)
        depths_um.add(depth_um)
        [entry] = resolve(stimulus)
        start_ms, end_ms = entry.window_ms
        wanted_ms = WHOLE_SECOND_MS if whole_second else end_ms - start_ms
        if depth_um != preindent_um or row.number("window_ms") != wanted_ms:
            continue
        rates.append(
            TouchsimRate(
                stimulus,
                row.choice("afferent", AFFERENTS),
                row.number("rate_ips", least=0),
                row.number("rate_sd_ips", least=0),
            )
        )
    if not rates:
        there = " or ".join(f"{depth_um:g}" for depth_um in sorted(depths_um))
        raise UsageError(f"preindent_um is {preindent_um:g}, TouchSim's is {there}")
    return rates
