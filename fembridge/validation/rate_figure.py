"""Rate against amplitude: a row a class, a column a set of stimuli."""

from typing import TYPE_CHECKING

import numpy as np

from fembridge.plots.palette import AFFERENT_COLOURS, INK, PAGE_WIDTH_IN, SMALL_TEXT_PT, TEXT_PT
from fembridge.plots.picture import make_plain
from fembridge.tables import AFFERENTS
from fembridge.validation.compared_rates import ComparedRates
from fembridge.validation.family import Family
from fembridge.validation.source_style import curve_style, draw_source_legend

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Inches. Margins are given, not found: a layout engine takes seconds.
_ROW_IN, _BETWEEN_ROWS_IN, _BETWEEN_COLUMNS_IN = 1.22, 0.17, 0.14
_LEFT_IN, _RIGHT_IN, _TOP_IN, _BOTTOM_IN = 1.0, 0.1, 0.55, 0.44
_LEGEND_DOWN_IN = 0.12
_HEADROOM = 1.06
_NUMBERS_DOWN_PT = 3.5
_AMPLITUDE_ROOM = 1.35


def rate_figure(compared: ComparedRates, family: Family, judged: str) -> "Figure":
    """Draw the rates of `family` under every source; rows share a scale."""
    from matplotlib.figure import Figure

    columns, sources = len(family.sets), compared.known(family.stimuli)
    height_in = (
        _TOP_IN + _BOTTOM_IN + len(AFFERENTS) * _ROW_IN + (len(AFFERENTS) - 1) * _BETWEEN_ROWS_IN
    )
    room_in = PAGE_WIDTH_IN - _LEFT_IN - _RIGHT_IN
    column_in = (room_in - (columns - 1) * _BETWEEN_COLUMNS_IN) / columns
    figure = Figure(figsize=(PAGE_WIDTH_IN, height_in))
    grid = figure.subplots(
        len(AFFERENTS),
        columns,
        squeeze=False,
        sharex=True,
        sharey="row",
        gridspec_kw={
            "left": _LEFT_IN / PAGE_WIDTH_IN,
            "right": 1 - _RIGHT_IN / PAGE_WIDTH_IN,
            "top": 1 - _TOP_IN / height_in,
            "bottom": _BOTTOM_IN / height_in,
            "hspace": _BETWEEN_ROWS_IN / _ROW_IN,
            "wspace": _BETWEEN_COLUMNS_IN / column_in,
        },
    )
    for row, afferent in enumerate(AFFERENTS):
        for column, one in enumerate(family.sets):
            panel = grid[row, column]
            for source in sources:
                rate_ips = compared.of(source, afferent, one.stimuli)
                panel.plot(
                    one.level_um, rate_ips, clip_on=False, **curve_style(source, afferent, judged)
                )
            _scale_amplitudes(panel, family)
            make_plain(panel)
            panel.tick_params(axis="x", pad=_NUMBERS_DOWN_PT)
            if column:
                panel.tick_params(labelleft=False)
        rates = compared.rate_ips[:, [compared.stimuli.index(id_) for id_ in family.stimuli], row]
        top_ips = max(1.0, float(np.nanmax(rates)))
        grid[row, 0].set_ylim(0.0, _HEADROOM * top_ips)
        _name_row(grid[row, 0], afferent)
    for column, one in enumerate(family.sets):
        grid[0, column].set_title(one.title, fontsize=TEXT_PT, color=INK, pad=5)
    figure.supxlabel(
        family.level_title,
        x=(_LEFT_IN + room_in / 2) / PAGE_WIDTH_IN,
        y=0.05 / height_in,
        va="bottom",
        fontsize=TEXT_PT,
        color=INK,
    )
    figure.supylabel("Rate (impulses/s)", x=0.03 / PAGE_WIDTH_IN, fontsize=TEXT_PT, color=INK)
    draw_source_legend(figure, sources, judged, height=1 - _LEGEND_DOWN_IN / height_in)
    return figure


def _scale_amplitudes(panel: "Axes", family: Family) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    levels_um = [level for one in family.sets for level in one.level_um]
    panel.set_xscale("log")
    panel.set_xlim(min(levels_um) / _AMPLITUDE_ROOM, max(levels_um) * _AMPLITUDE_ROOM)
    panel.xaxis.set_major_locator(LogLocator(10.0))
    panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.xaxis.set_minor_locator(LogLocator(10.0, subs=tuple(range(2, 10))))
    panel.xaxis.set_minor_formatter(NullFormatter())
    panel.tick_params(axis="x", which="minor", length=1.2, width=0.4, colors=INK)


def _name_row(panel: "Axes", afferent: str) -> None:
    panel.annotate(
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
    panel.tick_params(axis="y", labelsize=SMALL_TEXT_PT)
