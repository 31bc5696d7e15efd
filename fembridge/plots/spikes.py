"""Spikes: a raster, rates over time (PSTH), inter-spike intervals.

All are one grid, a panel a class, in it a row a stimulus: row k is at the height k.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

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
    explain_shade,
    fitting,
    in_style,
    new_figure,
    note,
    shade_outside,
)
from fembridge.plots.waveform import draw_waveform
from fembridge.stimulus import Stimulus
from fembridge.tables import SpikeTrain
from fembridge.typing import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PSTH_BIN_MS, ISI_BIN_MS = 5.0, 1.0
MOST_BINS = 5000

# Inches; a row's full height, of `_TALL_ROWS` and fewer, and the least of many.
_RASTER_IN, _HISTOGRAM_IN, _TALL_ROWS = (0.26, 0.104), (0.42, 0.13), 10
# A unit or repeat, where all together are no higher than this.
_LANE_IN, _LANES_IN = 0.1, 2.6
_WAVEFORM_IN, _AROUND_IN, _LEGEND_IN, _NOTE_IN, _LEAST_IN = 0.5, 0.62, 0.22, 0.14, 0.42
# A longer name of a stimulus is cut; up to this height of a row its name is small.
_NAME_IN, _SMALL_ROW_IN = 1.6, 0.13
# Share of a row that its spikes or its histogram fill.
_FILL, _FULL = 0.78, 0.86
_DENSE_LINE_PT = 0.65
# Right of the longest interval stands how many there are.
_ISI_ROOM = 1.22
# Spike times are multiples of a step that has rounding: one on an edge begins a bin.
_EDGE_SHARE = 1e-6


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
    """Spikes: a panel a class, a row a stimulus, in it a line a unit and repeat.

    Rows are `stimuli` from top to bottom, panels `afferents` from left to right, by default
    those of `trains`: name them where some are silent. The time axis is `span_ms`, by default
    from 0 to the last spike or window end; what is outside `window_ms` gets a grey ground, and
    `waveform` is drawn above. Raises UsageError: nothing to draw.
    """
    trains = list(trains)
    rows, classes = _rows_and_classes(trains, stimuli, afferents)
    x = ("Time (ms)", *(span_ms or _span_ms(trains, window_ms, waveform)))
    lanes = max(Counter((t.stimulus, t.afferent) for t in trains).values(), default=1)
    lanes_in = min(_LANE_IN * lanes, _LANES_IN / len(rows))
    row_in = max(_RASTER_IN[0], lanes_in), _RASTER_IN[1]
    figure, panels = _grid(rows, classes, row_in, x, window_ms=window_ms, waveform=waveform)
    line_pt = _DENSE_LINE_PT if len(rows) > _TALL_ROWS else LINE_PT
    for afferent, panel in zip(classes, panels, strict=True):
        _draw_spikes(panel, [one for one in trains if one.afferent == afferent], rows, line_pt)
    return figure


@in_style
def psth_figure(
    trains: Iterable[SpikeTrain],
    *,
    bin_ms: float = PSTH_BIN_MS,
    stimuli: Sequence[str] | None = None,
    afferents: Sequence[str] | None = None,
    window_ms: tuple[float, float] | None = None,
    waveform: Stimulus | None = None,
) -> "Figure":
    """Rate in each bin of `bin_ms`, mean over the cells or repeats that `trains` have.

    A silent cell counts where it is among `trains`. All rows of a class share a scale, which stands
    below its name. The other arguments are those of a raster. Raises UsageError: nothing to draw,
    no bin width or too many bins.
    """
    trains = list(trains)
    rows, classes = _rows_and_classes(trains, stimuli, afferents)
    _, end_ms = _span_ms(trains, window_ms, waveform)
    edges_ms = bins(end_ms, bin_ms)
    figure, _ = _histograms(
        rows,
        classes,
        [[psth(trains, name, one, edges_ms) for name in rows] for one in classes],
        edges_ms,
        ("Time (ms)", 0.0, float(edges_ms[-1])),
        lambda top: f"row height: {top:.3g} impulses/s" if top else "no spikes",
        window_ms=window_ms,
        waveform=waveform,
    )
    return figure


@in_style
def isi_figure(
    trains: Iterable[SpikeTrain],
    *,
    bin_ms: float = ISI_BIN_MS,
    longest_ms: float | None = None,
    stimuli: Sequence[str] | None = None,
    afferents: Sequence[str] | None = None,
) -> "Figure":
    """Share of a row's intervals in each bin of `bin_ms`; how many there are is beside it.

    Intervals are those between neighbouring spikes of one cell. The axis ends at `longest_ms`, by
    default the longest interval of all; shares are of all intervals, drawn or not. Raises
    UsageError: nothing to draw, no bin width or too many bins.
    """
    trains = list(trains)
    rows, classes = _rows_and_classes(trains, stimuli, afferents)
    found = [[intervals_ms(trains, name, one) for name in rows] for one in classes]
    if longest_ms is not None and not longest_ms > 0:
        raise UsageError(f"longest interval {longest_ms:g} ms, expected more than 0")
    longest = max([bin_ms, *(float(each.max(initial=0)) for one in found for each in one)])
    edges_ms = bins(longest_ms or longest + bin_ms / 2, bin_ms)
    figure, panels = _histograms(
        rows,
        classes,
        [
            [histogram(one[one < edges_ms[-1]], edges_ms) / max(one.size, 1) for one in of_class]
            for of_class in found
        ],
        edges_ms,
        ("Inter-spike interval (ms)", 0.0, _ISI_ROOM * float(edges_ms[-1])),
        lambda top: f"row height: {100 * top:.3g} % of intervals" if top else "none",
    )
    for panel, of_class in zip(panels, found, strict=True):
        for row, each in enumerate(of_class):
            if each.size:
                frame = ("axes fraction", "data")
                style = {"ha": "right", "va": "center", "fontsize": TINY_TEXT_PT}
                note(panel, f"n = {each.size}", (1.0, row), (0, 0), frame=frame, **style)
    return figure


def psth(
    trains: Iterable[SpikeTrain], stimulus: str, afferent: str, edges_ms: FloatArray
) -> FloatArray:
    """Rate ``(bin,)`` in impulses/s of the mean train of a stimulus and class; 0 of none."""
    mine = _times_ms(trains, stimulus, afferent)
    counts = histogram(np.concatenate([np.zeros(0), *mine]), edges_ms)
    rate_ips: FloatArray = counts * 1000.0 / (np.diff(edges_ms) * max(len(mine), 1))
    return rate_ips


def intervals_ms(trains: Iterable[SpikeTrain], stimulus: str, afferent: str) -> FloatArray:
    """Intervals between neighbouring spikes of each cell, all cells together."""
    return np.concatenate([np.zeros(0), *map(np.diff, _times_ms(trains, stimulus, afferent))])


def _times_ms(trains: Iterable[SpikeTrain], stimulus: str, afferent: str) -> list[FloatArray]:
    return [t.times_ms for t in trains if (t.stimulus, t.afferent) == (stimulus, afferent)]


def bins(end_ms: float, bin_ms: float) -> FloatArray:
    """Edges of bins of `bin_ms` from 0 on, the last one at `end_ms` or beyond."""
    if not (math.isfinite(bin_ms) and bin_ms > 0):
        raise UsageError(f"bins of {bin_ms:g} ms, expected more than 0")
    count = max(1, math.ceil(end_ms / bin_ms - _EDGE_SHARE))
    if count > MOST_BINS:
        raise UsageError(f"{count} bins of {bin_ms:g} ms, expected at most {MOST_BINS}: widen them")
    return bin_ms * np.arange(count + 1, dtype=np.float64)


def histogram(values_ms: FloatArray, edges_ms: FloatArray) -> FloatArray:
    """Numbers of values in even bins ``(bin,)``; one on an edge is in the bin it begins."""
    shifted_ms = np.minimum(values_ms + _EDGE_SHARE * edges_ms[1], edges_ms[-1])
    return np.histogram(shifted_ms, edges_ms)[0].astype(np.float64)


def _rows_and_classes(
    trains: Sequence[SpikeTrain], stimuli: Sequence[str] | None, afferents: Sequence[str] | None
) -> tuple[list[str], list[str]]:
    """Rows and panels: what is asked for, else what `trains` have."""
    rows = list(stimuli or dict.fromkeys(train.stimulus for train in trains))
    present = {train.afferent for train in trains}
    classes = list(afferents or [name for name in AFFERENT_COLOURS if name in present])
    if not rows or not classes:
        raise UsageError("no stimulus or no class to draw; name them if all are silent")
    return rows, classes


def _span_ms(
    trains: Sequence[SpikeTrain], window_ms: tuple[float, float] | None, waveform: Stimulus | None
) -> tuple[float, float]:
    """From 0, or an earlier spike, to the last spike, or the end of window or waveform."""
    waves_ms = [waveform.times_ms[[0, -1]]] if waveform else []
    ends_ms = [*(train.times_ms for train in trains), window_ms or (), *waves_ms, (0.0, 1.0)]
    every_ms = np.concatenate(ends_ms)
    return float(every_ms.min()), float(every_ms.max())


def _grid(
    rows: Sequence[str],
    classes: Sequence[str],
    row_in: tuple[float, float],
    x: tuple[str, float, float],
    notes: Sequence[str] = (),
    window_ms: tuple[float, float] | None = None,
    waveform: Stimulus | None = None,
) -> "tuple[Figure, list[Axes]]":
    """Figure, and its panels from left to right.

    `row_in` are the heights of a row of a few and of many, `x` words and ends of the axis,
    `notes` what is said below the name of each class.
    """
    tall_in, least_in = row_in
    rows_in = max(tall_in * min(len(rows), _TALL_ROWS), least_in * len(rows), _LEAST_IN)
    heights_in = [_WAVEFORM_IN] * (waveform is not None) + [rows_in]
    around_in = _AROUND_IN + _LEGEND_IN * bool(window_ms) + _NOTE_IN * bool(notes)
    figure, grid = new_figure(
        sum(heights_in) + around_in,
        len(heights_in),
        len(classes),
        heights=heights_in,
        sharex=True,
        sharey="row",
    )
    words, start, end = x
    for place, (afferent, column) in enumerate(zip(classes, grid.T, strict=True)):
        panel = column[-1]
        panel.set(xlim=(start, end), ylim=(len(rows) - 0.5, -0.5), xlabel=words)
        panel.tick_params(axis="y", length=0.0)
        if window_ms:
            shade_outside(panel, window_ms)
        _part_families(panel, rows)
        if waveform:
            draw_waveform(column[0], waveform, end_ms=end)
            panel.set_xlim(start, end)
            column[0].spines["bottom"].set_visible(False)
            column[0].tick_params(axis="x", bottom=False)
        pad = 5 + (SMALL_TEXT_PT + 3 if notes else 0)
        column[0].set_title(afferent, pad=pad, **class_style(afferent, TEXT_PT + 1))
        if notes:
            note(column[0], notes[place], (0.5, 1.0), (0, 4), ha="center", va="bottom")
    size_pt = SMALL_TEXT_PT if rows_in / len(rows) >= _SMALL_ROW_IN else TINY_TEXT_PT
    names = [fitting(name, _NAME_IN, size_pt) for name in rows]
    grid[-1, 0].set_yticks(range(len(rows)), names, fontsize=size_pt, parse_math=False)
    if waveform:
        whose = f"{fitting(waveform.id, _NAME_IN)}\n" if len(rows) > 1 else ""
        style = {"rotation": 0, "ha": "right", "va": "center", "parse_math": False}
        grid[0, 0].set_ylabel(f"{whose}Depth (µm)", **style)
    if window_ms:
        explain_shade(figure, [window_ms])
    return figure, list(grid[-1])


def _part_families(panel: "Axes", rows: Sequence[str]) -> None:
    """Draw a line between two families of stimuli, and a thin one between many sets."""
    for row, (above, below) in enumerate(pairwise(rows)):
        if above.split("_")[0] != below.split("_")[0]:
            panel.axhline(row + 0.5, color=FAINT, linewidth=LINE_PT, zorder=-1)
        elif len(rows) > _TALL_ROWS and above.rpartition("_")[0] != below.rpartition("_")[0]:
            panel.axhline(row + 0.5, color=FAINT, linewidth=HAIR_PT / 2, zorder=-1)


def _draw_spikes(
    panel: "Axes", trains: Sequence[SpikeTrain], rows: Sequence[str], line_pt: float
) -> None:
    """Draw all spikes of a panel; units and repeats of a row lie under one another."""
    units = list(dict.fromkeys(train.unit for train in trains))
    upper: list[float] = []
    lower: list[float] = []
    times_ms = [np.zeros(0)]
    for row, name in enumerate(rows):
        mine = [train for train in trains if train.stimulus == name]
        mine.sort(key=lambda train: (units.index(train.unit), train.repeat))
        lane = _FILL / max(len(mine), 1)
        half = lane / 2 if len(mine) == 1 else 0.42 * lane
        for place, train in enumerate(mine):
            middle = row - _FILL / 2 + (place + 0.5) * lane
            upper += [middle - half] * train.times_ms.size
            lower += [middle + half] * train.times_ms.size
            times_ms.append(train.times_ms)
    panel.vlines(
        np.concatenate(times_ms),
        upper,
        lower,
        colors=AFFERENT_COLOURS[trains[0].afferent] if trains else None,
        linewidths=line_pt,
        clip_on=False,  # a spike on the last sample is as thick as any
    )


def _histograms(
    rows: Sequence[str],
    classes: Sequence[str],
    found: Sequence[Sequence[FloatArray]],
    edges_ms: FloatArray,
    x: tuple[str, float, float],
    words: Callable[[float], str],
    **shown: Any,  # noqa: ANN401 - as `_grid` takes it
) -> "tuple[Figure, list[Axes]]":
    """Figure with a histogram a row, `found` by class and row, the highest of a class full.

    `words` say how high that is.
    """
    tops = [max(float(each.max()) for each in of_class) for of_class in found]
    notes = [words(top) for top in tops]
    figure, panels = _grid(rows, classes, _HISTOGRAM_IN, x, notes, **shown)
    ends = np.repeat(edges_ms, 2)[1:-1]
    for afferent, panel, of_class, top in zip(classes, panels, found, tops, strict=True):
        colour = AFFERENT_COLOURS[afferent]
        style: dict[str, Any] = {"facecolor": colour, "edgecolor": colour, "linewidth": HAIR_PT}
        for row, each in enumerate(of_class):
            floor, height = row + 0.5, np.repeat(each / (top or 1.0), 2)
            panel.axhline(floor, color=FAINT, linewidth=HAIR_PT, zorder=0)
            above = floor - _FULL * height
            panel.fill_between(ends, floor, above, where=height > 0, clip_on=False, **style)
    return figure, panels
