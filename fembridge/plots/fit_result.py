"""Trade-offs of a fit, and the held-out errors of a model study.

`tradeoffs_figure` has one row per class. On the left the error of every candidate at each
frequency; then the two frequencies with the strongest trade-off; on the right observed rates
against amplitude, with those of the selected candidate.

`study_figure` shows the held-out error of every model of a study, one panel per class, the
best model on top.
"""

from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge.plots.rate_comparison import LEVELS, OBSERVED_DOTS
from fembridge.plots.style import (
    FAINT,
    HAIR_PT,
    INK,
    LINE_PT,
    SMALL_TEXT_PT,
    TEXT_PT,
    WHITE,
    class_style,
    dots,
    grid_figure,
    in_style,
    legend_above,
    log_axis,
    new_figure,
    note,
)
from fembridge.typing import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from fembridge.fitting.fit import ClassFit, Fit
    from fembridge.fitting.model_study import ModelStudy
    from fembridge.plots.style import Panels

# Inches.
_LINES_IN, _PAIR_IN, _RATES_IN, _ROW_IN = 2.5, 1.7, 1.15, 1.55
_LEFT_IN, _RIGHT_IN, _TOP_IN, _BOTTOM_IN = 0.95, 0.15, 0.72, 0.46
_STUDY_ROW_IN = 0.17
_GAP_IN, _RATES_GAP_IN, _ROW_GAP_IN = 0.62, 0.12, 0.46
# Least width of a group in inches; names of more groups than this are slanted.
_GROUP_IN, _MAX_LEVEL_NAMES = 0.42, 6
_MAX_ALPHA, _MIN_ALPHA = 0.45, 0.10
_MARGIN, _AMPLITUDE_MARGIN = 1.08, 1.4
_DOT_PT, _RING_PT = 3.0, 7.0

_PUBLISHED: dict[str, Any] = {"color": "#777777", "dashes": (4, 2), "zorder": 3}
_SELECTED: dict[str, Any] = {"color": INK, "linewidth": 2 * LINE_PT, "zorder": 4}


@in_style
def tradeoffs_figure(result: "Fit", axes: "Panels | None" = None) -> "Figure":
    """Fits of `result`, one row per class.

    With `axes`, the panels of all rows are drawn into them, without a legend.
    """
    fits = list(result.fits.values())
    columns = list(dict.fromkeys(name for fit in fits for name in fit.front.groups))
    errors_in = max(_LINES_IN, _GROUP_IN * len(columns))
    rates_in = [_RATES_IN, _RATES_GAP_IN] * len(columns)
    widths_in = [_LEFT_IN, errors_in, _GAP_IN, _PAIR_IN, _GAP_IN, *rates_in[:-1], _RIGHT_IN]
    heights_in = [_TOP_IN, *[_ROW_IN, _ROW_GAP_IN] * len(fits)]
    titles = ["Error of each candidate", "Strongest trade-off", *columns]
    figure, new_panel = grid_figure(
        widths_in, [*heights_in[:-1], _BOTTOM_IN], len(fits) * len(titles), axes
    )
    families = set(fits[-1].seen["family"])
    level = LEVELS[families.pop()] if len(families) == 1 else LEVELS["sine"]
    for row, fit in enumerate(fits):
        panels = [new_panel(row, column) for column in range(len(titles))]
        if not row:
            for panel, title in zip(panels, titles, strict=True):
                panel.set_title(title, fontsize=TEXT_PT)
        _draw_errors(panels[0], fit)
        _draw_tradeoff(panels[1], fit)
        _draw_rates(panels[2:], columns, fit)
    if axes is not None:
        for panel in panels[2:]:
            panel.set_xlabel(level)
        return figure
    width_in, height_in = figure.get_size_inches()
    figure.text(
        0.5 * (1 + (sum(widths_in[:5]) - _RIGHT_IN) / width_in),
        0.06 / height_in,
        level,
        ha="center",
        va="bottom",
        fontsize=TEXT_PT,
    )
    legend_above(
        figure,
        [{"color": FAINT, "linewidth": 2 * LINE_PT}, _SELECTED, _PUBLISHED, OBSERVED_DOTS],
        ["candidates of the front", "chosen", "Table 2 of the paper", "observed rates"],
        handlelength=2.6,
        fontsize=TEXT_PT,
    )
    return figure


def strongest_tradeoff(errors: FloatArray) -> tuple[int, int]:
    """The two columns of `errors` ``(candidate, group)`` with the least rank correlation.

    The first of equal pairs; `errors` has two columns or more.
    """
    ranks = errors.argsort(axis=0, kind="stable").argsort(axis=0, kind="stable")
    centred = ranks - ranks.mean(axis=0)
    products = centred.T @ centred
    return min(combinations(range(errors.shape[1]), 2), key=lambda pair: products[pair])


