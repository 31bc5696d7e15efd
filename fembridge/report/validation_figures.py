"""The figures that only a validation has: regressions, a raster, recorded afferents.

A source looks the same in all: observed rates are black, TouchSim is grey, a model has the
colour of the class, the judged one filled.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from decks.stimuli import number_text, resolve
from fembridge.plots.style import (
    AFFERENT_COLOURS,
    FAINT,
    GREY,
    HAIR_PT,
    INK,
    LINE_PT,
    MARKERS,
    PAGE_WIDTH_IN,
    TEXT_PT,
    class_style,
    dots,
    in_style,
    legend_above,
    log_axis,
    marks,
    new_figure,
    note,
)
from fembridge.report.evidence import Evidence
from fembridge.report.rates import (
    EVERY_SET,
    FINGERTIP,
    OBSERVED,
    TOUCHSIM,
    Family,
    RateTable,
    row_of,
)
from fembridge.report.validate import PUBLISHED_NAME
from fembridge.stimulus import Stimulus
from fembridge.tables import AFFERENTS, SpikeTrain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame

_ROOM = 1.06
_LEGEND: dict[str, Any] = {"down_in": 0.12, "columnspacing": 1.3, "handletextpad": 0.5}
# Regression.
_MARK_PT = 3.8
_REGRESSION: dict[str, Any] = {"linewidth": 1.5 * LINE_PT, "dashes": (3.5, 1.6), "zorder": 2}
_EQUAL: dict[str, Any] = {"color": FAINT, "linewidth": 1.6 * HAIR_PT}
# Raster: a train in its row, and a row for each cell where there are many.
_TRAIN_HEIGHT, _FEW_ROWS_IN, _ROW_IN = 0.74, 0.62, 0.07
# Beside recorded afferents; the tuning curves are `fembridge.plots.thresholds`.
_EVIDENCE_IN, _EVIDENCE_MARGINS_IN = 2.1, (0.6, 0.12, 0.42, 0.4, 0.22, 0.0)


def source_title(source: str, judged: str) -> str:
    """Words for a source in figures and tables."""
    titles = {judged: "This model", OBSERVED: "Observed", PUBLISHED_NAME: "Published model"}
    titles[FINGERTIP] = "Whole fingertip"
    return titles.get(source, source)


def _colour(source: str, afferent: str) -> str:
    return {OBSERVED: INK, TOUCHSIM: GREY}.get(source) or class_style(afferent)["color"]


def _name_figure(figure: "Figure", panels: Any, x: str, y: str = "") -> None:  # noqa: ANN401 - array
    """Name the axes once for all panels, close to the figure's edges."""
    middle = (panels[0, 0].get_position().x0 + panels[0, -1].get_position().x1) / 2
    low = 0.05 / figure.get_figheight()
    figure.supxlabel(x, x=middle, y=low, va="bottom", fontsize=TEXT_PT)
    figure.supylabel(y, x=0.03 / PAGE_WIDTH_IN, fontsize=TEXT_PT)


@in_style
def regression_figure(
    rates: RateTable, agreement: "DataFrame", family: Family, reference: str, judged: str
) -> "Figure":
    """Predicted against reference rates: a column a class, a row a predicting source.

    Points, the line through them, and the line of equal rates.
    """
    from matplotlib.ticker import MaxNLocator

    sources = rates.compared(reference)
    height_in = 0.78 + 0.44 + len(sources) * 1.5 + (len(sources) - 1) * 0.36
    margins_in = (0.95, 0.12, 0.78, 0.44, 0.42, 0.36)
    figure, panels = new_figure(
        height_in, len(sources), len(AFFERENTS), margins_in=margins_in, sharex="col", sharey="col"
    )
    for column, afferent in zip(panels.T, AFFERENTS, strict=True):
        for panel, source in zip(column, sources, strict=True):
            cell = row_of(agreement, reference, source, family.name, EVERY_SET, afferent)
            _draw_points(panel, rates, family, cell)
            panel.axline((0, 0), slope=1.0, zorder=1, **_EQUAL)
        top_ips = _ROOM * max(1.0, rates.largest_ips(afferent, family.stimuli))
        column[0].set(xlim=(0.0, top_ips), ylim=(0.0, top_ips))
        for axis in (column[0].xaxis, column[0].yaxis):
            axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
        style = class_style(afferent, TEXT_PT + 1)
        note(column[0], afferent, (0.5, 1.0), (0, 20), ha="center", **style)
    for panel, source in zip(panels[:, 0], sources, strict=True):
        panel.set_ylabel(source_title(source, judged), fontsize=TEXT_PT)
    across = "Observed rate" if reference == OBSERVED else "TouchSim’s rate"
    _name_figure(figure, panels, f"{across} (impulses/s)", "Predicted rate (impulses/s)")
    samples = [marks(marker, INK, _MARK_PT) for marker in MARKERS[: len(family.sets)]]
    names = [*(one.title for one in family.sets), "regression", "equal rates"]
    legend_above(figure, [*samples, _REGRESSION, _EQUAL], names, handlelength=1.8, **_LEGEND)
    return figure


