"""The skin's profile under a thin probe: on every mesh, how they differ, the force."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge.deflection.profile import PAPER_STEP_MM, Deflection
from fembridge.errors import UsageError
from fembridge.plots.style import (
    FAINT,
    HAIR_PT,
    INK,
    LINE_PT,
    PAGE_WIDTH_IN,
    SMALL_TEXT_PT,
    make_plain,
    name_axes,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_MESHES = 5

_HEIGHT_IN = 2.5
_WIDTHS = (1.5, 1.0, 1.0)
# From the coarsest mesh to the finest, which is black; the others are grey.
_COLOURS = ("#E69F00", "#56B4E9", "#009E73", "#CC79A7")
_DASHES = ((1, 1.2), (4, 1.5), (6, 1.5, 1, 1.5), (2, 1))
_DOT_PT = 3.2
# Between panels, as a share of their width.
_BETWEEN = 0.06
_ROOM_SHARE = 1.08
_UM_PER_MM, _MN_PER_N = 1000.0, 1000.0


def deflection_figure(deflections: Sequence[Deflection]) -> "Figure":
    """The skin's profile on every mesh, with dots every 0.5 mm as in the paper.

    In the middle how each mesh differs from the finest, where there are two or more;
    right the force on the probe on its way down.

    Raises
    ------
    UsageError
        No profile or more than five.
    """
    from matplotlib.figure import Figure

    if not 0 < len(deflections) <= MOST_MESHES:
        raise UsageError(f"{len(deflections)} profiles, expected 1 to {MOST_MESHES} in one picture")
    meshes = sorted(deflections, key=lambda deflection: deflection.elements)
    compared = len(meshes) > 1
    widths = _WIDTHS if compared else (_WIDTHS[0], _WIDTHS[2])
    figure = Figure(figsize=(PAGE_WIDTH_IN, _HEIGHT_IN))
    figure.set_layout_engine("constrained", wspace=_BETWEEN)
    panels = figure.subplots(1, len(widths), squeeze=False, gridspec_kw={"width_ratios": widths})[0]
    _draw_profiles(panels[0], meshes)
    if compared:
        _draw_differences(panels[1], meshes)
    _draw_force(panels[-1], meshes)
    for panel in panels:
        make_plain(panel)
    return figure


def _draw_profiles(panel: "Axes", meshes: list[Deflection]) -> None:
    last_mm = min(float(mesh.distance_mm[-1]) for mesh in meshes)
    panel.axhline(0.0, color=FAINT, linewidth=HAIR_PT)
    for k, mesh in enumerate(meshes):
        panel.plot(
            mesh.distance_mm,
            mesh.deflection_mm,
            label=f"{mesh.name}, {_thousands(mesh.elements)} elements",
            **_style(k, len(meshes)),
        )
    finest = meshes[-1]
    paper_mm = np.arange(0.0, last_mm + 1e-9, PAPER_STEP_MM)
    panel.plot(
        paper_mm,
        finest.at(paper_mm),
        linestyle="none",
        marker="o",
        markersize=_DOT_PT,
        color=INK,
        markeredgewidth=0.0,
        clip_on=False,
        label=f"every {PAPER_STEP_MM:g} mm",
    )
    deepest_mm = max(float(mesh.deflection_mm.max()) for mesh in meshes)
    panel.set_xlim(0.0, np.floor(last_mm / PAPER_STEP_MM) * PAPER_STEP_MM)
    panel.set_ylim(_ROOM_SHARE * deepest_mm, -0.02 * deepest_mm)
    name_axes(panel, "Distance from the probe (mm)", "Deflection (mm)")
    panel.legend(
        loc="lower right", frameon=False, fontsize=SMALL_TEXT_PT, labelcolor=INK, handlelength=2.6
    )


def _draw_differences(panel: "Axes", meshes: list[Deflection]) -> None:
    finest = meshes[-1]
    last_mm = min(float(mesh.distance_mm[-1]) for mesh in meshes)
    panel.axhline(0.0, color=INK, linewidth=LINE_PT)
    for k, mesh in enumerate(meshes[:-1]):
        here_mm = mesh.distance_mm[mesh.distance_mm <= last_mm]
        differ_um = _UM_PER_MM * (mesh.at(here_mm) - finest.at(here_mm))
        panel.plot(here_mm, differ_um, **_style(k, len(meshes)))
    panel.set_xlim(0.0, np.floor(last_mm / PAPER_STEP_MM) * PAPER_STEP_MM)
    name_axes(panel, "Distance from the probe (mm)", f"Difference from {finest.name} (µm)")


def _draw_force(panel: "Axes", meshes: list[Deflection]) -> None:
    for k, mesh in enumerate(meshes):
        force_mn_per_mm = _MN_PER_N * mesh.loading_n_per_mm
        panel.plot(mesh.loading_mm, force_mn_per_mm, **_style(k, len(meshes)))
    panel.set_xlim(0.0, max(mesh.depth_mm for mesh in meshes))
    panel.set_ylim(bottom=0.0)
    name_axes(panel, "Depth of the probe (mm)", "Force on the probe (mN/mm)")


def _style(k: int, count: int) -> dict[str, Any]:
    """Line style of mesh `k` of `count`: the finest is black and whole."""
    if k == count - 1:
        return {"color": INK, "linewidth": LINE_PT}
    return {"color": _COLOURS[k], "linewidth": 1.4 * LINE_PT, "dashes": _DASHES[k], "zorder": 3}


def _thousands(count: int) -> str:
    return f"{count:,}".replace(",", "\N{NO-BREAK SPACE}")
