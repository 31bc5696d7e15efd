"""The figures of a validation: rates, regressions, a raster, thresholds.

A source looks the same in all: observed rates are black dots, TouchSim is grey, a model has
the colour of the class, the judged one thick or filled.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from decks.stimuli import number_text, resolve
from fembridge.plots.style import (
    AFFERENT_COLOURS,
    FAINT,
    HAIR_PT,
    INK,
    LINE_PT,
    MARKERS,
    PAGE_WIDTH_IN,
    SMALL_TEXT_PT,
    TEXT_PT,
    dots,
    legend_above,
    log_axis,
    make_plain,
    marks,
    new_figure,
)
from fembridge.report.rates import EVERY_SET, OBSERVED, TOUCHSIM, Family, RateTable, row_of
from fembridge.report.validate import PUBLISHED_NAME, REPEATS
from fembridge.stimulus import Stimulus
from fembridge.tables import AFFERENTS, SpikeTrain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame, Series

TOUCHSIM_COLOUR = "#808080"

_LEGEND_DOWN_IN = 0.12
_ROOM = 1.06
# Regression.
_MARK_PT = 3.8
_REGRESSION: dict[str, Any] = {"linewidth": 1.5 * LINE_PT, "dashes": (3.5, 1.6)}
_EQUAL: dict[str, Any] = {"color": FAINT, "linewidth": 1.6 * HAIR_PT}
# Thresholds: lanes of a block, one a frequency.
_LANE_IN, _BETWEEN_BLOCKS = 0.135, 0.9
_BAR_PT, _DOT_PT = 3.4, 4.2
# Raster.
_TRAIN_HEIGHT = 0.74


def source_title(source: str, judged: str) -> str:
    """Words for a source in figures and tables."""
    titles = {OBSERVED: "Observed", judged: "This model", PUBLISHED_NAME: "Published model"}
    if judged == PUBLISHED_NAME:
        titles[judged] = "Published model"
    return titles.get(source, source)


def _classes(source: str) -> tuple[str, ...]:
    """Classes that a legend has to show: a model has a colour of its own for each."""
    return AFFERENTS[:1] if source in (OBSERVED, TOUCHSIM) else AFFERENTS


def _colour(source: str, afferent: str) -> str:
    return {OBSERVED: INK, TOUCHSIM: TOUCHSIM_COLOUR}.get(source, AFFERENT_COLOURS[afferent])


def _curve(source: str, afferent: str, judged: str) -> dict[str, Any]:
    """Line of a source: dots, grey dashes, or the class colour."""
    colour = _colour(source, afferent)
    if source == OBSERVED:
        return {**dots(colour, 3.6), "zorder": 4}
    if source == TOUCHSIM:
        return {"color": colour, "linewidth": 1.3 * LINE_PT, "dashes": (4, 1.8), "zorder": 2}
    if source == judged:
        return {"color": colour, "linewidth": 2.2 * LINE_PT, "zorder": 3}
    return {"color": colour, "linewidth": 0.8 * LINE_PT, "zorder": 2.5}


def _name_figure(figure: "Figure", panels: Any, x: str, y: str = "") -> None:  # noqa: ANN401 - array
    """Name the axes once for all panels, close to the figure's edges."""
    left, right = panels[0, 0].get_position().x0, panels[0, -1].get_position().x1
    figure.supxlabel(
        x,
        x=(left + right) / 2,
        y=0.05 / figure.get_figheight(),
        va="bottom",
        fontsize=TEXT_PT,
        color=INK,
    )
    if y:
        figure.supylabel(y, x=0.03 / PAGE_WIDTH_IN, fontsize=TEXT_PT, color=INK)