def _draw_points(panel: "Axes", rates: RateTable, family: Family, cell: Any) -> None:  # noqa: ANN401 - row
    words = "no rates to compare"
    if cell["count"]:
        colour = _colour(cell.source, cell.afferent)
        pair = (cell.reference, cell.source)
        for marker, one in zip(MARKERS, family.sets, strict=False):
            points_ips = (rates.of(source, cell.afferent, one.stimuli) for source in pair)
            panel.plot(*points_ips, **marks(marker, colour, _MARK_PT))
        if math.isfinite(cell.slope):
            all_ips = rates.of(cell.reference, cell.afferent, family.stimuli)
            ends_ips = np.array([np.nanmin(all_ips), np.nanmax(all_ips)])
            line_ips = cell.slope * ends_ips + cell.intercept_ips
            panel.plot(ends_ips, line_ips, color=colour, **_REGRESSION)
        share = "–" if math.isnan(cell.r_squared) else f"{cell.r_squared:.2f}"
        words = f"R² {share}, RMSE {cell.rmse_ips:.1f} ips"
    panel.set_title(words, loc="left", pad=5)


@in_style
def raster_figure(
    trains: Sequence[SpikeTrain],
    stimuli: Sequence[Stimulus],
    recorded: Sequence[SpikeTrain] = (),
) -> "Figure":
    """Spikes as in Fig. 3 (a): a column a stimulus under its waveform, a row a class.

    Repeats, or cells, lie under one another; `recorded` trains of the same stimuli are black,
    above the model's.
    """
    lanes = max(train.repeat for train in trains)
    class_in = max(_FEW_ROWS_IN, _ROW_IN * lanes)
    figure, panels = new_figure(
        1.75 + 3 * class_in,
        1 + len(AFFERENTS),
        len(stimuli),
        margins_in=(0.78, 0.14, 0.3, 0.44, 0.178, 0.099),
        heights=(0.72, class_in, class_in, class_in),
        sharex=True,
        sharey="row",
    )
    depth_um = np.array([stimulus.displacement_um for stimulus in stimuli])
    room_um = 0.08 * (depth_um.max() - depth_um.min())
    for (top, *rows), stimulus in zip(panels.T, stimuli, strict=True):
        top.axhline(0.0, color=FAINT, linewidth=HAIR_PT, zorder=1)
        top.plot(stimulus.times_ms, stimulus.displacement_um)
        top.set_xlim(stimulus.times_ms[0], stimulus.times_ms[-1])
        top.set_ylim(depth_um.min() - room_um, depth_um.max() + room_um)
        [entry] = resolve(stimulus.id)
        if entry.family == "sine":
            frequency, amplitude = map(number_text, entry.numbers().values())
            top.set_title(f"{frequency} Hz, {amplitude} µm", fontsize=TEXT_PT, pad=4)
        for panel, afferent in zip(rows, AFFERENTS, strict=True):
            mine, theirs = (
                [t for t in source if (t.stimulus, t.afferent) == (stimulus.id, afferent)]
                for source in (trains, recorded)
            )
            drawn = [(train.repeat, class_style(afferent)["color"], train) for train in mine]
            drawn += [(-row, INK, train) for row, train in enumerate(theirs)]
            for row, colour, train in drawn:
                ends = row - _TRAIN_HEIGHT / 2, row + _TRAIN_HEIGHT / 2
                style = {"linewidths": 1.2 * LINE_PT, "clip_on": False}
                panel.vlines(train.times_ms, *ends, colors=colour, **style)
            if not any(train.times_ms.size for train in (*mine, *theirs)):
                note(panel, "no spikes", (0.5, 0.5), (0, 0), ha="center", va="center")
            panel.set_yticks(sorted({1, lanes}))
            panel.tick_params(axis="y", length=0.0)
            panel.set_ylim(lanes + 0.6, 0.4 - len(theirs))
        for panel in (top, *rows[:-1]):
            panel.spines["bottom"].set_visible(False)
            panel.tick_params(axis="x", bottom=False, labelbottom=False)
        rows[-1].set_xlabel("Time (ms)", fontsize=TEXT_PT)
    panels[0, 0].set_ylabel("Depth (µm)")
    place: dict[str, Any] = {"rotation": 0, "ha": "right", "va": "center", "labelpad": 16}
    for panel, afferent in zip(panels[1:, 0], AFFERENTS, strict=True):
        panel.set_ylabel(afferent, **place, **class_style(afferent, TEXT_PT + 2))
    return figure


