"""A finger's mesh: the whole section, and a close view of the pad under the probe.

The pad is up, as in the deck. Both panels are to scale and have a scale bar; the close
view shows the node of each afferent.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from decks.finger import LAYERS, Finger, Material
from decks.mesh import Mesh
from decks.probe import Probe, mesh_probe
from fembridge.io.run_folder import AfferentNode
from fembridge.plots.style import (
    HAIR_PT,
    INK,
    LAYER_COLOURS,
    PROBE_COLOUR,
    WHITE,
    class_style,
    dots,
    in_style,
    new_figure,
    note,
    spread_heights,
)
from fembridge.typing import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Resolves the mesh lines of the preset `paper`, also as pixels in PDF and SVG.
MESH_DPI = 300

# Inches: width of both panels, height of the legend and the bars below them.
_PANELS_IN, _LEGEND_IN = 5.4, 1.05
# Width over height of the close view.
_PAD_ASPECT = 0.76

# Brightness of a mesh line as a share of its element's fill. Some formats lack transparency.
_LINE_SHARE = 0.72
_MESH_LINE_PT = 0.2
_FINE_MESH_LINE_PT = 0.08
_FINE_ELEMENTS = 6_000
_BOUNDARY_PT = 0.45

# Least width and depth of the close view, which shows the probe's lower end.
_PAD_WIDTH_MM, _PAD_DEPTH_MM = 2.0, 2.3
_PROBE_SHOWN_MM = 0.36
_SITE_MARGIN_MM = 0.3
# Nodes on the flat of a punch differ in height by less than this.
_LEVEL_MM = 1.0e-6
# The section shows the lower end of a higher probe.
_PROBE_IN_SECTION_MM = 1.5
_SECTION_MARGIN_MM = 0.12

_BARS_MM = (10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1)
_BAR_SHARE = 0.26

# Inches: distance of two names, length of a leader beyond the panel.
_NAME_STEP_IN, _LEADER_IN = 0.34, 0.09
_BAR_IN, _LEADER_PT, _HALO_PT, _DOT_PT = 0.022, 0.7, 0.6, 5.0


class Window(NamedTuple):
    """Part of the section that a panel shows: `x_mm` left and right, `y_mm` low and high."""

    x_mm: tuple[float, float]
    y_mm: tuple[float, float]

    @property
    def aspect(self) -> float:
        """Width over height."""
        return float(np.ptp(self.x_mm) / np.ptp(self.y_mm))


@in_style
def mesh_figure(finger: Finger, mesh: Mesh, probe: Probe) -> "Figure":
    """Section and close view of the pad, with layers, afferents and probe.

    The materials and afferents are those of `finger`; the probe is on the pad at first touch.
    In vector formats (PDF, SVG) the elements are pixels of `MESH_DPI`, everything else is lines
    and text. Raises FingerError: the probe is outside the pad, or an afferent has no node.
    """
    sites = afferent_nodes(finger, mesh)
    probe_mm = probe_outline(probe, mesh)
    section_view = section_window(mesh.node_mm, probe_mm)
    site_mm = np.array([(site.x_mm, site.y_mm) for site in sites])
    pad_view = pad_window(site_mm, probe_mm, _PAD_ASPECT)
    height_in = _PANELS_IN / (section_view.aspect + _PAD_ASPECT)
    figure, [[section, pad]] = new_figure(
        height_in + _LEGEND_IN, columns=2, widths=(section_view.aspect, _PAD_ASPECT)
    )
    fine = len(mesh.quad) > _FINE_ELEMENTS
    for panel, window, line_pt in (
        (section, section_view, _FINE_MESH_LINE_PT if fine else _MESH_LINE_PT),
        (pad, pad_view, _MESH_LINE_PT),
    ):
        _draw_elements(panel, mesh, probe_mm, line_pt)
        panel.set(xlim=window.x_mm, ylim=window.y_mm, aspect="equal", xticks=[], yticks=[])
        draw_bar(panel, window, height_in)
    section.set_axis_off()
    pad.spines[:].set_visible(True)
    frame = (pad_view.x_mm[0], pad_view.y_mm[0], np.ptp(pad_view.x_mm), np.ptp(pad_view.y_mm))
    section.indicate_inset(frame, pad, edgecolor=INK, alpha=1.0, linewidth=HAIR_PT)
    _name_afferents(pad, sites, pad_view, height_in)
    draw_legend(figure, finger.materials, probe)
    return figure


def afferent_nodes(finger: Finger, mesh: Mesh) -> list[AfferentNode]:
    """Node of each afferent of `finger` in `mesh`, counted from 1."""
    nodes = []
    for name, site in finger.afferents.items():
        row = mesh.node_at(site)
        x_mm, y_mm = mesh.node_mm[row].tolist()
        nodes.append(AfferentNode(name, row + 1, site.layer, x_mm, y_mm, -y_mm))
    return nodes


def probe_outline(probe: Probe, mesh: Mesh) -> FloatArray:
    """Outline of the whole probe ``(P, 2)`` in mm, in first touch with `mesh`.

    The solver's probe is only the lower side. A cylinder is drawn as a circle, a flat punch
    with a height of half its width.
    """
    placed, _ = mesh_probe(probe, mesh)
    lower_mm = placed.node_mm[placed.lower_node]
    radius_mm = 0.5 * probe.diameter_mm
    bottom_mm = lower_mm[:, 1].min()
    if probe.shape == "flat":
        ends_mm = lower_mm[[-1, 0]] * [1.0, 0.0] + [0.0, bottom_mm + radius_mm]
        return np.concatenate([lower_mm, ends_mm])
    angle = np.linspace(-np.pi / 2, 3 * np.pi / 2, 181)
    middle_mm = [probe.x_mm, bottom_mm + radius_mm]
    outline: FloatArray = middle_mm + radius_mm * np.stack([np.cos(angle), np.sin(angle)], -1)
    return outline


def boundary_edges(mesh: Mesh) -> FloatArray:
    """Edges ``(B, 2, 2)`` in mm on the boundary of a layer or of the section."""
    nodes, element, _ = mesh.edges()
    edge, row = np.unique(np.sort(nodes, axis=1), axis=0, return_inverse=True)
    layer = mesh.layer[element]
    lowest, highest = np.full(len(edge), len(LAYERS)), np.full(len(edge), -1)
    np.minimum.at(lowest, row.ravel(), layer)
    np.maximum.at(highest, row.ravel(), layer)
    on_border = np.bincount(row.ravel()) == 1
    ends: FloatArray = mesh.node_mm[edge[on_border | (lowest != highest)]]
    return ends


def _draw_elements(panel: "Axes", mesh: Mesh, probe_mm: FloatArray, line_pt: float) -> None:
    """Fill the elements, draw the layers' boundaries and the probe."""
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.colors import to_rgba_array
    from matplotlib.patches import Polygon

    fills = to_rgba_array([LAYER_COLOURS[name] for name in LAYERS])[mesh.layer]
    elements = PolyCollection(
        list(mesh.node_mm[mesh.quad]),
        facecolors=fills,
        edgecolors=_LINE_SHARE * fills[:, :3],
        linewidths=line_pt,
        rasterized=True,
    )
    ends_mm = boundary_edges(mesh).tolist()
    ends = LineCollection(ends_mm, colors=INK, linewidths=_BOUNDARY_PT, capstyle="round")
    panel.add_collection(elements, autolim=False)
    panel.add_collection(ends, autolim=False)
    panel.add_patch(
        Polygon(probe_mm, facecolor=PROBE_COLOUR, edgecolor=INK, linewidth=_BOUNDARY_PT)
    )


