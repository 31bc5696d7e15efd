"""Waveforms of stimuli: small panels with one time axis, and one depth axis a family."""

import math
from collections.abc import Sequence
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np

from fembridge.plots.style import (
    FAINT,
    HAIR_PT,
    PAGE_WIDTH_IN,
    explain_shade,
    fitting,
    grid_figure,
    in_style,
    shade_outside,
)
from fembridge.stimulus import Stimulus

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# As many as levels of a set of diharmonics or noises.
_MOST_COLUMNS = 5
# Inches.
_PANEL_IN, _TALL_PANEL_IN, _BETWEEN_ROWS_IN, _BETWEEN_FAMILIES_IN = 0.5, 1.0, 0.3, 0.46
_BETWEEN_COLUMNS_IN = 0.26
_LEFT_IN, _RIGHT_IN, _TOP_IN, _BOTTOM_IN = 0.78, 0.14, 0.22, 0.62
_NAME_UP_IN, _LEGEND_UP_IN = 0.24, 0.13
_WAVE_PT = 0.6
# What is left and right of the waves, above and below, as a share of what they span.
_ROOM_SHARE = 0.06
# Two numbers on a scale are apart by this share of it, or one is left out.
_CLEAR_SHARE = 0.22


@in_style
def waveform_figure(stimuli: Sequence[Stimulus]) -> "Figure":
    """The probe's depth over time, a panel a stimulus, in reading order.

    Stimuli of one family share a scale; each family begins a row. Up is into the skin. What is
    outside the window in which spikes are counted gets a grey ground.
    """
    families = [list(each) for _, each in groupby(stimuli, key=family_of)]
    columns = min(_MOST_COLUMNS, max(math.ceil(math.sqrt(len(each))) for each in families))
    rows = [math.ceil(len(each) / columns) for each in families]
    tall_in = _TALL_PANEL_IN if sum(rows) == 1 else _PANEL_IN
    heights_in = [_TOP_IN]
    for count in rows:
        heights_in += [tall_in, _BETWEEN_ROWS_IN] * (count - 1) + [tall_in, _BETWEEN_FAMILIES_IN]
    wide_in = PAGE_WIDTH_IN - _LEFT_IN - _RIGHT_IN - (columns - 1) * _BETWEEN_COLUMNS_IN
    wide_in /= columns
    widths_in = [_LEFT_IN, *[wide_in, _BETWEEN_COLUMNS_IN] * (columns - 1), wide_in, _RIGHT_IN]
    figure, new_panel = grid_figure(widths_in, [*heights_in[:-1], _BOTTOM_IN])
    end_ms = max(float(stimulus.times_ms[-1]) for stimulus in stimuli)
    for first, members in zip(np.cumsum([0, *rows]), families, strict=False):
        ends_um = _ends_um([one for one in stimuli if family_of(one) == family_of(members[0])])
        for place, stimulus in enumerate(members):
            row, column = divmod(place, columns)
            panel = new_panel(first + row, column)
            draw_waveform(panel, stimulus, ends_um, end_ms)
            title = fitting(stimulus.id, wide_in + _BETWEEN_COLUMNS_IN / 2)
            panel.set_title(title, pad=3, parse_math=False)
            panel.tick_params(labelleft=not column, labelbottom=place + columns >= len(members))
    page_in = figure.get_figheight()
    figure.supxlabel("Time (ms)", y=_NAME_UP_IN / page_in, va="bottom")
    figure.supylabel("Depth (µm)", x=0.04 / PAGE_WIDTH_IN)
    middle = (0.5, _LEGEND_UP_IN / page_in)
    windows_ms = [each.window_ms for each in stimuli]
    explain_shade(figure, windows_ms, loc="center", bbox_to_anchor=middle)
    return figure


def family_of(stimulus: Stimulus) -> str:
    """Family of a stimulus: what is before the first number of its id."""
    return str(stimulus.origin.get("family") or stimulus.id.partition("_")[0])


def draw_waveform(
    panel: "Axes",
    stimulus: Stimulus,
    ends_um: tuple[float, float] | None = None,
    end_ms: float | None = None,
) -> None:
    """Draw one waveform on a scale from one of `ends_um` to the other, by default its own."""
    low, high = ends_um or _ends_um([stimulus])
    panel.plot(stimulus.times_ms, stimulus.displacement_um, linewidth=_WAVE_PT)
    panel.set_xlim(0.0, end_ms or stimulus.times_ms[-1])
    if low < 0 < high:
        panel.axhline(0.0, color=FAINT, linewidth=HAIR_PT, zorder=-1)
    if low < high:
        room_um = _ROOM_SHARE * (high - low)
        panel.set_ylim(low - room_um, high + room_um)
    shade_outside(panel, stimulus.window_ms)
    ticks = scale_ticks(low, high)
    panel.set_yticks(ticks, [f"{tick:.10g}".replace("-", "\N{MINUS SIGN}") for tick in ticks])


def scale_ticks(low: float, high: float) -> list[float]:
    """Both ends, rounded to a hundredth of what lies between, and 0 if it is clear."""
    if not high > low:
        return [low]
    decimals = 2 - math.floor(math.log10(high - low))
    room = _CLEAR_SHARE * (high - low)
    middle = [0.0] if low + room <= 0 <= high - room else []
    return [round(low, decimals), *middle, round(high, decimals)]


def _ends_um(stimuli: Sequence[Stimulus]) -> tuple[float, float]:
    every_um = np.concatenate([stimulus.displacement_um for stimulus in stimuli])
    return float(every_um.min()), float(every_um.max())