def rate_figure(rates: RateTable, family: Family, judged: str) -> "Figure":
    """Rate against amplitude under every source: a row a class, a column a set."""
    from matplotlib.lines import Line2D

    sources = rates.known(family.stimuli)
    margins_in = (1.0, 0.1, 0.55, 0.44, 0.14, 0.17)
    figure, panels = new_figure(
        4.99, len(AFFERENTS), len(family.sets), margins_in=margins_in, sharey="row"
    )
    levels_um = [level for one in family.sets for level in one.level_um]
    for row, afferent in zip(panels, AFFERENTS, strict=True):
        for panel, one in zip(row, family.sets, strict=True):
            for source in sources:
                rate_ips = rates.of(source, afferent, one.stimuli)
                style = _curve(source, afferent, judged)
                panel.plot(one.level_um, rate_ips, clip_on=False, **style)
            log_axis(panel, min(levels_um) / 1.35, max(levels_um) * 1.35)
            make_plain(panel)
            panel.tick_params(axis="x", pad=3.5)
            panel.tick_params(axis="y", labelleft=panel is row[0])
        row[0].set_ylim(0.0, _ROOM * max(1.0, rates.largest_ips(afferent, family.stimuli)))
        row[0].annotate(
            afferent,
            (0.0, 0.5),
            xycoords="axes fraction",
            xytext=(-30, 0),
            textcoords="offset points",
            ha="right",
            va="center",
            fontsize=TEXT_PT + 2,
            fontweight="bold",
            color=AFFERENT_COLOURS[afferent],
            annotation_clip=False,
        )
    for panel, one in zip(panels[0], family.sets, strict=True):
        panel.set_title(one.title, fontsize=TEXT_PT, color=INK, pad=5)
    _name_figure(figure, panels, family.level_title, "Rate (impulses/s)")
    legend_above(
        figure,
        [tuple(Line2D([], [], **_curve(s, one, judged)) for one in _classes(s)) for s in sources],
        [source_title(source, judged) for source in sources],
        down_in=_LEGEND_DOWN_IN,
        size_pt=SMALL_TEXT_PT + 0.5,
        handlelength=3.4,
        columnspacing=2.2,
    )
    return figure


def regression_figure(
    rates: RateTable, agreement: "DataFrame", family: Family, reference: str, judged: str
) -> "Figure":
    """Predicted against reference rates: a column a class, a row a predicting source.

    Points, the line through them, and the line of equal rates.
    """
    from matplotlib.lines import Line2D
    from matplotlib.ticker import MaxNLocator

    sources = [name for name in rates.sources if name not in (reference, OBSERVED)]
    height_in = 0.78 + 0.44 + len(sources) * 1.5 + (len(sources) - 1) * 0.36
    margins_in = (0.95, 0.12, 0.78, 0.44, 0.42, 0.36)
    figure, panels = new_figure(
        height_in, len(sources), len(AFFERENTS), margins_in=margins_in, sharex="col", sharey="col"
    )
    for column, afferent in enumerate(AFFERENTS):
        top_ips = _ROOM * max(1.0, rates.largest_ips(afferent, family.stimuli))
        for panel, source in zip(panels[:, column], sources, strict=True):
            cell = row_of(agreement, reference, source, family.name, EVERY_SET, afferent)
            _draw_points(panel, rates, family, cell, _colour(source, afferent))
            make_plain(panel)
            panel.axline((0, 0), slope=1.0, zorder=1, **_EQUAL)
        panels[0, column].set(xlim=(0.0, top_ips), ylim=(0.0, top_ips))
        for axis in (panels[0, column].xaxis, panels[0, column].yaxis):
            axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
        panels[0, column].annotate(
            afferent,
            (0.5, 1.0),
            xycoords="axes fraction",
            xytext=(0, 20),
            textcoords="offset points",
            ha="center",
            fontsize=TEXT_PT + 1,
            fontweight="bold",
            color=AFFERENT_COLOURS[afferent],
            annotation_clip=False,
        )
    for panel, source in zip(panels[:, 0], sources, strict=True):
        panel.set_ylabel(source_title(source, judged), fontsize=TEXT_PT, color=INK)
    across = "Observed rate" if reference == OBSERVED else "TouchSim’s rate"
    _name_figure(figure, panels, f"{across} (impulses/s)", "Predicted rate (impulses/s)")
    samples = [Line2D([], [], **marks(m, INK, _MARK_PT)) for m in MARKERS[: len(family.sets)]]
    legend_above(
        figure,
        [*samples, Line2D([], [], color=INK, **_REGRESSION), Line2D([], [], **_EQUAL)],
        [*(one.title for one in family.sets), "regression", "equal rates"],
        down_in=_LEGEND_DOWN_IN,
        handlelength=1.8,
        columnspacing=1.3,
        handletextpad=0.5,
    )
    return figure


