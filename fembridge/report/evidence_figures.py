"""Pictures of a model beside recorded afferents: phases, man, ramp and hold.

The tuning curves are `fembridge.plots.thresholds`.
"""

from typing import TYPE_CHECKING, Any

from fembridge.plots.style import (
    AFFERENT_COLOURS,
    INK,
    class_style,
    dots,
    in_style,
    legend_above,
    log_axis,
    new_figure,
    note,
)
from fembridge.report.evidence import RAMP, Evidence
from fembridge.tables import AFFERENTS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_HEIGHT_IN = 2.1
_MARGINS_IN = (0.6, 0.12, 0.42, 0.4, 0.22, 0.0)


@in_style
def phase_figure(found: Evidence) -> "Figure":
    """Shares of the spikes by phase of the cycle: recorded as steps, the model's filled."""
    keys = ["afferent", "frequency_hz", "amplitude_um"]
    cells: list[tuple[Any, Any]] = [*found.phases.groupby(keys, sort=False)]
    figure, [panels] = new_figure(
        _HEIGHT_IN, columns=len(cells), margins_in=_MARGINS_IN, sharey=True
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
        _HEIGHT_IN, columns=len(AFFERENTS), margins_in=_MARGINS_IN, sharey=True
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
    """Amplitude for one impulse a cycle against distance: recorded as dots, RA's as a line."""
    figure, [[panel]] = new_figure(_HEIGHT_IN, margins_in=(0.6, 3.2, 0.42, 0.4, 0.0, 0.0))
    colour, table = AFFERENT_COLOURS["RA"], found.distance
    panel.plot(table["distance_mm"], table["model_um"], color=colour)
    panel.plot(table["distance_mm"], table["amplitude_um"], **dots(INK, 3.5))
    panel.set_yscale("log")
    panel.set_yticks([50, 100, 200, 500], ["50", "100", "200", "500"])
    panel.set_yticks([], minor=True)
    panel.set_xlabel("Distance from the probe’s centre (mm)")
    panel.set_ylabel("Amplitude (µm)")
    legend_above(
        figure, [dots(INK, 3.5), {"color": colour}], ["recorded", "fitted_pad"], down_in=0.15
    )
    return figure


@in_style
def ramp_figure(found: Evidence) -> "Figure":
    """Spikes of every cell while a probe is pressed in, stays and is taken away."""
    wave = found.ramp_stimulus
    heights = [0.5, 1.0]
    figure, panels = new_figure(
        2.2, 2, margins_in=(0.6, 0.12, 0.1, 0.4, 0.0, 0.12), heights=heights, sharex=True
    )
    above, below = panels[:, 0]
    above.plot(wave.times_ms, wave.displacement_um)
    above.set_ylabel("Depth\n(µm)")
    rows = [(train.afferent, train) for train in found.ramp]
    for height, (name, train) in enumerate(rows):
        low = [-height - 0.4] * train.times_ms.size
        high = [-height + 0.4] * train.times_ms.size
        below.vlines(train.times_ms, low, high, color=AFFERENT_COLOURS[name], linewidth=0.7)
    for name in AFFERENTS:
        places = [-height for height, (one, _) in enumerate(rows) if one == name]
        middle = sum(places) / len(places)
        note(
            below,
            name,
            (0.0, middle),
            (-8, 0),
            frame=("axes fraction", "data"),
            ha="right",
            va="center",
            **class_style(name),
        )
    for corner_ms in RAMP.corners_ms:
        for panel in (above, below):
            panel.axvline(corner_ms, color=INK, linewidth=0.3, alpha=0.4)
    below.set_ylim(0.6 - len(rows), 0.6)
    below.set_yticks([])
    below.set_xlim(0.0, float(wave.times_ms[-1]))
    below.set_xlabel("Time (ms)")
    return figure
