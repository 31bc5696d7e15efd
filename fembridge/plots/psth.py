"""Peri-stimulus time histograms: the rate over time, a panel a class, a row a stimulus."""

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from fembridge.errors import UsageError
from fembridge.plots.rows import draw_histograms, rows_and_classes, rows_figure
from fembridge.plots.style import AFFERENT_COLOURS, in_style
from fembridge.stimulus import Stimulus
from fembridge.tables import SpikeTrain
from fembridge.typing import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DEFAULT_BIN_MS = 5.0
MOST_BINS = 5000

_ROW_IN = (0.42, 0.13)
_MS_PER_S = 1000.0
# Spike times are multiples of a step that has rounding: one on an edge begins a bin.
_EDGE_SHARE = 1e-6


@in_style
def psth_figure(
    trains: Iterable[SpikeTrain],
    *,
    bin_ms: float = DEFAULT_BIN_MS,
    stimuli: Sequence[str] | None = None,
    afferents: Sequence[str] | None = None,
    window_ms: tuple[float, float] | None = None,
    waveform: Stimulus | None = None,
) -> "Figure":
    """Rate in each bin of `bin_ms`, mean over the cells or repeats that `trains` have.

    A silent cell counts where it is among `trains`. All rows of a class share a scale,
    which stands below its name. The other arguments are those of a raster.

    Raises
    ------
    UsageError
        Nothing to draw, spikes that have no row, no bin width or too many bins.
    """
    trains = list(trains)
    rows, classes = rows_and_classes(trains, stimuli, afferents)
    ends_ms = [0.0, *(float(train.times_ms.max()) for train in trains if train.times_ms.size)]
    ends_ms += [window_ms[1]] if window_ms else []
    ends_ms += [float(waveform.times_ms[-1])] if waveform else []
    edges_ms = bins(0.0, max(ends_ms), bin_ms)
    rates = [[psth(trains, name, one, edges_ms) for name in rows] for one in classes]
    tops = [max(float(rate.max()) for rate in of_class) for of_class in rates]
    figure, panels = rows_figure(
        rows,
        classes,
        _ROW_IN,
        x=("Time (ms)", 0.0, float(edges_ms[-1])),
        window_ms=window_ms,
        waveform=waveform,
        notes=[f"row height: {top:.3g} impulses/s" if top else "no spikes" for top in tops],
    )
    for afferent, panel, of_class, top in zip(classes, panels, rates, tops, strict=True):
        heights = [rate / (top or 1.0) for rate in of_class]
        draw_histograms(panel, heights, edges_ms, AFFERENT_COLOURS[afferent])
    return figure


def psth(
    trains: Iterable[SpikeTrain], stimulus: str, afferent: str, edges_ms: FloatArray
) -> FloatArray:
    """Rate ``(bin,)`` in impulses/s of the mean train of a stimulus and class; 0 of none."""
    mine = [t.times_ms for t in trains if (t.stimulus, t.afferent) == (stimulus, afferent)]
    counts = histogram(np.concatenate([np.zeros(0), *mine]), edges_ms)
    rate_ips: FloatArray = counts * _MS_PER_S / (np.diff(edges_ms) * max(len(mine), 1))
    return rate_ips


def bins(start_ms: float, end_ms: float, bin_ms: float) -> FloatArray:
    """Edges of bins of `bin_ms` from `start_ms` on, the last one beyond `end_ms`."""
    if not (math.isfinite(bin_ms) and bin_ms > 0):
        raise UsageError(f"bins of {bin_ms:g} ms, expected more than 0")
    count = max(1, math.ceil((end_ms - start_ms) / bin_ms - _EDGE_SHARE))
    if count > MOST_BINS:
        raise UsageError(f"{count} bins of {bin_ms:g} ms, expected at most {MOST_BINS}: widen them")
    return start_ms + bin_ms * np.arange(count + 1, dtype=np.float64)


def histogram(values_ms: FloatArray, edges_ms: FloatArray) -> FloatArray:
    """Numbers of values in even bins ``(bin,)``; one on an edge is in the bin it begins."""
    bin_ms = edges_ms[1] - edges_ms[0]
    row = np.floor((values_ms - edges_ms[0]) / bin_ms + _EDGE_SHARE).astype(int)
    count = edges_ms.size - 1
    found: FloatArray = np.bincount(np.minimum(row, count - 1), minlength=count).astype(float)
    return found