def _draw_points(
    panel: "Axes", rates: RateTable, family: Family, cell: "Series[Any]", colour: str
) -> None:
    words = "no rates to compare"
    if cell["count"]:
        reference, source, afferent = cell.reference, cell.source, cell.afferent
        for marker, one in zip(MARKERS, family.sets, strict=False):
            panel.plot(
                rates.of(reference, afferent, one.stimuli),
                rates.of(source, afferent, one.stimuli),
                **marks(marker, colour, _MARK_PT),
            )
        if math.isfinite(cell.slope):
            all_ips = rates.of(reference, afferent, family.stimuli)
            ends = np.array([np.nanmin(all_ips), np.nanmax(all_ips)])
            line_ips = cell.slope * ends + cell.intercept_ips
            panel.plot(ends, line_ips, color=colour, zorder=2, **_REGRESSION)
        share = "–" if math.isnan(cell.r_squared) else f"{cell.r_squared:.2f}"
        words = f"R² {share}, RMSE {cell.rmse_ips:.1f} ips"
    panel.set_title(words, loc="left", fontsize=SMALL_TEXT_PT, color=INK, pad=5)


def raster_figure(trains: Sequence[SpikeTrain], stimuli: Sequence[Stimulus]) -> "Figure":
    """Spikes of `repeated_trains`, as in Fig. 3 (a): a column an amplitude, a row a class.

    The waveform is above each column.
    """
    figure, panels = new_figure(
        3.5,
        1 + len(AFFERENTS),
        len(stimuli),
        margins_in=(0.78, 0.14, 0.3, 0.44, 0.178, 0.099),
        heights=(1.15, 1.0, 1.0, 1.0),
        sharey="row",
    )
    depth_um = np.array([stimulus.displacement_um for stimulus in stimuli])
    room_um = 0.08 * (depth_um.max() - depth_um.min())
    for column, stimulus in zip(panels.T, stimuli, strict=True):
        top, *rows = column
        top.axhline(0.0, color=FAINT, linewidth=HAIR_PT, zorder=1)
        top.plot(stimulus.times_ms, stimulus.displacement_um, color=INK, linewidth=LINE_PT)
        top.set_xlim(stimulus.times_ms[0], stimulus.times_ms[-1])
        top.set_ylim(depth_um.min() - room_um, depth_um.max() + room_um)
        make_plain(top)
        [entry] = resolve(stimulus.id)
        frequency, amplitude = map(number_text, entry.numbers().values())
        top.set_title(f"{frequency} Hz, {amplitude} µm", fontsize=TEXT_PT, color=INK, pad=4)
        for panel, afferent in zip(rows, AFFERENTS, strict=True):
            mine = [t for t in trains if (t.stimulus, t.afferent) == (stimulus.id, afferent)]
            _draw_trains(panel, mine, AFFERENT_COLOURS[afferent])
        for panel in column[:-1]:
            panel.spines["bottom"].set_visible(False)
            panel.tick_params(axis="x", bottom=False, labelbottom=False)
        column[-1].set_xlabel("Time (ms)", fontsize=TEXT_PT, color=INK)
    panels[0, 0].set_ylabel("Depth (µm)", fontsize=SMALL_TEXT_PT, color=INK)
    for panel, afferent in zip(panels[1:, 0], AFFERENTS, strict=True):
        panel.set_ylabel(
            afferent,
            rotation=0,
            ha="right",
            va="center",
            labelpad=16,
            fontsize=TEXT_PT + 2,
            fontweight="bold",
            color=AFFERENT_COLOURS[afferent],
        )
    return figure


def _draw_trains(panel: "Axes", trains: Sequence[SpikeTrain], colour: str) -> None:
    for train in trains:
        low, high = train.repeat - _TRAIN_HEIGHT / 2, train.repeat + _TRAIN_HEIGHT / 2
        style: dict[str, Any] = {"colors": colour, "linewidths": 1.2 * LINE_PT, "clip_on": False}
        panel.vlines(train.times_ms, low, high, **style)
    if not any(train.times_ms.size for train in trains):
        panel.text(
            0.5,
            0.5,
            "no spikes",
            transform=panel.transAxes,
            ha="center",
            va="center",
            fontsize=SMALL_TEXT_PT,
            color=INK,
        )
    panel.set_ylim(REPEATS + 0.6, 0.4)
    panel.set_yticks([1, REPEATS])
    make_plain(panel)
    panel.tick_params(axis="y", length=0.0)


