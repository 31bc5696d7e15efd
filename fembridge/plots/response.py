"""A response map: stress at the afferents, and the probe's force, against depth."""

import math
from typing import TYPE_CHECKING

import numpy as np

from fembridge.plots.style import class_style, dots, in_style, new_figure, note, spread
from fembridge.response.response_map import ResponseMap
from fembridge.results.stress import von_mises_pa

if TYPE_CHECKING:
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


@in_style
def response_figure(response: ResponseMap) -> "Figure":
    """Stress at each afferent and the probe's force against depth.

    Dots are the solved depths, lines what is interpolated between them. What the
    load–unload run showed is written below.
    """
    places = {place.afferent: column for column, place in enumerate(response.places)}
    groups = [[name for name in places if (name in _DEEP) == deep] for deep in (False, True)]
    groups = [group for group in groups if group]
    figure, [panels] = new_figure(_HEIGHT_IN, columns=len(groups) + 1)
    depth_um = np.linspace(0.0, response.deepest_um, _POINTS)
    solved_kpa = von_mises_pa(response.tensor_pa) / _PA_PER_KPA
    curve_kpa = von_mises_pa(response.tensors(depth_um)) / _PA_PER_KPA
    for panel, group in zip(panels, groups, strict=False):
        ends = sorted(group, key=lambda name: -solved_kpa[-1, places[name]])
        for name in group:
            colour, column = class_style(name)["color"], places[name]
            panel.plot(depth_um, curve_kpa[:, column], color=colour)
            style = dots(colour, _DOT_PT, clip_on=False)
            panel.plot(response.depth_um, solved_kpa[:, column], **style)
        panel.set(xlim=(0.0, response.deepest_um), ylabel="Von Mises stress (kPa)")
        panel.set_ylim(bottom=0.0)
        bottom, top = panel.get_ylim()
        end_kpa = [solved_kpa[-1, places[name]] for name in ends]
        heights = spread(end_kpa, _NAME_SHARE * (top - bottom), bottom, top)
        frame = ("axes fraction", "data")
        for name, height in zip(ends, heights, strict=True):
            note(panel, name, (1.0, height), (5, 0), frame=frame, va="center", **class_style(name))
    force_mn_per_mm = response.force_n_per_mm * _MN_PER_N
    panels[-1].plot(
        response.depth_um, force_mn_per_mm, marker="o", markersize=_DOT_PT, clip_on=False
    )
    panels[-1].set(xlim=(0.0, response.deepest_um), ylabel="Force on the probe (mN/mm)")
    panels[-1].set_ylim(bottom=0.0)
    for panel in panels:
        panel.set_xlabel("Depth of the probe (µm)")
    figure.supxlabel(closure_text(response))
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
