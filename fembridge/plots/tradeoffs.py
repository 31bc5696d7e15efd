"""What a fit traded: the front of each class, what was taken of it, the rates it gives.

A row a class. Left the error of every candidate at each frequency, a line each; then
the two frequencies between which there is most to choose; right observed rates
against amplitude, with those of the candidate that was taken.
"""

from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge.fitting.fit import Fit, FitRun
from fembridge.plots.style import (
    FAINT,
    INK,
    LINE_PT,
    TEXT_PT,
    WHITE,
    class_style,
    dots,
    in_style,
    legend_above,
    log_axis,
    make_plain,
    note,
)
from fembridge.typing import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Inches. Margins are given, not found: a layout engine takes seconds.
_LINES_IN, _PAIR_IN, _RATES_IN, _ROW_IN = 2.5, 1.7, 1.15, 1.55
_LEFT_IN, _RIGHT_IN, _TOP_IN, _BOTTOM_IN = 0.95, 0.15, 0.72, 0.46
_PANEL_GAP_IN, _RATES_GAP_IN, _ROW_GAP_IN = 0.62, 0.12, 0.46
_LEGEND_DOWN_IN = 0.16
# A group is at least this wide; of more than these, names are written aslant.
_GROUP_IN, _MOST_LEVEL_NAMES = 0.42, 6
_MOST_OPAQUE, _LEAST_OPAQUE = 0.45, 0.10
_ROOM, _AMPLITUDE_ROOM = 1.08, 1.4
_DOT_PT, _RING_PT = 3.0, 7.0

_PUBLISHED: dict[str, Any] = {"color": "#777777", "dashes": (4, 2), "zorder": 3}
_CHOSEN: dict[str, Any] = {"color": INK, "linewidth": 2 * LINE_PT, "zorder": 4}
_OBSERVED = dots(INK, _DOT_PT, markerfacecolor=WHITE, markeredgewidth=0.8, clip_on=False, zorder=5)
_LEVELS = {
    "sine": "Amplitude (µm)",
    "diharm": "Amplitude of component 1 (µm)",
    "noise": "RMS amplitude (µm)",
}


@in_style
def tradeoffs_figure(run: FitRun) -> "Figure":
    """The fits of `run`, a row a class."""
    from matplotlib.figure import Figure

    columns = list(dict.fromkeys(name for fit in run.fits for name in fit.problem.group_names))
    lines_in = max(_LINES_IN, _GROUP_IN * len(columns))
    wide_in = np.array([lines_in, _PAIR_IN, *[_RATES_IN] * len(columns)])
    gap_in = [*[_PANEL_GAP_IN] * 2, *[_RATES_GAP_IN] * (len(columns) - 1)]
    left_in = _LEFT_IN + np.concatenate([[0.0], np.cumsum(wide_in[:-1] + gap_in)])
    width_in = float(left_in[-1] + wide_in[-1] + _RIGHT_IN)
    rows = len(run.fits)
    height_in = _TOP_IN + _BOTTOM_IN + rows * _ROW_IN + (rows - 1) * _ROW_GAP_IN
    figure = Figure(figsize=(width_in, height_in))
    titles = ["Error of each candidate", "Strongest trade-off", *columns]
    for row, fit in enumerate(run.fits):
        low = (_BOTTOM_IN + (rows - 1 - row) * (_ROW_IN + _ROW_GAP_IN)) / height_in
        panels = []
        for left, wide, title in zip(left_in / width_in, wide_in / width_in, titles, strict=True):
            panels.append(figure.add_axes((left, low, wide, _ROW_IN / height_in)))
            make_plain(panels[-1])
            if not row:
                panels[-1].set_title(title, fontsize=TEXT_PT)
        _draw_lines(panels[0], fit)
        _draw_pair(panels[1], fit)
        _draw_rates(panels[2:], columns, fit)
    families = {entry.family for entry in run.fits[-1].fitted.entries}
    figure.text(
        (left_in[2] / width_in + 1 - _RIGHT_IN / width_in) / 2,
        0.06 / height_in,
        _LEVELS[families.pop()] if len(families) == 1 else _LEVELS["sine"],
        ha="center",
        va="bottom",
        fontsize=TEXT_PT,
    )
    legend_above(
        figure,
        [{"color": FAINT, "linewidth": 2 * LINE_PT}, _CHOSEN, _PUBLISHED, _OBSERVED],
        ["candidates of the front", "chosen", "Table 2 of the paper", "observed rates"],
        down_in=_LEGEND_DOWN_IN,
        handlelength=2.6,
        fontsize=TEXT_PT,
    )
    return figure


