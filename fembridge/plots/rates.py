"""Rates against amplitude: a block of panels a family, a row a class, a column a frequency."""

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from decks.stimuli import Diharmonic, Entry, Sine, number_text, resolve, set_name
from fembridge.errors import StimulusError, UsageError
from fembridge.plots.style import (
    INK,
    LINE_PT,
    PAGE_WIDTH_IN,
    PT_PER_IN,
    TEXT_PT,
    WHITE,
    class_style,
    dots,
    fitting,
    in_style,
    legend_above,
    log_axis,
    make_plain,
    note,
)
from fembridge.tables import AFFERENTS, Rate

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_SETS = 60
OBSERVED, TOUCHSIM, OWN = "observed", "TouchSim", "own"

_LEVELS = {
    "sine": "Amplitude (µm)",
    "diharm": "Amplitude of component 1 (µm)",
    "noise": "RMS amplitude (µm)",
}
_MOST_COLUMNS = 5
# Inches. Margins are given, not found: a layout engine takes seconds for all 82.
_PANEL_IN, _GAP_IN, _ROW_GAP_IN, _BLOCK_IN = 0.85, 0.14, 0.14, 0.74
_LEFT_IN, _RIGHT_IN, _LEGEND_IN, _BOTTOM_IN = 1.0, 0.2, 0.3, 0.4
_TITLE_IN, _WIDEST_IN, _LEAST_IN, _LEVEL_DOWN_IN = 0.22, 2.4, 5.6, 0.34
# The name of a class stands that far left of its panels: at the page's edge.
_NAME_PT = 6.0 - PT_PER_IN * _LEFT_IN
_ROOM, _LEVEL_ROOM = 1.08, 1.35
_DOT_PT = 3.2
_TOUCHSIM: dict[str, Any] = {
    "color": "#808080", "linewidth": 1.3 * LINE_PT, "dashes": (4, 1.8), "zorder": 2,
}  # fmt: skip
_OBSERVED = dots(INK, _DOT_PT, markerfacecolor=WHITE, markeredgewidth=0.8, clip_on=False, zorder=5)


def placed(rates: Iterable[Rate]) -> tuple[dict[str, Entry], list[str]]:
    """Stimuli that have a frequency and an amplitude, by their ids; those that have none."""
    found: dict[str, Entry] = {}
    strange = []
    for name in dict.fromkeys(rate.stimulus for rate in rates):
        try:
            [entry] = resolve([name])
        except (StimulusError, ValueError):
            strange.append(name)
            continue
        if entry.family in _LEVELS:
            found[name] = entry
        else:
            strange.append(name)
    return found, strange


