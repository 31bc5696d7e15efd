"""What each parameter does to rates and stress: a panel a class, a row a parameter.

One at a time: a line from the answer where the parameter is low (hollow) to that
where it is high (filled), about the base. All at once: coefficients of the rank
regression with their intervals.
"""

import math
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from fembridge.errors import UsageError
from fembridge.plots.style import (
    AFFERENT_COLOURS,
    FAINT,
    HAIR_PT,
    INK,
    LINE_PT,
    TEXT_PT,
    class_style,
    fitting,
    in_style,
    legend_above,
    marks,
    new_figure,
    note,
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

MOST_PARAMETERS = 60

_ROW_IN, _BETWEEN_IN, _MARGIN_IN = 0.16, 0.62, 0.45
# A longer name of a parameter is cut, or it would leave no room for its row.
_NAME_IN = 1.8
_MARK_PT = {"o": 4.2, "D": 3.4}
# Rates stand a little above the middle of their row, stress a little below.
_ASIDE = 0.17
_ROOM = 0.07
_OTHER_COLOUR = "#555555"


@in_style
def effects_figure(effects: pd.DataFrame) -> Figure:
    """One-at-a-time effects: rates above, stress below; at most `MOST_PARAMETERS`."""
    mean, order = _of_all(effects)
    afferents, has_base = effects["afferent"].unique(), bool(effects["base"].notna().all())
    figure, panels = _panels(len(QUANTITIES), len(afferents), order)
    for quantity, row in zip(QUANTITIES, panels, strict=True):
        for afferent, panel in zip(afferents, row, strict=True):
            style = _class_style(afferent)
            mine = mean.loc[afferent, quantity].loc[order]
            for place, effect in enumerate(mine.itertuples()):
                low, high = (shown(quantity, end) for end in (effect.at_low, effect.at_high))
                panel.plot([low, high], [place] * 2, color=style["color"], linewidth=2 * LINE_PT)
                panel.plot([low], [place], **_mark(style["color"]))
                panel.plot([high], [place], **_mark(style["color"], filled=True))
            if has_base:
                panel.axvline(shown(quantity, mine["at_base"].iloc[0]), linewidth=HAIR_PT, zorder=1)
            panel.margins(x=_ROOM)
            panel.set_xlabel(f"Mean {quantity_words(quantity)}", fontsize=TEXT_PT)
            if quantity == QUANTITIES[0]:
                panel.set_title(afferent, **style)
    samples = [_mark(INK), _mark(INK, filled=True)]
    names = ["parameter low", "parameter high"]
    if has_base:
        samples.append({"linewidth": HAIR_PT})
        names.append("base: the finger that the others are varied from")
    legend_above(figure, samples, names)
    return figure


@in_style
def regressions_figure(regressions: pd.DataFrame, fingers: int) -> Figure:
    """Rank regressions of rate and stress on each parameter; at most `MOST_PARAMETERS`."""
    mean, order = _of_all(regressions)
    afferents = regressions["afferent"].unique()
    figure, [panels] = _panels(1, len(afferents), order)
    for afferent, panel in zip(afferents, panels, strict=True):
        style, notes = _class_style(afferent), []
        rate_mark, stress_mark = _mark(style["color"], filled=True), _mark(INK, marker="D")
        for quantity, aside in zip(QUANTITIES, (-_ASIDE, _ASIDE), strict=True):
            word, mark = ("rate", rate_mark) if quantity == RATE else ("stress", stress_mark)
            fits = mean.loc[afferent, quantity].loc[order]
            r_squared = fits["r_squared"].iloc[0]
            if math.isnan(r_squared):
                notes.append(f"{word}: no variation")
                continue
            notes.append(f"{word}: R² {r_squared:.2f}")
            for place, fit in enumerate(fits.itertuples()):
                span, height = [fit.low_95, fit.high_95], place + aside
                panel.plot(span, [height] * 2, color=mark["color"])
                panel.plot([fit.coefficient], [height], **mark)
        panel.axvline(0.0, linewidth=HAIR_PT, zorder=1)
        panel.set_xlim(-1.05, 1.05)
        panel.set_xticks([-1.0, -0.5, 0.0, 0.5, 1.0], ["−1", "−0.5", "0", "0.5", "1"])
        panel.set_xlabel("Rank regression coefficient", fontsize=TEXT_PT)
        panel.set_title(afferent, pad=16, **style)
        note(panel, ",  ".join(notes), (0.5, 1.0), (0, 4), ha="center", va="bottom")
    rate = {**_mark(_OTHER_COLOUR, filled=True), "linestyle": "-"}
    stress = {**_mark(INK, marker="D"), "linestyle": "-"}
    names = [
        "mean rate (in the colour of its class)",
        f"mean peak stress; lines: 95 %; {fingers} fingers",
    ]
    legend_above(figure, [rate, stress], names)
    return figure


def _of_all(answers: pd.DataFrame) -> tuple[pd.DataFrame, list[str]]:
    """Rows of the mean over all stimuli by class, quantity and parameter; parameters in order."""
    mean = answers[answers["stimuli"] == ALL]
    return mean.set_index(["afferent", "quantity", "parameter"]).sort_index(), in_order(answers)


def _panels(rows: int, afferents: int, parameters: list[str]) -> tuple[Figure, Any]:
    """Figure of `rows` rows of panels; in each a row a parameter, on a faint line."""
    if len(parameters) > MOST_PARAMETERS:
        raise UsageError(
            f"{len(parameters)} parameters, expected at most {MOST_PARAMETERS} in a picture"
        )
    height_in = _MARGIN_IN + rows * (_BETWEEN_IN + _ROW_IN * max(len(parameters), 3))
    figure, panels = new_figure(height_in, rows, afferents, sharey="row")
    for panel in panels.flat:
        panel.grid(axis="y", color=FAINT, linewidth=HAIR_PT, dashes=(1, 3))
        panel.set_axisbelow(True)
        names = [fitting(parameter_words(name), _NAME_IN) for name in parameters]
        panel.set_yticks(range(len(parameters)), names, parse_math=False)
        panel.set_ylim(len(parameters) - 0.5, -0.5)
        panel.tick_params(axis="y", length=0)
        panel.spines["left"].set_visible(False)
    return figure, panels


def _class_style(afferent: str) -> dict[str, Any]:
    colour = AFFERENT_COLOURS.get(afferent, _OTHER_COLOUR)
    return {**class_style(afferent), "color": colour}


def _mark(colour: str, marker: str = "o", *, filled: bool = False) -> dict[str, Any]:
    return {**marks(marker, colour, _MARK_PT[marker], filled=filled), "color": colour}
