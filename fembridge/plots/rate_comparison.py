"""Responses to vibration: rates against amplitude, threshold amplitudes against frequency.

Rates have one block of panels per family, one row per class, one column per frequency;
thresholds have one panel per class.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from itertools import chain
from typing import TYPE_CHECKING, Any

from decks.stimuli import Entry, resolve, set_name, set_title
from fembridge.errors import StimulusError, UsageError
from fembridge.evidence import CRITERIA, HIGHEST_HZ, LOWEST_HZ
from fembridge.io.spike_table import Rate
from fembridge.plots.style import (
    AFFERENT_COLOURS,
    FAINT,
    GREY,
    INK,
    LINE_PT,
    PAGE_WIDTH_IN,
    PT_PER_IN,
    TEXT_PT,
    WHITE,
    class_style,
    dots,
    grid_figure,
    in_style,
    legend_above,
    log_axis,
    marks,
    new_figure,
    note,
    shorten_text,
)
from fembridge.trace import AFFERENTS

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure
    from pandas import Series

    from fembridge.plots.style import Panels

MAX_SETS = 60
MAIN, OBSERVED, PUBLISHED, TOUCHSIM = "main", "observed", "published", "TouchSim"
LEVELS = {
    "sine": "Amplitude (µm)",
    "diharm": "Amplitude of component 1 (µm)",
    "noise": "RMS amplitude (µm)",
}
_DOT_PT = 3.2
OBSERVED_DOTS = dots(
    INK, _DOT_PT, markerfacecolor=WHITE, markeredgewidth=0.8, clip_on=False, zorder=5
)
_MAX_COLUMNS = 5
# Inches.
_PANEL_IN, _GAP_IN, _BLOCK_IN = 0.85, 0.14, 0.74
_LEFT_IN, _RIGHT_IN, _TOP_IN, _BOTTOM_IN = 1.0, 0.2, 0.52, 0.4
_WIDEST_IN, _SINGLE_COLUMN_IN = 2.4, 4.4
# Offset of a class name from its panels: at the left edge of the page.
_NAME_PT = 6.0 - PT_PER_IN * _LEFT_IN
_MARGIN, _LEVEL_MARGIN = 1.08, 1.35

# Figure of thresholds.
_THRESHOLDS_IN = 2.5
_CRITERION_LABELS = ("first impulse", "one impulse a cycle")
_DASHES: tuple[dict[str, Any], ...] = ({}, {"dashes": (3, 2)})
_MARK_PT = 4.0
# Upper end of the shade if the least sensitive cell has no threshold: above the axis.
_NO_THRESHOLD_UM = 1.0e6


def placed(rates: Iterable[Rate]) -> tuple[dict[str, Entry], list[str]]:
    """Catalogue entries by id of stimuli with a frequency and an amplitude; ids of the others."""
    entries: dict[str, Entry] = {}
    names = dict.fromkeys(rate.stimulus for rate in rates)
    for name in names:
        with suppress(StimulusError, ValueError):  # not in the catalogue, or a set
            [entry] = resolve([name])
            if entry.family in LEVELS:
                entries[name] = entry
    return entries, [name for name in names if name not in entries]


@in_style
def rates_figure(
    rates: Sequence[Rate],
    *,
    observed: Sequence[Rate] = (),
    published: Sequence[Rate] = (),
    touchsim: Sequence[Rate] = (),
    afferents: Sequence[str] | None = None,
    names: Mapping[str, str] | None = None,
    panel_in: float = _PANEL_IN,
    axes: "Panels | None" = None,
) -> "Figure":
    """Rate against amplitude: one block of panels per family of stimuli, one row per class.

    Lines with dots are `rates` in the colour of their class; rings are `observed`, thin lines
    `published`, dashes `touchsim`, all only at the frequencies of `rates`. Panels of a class and
    family share a scale. `names` are legend entries for `MAIN` and `PUBLISHED`. With `axes`, one
    per panel in reading order, the panels are drawn into them, without a legend. Raises UsageError:
    no stimulus has a frequency and an amplitude, more than `MAX_SETS` frequencies, or another
    number of axes.
    """
    from pandas import DataFrame

    sets = {set_name(entry): entry for entry in placed(rates)[0].values()}
    present = {rate.afferent for rate in rates}
    classes = list(afferents or [name for name in AFFERENTS if name in present])
    if not sets or not present & set(classes):
        raise UsageError("no rate of a sinusoid, diharmonic or noise stimulus to draw")
    if len(sets) > MAX_SETS:
        raise UsageError(f"{len(sets)} frequencies, expected at most {MAX_SETS} in one picture")
    labels = {MAIN: "these rates", OBSERVED: "observed", PUBLISHED: "published model"}
    labels |= {TOUCHSIM: "TouchSim (fitted to recordings of the same experiments)", **(names or {})}
    sources = dict(zip(labels, (rates, observed, published, touchsim), strict=True))
    entries, _ = placed(chain.from_iterable(sources.values()))
    points = DataFrame(
        [
            (source, set_name(entry), entry.family, rate.afferent, entry.level_um, rate.rate_ips)
            for source, source_rates in sources.items()
            for rate in source_rates
            if (entry := entries.get(rate.stimulus)) and set_name(entry) in sets
        ],
        columns=["source", "set", "family", "afferent", "level_um", "rate_ips"],
    ).sort_values(["level_um", "rate_ips"])
    blocks: list[list[str]] = []
    for family in LEVELS:
        members = [name for name, entry in sets.items() if entry.family == family]
        blocks += [members[k : k + _MAX_COLUMNS] for k in range(0, len(members), _MAX_COLUMNS)]
    columns = max(map(len, blocks))
    width_in = (PAGE_WIDTH_IN - _LEFT_IN - _RIGHT_IN + _GAP_IN) / columns - _GAP_IN
    width_in = _SINGLE_COLUMN_IN if columns == 1 else min(width_in, _WIDEST_IN)
    block_in = [panel_in, *[_GAP_IN, panel_in] * (len(classes) - 1)]
    figure, new_panel = grid_figure(
        [_LEFT_IN, width_in, *[_GAP_IN, width_in] * (columns - 1), _RIGHT_IN],
        [_TOP_IN, *block_in, *[_BLOCK_IN, *block_in] * (len(blocks) - 1), _BOTTOM_IN],
        len(classes) * len(sets),
        axes,
    )
    for number, block in enumerate(blocks):
        family = sets[block[0]].family
        family_points = points[points["family"] == family]
        for row, afferent in enumerate(classes):
            class_points = family_points[family_points["afferent"] == afferent]
            top_ips = _MARGIN * max(1.0, class_points["rate_ips"].max())
            for column, name in enumerate(block):
                panel = new_panel(number * len(classes) + row, column)
                for source, curve in class_points[class_points["set"] == name].groupby("source"):
                    style = _style(str(source), afferent)
                    panel.plot(curve["level_um"], curve["rate_ips"], **style)
                log_axis(panel, *_level_limits_um(family_points["level_um"]))
                panel.set_ylim(0.0, top_ips)
                panel.tick_params(labelleft=not column, labelbottom=row == len(classes) - 1)
                if not row:
                    title = shorten_text(set_title(sets[name]), width_in, TEXT_PT)
                    panel.set_title(title, fontsize=TEXT_PT, pad=5)
                if axes is not None:
                    panel.set_xlabel(LEVELS[family] if row == len(classes) - 1 else "")
                    panel.set_ylabel("" if column else f"{afferent} (impulses/s)")
                elif not column:
                    panel.set_ylabel("impulses/s")
                    style, by_pt = class_style(afferent, TEXT_PT + 2), (_NAME_PT, 0.0)
                    note(panel, afferent, (0, 0.5), by_pt, ha="left", va="center", **style)
        if axes is None:
            middle = 0.5 * len(block) + 0.5 * (len(block) - 1) * _GAP_IN / width_in
            label_style = {"ha": "center", "va": "top", "fontsize": TEXT_PT}
            note(figure.axes[-len(block)], LEVELS[family], (middle, 0.0), (0, -14), **label_style)
    if axes is not None:
        return figure
    shown = {
        source: classes if source in (MAIN, PUBLISHED) else classes[:1]
        for source in sources
        if source in set(points["source"])
    }
    legend_above(
        figure,
        [
            [_style(source, name) for name in shown_classes]
            for source, shown_classes in shown.items()
        ],
        [labels[source] for source in shown],
        handlelength=2.8,
        columnspacing=1.6,
    )
    return figure


def _style(source: str, afferent: str) -> dict[str, Any]:
    """Line style of a source: rings, grey dashes, or the class colour."""
    colour = class_style(afferent)["color"]
    rings = {"marker": "o", "markersize": _DOT_PT - 0.6, "clip_on": False, "zorder": 3}
    return {
        MAIN: {"color": colour, "linewidth": 1.5 * LINE_PT, **rings},
        OBSERVED: OBSERVED_DOTS,
        PUBLISHED: {"color": colour, "linewidth": 0.8 * LINE_PT, "zorder": 2.5},
        TOUCHSIM: {"color": GREY, "linewidth": 1.3 * LINE_PT, "dashes": (4, 1.8), "zorder": 2},
    }[source]


def _level_limits_um(level_um: "Series[float]") -> tuple[float, float]:
    """Limits of the amplitude axis, at decades if it spans less than one."""
    low_um, high_um = level_um.min() / _LEVEL_MARGIN, level_um.max() * _LEVEL_MARGIN
    if high_um < 10 * low_um:
        low_um = 10.0 ** math.floor(math.log10(low_um))
        high_um = 10.0 ** math.ceil(math.log10(high_um))
    return low_um, high_um


# The range from the most to the least sensitive cell.
_CELLS_BAND: dict[str, Any] = {"facecolor": FAINT, "alpha": 0.35, "linewidth": 0}


@in_style
def thresholds_figure(
    curves: "pandas.DataFrame",
    observed: "pandas.DataFrame",
    axes: "Panels | None" = None,
) -> "Figure":
    """Threshold curves (the table of `fembridge.threshold`) and observed thresholds as markers.

    The shade is from the most to the least sensitive cell, for the first impulse. With `axes`,
    one per class, the panels are drawn into them, without a legend.
    """
    classes = list(dict.fromkeys(curves["afferent"]))
    figure, [panels] = new_figure(_THRESHOLDS_IN, columns=len(classes), sharey=True, axes=axes)
    for panel, name in zip(panels, classes, strict=True):
        colour = AFFERENT_COLOURS[name]
        log_axis(panel, 0.8 * LOWEST_HZ, 1.25 * HIGHEST_HZ)
        panel.set_yscale("log")
        for criterion, dashes in zip(CRITERIA, _DASHES, strict=True):
            curve, marked = (
                table[(table["afferent"] == name) & (table["criterion"] == criterion)]
                for table in (curves, observed)
            )
            panel.plot("frequency_hz", "amplitude_um", data=curve, color=colour, **dashes)
            if criterion == CRITERIA[0]:
                highest_cell_um = curve["least_sensitive_um"].fillna(_NO_THRESHOLD_UM)
                columns = (curve["frequency_hz"], curve["most_sensitive_um"], highest_cell_um)
                panel.fill_between(*columns, **_CELLS_BAND)
            mark = marks("o", colour, _MARK_PT, filled=criterion == CRITERIA[0])
            panel.plot("frequency_hz", "amplitude_um", data=marked, **mark)
        note(panel, name, (0.04, 0.05), (0, 0), **class_style(name))
        panel.set_xlabel("Frequency (Hz)")
    top_um = max([*curves["amplitude_um"].dropna(), *observed["amplitude_um"], 1.0])
    bottom_um = min(panel.get_ylim()[0] for panel in panels)
    for panel in panels:
        log_axis(panel, bottom_um, 2.0 * top_um, vertical=True)
    panels[0].set_ylabel("Threshold amplitude (µm)")
    if axes is not None:
        return figure
    colour = AFFERENT_COLOURS[classes[0]]
    samples = [{"color": colour, **dashes} for dashes in _DASHES]
    samples += [marks("o", colour, _MARK_PT, filled=filled) for filled in (True, False)]
    names = [
        f"{source}, {label}" for source in ("model", "observed") for label in _CRITERION_LABELS
    ]
    samples.append(_CELLS_BAND)
    names.append("model, range of cells")
    legend_above(figure, samples, names, ncols=3)
    return figure
