"""A receptive field: impulses of one afferent against the position of the probe."""

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


@in_style
def field_figure(field: "ReceptiveField", axes: "Sequence[Axes] | None" = None) -> "Figure":
    """Maps of impulses, one per depth, with the border of the field; and area against depth.

    `axes` are these panels, the area last. Raises UsageError: another number of axes.
    """
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.ticker import MaxNLocator

    count = len(field.depth_um)
    rows = np.unique(np.linspace(0, count - 1, min(count, _MAX_PANELS)).astype(int))
    colour = AFFERENT_COLOURS[field.afferent]
    colours = LinearSegmentedColormap.from_list("impulses", ["#FFFFFF", colour])
    half_mm = min(_SHOWN_MM, float(field.z_mm[-1]))
    width_in = (PAGE_WIDTH_IN - 0.8) / _MAX_PANELS
    height_in = width_in * half_mm / float(field.x_mm[-1])
    if axes is None:
        from fembridge.plots.notebook_figure import NotebookFigure

        figure: Figure = NotebookFigure(
            figsize=(PAGE_WIDTH_IN, height_in + 2.25), layout="constrained"
        )
        grid = figure.add_gridspec(2, _MAX_PANELS, height_ratios=[height_in, 1.3])
        panels = [figure.add_subplot(grid[0, column]) for column in range(len(rows))]
        area_panel = figure.add_subplot(grid[1, :])
    else:
        figure, (*panels, area_panel) = checked_axes(axes, len(rows) + 1)
    highest = max(int(field.impulses.max()), 1)
    for column, (panel, row) in enumerate(zip(panels, rows, strict=True)):
        image = panel.pcolormesh(
            field.x_mm,
            field.z_mm,
            field.impulses[row].T,
            cmap=colours,
            vmin=0,
            vmax=highest,
            shading="nearest",
            rasterized=True,
        )
        inside = field.responds[row]
        if inside.any() and not inside.all():
            border = inside.T.astype(float)
            panel.contour(
                field.x_mm, field.z_mm, border, levels=[0.5], colors=[INK], linewidths=[LINE_PT]
            )
        panel.set_aspect("equal")
        panel.set_ylim(-half_mm, half_mm)
        panel.set_xlabel("Across (mm)")
        panel.set_ylabel("Along (mm)" if not column else "")
        _, _, area_mm2, is_complete = field.areas.iloc[row]
        panel.set_title(
            f"{field.depth_um[row]:.0f} µm\n{'' if is_complete else '> '}{area_mm2:.1f} mm²"
        )
    bar = figure.colorbar(image, ax=panels, fraction=0.02, pad=0.01)
    bar.set_label("Impulses")
    bar.locator = MaxNLocator(5, integer=True)
    bar.update_ticks()
    _draw_area(area_panel, field)
    for panel in (*panels, area_panel, bar.ax):
        make_plain(panel)
    if axes is None:
        title = f"{field.afferent}, probe {field.probe_diameter_mm:g} mm, threshold "
        figure.suptitle(f"{title}{field.threshold_um:.3g} µm", **class_style(field.afferent))
    return figure


@in_style
def area_figure(field: "ReceptiveField", axes: "Sequence[Axes] | None" = None) -> "Figure":
    """Area of the field against the depth of the probe; `axes` is the one panel to draw into."""
    figure, panels = new_figure(2.0, axes=axes)
    _draw_area(panels[0, 0], field)
    make_plain(panels[0, 0])
    return figure


def _draw_area(panel: "Axes", field: "ReceptiveField") -> None:
    colour = AFFERENT_COLOURS[field.afferent]
    panel.plot(field.depth_um, field.areas["area_mm2"], color=colour, marker="o", markersize=3.5)
    panel.set_ylim(bottom=0)
    panel.set_xlabel("Depth of the probe (µm)")
    panel.set_ylabel("Area (mm²)")
