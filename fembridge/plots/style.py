"""The one style of every picture: colours, sizes, plain axes, and how a file is saved.

The class colours are those of Okabe and Ito (2008), which people with any common
colour blindness distinguish; green, blue and orange for SA, RA and PC is the custom
of the field. The fills of a finger's layers are muted, so that afferents stand out on
all of them. Layers that touch differ in lightness, not in hue alone: they stay apart in
print without colour. Their hues are those of histology where they can be.
"""

import math
import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, ParamSpec, TypeVar

import numpy as np

from fembridge.errors import UsageError
from fembridge.store import replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Annotation

Share = bool | Literal["row", "col"]
_Given = ParamSpec("_Given")
_Drawn = TypeVar("_Drawn")

AFFERENT_COLOURS = {"SA": "#009E73", "RA": "#0072B2", "PC": "#D55E00"}
INK, GREY, FAINT, SHADE, WHITE = "#1A1A1A", "#808080", "#B8B8B8", "#E6E6E6", "#FFFFFF"
LAYER_COLOURS: Mapping[str, str] = {
    "stratum_corneum": "#96794E",
    "epidermis": "#E8C699",
    "dermis": "#D0958F",
    "subcutaneous_tissue": "#F8F0DA",
    "bone": "#BCC3CC",
    "nail": "#73849C",
}
PROBE_COLOUR = "#4D4D4D"
# Of Okabe and Ito, those that no class of afferents has.
SERIES_COLOURS = ("#56B4E9", "#E69F00", "#CC79A7", INK, "#7A7A7A", "#F0E442")
MARKERS = ("o", "s", "^", "D", "v", "P")

# In points, for a figure that is printed at its own size.
TEXT_PT = 8.0
SMALL_TEXT_PT = 7.0
TINY_TEXT_PT = 5.5
HAIR_PT = 0.5
PT_PER_IN = 72.0
LINE_PT = 0.9

# Two columns of a journal, in inches.
PAGE_WIDTH_IN = 7.2
DPI = 200

_STYLE: dict[Any, Any] = {
    "font.size": SMALL_TEXT_PT,
    "text.color": INK,
    "axes.prop_cycle": f"cycler('color', ['{INK}'])",
    "axes.edgecolor": INK,
    "axes.linewidth": HAIR_PT,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.labelcolor": INK,
    "axes.labelsize": SMALL_TEXT_PT,
    # Given, no place is looked for that is clear of ticks above the panel: we have none.
    "axes.titley": 1.0,
    "axes.titlesize": SMALL_TEXT_PT,
    "figure.labelsize": SMALL_TEXT_PT,
    "figure.titlesize": TEXT_PT,
    "legend.fontsize": SMALL_TEXT_PT,
    "legend.frameon": False,
    "lines.color": INK,
    "lines.linewidth": LINE_PT,
    "lines.markeredgewidth": 0.0,
    # Text stays text where a format allows it, and nothing in a file is random.
    "svg.hashsalt": "fembridge",
    "pdf.fonttype": 42,
    "ps.fonttype": 42,
}
# The entries of a file's metadata that would hold the time of writing.
_DATED = {"svg": "Date", "svgz": "Date", "pdf": "CreationDate"}
# Matplotlib writes it through LaTeX, which may not be there and can stop midway.
_NEEDS_LATEX = "pgf"

# The mark of a grey ground of `shade_outside`; legends leave out what begins so.
_SHADED = "_not counted"

# Of a name that is too long for its place: no font shows more in a figure's width.
_MOST_LETTERS = 400


def import_matplotlib() -> None:
    """Import Matplotlib whatever ``MPLBACKEND`` says: Jupyter's is often not installed here.

    We draw without that backend; who shows figures in this process gets it if it exists.
    """
    if "matplotlib" in sys.modules:
        return
    asked = os.environ.pop("MPLBACKEND", None)
    import matplotlib as mpl

    if asked is not None:
        os.environ["MPLBACKEND"] = asked
        with suppress(ValueError):
            mpl.rcParams["backend"] = asked


def in_style(draw: Callable[_Given, _Drawn]) -> Callable[_Given, _Drawn]:
    """`draw` in the style: it says of its lines and words only where they differ."""

    @wraps(draw)
    def drawn(*args: _Given.args, **options: _Given.kwargs) -> _Drawn:
        import_matplotlib()
        from matplotlib import rc_context

        with rc_context(_STYLE):
            return draw(*args, **options)

    return drawn


