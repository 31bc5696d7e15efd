"""A figure's SVG as part of a page: the page's colours, and ids of its own."""

import re

from fembridge.plots.palette import AFFERENT_COLOURS, FAINT, INK, SHADE

# Colours that a page has under a name, one value for light and one for dark. White
# is the paper and what lies on it: the faces of open marks.
_NAMED = {
    INK: "ink",
    FAINT: "faint",
    SHADE: "shade",
    "#FFFFFF": "paper",
    **{colour: name.lower() for name, colour in AFFERENT_COLOURS.items()},
}
_PROLOGUE = re.compile(r"\A.*?(?=<svg)", re.DOTALL)
_METADATA = re.compile(r"\s*<metadata>.*?</metadata>", re.DOTALL)
_SIZE = re.compile(r'(<svg[^>]*?) width="[^"]*"', re.DOTALL)
_HEIGHT = re.compile(r'(<svg[^>]*?) height="[^"]*"', re.DOTALL)
_ID = re.compile(r'\bid="([^"]+)"')
_REFERENCE = re.compile(r'(xlink:href="#|url\(#)')


def to_inline(svg: str, prefix: str, words: str) -> str:
    """Turn a file's SVG into an element of a page.

    Parameters
    ----------
    svg
        Text of a file as Matplotlib writes it.
    prefix
        Put before every id, since a page holds several figures.
    words
        What the figure shows, for those who cannot see it.

    Returns
    -------
    str
        The element ``<svg>``, without size: it is as wide as its place.
    """
    from html import escape

    inner = _METADATA.sub("", _PROLOGUE.sub("", svg))
    inner = _HEIGHT.sub(r"\1", _SIZE.sub(r"\1", inner, count=1), count=1)
    inner = _ID.sub(rf'id="{prefix}-\1"', inner)
    inner = _REFERENCE.sub(rf"\1{prefix}-", inner)
    for colour, name in _NAMED.items():
        inner = re.sub(colour, f"var(--{name})", inner, flags=re.IGNORECASE)
    label = f'<svg role="img" aria-label="{escape(words)}" '
    return inner.replace("<svg ", label, 1).strip()