def _draw_errors(panel: "Axes", fit: "ClassFit") -> None:
    """Draw the errors of each candidate of the front as a line over the groups."""
    style = class_style(fit.afferent, TEXT_PT + 3)
    rmse_ips = np.sqrt(fit.front.errors_ips2)
    published_ips = fit.group_rmse_ips("published_ips")
    positions = np.arange(rmse_ips.shape[1])
    alpha = float(np.clip(8.0 / len(rmse_ips), _MIN_ALPHA, _MAX_ALPHA))
    panel.plot(positions, rmse_ips.T, color=style["color"], alpha=alpha)
    panel.plot(positions, published_ips, **_PUBLISHED)
    panel.plot(positions, rmse_ips[fit.choice.row], marker="o", markersize=_DOT_PT + 1, **_SELECTED)
    panel.set_xticks(positions, fit.front.groups)
    if len(positions) > _MAX_LEVEL_NAMES:
        for label in panel.get_xticklabels():
            label.set(rotation=30, ha="right", rotation_mode="anchor")
    panel.set_xlim(-0.15, len(positions) - 0.85)
    panel.set_ylim(0.0, _MARGIN * max(rmse_ips.max(), published_ips.max(), 1.0))
    panel.set_ylabel("RMSE (impulses/s)")
    note(panel, fit.afferent, (0.0, 0.5), (-42, 0), ha="right", va="center", **style)


def _draw_tradeoff(panel: "Axes", fit: "ClassFit") -> None:
    """Scatter the errors of the two groups with the strongest trade-off."""
    errors_ips2, names = fit.front.errors_ips2, fit.front.groups
    if len(names) < 2:
        panel.set_axis_off()
        return
    pair = strongest_tradeoff(errors_ips2)
    rmse_ips = np.sqrt(errors_ips2[:, pair])
    colour = class_style(fit.afferent)["color"]
    panel.plot(*rmse_ips.T, **dots(colour, _DOT_PT, alpha=0.55, clip_on=False))
    selected_ips = rmse_ips[fit.choice.row]
    ring = {"markerfacecolor": "none", "markeredgewidth": 1.4, "clip_on": False, "zorder": 4}
    panel.plot(*selected_ips, **dots(INK, _RING_PT, **ring))
    background = {"facecolor": WHITE, "edgecolor": "none", "alpha": 0.8, "pad": 0.8}
    note(panel, "chosen", tuple(selected_ips), (7, 7), frame="data", bbox=background, zorder=5)
    right_ips, top_ips = _MARGIN * np.maximum(rmse_ips.max(axis=0), 1.0)
    panel.set(xlim=(0.0, right_ips), ylim=(0.0, top_ips))
    first, second = (names[column] for column in pair)
    panel.set(xlabel=f"RMSE at {first} (impulses/s)", ylabel=f"RMSE at {second}")


def _draw_rates(panels: "list[Axes]", columns: list[str], fit: "ClassFit") -> None:
    """Draw observed and predicted rates against amplitude, on one scale per row."""
    highest_ips = max(1.0, fit.seen[["observed_ips", "predicted_ips"]].to_numpy().max())
    leftmost = True
    for panel, name in zip(panels, columns, strict=True):
        group = fit.seen[fit.seen["group"] == name]
        if group.empty:
            panel.set_axis_off()
            continue
        ordered, level_um = group.sort_values("level_um", kind="stable"), group["level_um"]
        for predicted, style in (("published_ips", _PUBLISHED), ("predicted_ips", _SELECTED)):
            panel.plot(ordered["level_um"], ordered[predicted], **style)
        panel.plot(level_um, group["observed_ips"], **OBSERVED_DOTS)
        log_axis(panel, level_um.min() / _AMPLITUDE_MARGIN, level_um.max() * _AMPLITUDE_MARGIN)
        panel.set_ylim(0.0, _MARGIN * highest_ips)
        panel.tick_params(labelleft=leftmost)
        panel.set_ylabel("Rate (impulses/s)" if leftmost else "")
        leftmost = False


@in_style
def study_figure(study: "ModelStudy", axes: "Panels | None" = None) -> "Figure":
    """Dots: RMSE on held-out frequencies, one dot per seed; ticks: on fitted frequencies.

    With `axes`, one per class, the panels are drawn into them, without a title.
    """
    rows = {name: study.ranked(name) for name in study.unfitted}
    height_in = 1.1 + _STUDY_ROW_IN * max(map(len, rows.values()))
    figure, [panels] = new_figure(height_in, columns=len(rows), axes=axes)
    for panel, (name, cases) in zip(panels, rows.items(), strict=True):
        style = class_style(name)
        for position, trials in enumerate(cases):
            held_out_ips, fitted_ips = trials["held_out_rmse_ips"], trials["fitted_rmse_ips"]
            panel.plot(
                [fitted_ips.min(), held_out_ips.max()],
                [position] * 2,
                color=FAINT,
                linewidth=HAIR_PT,
            )
            panel.plot(
                fitted_ips, [position] * len(fitted_ips), "|", markersize=5, markeredgewidth=1
            )
            panel.plot(held_out_ips, [position] * len(held_out_ips), **dots(style["color"], 4.5))
        panel.axvline(study.unfitted[name].rmse_ips, linewidth=HAIR_PT, dashes=(4, 3))
        firsts = [trials.iloc[0] for trials in cases]
        labels = [f"{case['drive']}, {case['cells']}, {case['preindent_um']:g}" for case in firsts]
        panel.set_yticks(range(len(labels)), labels, fontsize=SMALL_TEXT_PT - 1)
        panel.set_ylim(len(labels) - 0.4, -0.6)
        panel.set_xlim(left=0)
        panel.set_title(name, **style)
        panel.set_xlabel("RMSE (impulses/s)", fontsize=TEXT_PT)
    if axes is not None:
        return figure
    figure.suptitle(
        "Rows: drive, cells, pre-indentation (µm)\n"
        "dots: held-out frequencies;  ticks: fitted frequencies;  dashes: Table 2 as printed",
    )
    return figure