@in_style
def phase_figure(found: Evidence) -> "Figure":
    """Shares of the spikes by phase of the cycle: recorded as steps, the model's filled."""
    keys = ["afferent", "frequency_hz", "amplitude_um"]
    cells: list[tuple[Any, Any]] = [*found.phases.groupby(keys, sort=False)]
    figure, [panels] = new_figure(
        _EVIDENCE_IN, columns=len(cells), margins_in=_EVIDENCE_MARGINS_IN, sharey=True
    )
    for panel, ((name, frequency_hz, amplitude_um), rows) in zip(panels, cells, strict=True):
        edges_ms = [*rows["phase_ms"], 1000.0 / frequency_hz]
        panel.stairs(rows["model"], edges_ms, fill=True, color=AFFERENT_COLOURS[name], alpha=0.75)
        panel.stairs(rows["recorded"], edges_ms, color=INK)
        panel.set_xlim(edges_ms[0], edges_ms[-1])
        panel.set_xlabel("Phase (ms)")
        words = f"{name}\n{frequency_hz:g} Hz\n{amplitude_um:g} µm"
        note(panel, words, (0.98, 0.97), (0, 0), ha="right", va="top")
    panels[0].set_ylabel("Share of the spikes")
    samples = [
        {"color": INK},
        [{"color": AFFERENT_COLOURS[one], "linewidth": 4} for one in AFFERENTS],
    ]
    legend_above(figure, samples, ["recorded", "this model"], down_in=0.15)
    return figure


@in_style
def man_figure(found: Evidence) -> "Figure":
    """Impulses a cycle against amplitude: medians of human units as dots, the model as lines."""
    figure, [panels] = new_figure(
        _EVIDENCE_IN, columns=len(AFFERENTS), margins_in=_EVIDENCE_MARGINS_IN, sharey=True
    )
    fills = {8.0: 1.0, 32.0: 0.6, 128.0: 0.3}
    for panel, name in zip(panels, AFFERENTS, strict=True):
        colour = AFFERENT_COLOURS[name]
        for frequency_hz, rows in found.man[found.man["afferent"] == name].groupby("frequency_hz"):
            style = {"alpha": fills.get(float(str(frequency_hz)), 1.0)}
            panel.plot(rows["amplitude_um"], rows["model"], color=colour, **style)
            panel.plot(
                rows["amplitude_um"], rows["impulses_per_cycle"], **dots(colour, 3.5, **style)
            )
        log_axis(panel, 6.0, 400.0)
        panel.set_xlabel("Amplitude (µm)")
        note(panel, name, (0.04, 0.9), (0, 0), **class_style(name))
    panels[0].set_ylabel("Impulses a cycle")
    samples = [{"color": INK, "alpha": alpha} for alpha in fills.values()]
    samples.append(dots(INK, 3.5))
    names = [*(f"model, {hz:g} Hz" for hz in fills), "medians in man"]
    legend_above(figure, samples, names, down_in=0.15)
    return figure


@in_style
def distance_figure(found: Evidence) -> "Figure":
    """Amplitude for one impulse a cycle against distance: recorded as dots, RA's as lines."""
    figure, [[panel]] = new_figure(_EVIDENCE_IN, margins_in=(0.6, 3.2, 0.42, 0.4, 0.0, 0.0))
    colour, table = AFFERENT_COLOURS["RA"], found.distance
    keenest: dict[str, Any] = {"color": colour, "dashes": (3, 2)}
    panel.plot(table["distance_mm"], table["model_um"], color=colour)
    panel.plot(table["distance_mm"], table["keenest_um"], **keenest)
    panel.plot(table["distance_mm"], table["amplitude_um"], **dots(INK, 3.5))
    panel.set_yscale("log")
    panel.set_yticks([50, 100, 200, 500], ["50", "100", "200", "500"])
    panel.set_yticks([], minor=True)
    panel.set_xlabel("Distance from the probe’s centre (mm)")
    panel.set_ylabel("Amplitude (µm)")
    legend_above(
        figure,
        [dots(INK, 3.5), {"color": colour}, keenest],
        ["recorded", "median cell", "keenest cell"],
        down_in=0.15,
    )
    return figure
