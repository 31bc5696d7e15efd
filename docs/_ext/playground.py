"""The playground in the browser: a directive for a page, and a page of its own in one file.

``{playground}`` embeds it. ``playground.html`` of the site has all that it needs in it, so that a
saved copy works without a server. Both are made of the files in ``docs/playground``.
"""

import sys
from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

sys.path.insert(0, str(Path(__file__).parents[1] / "playground"))

from playground_page import PAGE, SCRIPT, STYLE, page, script, style


class PlaygroundDirective(SphinxDirective):
    """``{playground}``: the playground on this page, and a link to the page of its own."""

    def run(self) -> list[nodes.Node]:
        """The element, its style and its script."""
        root = "../" * self.env.docname.count("/")
        html = (
            "<p><strong>Try it.</strong> A probe of 1 mm moves on the fingertip: choose how, drag "
            "its curve or draw one, and see stress in the skin and spikes of 30 cells.</p>\n"
            f'<link rel="stylesheet" href="{root}_static/{STYLE}">\n'
            '<div class="fembridge-playground">'
            "<noscript>The playground needs JavaScript.</noscript></div>\n"
            f'<script src="{root}_static/{SCRIPT}" defer></script>\n'
            f'<p><a href="{root}{PAGE}">The playground as a page of its own</a>, one file that '
            "works without a network.</p>"
        )
        return [nodes.raw("", html, format="html")]


def write_files(app: Sphinx, error: Exception | None) -> None:
    """Write script, style and page into the built site."""
    if error is not None or app.builder.format != "html":
        return
    static = Path(app.outdir) / "_static"
    static.mkdir(exist_ok=True)
    for path, text in (
        (static / SCRIPT, script()),
        (static / STYLE, style()),
        (Path(app.outdir) / PAGE, page()),
    ):
        path.write_text(text, encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive, and write the files at the end of a build."""
    app.add_directive("playground", PlaygroundDirective)
    app.connect("build-finished", write_files)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
