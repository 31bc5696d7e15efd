"""Spikes: raster, rate over time (PSTH), inter-spike intervals.

Each figure has one panel per class, with one row per stimulus: row k is at height k.
"""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge.errors import UsageError
from fembridge.io.spike_table import SpikeTrain
from fembridge.plots.style import (
    AFFERENT_COLOURS,
    FAINT,
    HAIR_PT,
    INK,
    LINE_PT,
    SMALL_TEXT_PT,
    TEXT_PT,
    TINY_TEXT_PT,
    class_style,
    explain_shade,
    in_style,
    new_figure,
    note,
    shade_outside,
    shorten_text,
)
from fembridge.plots.waveform_overview import draw_waveform
from fembridge.stimulus import Stimulus
from fembridge.typing import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from fembridge.plots.style import Panels

PSTH_BIN_MS, ISI_BIN_MS = 5.0, 1.0
MAX_BINS = 5000

# Inches: height of a row of at most `_TALL_ROWS` rows, and of each further row.
_RASTER_IN, _HISTOGRAM_IN, _TALL_ROWS = (0.26, 0.104), (0.42, 0.13), 10
# Inches: height of a unit or trial, and of all of them at most.
_LANE_IN, _LANES_IN = 0.1, 2.6
_WAVEFORM_IN, _MARGINS_IN, _LEGEND_IN, _NOTE_IN, _MIN_HEIGHT_IN = 0.5, 0.62, 0.22, 0.14, 0.42
# Inches: width at which a stimulus name is cut, row height below which it is small.
_NAME_IN, _SMALL_ROW_IN = 1.6, 0.13
# Share of a row that its spikes or its histogram fill.
_RASTER_SHARE, _HISTOGRAM_SHARE = 0.78, 0.86
_MOST_SCALES = 8  # with more rows their height is printed: an axis would not fit
_DENSE_LINE_PT = 0.65
# Space on the right of the longest interval for the number of intervals.
_ISI_MARGIN = 1.22
# Share of a bin by which a spike may precede an edge through rounding of its time.
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
    axes: "Panels | None" = None,
) -> "Figure":
    """Spikes: one panel per class, one row per stimulus, in it one line per unit and trial.

    Rows are `stimuli` from top to bottom, panels `afferents` from left to right, by default
    those of `trains`: name them if some are silent. The time axis is `span_ms`, by default from 0
    to the last spike or window end; the time outside `window_ms` (default: none) is shaded, and
    `waveform` (default: none) is drawn above. `axes`, one per class, are drawn into instead of a
    new figure, without the waveform and without a legend. Raises UsageError: nothing to draw, or
    another number of axes.
    """
    trains = list(trains)
    rows, classes = _rows_and_classes(trains, stimuli, afferents)
    x_axis = ("Time (ms)", *(span_ms or _time_span_ms(trains, window_ms, waveform)))
    lanes = max(Counter((train.stimulus, train.afferent) for train in trains).values(), default=1)
    lanes_in = min(_LANE_IN * lanes, _LANES_IN / len(rows))
    row_in = max(_RASTER_IN[0], lanes_in), _RASTER_IN[1]
    figure, panels = _grid(
        rows, classes, row_in, x_axis, window_ms=window_ms, waveform=waveform, axes=axes
    )
    line_pt = _DENSE_LINE_PT if len(rows) > _TALL_ROWS else LINE_PT
    for afferent, panel in zip(classes, panels, strict=True):
        _draw_spikes(
            panel, [train for train in trains if train.afferent == afferent], rows, line_pt
        )
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
    axes: "Panels | None" = None,
) -> "Figure":
    """Rate in bins of `bin_ms` (default 5 ms), mean over the cells or trials of `trains`.

    A silent cell counts if it is among `trains`. All rows of a class share a scale, the axis on
    the right of the panel, of many rows printed above it. The other arguments are those of
    `raster_figure`. Raises UsageError: nothing to draw, no bin width or too many bins.
    """
    trains = list(trains)
    rows, classes = _rows_and_classes(trains, stimuli, afferents)
    _, end_ms = _time_span_ms(trains, window_ms, waveform)
    edges_ms = bin_edges(end_ms, bin_ms)
    figure, _ = _histograms(
        rows,
        classes,
        [[psth(trains, name, afferent, edges_ms) for name in rows] for afferent in classes],
        edges_ms,
        ("Time (ms)", 0.0, float(edges_ms[-1])),
        "impulses/s",
        1.0,
        window_ms=window_ms,
        waveform=waveform,
        axes=axes,
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
    axes: "Panels | None" = None,
) -> "Figure":
    """Share of a row's intervals in bins of `bin_ms` (default 1 ms), with their number.

    Intervals are between consecutive spikes of one cell. The axis ends at `longest_ms`, by
    default the longest interval; shares are of all intervals, including those beyond the axis.
    The other arguments are those of `raster_figure`.
    Raises UsageError: nothing to draw, no bin width or too many bins.
    """
    trains = list(trains)
    rows, classes = _rows_and_classes(trains, stimuli, afferents)
    intervals = [[intervals_ms(trains, name, afferent) for name in rows] for afferent in classes]
    if longest_ms is not None and not longest_ms > 0:
        raise UsageError(argument="longest_ms", found=longest_ms, expected="more than 0")
    longest = max(
        [bin_ms, *(float(row_ms.max(initial=0)) for of_class in intervals for row_ms in of_class)]
    )
    edges_ms = bin_edges(longest_ms or longest + bin_ms / 2, bin_ms)
    figure, panels = _histograms(
        rows,
        classes,
        [
            [
                histogram(row_ms[row_ms < edges_ms[-1]], edges_ms) / max(row_ms.size, 1)
                for row_ms in of_class
            ]
            for of_class in intervals
        ],
        edges_ms,
        ("Inter-spike interval (ms)", 0.0, _ISI_MARGIN * float(edges_ms[-1])),
        "% of intervals",
        100.0,
        axes=axes,
    )
    for panel, of_class in zip(panels, intervals, strict=True):
        for row, row_ms in enumerate(of_class):
            if row_ms.size:
                frame = ("axes fraction", "data")
                style = {"ha": "right", "va": "center", "fontsize": TINY_TEXT_PT}
                note(panel, f"n = {row_ms.size}", (0.97, row), (0, 0), frame=frame, **style)
    return figure


