"""The one style of every picture: colours, sizes, plain axes, and how a file is saved.

The class colours are those of Okabe and Ito (2008), which people with any common
colour blindness tell apart; green, blue and orange for SA, RA and PC is the custom
of the field. The fills of a finger's layers are muted, so that afferents stand out on
all of them. Layers that touch differ in lightness, not in hue alone: they stay apart in
print without colour. Their hues are those of histology where they can be.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from fembridge.errors import UsageError
from fembridge.store import replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Share = bool | Literal["row", "col"]

AFFERENT_COLOURS = {"SA": "#009E73", "RA": "#0072B2", "PC": "#D55E00"}
INK, FAINT, SHADE, WHITE = "#1A1A1A", "#B8B8B8", "#F1F1F1", "#FFFFFF"
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
LINE_PT = 0.9

# Two columns of a journal, in inches.
PAGE_WIDTH_IN = 7.2
DPI = 200

# Text stays text where a format allows it, and nothing in a file is random.
_SETTINGS: dict[Any, Any] = {"svg.hashsalt": "fembridge", "pdf.fonttype": 42, "ps.fonttype": 42}
# The entries of a file's metadata that would hold the time of writing.
_DATED = {"svg": "Date", "svgz": "Date", "pdf": "CreationDate"}
# Matplotlib writes it through LaTeX, which may not be there and can stop midway.
_NEEDS_LATEX = "pgf"

# A line of the mesh is its element's fill, darkened: no transparency, which some
# formats do not have.
_LINE_SHARE = 0.72


def line_colour(fill: str) -> tuple[float, float, float]:
    """Darker tone of a fill such as ``#E8C699``, for the lines drawn on it."""
    red, green, blue = (int(fill[k : k + 2], 16) / 255 for k in (1, 3, 5))
    return red * _LINE_SHARE, green * _LINE_SHARE, blue * _LINE_SHARE


def check_suffix(path: Path) -> str:
    """Format that the suffix of `path` stands for.

    Raises
    ------
    UsageError
        No suffix, or one of which Matplotlib makes no picture.
    """
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
    """Write `figure`; its suffix chooses the format, the same figure the same bytes.

    Raises
    ------
    UsageError
        A suffix that Matplotlib does not know.
    OutputError
        A place where nothing can be written.
    """
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    suffix = check_suffix(path)
    FigureCanvasAgg(figure)
    metadata = {_DATED[suffix]: None} if suffix in _DATED else None
    with rc_context(_SETTINGS), replacing(path) as draft:
        figure.savefig(draft, format=suffix, dpi=dpi, metadata=metadata)


def new_figure(
    height_in: float,
    rows: int,
    columns: int,
    *,
    margins_in: tuple[float, float, float, float, float, float],
    heights: Sequence[float] = (),
    sharex: Share = True,
    sharey: Share = True,
) -> tuple["Figure", Any]:
    """Figure of the page's width, and its panels ``(rows, columns)``.

    `margins_in` are left, right, top, bottom, then between columns and between rows,
    all in inches: a layout engine takes seconds. `heights` are those of the rows.
    """
    from matplotlib.figure import Figure

    left, right, top, bottom, between_columns, between_rows = margins_in
    panel_in = (PAGE_WIDTH_IN - left - right - (columns - 1) * between_columns) / columns
    tall_in = (height_in - top - bottom - (rows - 1) * between_rows) / rows
    figure = Figure(figsize=(PAGE_WIDTH_IN, height_in))
    spaced: dict[str, Any] = {
        "left": left / PAGE_WIDTH_IN,
        "right": 1 - right / PAGE_WIDTH_IN,
        "top": 1 - top / height_in,
        "bottom": bottom / height_in,
        "wspace": between_columns / panel_in,
        "hspace": between_rows / tall_in,
    }
    if heights:
        spaced["height_ratios"] = heights
    return figure, figure.subplots(
        rows, columns, squeeze=False, sharex=sharex, sharey=sharey, gridspec_kw=spaced
    )


def make_plain(panel: "Axes") -> None:
    """Leave a panel its left and lower line, thin, with small numbers."""
    for side, spine in panel.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_linewidth(HAIR_PT)
        spine.set_color(INK)
    panel.tick_params(labelsize=SMALL_TEXT_PT, length=2.0, width=HAIR_PT, pad=2, colors=INK)


def name_axes(panel: "Axes", x: str, y: str, size_pt: float = SMALL_TEXT_PT) -> None:
    """Label both axes, each with its unit in parentheses."""
    panel.set_xlabel(x, fontsize=size_pt, color=INK)
    panel.set_ylabel(y, fontsize=size_pt, color=INK)


def log_axis(panel: "Axes", low: float, high: float) -> None:
    """Scale x logarithmically from `low` to `high`, plain numbers at the decades."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    panel.set_xscale("log")
    panel.set_xlim(low, high)
    panel.xaxis.set_major_locator(LogLocator(10.0))
    panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.xaxis.set_minor_locator(LogLocator(10.0, subs=tuple(range(2, 10))))
    panel.xaxis.set_minor_formatter(NullFormatter())
    panel.tick_params(axis="x", which="minor", length=1.2, width=0.4, colors=INK)


def dots(colour: str, size_pt: float, marker: str = "o") -> dict[str, Any]:
    """Filled marks without a line between them."""
    return {
        "color": colour,
        "linestyle": "none",
        "marker": marker,
        "markersize": size_pt,
        "markeredgewidth": 0.0,
    }


def marks(marker: str, colour: str, size_pt: float, *, filled: bool = False) -> dict[str, Any]:
    """Outlined marks without a line between them, white inside unless `filled`."""
    return {
        "linestyle": "none",
        "marker": marker,
        "markersize": size_pt,
        "markerfacecolor": colour if filled else WHITE,
        "markeredgecolor": colour,
        "markeredgewidth": 0.9,
        "zorder": 3,
        "clip_on": False,
    }


def legend_above(
    figure: "Figure",
    samples: Sequence[Any],
    names: Iterable[str],
    *,
    down_in: float,
    size_pt: float = SMALL_TEXT_PT,
    pad: float = 0.0,
    **spacing: float | None,
) -> None:
    """One row of names for all panels, `down_in` below the figure's upper edge.

    A sample that is a tuple shows its lines side by side: a class each.
    """
    from matplotlib.legend_handler import HandlerTuple

    figure.legend(
        list(samples),
        list(names),
        loc="center",
        bbox_to_anchor=(0.5, 1 - down_in / figure.get_figheight()),
        ncols=len(samples),
        frameon=False,
        fontsize=size_pt,
        labelcolor=INK,
        handler_map={tuple: HandlerTuple(ndivide=None, pad=pad)},
        **spacing,
    )


def spread(wanted: Sequence[float], step: float, bottom: float, top: float) -> list[float]:
    """Move falling heights apart by `step` or more, each as little as it can be.

    They stay between `bottom` and `top` where there is room for all; in groups
    that push each other, the middle stays where it was.
    """
    groups: list[list[float]] = []

    def middle(group: Sequence[float]) -> float:
        half = 0.5 * step * (len(group) - 1)
        mean = sum(group) / len(group)
        return min(max(mean, bottom + half), top - half)

    for height in wanted:
        group = [height]
        while groups:
            reach = 0.5 * step * (len(groups[-1]) + len(group))
            if middle(groups[-1]) - middle(group) >= reach:
                break
            group = groups.pop() + group
        groups.append(group)
    return [
        middle(group) + step * (0.5 * (len(group) - 1) - k)
        for group in groups
        for k in range(len(group))
    ]
