"""How closely spikes follow each sinusoid: impulses a cycle, and phase."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from fembridge.tables import AFFERENTS, SpikeTrain
from fembridge.typing import FloatArray
from fembridge.validation.compared_rates import ComparedRates
from fembridge.validation.family import SINES
from neural import vector_strength
from neural.rate import EDGE_MS


@dataclass(frozen=True, slots=True)
class LockingRow:
    """One source, class and sinusoid.

    `vector_strength` is the mean over the cells that fired; NaN where none did, and
    where a source has rates only.
    """

    source: str
    afferent: str
    stimulus: str
    frequency_hz: float
    amplitude_um: float
    impulses_per_cycle: float
    vector_strength: float


def locking_rows(
    compared: ComparedRates, trains: Mapping[str, Iterable[SpikeTrain]]
) -> tuple[LockingRow, ...]:
    """Tell it of each source that has a rate; `trains` are those of the models."""
    cells: dict[tuple[str, str, str], list[FloatArray]] = {}
    for source, mine in trains.items():
        for train in mine:
            name = (source, train.afferent, train.stimulus)
            cells.setdefault(name, []).append(train.times_ms)
    rows = []
    for source in compared.sources:
        for afferent in AFFERENTS:
            rate_ips = compared.of(source, afferent, SINES.stimuli)
            sines = [entry for one in SINES.sets for entry in one.entries]
            for entry, rate in zip(sines, rate_ips.tolist(), strict=True):
                if math.isnan(rate):
                    continue
                frequency_hz, amplitude_um = entry.numbers().values()
                mine_ms = cells.get((source, afferent, entry.id), [])
                rows.append(
                    LockingRow(
                        source=source,
                        afferent=afferent,
                        stimulus=entry.id,
                        frequency_hz=frequency_hz,
                        amplitude_um=amplitude_um,
                        impulses_per_cycle=rate / frequency_hz,
                        vector_strength=_strength(mine_ms, entry.window_ms, frequency_hz),
                    )
                )
    return tuple(rows)


def _strength(
    trains_ms: list[FloatArray], window_ms: tuple[float, float], frequency_hz: float
) -> float:
    start_ms, end_ms = window_ms
    counted = [
        times_ms[(times_ms > start_ms + EDGE_MS) & (times_ms <= end_ms + EDGE_MS)]
        for times_ms in trains_ms
    ]
    found = [vector_strength(one, frequency_hz) for one in counted if one.size]
    return float(np.mean(found)) if found else math.nan
