"""A finger's mesh: the whole section, and the pad under the probe close up.

The pad is up, as in the deck. Both panels are to scale and carry a bar; the close
view shows which node stands for which afferent.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from decks.finger import LAYERS, Finger
from decks.material import Material
from decks.mesh import Mesh
from decks.probe import Probe, mesh_probe
from fembridge.plots.style import (
    AFFERENT_COLOURS,
    HAIR_PT,
    INK,
    LAYER_COLOURS,
    PAGE_WIDTH_IN,
    PROBE_COLOUR,
    SMALL_TEXT_PT,
    TEXT_PT,
    line_colour,
    spread,
)
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

# The close view is at least this wide and deep; the probe's lower
# end stands in it.
_CLOSE_WIDTH_MM, _CLOSE_DEPTH_MM = 2.0, 2.3
_PROBE_SHOWN_MM = 0.36
_AROUND_SITE_MM = 0.3
# The flat of a punch is level within this.
_LEVEL_MM = 1.0e-6
# Of a probe higher than this, the section shows the lower end.
_PROBE_IN_SECTION_MM = 1.5
_AROUND_SECTION_MM = 0.12

_BARS_MM = (10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1)
_BAR_SHARE = 0.26

# Inches: the bar below its panel, a name from the next, a leader beyond the panel.
_BAR_BELOW_IN, _NAME_STEP_IN, _LEADER_IN = 0.14, 0.32, 0.09
_BAR_PT, _LEADER_PT, _HALO_PT, _DOT_PT = 1.6, 0.7, 0.6, 5.0

_KILO, _GIGA_PER_MEGA = 1000.0, 1000.0


@dataclass(frozen=True, slots=True)
class Window:
    """What a panel shows: `x_mm` from left to right, `y_mm` from low to high."""

    x_mm: tuple[float, float]
    y_mm: tuple[float, float]

    @property
    def aspect(self) -> float:
        """Width over height."""
        return (self.x_mm[1] - self.x_mm[0]) / (self.y_mm[1] - self.y_mm[0])

    @property
    def bar_mm(self) -> float:
        """Length of a scale bar: round, at most a quarter or so of the width."""
        most_mm = _BAR_SHARE * (self.x_mm[1] - self.x_mm[0])
        return next((bar for bar in _BARS_MM if bar <= most_mm), _BARS_MM[-1])

    def meets(self, corner_mm: FloatArray) -> BoolArray:
        """Which shapes ``(N, corner, 2)`` may be seen, by their bounding boxes."""
        low, high = corner_mm.min(axis=1), corner_mm.max(axis=1)
        start = np.array([self.x_mm[0], self.y_mm[0]])
        end = np.array([self.x_mm[1], self.y_mm[1]])
        seen: BoolArray = ((high >= start) & (low <= end)).all(axis=1)
        return seen


def mesh_figure(finger: Finger, mesh: Mesh, probe: Probe) -> "Figure":
    """The section and the pad close up, with layers, afferents and probe.

    The materials and afferents are those of `finger`; the probe is on the pad at first
    touch, nothing pressed. Saved in a format of lines and text (PDF, SVG) the elements
    are pixels of `MESH_DPI`, all else is lines and text.

    Raises
    ------
    FingerError
        The probe is beside the pad, or an afferent has no node.
    """
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
    _draw_bar(figure, section, whole)
    _draw_bar(figure, pad, close)
    _name_afferents(pad, sites, close, height_in)
    _draw_legend(figure, finger.materials, probe)
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
    placed, _ = mesh_probe(probe, mesh)
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


def whole_window(node_mm: FloatArray, body_mm: FloatArray) -> Window:
    """Window on the whole section ``(N, 2)`` with the probe ``(P, 2)`` on it."""
    low, high = node_mm.min(axis=0), node_mm.max(axis=0)
    top_mm = min(body_mm[:, 1].max(), high[1] + _PROBE_IN_SECTION_MM)
    top_mm = max(top_mm, high[1] + _PROBE_SHOWN_MM)  # the close view lies inside
    around_mm = _AROUND_SECTION_MM
    return Window(
        (float(low[0] - around_mm), float(high[0] + around_mm)),
        (float(low[1] - around_mm), float(top_mm + around_mm)),
    )


def close_window(site_mm: FloatArray, body_mm: FloatArray, aspect: float) -> Window:
    """Window on the pad with all afferents ``(A, 2)`` and the probe's lowest point.

    `aspect` is the panel's width over its height. Two millimetres wide and 2.3 mm
    deep, or as much more as the afferents need; the probe is in the middle where
    that leaves them in sight.
    """
    lowest = body_mm[:, 1] <= body_mm[:, 1].min() + _LEVEL_MM
    touch_mm = body_mm[lowest].mean(axis=0)
    points = np.concatenate([site_mm, touch_mm[None]])
    left, low = points.min(axis=0) - _AROUND_SITE_MM
    right, _ = points.max(axis=0) + _AROUND_SITE_MM
    top = max(float(touch_mm[1]), 0.0) + _PROBE_SHOWN_MM
    height = max(top - min(float(low), -_CLOSE_DEPTH_MM), _CLOSE_WIDTH_MM / aspect)
    width = max(aspect * height, float(right - left))
    middle = float(touch_mm[0])
    if max(middle - left, right - middle) > 0.5 * width:
        middle = 0.5 * float(left + right)
    return Window((middle - 0.5 * width, middle + 0.5 * width), (top - width / aspect, top))


def _draw_bar(figure: "Figure", panel: "Axes", window: Window) -> None:
    """Draw a bar of a round length under the panel's left corner."""
    from matplotlib.lines import Line2D

    slot = panel.get_position(original=True)
    length_mm = window.bar_mm
    share = length_mm / (window.x_mm[1] - window.x_mm[0])
    height = slot.y0 - _BAR_BELOW_IN / figure.get_figheight()
    end = slot.x0 + share * slot.width
    figure.add_artist(
        Line2D(
            [slot.x0, end], [height, height], color=INK, linewidth=_BAR_PT, solid_capstyle="butt"
        )
    )
    figure.text(
        end + 0.05 / PAGE_WIDTH_IN,
        height,
        f"{length_mm:g} mm",
        va="center_baseline",
        fontsize=SMALL_TEXT_PT,
        color=INK,
    )


