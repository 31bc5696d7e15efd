"""Mean rates of many touches against a setting, a panel a class."""

from typing import TYPE_CHECKING

import numpy as np

from fembridge.plots.style import (
    FAINT,
    LINE_PT,
    SMALL_TEXT_PT,
    TEXT_PT,
    class_style,
    in_style,
    new_figure,
    shorten_text,
)

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from fembridge.plots.style import Panels

MOST_NAMES = 40
"""Names along an axis; more are numbered."""

_HEIGHT_IN = 2.3
_NAME_IN = 1.2
_FEW = 20  # values, up to which their means are joined even if none occurs twice
_MANY = 200  # touches, from which on dots are small


@in_style
def touches_figure(rates: "pd.DataFrame", column: str, axes: "Panels | None" = None) -> "Figure":
    """Mean rate of the units of each class, a dot a touch, and the mean of equal settings.

    `rates` has ``touch, afferent, rate_ips`` and ``at``, the value of the setting `column`:
    numbers, or names, which are drawn in the order of their first touch.
    """
    import pandas as pd

    classes = list(dict.fromkeys(rates["afferent"]))
    figure, panels = new_figure(_HEIGHT_IN, columns=len(classes), sharey=True, axes=axes)
    is_number = pd.api.types.is_numeric_dtype(rates["at"]) and not pd.api.types.is_bool_dtype(
        rates["at"]
    )
    shown = rates.dropna(subset=["at"])
    names = [] if is_number else list(dict.fromkeys(shown["at"].astype(str)))
    position = (
        shown["at"].astype(float)
        if is_number
        else shown["at"].astype(str).map({name: row for row, name in enumerate(names)})
    )
    shown = shown.assign(position=position)
    for panel, afferent in zip(np.ravel(panels), classes, strict=True):
        rows = shown[shown["afferent"] == afferent]
        colour = class_style(afferent)["color"]
        size = 2.0 if len(rows) > _MANY else 3.0
        mean = rows.groupby("position")["rate_ips"].mean()
        if len(mean) < len(rows):
            panel.plot(rows["position"], rows["rate_ips"], "o", markersize=size, color=FAINT)
        style = {"color": colour, "markersize": size, "linewidth": LINE_PT}
        is_curve = is_number and (len(mean) <= _FEW or 2 * len(mean) <= len(rows))
        panel.plot(mean.index, mean, "o-" if is_curve else "o", **style)
        panel.set_title(afferent, **class_style(afferent))
        panel.set_xlabel(column, fontsize=TEXT_PT)
        if names and len(names) <= MOST_NAMES:
            labels = [shorten_text(name, _NAME_IN) for name in names]
            turn = 90 if max(map(len, labels)) > 2 else 0
            panel.set_xticks(range(len(names)), labels, rotation=turn, fontsize=SMALL_TEXT_PT)
        if column == "touch":
            panel.xaxis.get_major_locator().set_params(integer=True)
    for panel in np.ravel(panels):  # at the end: a limit stops the scale that the panels share
        panel.set_ylim(bottom=0)
    np.ravel(panels)[0].set_ylabel("Mean rate (impulses/s)", fontsize=TEXT_PT)
    return figure
