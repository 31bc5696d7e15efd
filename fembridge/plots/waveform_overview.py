"""Waveforms of stimuli: small panels with one time axis, and one depth axis per family."""

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
    grid_figure,
    in_style,
    shade_outside,
    shorten_text,
)
from fembridge.stimulus import Stimulus

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from fembridge.plots.style import Panels

# The number of levels in a set of diharmonics or noises.
_MAX_COLUMNS = 5
# Inches.
_PANEL_IN, _SINGLE_ROW_PANEL_IN, _BETWEEN_ROWS_IN, _BETWEEN_FAMILIES_IN = 0.5, 1.0, 0.3, 0.46
_BETWEEN_COLUMNS_IN = 0.26
_LEFT_IN, _RIGHT_IN, _TOP_IN, _BOTTOM_IN = 0.78, 0.14, 0.22, 0.62
_NAME_UP_IN, _LEGEND_UP_IN = 0.24, 0.13
_WAVE_PT = 0.6
# Margin above and below the waves, as a share of their range.
_ROOM_SHARE = 0.06
# Least distance of two tick labels, as a share of the scale; a closer one is omitted.
_CLEAR_SHARE = 0.22


@in_style
def waveform_figure(stimuli: Sequence[Stimulus], axes: "Panels | None" = None) -> "Figure":
    """The probe's depth over time, one panel per stimulus, in reading order.

    Stimuli of one family share a scale; each family begins a new row. Up is into the skin. The
    time outside the counting window is shaded grey. With `axes`, one per stimulus in the order
    of `stimuli`, the panels are drawn into them, without a legend. Raises UsageError: another
    number of axes.
    """
    families = [list(group) for _, group in groupby(stimuli, key=stimulus_family)]
    columns = min(_MAX_COLUMNS, max(math.ceil(math.sqrt(len(family))) for family in families))
    rows = [math.ceil(len(family) / columns) for family in families]
    panel_in = _SINGLE_ROW_PANEL_IN if sum(rows) == 1 else _PANEL_IN
    heights_in = [_TOP_IN]
    for count in rows:
        heights_in += [panel_in, _BETWEEN_ROWS_IN] * (count - 1) + [panel_in, _BETWEEN_FAMILIES_IN]
    width_in = PAGE_WIDTH_IN - _LEFT_IN - _RIGHT_IN - (columns - 1) * _BETWEEN_COLUMNS_IN
    width_in /= columns
    widths_in = [_LEFT_IN, *[width_in, _BETWEEN_COLUMNS_IN] * (columns - 1), width_in, _RIGHT_IN]
    figure, new_panel = grid_figure(
        widths_in, [*heights_in[:-1], _BOTTOM_IN], sum(map(len, families)), axes
    )
    end_ms = max(float(stimulus.times_ms[-1]) for stimulus in stimuli)
    for first, members in zip(np.cumsum([0, *rows]), families, strict=False):
        depth_range_um = _depth_range_um(
            [
                stimulus
                for stimulus in stimuli
                if stimulus_family(stimulus) == stimulus_family(members[0])
            ]
        )
        for index, stimulus in enumerate(members):
            row, column = divmod(index, columns)
            panel = new_panel(first + row, column)
            draw_waveform(panel, stimulus, depth_range_um, end_ms)
            title = shorten_text(stimulus.id, width_in + _BETWEEN_COLUMNS_IN / 2)
            panel.set_title(title, pad=3, parse_math=False)
            if axes is None:
                panel.tick_params(labelleft=not column, labelbottom=index + columns >= len(members))
            else:
                panel.set(xlabel="Time (ms)", ylabel="Depth (µm)")
    if axes is not None:
        return figure
    page_in = figure.get_figheight()
    figure.supxlabel("Time (ms)", y=_NAME_UP_IN / page_in, va="bottom")
    figure.supylabel("Depth (µm)", x=0.04 / PAGE_WIDTH_IN)
    anchor = (0.5, _LEGEND_UP_IN / page_in)
    windows_ms = [stimulus.window_ms for stimulus in stimuli]
    explain_shade(figure, windows_ms, loc="center", bbox_to_anchor=anchor)
    return figure


def stimulus_family(stimulus: Stimulus) -> str:
    """Family of a stimulus, by default the part of its id before the first underscore."""
    return str(stimulus.origin.get("family") or stimulus.id.partition("_")[0])


def draw_waveform(
    panel: "Axes",
    stimulus: Stimulus,
    depth_range_um: tuple[float, float] | None = None,
    end_ms: float | None = None,
) -> None:
    """Draw one waveform on a scale over `depth_range_um`, by default its own range."""
    low_um, high_um = depth_range_um or _depth_range_um([stimulus])
    panel.plot(stimulus.times_ms, stimulus.displacement_um, linewidth=_WAVE_PT)
    panel.set_xlim(0.0, end_ms or stimulus.times_ms[-1])
    if low_um < 0 < high_um:
        panel.axhline(0.0, color=FAINT, linewidth=HAIR_PT, zorder=-1)
    if low_um < high_um:
        room_um = _ROOM_SHARE * (high_um - low_um)
        panel.set_ylim(low_um - room_um, high_um + room_um)
    shade_outside(panel, stimulus.window_ms)
    ticks = scale_ticks(low_um, high_um)
    panel.set_yticks(ticks, [f"{tick:.10g}".replace("-", "\N{MINUS SIGN}") for tick in ticks])


def scale_ticks(low: float, high: float) -> list[float]:
    """Both ends, rounded to a hundredth of the range, and 0 unless it is close to an end."""
    if not high > low:
        return [low]
    decimals = 2 - math.floor(math.log10(high - low))
    room = _CLEAR_SHARE * (high - low)
    middle = [0.0] if low + room <= 0 <= high - room else []
    return [round(low, decimals), *middle, round(high, decimals)]


def _depth_range_um(stimuli: Sequence[Stimulus]) -> tuple[float, float]:
    depths_um = np.concatenate([stimulus.displacement_um for stimulus in stimuli])
    return float(depths_um.min()), float(depths_um.max())
