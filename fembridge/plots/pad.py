"""A touch from above: where the shape is, how hard it presses, and who fires how much."""

from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge.plots.style import (
    AFFERENT_COLOURS,
    FAINT,
    HAIR_PT,
    INK,
    LINE_PT,
    PAGE_WIDTH_IN,
    SMALL_TEXT_PT,
    TEXT_PT,
    in_style,
    make_plain,
)
from fembridge.touching.touch import Touch
from fembridge.typing import BoolArray, FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# A unit's area in the picture grows with its rate up to this, that of the class's
# liveliest unit, in points squared.
_LEAST_PT2, _MOST_PT2 = 1.5, 38.0
_MARGIN_MM = 0.8
# A view is at least so long, of its width.
_LEAST_SHARE = 0.8
_TRACE_IN = 0.75
_MOST_HEIGHT_IN = 4.2
_KPA_PER_N_MM2 = 1000.0
_MOST_ROWS = 60


@in_style
def pad_figure(touch: Touch) -> "Figure":
    """The pad from above, a panel a class: units by rate, contact pressure, and the way."""
    from matplotlib.figure import Figure

    classes = [name for name in AFFERENT_COLOURS if name in touch.population.afferent]
    width_mm, height_mm = (2 * each for each in view_mm(touch))
    panel_in = (PAGE_WIDTH_IN - 1.4) / 3
    tall_in = min(panel_in * height_mm / width_mm, _MOST_HEIGHT_IN)
    figure = Figure(figsize=(PAGE_WIDTH_IN, tall_in + _TRACE_IN + 1.25), layout="constrained")
    grid = figure.add_gridspec(
        2, len(classes), height_ratios=[tall_in, _TRACE_IN], hspace=0.04, wspace=0.02
    )
    image = None
    for column, name in enumerate(classes):
        panel = figure.add_subplot(grid[0, column])
        image = draw_pressure(panel, touch, hardest(touch))
        mine = np.array(touch.population.afferent) == name
        _draw_units(panel, touch, mine, AFFERENT_COLOURS[name])
        _draw_view(panel, touch, first=column == 0)
        firing = int((touch.rate_ips[mine] > 0).sum())
        panel.set_title(
            f"{name}: {firing} of {int(mine.sum())} fire",
            color=AFFERENT_COLOURS[name],
            fontsize=TEXT_PT,
            fontweight="bold",
        )
    if image is not None:
        bar = figure.colorbar(image, ax=figure.axes, fraction=0.025, pad=0.01, shrink=0.7)
        bar.set_label("Contact pressure (kPa)", fontsize=SMALL_TEXT_PT, color=INK)
        bar.ax.tick_params(labelsize=SMALL_TEXT_PT, length=2, width=HAIR_PT)
        bar.ax.spines["outline"].set_linewidth(HAIR_PT)
    draw_way(figure.add_subplot(grid[1, :]), touch)
    return figure


