"""A chart of a finding as a picture: panels side by side, one legend under them."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from fembridge.plots.palette import (
    AFFERENT_COLOURS,
    FAINT,
    HAIR_PT,
    INK,
    LINE_PT,
    PAGE_WIDTH_IN,
    SMALL_TEXT_PT,
)
from fembridge.plots.picture import make_plain, save_figure
from fembridge.verification.finding import Chart, Line, Panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_HEIGHT_IN = 2.6
_PANEL_IN = 3.4
# Of Okabe and Ito (2008), those that no class of afferents has.
_COLOURS = ("#56B4E9", "#E69F00", "#CC79A7", "#1A1A1A", "#7A7A7A", "#F0E442")
_MARKERS = ("o", "s", "^", "D", "v", "P")
_DOT_PT = 3.2
# Names on a logarithmic axis that do not run into each other, less one.
_MOST_STEPS = 4
_REFERENCES = ("closed form", "limit")


def draw_chart(chart: Chart, path: Path) -> None:
    """Draw into a file; its suffix chooses the format.

    Raises
    ------
    OutputError
        A place where nothing can be written.
    """
    save_figure(chart_figure(chart), path)


def chart_figure(chart: Chart) -> "Figure":
    """Make the figure that `draw_chart` saves."""
    from matplotlib.figure import Figure

    count = len(chart.panels)
    width_in = min(PAGE_WIDTH_IN, _PANEL_IN * count + 0.6)
    figure = Figure(figsize=(width_in, _HEIGHT_IN), layout="constrained")
    axes = figure.subplots(1, count, squeeze=False)[0]
    for panel, at in zip(chart.panels, axes, strict=True):
        _draw_panel(panel, at)
    return figure


def _draw_panel(panel: Panel, at: "Axes") -> None:
    labels = list(dict.fromkeys(line.label for line in panel.lines))
    told: set[str] = set()
    for line in panel.lines:
        style = _style(line, labels)
        at.plot(line.x, line.y, label=None if line.label in told else line.label, **style)
        told.add(line.label)
    at.set_xscale("log" if "x" in panel.log else "linear")
    at.set_yscale("log" if "y" in panel.log else "linear")
    make_plain(at)
    at.set_xlabel(panel.along, fontsize=SMALL_TEXT_PT, color=INK)
    at.set_ylabel(panel.up, fontsize=SMALL_TEXT_PT, color=INK)
    if panel.title:
        at.set_title(panel.title, fontsize=SMALL_TEXT_PT, color=INK)
    if "x" in panel.log:
        _name_ticks(at, panel)
    at.legend(frameon=False, fontsize=SMALL_TEXT_PT - 1, labelcolor=INK, handlelength=1.8)


def _name_ticks(at: "Axes", panel: Panel) -> None:
    """Name a logarithmic axis where the samples are: there are few."""
    from matplotlib.ticker import NullFormatter

    places = sorted({x for line in panel.lines for x in line.x})
    kept, step = places[:1], (places[-1] / places[0]) ** (1 / _MOST_STEPS)
    for place in places[1:]:
        if place >= 0.99 * step * kept[-1]:
            kept.append(place)
    at.xaxis.set_minor_formatter(NullFormatter())
    at.set_xticks(kept, [f"{place:g}" for place in kept])
    at.minorticks_off()


def _style(line: Line, labels: list[str]) -> dict[str, Any]:
    row = labels.index(line.label)
    colour = AFFERENT_COLOURS.get(line.label, _COLOURS[row % len(_COLOURS)])
    if line.label in _REFERENCES:
        colour = INK if line.mark == "line" else FAINT
    style: dict[str, Any] = {"color": colour, "linewidth": LINE_PT}
    if line.mark in ("dots", "both"):
        style["marker"] = _MARKERS[row % len(_MARKERS)]
        style["markersize"] = _DOT_PT
        style["markeredgewidth"] = 0.0
    if line.mark == "dots":
        style["linestyle"] = "none"
    if line.mark == "dashed":
        style["dashes"] = (4, 2)
    if line.label in _REFERENCES:
        style["linewidth"] = 2 * HAIR_PT
    return style