def _name_afferents(
    panel: "Axes", sites: Sequence[AfferentNode], window: Window, height_in: float
) -> None:
    """Mark the nodes; write names at the right, from top to bottom as they lie."""
    from matplotlib.patheffects import withStroke

    halo = withStroke(linewidth=_LEADER_PT + 2 * _HALO_PT, foreground="white")
    bottom, top = window.y_mm
    step_mm = _NAME_STEP_IN / height_in * (top - bottom)
    right = window.x_mm[1]
    gap_mm = _LEADER_IN / height_in * (top - bottom)
    ordered = sorted(sites, key=lambda site: (-site.y_mm, -site.x_mm))
    heights = spread([site.y_mm for site in ordered], step_mm, bottom, top)
    for site, height in zip(ordered, heights, strict=True):
        colour = AFFERENT_COLOURS.get(site.afferent, INK)
        panel.plot(
            [site.x_mm, right, right + gap_mm],
            [site.y_mm, height, height],
            color=colour,
            linewidth=_LEADER_PT,
            clip_on=False,
            path_effects=[halo],
            zorder=4,
        )
        panel.plot(
            site.x_mm,
            site.y_mm,
            marker="o",
            markersize=_DOT_PT,
            color=colour,
            markeredgecolor="white",
            markeredgewidth=_HALO_PT,
            zorder=5,
        )
        name = panel.annotate(
            site.afferent,
            (right + gap_mm, height),
            xytext=(2.5, 0.5),
            textcoords="offset points",
            va="bottom",
            fontsize=TEXT_PT,
            fontweight="bold",
            color=colour,
            annotation_clip=False,
        )
        panel.annotate(
            "" if site.depth_mm is None else f"{site.depth_mm:.2f} mm deep",
            (1, 0),
            xycoords=name,
            xytext=(4, 0),
            textcoords="offset points",
            va="bottom",
            fontsize=SMALL_TEXT_PT,
            color=INK,
            annotation_clip=False,
        )
        panel.annotate(
            _words(site.layer),
            (right + gap_mm, height),
            xytext=(2.5, -0.5),
            textcoords="offset points",
            va="top",
            fontsize=SMALL_TEXT_PT,
            color=INK,
            annotation_clip=False,
        )


def _draw_legend(figure: "Figure", materials: Mapping[str, Material], probe: Probe) -> None:
    """Name the fills, with what is elastic about them."""
    from matplotlib.patches import Patch

    entries = [
        (
            LAYER_COLOURS[layer],
            f"{_words(layer).capitalize()}\n"
            rf"$E$ = {modulus_text(materials[layer].young_mpa)}, "
            rf"$\nu$ = {poisson_text(materials[layer].poisson)}",
        )
        for layer in LAYERS
    ]
    entries.append((PROBE_COLOUR, f"Probe\nrigid, {probe.shape}, {probe.diameter_mm:g} mm"))
    columns = -(-len(entries) // 2)  # a legend fills columns; people read rows
    in_rows = [
        entries[k]
        for column in range(columns)
        for k in (column, column + columns)
        if k < len(entries)
    ]
    figure.legend(
        handles=[
            Patch(facecolor=fill, edgecolor=INK, linewidth=HAIR_PT, label=text)
            for fill, text in in_rows
        ],
        ncols=columns,
        loc="lower center",
        frameon=False,
        fontsize=SMALL_TEXT_PT,
        labelcolor=INK,
        borderpad=0.0,
        borderaxespad=0.3,
        labelspacing=0.7,
        columnspacing=2.0,
        handlelength=1.4,
        handleheight=1.4,
    )


def modulus_text(young_mpa: float) -> str:
    """Young's modulus in the unit that needs fewest digits."""
    if young_mpa < 1:
        return f"{young_mpa * _KILO:g} kPa"
    if young_mpa >= _GIGA_PER_MEGA:
        return f"{young_mpa / _GIGA_PER_MEGA:g} GPa"
    return f"{young_mpa:g} MPa"


def poisson_text(poisson: float) -> str:
    """Poisson's ratio with two decimals, or as many as it has."""
    return f"{poisson:.2f}" if round(poisson, 2) == poisson else f"{poisson:g}"


def _words(layer: str) -> str:
    return layer.replace("_", " ")
