"""How each source of rates looks, the same in every figure of a report."""

from typing import TYPE_CHECKING, Any

from fembridge.plots.palette import AFFERENT_COLOURS, INK, LINE_PT, SMALL_TEXT_PT
from fembridge.validation.compared_rates import OBSERVED, TOUCHSIM
from fembridge.validation.judged_model import PUBLISHED_NAME

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TOUCHSIM_COLOUR = "#808080"

_DOT_PT = 3.6
_DASHES = (4, 1.8)
_LEGEND_HANDLE = 3.4


def curve_style(source: str, afferent: str, judged: str) -> dict[str, Any]:
    """Give the line of `source`: dots, grey dashes, or the class colour."""
    if source == OBSERVED:
        return {
            "color": INK,
            "linestyle": "none",
            "marker": "o",
            "markersize": _DOT_PT,
            "markeredgewidth": 0.0,
            "zorder": 4,
        }
    if source == TOUCHSIM:
        return {
            "color": TOUCHSIM_COLOUR,
            "linewidth": 1.3 * LINE_PT,
            "dashes": _DASHES,
            "zorder": 2,
        }
    thick = source == judged
    return {
        "color": AFFERENT_COLOURS[afferent],
        "linewidth": 2.2 * LINE_PT if thick else 0.8 * LINE_PT,
        "zorder": 3 if thick else 2.5,
    }


def draw_source_legend(
    figure: "Figure", sources: tuple[str, ...], judged: str, height: float
) -> None:
    """Name the sources once for all panels, `height` up the figure.

    A model has a colour of its own in each row: its sample shows all three.
    """
    from matplotlib.legend_handler import HandlerTuple
    from matplotlib.lines import Line2D

    samples: list[Any] = []  # tuples, which the types of Matplotlib know nothing of
    for source in sources:
        common = source in (OBSERVED, TOUCHSIM)
        classes = ("SA",) if common else tuple(AFFERENT_COLOURS)
        samples.append(tuple(Line2D([], [], **curve_style(source, one, judged)) for one in classes))
    figure.legend(
        samples,
        [source_title(source, judged) for source in sources],
        loc="center",
        bbox_to_anchor=(0.5, height),
        ncols=len(sources),
        frameon=False,
        fontsize=SMALL_TEXT_PT + 0.5,
        labelcolor=INK,
        handlelength=_LEGEND_HANDLE,
        columnspacing=2.2,
        handler_map={tuple: HandlerTuple(ndivide=None, pad=0.0)},
    )


def source_title(source: str, judged: str) -> str:
    """Give the words for a source in figures and tables."""
    if source == OBSERVED:
        return "Observed"
    if source == PUBLISHED_NAME:
        return "Published model"
    return "This model" if source == judged else source
