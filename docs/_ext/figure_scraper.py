"""Pictures of the gallery: figures of Matplotlib with and without pyplot.

A result's ``plot()`` makes a figure without pyplot, so that it opens no window; the scraper of
sphinx-gallery collects the figures of pyplot alone.
"""

from typing import Any

from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from sphinx_gallery.scrapers import figure_rst


def figure_scraper(
    block: Any,  # noqa: ANN401 - sphinx-gallery's own
    block_vars: dict[str, Any],
    gallery_conf: dict[str, Any],
) -> str:
    """Save the figures that are new after a `block` of an example; their text in reST."""
    values = block_vars["example_globals"].values()
    figures = [value for value in values if isinstance(value, Figure)]
    figures += [plt.figure(number) for number in plt.get_fignums()]
    paths = []
    for figure in dict.fromkeys(figures):
        if not vars(figure).get("_in_gallery"):
            figure._in_gallery = True  # type: ignore[attr-defined]  # variables outlive a block
            paths.append(next(block_vars["image_path_iterator"]))
            figure.savefig(paths[-1], dpi=110, bbox_inches="tight", facecolor="white")
    plt.close("all")
    return str(figure_rst(paths, gallery_conf["src_dir"]))
