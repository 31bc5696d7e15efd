"""A Matplotlib figure that a notebook shows, without a magic line and without pyplot."""

from io import BytesIO

from matplotlib.figure import Figure

_NOTEBOOK_DPI = 96


class NotebookFigure(Figure):
    """A figure with a picture for IPython, as every picture of this package."""

    def _repr_png_(self) -> bytes:
        content = BytesIO()
        self.savefig(content, format="png", dpi=_NOTEBOOK_DPI)
        return content.getvalue()
