"""Observed rates against amplitude, and those that a fit gives; a panel a group."""

from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge.fitting.fit import Fit
from fembridge.fitting.judged_rates import JudgedRates
from fembridge.plots.palette import HAIR_PT, INK, LINE_PT, SMALL_TEXT_PT

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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


def draw_rates(panels: "list[Axes]", columns: list[str], fit: Fit) -> None:
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
        panel.set_xscale("log")
        panel.set_xlim(levels.min() / _AMPLITUDE_ROOM, levels.max() * _AMPLITUDE_ROOM)
        panel.set_ylim(0.0, _ROOM * highest_ips)
        _plain_logarithms(panel)
        if panel is not first:
            panel.tick_params(labelleft=False)
    first.set_ylabel("Rate (impulses/s)", fontsize=SMALL_TEXT_PT, color=INK)


def level_name(judged: JudgedRates) -> str:
    """Name the axis of the levels of these stimuli."""
    families = {entry.family for entry in judged.entries}
    words = {
        "sine": "Amplitude (µm)",
        "diharm": "Amplitude of component 1 (µm)",
        "noise": "RMS amplitude (µm)",
    }
    return words[families.pop()] if len(families) == 1 else "Amplitude (µm)"


def _plain_logarithms(panel: "Axes") -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    panel.xaxis.set_major_locator(LogLocator(10.0))
    panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.xaxis.set_minor_locator(LogLocator(10.0, subs=tuple(range(2, 10))))
    panel.xaxis.set_minor_formatter(NullFormatter())
    panel.tick_params(axis="x", which="minor", length=1.2, width=HAIR_PT, colors=INK)
