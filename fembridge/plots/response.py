"""The pressed skin: stress and force against depth, and its profile around a thin probe."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge.plots.style import (
    FAINT,
    HAIR_PT,
    INK,
    LINE_PT,
    class_style,
    dots,
    in_style,
    new_figure,
    note,
    spread_heights,
)
from fembridge.response.deflection import PAPER_STEP_MM, Deflection
from fembridge.response.response_map import ResponseMap
from fembridge.results.von_mises import von_mises_pa

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fembridge.plots.style import Panels

_HEIGHT_IN = 2.15
_POINTS = 301
_PA_PER_KPA, _MN_PER_N, _UM_PER_MM = 1000.0, 1000.0, 1000.0
_DOT_PT = 2.6
_MAX_DOTTED = 12
# Smaller closures are shown as this value: they are rounding.
_MIN_PERCENT = 0.01
# Height of a name as a share of its panel's height.
_NAME_SHARE = 0.09

# Classes with a stress tens of times smaller than the others': shown on another scale.
_DEEP_CLASSES = ("PC",)

# Height of the figure of the profile.
_PROFILE_IN = 2.5
# Styles of the coarser meshes; the finest is a solid black line.
_STYLES: tuple[dict[str, Any], ...] = tuple(
    {"color": colour, "dashes": dashes, "linewidth": 1.4 * LINE_PT, "zorder": 3}
    for colour, dashes in (
        ("#E69F00", (1, 1.2)),
        ("#56B4E9", (4, 1.5)),
        ("#009E73", (6, 1.5, 1, 1.5)),
        ("#CC79A7", (2, 1)),
    )
)
_PROFILE_DOT_PT = 3.2
_MARGIN_SHARE = 1.08


@in_style
def response_figure(response: ResponseMap, axes: "Panels | None" = None) -> "Figure":
    """Stress at each afferent and force on the probe against its depth.

    Dots are solved depths, lines are interpolated. The result of the load–unload check is
    written below. With `axes`, for SA and RA, for PC and for the force, as far as the map has
    them, the panels are drawn into them, without that text. The name of a class is at the unit
    with the largest stress; of more than `_MAX_DOTTED` units there are no dots. A map of a load
    is drawn against the load.
    """
    solved_kpa = von_mises_pa(response.tensor_pa) / _PA_PER_KPA
    columns: dict[str, list[int]] = {}
    for column in np.argsort(-solved_kpa.max(axis=0), kind="stable").tolist():
        columns.setdefault(response.places[column].afferent, []).append(column)
    columns = {name: columns[name] for name in sorted(columns, key=response.class_names().index)}
    groups = [
        [name for name in columns if (name in _DEEP_CLASSES) == deep] for deep in (False, True)
    ]
    groups = list(filter(None, groups))
    has_force = response.force_n_per_mm.size > 0
    figure, [panels] = new_figure(_HEIGHT_IN, columns=len(groups) + has_force, axes=axes)
    depth_um = np.linspace(response.depth_um[0], response.deepest_um, _POINTS)
    curve_kpa = von_mises_pa(response.tensors(depth_um)) / _PA_PER_KPA
    load = response.load
    per_um = 1.0 if load is None else load.per_um
    label = "Depth of the probe (µm)"
    if load is not None:
        label = f"{load.quantity.capitalize()} ({load.unit})"
    for panel, group in zip(panels, groups, strict=False):
        by_stress = sorted(group, key=lambda name: -solved_kpa[-1, columns[name][0]])
        has_dots = sum(len(columns[name]) for name in group) <= _MAX_DOTTED
        for name in group:
            colour = class_style(name)["color"]
            panel.plot(per_um * depth_um, curve_kpa[:, columns[name]], color=colour)
            if has_dots:
                style = dots(colour, _DOT_PT, clip_on=False)
                solved = solved_kpa[:, columns[name]]
                panel.plot(per_um * response.depth_um, solved, **style)
        panel.set_ylabel("Von Mises stress (kPa)")
        panel.set_ylim(bottom=0.0)
        bottom, top = panel.get_ylim()
        end_kpa = [solved_kpa[-1, columns[name][0]] for name in by_stress]
        heights = spread_heights(end_kpa, _NAME_SHARE * (top - bottom), bottom, top)
        frame = ("axes fraction", "data")
        for name, height in zip(by_stress, heights, strict=True):
            note(panel, name, (1.0, height), (5, 0), frame=frame, va="center", **class_style(name))
    if has_force:
        style = {"marker": "o", "markersize": _DOT_PT, "clip_on": False}
        panels[-1].plot(response.depth_um, response.force_n_per_mm * _MN_PER_N, **style)
        panels[-1].set_ylabel("Force on the probe (mN/mm)")
        panels[-1].set_ylim(bottom=0.0)
    ends = (per_um * float(response.depth_um[0]), per_um * response.deepest_um)
    for panel in panels:
        panel.set(xlim=ends, xlabel=label)
    if axes is None:
        figure.supxlabel(closure_text(response))
    return figure


def closure_text(response: ResponseMap) -> str:
    """Result of the load–unload check as a sentence."""
    if not math.isfinite(response.closure_percent):
        return "Unloading was not compared with loading."
    percent = max(response.closure_percent, _MIN_PERCENT)
    text = "The stress in unloading agreed with that in loading within"
    return f"{text} {percent:.2g} % at every compared depth."


@in_style
def deflection_figure(deflections: Sequence[Deflection], axes: "Panels | None" = None) -> "Figure":
    """Profile of the skin on each mesh, with dots every 0.5 mm as in the paper.

    In the middle the difference of each mesh from the finest, if there are two or more; on the
    right the force on the probe during loading. `axes` are drawn into instead of a new figure:
    three, of one mesh two.
    """
    meshes = sorted(deflections, key=lambda deflection: deflection.elements)
    finest = meshes[-1]
    styles = [*_STYLES[: len(meshes) - 1], {"color": INK}]
    last_mm = min(float(mesh.distance_mm[-1]) for mesh in meshes)
    paper_mm = np.arange(0.0, last_mm + 1e-9, PAPER_STEP_MM)
    widths = (1.5, 1.0, 1.0) if len(meshes) > 1 else (1.5, 1.0)
    figure, [[profile, *differences, force]] = new_figure(
        _PROFILE_IN, columns=len(widths), widths=widths, axes=axes
    )
    if axes is None:
        figure.set_layout_engine("constrained", wspace=0.06)

    profile.axhline(0.0, color=FAINT, linewidth=HAIR_PT)
    for mesh, style in zip(meshes, styles, strict=True):
        count = f"{mesh.elements:,}".replace(",", "\N{NO-BREAK SPACE}")
        label = f"{mesh.name}, {count} elements"
        profile.plot(mesh.distance_mm, mesh.deflection_mm, label=label, **style)
        force.plot(mesh.loading_mm, _MN_PER_N * mesh.loading_n_per_mm, **style)
    style = dots(INK, _PROFILE_DOT_PT, clip_on=False, label=f"every {PAPER_STEP_MM:g} mm")
    profile.plot(paper_mm, finest.at(paper_mm), **style)
    deepest_mm = max(float(mesh.deflection_mm.max()) for mesh in meshes)
    profile.set_ylim(_MARGIN_SHARE * deepest_mm, -0.02 * deepest_mm)
    profile.set_ylabel("Deflection (mm)")
    profile.legend(loc="lower right", handlelength=2.6)

    for panel in differences:
        panel.axhline(0.0)
        for mesh, style in zip(meshes[:-1], styles, strict=False):
            distance_mm = mesh.distance_mm[mesh.distance_mm <= last_mm]
            panel.plot(
                distance_mm, _UM_PER_MM * (mesh.at(distance_mm) - finest.at(distance_mm)), **style
            )
        panel.set_ylabel(f"Difference from {finest.name} (µm)")
    for panel in (profile, *differences):
        panel.set(xlim=(0.0, paper_mm[-1]), xlabel="Distance from the probe (mm)")
    force.set_xlim(0.0, max(mesh.depth_mm for mesh in meshes))
    force.set_ylim(bottom=0.0)
    force.set(xlabel="Depth of the probe (mm)", ylabel="Force on the probe (mN/mm)")
    return figure
