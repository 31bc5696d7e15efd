"""Style of all pictures: colours, sizes, axes; and saving a figure to a file.

The class colours are from Okabe and Ito (2008), which people with any common colour
blindness distinguish; green, blue and orange for SA, RA and PC are customary in the field.
The fills of a finger's layers are muted, so that afferents are visible on all of them.
Adjacent layers differ in lightness too, so that they remain distinct in print without
colour. Their hues follow histology where possible.
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
from fembridge.host.store import replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Annotation

    Panels = Axes | Sequence[Axes] | np.ndarray[Any, Any]  # to draw into, in reading order

Share = bool | Literal["row", "col"]
_Params = ParamSpec("_Params")
_Result = TypeVar("_Result")

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
# Colours of Okabe and Ito that no afferent class uses.
SERIES_COLOURS = ("#56B4E9", "#E69F00", "#CC79A7", INK, "#7A7A7A", "#F0E442")
MARKERS = ("o", "s", "^", "D", "v", "P")

# In points, for a figure printed at its own size.
TEXT_PT = 8.0
SMALL_TEXT_PT = 7.0
TINY_TEXT_PT = 5.5
HAIR_PT = 0.5
PT_PER_IN = 72.0
LINE_PT = 0.9

# Width of a journal's two columns, in inches.
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
    # A fixed value skips the search for a position above the ticks: none are on top.
    "axes.titley": 1.0,
    "axes.titlesize": SMALL_TEXT_PT,
    "figure.labelsize": SMALL_TEXT_PT,
    "figure.titlesize": TEXT_PT,
    "legend.fontsize": SMALL_TEXT_PT,
    "legend.frameon": False,
    "lines.color": INK,
    "lines.linewidth": LINE_PT,
    "lines.markeredgewidth": 0.0,
    # Text stays text where a format allows it, and files are reproducible.
    "svg.hashsalt": "fembridge",
    "pdf.fonttype": 42,
    "ps.fonttype": 42,
}
# Metadata entries with the time of writing, which is left out.
_DATE_KEYS = {"svg": "Date", "svgz": "Date", "pdf": "CreationDate"}
# Matplotlib writes this format through LaTeX, which may be missing or stop midway.
_LATEX_FORMAT = "pgf"

# Label of the patches of `shade_outside`; Matplotlib's legends skip labels with "_".
_SHADE_LABEL = "_not counted"

# No font fits more letters into a figure's width.
_MAX_LETTERS = 400


def import_matplotlib() -> None:
    """Import Matplotlib even if the backend in ``MPLBACKEND`` (as Jupyter's) is not installed.

    Our figures need no backend. If it is installed, later figures of this process use it.
    """
    if "matplotlib" in sys.modules:
        return
    backend = os.environ.pop("MPLBACKEND", None)
    import matplotlib as mpl

    if backend is not None:
        os.environ["MPLBACKEND"] = backend
        with suppress(ValueError):
            mpl.rcParams["backend"] = backend


def in_style(draw: Callable[_Params, _Result]) -> Callable[_Params, _Result]:
    """`draw` with the common style as Matplotlib's defaults."""

    @wraps(draw)
    def styled(*args: _Params.args, **options: _Params.kwargs) -> _Result:
        import_matplotlib()
        from matplotlib import rc_context

        with rc_context(_STYLE):
            return draw(*args, **options)

    return styled


def check_suffix(path: Path) -> str:
    """Format of the suffix of `path`; a UsageError if Matplotlib cannot write it."""
    import_matplotlib()
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    formats = set(FigureCanvasAgg.get_supported_filetypes()) - {_LATEX_FORMAT}
    suffix = path.suffix.removeprefix(".").lower()
    if suffix not in formats:
        expected = f"one of {', '.join(sorted(formats))}"
        kind = path.suffix or "a file without suffix"
        problem = f"cannot draw {kind}, expected {expected}"
        raise UsageError(problem, path, found=path.suffix, expected=expected)
    return suffix


def save_figure(figure: "Figure", path: Path, dpi: float = DPI) -> None:
    """Write `figure` in the format of the suffix; the same figure gives the same bytes."""
    from matplotlib import rc_context
    from matplotlib.backend_bases import get_registered_canvas_class

    suffix = check_suffix(path)
    canvas = get_registered_canvas_class(suffix)(figure)
    figure.dpi = canvas.fixed_dpi or dpi
    if (layout := figure.get_layout_engine()) is not None:
        layout.execute(figure)  # otherwise Matplotlib draws twice: for the margins, and to save
        figure.set_layout_engine("none")
    metadata = {_DATE_KEYS[suffix]: None} if suffix in _DATE_KEYS else None
    with rc_context(_STYLE), replacing(path) as draft:
        figure.savefig(draft, format=suffix, dpi=dpi, metadata=metadata)


def checked_axes(axes: "Panels", count: int) -> tuple["Figure", Any]:
    """Figure of the caller's `axes`, and these as an array ``(count,)``.

    Raises UsageError: another number of axes, or no Matplotlib axes.
    """
    from matplotlib.axes import Axes

    panels = np.ravel(np.asarray(axes, dtype=object))
    if panels.size != count or not all(isinstance(panel, Axes) for panel in panels):
        kinds = {type(panel).__name__ for panel in panels} or {"nothing"}
        raise UsageError(
            f"has {panels.size} items ({', '.join(sorted(kinds))}), expected {count} Matplotlib "
            "axes, one per panel in reading order",
            argument="ax",
            found=panels.size,
            expected=f"{count} axes",
        )
    figure = panels[0].figure
    while (parent := getattr(figure, "figure", figure)) is not figure:  # of a subfigure
        figure = parent
    return figure, panels


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
    axes: "Panels | None" = None,
) -> tuple["Figure", Any]:
    """Figure and its panels ``(rows, columns)``.

    Matplotlib computes the margins, which takes seconds for many panels: see `grid_figure`.
    `heights` and `widths` are the shares of rows and columns, by default equal. `axes` are
    panels in reading order that replace a new figure. Raises UsageError: another number of them.
    """
    if axes is not None:
        figure, panels = checked_axes(axes, rows * columns)
        _share(panels.reshape(rows, columns), sharex, sharey)
        return figure, panels.reshape(rows, columns)
    from fembridge.plots.notebook_figure import NotebookFigure

    figure = NotebookFigure(figsize=(width_in, height_in), layout="constrained")
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
    widths_in: Sequence[float],
    heights_in: Sequence[float],
    count: int,
    axes: "Panels | None" = None,
) -> tuple["Figure", Callable[[int, int], "Axes"]]:
    """Figure, and a function that adds its panel of a row and column; for hundreds of panels.

    Widths and heights are in the order margin, panel, gap, panel, ... margin. `axes` are `count`
    panels in reading order that replace a new figure. Raises UsageError: another number of them.
    """
    if axes is not None:
        figure, panels = checked_axes(axes, count)
        remaining = iter(panels)
        return figure, lambda row, column: next(remaining)
    from fembridge.plots.notebook_figure import NotebookFigure

    x_in, y_in = np.cumsum(widths_in), np.cumsum(heights_in)
    width_in, height_in = x_in[-1], y_in[-1]
    figure = NotebookFigure(figsize=(width_in, height_in))

    def panel(row: int, column: int) -> "Axes":
        width, height = widths_in[2 * column + 1] / width_in, heights_in[2 * row + 1] / height_in
        corner = x_in[2 * column] / width_in, 1 - y_in[2 * row + 1] / height_in
        axes: Axes = figure.add_axes((*corner, width, height))
        make_plain(axes)
        return axes

    return figure, panel