def check_suffix(path: Path) -> str:
    """Format that the suffix of `path` stands for; a UsageError where Matplotlib has none."""
    import_matplotlib()
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    known = set(FigureCanvasAgg.get_supported_filetypes()) - {_NEEDS_LATEX}
    suffix = path.suffix.removeprefix(".").lower()
    if suffix not in known:
        raise UsageError(
            f"{path}: cannot draw {path.suffix or 'a file without suffix'}, "
            f"expected one of {', '.join(sorted(known))}"
        )
    return suffix


def save_figure(figure: "Figure", path: Path, dpi: float = DPI) -> None:
    """Write `figure`; its suffix chooses the format, the same figure the same bytes."""
    from matplotlib import rc_context
    from matplotlib.backend_bases import get_registered_canvas_class

    suffix = check_suffix(path)
    canvas = get_registered_canvas_class(suffix)(figure)
    figure.dpi = canvas.fixed_dpi or dpi
    if (layout := figure.get_layout_engine()) is not None:
        layout.execute(figure)  # else Matplotlib draws twice: to find the margins, and to save
        figure.set_layout_engine("none")
    metadata = {_DATED[suffix]: None} if suffix in _DATED else None
    with rc_context(_STYLE), replacing(path) as draft:
        figure.savefig(draft, format=suffix, dpi=dpi, metadata=metadata)


