"""A finger's mesh: the whole section, and the pad under the probe close up.

The pad is up, as in the deck. Both panels are to scale and carry a bar; the close
view shows which node stands for which afferent.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from decks.finger import LAYERS, Finger
from decks.mesh import Mesh
from decks.probe import Probe, mesh_probe
from fembridge.plots.layer_palette import LAYER_COLOURS, PROBE_COLOUR, line_colour
from fembridge.plots.mesh_annotations import draw_bar, draw_legend, name_afferents
from fembridge.plots.palette import HAIR_PT, INK, PAGE_WIDTH_IN
from fembridge.plots.picture import save_figure
from fembridge.plots.window import Window, close_window, whole_window
from fembridge.run_folder import AfferentNode
from fembridge.typing import BoolArray, FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Fine enough for mesh lines of the paper's preset, also where a format of lines
# and text holds them as pixels.
MESH_DPI = 300

# Inches: around the panels, between them, for the names at the right.
_EDGE_IN, _BETWEEN_IN, _NAMES_IN = 0.05, 0.42, 1.12
_LEGEND_IN, _BARS_IN = 0.72, 0.26
_LEAST_HEIGHT_IN, _MOST_HEIGHT_IN, _MOST_SHARE = 2.4, 3.3, 0.64
# Width over height that a close view has beside a finger of usual proportions.
_CLOSE_ASPECT = 0.76

_MESH_LINE_PT = 0.2
_FINE_MESH_LINE_PT = 0.08
_FINE_ELEMENTS = 6_000
_BOUNDARY_PT = 0.45


def draw_mesh(
    finger: Finger, mesh: Mesh, probe: Probe, path: Path, *, dpi: float = MESH_DPI
) -> None:
    """Draw `mesh` with layers, afferents and probe into a file.

    Parameters
    ----------
    finger
        Whose materials and afferents are named.
    mesh
        Its mesh; see `decks.presets.mesh_of`.
    probe
        Set on the pad at first touch, nothing pressed.
    path
        Where to; the suffix chooses the format. In one of lines and text (PDF,
        SVG) the elements are pixels, all else is lines and text.
    dpi
        Dots an inch.

    Raises
    ------
    FingerError
        The probe stands beside the pad, or an afferent has no node.
    UsageError
        A suffix that Matplotlib does not know.
    OutputError
        A place where nothing can be written.
    """
    save_figure(mesh_figure(finger, mesh, probe), path, dpi)


def mesh_figure(finger: Finger, mesh: Mesh, probe: Probe) -> "Figure":
    """Make the figure that `draw_mesh` saves; the arguments are the same."""
    from matplotlib.figure import Figure

    sites = afferent_nodes(finger, mesh)
    body_mm = probe_outline(probe, mesh)
    whole = whole_window(mesh.node_mm, body_mm)
    room_in = PAGE_WIDTH_IN - 2 * _EDGE_IN - _BETWEEN_IN - _NAMES_IN
    height_in = float(
        np.clip(room_in / (whole.aspect + _CLOSE_ASPECT), _LEAST_HEIGHT_IN, _MOST_HEIGHT_IN)
    )
    left_in = min(whole.aspect * height_in, _MOST_SHARE * room_in)
    right_in = room_in - left_in
    close = close_window(
        np.array([(site.x_mm, site.y_mm) for site in sites]), body_mm, right_in / height_in
    )
    page_in = height_in + _LEGEND_IN + _BARS_IN + _EDGE_IN
    figure = Figure(figsize=(PAGE_WIDTH_IN, page_in))
    floor = (_LEGEND_IN + _BARS_IN) / page_in
    start_in = _EDGE_IN + left_in + _BETWEEN_IN
    section, pad = (
        figure.add_axes((left / PAGE_WIDTH_IN, floor, width / PAGE_WIDTH_IN, height_in / page_in))
        for left, width in ((_EDGE_IN, left_in), (start_in, right_in))
    )
    for panel, window in ((section, whole), (pad, close)):
        _draw_elements(panel, mesh, window)
        _draw_probe(panel, body_mm)
        panel.set(xlim=window.x_mm, ylim=window.y_mm, aspect="equal", xticks=[])
        panel.set(yticks=[])
    section.set_axis_off()
    for spine in pad.spines.values():
        spine.set(linewidth=HAIR_PT, color=INK)
    _join(section, pad, close)
    draw_bar(figure, section, whole)
    draw_bar(figure, pad, close)
    name_afferents(pad, sites, close, height_in)
    draw_legend(figure, finger.materials, probe)
    return figure


def afferent_nodes(finger: Finger, mesh: Mesh) -> list[AfferentNode]:
    """Where the afferents of `finger` sit in `mesh`; nodes count from 1."""
    places = []
    for name, site in finger.afferents.items():
        row = mesh.node_at(site)
        x_mm, y_mm = mesh.node_mm[row].tolist()
        places.append(AfferentNode(name, row + 1, site.layer, x_mm, y_mm, -y_mm))
    return places


def probe_outline(probe: Probe, mesh: Mesh) -> FloatArray:
    """Outline of the whole probe ``(P, 2)`` in mm, standing on `mesh`.

    The solver's probe is its lower side alone. A cylinder is drawn round, a flat
    punch as high as half its width.
    """
    placed = mesh_probe(probe, mesh)
    lower_mm = placed.node_mm[placed.lower_node]
    if probe.shape == "flat":
        top_mm = lower_mm[:, 1].min() + 0.5 * probe.diameter_mm
        ends_mm = lower_mm[[-1, 0]] * [1.0, 0.0] + [0.0, top_mm]
        return np.concatenate([lower_mm, ends_mm])
    radius_mm = 0.5 * probe.diameter_mm
    angle = np.linspace(-np.pi / 2, 3 * np.pi / 2, 181)
    middle_mm = [probe.x_mm, lower_mm[:, 1].min() + radius_mm]
    outline: FloatArray = middle_mm + radius_mm * np.stack([np.cos(angle), np.sin(angle)], -1)
    return outline


def boundaries(mesh: Mesh) -> FloatArray:
    """Find where a layer or the section ends: edges ``(B, 2, 2)`` in mm."""
    nodes, element, _ = mesh.edges()
    key = np.sort(nodes, axis=1)
    order = np.lexsort((key[:, 1], key[:, 0]))
    key, layer = key[order], mesh.layer[element[order]]
    paired: BoolArray = np.zeros(len(key) + 1, dtype=bool)  # with the row before
    paired[1:-1] = (key[1:] == key[:-1]).all(axis=1)
    alone = ~paired[:-1] & ~paired[1:]
    changes = paired[:-1] & (layer != np.roll(layer, 1))
    ends: FloatArray = mesh.node_mm[key[alone | changes]]
    return ends


def _draw_elements(panel: "Axes", mesh: Mesh, window: Window) -> None:
    from matplotlib.collections import LineCollection, PolyCollection

    corner = mesh.node_mm[mesh.quad]
    seen = window.meets(corner)
    fills = np.array([LAYER_COLOURS[name] for name in LAYERS])
    lines = np.array([line_colour(LAYER_COLOURS[name]) for name in LAYERS])
    fine = seen.all() and len(mesh.quad) > _FINE_ELEMENTS
    panel.add_collection(
        PolyCollection(
            list(corner[seen]),
            facecolors=fills[mesh.layer[seen]].tolist(),
            edgecolors=lines[mesh.layer[seen]],
            linewidths=_FINE_MESH_LINE_PT if fine else _MESH_LINE_PT,
            rasterized=True,
        ),
        autolim=False,
    )
    ends = boundaries(mesh)
    panel.add_collection(
        LineCollection(
            ends[window.meets(ends)].tolist(), colors=INK, linewidths=_BOUNDARY_PT, capstyle="round"
        ),
        autolim=False,
    )


def _draw_probe(panel: "Axes", body_mm: FloatArray) -> None:
    from matplotlib.patches import Polygon

    panel.add_patch(Polygon(body_mm, facecolor=PROBE_COLOUR, edgecolor=INK, linewidth=_BOUNDARY_PT))


def _join(section: "Axes", pad: "Axes", close: Window) -> None:
    """Draw the close view's frame in the section, and lines from it to the panel."""
    from matplotlib.patches import ConnectionPatch, Rectangle

    (left, right), (bottom, top) = close.x_mm, close.y_mm
    section.add_patch(
        Rectangle(
            (left, bottom),
            right - left,
            top - bottom,
            facecolor="none",
            edgecolor=INK,
            linewidth=HAIR_PT,
        )
    )
    for height in (bottom, top):
        section.add_artist(
            ConnectionPatch(
                (right, height),
                (left, height),
                coordsA="data",
                coordsB="data",
                axesA=section,
                axesB=pad,
                color=INK,
                linewidth=0.7 * HAIR_PT,
                linestyle=(0, (6, 3)),
                clip_on=False,
            )
        )
