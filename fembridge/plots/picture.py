"""What every picture shares: plain axes, and a file that is whole or not there."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from fembridge.errors import UsageError
from fembridge.plots.palette import DPI, HAIR_PT, INK, SMALL_TEXT_PT
from fembridge.store import replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Text stays text where a format allows it, and nothing in a file is random.
_SETTINGS: dict[Any, Any] = {"svg.hashsalt": "fembridge", "pdf.fonttype": 42, "ps.fonttype": 42}
# The entries of a file's metadata that would hold the time of writing.
_DATED = {"svg": "Date", "svgz": "Date", "pdf": "CreationDate"}

# Matplotlib writes it through LaTeX, which may not be there and can stop midway.
_NEEDS_LATEX = "pgf"


def check_suffix(path: Path) -> str:
    """Give the format that the suffix of `path` stands for.

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


def make_plain(panel: "Axes") -> None:
    """Leave a panel its left and lower line, thin, with small numbers."""
    for side, spine in panel.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_linewidth(HAIR_PT)
        spine.set_color(INK)
    panel.tick_params(labelsize=SMALL_TEXT_PT, length=2.0, width=HAIR_PT, pad=2, colors=INK)