def threshold_figure(thresholds: "DataFrame", judged: str) -> "Figure":
    """Each source's threshold as a mark and its plateau of 1:1 as a bar.

    A panel a class, a block a frequency.
    """
    from matplotlib.lines import Line2D

    table = thresholds
    sources, frequencies_hz = list(table.source.unique()), sorted(table.frequency_hz.unique())
    block = len(sources) + _BETWEEN_BLOCKS
    lanes = block * len(frequencies_hz)
    figure, panels = new_figure(
        1.0 + lanes * _LANE_IN,
        1,
        len(AFFERENTS),
        margins_in=(0.62, 0.12, 0.56, 0.44, 0.16, 0.0),
    )
    for panel, afferent in zip(panels[0], AFFERENTS, strict=True):
        for row in table[table.afferent == afferent].itertuples():
            lane = frequencies_hz.index(row.frequency_hz) * block + sources.index(row.source)
            _draw_threshold(panel, row, lane, judged)
        for k in range(1, len(frequencies_hz)):
            between = k * block - (1 + _BETWEEN_BLOCKS) / 2
            panel.axhline(between, color=FAINT, linewidth=HAIR_PT, zorder=0)
        log_axis(panel, table.lowest_tried_um.min() / 1.5, table.highest_tried_um.max() * 1.5)
        panel.set_ylim(lanes - _BETWEEN_BLOCKS / 2 - 0.5, -0.9)
        make_plain(panel)
        panel.tick_params(axis="y", length=0.0, labelsize=SMALL_TEXT_PT)
        panel.spines["left"].set_visible(False)
        middles = [k * block + (len(sources) - 1) / 2 for k in range(len(frequencies_hz))]
        panel.set_yticks(middles, [f"{frequency_hz:g} Hz" for frequency_hz in frequencies_hz])
        style: dict[str, Any] = {"fontsize": TEXT_PT + 1, "fontweight": "bold", "pad": 5}
        panel.set_title(afferent, color=AFFERENT_COLOURS[afferent], **style)
    _name_figure(figure, panels, "Amplitude (µm)")
    legend_above(
        figure,
        [
            *(
                tuple(
                    Line2D([], [], **_threshold_mark("o", source, one, judged))
                    for one in _classes(source)
                )
                for source in sources
            ),
            Line2D([], [], color=INK, linewidth=_BAR_PT, solid_capstyle="butt"),
            Line2D([], [], **marks(">", INK, _DOT_PT, filled=True)),
        ],
        [
            *(source_title(source, judged) for source in sources),
            *("one impulse a cycle", "none up to here"),
        ],
        down_in=_LEGEND_DOWN_IN,
        pad=0.2,
        handlelength=1.9,
        columnspacing=1.3,
        handletextpad=0.5,
    )
    return figure


def _threshold_mark(marker: str, source: str, afferent: str, judged: str) -> dict[str, Any]:
    filled = source in (OBSERVED, TOUCHSIM, judged)
    return marks(marker, _colour(source, afferent), _DOT_PT, filled=filled)


def _draw_threshold(panel: "Axes", row: Any, lane: float, judged: str) -> None:  # noqa: ANN401 - row
    tried_um = [row.lowest_tried_um, row.highest_tried_um]
    panel.plot(tried_um, [lane, lane], color=FAINT, linewidth=HAIR_PT, zorder=1)
    if not math.isnan(row.plateau_low_um):
        panel.plot(
            [row.plateau_low_um, row.plateau_high_um],
            [lane, lane],
            color=_colour(row.source, row.afferent),
            linewidth=_BAR_PT if row.source in (OBSERVED, TOUCHSIM, judged) else 0.5 * _BAR_PT,
            solid_capstyle="butt",
            zorder=2,
        )
    above = math.isinf(row.threshold_um)
    style = _threshold_mark(">" if above else "o", row.source, row.afferent, judged)
    panel.plot([row.highest_tried_um if above else row.threshold_um], [lane], **style)