def psth(
    trains: Iterable[SpikeTrain], stimulus: str, afferent: str, edges_ms: FloatArray
) -> FloatArray:
    """Rate ``(bin,)`` in impulses/s, mean over the trains of a stimulus and class; 0 if none."""
    times_ms = _train_times_ms(trains, stimulus, afferent)
    counts = histogram(np.concatenate([np.zeros(0), *times_ms]), edges_ms)
    rate_ips: FloatArray = counts * 1000.0 / (np.diff(edges_ms) * max(len(times_ms), 1))
    return rate_ips


def intervals_ms(trains: Iterable[SpikeTrain], stimulus: str, afferent: str) -> FloatArray:
    """Intervals in ms between consecutive spikes of each cell, all cells together."""
    return np.concatenate([np.zeros(0), *map(np.diff, _train_times_ms(trains, stimulus, afferent))])


def _train_times_ms(trains: Iterable[SpikeTrain], stimulus: str, afferent: str) -> list[FloatArray]:
    return [
        train.times_ms
        for train in trains
        if (train.stimulus, train.afferent) == (stimulus, afferent)
    ]


def bin_edges(end_ms: float, bin_ms: float) -> FloatArray:
    """Edges of bins of `bin_ms` from 0 to `end_ms` or the next edge after it."""
    if not (math.isfinite(bin_ms) and bin_ms > 0):
        raise UsageError(argument="bin_ms", found=bin_ms, expected="more than 0")
    count = max(1, math.ceil(end_ms / bin_ms - _EDGE_SHARE))
    if count > MAX_BINS:
        problem = f"is {bin_ms:g}, which makes {count} bins, expected at most {MAX_BINS}"
        raise UsageError(problem, argument="bin_ms", found=bin_ms)
    return bin_ms * np.arange(count + 1, dtype=np.float64)


def histogram(values_ms: FloatArray, edges_ms: FloatArray) -> FloatArray:
    """Number of values in bins of equal width ``(bin,)``; an edge belongs to the bin it begins."""
    shifted_ms = np.minimum(values_ms + _EDGE_SHARE * edges_ms[1], edges_ms[-1])
    return np.histogram(shifted_ms, edges_ms)[0].astype(np.float64)