def section_window(node_mm: FloatArray, probe_mm: FloatArray) -> Window:
    """Window on the whole section, nodes ``(N, 2)``, with the probe ``(P, 2)`` on it."""
    low, high = node_mm.min(axis=0) - _SECTION_MARGIN_MM, node_mm.max(axis=0)
    top_mm = min(probe_mm[:, 1].max(), high[1] + _PROBE_IN_SECTION_MM)
    high[1] = max(top_mm, high[1] + _PROBE_SHOWN_MM)  # the close view lies inside
    (left, bottom), (right, top) = low.tolist(), (high + _SECTION_MARGIN_MM).tolist()
    return Window((left, right), (bottom, top))


def pad_window(site_mm: FloatArray, probe_mm: FloatArray, aspect: float) -> Window:
    """Window on the pad with all afferents ``(A, 2)`` and the probe's lowest point.

    `aspect` is the panel's width over its height. The window is 2 mm wide and 2.3 mm deep, or
    larger if the afferents need it; the probe is in the middle if all afferents stay visible.
    """
    lowest = probe_mm[:, 1] <= probe_mm[:, 1].min() + _LEVEL_MM
    touch_mm = probe_mm[lowest].mean(axis=0)
    points = np.concatenate([site_mm, touch_mm[None]])
    left, low = (points.min(axis=0) - _SITE_MARGIN_MM).tolist()
    right, _ = (points.max(axis=0) + _SITE_MARGIN_MM).tolist()
    middle, touch = touch_mm.tolist()
    top = max(touch, 0.0) + _PROBE_SHOWN_MM
    height = max(top - min(low, -_PAD_DEPTH_MM), _PAD_WIDTH_MM / aspect)
    width = max(aspect * height, right - left)
    if max(middle - left, right - middle) > 0.5 * width:
        middle = 0.5 * (left + right)
    return Window((middle - 0.5 * width, middle + 0.5 * width), (top - width / aspect, top))


