"""The rates of TouchSim under the 82 stimuli: the model to set one's own beside.

``rates.csv`` in this folder; what made it, and what is not known of that, is in the
``README.md`` beside it.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from decks.stimuli import resolve
from fembridge.errors import UsageError
from fembridge.tables import AFFERENTS, Rate, read_table

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
    """TouchSim's rates under all 82 stimuli, in the order of the catalogue.

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
    """
    table = read_table(TABLE, _COLUMNS)
    depth_um = table.numbers("preindent_um")
    if preindent_um not in depth_um:
        there = " or ".join(f"{depth:g}" for depth in np.unique(depth_um))
        raise UsageError(f"preindent_um is {preindent_um:g}, TouchSim's is {there}")
    stimuli = table.words("stimulus")
    windows_ms = {id_: np.ptp(resolve(id_)[0].window_ms) for id_ in dict.fromkeys(stimuli)}
    wanted_ms = np.array([WHOLE_SECOND_MS if whole_second else windows_ms[id_] for id_ in stimuli])
    table = table.where((depth_um == preindent_um) & (table.numbers("window_ms") == wanted_ms))
    return [
        TouchsimRate(*row)
        for row in zip(
            table.words("stimulus").tolist(),
            table.choices("afferent", AFFERENTS).tolist(),
            table.numbers("rate_ips").tolist(),
            table.numbers("rate_sd_ips").tolist(),
            strict=True,
        )
    ]
