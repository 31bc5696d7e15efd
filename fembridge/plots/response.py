"""A response map: stress at the afferents, and the probe's force, against depth."""

import math
from typing import TYPE_CHECKING

import numpy as np

from fembridge.plots.style import (
    AFFERENT_COLOURS,
    INK,
    LINE_PT,
    PAGE_WIDTH_IN,
    SMALL_TEXT_PT,
    TEXT_PT,
    make_plain,
    spread,
)
from fembridge.response.response_map import ResponseMap
from fembridge.results.stress import von_mises_pa
from fembridge.typing import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_HEIGHT_IN = 2.15
_POINTS = 301
_PA_PER_KPA, _MN_PER_N = 1000.0, 1000.0
_DOT_PT = 2.6
# A closure below this is shown as this: rounding is no property of a contact.
_LEAST_PERCENT = 0.01
# A name takes this share of its panel's height.
_NAME_SHARE = 0.09

# Their stress is tens of times smaller than the others': a scale of its own.
_DEEP = ("PC",)


def response_figure(response: ResponseMap) -> "Figure":
    """Stress at each afferent and the probe's force against depth.

    Dots are the solved depths, lines what is interpolated between them. What the
    load–unload run showed is written below.
    """
    from matplotlib.figure import Figure

    deep = [k for k, place in enumerate(response.places) if place.afferent in _DEEP]
    shallow = [k for k in range(len(response.places)) if k not in deep]
    groups = [group for group in (shallow, deep) if group]
    figure = Figure(figsize=(PAGE_WIDTH_IN, _HEIGHT_IN), layout="constrained")
    panels = figure.subplots(1, len(groups) + 1, squeeze=False)[0]
    solved_kpa = von_mises_pa(response.tensor_pa) / _PA_PER_KPA
    depth_um = np.linspace(0.0, response.deepest_um, _POINTS)
    curve_kpa = von_mises_pa(response.tensors(depth_um)) / _PA_PER_KPA
    for panel, group in zip(panels, groups, strict=False):
        for column in group:
            afferent = response.places[column].afferent
            colour = AFFERENT_COLOURS.get(afferent, INK)
            panel.plot(depth_um, curve_kpa[:, column], color=colour, linewidth=LINE_PT)
            _draw_dots(panel, response.depth_um, solved_kpa[:, column], colour)
        panel.set_ylabel("Von Mises stress (kPa)", fontsize=SMALL_TEXT_PT, color=INK)
    _draw_force(panels[-1], response)
    for panel in panels:
        panel.set_xlim(0.0, response.deepest_um)
        panel.set_ylim(bottom=0.0)
        panel.set_xlabel("Depth of the probe (µm)", fontsize=SMALL_TEXT_PT, color=INK)
        make_plain(panel)
    for panel, group in zip(panels, groups, strict=False):
        names = [response.places[column].afferent for column in group]
        _name_lines(panel, names, solved_kpa[-1, group])
    figure.supxlabel(closure_text(response), fontsize=SMALL_TEXT_PT, color=INK)
    return figure


def closure_text(response: ResponseMap) -> str:
    """What the load–unload run showed, in words."""
    if not math.isfinite(response.closure_percent):
        return "Unloading was not compared with loading."
    percent = max(response.closure_percent, _LEAST_PERCENT)
    return (
        "Unloading came back to the stress of loading within "
        f"{percent:.2g} % at every depth compared."
    )


def _draw_force(panel: "Axes", response: ResponseMap) -> None:
    force_mn_per_mm = response.force_n_per_mm * _MN_PER_N
    panel.plot(response.depth_um, force_mn_per_mm, color=INK, linewidth=LINE_PT)
    _draw_dots(panel, response.depth_um, force_mn_per_mm, INK)
    panel.set_ylabel("Force on the probe (mN/mm)", fontsize=SMALL_TEXT_PT, color=INK)


def _draw_dots(panel: "Axes", depth_um: FloatArray, height: FloatArray, colour: str) -> None:
    panel.plot(
        depth_um,
        height,
        linestyle="none",
        marker="o",
        markersize=_DOT_PT,
        color=colour,
        markeredgewidth=0.0,
        clip_on=False,
    )


def _name_lines(panel: "Axes", names: list[str], end_kpa: FloatArray) -> None:
    """Write each name at its line's end, moved apart where lines end together."""
    bottom, top = panel.get_ylim()
    order = np.argsort(-end_kpa, kind="stable")
    heights = spread(end_kpa[order].tolist(), _NAME_SHARE * (top - bottom), bottom, top)
    for row, height in zip(order, heights, strict=True):
        panel.annotate(
            names[row],
            (1.0, height),
            xycoords=("axes fraction", "data"),
            xytext=(5, 0),
            textcoords="offset points",
            va="center",
            fontsize=TEXT_PT,
            fontweight="bold",
            color=AFFERENT_COLOURS.get(names[row], INK),
            annotation_clip=False,
        )
