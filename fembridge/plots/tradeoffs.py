"""What a fit traded: the front of each class, what was taken of it, the rates it gives.

A row a class. Left the error of every candidate at each frequency, a line each; then
the two frequencies between which there is most to choose; right observed rates
against amplitude, with those of the candidate that was taken.
"""

from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge.fitting.fit import Fit, FitRun, JudgedRates
from fembridge.plots.style import (
    AFFERENT_COLOURS,
    FAINT,
    INK,
    LINE_PT,
    SMALL_TEXT_PT,
    TEXT_PT,
    log_axis,
    make_plain,
    name_axes,
)
from fembridge.typing import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Inches. Margins are given, not found: a layout engine takes seconds.
_LINES_IN, _PAIR_IN, _RATES_IN, _ROW_IN = 2.5, 1.7, 1.15, 1.55
_LEFT_IN, _RIGHT_IN, _TOP_IN, _BOTTOM_IN = 0.95, 0.15, 0.72, 0.46
_PANEL_GAP_IN, _RATES_GAP_IN, _ROW_GAP_IN = 0.62, 0.12, 0.46
_LEGEND_DOWN_IN = 0.08
# A group is at least this wide; of more than these, names are written aslant.
_GROUP_IN, _MOST_LEVEL_NAMES = 0.42, 6
_RING_PT = 7.0
_MOST_OPAQUE, _LEAST_OPAQUE = 0.45, 0.10
_RMSE = "RMSE (impulses/s)"
_PUBLISHED_NAME = "Table 2 of the paper"

_ROOM, _AMPLITUDE_ROOM = 1.08, 1.4
DOT_PT = 3.0

PUBLISHED_STYLE: dict[str, Any] = {
    "color": "#777777",
    "linewidth": LINE_PT,
    "dashes": (4, 2),
    "zorder": 3,
}
CHOSEN_STYLE: dict[str, Any] = {"color": INK, "linewidth": 2 * LINE_PT, "zorder": 4}
OBSERVED_STYLE: dict[str, Any] = {
    "linestyle": "none",
    "marker": "o",
    "markersize": DOT_PT,
    "markerfacecolor": "white",
    "markeredgecolor": INK,
    "markeredgewidth": 0.8,
    "clip_on": False,
    "zorder": 5,
}


def tradeoffs_figure(run: FitRun) -> "Figure":
    """The fits of `run`, a row a class."""
    from matplotlib.figure import Figure

    columns = list(dict.fromkeys(name for fit in run.fits for name in fit.problem.group_names))
    lines_in = max(_LINES_IN, _GROUP_IN * len(columns))
    rates_in = len(columns) * (_RATES_IN + _RATES_GAP_IN) - _RATES_GAP_IN
    width_in = _LEFT_IN + lines_in + _PAIR_IN + 2 * _PANEL_GAP_IN + rates_in
    width_in += _RIGHT_IN
    rows = len(run.fits)
    height_in = _TOP_IN + _BOTTOM_IN + rows * _ROW_IN + (rows - 1) * _ROW_GAP_IN
    figure = Figure(figsize=(width_in, height_in))
    for row, fit in enumerate(run.fits):
        bottom_in = _BOTTOM_IN + (rows - 1 - row) * (_ROW_IN + _ROW_GAP_IN)

        def panel(left_in: float, wide_in: float, low_in: float = bottom_in) -> "Axes":
            made: Axes = figure.add_axes(
                (left_in / width_in, low_in / height_in, wide_in / width_in, _ROW_IN / height_in)
            )
            make_plain(made)
            return made

        lines = panel(_LEFT_IN, lines_in)
        _draw_lines(lines, fit)
        pair_left_in = _LEFT_IN + lines_in + _PANEL_GAP_IN
        pair = panel(pair_left_in, _PAIR_IN)
        _draw_pair(pair, fit)
        rates_left_in = pair_left_in + _PAIR_IN + _PANEL_GAP_IN
        panels = [
            panel(rates_left_in + k * (_RATES_IN + _RATES_GAP_IN), _RATES_IN)
            for k in range(len(columns))
        ]
        _draw_rates(panels, columns, fit)
        if not row:
            _head(lines, "Error of each candidate")
            _head(pair, "Strongest trade-off")
            for each, name in zip(panels, columns, strict=True):
                _head(each, name)
        if row == rows - 1:
            middle_in = rates_left_in + rates_in / 2
            figure.text(
                middle_in / width_in,
                0.06 / height_in,
                _level_name(fit.fitted),
                ha="center",
                va="bottom",
                fontsize=TEXT_PT,
                color=INK,
            )
    _draw_legend(figure, 1 - _LEGEND_DOWN_IN / height_in)
    return figure


def strongest_tradeoff(errors: FloatArray) -> tuple[int, int]:
    """The two columns of ``(candidate, group)`` that rank candidates least alike.

    The least rank correlation; the first of equals. Two groups or more.
    """
    ranks = errors.argsort(axis=0, kind="stable").argsort(axis=0, kind="stable")
    centred = ranks - ranks.mean(axis=0)
    alike = centred.T @ centred
    return min(combinations(range(errors.shape[1]), 2), key=lambda pair: alike[pair])