@in_style
def unit_raster_figure(touch: Touch) -> "Figure":
    """Spikes of every unit that fires: a panel a class, units in order along the finger."""
    from matplotlib.figure import Figure

    classes = [name for name in AFFERENT_COLOURS if name in touch.population.afferent]
    afferent = np.array(touch.population.afferent)
    rows = {
        name: np.flatnonzero(
            (afferent == name) & np.isin(np.arange(afferent.size), touch.fired.unit)
        )
        for name in classes
    }
    heights = [max(0.45, min(2.6, 0.028 * rows[name].size * touch.trials)) for name in classes]
    figure = Figure(figsize=(PAGE_WIDTH_IN, sum(heights) + _TRACE_IN + 0.9), layout="constrained")
    panels = figure.subplots(
        len(classes) + 1,
        1,
        sharex=True,
        gridspec_kw={"height_ratios": [_TRACE_IN, *heights]},
    )
    draw_way(panels[0], touch)
    panels[0].set_xlabel("")
    for panel, name in zip(panels[1:], classes, strict=True):
        order = np.lexsort((touch.population.x_mm[rows[name]], touch.population.z_mm[rows[name]]))
        place = np.full(afferent.size, -1)
        place[rows[name][order]] = np.arange(order.size)
        mine = place[touch.fired.unit] >= 0
        lane = (touch.fired.trial[mine] - 1) / touch.trials
        at = place[touch.fired.unit[mine]] + lane
        lines = max(rows[name].size, 1)
        panel.vlines(
            touch.fired.time_ms[mine],
            at + 0.05,
            at + 0.05 + 0.85 / touch.trials,
            colors=AFFERENT_COLOURS[name],
            linewidths=LINE_PT if lines < _MOST_ROWS else 0.6,
        )
        panel.set_ylim(0, lines)
        make_plain(panel)
        panel.set_yticks([])
        panel.set_ylabel(
            f"{name}\n{rows[name].size} units",
            fontsize=SMALL_TEXT_PT,
            rotation=0,
            ha="right",
            va="center",
            color=AFFERENT_COLOURS[name],
            fontweight="bold",
        )
    panels[-1].set_xlabel("Time (ms), units from base to tip", fontsize=SMALL_TEXT_PT)
    panels[0].set_xlim(0, float(touch.way.times_ms[-1]))
    return figure


PICTURES = {"pad": pad_figure, "raster": unit_raster_figure}
"""Pictures of a touch by their names."""


def view_mm(touch: Touch) -> tuple[float, float]:
    """Half width and half length of what is shown: units and contact, of a line room around it."""
    across = [np.abs(touch.population.x_mm).max(), np.abs(touch.nodes.x_mm).max(initial=1.0)]
    along = [np.abs(touch.population.z_mm).max(), np.abs(touch.nodes.z_mm).max(initial=1.0)]
    half_width = float(max(across)) + _MARGIN_MM
    return half_width, max(float(max(along)) + _MARGIN_MM, _LEAST_SHARE * half_width)


def draw_pressure(panel: "Axes", touch: Touch, row: int) -> Any:  # noqa: ANN401 - an image
    """Contact pressure of the solved state `row` as a map; None where nothing touches."""
    if not touch.nodes.column.size:
        return None
    pad = touch.nodes.pad
    grid = pressure_kpa(touch, row)
    first = int(touch.nodes.row.min())
    middle = 0.5 * (pad.x_mm[1:] + pad.x_mm[:-1])
    edge = np.concatenate([2 * pad.x_mm[:1] - middle[:1], middle, 2 * pad.x_mm[-1:] - middle[-1:]])
    rows_mm = (np.arange(first, first + len(grid) + 1) - 0.5) * pad.spacing_mm
    if pad.plane:
        half_length = view_mm(touch)[1]
        rows_mm = np.array([-half_length, half_length])
    top = max(float(np.nanmax(grid, initial=0.0)), 1e-3)
    return panel.pcolormesh(
        edge, rows_mm, grid, cmap=_pressure_colours(), vmin=0.0, vmax=top, rasterized=True
    )


def pressure_kpa(touch: Touch, row: int) -> FloatArray:
    """Pressure on all columns and the touched rows of the skin; NaN where nothing touches."""
    nodes = touch.nodes
    first, last = int(nodes.row.min()), int(nodes.row.max())
    area_mm2 = nodes.pad.node_mm2[nodes.column]
    grid = np.full((last - first + 1, nodes.pad.x_mm.size), np.nan)
    force = touch.contact_n[row]
    grid[nodes.row - first, nodes.column] = np.where(
        force > 0, force / area_mm2 * _KPA_PER_N_MM2, np.nan
    )
    return grid


