"""Rasters of spikes: one panel a class, one row a stimulus."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from fembridge.errors import UsageError
from fembridge.plots.style import (
    AFFERENT_COLOURS,
    FAINT,
    HAIR_PT,
    INK,
    LINE_PT,
    PAGE_WIDTH_IN,
    SHADE,
    SMALL_TEXT_PT,
    TEXT_PT,
    TINY_TEXT_PT,
    make_plain,
)
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
    from matplotlib.figure import Figure

    trains = list(trains)
    rows = list(stimuli or dict.fromkeys(train.stimulus for train in trains))
    present = {train.afferent for train in trains}
    classes = list(afferents or [name for name in AFFERENT_COLOURS if name in present])
    _check(trains, rows, classes)
    span = span_ms or _span(trains, window_ms, waveform)
    rows_in = _ROW_IN * len(rows)
    if len(rows) > _TALL_ROWS:
        rows_in = max(_ROW_IN * _TALL_ROWS, _LEAST_ROW_IN * len(rows))
    heights_in = [_WAVEFORM_IN, rows_in] if waveform else [rows_in]
    figure = Figure(figsize=(PAGE_WIDTH_IN, sum(heights_in) + _AROUND_IN), layout="constrained")
    grid = figure.subplots(
        len(heights_in),
        len(classes),
        squeeze=False,
        sharex=True,
        sharey="row",
        gridspec_kw={"height_ratios": heights_in},
    )
    for column, afferent in enumerate(classes):
        panel = grid[-1, column]
        mine = [train for train in trains if train.afferent == afferent]
        _draw_spikes(panel, mine, rows, span, AFFERENT_COLOURS[afferent])
        _draw_ground(panel, rows, span, window_ms)
        if waveform:
            _draw_waveform(grid[0, column], waveform)
        grid[0, column].set_title(
            afferent, color=AFFERENT_COLOURS[afferent], fontsize=TEXT_PT + 1, fontweight="bold"
        )
    _label_rows(grid[-1, 0], rows, rows_in / len(rows))
    if waveform:
        whose = f"{_short(waveform.id)}\n" if len(rows) > 1 else ""
        grid[0, 0].set_ylabel(
            f"{whose}depth (µm)",
            fontsize=SMALL_TEXT_PT,
            color=INK,
            rotation=0,
            ha="right",
            va="center",
            parse_math=False,
        )
    return figure


def _check(trains: Sequence[SpikeTrain], rows: Sequence[str], classes: Sequence[str]) -> None:
    if not rows or not classes:
        raise UsageError("no stimulus or no class to draw; name them if all are silent")
    unknown = [name for name in classes if name not in AFFERENT_COLOURS]
    if unknown:
        raise UsageError(f"afferent {unknown[0]!r}, expected {', '.join(AFFERENT_COLOURS)}")
    for train in trains:
        if train.stimulus not in rows:
            raise UsageError(f"spikes of {train.stimulus}, which has no row")


def _span(
    trains: Sequence[SpikeTrain], window_ms: tuple[float, float] | None, waveform: Stimulus | None
) -> tuple[float, float]:
    times = [train.times_ms for train in trains]
    if window_ms:
        times.append(np.array(window_ms))
    if waveform:
        times.append(waveform.times_ms[[0, -1]])
    every_ms = np.concatenate([*times, [0.0, 1.0]])
    return float(every_ms.min()), float(every_ms.max())


def _draw_spikes(
    panel: "Axes",
    trains: Sequence[SpikeTrain],
    rows: Sequence[str],
    span_ms: tuple[float, float],
    colour: str,
) -> None:
    """Draw all spikes of a panel; the repeats of a row lie under one another."""
    repeats: dict[str, list[int]] = {}
    for train in trains:
        repeats.setdefault(train.stimulus, []).append(train.repeat)
    start, end = span_ms
    times_ms, middles, halves = [np.empty(0)], [np.empty(0)], [np.empty(0)]
    for train in trains:
        here = sorted(set(repeats[train.stimulus]))
        lane = _FILL / len(here)
        top = rows.index(train.stimulus) - _FILL / 2
        middle = top + (here.index(train.repeat) + 0.5) * lane
        half = lane / 2 if len(here) == 1 else 0.42 * lane
        shown = train.times_ms[(train.times_ms >= start) & (train.times_ms <= end)]
        times_ms.append(shown)
        middles.append(np.full(shown.size, middle))
        halves.append(np.full(shown.size, half))
    centres, reach = np.concatenate(middles), np.concatenate(halves)
    panel.vlines(
        np.concatenate(times_ms),
        centres - reach,
        centres + reach,
        colors=colour,
        linewidths=LINE_PT if len(rows) <= _TALL_ROWS else _DENSE_LINE_PT,
        clip_on=False,  # a spike on the last sample is as thick as any
    )


def _draw_ground(
    panel: "Axes",
    rows: Sequence[str],
    span_ms: tuple[float, float],
    window_ms: tuple[float, float] | None,
) -> None:
    """Draw what is behind the spikes: axes, window, lines between families."""
    start, end = span_ms
    panel.set_xlim(start, end)
    panel.set_ylim(len(rows) - 0.5, -0.5)
    if window_ms:
        for left, right in ((start, window_ms[0]), (window_ms[1], end)):
            if right > left:
                panel.axvspan(left, right, facecolor=SHADE, linewidth=0, zorder=-2)
    families = [name.split("_")[0] for name in rows]
    series = [name.rpartition("_")[0] for name in rows]
    for row in range(1, len(rows)):
        if families[row] != families[row - 1]:
            panel.axhline(row - 0.5, color=FAINT, linewidth=LINE_PT, zorder=-1)
        elif series[row] != series[row - 1] and len(rows) > _TALL_ROWS:
            panel.axhline(row - 0.5, color=FAINT, linewidth=HAIR_PT / 2, zorder=-1)
    make_plain(panel)
    panel.tick_params(axis="y", length=0.0)
    panel.set_xlabel("Time (ms)", fontsize=SMALL_TEXT_PT, color=INK)


def _draw_waveform(panel: "Axes", waveform: Stimulus) -> None:
    panel.plot(waveform.times_ms, waveform.displacement_um, color=INK, linewidth=HAIR_PT + 0.2)
    make_plain(panel)
    panel.spines["bottom"].set_visible(False)
    panel.tick_params(axis="x", bottom=False, labelbottom=False)


def _label_rows(panel: "Axes", rows: Sequence[str], row_in: float) -> None:
    size = SMALL_TEXT_PT if row_in >= _ROW_IN / 2 else TINY_TEXT_PT
    names = [_short(name) for name in rows]
    panel.set_yticks(range(len(rows)), names, fontsize=size, parse_math=False)


def _short(name: str) -> str:
    return name if len(name) <= _NAME_LETTERS else f"{name[: _NAME_LETTERS - 1]}…"
