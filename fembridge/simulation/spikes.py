"""Spikes of stress traces, encoded in batches of equal length."""

from collections.abc import Sequence

import numpy as np

from fembridge.io.spike_table import SpikeTrain
from fembridge.trace import StressTrace
from fembridge.typing import FloatArray
from neural import Parameters, encode_afferents

# Samples of a class that are encoded at once: 220 bytes each with ten cells.
_BATCH_SAMPLES = 1_000_000


def encode_traces(
    traces: Sequence[StressTrace], parameters: Parameters, derivative: str = "backward"
) -> list[list[FloatArray]]:
    """Spike times in ms of each cell of each trace; traces of one length are one batch."""
    cells_by_row: dict[int, list[FloatArray]] = {}
    by_grid: dict[tuple[int, float, float], dict[str, list[int]]] = {}
    for row, trace in enumerate(traces):
        batch = by_grid.setdefault((trace.stress_pa.size, trace.dt_ms, trace.start_ms), {})
        batch.setdefault(str(trace.afferent), []).append(row)
    for (samples, dt_ms, start_ms), classes in by_grid.items():
        batch_size = max(1, _BATCH_SAMPLES // samples)
        for begin in range(0, max(map(len, classes.values())), batch_size):
            batch_rows = {
                name: selected
                for name, rows in classes.items()
                if (selected := rows[begin : begin + batch_size])
            }
            stress_pa = {
                name: np.stack([traces[row].stress_pa for row in rows], -1)
                for name, rows in batch_rows.items()
            }
            cells = encode_afferents(stress_pa, dt_ms, parameters, start_ms, derivative)
            for name, rows in batch_rows.items():
                cells_by_row |= dict(zip(rows, cells[name], strict=True))
    return [cells_by_row[row] for row in range(len(traces))]


def spike_trains(
    stimulus: str, afferent: str, cells_ms: Sequence[FloatArray], unit: str = ""
) -> list[SpikeTrain]:
    """One train for each cell; `cell` numbers several cells from 1 and is 0 for a single cell."""
    first = 1 if len(cells_ms) > 1 else 0
    return [
        SpikeTrain(stimulus, afferent, times_ms, cell, unit)
        for cell, times_ms in enumerate(cells_ms, start=first)
    ]
