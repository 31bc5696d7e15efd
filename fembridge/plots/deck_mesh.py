"""The mesh of your own deck with its afferents: a plane one to scale, a solid from two sides.

Faces of a solid are painted from the far ones to the near ones, brighter the more they face the
viewer. Afferents are drawn over all faces, also those that lie inside.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from decks.own_model.deck_mesh import DeckMesh
from fembridge.plots.style import (
    HAIR_PT,
    INK,
    LAYER_COLOURS,
    SERIES_COLOURS,
    WHITE,
    class_style,
    dots,
    in_style,
    new_figure,
    note,
)
from fembridge.trace import split_afferent_key
from fembridge.typing import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from fembridge.plots.style import Panels

_MOST_LINED = 40_000  # of more faces the edges are left out
_HEIGHT_IN, _LEGEND_IN = 3.0, 0.5
_LINE_PT, _LINE_SHARE, _DOT_PT, _HALO_PT = 0.15, 0.75, 5.0, 0.6
_MARGIN = 0.04
_SHADOW = 0.45  # brightness of a face that is seen from its edge
# Views of a solid: direction to the viewer and up, as people draw x right, y back, z up, and
# the side along y.
_VIEWS = (((1.0, -1.6, 1.1), (0.0, 0.0, 1.0)), ((0.0, -1.0, 0.0), (0.0, 0.0, 1.0)))
_FILLS = (*sorted(LAYER_COLOURS.values(), reverse=True), *SERIES_COLOURS)
_LONGEST_NAME = 28
_MOST_NAMED = 12  # afferents


@in_style
def deck_mesh_figure(
    mesh: DeckMesh,
    afferents: Mapping[str, Sequence[float]],
    unit: str = "mm",
    axes: "Panels | None" = None,
) -> "Figure":
    """Faces by material, and the position ``(2 or 3,)`` of each of `afferents`, by name.

    Lengths are in the deck's `unit`. Of a solid the view is from above one corner, and along
    y. With `axes`, one for a plane mesh and two for a solid, the panels are drawn into them.
    """
    from matplotlib.patches import Patch

    views = (((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)),) if mesh.flat else _VIEWS
    figure, [panels] = new_figure(_HEIGHT_IN + _LEGEND_IN, columns=len(views), axes=axes)
    site = {
        name: np.array([*position, 0.0, 0.0][:3], dtype=np.float64)
        for name, position in afferents.items()
    }
    for panel, (toward, up) in zip(panels, views, strict=True):
        basis = _basis(np.array(toward), np.array(up))
        _draw_faces(panel, mesh, basis)
        for count, (name, place) in enumerate(site.items()):
            x, y, _ = basis @ place
            style = class_style(split_afferent_key(name)[0])
            marker = {"markeredgecolor": WHITE, "markeredgewidth": _HALO_PT, "zorder": 5}
            panel.plot(x, y, **dots(style["color"], _DOT_PT, **marker))
            if len(site) <= _MOST_NAMED:
                offset = (4, 3) if count % 2 == 0 else (4, -9)
                note(panel, name, (x, y), offset, frame="data", **style)
        panel.set_axis_off()
    handles = [
        Patch(
            facecolor=colour,
            edgecolor=INK,
            linewidth=HAIR_PT,
            label=(name or "without a material")[:_LONGEST_NAME].replace("$", r"\$"),
        )
        for index, (name, colour) in enumerate(
            zip(mesh.materials, _fills(mesh.materials), strict=True)
        )
        if (mesh.material == index).any()
    ]
    sides = np.ptp(mesh.point[mesh.face].reshape(-1, 3), axis=0)
    size = " × ".join(f"{side:.4g}" for side in sides[: 2 if mesh.flat else 3])
    if axes is None:
        figure.legend(handles=handles, ncols=4, loc="outside lower center")
        figure.suptitle(f"{size} {unit}")
    return figure


def _fills(materials: Sequence[str]) -> list[str]:
    """A colour by material; layers of our finger have theirs."""
    return [
        LAYER_COLOURS.get(name.lower(), _FILLS[index % len(_FILLS)])
        for index, name in enumerate(materials)
    ]


def _basis(toward: FloatArray, up: FloatArray) -> FloatArray:
    """Rows: to the right, upwards, and towards the viewer."""
    depth = toward / np.linalg.norm(toward)
    right = np.cross(up, depth)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(depth, right), depth])


def _draw_faces(panel: "Axes", mesh: DeckMesh, basis: FloatArray) -> None:
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgba_array

    corner = mesh.point[mesh.face] @ basis.T
    fills = to_rgba_array(_fills(mesh.materials))[mesh.material]
    if not mesh.flat:
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        length = np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
        order = np.argsort(corner[:, :, 2].mean(axis=1))
        brightness = _SHADOW + (1 - _SHADOW) * np.abs(normal[:, 2]) / length
        fills[:, :3] *= brightness[:, None]
        corner, fills = corner[order], fills[order]
    few = len(corner) <= _MOST_LINED
    faces = PolyCollection(
        list(corner[:, :, :2]),
        facecolors=fills,
        edgecolors=_LINE_SHARE * fills[:, :3] if few else fills,
        linewidths=_LINE_PT if few else 0.0,
        rasterized=True,
    )
    panel.add_collection(faces, autolim=False)
    low, high = corner[:, :, :2].min(axis=(0, 1)), corner[:, :, :2].max(axis=(0, 1))
    margin = _MARGIN * max(np.ptp([low, high], axis=0).max(), 1e-300)
    panel.set(
        xlim=(low[0] - margin, high[0] + margin),
        ylim=(low[1] - margin, high[1] + margin),
        aspect="equal",
    )