def _pressure_colours() -> Any:  # noqa: ANN401 - a colour map
    """Greys without white and black: on paper all of it is seen."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("pressure", ["#E4E4E4", "#303030"])


def draw_way(panel: "Axes", touch: Touch) -> None:
    """Depth and force over time."""
    times_ms = touch.way.times_ms
    panel.plot(times_ms, touch.depth_um, color=INK, linewidth=LINE_PT)
    make_plain(panel)
    panel.set_xlabel("Time (ms)")
    panel.set_ylabel("Depth (µm)")
    panel.set_ylim(
        min(float(touch.depth_um.min()), 0.0), 1.15 * max(float(touch.depth_um.max()), 1.0)
    )
    panel.set_xlim(0, float(times_ms[-1]))
    other = panel.twinx()
    other.plot(times_ms, touch.force_n, color="#CC79A7", linewidth=LINE_PT, linestyle=(0, (4, 1.5)))
    unit = "N/mm" if touch.nodes.pad.plane else "N"
    other.set_ylabel(f"Force ({unit})", fontsize=SMALL_TEXT_PT, color="#CC79A7")
    make_plain(other)
    other.spines["right"].set_visible(True)
    other.spines["left"].set_visible(False)
    other.set_ylim(0, 1.15 * max(float(touch.force_n.max()), 1e-6))


def _draw_units(panel: "Axes", touch: Touch, mine: BoolArray, colour: str) -> None:
    """Units of a class, larger the more they fire, and what the largest stands for."""
    rate, x_mm, z_mm = (
        touch.rate_ips[mine],
        touch.population.x_mm[mine],
        touch.population.z_mm[mine],
    )
    fires, most_ips = rate > 0, max(float(rate.max()), 1e-9)
    panel.scatter(
        x_mm[~fires],
        z_mm[~fires],
        s=_LEAST_PT2,
        facecolors="none",
        edgecolors=FAINT,
        linewidths=0.35,
        zorder=2,
    )
    firing: dict[str, Any] = {
        "color": colour,
        "edgecolors": "white",
        "linewidths": 0.3,
        "alpha": 0.9,
        "zorder": 3,
    }
    size_pt2 = _LEAST_PT2 + (_MOST_PT2 - _LEAST_PT2) * rate[fires] / most_ips
    panel.scatter(x_mm[fires], z_mm[fires], s=size_pt2, **firing)
    if fires.any():
        mark = panel.scatter([], [], s=_MOST_PT2, **firing)
        panel.legend(
            [mark],
            [f"{most_ips:.3g}/s"],
            loc="lower right",
            fontsize=SMALL_TEXT_PT - 1,
            frameon=True,
            framealpha=0.85,
            edgecolor="none",
            borderpad=0.2,
            handletextpad=0.2,
        )


def _draw_view(panel: "Axes", touch: Touch, *, first: bool) -> None:
    half_width, half_length = view_mm(touch)
    panel.set_xlim(-half_width, half_width)
    panel.set_ylim(-half_length, half_length)
    panel.set_aspect("equal")
    make_plain(panel)
    panel.set_xlabel("Across the finger (mm)")
    panel.set_ylabel("Along the finger (mm)" if first else "")
    if not first:
        panel.tick_params(labelleft=False)
    if touch.way.x_mm is not None and touch.way.z_mm is not None:
        way = touch.way.x_mm, touch.way.z_mm
        step = np.array([way[0][-1] - way[0][0], way[1][-1] - way[1][0]])
        length = float(np.hypot(*step))
        if length > 0:
            x, z = 2.5 * step / length
            middle = np.array([-0.82 * half_width, 0.86 * half_length])
            panel.annotate(
                "",
                xy=(middle[0] + x / 2, middle[1] + z / 2),
                xytext=(middle[0] - x / 2, middle[1] - z / 2),
                arrowprops={"arrowstyle": "->", "color": INK, "linewidth": LINE_PT},
            )


def hardest(touch: Touch) -> int:
    """The solved state with the largest force."""
    return int(touch.contact_n.sum(axis=1).argmax()) if touch.contact_n.size else 0
