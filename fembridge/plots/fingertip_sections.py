"""A round fingertip, cut along the finger and across it: layers, elements and afferents.

The pad is up, as in the deck, and the tip on the right. Both sections are to one scale; dots are
the nodes with afferents near the plane of the section.
"""

from typing import TYPE_CHECKING

import numpy as np

from decks.finger import LAYERS
from decks.fingertip import Fingertip
from decks.fingertip_mesh import TipMesh
from fembridge.plots.finger_mesh import Window, draw_bar, draw_legend
from fembridge.plots.style import (
    INK,
    LAYER_COLOURS,
    WHITE,
    class_style,
    dots,
    in_style,
    new_figure,
    note,
)
from fembridge.typing import FloatArray, IntArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Inches: width of both panels, height of the legend and the bars below them.
_PANELS_IN, _LEGEND_IN = 6.2, 1.2
_MARGIN_MM = 0.4
# A cut through nodes would run along faces: it is this far from the plane of symmetry.
_OFF_PLANE_MM = 1.0e-3
# Edges of the four faces of a tetrahedron, by corners.
_EDGES = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))
_MESH_LINE_PT, _BOUNDARY_PT, _DOT_PT = 0.2, 0.5, 3.0
_LINE_SHARE = 0.72


@in_style
def sections_figure(tip: Fingertip, mesh: TipMesh) -> "Figure":
    """Sections at ``x = 0`` (along the finger) and ``z = 0`` (across the apex of the pad)."""
    cuts = [(0, (2, 1), "along the finger"), (2, (0, 1), "across the finger")]
    polygons = [cut_polygons(mesh, axis, _OFF_PLANE_MM, kept) for axis, kept, _ in cuts]
    windows = []
    for points, _ in polygons:
        corners_mm = np.concatenate(points)
        low, high = corners_mm.min(axis=0) - _MARGIN_MM, corners_mm.max(axis=0) + _MARGIN_MM
        windows.append(Window((low[0], high[0]), (low[1], high[1])))
    height_in = _PANELS_IN / sum(window.aspect for window in windows)
    figure, [panels] = new_figure(
        height_in + _LEGEND_IN, columns=2, widths=tuple(window.aspect for window in windows)
    )
    for panel, window, (points, layer), (axis, kept, title) in zip(
        panels, windows, polygons, cuts, strict=True
    ):
        _draw(panel, points, layer)
        _draw_afferents(panel, tip, mesh, axis, kept)
        panel.set(xlim=window.x_mm, ylim=window.y_mm, aspect="equal")
        panel.set_axis_off()
        draw_bar(panel, window, height_in)
        note(panel, title, (0.5, 0.0), (0, -4), ha="center", va="top")
    panels[0].legend(loc="lower right", frameon=False)
    draw_legend(figure, tip.materials)
    return figure


def cut_polygons(
    mesh: TipMesh, axis: int, position_mm: float, kept: tuple[int, int]
) -> tuple[list[FloatArray], IntArray]:
    """Polygons of the elements in the plane where the coordinate `axis` is `position_mm`.

    Returns
    -------
    list of ndarray, ndarray
        Corners ``(3 or 4, 2)`` in mm of each polygon, in the coordinates `kept`, and its layer.
    """
    corner = mesh.node_mm[mesh.tet[:, :4]]
    above = corner[:, :, axis] - position_mm
    crossed = np.flatnonzero((above.min(axis=1) < 0) & (above.max(axis=1) > 0))
    polygons = []
    for row in crossed.tolist():
        points = []
        for first, second in _EDGES:
            a, b = above[row, first], above[row, second]
            if a * b < 0:
                share = a / (a - b)
                points.append((1 - share) * corner[row, first] + share * corner[row, second])
        flat = np.array(points)[:, kept]
        around = flat - flat.mean(axis=0)
        polygons.append(flat[np.argsort(np.arctan2(around[:, 1], around[:, 0]))])
    return polygons, mesh.layer[crossed]


def _draw(panel: "Axes", polygons: list[FloatArray], layer: IntArray) -> None:
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.colors import to_rgba_array

    fills = to_rgba_array([LAYER_COLOURS[name] for name in LAYERS])[layer]
    elements = PolyCollection(
        polygons,
        facecolors=fills,
        edgecolors=_LINE_SHARE * fills[:, :3],
        linewidths=_MESH_LINE_PT,
        rasterized=True,
    )
    panel.add_collection(elements, autolim=False)
    lines = LineCollection(
        _boundaries(polygons, layer), colors=INK, linewidths=_BOUNDARY_PT, capstyle="round"
    )
    panel.add_collection(lines, autolim=False)


def _boundaries(polygons: list[FloatArray], layer: IntArray) -> list[FloatArray]:
    """Sides of polygons between two layers or on the outline, each ``(2, 2)``."""
    sides: dict[tuple[tuple[float, ...], ...], list[tuple[FloatArray, int]]] = {}
    for polygon, number in zip(polygons, layer.tolist(), strict=True):
        for first, second in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            ends = sorted(tuple(np.round(point, 6).tolist()) for point in (first, second))
            sides.setdefault(tuple(ends), []).append((np.stack([first, second]), number))
    return [
        owners[0][0]
        for owners in sides.values()
        if len(owners) == 1 or owners[0][1] != owners[1][1]
    ]


def _draw_afferents(
    panel: "Axes", tip: Fingertip, mesh: TipMesh, axis: int, kept: tuple[int, int]
) -> None:
    """Mark the nodes within half an element of the section; classes at one depth share dots."""
    reach_mm = 0.5 * tip.resolution.pad_mm
    names: dict[bytes, list[str]] = {}
    for name, rows in mesh.afferents.items():
        names.setdefault(rows.tobytes(), []).append(name)
    for classes in names.values():
        point_mm = mesh.node_mm[mesh.afferents[classes[0]]]
        near = point_mm[np.abs(point_mm[:, axis]) < reach_mm][:, kept]
        style = dots(class_style(classes[0])["color"], _DOT_PT, markeredgecolor=WHITE)
        panel.plot(near[:, 0], near[:, 1], label=" and ".join(classes), zorder=4, **style)
