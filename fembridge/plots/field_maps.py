"""Receptive fields: impulses of units of a class against the position of the probe."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from fembridge.plots.style import (
    AFFERENT_COLOURS,
    INK,
    LINE_PT,
    PAGE_WIDTH_IN,
    checked_axes,
    class_style,
    in_style,
    make_plain,
    new_figure,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from fembridge.touching.receptive_field import ReceptiveField

_MAX_PANELS = 5
_SHOWN_MM = 6.0
# A map shows the skin around the fields, at least so far from the unit.
_LEAST_SHOWN_MM = 2.0
_ROOM_MM = 0.75


@in_style
def field_figure(field: "ReceptiveField", axes: "Sequence[Axes] | None" = None) -> "Figure":
    """Maps of impulses with the borders of the fields; and areas against depth.

    First the unit of median sensitivity at each depth, five at most; then, of several units,
    five others at the last depth, from the most to the least sensitive; the areas last. `axes`
    are these panels. Raises UsageError: another number of axes.
    """
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.ticker import MaxNLocator

    maps = _shown_maps(field)
    columns = max(sum(first == 0 for first, *_ in maps), sum(first == 1 for first, *_ in maps))
    colours = LinearSegmentedColormap.from_list(
        "impulses", ["#FFFFFF", AFFERENT_COLOURS[field.afferent]]
    )
    half_mm = _half_shown_mm(field, maps)
    if axes is None:
        from fembridge.plots.notebook_figure import NotebookFigure

        rows = 1 + maps[-1][0]
        width_in = (PAGE_WIDTH_IN - 1.2) / _MAX_PANELS
        height_in = width_in * half_mm[1] / half_mm[0] + 0.55
        figure: Figure = NotebookFigure(
            figsize=(PAGE_WIDTH_IN, rows * height_in + 2.2), layout="constrained"
        )
        grid = figure.add_gridspec(rows + 1, _MAX_PANELS, height_ratios=[height_in] * rows + [1.3])
        panels = []
        for row in range(rows):
            of_row = sum(first == row for first, *_ in maps)
            panels += [figure.add_subplot(grid[row, column]) for column in range(of_row)]
        area_panel = figure.add_subplot(grid[-1, :])
    else:
        figure, (*panels, area_panel) = checked_axes(axes, len(maps) + 1)
        rows = 1 + maps[-1][0]
    shown = [field.impulses[unit, depth] for _, unit, depth in maps]
    highest = max(*(int(impulses.max()) for impulses in shown), 1)
    areas = field.areas["area_mm2"].to_numpy().reshape(len(field.unit), -1)
    whole = field.areas["whole"].to_numpy().reshape(areas.shape)
    previous = -1
    for panel, impulses, (row, unit, depth) in zip(panels, shown, maps, strict=True):
        image = panel.pcolormesh(
            field.x_mm,
            field.z_mm,
            impulses.T,
            cmap=colours,
            vmin=0,
            vmax=highest,
            shading="nearest",
            rasterized=True,
        )
        inside = field.responds[unit, depth]
        if inside.any() and not inside.all():
            border = inside.T.astype(float)
            panel.contour(
                field.x_mm, field.z_mm, border, levels=[0.5], colors=[INK], linewidths=[LINE_PT]
            )
        panel.set_aspect("equal")
        panel.set_xlim(-half_mm[0], half_mm[0])
        panel.set_ylim(-half_mm[1], half_mm[1])
        panel.set_xlabel("Across (mm)" if row == rows - 1 else "")
        panel.set_ylabel("Along (mm)" if row != previous else "")
        area = f"{'' if whole[unit, depth] else '> '}{areas[unit, depth]:.1f} mm²"
        title = f"{field.depth_um[unit, depth]:.0f} µm"
        times = field.times_threshold[depth]
        if row == 0 and np.isfinite(times):
            title += f", {times:g} x"
        panel.set_title(f"{title}\n{area}" if row == 0 else f"{field.unit[unit]}, {title}\n{area}")
        previous = row
    bar = figure.colorbar(image, ax=panels, fraction=0.02 * 5 / max(columns, 1), pad=0.01)
    bar.set_label("Impulses")
    bar.locator = MaxNLocator(5, integer=True)
    bar.update_ticks()
    _draw_area(area_panel, field)
    for panel in (*panels, area_panel, bar.ax):
        make_plain(panel)
    if axes is None:
        median_um, median_mn = (
            float(np.median(values)) for values in (field.threshold_um, field.threshold_mn)
        )
        many = len(field.unit) > 1
        count, median = (f", {len(field.unit)} units", "median ") if many else ("", "")
        figure.suptitle(
            f"{field.afferent}{count}, probe {field.probe_diameter_mm:g} mm, {median}threshold "
            f"{median_um:.3g} µm, {median_mn:.2g} mN",
            **class_style(field.afferent),
        )
    return figure


@in_style
def area_figure(field: "ReceptiveField", axes: "Sequence[Axes] | None" = None) -> "Figure":
    """Areas of the fields against the depth of the probe; `axes` is the one panel to draw into."""
    figure, panels = new_figure(2.0, axes=axes)
    _draw_area(panels[0, 0], field)
    make_plain(panels[0, 0])
    return figure


def _shown_maps(field: "ReceptiveField") -> list[tuple[int, int, int]]:
    """Row of the figure, unit and depth of each map."""
    depths = np.flatnonzero(np.isfinite(field.depth_um[field.middle]))
    chosen = depths[
        np.unique(np.linspace(0, depths.size - 1, min(depths.size, _MAX_PANELS)).astype(int))
    ]
    maps = [(0, field.middle, depth) for depth in chosen.tolist()]
    last = int(chosen[-1])
    known = np.flatnonzero(np.isfinite(field.depth_um[:, last]))
    others = known[known != field.middle]
    if others.size:
        rows = np.unique(np.linspace(0, others.size - 1, min(others.size, _MAX_PANELS)).astype(int))
        maps += [(1, unit, last) for unit in others[rows].tolist()]
    return maps


def _half_shown_mm(
    field: "ReceptiveField", maps: list[tuple[int, int, int]]
) -> tuple[float, float]:
    """Half of the width and the length of the maps: all that fires, and some room."""
    fires = np.any([field.impulses[unit, depth] > 0 for _, unit, depth in maps], axis=0)
    halves = []
    for axis, along in ((field.x_mm, fires.any(axis=1)), (field.z_mm, fires.any(axis=0))):
        reach_mm = float(np.abs(axis[along]).max()) + _ROOM_MM if along.any() else 0.0
        halves.append(min(max(reach_mm, _LEAST_SHOWN_MM), _SHOWN_MM, float(axis[-1])))
    return halves[0], halves[1]


def _draw_area(panel: "Axes", field: "ReceptiveField") -> None:
    """Areas of each unit and their median; of a multiple of the threshold at the unit's depth."""
    colour = AFFERENT_COLOURS[field.afferent]
    areas = field.areas["area_mm2"].to_numpy().reshape(len(field.unit), -1)
    for depth, times in enumerate(field.times_threshold):
        own = np.isfinite(times)
        panel.plot(
            field.depth_um[:, depth],
            areas[:, depth],
            color=colour,
            linestyle="none",
            marker="^" if own else "o",
            markersize=4 if own else 3.5,
            alpha=1.0 if len(field.unit) == 1 else 0.45,
            label=f"{times:g} x threshold" if own else None,
        )
    shared = np.flatnonzero(np.isnan(field.times_threshold))
    if shared.size:
        panel.plot(
            field.depth_um[0, shared],
            np.median(areas[:, shared], axis=0),
            color=colour,
            label="median" if len(field.unit) > 1 else None,
        )
    if panel.get_legend_handles_labels()[1]:
        panel.legend(frameon=False, loc="best")
    panel.set_ylim(bottom=0)
    panel.set_xlabel("Depth of the probe (µm)")
    panel.set_ylabel("Area (mm²)")
