"""What is written on a picture of a mesh: scale bars, names of afferents, a legend."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from decks.finger import LAYERS
from decks.material import Material
from decks.probe import Probe
from fembridge.plots.layer_palette import LAYER_COLOURS, PROBE_COLOUR
from fembridge.plots.palette import (
    AFFERENT_COLOURS,
    HAIR_PT,
    INK,
    PAGE_WIDTH_IN,
    SMALL_TEXT_PT,
    TEXT_PT,
)
from fembridge.plots.window import Window, spread
from fembridge.run_folder import AfferentNode

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Inches: the bar below its panel, a name from the next, a leader beyond the panel.
_BAR_BELOW_IN, _NAME_STEP_IN, _LEADER_IN = 0.14, 0.32, 0.09
_BAR_PT, _LEADER_PT, _HALO_PT, _DOT_PT = 1.6, 0.7, 0.6, 5.0

_KILO, _GIGA_PER_MEGA = 1000.0, 1000.0


def draw_bar(figure: "Figure", panel: "Axes", window: Window) -> None:
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


def name_afferents(
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


def draw_legend(figure: "Figure", materials: Mapping[str, Material], probe: Probe) -> None:
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
