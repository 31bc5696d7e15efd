"""Stress histories: a panel a node, one below the other, on one time axis."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from fembridge.errors import UsageError
from fembridge.plots.style import (
    AFFERENT_COLOURS,
    INK,
    LINE_PT,
    PAGE_WIDTH_IN,
    SMALL_TEXT_PT,
    TEXT_PT,
    make_plain,
)
from fembridge.plots.waveform import draw_waveform
from fembridge.stimulus import Stimulus
from fembridge.trace import StressTrace

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_PANELS = 20

_PANEL_IN, _WAVEFORM_IN, _AROUND_IN = 0.85, 0.6, 0.42
_PA_PER_KPA = 1000.0


def trace_figure(traces: Sequence[StressTrace], *, waveform: Stimulus | None = None) -> "Figure":
    """Von Mises stress over time: a panel a trace, from top to bottom.

    All have the same unit, kPa, or Pa where none reaches 1 kPa, and each its own scale.
    `waveform` is the stimulus that made them, to be drawn above.

    Raises
    ------
    UsageError
        No trace, or more than `MOST_PANELS`.
    """
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    if not 0 < len(traces) <= MOST_PANELS:
        raise UsageError(f"{len(traces)} traces, expected 1 to {MOST_PANELS} in one picture")
    heights_in = [_PANEL_IN] * len(traces)
    if waveform:
        heights_in.insert(0, _WAVEFORM_IN)
    figure = Figure(figsize=(PAGE_WIDTH_IN, sum(heights_in) + _AROUND_IN), layout="constrained")
    panels = figure.subplots(
        len(heights_in), squeeze=False, sharex=True, gridspec_kw={"height_ratios": heights_in}
    )[:, 0]
    if waveform:
        draw_waveform(panels[0], waveform)
        panels[0].set_ylabel("Depth\n(µm)", fontsize=SMALL_TEXT_PT, color=INK)
        panels[0].set_title(waveform.id, fontsize=SMALL_TEXT_PT, color=INK, parse_math=False)
    largest_pa = max(float(trace.stress_pa.max()) for trace in traces)
    unit, unit_pa = ("kPa", _PA_PER_KPA) if largest_pa >= _PA_PER_KPA else ("Pa", 1.0)
    for panel, trace in zip(panels[-len(traces) :], traces, strict=True):
        colour = AFFERENT_COLOURS.get(trace.afferent or "", INK)
        panel.plot(trace.times_ms, trace.stress_pa / unit_pa, color=colour, linewidth=LINE_PT)
        panel.set_ylabel(f"Stress\n({unit})", fontsize=SMALL_TEXT_PT, color=INK)
        panel.set_ylim(bottom=0.0)
        panel.yaxis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 5, 10]))
        make_plain(panel)
        panel.annotate(
            trace.afferent or f"node {trace.node}",
            (1.0, 0.5),
            xycoords="axes fraction",
            xytext=(5, 0),
            textcoords="offset points",
            va="center",
            fontsize=TEXT_PT,
            fontweight="bold",
            color=colour,
        )
    start_ms = min(trace.start_ms for trace in traces)
    end_ms = max(float(trace.times_ms[-1]) for trace in traces)
    panels[-1].set_xlim(start_ms, end_ms)
    panels[-1].set_xlabel("Time (ms)", fontsize=SMALL_TEXT_PT, color=INK)
    figure.align_ylabels(panels)
    return figure
