"""Stress histories: one panel per node, one below the other, with one time axis."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from fembridge.errors import UsageError
from fembridge.plots.style import (
    PAGE_WIDTH_IN,
    class_style,
    explain_shade,
    in_style,
    new_figure,
    note,
    shade_outside,
    shorten_text,
)
from fembridge.plots.waveform_overview import draw_waveform
from fembridge.stimulus import Stimulus
from fembridge.trace import StressTrace

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fembridge.plots.style import Panels

MAX_PANELS = 20

_PANEL_IN, _WAVEFORM_IN, _AROUND_IN, _LEGEND_IN = 0.85, 0.6, 0.42, 0.22
_PA_PER_KPA = 1000.0


@in_style
def trace_figure(
    traces: Sequence[StressTrace],
    *,
    waveform: Stimulus | None = None,
    axes: "Panels | None" = None,
) -> "Figure":
    """Von Mises stress over time: one panel per trace, from top to bottom.

    All panels have the same unit (kPa, or Pa if no trace reaches 1 kPa), each its own scale.
    `waveform` is their stimulus, by default none: it is drawn above, and the time outside its
    counting window is shaded. `axes`, one per trace, are drawn into instead of a new figure,
    without the waveform and without a legend. Raises UsageError: no trace, more than
    `MAX_PANELS`, or another number of axes.
    """
    from matplotlib.ticker import MaxNLocator

    if not 0 < len(traces) <= MAX_PANELS:
        raise UsageError(f"{len(traces)} traces, expected 1 to {MAX_PANELS} in one picture")
    draws_waveform = waveform is not None and axes is None
    heights_in = [_WAVEFORM_IN] * draws_waveform + [_PANEL_IN] * len(traces)
    height_in = sum(heights_in) + _AROUND_IN + _LEGEND_IN * draws_waveform
    figure, panels = new_figure(
        height_in, len(heights_in), heights=heights_in, sharex=True, axes=axes
    )
    panels = panels[:, 0]
    largest_pa = max(float(trace.stress_pa.max()) for trace in traces)
    unit, unit_pa = ("kPa", _PA_PER_KPA) if largest_pa >= _PA_PER_KPA else ("Pa", 1.0)
    if waveform and draws_waveform:
        draw_waveform(panels[0], waveform)
        panels[0].set_ylabel("Depth\n(µm)")
        panels[0].set_title(shorten_text(waveform.id, 0.8 * PAGE_WIDTH_IN), parse_math=False)
    for panel, trace in zip(panels[-len(traces) :], traces, strict=True):
        style = class_style(trace.afferent or "")
        panel.plot(trace.times_ms, trace.stress_pa / unit_pa, color=style["color"])
        panel.set_ylabel(f"Stress\n({unit})")
        panel.set_ylim(bottom=0.0)
        panel.yaxis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 5, 10]))
        note(
            panel, trace.afferent or f"node {trace.node}", (1.0, 0.5), (5, 0), va="center", **style
        )
    start_ms = min(trace.start_ms for trace in traces)
    end_ms = max(float(trace.times_ms[-1]) for trace in traces)
    for panel in panels:
        panel.set_xlim(start_ms, end_ms)
    panels[-1].set_xlabel("Time (ms)")
    if waveform:
        for panel in panels[-len(traces) :]:
            shade_outside(panel, waveform.window_ms)
    if waveform and draws_waveform:
        explain_shade(figure, [waveform.window_ms])
    figure.align_ylabels(panels)
    return figure