def _draw_lines(panel: "Axes", fit: Fit) -> None:
    """Lay a line of errors over the groups for each candidate of the front."""
    rmse_ips, colour = np.sqrt(fit.front.errors_ips2), _colour(fit)
    along = np.arange(rmse_ips.shape[1])
    opaque = float(np.clip(8.0 / len(rmse_ips), _LEAST_OPAQUE, _MOST_OPAQUE))
    panel.plot(along, rmse_ips.T, color=colour, linewidth=LINE_PT, alpha=opaque)
    published_ips = _group_rmse_ips(fit, fit.published)
    panel.plot(along, published_ips, **PUBLISHED_STYLE)
    panel.plot(along, rmse_ips[fit.choice.row], marker="o", markersize=DOT_PT, **CHOSEN_STYLE)
    panel.set_xticks(along, fit.problem.group_names)
    if len(along) > _MOST_LEVEL_NAMES:
        for name in panel.get_xticklabels():
            name.set(rotation=30, ha="right", rotation_mode="anchor")
    panel.set_xlim(-0.15, len(along) - 0.85)
    highest_ips = max(float(rmse_ips.max()), float(published_ips.max()), 1.0)
    panel.set_ylim(0.0, _ROOM * highest_ips)
    name_axes(panel, "", _RMSE)
    panel.annotate(
        fit.afferent,
        (0.0, 0.5),
        xycoords="axes fraction",
        xytext=(-42, 0),
        textcoords="offset points",
        ha="right",
        va="center",
        fontsize=TEXT_PT + 3,
        fontweight="bold",
        color=_colour(fit),
        annotation_clip=False,
    )


def _draw_pair(panel: "Axes", fit: Fit) -> None:
    """Scatter the errors of the two groups between which there is most to choose."""
    errors_ips2, names = fit.front.errors_ips2, fit.problem.group_names
    if len(names) < 2:
        panel.set_axis_off()
        return
    first, second = strongest_tradeoff(errors_ips2)
    across_ips, up_ips = np.sqrt(errors_ips2[:, [first, second]]).T
    panel.plot(
        across_ips,
        up_ips,
        linestyle="none",
        marker="o",
        markersize=DOT_PT,
        markeredgewidth=0.0,
        color=_colour(fit),
        alpha=0.55,
        clip_on=False,
    )
    row = fit.choice.row
    panel.plot(
        across_ips[row],
        up_ips[row],
        linestyle="none",
        marker="o",
        markersize=_RING_PT,
        markerfacecolor="none",
        markeredgecolor=INK,
        markeredgewidth=1.4,
        clip_on=False,
        zorder=4,
    )
    panel.annotate(
        "chosen",
        (across_ips[row], up_ips[row]),
        xytext=(7, 7),
        textcoords="offset points",
        fontsize=SMALL_TEXT_PT,
        color=INK,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.8},
        zorder=5,
    )
    panel.set_xlim(0.0, _ROOM * max(float(across_ips.max()), 1.0))
    panel.set_ylim(0.0, _ROOM * max(float(up_ips.max()), 1.0))
    name_axes(panel, f"RMSE at {names[first]} (impulses/s)", f"RMSE at {names[second]}")


def _draw_legend(figure: "Figure", height: float) -> None:
    from matplotlib.lines import Line2D

    plain: tuple[list[float], list[float]] = ([], [])
    figure.legend(
        handles=[
            Line2D(*plain, color=FAINT, linewidth=2 * LINE_PT, label="candidates of the front"),
            Line2D(*plain, **CHOSEN_STYLE, label="chosen"),
            Line2D(*plain, **PUBLISHED_STYLE, label=_PUBLISHED_NAME),
            Line2D(*plain, **OBSERVED_STYLE, label="observed rates"),
        ],
        loc="upper center",
        bbox_to_anchor=(0.5, height),
        ncols=4,
        frameon=False,
        fontsize=TEXT_PT,
        labelcolor=INK,
        handlelength=2.6,
        borderaxespad=0.0,
    )


def _group_rmse_ips(fit: Fit, judged: JudgedRates) -> FloatArray:
    """RMSE of rates in each group of a fit, ``(group,)``."""
    errors_ips2 = fit.problem.group_errors(judged.predicted_ips[None])
    rmse_ips: FloatArray = np.sqrt(errors_ips2[0])
    return rmse_ips


def _colour(fit: Fit) -> str:
    return AFFERENT_COLOURS[fit.afferent]


def _head(panel: "Axes", text: str) -> None:
    panel.set_title(text, fontsize=TEXT_PT, color=INK, pad=6)


def _draw_rates(panels: "list[Axes]", columns: list[str], fit: Fit) -> None:
    """Draw observed rates, and predicted ones, against amplitude; one scale a row."""
    highest_ips = max(
        1.0, float(fit.fitted.observed_ips.max()), float(fit.fitted.predicted_ips.max())
    )
    shown = [name in fit.problem.group_names for name in columns]
    first = panels[shown.index(True)]
    for panel, name in zip(panels, columns, strict=True):
        if name not in fit.problem.group_names:
            panel.set_axis_off()
            continue
        for judged, style in ((fit.published, PUBLISHED_STYLE), (fit.fitted, CHOSEN_STYLE)):
            mine = judged.of_group(name)
            levels = np.array([entry.level_um for entry in mine.entries])
            order = levels.argsort(kind="stable")
            panel.plot(levels[order], mine.predicted_ips[order], **style)
        panel.plot(levels, mine.observed_ips, **OBSERVED_STYLE)
        log_axis(panel, levels.min() / _AMPLITUDE_ROOM, levels.max() * _AMPLITUDE_ROOM)
        panel.set_ylim(0.0, _ROOM * highest_ips)
        if panel is not first:
            panel.tick_params(labelleft=False)
    first.set_ylabel("Rate (impulses/s)", fontsize=SMALL_TEXT_PT, color=INK)


def _level_name(judged: JudgedRates) -> str:
    """Name the axis of the levels of these stimuli."""
    families = {entry.family for entry in judged.entries}
    words = {
        "sine": "Amplitude (µm)",
        "diharm": "Amplitude of component 1 (µm)",
        "noise": "RMS amplitude (µm)",
    }
    return words[families.pop()] if len(families) == 1 else "Amplitude (µm)"
