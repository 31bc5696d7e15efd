"""What a study of the finite-element model finds: checks, tables, numbers, a figure."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fembridge.plots.style import (
    AFFERENT_COLOURS,
    FAINT,
    HAIR_PT,
    INK,
    LINE_PT,
    MARKERS,
    PAGE_WIDTH_IN,
    SERIES_COLOURS,
    SMALL_TEXT_PT,
    make_plain,
    name_axes,
)
from fembridge.report.runs import Cost

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame

AT_MOST, AT_LEAST = "at most", "at least"

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

    def to_frame(self) -> "DataFrame":
        """Checks: what, found, bound, unit, side, passed."""
        from pandas import DataFrame

        return DataFrame(
            [{**check._asdict(), "passed": check.passed} for check in self.checks],
            columns=[*Check._fields, "passed"],
        )


def panels(count: int) -> tuple["Figure", list["Axes"]]:
    """Figure of `count` panels side by side."""
    from matplotlib.figure import Figure

    width_in = min(PAGE_WIDTH_IN, _PANEL_IN * count + 0.6)
    figure = Figure(figsize=(width_in, _HEIGHT_IN), layout="constrained")
    return figure, list(figure.subplots(1, count, squeeze=False)[0])


def line(row: int, *, name: str = "", mark: str = "both") -> dict[str, Any]:
    """Style of series `row` of a panel: "line", "dots", "both" or "dashed".

    A class of afferents has its own colour.
    """
    style: dict[str, Any] = {
        "color": AFFERENT_COLOURS.get(name, SERIES_COLOURS[row % len(SERIES_COLOURS)]),
        "linewidth": LINE_PT,
    }
    if mark in ("dots", "both"):
        style |= {"marker": MARKERS[row], "markersize": _DOT_PT, "markeredgewidth": 0.0}
    if mark == "dots":
        style["linestyle"] = "none"
    if mark == "dashed":
        style["dashes"] = (4, 2)
    return style


def exact(*, dashed: bool = False) -> dict[str, Any]:
    """Style of a closed form or, dashed, of a limit."""
    style: dict[str, Any] = {"color": FAINT if dashed else INK, "linewidth": 2 * HAIR_PT}
    return {**style, "dashes": (4, 2)} if dashed else style


def finish(panel: "Axes", x: str, y: str, *, title: str = "", log: str = "") -> None:
    """Name axes and series; `log` names the logarithmic axes: "", "x" or "xy"."""
    panel.set_xscale("log" if "x" in log else "linear")
    panel.set_yscale("log" if "y" in log else "linear")
    make_plain(panel)
    name_axes(panel, x, y)
    if title:
        panel.set_title(title, fontsize=SMALL_TEXT_PT, color=INK)
    if log:
        _name_samples(panel)
    panel.legend(frameon=False, fontsize=SMALL_TEXT_PT - 1, labelcolor=INK, handlelength=1.8)


def _name_samples(panel: "Axes") -> None:
    """Name a logarithmic x axis where the samples are: there are few."""
    from matplotlib.ticker import NullFormatter

    all_x = np.concatenate([np.asarray(each.get_xdata(), float) for each in panel.lines])
    places = np.unique(all_x).tolist()
    kept, step = places[:1], (places[-1] / places[0]) ** (1 / _MOST_STEPS)
    for place in places[1:]:
        if place >= 0.99 * step * kept[-1]:
            kept.append(place)
    panel.xaxis.set_minor_formatter(NullFormatter())
    panel.set_xticks(kept, [f"{place:g}" for place in kept])
    panel.minorticks_off()
