"""The grid of a raster or of histograms: a panel a class, a row a stimulus."""

from collections.abc import Iterable, Sequence
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

# Inches.
_WAVEFORM_IN, _AROUND_IN, _LEGEND_IN, _NOTE_IN, _LEAST_IN = 0.5, 0.62, 0.22, 0.14, 0.42
# A longer name of a stimulus is cut, or it would leave no room for its row.
_NAME_IN = 1.6
# Of this many rows and fewer each has its full height.
_TALL_ROWS = 10
# Up to this height a row's name is small.
_SMALL_ROW_IN = 0.13

# Share of a row that its histogram fills.
_FULL = 0.86


def rows_and_classes(
    trains: Sequence[SpikeTrain],
    stimuli: Sequence[str] | None = None,
    afferents: Sequence[str] | None = None,
) -> tuple[list[str], list[str]]:
    """Rows and panels: what is asked for, else what `trains` have.

    Raises
    ------
    UsageError
        Nothing to draw, or spikes that have no row.
    """
    rows = list(stimuli or dict.fromkeys(train.stimulus for train in trains))
    present = {train.afferent for train in trains}
    classes = list(afferents or [name for name in AFFERENT_COLOURS if name in present])
    if not rows or not classes:
        raise UsageError("no stimulus or no class to draw; name them if all are silent")
    if unknown := [name for name in classes if name not in AFFERENT_COLOURS]:
        raise UsageError(f"afferent {unknown[0]!r}, expected {', '.join(AFFERENT_COLOURS)}")
    if homeless := [train.stimulus for train in trains if train.stimulus not in rows]:
        raise UsageError(f"spikes of {homeless[0]}, which has no row")
    return rows, classes


def rows_figure(
    rows: Sequence[str],
    classes: Sequence[str],
    row_in: tuple[float, float],
    *,
    x: tuple[str, float, float],
    window_ms: tuple[float, float] | None = None,
    waveform: Stimulus | None = None,
    notes: Sequence[str] = (),
) -> "tuple[Figure, list[Axes]]":
    """Figure, and its panels from left to right, in which row k is at the height k.

    Parameters
    ----------
    row_in
        Height of one of a few rows, and the least one of many, in inches.
    x
        Words and ends of the axis that all panels share.
    window_ms
        Where spikes were counted; what is outside gets a grey ground, and the legend
        says so.
    waveform
        A stimulus to draw above the panels.
    notes
        What is said below the name of each class.
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


def draw_histograms(
    panel: "Axes", heights: Iterable[FloatArray], edges: FloatArray, colour: str
) -> None:
    """Draw a histogram into each row, ``(bin,)`` from 0 to 1, which is the full height."""
    ends = np.repeat(edges, 2)[1:-1]
    for row, height in enumerate(heights):
        floor = row + 0.5
        panel.axhline(floor, color=FAINT, linewidth=HAIR_PT, zorder=0)
        top = floor - _FULL * np.repeat(height, 2)
        there = np.repeat(height, 2) > 0
        style: dict[str, Any] = {"facecolor": colour, "edgecolor": colour, "linewidth": HAIR_PT}
        panel.fill_between(ends, floor, top, where=there, clip_on=False, **style)


def _part_families(panel: "Axes", rows: Sequence[str]) -> None:
    """Draw a line between two families of stimuli, and a thin one between many sets."""
    for row, (above, below) in enumerate(pairwise(rows)):
        if above.split("_")[0] != below.split("_")[0]:
            panel.axhline(row + 0.5, color=FAINT, linewidth=LINE_PT, zorder=-1)
        elif len(rows) > _TALL_ROWS and above.rpartition("_")[0] != below.rpartition("_")[0]:
            panel.axhline(row + 0.5, color=FAINT, linewidth=HAIR_PT / 2, zorder=-1)
