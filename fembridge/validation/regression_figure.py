"""Predicted against reference rates: a column a class, a row a predicting source."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge.plots.palette import (
    AFFERENT_COLOURS,
    FAINT,
    HAIR_PT,
    INK,
    LINE_PT,
    PAGE_WIDTH_IN,
    SMALL_TEXT_PT,
    TEXT_PT,
)
from fembridge.plots.picture import make_plain
from fembridge.tables import AFFERENTS
from fembridge.validation.agreement_cell import AgreementCell, cell_of
from fembridge.validation.compared_rates import OBSERVED, TOUCHSIM, ComparedRates
from fembridge.validation.family import Family
from fembridge.validation.number_text import share_text
from fembridge.validation.source_style import TOUCHSIM_COLOUR, source_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Inches.
_PANEL_IN, _BETWEEN_IN = 1.5, 0.36
_LEFT_IN, _RIGHT_IN, _TOP_IN, _BOTTOM_IN = 0.95, 0.12, 0.78, 0.44
_NUMBERS_IN = 0.42
_LEGEND_DOWN_IN = 0.12
_CLASS_UP_PT = 20
_MARKERS = ("o", "s", "^", "D", "v")
_MARK_PT = 3.8
_ROOM = 1.06


def regression_figure(
    compared: ComparedRates,
    cells: tuple[AgreementCell, ...],
    family: Family,
    reference: str,
    judged: str,
) -> "Figure":
    """Draw the points of `family`, the line through them, and where they should be."""
    from matplotlib.figure import Figure

    sources = [name for name in compared.sources if name not in (reference, OBSERVED)]
    rows = len(sources)
    height_in = _TOP_IN + _BOTTOM_IN + rows * _PANEL_IN + (rows - 1) * _BETWEEN_IN
    room_in = PAGE_WIDTH_IN - _LEFT_IN - _RIGHT_IN
    column_in = (room_in - (len(AFFERENTS) - 1) * _NUMBERS_IN) / len(AFFERENTS)
    figure = Figure(figsize=(PAGE_WIDTH_IN, height_in))
    grid = figure.subplots(
        rows,
        len(AFFERENTS),
        squeeze=False,
        sharex="col",
        sharey="col",
        gridspec_kw={
            "left": _LEFT_IN / PAGE_WIDTH_IN,
            "right": 1 - _RIGHT_IN / PAGE_WIDTH_IN,
            "top": 1 - _TOP_IN / height_in,
            "bottom": _BOTTOM_IN / height_in,
            "hspace": _BETWEEN_IN / _PANEL_IN,
            "wspace": _NUMBERS_IN / column_in,
        },
    )
    for column, afferent in enumerate(AFFERENTS):
        for row, source in enumerate(sources):
            panel = grid[row, column]
            cell = cell_of(cells, reference, source, family.name, afferent)
            colour = TOUCHSIM_COLOUR if source == TOUCHSIM else AFFERENT_COLOURS[afferent]
            _draw_points(panel, compared, family, cell, colour)
            make_plain(panel)
        _scale(grid[0, column], compared, family, afferent)
        for panel in grid[:, column]:
            _draw_identity(panel)
        grid[0, column].annotate(
            afferent,
            (0.5, 1.0),
            xycoords="axes fraction",
            xytext=(0, _CLASS_UP_PT),
            textcoords="offset points",
            ha="center",
            fontsize=TEXT_PT + 1,
            fontweight="bold",
            color=AFFERENT_COLOURS[afferent],
            annotation_clip=False,
        )
    for row, source in enumerate(sources):
        grid[row, 0].set_ylabel(source_title(source, judged), fontsize=TEXT_PT, color=INK)
    across = "Observed rate" if reference == OBSERVED else "TouchSim’s rate"
    figure.supxlabel(
        f"{across} (impulses/s)",
        x=(_LEFT_IN + room_in / 2) / PAGE_WIDTH_IN,
        y=0.05 / height_in,
        va="bottom",
        fontsize=TEXT_PT,
        color=INK,
    )
    figure.supylabel(
        "Predicted rate (impulses/s)", x=0.03 / PAGE_WIDTH_IN, fontsize=TEXT_PT, color=INK
    )
    _draw_legend(figure, family, height=1 - _LEGEND_DOWN_IN / height_in)
    return figure


def _draw_points(
    panel: "Axes", compared: ComparedRates, family: Family, cell: AgreementCell, colour: str
) -> None:
    if cell.agreement is None:
        _tell(panel, "no rates to compare")
        return
    for marker, one in zip(_MARKERS, family.sets, strict=False):
        panel.plot(
            compared.of(cell.reference, cell.afferent, one.stimuli),
            compared.of(cell.source, cell.afferent, one.stimuli),
            **_mark(marker, colour),
        )
    line = cell.agreement.regression
    if math.isfinite(line.slope):
        reference = compared.of(cell.reference, cell.afferent, family.stimuli)
        ends = np.array([np.nanmin(reference), np.nanmax(reference)])
        panel.plot(
            ends,
            line.slope * ends + line.intercept_ips,
            color=colour,
            linewidth=1.5 * LINE_PT,
            dashes=(3.5, 1.6),
            zorder=2,
        )
    _tell(panel, f"R² {share_text(line.r_squared)}, RMSE {cell.agreement.rmse_ips:.1f} ips")


def _mark(marker: str, colour: str) -> dict[str, Any]:
    return {
        "linestyle": "none",
        "marker": marker,
        "markersize": _MARK_PT,
        "markerfacecolor": "#FFFFFF",
        "markeredgecolor": colour,
        "markeredgewidth": 0.9,
        "zorder": 3,
        "clip_on": False,
    }


def _scale(panel: "Axes", compared: ComparedRates, family: Family, afferent: str) -> None:
    """Give both axes of a column one scale, from 0 to above all of its points."""
    from matplotlib.ticker import MaxNLocator

    rows = [compared.stimuli.index(id_) for id_ in family.stimuli]
    rates = compared.rate_ips[:, rows, AFFERENTS.index(afferent)]
    top_ips = _ROOM * max(1.0, float(np.nanmax(rates)))
    panel.set_xlim(0.0, top_ips)
    panel.set_ylim(0.0, top_ips)
    for axis in (panel.xaxis, panel.yaxis):
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))


def _draw_identity(panel: "Axes") -> None:
    panel.axline((0, 0), slope=1.0, color=FAINT, linewidth=1.6 * HAIR_PT, zorder=1)


def _tell(panel: "Axes", words: str) -> None:
    panel.set_title(words, loc="left", fontsize=SMALL_TEXT_PT, color=INK, pad=5)


def _draw_legend(figure: "Figure", family: Family, height: float) -> None:
    from matplotlib.lines import Line2D

    marks = [
        Line2D([], [], **_mark(marker, INK))
        for marker, _ in zip(_MARKERS, family.sets, strict=False)
    ]
    marks += [
        Line2D([], [], color=INK, linewidth=1.5 * LINE_PT, dashes=(3.5, 1.6)),
        Line2D([], [], color=FAINT, linewidth=1.6 * HAIR_PT),
    ]
    names = [one.title for one in family.sets]
    figure.legend(
        marks,
        [*names, "regression", "equal rates"],
        loc="center",
        bbox_to_anchor=(0.5, height),
        ncols=len(marks),
        frameon=False,
        fontsize=SMALL_TEXT_PT,
        labelcolor=INK,
        handlelength=1.8,
        columnspacing=1.3,
        handletextpad=0.5,
    )
