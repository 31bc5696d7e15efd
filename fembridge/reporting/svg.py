"""Figures as SVG elements of a page, in its colours."""

import re
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from fembridge.plots.style import AFFERENT_COLOURS, FAINT, INK, SHADE, WHITE, save_figure

if TYPE_CHECKING:
    from markupsafe import Markup
    from matplotlib.figure import Figure

# CSS variables of the page, each with a light and a dark value, for these colours of a figure.
# White is the background, also inside open markers.
_NAMED = {
    INK: "ink",
    FAINT: "faint",
    SHADE: "shade",
    WHITE: "paper",
    **{colour: name.lower() for name, colour in AFFERENT_COLOURS.items()},
}
_HASHED_ID = re.compile(r'((?:\bid="|href="#|url\(#)[^")]*-[A-Za-z])([0-9a-f]{10})(?=["\s)])')


def inline_svg(figure: "Figure", path: Path) -> "Markup":
    """SVG element of a figure for the page; also writes the figure to `path`.

    The element uses the page's colours, has ids that are unique on the page, and no size: it
    fills the width of its parent.
    """
    from markupsafe import Markup

    save_figure(figure, path)
    _, _, drawing = path.read_text(encoding="utf-8").partition("<svg ")
    head, _, drawing = drawing.partition(">")
    drawing = re.sub(r"<metadata>.*?</metadata>", "", drawing, count=1, flags=re.DOTALL)
    drawing = _numbered(re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{path.stem}-", drawing))
    for colour, name in _NAMED.items():
        drawing = drawing.replace(colour.lower(), f"var(--{name})")
    head = re.sub(r'\b(width|height)="[^"]*"', "", head)
    return Markup(f'<svg role="img" {head}>{drawing}')


def _numbered(drawing: str) -> str:
    """`drawing` with numbers for the hashes in its ids: those of clip paths are new each time."""
    numbers: dict[str, int] = {}
    return _HASHED_ID.sub(
        lambda match: f"{match[1]}{numbers.setdefault(match[2], len(numbers))}", drawing
    )


def svg_element(figure: "Figure", name: str) -> "Markup":
    """SVG element of a figure, with ids that begin with `name`; no file is kept."""
    with TemporaryDirectory(prefix="fembridge-svg-") as folder:
        return inline_svg(figure, Path(folder) / f"{name}.svg")
