"""Spikes of repeats, as in Fig. 3 (a): a column an amplitude, a row a class."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from decks.stimuli import number_text, resolve
from fembridge.plots.palette import (
    AFFERENT_COLOURS,
    FAINT,
    HAIR_PT,
    INK,
    LINE_PT,
    PAGE_WIDTH_IN,
    SMALL_TEXT_PT,
    TEXT_PT,
)
from fembridge.plots.picture import make_plain
from fembridge.simulation import Simulation
from fembridge.stimulus import Stimulus
from fembridge.tables import AFFERENTS, SpikeTrain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Fig. 3 (a): 35, 130 and 250 um at 20 Hz; Appendix A has 34.74 and 129.49.
RASTER_STIMULI = ("sine_20_34.74", "sine_20_129.49", "sine_20_250")
REPEATS = 5

# Inches.
_HEIGHT_IN = 3.5
_LEFT_IN, _RIGHT_IN, _TOP_IN, _BOTTOM_IN = 0.78, 0.14, 0.3, 0.44
_HEIGHTS = (1.15, 1.0, 1.0, 1.0)
_FILL = 0.74


def repeated_trains(simulation: Simulation) -> tuple[SpikeTrain, ...]:
    """Give five trains for each class and stimulus of the figure, repeat 1 to 5.

    Those of a population are those of its first five cells. A model of one cell has
    no noise, so that each of its repeats is the same.
    """
    found = []
    for stimulus in RASTER_STIMULI:
        for afferent in AFFERENTS:
            mine = [
                train
                for train in simulation.trains
                if train.stimulus == stimulus and train.afferent == afferent
            ]
            cells = sorted(mine, key=lambda train: train.repeat)
            for repeat in range(REPEATS):
                times_ms = cells[repeat % len(cells)].times_ms
                found.append(SpikeTrain(stimulus, afferent, times_ms, repeat + 1))
    return tuple(found)


def cells_of(simulation: Simulation) -> int:
    """Give how many cells each class of the model has."""
    return len({train.repeat for train in simulation.trains})


def raster_figure(trains: Sequence[SpikeTrain], stimuli: Sequence[Stimulus]) -> "Figure":
    """Draw what `repeated_trains` gives, each column's waveform above it."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(PAGE_WIDTH_IN, _HEIGHT_IN))
    grid = figure.subplots(
        1 + len(AFFERENTS),
        len(stimuli),
        squeeze=False,
        sharex=True,
        sharey="row",
        gridspec_kw={
            "left": _LEFT_IN / PAGE_WIDTH_IN,
            "right": 1 - _RIGHT_IN / PAGE_WIDTH_IN,
            "top": 1 - _TOP_IN / _HEIGHT_IN,
            "bottom": _BOTTOM_IN / _HEIGHT_IN,
            "hspace": 0.16,
            "wspace": 0.09,
            "height_ratios": _HEIGHTS,
        },
    )
    for column, stimulus in enumerate(stimuli):
        _draw_waveform(grid[0, column], stimulus)
        for row, afferent in enumerate(AFFERENTS, start=1):
            mine = [
                train
                for train in trains
                if train.stimulus == stimulus.id and train.afferent == afferent
            ]
            _draw_trains(grid[row, column], mine, AFFERENT_COLOURS[afferent])
        grid[-1, column].spines["bottom"].set_visible(True)
        grid[-1, column].tick_params(axis="x", bottom=True, labelbottom=True)
        grid[-1, column].set_xlabel("Time (ms)", fontsize=TEXT_PT, color=INK)
        [entry] = resolve(stimulus.id)
        frequency, amplitude = map(number_text, entry.numbers().values())
        grid[0, column].set_title(
            f"{frequency} Hz, {amplitude} µm", fontsize=TEXT_PT, color=INK, pad=4
        )
    depth_um = [stimulus.displacement_um for stimulus in stimuli]
    low, high = float(np.min(depth_um)), float(np.max(depth_um))
    grid[0, 0].set_ylim(low - 0.08 * (high - low), high + 0.08 * (high - low))
    grid[0, 0].set_ylabel("Depth (µm)", fontsize=SMALL_TEXT_PT, color=INK)
    for row, afferent in enumerate(AFFERENTS, start=1):
        grid[row, 0].set_ylabel(
            afferent,
            rotation=0,
            ha="right",
            va="center",
            labelpad=16,
            fontsize=TEXT_PT + 2,
            fontweight="bold",
            color=AFFERENT_COLOURS[afferent],
        )
    return figure


def _draw_waveform(panel: "Axes", stimulus: Stimulus) -> None:
    panel.axhline(0.0, color=FAINT, linewidth=HAIR_PT, zorder=1)
    panel.plot(stimulus.times_ms, stimulus.displacement_um, color=INK, linewidth=LINE_PT)
    panel.set_xlim(stimulus.times_ms[0], stimulus.times_ms[-1])
    make_plain(panel)
    panel.spines["bottom"].set_visible(False)
    panel.tick_params(axis="x", bottom=False, labelbottom=False)


def _draw_trains(panel: "Axes", trains: Sequence[SpikeTrain], colour: str) -> None:
    for train in trains:
        panel.vlines(
            train.times_ms,
            train.repeat - _FILL / 2,
            train.repeat + _FILL / 2,
            colors=colour,
            linewidths=1.2 * LINE_PT,
            clip_on=False,
        )
    if not any(train.times_ms.size for train in trains):
        panel.text(
            0.5,
            0.5,
            "no spikes",
            transform=panel.transAxes,
            ha="center",
            va="center",
            fontsize=SMALL_TEXT_PT,
            color=INK,
        )
    panel.set_ylim(REPEATS + 0.6, 0.4)
    panel.set_yticks([1, REPEATS])
    make_plain(panel)
    panel.spines["bottom"].set_visible(False)
    panel.tick_params(axis="x", bottom=False, labelbottom=False)
    panel.tick_params(axis="y", length=0.0)
