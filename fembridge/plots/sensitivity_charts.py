"""Effect of each parameter on rates and stress: one panel per class, one row per parameter.

One-at-a-time designs: a line from the response at the low end of a parameter (hollow) to that
at the high end (filled). Other designs: coefficients of the rank regression with their
confidence intervals.
"""

import math
from typing import TYPE_CHECKING, Any

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
    in_style,
    legend_above,
    marks,
    new_figure,
    note,
    shorten_text,
)
from fembridge.sensitivity.effects import ALL, QUANTITIES, RATE, ordered_parameters
from fembridge.sensitivity.wording import parameter_words, quantity_label, to_display_unit

if TYPE_CHECKING:
    from fembridge.plots.style import Panels

MAX_PARAMETERS = 60

_ROW_IN, _PANEL_GAP_IN, _MARGIN_IN = 0.16, 0.62, 0.45
# Inches: a longer parameter name is cut.
_NAME_IN = 1.8
_MARK_PT = {"o": 4.2, "D": 3.4}
# Rates are drawn above the middle of their row, stress below.
_ROW_OFFSET = 0.17
_X_MARGIN = 0.07
_OTHER_COLOUR = "#555555"


@in_style
def effects_figure(effects: pd.DataFrame, axes: "Panels | None" = None) -> Figure:
    """One-at-a-time effects: rates above, stress below.

    With `axes`, one per class for rates and one per class for stress, the panels are drawn into
    them, without a legend.

    Raises UsageError: more than `MAX_PARAMETERS` parameters.
    """
    mean, order = _mean_effects(effects)
    afferents, has_base = effects["afferent"].unique(), bool(effects["base"].notna().all())
    figure, panels = _parameter_panels(len(QUANTITIES), len(afferents), order, axes)
    for quantity, row in zip(QUANTITIES, panels, strict=True):
        for afferent, panel in zip(afferents, row, strict=True):
            style = _class_style(afferent)
            selected = mean.loc[afferent, quantity].loc[order]
            for position, effect in enumerate(selected.itertuples()):
                low, high = (
                    to_display_unit(quantity, end) for end in (effect.at_low, effect.at_high)
                )
                panel.plot([low, high], [position] * 2, color=style["color"], linewidth=2 * LINE_PT)
                panel.plot([low], [position], **_marker_style(style["color"]))
                panel.plot([high], [position], **_marker_style(style["color"], filled=True))
            if has_base:
                panel.axvline(
                    to_display_unit(quantity, selected["at_base"].iloc[0]),
                    linewidth=HAIR_PT,
                    zorder=1,
                )
            panel.margins(x=_X_MARGIN)
            panel.set_xlabel(f"Mean {quantity_label(quantity)}", fontsize=TEXT_PT)
            if quantity == QUANTITIES[0]:
                panel.set_title(afferent, **style)
    if axes is not None:
        return figure
    samples = [_marker_style(INK), _marker_style(INK, filled=True)]
    names = ["parameter low", "parameter high"]
    if has_base:
        samples.append({"linewidth": HAIR_PT})
        names.append("base finger")
    legend_above(figure, samples, names)
    return figure


@in_style
def regressions_figure(
    regressions: pd.DataFrame, fingers: int, axes: "Panels | None" = None
) -> Figure:
    """Rank regressions of rate and stress on each parameter, over `fingers` fingers.

    With `axes`, one per class, the panels are drawn into them, without a legend.

    Raises UsageError: more than `MAX_PARAMETERS` parameters.
    """
    mean, order = _mean_effects(regressions)
    afferents = regressions["afferent"].unique()
    figure, [panels] = _parameter_panels(1, len(afferents), order, axes)
    for afferent, panel in zip(afferents, panels, strict=True):
        name_style, notes = _class_style(afferent), []
        rate_mark, stress_mark = (
            _marker_style(name_style["color"], filled=True),
            _marker_style(INK, marker="D"),
        )
        for quantity, offset in zip(QUANTITIES, (-_ROW_OFFSET, _ROW_OFFSET), strict=True):
            label, style = ("rate", rate_mark) if quantity == RATE else ("stress", stress_mark)
            fits = mean.loc[afferent, quantity].loc[order]
            r_squared = fits["r_squared"].iloc[0]
            if math.isnan(r_squared):
                notes.append(f"{label}: no variation")
                continue
            notes.append(f"{label}: R² {r_squared:.2f}")
            for position, fit in enumerate(fits.itertuples()):
                span, height = [fit.low_95, fit.high_95], position + offset
                panel.plot(span, [height] * 2, color=style["color"])
                panel.plot([fit.coefficient], [height], **style)
        panel.axvline(0.0, linewidth=HAIR_PT, zorder=1)
        panel.set_xlim(-1.05, 1.05)
        panel.set_xticks([-1.0, -0.5, 0.0, 0.5, 1.0], ["−1", "−0.5", "0", "0.5", "1"])
        panel.set_xlabel("Rank regression coefficient", fontsize=TEXT_PT)
        panel.set_title(afferent, pad=16, **name_style)
        note(panel, ",  ".join(notes), (0.5, 1.0), (0, 4), ha="center", va="bottom")
    if axes is not None:
        return figure
    rate = {**_marker_style(_OTHER_COLOUR, filled=True), "linestyle": "-"}
    stress = {**_marker_style(INK, marker="D"), "linestyle": "-"}
    names = [
        "mean rate (in the class colour)",
        f"mean peak stress; lines: 95 % intervals; {fingers} fingers",
    ]
    legend_above(figure, [rate, stress], names)
    return figure


def _mean_effects(answers: pd.DataFrame) -> tuple[pd.DataFrame, list[str]]:
    """Effects on the mean over all stimuli; names of the parameters, strongest first."""
    mean = answers[answers["stimuli"] == ALL]
    return mean.set_index(["afferent", "quantity", "parameter"]).sort_index(), ordered_parameters(
        answers
    )


def _parameter_panels(
    rows: int, afferents: int, parameters: list[str], axes: "Panels | None"
) -> tuple[Figure, Any]:
    """Figure with `rows` rows of panels, each with one faint line per parameter."""
    if len(parameters) > MAX_PARAMETERS:
        raise UsageError(
            f"{len(parameters)} parameters, expected at most {MAX_PARAMETERS} in a picture"
        )
    height_in = _MARGIN_IN + rows * (_PANEL_GAP_IN + _ROW_IN * max(len(parameters), 3))
    figure, panels = new_figure(height_in, rows, afferents, sharey="row", axes=axes)
    for panel in panels.flat:
        panel.grid(axis="y", color=FAINT, linewidth=HAIR_PT, dashes=(1, 3))
        panel.set_axisbelow(True)
        names = [shorten_text(parameter_words(name), _NAME_IN) for name in parameters]
        panel.set_yticks(range(len(parameters)), names, parse_math=False)
        panel.set_ylim(len(parameters) - 0.5, -0.5)
        panel.tick_params(axis="y", length=0)
        panel.spines["left"].set_visible(False)
    return figure, panels


def _class_style(afferent: str) -> dict[str, Any]:
    colour = AFFERENT_COLOURS.get(afferent, _OTHER_COLOUR)
    return {**class_style(afferent), "color": colour}


def _marker_style(colour: str, marker: str = "o", *, filled: bool = False) -> dict[str, Any]:
    return {**marks(marker, colour, _MARK_PT[marker], filled=filled), "color": colour}
