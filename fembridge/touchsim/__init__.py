"""The rates of TouchSim under the 82 stimuli: the model to set one's own beside.

``rates.csv`` in this folder; what made it, and what is not known of that, is in the
``README.md`` beside it.
"""

from pathlib import Path

import numpy as np

from decks.stimuli import resolve
from fembridge.errors import UsageError
from fembridge.tables import Rate, read_table

TABLE = Path(__file__).parent / "rates.csv"

MODELS = {"SA": 4, "RA": 9, "PC": 4}
"""Afferents of each class that TouchSim has models of; a rate is their mean."""


def touchsim_rates(preindent_um: float = 0.0, *, whole_second: bool = False) -> list[Rate]:
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
    list of Rate
        SA, RA and PC of the first stimulus, then of the next; rates in impulses a
        second.

    Raises
    ------
    UsageError
        Nothing was computed for that depth.
    """
    table = read_table(TABLE)
    depth_um, window_ms = table.numbers("preindent_um"), table.numbers("window_ms")
    if preindent_um not in depth_um:
        raise UsageError(f"preindent_um is {preindent_um:g}, TouchSim's is 0 or 500")
    stimuli = table.column("stimulus")
    own_ms = {name: np.ptp(resolve(name)[0].window_ms) for name in dict.fromkeys(stimuli)}
    wanted_ms = 1000.0 if whole_second else [own_ms[name] for name in stimuli]
    table = table.where((depth_um == preindent_um) & (window_ms == wanted_ms))
    columns = table.column("stimulus"), table.column("afferent"), table.numbers("rate_ips").tolist()
    return [Rate(*row) for row in zip(*columns, strict=True)]