def new_figure(
    height_in: float,
    rows: int = 1,
    columns: int = 1,
    *,
    width_in: float = PAGE_WIDTH_IN,
    heights: Sequence[float] | None = None,
    widths: Sequence[float] | None = None,
    sharex: Share = False,
    sharey: Share = False,
) -> tuple["Figure", Any]:
    """Figure and its panels ``(rows, columns)``, their axes plain.

    Margins are found, which takes seconds where panels are many: see `grid_figure`. `heights`
    and `widths` are the shares of rows and columns.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    panels = figure.subplots(
        rows,
        columns,
        squeeze=False,
        sharex=sharex,
        sharey=sharey,
        height_ratios=heights,
        width_ratios=widths,
    )
    for panel in panels.flat:
        make_plain(panel)
    return figure, panels


def grid_figure(
    widths_in: Sequence[float], heights_in: Sequence[float]
) -> tuple["Figure", Callable[[int, int], "Axes"]]:
    """Figure, and what makes its panel of a row and column, for hundreds of panels.

    Widths and heights are those of margin, panel, gap, panel, ... margin.
    """
    from matplotlib.figure import Figure

    x_in, y_in = np.cumsum(widths_in), np.cumsum(heights_in)
    wide_in, tall_in = x_in[-1], y_in[-1]
    figure = Figure(figsize=(wide_in, tall_in))

    def panel(row: int, column: int) -> "Axes":
        wide, tall = widths_in[2 * column + 1] / wide_in, heights_in[2 * row + 1] / tall_in
        corner = x_in[2 * column] / wide_in, 1 - y_in[2 * row + 1] / tall_in
        made: Axes = figure.add_axes((*corner, wide, tall))
        make_plain(made)
        return made

    return figure, panel


def make_plain(panel: "Axes") -> None:
    """Small numbers and marks on both axes; Matplotlib would make them when it saves."""
    panel.tick_params(labelsize=SMALL_TEXT_PT, length=2.0, width=HAIR_PT, pad=2, colors=INK)


def log_axis(panel: "Axes", low: float, high: float, *, vertical: bool = False) -> None:
    """Scale x, or y, logarithmically from `low` to `high`, plain numbers at the decades.

    The marks between them are one line of markers: as ticks they were half of what a
    picture of many panels took.
    """
    from matplotlib.lines import Line2D
    from matplotlib.markers import TICKDOWN, TICKLEFT, MarkerStyle
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    axis = panel.yaxis if vertical else panel.xaxis
    name = "y" if vertical else "x"
    panel.set(**{f"{name}scale": "log", f"{name}lim": (low, high)})
    axis.set_major_locator(LogLocator(10.0))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())
    decades = 10.0 ** np.arange(math.floor(math.log10(low)), math.ceil(math.log10(high)))
    between = np.outer(decades, np.arange(2, 10)).ravel()
    between = between[(low <= between) & (between <= high)]
    at = (0.0 * between, between) if vertical else (between, 0.0 * between)
    marks = Line2D(
        *at,
        transform=panel.get_yaxis_transform() if vertical else panel.get_xaxis_transform(),
        marker=MarkerStyle(TICKLEFT if vertical else TICKDOWN),
        markersize=1.2,
        markeredgewidth=0.4,
        linestyle="none",
        color=INK,
    )
    panel.figure.add_artist(marks)


def dots(colour: str, size_pt: float, **changed: Any) -> dict[str, Any]:  # noqa: ANN401 - style
    """Filled marks without a line between them."""
    return {"color": colour, "linestyle": "none", "marker": "o", "markersize": size_pt, **changed}


def marks(marker: str, colour: str, size_pt: float, *, filled: bool = False) -> dict[str, Any]:
    """Outlined marks without a line between them, white inside unless `filled`."""
    face = {"markerfacecolor": colour if filled else WHITE, "markeredgewidth": 0.9}
    return dots(colour, size_pt, marker=marker, clip_on=False, zorder=3, **face)


def note(
    panel: "Axes",
    words: str,
    at: tuple[float, float],
    by_pt: tuple[float, float],
    *,
    frame: Any = "axes fraction",  # noqa: ANN401 - as Matplotlib takes it
    **text: Any,  # noqa: ANN401 - as Matplotlib takes it
) -> "Annotation":
    """Words `by_pt` points away from a place of a panel, also outside of it."""
    place: dict[str, Any] = {"xycoords": frame, "textcoords": "offset points"}
    return panel.annotate(words, at, xytext=by_pt, annotation_clip=False, **place, **text)


def class_style(afferent: str, size_pt: float = TEXT_PT) -> dict[str, Any]:
    """Style of the name of a class: bold, in its colour."""
    colour = AFFERENT_COLOURS.get(afferent, INK)
    return {"color": colour, "fontsize": size_pt, "fontweight": "bold"}


def legend_above(
    figure: "Figure",
    samples: Iterable[Any],
    names: Iterable[str],
    **spacing: Any,  # noqa: ANN401 - as Matplotlib takes it
) -> None:
    """One row of names above all panels.

    A sample is the style of a line; a list of them is shown side by side: a class each.
    """
    from matplotlib.legend_handler import HandlerTuple
    from matplotlib.lines import Line2D

    handles: list[Any] = [
        tuple(Line2D([], [], **one) for one in (each if isinstance(each, list) else [each]))
        for each in samples
    ]
    place: dict[str, Any] = {"loc": "outside upper center"}
    if figure.get_layout_engine() is None:
        place = {"loc": "upper center", "borderaxespad": 0.2}
    figure.legend(
        handles,
        list(names),
        ncols=len(handles),
        handler_map={tuple: HandlerTuple(ndivide=None, pad=0.0)},
        **{**place, **spacing},
    )


def shade_outside(panel: "Axes", window_ms: tuple[float, float]) -> None:
    """Give the time of a panel that is not in the window a grey ground."""
    start_ms, end_ms = panel.get_xlim()
    for left, right in ((start_ms, window_ms[0]), (window_ms[1], end_ms)):
        if right > left:
            ground = panel.axvspan(left, right, facecolor=SHADE, linewidth=0, zorder=-2)
            ground.set_label(_SHADED)


def explain_shade(
    figure: "Figure",
    windows_ms: Iterable[tuple[float, float]],
    **place: Any,  # noqa: ANN401 - as Matplotlib takes it
) -> None:
    """Name the grey ground of `shade_outside`, where there is any, in a legend below all panels."""
    from matplotlib.patches import Patch

    if not any(patch.get_label() == _SHADED for panel in figure.axes for patch in panel.patches):
        return
    spans = {f" ({start:g} to {end:g} ms)" for start, end in windows_ms}
    words = f"outside the time in which spikes are counted{spans.pop() if len(spans) == 1 else ''}"
    sample = Patch(facecolor=SHADE, edgecolor=FAINT, linewidth=HAIR_PT, label=words)
    figure.legend(handles=[sample], **{"loc": "outside lower center", "handlelength": 1.4, **place})


def fitting(words: str, room_in: float, size_pt: float = SMALL_TEXT_PT) -> str:
    """`words` on one line, or as much of their two ends as is no wider than `room_in`."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    font, whole = FontProperties(size=size_pt), " ".join(words.split())
    shown, kept = whole, min(len(whole), _MOST_LETTERS)
    while kept > 1 and text_to_path.get_text_width_height_descent(shown, font, False)[0] > (
        room_in * PT_PER_IN
    ):
        kept -= 1
        shown = f"{whole[: (kept + 1) // 2]}…{whole[len(whole) - kept // 2 :]}"
    return shown


def spread(wanted: Sequence[float], step: float, bottom: float, top: float) -> list[float]:
    """Move falling heights apart by `step` or more, each as little as it can be.

    They stay between `bottom` and `top` where there is room for all; in groups
    that push each other, the middle stays where it was.
    """
    from scipy.optimize import isotonic_regression

    below = step * np.arange(len(wanted))
    placed = isotonic_regression(wanted + below, increasing=False).x
    # Where there is no room for all, the upper end counts.
    heights: list[float] = (
        np.minimum(np.maximum(placed, bottom + below[-1]), top) - below
    ).tolist()
    return heights