def _rows_and_classes(
    trains: Sequence[SpikeTrain], stimuli: Sequence[str] | None, afferents: Sequence[str] | None
) -> tuple[list[str], list[str]]:
    """Rows and panels: `stimuli` and `afferents`, by default those of `trains`."""
    rows = list(stimuli or dict.fromkeys(train.stimulus for train in trains))
    present = {train.afferent for train in trains}
    classes = list(afferents or [name for name in AFFERENT_COLOURS if name in present])
    if not rows or not classes:
        raise UsageError("no stimulus or no class to draw; name them if all are silent")
    return rows, classes


def _time_span_ms(
    trains: Sequence[SpikeTrain], window_ms: tuple[float, float] | None, waveform: Stimulus | None
) -> tuple[float, float]:
    """From 0 or an earlier spike to the last spike or the end of window or waveform."""
    waveform_ms = [waveform.times_ms[[0, -1]]] if waveform else []
    ends_ms = [*(train.times_ms for train in trains), window_ms or (), *waveform_ms, (0.0, 1.0)]
    times_ms = np.concatenate(ends_ms)
    return float(times_ms.min()), float(times_ms.max())


def _grid(
    rows: Sequence[str],
    classes: Sequence[str],
    row_in: tuple[float, float],
    x_axis: tuple[str, float, float],
    notes: Sequence[str] = (),
    window_ms: tuple[float, float] | None = None,
    waveform: Stimulus | None = None,
    axes: "Panels | None" = None,
) -> "tuple[Figure, list[Axes]]":
    """Figure, and its panels from left to right.

    `row_in` are the row heights for few and for many rows, `x_axis` the label and limits of the
    time axis, `notes` the texts below the class names. `axes` have no room for the waveform.
    """
    if axes is not None:
        waveform = None
    few_rows_in, many_rows_in = row_in
    rows_in = max(
        few_rows_in * min(len(rows), _TALL_ROWS), many_rows_in * len(rows), _MIN_HEIGHT_IN
    )
    heights_in = [_WAVEFORM_IN] * (waveform is not None) + [rows_in]
    margins_in = _MARGINS_IN + _LEGEND_IN * bool(window_ms) + _NOTE_IN * bool(notes)
    figure, grid = new_figure(
        sum(heights_in) + margins_in,
        len(heights_in),
        len(classes),
        heights=heights_in,
        sharex=True,
        sharey="row",
        axes=axes,
    )
    if axes is not None:
        rows_in = grid[0, 0].get_position().height * figure.get_figheight()
    label, start, end = x_axis
    for index, (afferent, column) in enumerate(zip(classes, grid.T, strict=True)):
        panel = column[-1]
        panel.set(xlim=(start, end), ylim=(len(rows) - 0.5, -0.5), xlabel=label)
        panel.tick_params(axis="y", length=0.0)
        if window_ms:
            shade_outside(panel, window_ms)
        _separate_families(panel, rows)
        if waveform:
            draw_waveform(column[0], waveform, end_ms=end)
            panel.set_xlim(start, end)
            column[0].spines["bottom"].set_visible(False)
            column[0].tick_params(axis="x", bottom=False)
        pad = 5 + (SMALL_TEXT_PT + 3 if notes else 0)
        column[0].set_title(afferent, pad=pad, **class_style(afferent, TEXT_PT + 1))
        if notes:
            note(column[0], notes[index], (0.5, 1.0), (0, 4), ha="center", va="bottom")
    size_pt = SMALL_TEXT_PT if rows_in / len(rows) >= _SMALL_ROW_IN else TINY_TEXT_PT
    names = [shorten_text(name, _NAME_IN, size_pt) for name in rows]
    grid[-1, 0].set_yticks(range(len(rows)), names, fontsize=size_pt, parse_math=False)
    if waveform:
        prefix = f"{shorten_text(waveform.id, _NAME_IN)}\n" if len(rows) > 1 else ""
        style = {"rotation": 0, "ha": "right", "va": "center", "parse_math": False}
        grid[0, 0].set_ylabel(f"{prefix}Depth (µm)", **style)
    if window_ms and axes is None:
        explain_shade(figure, [window_ms])
    return figure, list(grid[-1])


def _separate_families(panel: "Axes", rows: Sequence[str]) -> None:
    """Draw a line between families of stimuli, and among many rows a thin one between sets."""
    for row, (above, below) in enumerate(pairwise(rows)):
        if above.split("_")[0] != below.split("_")[0]:
            panel.axhline(row + 0.5, color=FAINT, linewidth=LINE_PT, zorder=-1)
        elif len(rows) > _TALL_ROWS and above.rpartition("_")[0] != below.rpartition("_")[0]:
            panel.axhline(row + 0.5, color=FAINT, linewidth=HAIR_PT / 2, zorder=-1)


