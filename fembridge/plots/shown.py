"""What the results of all commands share: a picture and a few lines in a notebook."""

from base64 import b64encode
from html import escape
from io import BytesIO
from typing import TYPE_CHECKING, Any

from fembridge.errors import FembridgeError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LONGEST_REPR = 5
"""Lines of a result in an interpreter."""
_SMALL_DPI = 60
_SMALL_WIDTH = 480  # pixels


class Shown:
    """A result that shows itself: `repr` in a few lines, in a notebook with a small picture.

    A result class defines `_lines`, the lines of its `repr`, and `plot`.
    """

    __slots__ = ()

    def _lines(self) -> list[str]:
        """Lines of the `repr`, the class first; more than five are cut."""
        raise NotImplementedError

    def plot(self, kind: str | None = None, ax: Any = None) -> "Figure":  # noqa: ANN401 - axes
        """Picture of the result, drawn into `ax` if that is given."""
        raise NotImplementedError

    def __repr__(self) -> str:
        return "\n".join(self._lines()[:LONGEST_REPR])

    def _repr_html_(self) -> str:
        text = f"<pre>{escape(repr(self))}</pre>"
        try:
            figure = self.plot()
        except FembridgeError as error:  # without data to draw
            return f"{text}<p>{escape(str(error))}</p>"
        content = BytesIO()
        figure.savefig(content, format="png", dpi=_SMALL_DPI)
        picture = b64encode(content.getvalue()).decode()
        source = f"data:image/png;base64,{picture}"
        return f'{text}<img style="max-width: {_SMALL_WIDTH}px" src="{source}">'
