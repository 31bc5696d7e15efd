"""Fills of a finger's layers: muted, so that afferents stand out on all of them.

Layers that touch differ in lightness, not in hue alone: they stay apart in print
without colour and for people with any common colour blindness (a test works it
out). The hues are those of histology where they can be: horn, fat, rose dermis.
"""

from collections.abc import Mapping

LAYER_COLOURS: Mapping[str, str] = {
    "stratum_corneum": "#96794E",
    "epidermis": "#E8C699",
    "dermis": "#D0958F",
    "subcutaneous_tissue": "#F8F0DA",
    "bone": "#BCC3CC",
    "nail": "#73849C",
}

PROBE_COLOUR = "#4D4D4D"

# A line of the mesh is its element's fill, darkened: no transparency, which some
# formats do not have.
_LINE_SHARE = 0.72


def line_colour(fill: str) -> tuple[float, float, float]:
    """Darken a fill such as ``#E8C699`` for the lines drawn on it."""
    red, green, blue = (int(fill[k : k + 2], 16) / 255 for k in (1, 3, 5))
    return red * _LINE_SHARE, green * _LINE_SHARE, blue * _LINE_SHARE
