"""The page of ``fembridge explore`` that a how-to page shows: a Braille touch."""

from pathlib import Path

from sphinx.application import Sphinx

import fembridge as fb

PAGE = "explored_touch.html"


def write_page(app: Sphinx, error: Exception | None) -> None:
    """Write the page of a touch into the built site."""
    if error is not None or app.builder.format != "html":
        return
    folder = Path(app.outdir) / "_static"
    folder.mkdir(exist_ok=True)
    fb.explore(fb.touch("braille:text=fb", press_um=300)).write(folder / PAGE)


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the page at the end of a build."""
    app.connect("build-finished", write_page)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
