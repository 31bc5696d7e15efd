"""Thresholds and entrainment: a panel a class, a block a frequency."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from fembridge.plots.palette import (
    AFFERENT_COLOURS,
    FAINT,
    HAIR_PT,
    INK,
    PAGE_WIDTH_IN,
    SMALL_TEXT_PT,
    TEXT_PT,
)
from fembridge.plots.picture import make_plain
from fembridge.tables import AFFERENTS
from fembridge.validation.compared_rates import OBSERVED, TOUCHSIM
from fembridge.validation.source_style import TOUCHSIM_COLOUR, source_title
from fembridge.validation.threshold_row import ThresholdRow

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Inches.
_LANE_IN, _BETWEEN_BLOCKS = 0.135, 0.9
_LEFT_IN, _RIGHT_IN, _TOP_IN, _BOTTOM_IN = 0.62, 0.12, 0.56, 0.44
_BETWEEN_IN = 0.16
_LEGEND_DOWN_IN = 0.12
_BAR_PT, _DOT_PT = 3.4, 4.2
_ROOM = 1.5


def threshold_figure(rows: Sequence[ThresholdRow], judged: str) -> "Figure":
    """Draw each source's threshold as a mark and its plateau of 1:1 as a bar."""
    from matplotlib.figure import Figure

    sources = list(dict.fromkeys(row.source for row in rows))
    frequencies_hz = sorted({row.frequency_hz for row in rows})
    block = len(sources) + _BETWEEN_BLOCKS
    lanes = block * len(frequencies_hz)
    height_in = _TOP_IN + _BOTTOM_IN + lanes * _LANE_IN
    room_in = PAGE_WIDTH_IN - _LEFT_IN - _RIGHT_IN
    column_in = (room_in - (len(AFFERENTS) - 1) * _BETWEEN_IN) / len(AFFERENTS)
    figure = Figure(figsize=(PAGE_WIDTH_IN, height_in))
    panels = figure.subplots(
        1,
        len(AFFERENTS),
        squeeze=False,
        sharex=True,
        sharey=True,
        gridspec_kw={
            "left": _LEFT_IN / PAGE_WIDTH_IN,
            "right": 1 - _RIGHT_IN / PAGE_WIDTH_IN,
            "top": 1 - _TOP_IN / height_in,
            "bottom": _BOTTOM_IN / height_in,
            "wspace": _BETWEEN_IN / column_in,
        },
    )[0]
    middles = [k * block + (len(sources) - 1) / 2 for k in range(len(frequencies_hz))]
    for panel, afferent in zip(panels, AFFERENTS, strict=True):
        for row in rows:
            if row.afferent == afferent:
                lane = frequencies_hz.index(row.frequency_hz) * block
                lane += sources.index(row.source)
                _draw_row(panel, row, lane, judged)
        for k in range(1, len(frequencies_hz)):
            between = k * block - (1 + _BETWEEN_BLOCKS) / 2
            panel.axhline(between, color=FAINT, linewidth=HAIR_PT, zorder=0)
        _scale_panel(panel, rows, lanes)
        panel.set_yticks(middles, [f"{f_hz:g} Hz" for f_hz in frequencies_hz])
        panel.set_title(
            afferent,
            fontsize=TEXT_PT + 1,
            fontweight="bold",
            color=AFFERENT_COLOURS[afferent],
            pad=5,
        )
    figure.supxlabel(
        "Amplitude (µm)",
        x=(_LEFT_IN + room_in / 2) / PAGE_WIDTH_IN,
        y=0.05 / height_in,
        va="bottom",
        fontsize=TEXT_PT,
        color=INK,
    )
    _draw_legend(figure, sources, judged, 1 - _LEGEND_DOWN_IN / height_in)
    return figure


def _draw_row(panel: "Axes", row: ThresholdRow, lane: float, judged: str) -> None:
    colour, filled = _look(row.source, row.afferent, judged)
    panel.plot(
        [row.lowest_um, row.highest_um], [lane, lane], color=FAINT, linewidth=HAIR_PT, zorder=1
    )
    if row.plateau is not None:
        panel.plot(
            [row.plateau.low_um, row.plateau.high_um],
            [lane, lane],
            color=colour,
            linewidth=_BAR_PT if filled else 0.5 * _BAR_PT,
            solid_capstyle="butt",
            zorder=2,
        )
    above = math.isinf(row.threshold_um)
    panel.plot(
        [row.highest_um if above else row.threshold_um],
        [lane],
        **_mark(">" if above else "o", colour, filled),
    )


def _look(source: str, afferent: str, judged: str) -> tuple[str, bool]:
    """Give colour, and whether the mark is filled."""
    if source == OBSERVED:
        return INK, True
    if source == TOUCHSIM:
        return TOUCHSIM_COLOUR, True
    return AFFERENT_COLOURS[afferent], source == judged


def _mark(marker: str, colour: str, filled: bool) -> dict[str, Any]:
    return {
        "linestyle": "none",
        "marker": marker,
        "markersize": _DOT_PT,
        "markerfacecolor": colour if filled else "#FFFFFF",
        "markeredgecolor": colour,
        "markeredgewidth": 0.9,
        "zorder": 3,
        "clip_on": False,
    }


def _scale_panel(panel: "Axes", rows: Sequence[ThresholdRow], lanes: float) -> None:
    from matplotlib.ticker import FuncFormatter, NullFormatter

    panel.set_xscale("log")
    panel.set_xlim(
        min(row.lowest_um for row in rows) / _ROOM, max(row.highest_um for row in rows) * _ROOM
    )
    panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.xaxis.set_minor_formatter(NullFormatter())
    panel.set_ylim(lanes - _BETWEEN_BLOCKS / 2 - 0.5, -0.9)
    make_plain(panel)
    panel.tick_params(axis="x", which="minor", length=1.2, width=0.4, colors=INK)
    panel.tick_params(axis="y", length=0.0, labelsize=SMALL_TEXT_PT)
    panel.spines["left"].set_visible(False)


def _draw_legend(figure: "Figure", sources: Sequence[str], judged: str, height: float) -> None:
    from matplotlib.legend_handler import HandlerTuple
    from matplotlib.lines import Line2D

    samples: list[Any] = []  # tuples, which the types of Matplotlib know nothing of
    for source in sources:
        common = source in (OBSERVED, TOUCHSIM)
        classes = ("SA",) if common else AFFERENTS
        looks = [_look(source, afferent, judged) for afferent in classes]
        samples.append(tuple(Line2D([], [], **_mark("o", *look)) for look in looks))
    names = [source_title(source, judged) for source in sources]
    bar = Line2D([], [], color=INK, linewidth=_BAR_PT, solid_capstyle="butt")
    above = Line2D([], [], **_mark(">", INK, True))
    samples += [(bar,), (above,)]
    figure.legend(
        samples,
        [*names, "one impulse a cycle", "none up to here"],
        loc="center",
        bbox_to_anchor=(0.5, height),
        ncols=len(names) + 2,
        frameon=False,
        fontsize=SMALL_TEXT_PT,
        labelcolor=INK,
        handlelength=1.9,
        columnspacing=1.3,
        handletextpad=0.5,
        handler_map={tuple: HandlerTuple(ndivide=None, pad=0.2)},
    )