@in_style
def rates_figure(
    rates: Sequence[Rate],
    *,
    observed: Sequence[Rate] = (),
    touchsim: Sequence[Rate] = (),
    afferents: Sequence[str] | None = None,
) -> "Figure":
    """Rate against amplitude: a block of panels a family of stimuli, in it a row a class.

    Lines are `rates`, in the colour of their class; dots `observed`, dashes `touchsim`,
    both of the frequencies of `rates` alone. Panels of a class and family share a scale.

    Raises
    ------
    UsageError
        No rate of a stimulus that has a frequency and an amplitude.
    """
    from matplotlib.figure import Figure

    entries, _ = placed(rates)
    sets: dict[str, Entry] = {set_name(entry): entry for entry in entries.values()}
    present = {rate.afferent for rate in rates}
    classes = list(afferents or [name for name in AFFERENTS if name in present])
    if not sets or not present & set(classes):
        raise UsageError("no rate of a sinusoid, diharmonic or noise to draw")
    if len(sets) > MOST_SETS:
        raise UsageError(f"{len(sets)} frequencies, expected at most {MOST_SETS} in one picture")
    points = {
        source: _points(given, sets)
        for source, given in ((OWN, rates), (OBSERVED, observed), (TOUCHSIM, touchsim))
        if given
    }
    families = list(_LEVELS)
    names = sorted(sets, key=lambda name: families.index(sets[name].family))
    blocks: list[list[str]] = []
    for _, members in groupby(names, key=lambda name: sets[name].family):
        mine = list(members)
        blocks += [mine[k : k + _MOST_COLUMNS] for k in range(0, len(mine), _MOST_COLUMNS)]
    columns = max(map(len, blocks))
    wide_in = (PAGE_WIDTH_IN - _LEFT_IN - _RIGHT_IN + _GAP_IN) / columns - _GAP_IN
    wide_in = _LEAST_IN - _LEFT_IN - _RIGHT_IN if columns == 1 else min(wide_in, _WIDEST_IN)
    page_in = _LEFT_IN + columns * (wide_in + _GAP_IN) - _GAP_IN + _RIGHT_IN
    block_in = len(classes) * (_PANEL_IN + _ROW_GAP_IN) - _ROW_GAP_IN
    around_in = _LEGEND_IN + _TITLE_IN + _BOTTOM_IN
    height_in = around_in + len(blocks) * (block_in + _BLOCK_IN) - _BLOCK_IN
    figure = Figure(figsize=(page_in, height_in))
    page = np.array([page_in, height_in, page_in, height_in])
    top_in = height_in - _LEGEND_IN - _TITLE_IN
    for block in blocks:
        family = [name for name in names if sets[name].family == sets[block[0]].family]
        for row, afferent in enumerate(classes):
            low_in = top_in - row * (_PANEL_IN + _ROW_GAP_IN) - _PANEL_IN
            low_um, high_um, most_ips = _scales(points, family, afferent)
            for column, name in enumerate(block):
                left_in = _LEFT_IN + column * (wide_in + _GAP_IN)
                panel = figure.add_axes(tuple([left_in, low_in, wide_in, _PANEL_IN] / page))
                make_plain(panel)
                _draw(panel, points, name, afferent)
                log_axis(panel, low_um, high_um)
                panel.set_ylim(0.0, _ROOM * most_ips)
                panel.tick_params(labelleft=not column, labelbottom=row == len(classes) - 1)
                if not row:
                    title = fitting(_title(sets[name]), wide_in, TEXT_PT)
                    panel.set_title(title, fontsize=TEXT_PT, pad=5)
                if not column:
                    panel.set_ylabel("impulses/s")
                    style, by_pt = class_style(afferent, TEXT_PT + 2), (_NAME_PT, 0.0)
                    note(panel, afferent, (0, 0.5), by_pt, ha="left", va="center", **style)
        middle_in = _LEFT_IN + (len(block) * (wide_in + _GAP_IN) - _GAP_IN) / 2
        level = _LEVELS[sets[block[0]].family]
        low = (top_in - block_in - _LEVEL_DOWN_IN) / height_in
        figure.text(middle_in / page_in, low, level, ha="center", va="bottom", fontsize=TEXT_PT)
        top_in -= block_in + _BLOCK_IN
    colours = [_own(afferent) for afferent in classes]
    samples = {OWN: colours, OBSERVED: _OBSERVED, TOUCHSIM: _TOUCHSIM}
    words = {OWN: "these rates", OBSERVED: "observed"}
    words[TOUCHSIM] = "TouchSim (fitted to recordings of the same experiments)"
    legend_above(
        figure,
        [samples[source] for source in points],
        [words[source] for source in points],
        down_in=0.14,
        handlelength=2.8,
        columnspacing=1.6,
    )
    return figure


def _draw(panel: "Axes", points: "Mapping[str, _Points]", name: str, afferent: str) -> None:
    """Draw what each source has of a set and class."""
    styles = {OWN: _own(afferent), OBSERVED: _OBSERVED, TOUCHSIM: _TOUCHSIM}
    for source, found in points.items():
        if mine := found.get((name, afferent)):
            panel.plot(*np.array(mine).T, **styles[source])


_Points: TypeAlias = Mapping[tuple[str, str], Sequence[tuple[float, float]]]
_Scales: TypeAlias = tuple[float, float, float]


def _points(rates: Sequence[Rate], sets: Mapping[str, Entry]) -> _Points:
    """Level in um and rate of each set and class, the weakest first."""
    entries, _ = placed(rates)
    found: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for rate in rates:
        entry = entries.get(rate.stimulus)
        if entry is not None and set_name(entry) in sets:
            key = (set_name(entry), rate.afferent)
            found.setdefault(key, []).append((entry.level_um, rate.rate_ips))
    return {key: sorted(each) for key, each in found.items()}


def _scales(points: Mapping[str, _Points], family: Sequence[str], afferent: str) -> _Scales:
    """Ends of amplitude, the same for a family, and the highest rate of a class in it."""
    of_family = [
        (who, *point)
        for found in points.values()
        for (name, who), each in found.items()
        if name in family
        for point in each
    ]
    levels_um = [level_um for _, level_um, _ in of_family]
    low_um, high_um = min(levels_um) / _LEVEL_ROOM, max(levels_um) * _LEVEL_ROOM
    if high_um < 10 * low_um:  # both ends have a number
        low_um = 10.0 ** math.floor(math.log10(low_um))
        high_um = 10.0 ** math.ceil(math.log10(high_um))
    return low_um, high_um, max([1.0, *(rate for who, _, rate in of_family if who == afferent)])


def _own(afferent: str) -> dict[str, Any]:
    style = {"marker": "o", "markersize": _DOT_PT - 0.6, "clip_on": False, "zorder": 3}
    return {"color": class_style(afferent)["color"], "linewidth": 1.5 * LINE_PT, **style}


def _title(entry: Entry) -> str:
    """Frequencies or band of a set."""
    numbers = [number_text(number) for number in entry.numbers().values()]
    if isinstance(entry, Sine):
        return f"{numbers[0]} Hz"
    return f"{numbers[0]}{' + ' if isinstance(entry, Diharmonic) else '–'}{numbers[1]} Hz"
