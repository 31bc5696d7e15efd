"""Rasters of spikes: one panel a class, one row a stimulus."""

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from fembridge.errors import UsageError
from fembridge.plots.style import (
    AFFERENT_COLOURS,
    FAINT,
    HAIR_PT,
    LINE_PT,
    SMALL_TEXT_PT,
    TEXT_PT,
    TINY_TEXT_PT,
    class_style,
    in_style,
    new_figure,
)
from fembridge.plots.waveform import shade_outside
from fembridge.stimulus import Stimulus
from fembridge.tables import SpikeTrain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Inches. A few rows are tall enough to see single spikes; many share a page.
_ROW_IN, _LEAST_ROW_IN, _TALL_ROWS = 0.26, 0.104, 10
_WAVEFORM_IN, _AROUND_IN = 0.5, 0.62

# A longer name of a stimulus is cut, or it would leave no room for its spikes.
_NAME_LETTERS = 28

# Share of a row that its spikes fill, and their width where rows are many.
_FILL = 0.78
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
        Spikes; those of one stimulus and class share a row, a line a repeat.
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
    rows = list(stimuli or dict.fromkeys(train.stimulus for train in trains))
    present = {train.afferent for train in trains}
    classes = list(afferents or [name for name in AFFERENT_COLOURS if name in present])
    if not rows or not classes:
        raise UsageError("no stimulus or no class to draw; name them if all are silent")
    if unknown := [name for name in classes if name not in AFFERENT_COLOURS]:
        raise UsageError(f"afferent {unknown[0]!r}, expected {', '.join(AFFERENT_COLOURS)}")
    if homeless := [train.stimulus for train in trains if train.stimulus not in rows]:
        raise UsageError(f"spikes of {homeless[0]}, which has no row")
    many = len(rows) > _TALL_ROWS
    rows_in = max(_ROW_IN * min(len(rows), _TALL_ROWS), _LEAST_ROW_IN * len(rows))
    heights_in = [_WAVEFORM_IN] * (waveform is not None) + [rows_in]
    figure, grid = new_figure(
        sum(heights_in) + _AROUND_IN,
        len(heights_in),
        len(classes),
        heights=heights_in,
        sharex=True,
        sharey="row",
    )
    ends_ms = [*(train.times_ms for train in trains), window_ms or (), (0.0, 1.0)]
    if waveform:
        ends_ms.append(waveform.times_ms[[0, -1]])
    every_ms = np.concatenate(ends_ms if span_ms is None else [span_ms])
    for afferent, column in zip(classes, grid.T, strict=True):
        panel = column[-1]
        mine = [train for train in trains if train.afferent == afferent]
        _draw_spikes(panel, mine, rows, _DENSE_LINE_PT if many else LINE_PT)
        panel.set(xlim=(every_ms.min(), every_ms.max()), ylim=(len(rows) - 0.5, -0.5))
        panel.set_xlabel("Time (ms)")
        panel.tick_params(axis="y", length=0.0)
        if window_ms:
            shade_outside(panel, window_ms)
        _part_families(panel, rows, many)
        if waveform:
            column[0].plot(waveform.times_ms, waveform.displacement_um, linewidth=HAIR_PT + 0.2)
            column[0].spines["bottom"].set_visible(False)
            column[0].tick_params(axis="x", bottom=False)
        column[0].set_title(afferent, **class_style(afferent, TEXT_PT + 1))
    size_pt = SMALL_TEXT_PT if rows_in / len(rows) >= _ROW_IN / 2 else TINY_TEXT_PT
    names = [_short(name) for name in rows]
    grid[-1, 0].set_yticks(range(len(rows)), names, fontsize=size_pt, parse_math=False)
    if waveform:
        whose = f"{_short(waveform.id)}\n" if len(rows) > 1 else ""
        style = {"rotation": 0, "ha": "right", "va": "center", "parse_math": False}
        grid[0, 0].set_ylabel(f"{whose}depth (µm)", **style)
    return figure


def _draw_spikes(
    panel: "Axes", trains: Sequence[SpikeTrain], rows: Sequence[str], line_pt: float
) -> None:
    """Draw all spikes of a panel; the repeats of a row lie under one another."""
    repeats = {name: sorted({t.repeat for t in trains if t.stimulus == name}) for name in rows}
    times_ms, tops, bottoms = [np.empty(0)], [np.empty(0)], [np.empty(0)]
    for train in trains:
        here = repeats[train.stimulus]
        lane = _FILL / len(here)
        middle = rows.index(train.stimulus) - _FILL / 2 + (here.index(train.repeat) + 0.5) * lane
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


def _part_families(panel: "Axes", rows: Sequence[str], many: bool) -> None:
    """Draw a line between two families of stimuli, and a thin one between many sets."""
    for row, (above, below) in enumerate(pairwise(rows)):
        if above.split("_")[0] != below.split("_")[0]:
            panel.axhline(row + 0.5, color=FAINT, zorder=-1)
        elif many and above.rpartition("_")[0] != below.rpartition("_")[0]:
            panel.axhline(row + 0.5, color=FAINT, linewidth=HAIR_PT / 2, zorder=-1)


def _short(name: str) -> str:
    return name if len(name) <= _NAME_LETTERS else f"{name[: _NAME_LETTERS - 1]}…"
