"""What a study of the finite-element model finds: checks, tables, numbers, a figure."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fembridge.plots.style import (
    AFFERENT_COLOURS,
    FAINT,
    HAIR_PT,
    INK,
    MARKERS,
    PAGE_WIDTH_IN,
    SERIES_COLOURS,
    SMALL_TEXT_PT,
    new_figure,
)
from fembridge.report.runs import Cost
from fembridge.response.deflection import richardson
from fembridge.typing import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame

AT_MOST, AT_LEAST = "at most", "at least"
SAFETY = 1.25

_HEIGHT_IN, _PANEL_IN = 2.6, 3.4
_DOT_PT = 3.2
# Names on a logarithmic axis that do not run into each other, less one.
_MOST_STEPS = 4


class Check(NamedTuple):
    """A number that was found, in `unit`, and the bound that it has to keep."""

    what: str
    found: float
    bound: float
    unit: str = ""
    side: str = AT_MOST

    @property
    def passed(self) -> bool:
        """Whether the bound is kept; what could not be found keeps none."""
        return self.found <= self.bound if self.side == AT_MOST else self.found >= self.bound


@dataclass(frozen=True, slots=True, eq=False)
class Finding:
    """What one study found.

    `tables` are by name, with all digits; NaN is a number that could not be had.
    `numbers` are those that the words of the page hold. `skipped` says why there are
    none of these, where something that the study needs is not installed.
    """

    checks: tuple[Check, ...] = ()
    tables: Mapping[str, "DataFrame"] = field(default_factory=dict)
    numbers: Mapping[str, Any] = field(default_factory=dict)
    figure: "Figure | None" = None
    skipped: str = ""
    cost: Cost = Cost()  # noqa: RUF009 - frozen


def extrapolated(width: FloatArray, value: FloatArray) -> tuple[float, float, float]:
    """Limit and order of the last three of `value` ``(K,)`` at falling element widths.

    Third what the finest is worth in percent: Roache's grid convergence index (J. Fluids Eng.
    116:405, 1994), 1.25 times its estimated error. Where the values do not close in from one
    side, limit and order are NaN and that is their spread.
    """
    last = value[-3:]
    limit, order = richardson(width[-3:], last)
    off = last.max() - last.min() if math.isnan(limit) else SAFETY * abs(limit - last[-1])
    return limit, order, 100 * float(off / abs(last[-1]))


def off_percent(found: FloatArray, expected: FloatArray) -> float:
    """Largest difference in percent of the largest value."""
    return 100 * float(np.abs(found - expected).max() / np.abs(expected).max())


def panels(count: int) -> tuple["Figure", list["Axes"]]:
    """Figure of `count` panels side by side."""
    width_in = min(PAGE_WIDTH_IN, _PANEL_IN * count + 0.6)
    figure, [row] = new_figure(_HEIGHT_IN, columns=count, width_in=width_in)
    return figure, list(row)


def line(row: int, *, name: str = "", mark: str = "both") -> dict[str, Any]:
    """Style of series `row` of a panel: "line", "dots", "both" or "dashed".

    A class of afferents has its own colour.
    """
    colour = AFFERENT_COLOURS.get(name, SERIES_COLOURS[row % len(SERIES_COLOURS)])
    style: dict[str, Any] = {"color": colour, "markersize": _DOT_PT}
    if mark in ("dots", "both"):
        style["marker"] = MARKERS[row]
    if mark == "dots":
        style["linestyle"] = "none"
    return {**style, "dashes": (4, 2)} if mark == "dashed" else style


def exact(*, dashed: bool = False) -> dict[str, Any]:
    """Style of a closed form or, dashed, of a limit."""
    style: dict[str, Any] = {"color": FAINT if dashed else INK, "linewidth": 2 * HAIR_PT}
    return {**style, "dashes": (4, 2)} if dashed else style


def finish(panel: "Axes", x: str, y: str, *, title: str = "", log: str = "") -> None:
    """Name axes and series; `log` names the logarithmic axes: "", "x" or "xy"."""
    panel.set_xscale("log" if "x" in log else "linear")
    panel.set_yscale("log" if "y" in log else "linear")
    panel.set(xlabel=x, ylabel=y, title=title)
    if log:
        _name_samples(panel)
    panel.legend(fontsize=SMALL_TEXT_PT - 1, handlelength=1.8)


def _name_samples(panel: "Axes") -> None:
    """Name a logarithmic x axis where the samples are: there are few."""
    places = np.unique(np.concatenate([each.get_xdata() for each in panel.lines])).tolist()
    kept, step = places[:1], (places[-1] / places[0]) ** (1 / _MOST_STEPS)
    for place in places[1:]:
        if place >= 0.99 * step * kept[-1]:
            kept.append(place)
    panel.set_xticks(kept, [f"{place:g}" for place in kept])
    panel.minorticks_off()
