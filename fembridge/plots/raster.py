"""Rasters of spikes: one panel a class, one row a stimulus."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from fembridge.plots.rows import rows_and_classes, rows_figure
from fembridge.plots.style import AFFERENT_COLOURS, LINE_PT, in_style
from fembridge.stimulus import Stimulus
from fembridge.tables import SpikeTrain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Inches. A few rows are tall enough to see single spikes; many share a page.
_ROW_IN, _LEAST_ROW_IN = 0.26, 0.104

# Share of a row that its spikes fill, and their width where rows are many.
_FILL = 0.78
_MANY_ROWS = 10
_DENSE_LINE_PT = 0.65


@in_style
def raster_figure(
    trains: Iterable[SpikeTrain],
    *,
    stimuli: Sequence[str] | None = None,
    afferents: Sequence[str] | None = None,
    span_ms: tuple[float, float] | None = None,
    window_ms: tuple[float, float] | None = None,
    waveform: Stimulus | None = None,
) -> "Figure":
    """Spikes: a panel a class, a row a stimulus.

    Parameters
    ----------
    trains
        Spikes; those of one stimulus and class share a row, a line a unit and repeat.
    stimuli
        Rows from top to bottom. Default: as they come in `trains`. Name them where
        some are silent in all classes.
    afferents
        Panels from left to right. Default: the classes of `trains`.
    span_ms
        Ends of the time axis. Default: from 0 to the last spike or window end.
    window_ms
        Where spikes were counted; what is outside gets a grey ground.
    waveform
        A stimulus to draw above the panels.

    Raises
    ------
    UsageError
        Nothing to draw, or spikes that have no row.
    """
    trains = list(trains)
    rows, classes = rows_and_classes(trains, stimuli, afferents)
    ends_ms = [*(train.times_ms for train in trains), window_ms or (), (0.0, 1.0)]
    if waveform:
        ends_ms.append(waveform.times_ms[[0, -1]])
    every_ms = np.concatenate(ends_ms if span_ms is None else [span_ms])
    figure, panels = rows_figure(
        rows,
        classes,
        (_ROW_IN, _LEAST_ROW_IN),
        x=("Time (ms)", float(every_ms.min()), float(every_ms.max())),
        window_ms=window_ms,
        waveform=waveform,
    )
    line_pt = _DENSE_LINE_PT if len(rows) > _MANY_ROWS else LINE_PT
    for afferent, panel in zip(classes, panels, strict=True):
        _draw_spikes(panel, [one for one in trains if one.afferent == afferent], rows, line_pt)
    return figure


def _draw_spikes(
    panel: "Axes", trains: Sequence[SpikeTrain], rows: Sequence[str], line_pt: float
) -> None:
    """Draw all spikes of a panel; units and repeats of a row lie under one another."""
    lanes: dict[str, dict[tuple[str, int], int]] = {name: {} for name in rows}
    units = {name: k for k, name in enumerate(dict.fromkeys(train.unit for train in trains))}
    for train in sorted(trains, key=lambda train: (units[train.unit], train.repeat)):
        here = lanes[train.stimulus]
        here.setdefault((train.unit, train.repeat), len(here))
    times_ms, tops, bottoms = [np.empty(0)], [np.empty(0)], [np.empty(0)]
    for train in trains:
        here = lanes[train.stimulus]
        lane, place = _FILL / len(here), here[train.unit, train.repeat]
        middle = rows.index(train.stimulus) - _FILL / 2 + (place + 0.5) * lane
        half = lane / 2 if len(here) == 1 else 0.42 * lane
        times_ms.append(train.times_ms)
        tops.append(np.full(train.times_ms.size, middle - half))
        bottoms.append(np.full(train.times_ms.size, middle + half))
    panel.vlines(
        np.concatenate(times_ms),
        np.concatenate(tops),
        np.concatenate(bottoms),
        colors=AFFERENT_COLOURS[trains[0].afferent] if trains else None,
        linewidths=line_pt,
        clip_on=False,  # a spike on the last sample is as thick as any
    )
