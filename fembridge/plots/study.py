"""Held-out error of every model of a study, a panel a class, the best on top."""

from typing import TYPE_CHECKING

from fembridge.fitting.study import ModelStudy
from fembridge.plots.style import (
    AFFERENT_COLOURS,
    FAINT,
    HAIR_PT,
    INK,
    PAGE_WIDTH_IN,
    SMALL_TEXT_PT,
    TEXT_PT,
    make_plain,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_ROW_IN = 0.17


def study_figure(study: ModelStudy) -> "Figure":
    """Dots: RMSE on held-out frequencies, a dot a seed; ticks: on those fitted."""
    from matplotlib.figure import Figure

    classes = tuple(study.unfitted)
    rows = [study.ranked(name) for name in classes]
    height = 1.1 + _ROW_IN * max(map(len, rows))
    figure = Figure(figsize=(PAGE_WIDTH_IN, height), layout="constrained")
    panels = figure.subplots(1, len(classes), squeeze=False)[0]
    for panel, name, cases in zip(panels, classes, rows, strict=True):
        make_plain(panel)
        for place, trials in enumerate(cases):
            held, seen = trials["held_out_rmse_ips"], trials["fitted_rmse_ips"]
            panel.plot([seen.min(), held.max()], [place] * 2, color=FAINT, linewidth=HAIR_PT)
            panel.plot(seen, [place] * len(seen), "|", color=INK, markersize=5)
            panel.plot(held, [place] * len(held), "o", color=AFFERENT_COLOURS[name], markersize=3.5)
        panel.axvline(study.unfitted[name].rmse_ips, color=INK, linewidth=HAIR_PT, dashes=(4, 3))
        firsts = [trials.iloc[0] for trials in cases]
        labels = [f"{one['drive']}, {one['cells']}, {one['preindent_um']:g}" for one in firsts]
        panel.set_yticks(range(len(labels)), labels, fontsize=SMALL_TEXT_PT - 1)
        panel.set_ylim(len(labels) - 0.4, -0.6)
        panel.set_xlim(left=0)
        panel.set_title(name, color=AFFERENT_COLOURS[name], fontsize=TEXT_PT, fontweight="bold")
        panel.set_xlabel("RMSE (impulses/s)", fontsize=TEXT_PT)
    figure.suptitle(
        "Rows: drive, cells, depth of the probe before time 0 (µm)\n"
        "dots: frequencies left out of the fit;  ticks: all fitted;  "
        "dashes: Table 2 as printed",
        fontsize=TEXT_PT,
    )
    return figure
