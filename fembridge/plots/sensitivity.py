"""What each parameter does to rates and stress: a panel a class, a row a parameter.

One at a time: a line from the answer where the parameter is low (hollow) to that
where it is high (filled), about the base. All at once: coefficients of the rank
regression with their intervals.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from fembridge.errors import UsageError
from fembridge.plots.style import (
    AFFERENT_COLOURS,
    HAIR_PT,
    INK,
    LINE_PT,
    PAGE_WIDTH_IN,
    SHADE,
    SMALL_TEXT_PT,
    TEXT_PT,
    make_plain,
)
from fembridge.sensitivity import (
    ALL,
    QUANTITIES,
    RATE,
    in_order,
    parameter_words,
    quantity_words,
    shown,
)

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

MOST_PARAMETERS = 60

_ROW_IN, _BETWEEN_IN, _MARGIN_IN = 0.16, 0.62, 0.45
_DOT_PT, _MARK_PT = 4.2, 3.4
# Rates stand a little above the middle of their row, stress a little below.
_ASIDE = 0.17
_ROOM = 0.07
_OTHER_COLOUR = "#555555"


def effects_figure(effects: "pd.DataFrame") -> "Figure":
    """One-at-a-time effects: rates above, stress below; at most `MOST_PARAMETERS`."""
    order = in_order(effects)
    mean = effects[effects["stimuli"] == ALL]
    mean = mean.set_index(["quantity", "afferent", "parameter"]).sort_index()
    afferents = effects["afferent"].unique()
    figure, panels = _panels(len(afferents), len(QUANTITIES), len(order))
    for quantity, row in zip(QUANTITIES, panels, strict=True):
        for afferent, panel in zip(afferents, row, strict=True):
            colour = AFFERENT_COLOURS.get(afferent, _OTHER_COLOUR)
            mine = mean.loc[quantity, afferent].loc[order]
            for place, effect in enumerate(mine.itertuples()):
                ends = [shown(quantity, e) for e in (effect.at_low, effect.at_high)]
                panel.plot(ends, [place] * 2, color=colour, linewidth=2 * LINE_PT)
                for end, face in zip(ends, ("white", colour), strict=True):
                    panel.plot(
                        [end],
                        [place],
                        "o",
                        color=colour,
                        markersize=_DOT_PT,
                        markerfacecolor=face,
                        markeredgewidth=LINE_PT,
                        zorder=3 if face == "white" else 4,
                    )
            base = mine["at_base"].iloc[0]
            panel.axvline(shown(quantity, base), color=INK, linewidth=HAIR_PT, zorder=1)
            _finish(panel, [parameter_words(name) for name in order])
            panel.margins(x=_ROOM)
            panel.set_xlabel(f"Mean {quantity_words(quantity)}", fontsize=TEXT_PT)
            if quantity == QUANTITIES[0]:
                _head(panel, afferent)
    _legend_of_ends(figure)
    return figure


def regressions_figure(regressions: "pd.DataFrame", fingers: int) -> "Figure":
    """Rank regressions of rate and stress on each parameter; at most `MOST_PARAMETERS`."""
    order = in_order(regressions)
    mean = regressions[regressions["stimuli"] == ALL]
    mean = mean.set_index(["afferent", "quantity", "parameter"]).sort_index()
    afferents = regressions["afferent"].unique()
    figure, [panels] = _panels(len(afferents), 1, len(order))
    for afferent, panel in zip(afferents, panels, strict=True):
        colour = AFFERENT_COLOURS.get(afferent, _OTHER_COLOUR)
        notes = []
        for quantity, aside in zip(QUANTITIES, (-_ASIDE, _ASIDE), strict=True):
            fits = mean.loc[afferent, quantity].loc[order]
            r_squared = fits["r_squared"].iloc[0]
            is_rate = quantity == RATE
            word = "rate" if is_rate else "stress"
            if math.isnan(r_squared):
                notes.append(f"{word}: no variation")
                continue
            notes.append(f"{word}: R² {r_squared:.2f}")
            for place, fit in enumerate(fits.itertuples()):
                height = place + aside
                shade = colour if is_rate else INK
                panel.plot([fit.low_95, fit.high_95], [height] * 2, color=shade, linewidth=LINE_PT)
                panel.plot(
                    [fit.coefficient],
                    [height],
                    "o" if is_rate else "D",
                    color=shade,
                    markersize=_DOT_PT if is_rate else _MARK_PT,
                    markerfacecolor=shade if is_rate else "white",
                    markeredgewidth=LINE_PT,
                )
        panel.axvline(0.0, color=INK, linewidth=HAIR_PT, zorder=1)
        _finish(panel, [parameter_words(name) for name in order])
        panel.set_xlim(-1.05, 1.05)
        panel.set_xticks([-1.0, -0.5, 0.0, 0.5, 1.0], ["−1", "−0.5", "0", "0.5", "1"])
        panel.set_xlabel("Rank regression coefficient", fontsize=TEXT_PT)
        _head(panel, afferent, ",  ".join(notes))
    _legend_of_quantities(figure, fingers)
    return figure


def _panels(afferents: int, rows: int, parameters: int) -> "tuple[Figure, list[list[Axes]]]":
    """Make a figure of `rows` rows of panels with a class each."""
    from matplotlib.figure import Figure

    if parameters > MOST_PARAMETERS:
        raise UsageError(
            f"{parameters} parameters, expected at most {MOST_PARAMETERS} in a picture"
        )
    height_in = _MARGIN_IN + rows * (_BETWEEN_IN + _ROW_IN * max(parameters, 3))
    figure = Figure(figsize=(PAGE_WIDTH_IN, height_in), layout="constrained")
    panels = figure.subplots(rows, afferents, squeeze=False, sharey="row")
    return figure, [list(row) for row in panels]


def _finish(panel: "Axes", labels: Sequence[str]) -> None:
    """Name the rows of a panel, the first on top, every other one shaded."""
    make_plain(panel)
    for place in range(0, len(labels), 2):
        panel.axhspan(place - 0.5, place + 0.5, color=SHADE, linewidth=0, zorder=0)
    panel.set_yticks(range(len(labels)), labels, fontsize=SMALL_TEXT_PT)
    panel.set_ylim(len(labels) - 0.5, -0.5)
    panel.tick_params(axis="y", length=0)
    panel.spines["left"].set_visible(False)


def _head(panel: "Axes", afferent: str, note: str = "") -> None:
    panel.set_title(
        afferent,
        color=AFFERENT_COLOURS.get(afferent, _OTHER_COLOUR),
        fontsize=TEXT_PT,
        fontweight="bold",
        pad=16 if note else 6,
    )
    if note:
        panel.annotate(
            note,
            (0.5, 1.0),
            xycoords="axes fraction",
            xytext=(0, 4),
            textcoords="offset points",
            ha="center",
            va="bottom",
            fontsize=SMALL_TEXT_PT,
            color=INK,
        )


def _legend_of_ends(figure: "Figure") -> None:
    from matplotlib.lines import Line2D

    def mark(face: str, label: str) -> Line2D:
        return Line2D(
            [],
            [],
            marker="o",
            linestyle="none",
            color=INK,
            markerfacecolor=face,
            markersize=_DOT_PT,
            label=label,
        )

    base = Line2D([], [], color=INK, linewidth=HAIR_PT, label="base")
    _legend(figure, [mark("white", "parameter low"), mark(INK, "parameter high"), base])


def _legend_of_quantities(figure: "Figure", fingers: int) -> None:
    from matplotlib.lines import Line2D

    rate = Line2D(
        [],
        [],
        marker="o",
        color=_OTHER_COLOUR,
        linewidth=LINE_PT,
        markersize=_DOT_PT,
        label="mean rate (in the colour of its class)",
    )
    stress = Line2D(
        [],
        [],
        marker="D",
        color=INK,
        linewidth=LINE_PT,
        markerfacecolor="white",
        markersize=_MARK_PT,
        label=f"mean peak stress; lines: 95 %; {fingers} fingers",
    )
    _legend(figure, [rate, stress])


def _legend(figure: "Figure", handles: "list[Line2D]") -> None:
    figure.legend(
        handles=handles,
        loc="outside upper center",
        ncols=len(handles),
        frameon=False,
        fontsize=SMALL_TEXT_PT,
        labelcolor=INK,
    )