def _share(panels: "np.ndarray[Any, Any]", sharex: Share, sharey: Share) -> None:
    """Share x and y axes of `panels` ``(rows, columns)`` as `Figure.subplots` does.

    A panel that already shares its axis with another one of the caller is left as it is.
    """
    for (row, column), panel in np.ndenumerate(panels):
        first = {True: panels[0, 0], "row": panels[row, 0], "col": panels[0, column]}
        if sharex and len(panel.get_shared_x_axes().get_siblings(panel)) == 1:
            panel.sharex(first[sharex])
        if sharey and len(panel.get_shared_y_axes().get_siblings(panel)) == 1:
            panel.sharey(first[sharey])
        if sharex in (True, "col") and row + 1 < len(panels):
            panel.tick_params(labelbottom=False)
        if sharey in (True, "row") and column:
            panel.tick_params(labelleft=False)


def make_plain(panel: "Axes") -> None:
    """Set small tick labels and ticks on both axes."""
    panel.tick_params(labelsize=SMALL_TEXT_PT, length=2.0, width=HAIR_PT, pad=2, colors=INK)


def log_axis(panel: "Axes", low: float, high: float, *, vertical: bool = False) -> None:
    """Scale x (y if `vertical`) logarithmically from `low` to `high`, plain numbers at decades.

    The minor ticks are one line of markers: as ticks they took half of the drawing time of a
    picture with many panels.
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
    minor = np.outer(decades, np.arange(2, 10)).ravel()
    minor = minor[(low <= minor) & (minor <= high)]
    positions = (0.0 * minor, minor) if vertical else (minor, 0.0 * minor)
    ticks = Line2D(
        *positions,
        transform=panel.get_yaxis_transform() if vertical else panel.get_xaxis_transform(),
        marker=MarkerStyle(TICKLEFT if vertical else TICKDOWN),
        markersize=1.2,
        markeredgewidth=0.4,
        linestyle="none",
        color=INK,
    )
    panel.figure.add_artist(ticks)


def dots(colour: str, size_pt: float, **overrides: Any) -> dict[str, Any]:  # noqa: ANN401 - style
    """Line style of filled markers without a line; `overrides` are further properties."""
    return {"color": colour, "linestyle": "none", "marker": "o", "markersize": size_pt, **overrides}


def marks(marker: str, colour: str, size_pt: float, *, filled: bool = False) -> dict[str, Any]:
    """Line style of outlined markers without a line, white inside unless `filled`."""
    face = {"markerfacecolor": colour if filled else WHITE, "markeredgewidth": 0.9}
    return dots(colour, size_pt, marker=marker, clip_on=False, zorder=3, **face)


def note(
    panel: "Axes",
    text: str,
    position: tuple[float, float],
    offset_pt: tuple[float, float],
    *,
    frame: Any = "axes fraction",  # noqa: ANN401 - Matplotlib's own
    **options: Any,  # noqa: ANN401 - Matplotlib's own
) -> "Annotation":
    """Write `text` at `offset_pt` points from `position`, also outside of the panel."""
    coordinates: dict[str, Any] = {"xycoords": frame, "textcoords": "offset points"}
    return panel.annotate(
        text, position, xytext=offset_pt, annotation_clip=False, **coordinates, **options
    )


def class_style(afferent: str, size_pt: float = TEXT_PT) -> dict[str, Any]:
    """Text style of the name of an afferent class: bold, in its colour."""
    colour = AFFERENT_COLOURS.get(afferent, INK)
    return {"color": colour, "fontsize": size_pt, "fontweight": "bold"}


def legend_above(
    figure: "Figure",
    samples: Iterable[Any],
    names: Iterable[str],
    **spacing: Any,  # noqa: ANN401 - Matplotlib's own
) -> None:
    """Add a legend above all panels, of one row unless `spacing` has ``ncols``.

    A sample is a line style, or a list of line styles (one per class) shown side by side; a style
    with a ``facecolor`` is that of a band.
    """
    from matplotlib.legend_handler import HandlerTuple
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [
        tuple(
            Patch(**style) if "facecolor" in style else Line2D([], [], **style)
            for style in (sample if isinstance(sample, list) else [sample])
        )
        for sample in samples
    ]
    location: dict[str, Any] = {"loc": "outside upper center"}
    if figure.get_layout_engine() is None:
        location = {"loc": "upper center", "borderaxespad": 0.2}
    figure.legend(
        handles,
        list(names),
        handler_map={tuple: HandlerTuple(ndivide=None, pad=0.0)},
        **{"ncols": len(handles), **location, **spacing},
    )


def shade_outside(panel: "Axes", window_ms: tuple[float, float]) -> None:
    """Shade the time of a panel outside `window_ms` grey."""
    start_ms, end_ms = panel.get_xlim()
    for from_ms, to_ms in ((start_ms, window_ms[0]), (window_ms[1], end_ms)):
        if to_ms > from_ms:
            patch = panel.axvspan(from_ms, to_ms, facecolor=SHADE, linewidth=0, zorder=-2)
            patch.set_label(_SHADE_LABEL)


def explain_shade(
    figure: "Figure",
    windows_ms: Iterable[tuple[float, float]],
    **location: Any,  # noqa: ANN401 - Matplotlib's own
) -> None:
    """Add a legend below all panels for the grey of `shade_outside`, if any panel has it."""
    from matplotlib.patches import Patch

    if not any(
        patch.get_label() == _SHADE_LABEL for panel in figure.axes for patch in panel.patches
    ):
        return
    spans = {f" ({start:g} to {end:g} ms)" for start, end in windows_ms}
    label = f"outside the time in which spikes are counted{spans.pop() if len(spans) == 1 else ''}"
    sample = Patch(facecolor=SHADE, edgecolor=FAINT, linewidth=HAIR_PT, label=label)
    figure.legend(
        handles=[sample], **{"loc": "outside lower center", "handlelength": 1.4, **location}
    )


def shorten_text(text: str, width_in: float, size_pt: float = SMALL_TEXT_PT) -> str:
    """`text` on one line, cut in the middle to at most `width_in` inches."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    font, line = FontProperties(size=size_pt), " ".join(text.split())
    shortened, letters = line, min(len(line), _MAX_LETTERS)
    while letters > 1 and text_to_path.get_text_width_height_descent(shortened, font, False)[0] > (
        width_in * PT_PER_IN
    ):
        letters -= 1
        shortened = f"{line[: (letters + 1) // 2]}…{line[len(line) - letters // 2 :]}"
    return shortened


def spread_heights(targets: Sequence[float], step: float, bottom: float, top: float) -> list[float]:
    """Falling heights at least `step` apart, as close to `targets` as possible.

    They stay between `bottom` and `top` if there is room for all. The mean of a group of
    heights that are moved apart does not change.
    """
    from scipy.optimize import isotonic_regression

    offsets = step * np.arange(len(targets))
    moved = isotonic_regression(targets + offsets, increasing=False).x
    # Without room for all, the upper limit takes precedence.
    heights: list[float] = (
        np.minimum(np.maximum(moved, bottom + offsets[-1]), top) - offsets
    ).tolist()
    return heights
