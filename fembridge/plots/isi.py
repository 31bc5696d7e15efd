"""Inter-spike intervals: their histogram, a panel a class, a row a stimulus."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from fembridge.errors import UsageError
from fembridge.plots.psth import bins, histogram
from fembridge.plots.rows import draw_histograms, rows_and_classes, rows_figure
from fembridge.plots.style import AFFERENT_COLOURS, TINY_TEXT_PT, in_style, note
from fembridge.tables import SpikeTrain
from fembridge.typing import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DEFAULT_BIN_MS = 1.0

_ROW_IN = (0.42, 0.13)
# Of the axis: right of the longest interval stands how many there are.
_ROOM = 1.22


@in_style
def isi_figure(
    trains: Iterable[SpikeTrain],
    *,
    bin_ms: float = DEFAULT_BIN_MS,
    longest_ms: float | None = None,
    stimuli: Sequence[str] | None = None,
    afferents: Sequence[str] | None = None,
) -> "Figure":
    """Share of a row's intervals in each bin of `bin_ms`; how many there are is beside it.

    Intervals are those between neighbouring spikes of one cell. The axis ends at
    `longest_ms`, by default the longest interval of all; shares are of all intervals,
    drawn or not. All rows of a class share a scale, which stands below its name.

    Raises
    ------
    UsageError
        Nothing to draw, spikes that have no row, no bin width or too many bins.
    """
    trains = list(trains)
    rows, classes = rows_and_classes(trains, stimuli, afferents)
    found = [[intervals_ms(trains, name, one) for name in rows] for one in classes]
    longest = [float(each.max()) for of_class in found for each in of_class if each.size]
    if longest_ms is not None and not longest_ms > 0:
        raise UsageError(f"longest interval {longest_ms:g} ms, expected more than 0")
    edges_ms = bins(0.0, longest_ms or max([*longest, bin_ms]) + bin_ms / 2, bin_ms)
    shares = []
    for of_class in found:
        drawn = [each[each < edges_ms[-1]] for each in of_class]
        pairs = zip(drawn, of_class, strict=True)
        shares.append([histogram(part, edges_ms) / max(whole.size, 1) for part, whole in pairs])
    tops = [max(float(share.max()) for share in of_class) for of_class in shares]
    figure, panels = rows_figure(
        rows,
        classes,
        _ROW_IN,
        x=("Inter-spike interval (ms)", 0.0, _ROOM * float(edges_ms[-1])),
        notes=[f"row height: {100 * top:.3g} % of intervals" if top else "none" for top in tops],
    )
    drawings = zip(classes, panels, shares, tops, found, strict=True)
    for afferent, panel, of_class, top, whole in drawings:
        heights = [share / (top or 1.0) for share in of_class]
        draw_histograms(panel, heights, edges_ms, AFFERENT_COLOURS[afferent])
        style = {"ha": "right", "va": "center", "fontsize": TINY_TEXT_PT}
        for row, each in enumerate(whole):
            if each.size:
                frame = ("axes fraction", "data")
                note(panel, f"n = {each.size}", (1.0, row), (0, 0), frame=frame, **style)
    return figure


def intervals_ms(trains: Iterable[SpikeTrain], stimulus: str, afferent: str) -> FloatArray:
    """Intervals between neighbouring spikes of each cell, all cells together."""
    mine = [t.times_ms for t in trains if (t.stimulus, t.afferent) == (stimulus, afferent)]
    return np.concatenate([np.zeros(0), *map(np.diff, mine)])
