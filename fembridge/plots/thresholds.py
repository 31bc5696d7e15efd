"""Tuning curves: threshold amplitude against frequency, a panel a class."""

from typing import TYPE_CHECKING, Any

from fembridge.evidence import CRITERIA
from fembridge.plots.style import (
    AFFERENT_COLOURS,
    FAINT,
    class_style,
    in_style,
    legend_above,
    log_axis,
    marks,
    new_figure,
    note,
)
from fembridge.tuning import HIGHEST_HZ, LOWEST_HZ

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

_HEIGHT_IN = 2.5
_WORDS = ("first impulse", "one impulse a cycle")
_DASHES: tuple[dict[str, Any], ...] = ({}, {"dashes": (3, 2)})
_MARK_PT = 4.0
# A dullest cell without a threshold is beyond what was tried: the shade goes on to the top.
_BEYOND_UM = 1.0e6


@in_style
def thresholds_figure(found: "pandas.DataFrame", observed: "pandas.DataFrame") -> "Figure":
    """Curves of a model, `fembridge.tuning.thresholds`, and observed ones as marks.

    The shade is from the keenest to the dullest cell, for the first impulse.
    """
    classes = list(dict.fromkeys(found["afferent"]))
    figure, [panels] = new_figure(_HEIGHT_IN, columns=len(classes), sharey=True)
    for panel, name in zip(panels, classes, strict=True):
        colour = AFFERENT_COLOURS[name]
        log_axis(panel, 0.8 * LOWEST_HZ, 1.25 * HIGHEST_HZ)
        panel.set_yscale("log")
        for criterion, dashes in zip(CRITERIA, _DASHES, strict=True):
            mine = found[(found["afferent"] == name) & (found["criterion"] == criterion)]
            panel.plot(mine["frequency_hz"], mine["amplitude_um"], color=colour, **dashes)
            if criterion == CRITERIA[0]:
                most_um = mine["most_um"].fillna(_BEYOND_UM)
                columns = (mine["frequency_hz"], mine["least_um"], most_um)
                panel.fill_between(*columns, color=FAINT, alpha=0.35, linewidth=0)
            seen = observed[(observed["afferent"] == name) & (observed["criterion"] == criterion)]
            mark = marks("o", colour, _MARK_PT, filled=criterion == CRITERIA[0])
            panel.plot(seen["frequency_hz"], seen["amplitude_um"], **mark)
        note(panel, name, (0.04, 0.05), (0, 0), **class_style(name))
        panel.set_xlabel("Frequency (Hz)")
    highest_um = max(*found["amplitude_um"].dropna(), *observed["amplitude_um"], 1.0)
    for panel in panels:
        log_axis(panel, panel.get_ylim()[0], 2.0 * highest_um, vertical=True)
    panels[0].set_ylabel("Threshold amplitude (µm)")
    ink = AFFERENT_COLOURS[classes[0]]
    samples = [{"color": ink, **dashes} for dashes in _DASHES]
    samples += [marks("o", ink, _MARK_PT, filled=filled) for filled in (True, False)]
    names = [*(f"model, {word}" for word in _WORDS), *(f"observed, {word}" for word in _WORDS)]
    legend_above(figure, samples, names)
    return figure