def strongest_tradeoff(errors: FloatArray) -> tuple[int, int]:
    """The two columns of ``(candidate, group)`` that rank candidates most differently.

    The least rank correlation; the first of equals. Two groups or more.
    """
    ranks = errors.argsort(axis=0, kind="stable").argsort(axis=0, kind="stable")
    centred = ranks - ranks.mean(axis=0)
    products = centred.T @ centred
    return min(combinations(range(errors.shape[1]), 2), key=lambda pair: products[pair])


def _draw_lines(panel: "Axes", fit: Fit) -> None:
    """Lay a line of errors over the groups for each candidate of the front."""
    style = class_style(fit.afferent, TEXT_PT + 3)
    rmse_ips = np.sqrt(fit.front.errors_ips2)
    published_ips = np.sqrt(fit.problem.group_errors(fit.published.predicted_ips[None])[0])
    along = np.arange(rmse_ips.shape[1])
    opaque = float(np.clip(8.0 / len(rmse_ips), _LEAST_OPAQUE, _MOST_OPAQUE))
    panel.plot(along, rmse_ips.T, color=style["color"], alpha=opaque)
    panel.plot(along, published_ips, **_PUBLISHED)
    panel.plot(along, rmse_ips[fit.choice.row], marker="o", markersize=_DOT_PT + 1, **_CHOSEN)
    panel.set_xticks(along, fit.problem.group_names)
    if len(along) > _MOST_LEVEL_NAMES:
        for name in panel.get_xticklabels():
            name.set(rotation=30, ha="right", rotation_mode="anchor")
    panel.set_xlim(-0.15, len(along) - 0.85)
    panel.set_ylim(0.0, _ROOM * max(rmse_ips.max(), published_ips.max(), 1.0))
    panel.set_ylabel("RMSE (impulses/s)")
    note(panel, fit.afferent, (0.0, 0.5), (-42, 0), ha="right", va="center", **style)


def _draw_pair(panel: "Axes", fit: Fit) -> None:
    """Scatter the errors of the two groups between which there is most to choose."""
    errors_ips2, names = fit.front.errors_ips2, fit.problem.group_names
    if len(names) < 2:
        panel.set_axis_off()
        return
    pair = strongest_tradeoff(errors_ips2)
    rmse_ips = np.sqrt(errors_ips2[:, pair])
    colour = class_style(fit.afferent)["color"]
    panel.plot(*rmse_ips.T, **dots(colour, _DOT_PT, alpha=0.55, clip_on=False))
    chosen = rmse_ips[fit.choice.row]
    ring = {"markerfacecolor": "none", "markeredgewidth": 1.4, "clip_on": False, "zorder": 4}
    panel.plot(*chosen, **dots(INK, _RING_PT, **ring))
    ground = {"facecolor": WHITE, "edgecolor": "none", "alpha": 0.8, "pad": 0.8}
    note(panel, "chosen", tuple(chosen), (7, 7), frame="data", bbox=ground, zorder=5)
    right_ips, top_ips = _ROOM * np.maximum(rmse_ips.max(axis=0), 1.0)
    panel.set(xlim=(0.0, right_ips), ylim=(0.0, top_ips))
    first, second = (names[column] for column in pair)
    panel.set(xlabel=f"RMSE at {first} (impulses/s)", ylabel=f"RMSE at {second}")


def _draw_rates(panels: "list[Axes]", columns: list[str], fit: Fit) -> None:
    """Draw observed rates, and predicted ones, against amplitude; one scale a row."""
    fitted, published = fit.fitted, fit.published
    highest_ips = max(1.0, float(fitted.observed_ips.max()), float(fitted.predicted_ips.max()))
    first = True
    for panel, name in zip(panels, columns, strict=True):
        if name not in fit.problem.group_names:
            panel.set_axis_off()
            continue
        level_um = np.array([entry.level_um for entry in fitted.of_group(name).entries])
        order = level_um.argsort(kind="stable")
        for judged, style in ((published, _PUBLISHED), (fitted, _CHOSEN)):
            panel.plot(level_um[order], judged.of_group(name).predicted_ips[order], **style)
        panel.plot(level_um, fitted.of_group(name).observed_ips, **_OBSERVED)
        log_axis(panel, level_um.min() / _AMPLITUDE_ROOM, level_um.max() * _AMPLITUDE_ROOM)
        panel.set_ylim(0.0, _ROOM * highest_ips)
        panel.tick_params(labelleft=first)
        panel.set_ylabel("Rate (impulses/s)" if first else "")
        first = False
