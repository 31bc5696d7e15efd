"""The figures of a report: each a file beside the page, and its text for the page."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from fembridge.plots.picture import save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class Album:
    """Figures as SVG in `folder`, which stands."""

    folder: Path

    def keep(self, figure: "Figure", name: str) -> str:
        """Write `figure` as ``NAME.svg`` and give the text of that file."""
        path = self.folder / file_name(name)
        save_figure(figure, path)
        return path.read_text(encoding="utf-8")


def file_name(name: str) -> str:
    """Give the name of the file that holds the figure `name`."""
    return f"{name}.svg"