def draw_bar(panel: "Axes", window: Window, height_in: float) -> None:
    """Draw a scale bar below the left corner, at most about a quarter of the width."""
    from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar

    width_mm, height_mm = np.ptp(window.x_mm), np.ptp(window.y_mm)
    length_mm = next((bar for bar in _BARS_MM if bar <= _BAR_SHARE * width_mm), _BARS_MM[-1])
    bar = AnchoredSizeBar(
        panel.transData,
        length_mm,
        f"{length_mm:g} mm",
        "upper left",
        size_vertical=_BAR_IN * height_mm / height_in,
        frameon=False,
        borderpad=0.4,
        pad=0.0,
        sep=3,
        color=INK,
        bbox_to_anchor=(0.0, 0.0),
        bbox_transform=panel.transAxes,
    )
    panel.add_artist(bar)


def _name_afferents(
    panel: "Axes", sites: Sequence[AfferentNode], window: Window, height_in: float
) -> None:
    """Mark the nodes; write the names on the right, sorted by height."""
    from matplotlib.patheffects import withStroke

    halo = withStroke(linewidth=_LEADER_PT + 2 * _HALO_PT, foreground=WHITE)
    (bottom, top), right = window.y_mm, window.x_mm[1]
    mm_per_in = (top - bottom) / height_in
    end = right + _LEADER_IN * mm_per_in
    ordered = sorted(sites, key=lambda site: (-site.y_mm, -site.x_mm))
    heights = spread_heights(
        [site.y_mm for site in ordered], _NAME_STEP_IN * mm_per_in, bottom, top
    )
    for site, height in zip(ordered, heights, strict=True):
        style = class_style(site.afferent)
        leader_style: dict[str, Any] = {
            "linewidth": _LEADER_PT,
            "path_effects": [halo],
            "zorder": 4,
        }
        leader_mm = ([site.x_mm, right, end], [site.y_mm, height, height])
        panel.plot(*leader_mm, color=style["color"], clip_on=False, **leader_style)
        marker_style: dict[str, Any] = {
            "markeredgecolor": WHITE,
            "markeredgewidth": _HALO_PT,
            "zorder": 5,
        }
        panel.plot(site.x_mm, site.y_mm, **dots(style["color"], _DOT_PT, **marker_style))
        corner = (end, height)
        name = note(panel, site.afferent, corner, (2.5, 0.5), frame="data", va="bottom", **style)
        note(panel, f"{-site.y_mm:.2f} mm deep", (1, 0), (4, 0), frame=name, va="bottom")
        note(panel, layer_label(site.layer), corner, (2.5, -0.5), frame="data", va="top")


def draw_legend(
    figure: "Figure", materials: Mapping[str, Material], probe: Probe | None = None
) -> None:
    """Add a legend of the layers with their elastic constants, and of the probe."""
    from matplotlib.patches import Patch
    from matplotlib.ticker import EngFormatter

    def patch(fill: str, text: str) -> Patch:
        return Patch(facecolor=fill, edgecolor=INK, linewidth=HAIR_PT, label=text)

    entries = []
    for layer in LAYERS:
        young_pa, poisson = 1e6 * materials[layer].young_mpa, materials[layer].poisson
        ratio = f"{poisson:.2f}" if round(poisson, 2) == poisson else f"{poisson:g}"
        text = rf"$E$ = {EngFormatter('Pa')(young_pa)}, $\nu$ = {ratio}"
        entries.append(patch(LAYER_COLOURS[layer], f"{layer_label(layer).capitalize()}\n{text}"))
    if probe is not None:
        text = f"Probe\nrigid, {probe.shape}, {probe.diameter_mm:g} mm"
        entries.append(patch(PROBE_COLOUR, text))
    columns = -(-len(entries) // 2)  # a legend fills columns; people read rows
    figure.legend(
        handles=[entry for column in range(columns) for entry in entries[column::columns]],
        ncols=columns,
        loc="outside lower center",
        borderpad=0.0,
        labelspacing=0.7,
        columnspacing=2.0,
        handlelength=1.4,
        handleheight=1.4,
    )


def layer_label(layer: str) -> str:
    """Name of a layer in a figure."""
    return layer.replace("_", " ")