def _draw_spikes(
    panel: "Axes", trains: Sequence[SpikeTrain], rows: Sequence[str], line_pt: float
) -> None:
    """Draw all spikes of a panel; units and trials of a row are stacked."""
    units = list(dict.fromkeys(train.unit for train in trains))
    upper: list[float] = []
    lower: list[float] = []
    times_ms = [np.zeros(0)]
    for row, name in enumerate(rows):
        row_trains = [train for train in trains if train.stimulus == name]
        row_trains.sort(key=lambda train: (units.index(train.unit), train.cell, train.trial))
        lane = _RASTER_SHARE / max(len(row_trains), 1)
        half = lane / 2 if len(row_trains) == 1 else 0.42 * lane
        for index, train in enumerate(row_trains):
            middle = row - _RASTER_SHARE / 2 + (index + 0.5) * lane
            upper += [middle - half] * train.times_ms.size
            lower += [middle + half] * train.times_ms.size
            times_ms.append(train.times_ms)
    panel.vlines(
        np.concatenate(times_ms),
        upper,
        lower,
        colors=AFFERENT_COLOURS[trains[0].afferent] if trains else None,
        linewidths=line_pt,
        clip_on=False,  # keeps a spike on the last sample at full width
    )


def _histograms(
    rows: Sequence[str],
    classes: Sequence[str],
    histograms: Sequence[Sequence[FloatArray]],
    edges_ms: FloatArray,
    x_axis: tuple[str, float, float],
    unit: str,
    per_value: float,
    **options: Any,  # noqa: ANN401 - as `_grid` takes it
) -> "tuple[Figure, list[Axes]]":
    """Figure with one histogram per row; the highest of a class fills its row.

    `histograms` are by class and row; the axis of a row is in `unit`, `per_value` of a value.
    """
    tops = [max(float(row_values.max()) for row_values in of_class) for of_class in histograms]
    has_scales = len(rows) <= _MOST_SCALES
    notes = [
        "none" if not top else unit if has_scales else f"rows: 0 to {per_value * top:.3g} {unit}"
        for top in tops
    ]
    figure, panels = _grid(rows, classes, _HISTOGRAM_IN, x_axis, notes, **options)
    bin_ends = np.repeat(edges_ms, 2)[1:-1]
    for afferent, panel, of_class, top in zip(classes, panels, histograms, tops, strict=True):
        colour = AFFERENT_COLOURS[afferent]
        style: dict[str, Any] = {"facecolor": colour, "edgecolor": colour, "linewidth": HAIR_PT}
        for row, row_values in enumerate(of_class):
            floor, height = row + 0.5, np.repeat(row_values / (top or 1.0), 2)
            panel.axhline(floor, color=FAINT, linewidth=HAIR_PT, zorder=0)
            above = floor - _HISTOGRAM_SHARE * height
            panel.fill_between(bin_ends, floor, above, where=height > 0, clip_on=False, **style)
            if top and has_scales:
                _draw_scale(panel, floor, per_value * top)
    return figure, panels


def _draw_scale(panel: "Axes", floor: float, top: float) -> None:
    """Axis of a row on the right: 0 at the row's `floor`, and a round number up to `top`."""
    exponent = math.floor(math.log10(top))
    digit = max(digit for digit in (1, 2, 5) if digit * 10.0**exponent <= top * (1 + 1e-9))
    value = digit * 10.0**exponent
    end = floor - _HISTOGRAM_SHARE * value / top
    frame = panel.get_yaxis_transform()
    style: dict[str, Any] = {"color": INK, "linewidth": HAIR_PT, "clip_on": False}
    panel.plot([1.0, 1.0], [floor, end], transform=frame, **style)
    for place, text, side in ((floor, "0", "bottom"), (end, f"{value:g}", "center")):
        panel.plot([1.0, 1.012], [place, place], transform=frame, **style)
        panel.annotate(
            text,
            xy=(1.0, place),
            xycoords=frame,
            xytext=(3, 0),
            textcoords="offset points",
            va=side,
            fontsize=TINY_TEXT_PT,
            annotation_clip=False,
        )
