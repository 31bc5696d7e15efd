"""Waveforms of stimuli: small panels with one time axis, each with its own depth."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from fembridge.errors import UsageError
from fembridge.plots.style import FAINT, HAIR_PT, PAGE_WIDTH_IN, SHADE, in_style, new_figure
from fembridge.stimulus import Stimulus

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MOST_COLUMNS = 4
# Inches. Margins are given, not found: a layout engine takes seconds for all 82.
_PANEL_IN, _TALL_PANEL_IN, _BETWEEN_IN, _NUMBERS_IN = 0.5, 1.0, 0.34, 0.58
_LEFT_IN, _RIGHT_IN, _TOP_IN, _BOTTOM_IN = 0.72, 0.12, 0.22, 0.4
_WAVE_PT = 0.6
# Two numbers on a scale are apart by this share of it, or one is left out.
_CLEAR_SHARE = 0.22


@in_style
def waveform_figure(stimuli: Sequence[Stimulus]) -> "Figure":
    """The probe's depth over time, a panel a stimulus, in reading order.

    Each has its own scale, since amplitudes of the catalogue span three orders of
    magnitude; up is into the skin. What is outside the window in which spikes are counted
    gets a grey ground.

    Raises
    ------
    UsageError
        No stimulus.
    """
    if not stimuli:
        raise UsageError("no stimulus to draw")
    columns = min(_MOST_COLUMNS, math.ceil(math.sqrt(len(stimuli))))
    rows = math.ceil(len(stimuli) / columns)
    row_in = _TALL_PANEL_IN if rows == 1 else _PANEL_IN
    page_in = rows * row_in + (rows - 1) * _BETWEEN_IN + _TOP_IN + _BOTTOM_IN
    margins_in = (_LEFT_IN, _RIGHT_IN, _TOP_IN, _BOTTOM_IN, _NUMBERS_IN, _BETWEEN_IN)
    figure, grid = new_figure(page_in, rows, columns, margins_in=margins_in, sharex=True)
    panels = grid.ravel()
    for panel, stimulus in zip(panels, stimuli, strict=False):
        draw_waveform(panel, stimulus)
        panel.set_title(stimulus.id, pad=3, parse_math=False)
    for panel in panels[len(stimuli) :]:
        panel.set_axis_off()
    for panel in panels[max(0, len(stimuli) - columns) : len(stimuli)]:
        panel.tick_params(labelbottom=True)
    figure.supxlabel("Time (ms)", y=0.03 / page_in, va="bottom")
    figure.supylabel("Depth (µm)", x=0.04 / PAGE_WIDTH_IN)
    return figure


def draw_waveform(panel: "Axes", stimulus: Stimulus) -> None:
    """Draw one waveform; its scale shows its ends and first touch."""
    times_ms, depth_um = stimulus.times_ms, stimulus.displacement_um
    panel.plot(times_ms, depth_um, linewidth=_WAVE_PT)
    low, high = float(depth_um.min()), float(depth_um.max())
    if low < 0 < high:
        panel.axhline(0.0, color=FAINT, linewidth=HAIR_PT, zorder=-1)
    panel.set_xlim(times_ms[0], times_ms[-1])
    shade_outside(panel, stimulus.window_ms)
    ticks = scale_ticks(low, high)
    panel.set_yticks(ticks, [f"{tick:.10g}".replace("-", "\N{MINUS SIGN}") for tick in ticks])


def shade_outside(panel: "Axes", window_ms: tuple[float, float]) -> None:
    """Give the time of a panel that is not in the window a grey ground."""
    start_ms, end_ms = panel.get_xlim()
    for left, right in ((start_ms, window_ms[0]), (window_ms[1], end_ms)):
        if right > left:
            panel.axvspan(left, right, facecolor=SHADE, linewidth=0, zorder=-2)


def scale_ticks(low: float, high: float) -> list[float]:
    """Both ends, rounded to a hundredth of what lies between, and 0 if it is clear."""
    if not high > low:
        return [low]
    decimals = 2 - math.floor(math.log10(high - low))
    room = _CLEAR_SHARE * (high - low)
    middle = [0.0] if low + room <= 0 <= high - room else []
    return [round(low, decimals), *middle, round(high, decimals)]
