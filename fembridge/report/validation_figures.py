"""The figures that only a validation has: regressions, a raster, recorded afferents.

A source looks the same in all: observed rates are black, TouchSim is grey, a model has the
colour of the class, the judged one filled.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fembridge.plots.spikes import raster_figure
from fembridge.plots.style import (
    AFFERENT_COLOURS,
    FAINT,
    GREY,
    HAIR_PT,
    INK,
    LINE_PT,
    MARKERS,
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
# Regression.
_MARK_PT = 3.8
_REGRESSION: dict[str, Any] = {"linewidth": 1.5 * LINE_PT, "dashes": (3.5, 1.6), "zorder": 2}
_EQUAL: dict[str, Any] = {"color": FAINT, "linewidth": 1.6 * HAIR_PT}
# Beside recorded afferents; the tuning curves are `fembridge.plots.thresholds`.
_EVIDENCE_IN = 2.1


def source_title(source: str, judged: str) -> str:
    """Words for a source in figures and tables."""
    titles = {judged: "This model", OBSERVED: "Observed", PUBLISHED_NAME: "Published model"}
    titles[FINGERTIP] = "Whole fingertip"
    return titles.get(source, source)


def _colour(source: str, afferent: str) -> str:
    return {OBSERVED: INK, TOUCHSIM: GREY}.get(source) or class_style(afferent)["color"]


@in_style
def regression_figure(
    rates: RateTable, agreement: "DataFrame", family: Family, reference: str, judged: str
) -> "Figure":
    """Predicted against reference rates: a column a class, a row a predicting source.

    Points, the line through them, and the line of equal rates.
    """
    from matplotlib.ticker import MaxNLocator

    sources = rates.compared(reference)
    height_in = 0.8 + len(sources) * 1.85
    figure, panels = new_figure(height_in, len(sources), len(AFFERENTS), sharex="col", sharey="col")
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
    figure.supxlabel(f"{across} (impulses/s)", fontsize=TEXT_PT)
    figure.supylabel("Predicted rate (impulses/s)", fontsize=TEXT_PT)
    samples = [marks(marker, INK, _MARK_PT) for marker in MARKERS[: len(family.sets)]]
    names = [*(one.title for one in family.sets), "regression", "equal rates"]
    legend_above(figure, [*samples, _REGRESSION, _EQUAL], names, handlelength=1.8)
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


def rasters_figure(
    trains: Sequence[SpikeTrain],
    strongest: Stimulus,
    recorded: Sequence[SpikeTrain] = (),
) -> "Figure":
    """Spikes of Fig. 3 (a), `recorded` trains of the same stimuli in rows of their own."""
    rows = list(dict.fromkeys(train.stimulus for train in trains))
    theirs = [
        replace(t, stimulus=f"{t.stimulus}, {OBSERVED}") for t in recorded if t.stimulus in rows
    ]
    there = [name for row in rows for name in (row, f"{row}, {OBSERVED}")
             if name == row or name in {train.stimulus for train in theirs}]  # fmt: skip
    return raster_figure([*trains, *theirs], stimuli=there, waveform=strongest)


@in_style
def phase_figure(found: Evidence) -> "Figure":
    """Shares of the spikes by phase of the cycle: recorded as steps, the model's filled."""
    keys = ["afferent", "frequency_hz", "amplitude_um"]
    cells: list[tuple[Any, Any]] = [*found.phases.groupby(keys, sort=False)]
    figure, [panels] = new_figure(_EVIDENCE_IN, columns=len(cells), sharey=True)
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
    legend_above(figure, samples, ["recorded", "this model"])
    return figure


@in_style
def man_figure(found: Evidence) -> "Figure":
    """Impulses a cycle against amplitude: medians of human units as dots, the model as lines."""
    figure, [panels] = new_figure(_EVIDENCE_IN, columns=len(AFFERENTS), sharey=True)
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
    legend_above(figure, samples, names)
    return figure


@in_style
def distance_figure(found: Evidence) -> "Figure":
    """Amplitude for one impulse a cycle against distance: recorded as dots, RA's as lines."""
    figure, [[panel]] = new_figure(_EVIDENCE_IN)
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
    )
    return figure
