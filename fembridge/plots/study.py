"""Held-out error of every model of a study, a panel a class, the best on top."""

from typing import TYPE_CHECKING

from fembridge.fitting.study import ModelStudy
from fembridge.plots.style import (
    FAINT,
    HAIR_PT,
    SMALL_TEXT_PT,
    TEXT_PT,
    class_style,
    dots,
    in_style,
    new_figure,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_ROW_IN = 0.17


@in_style
def study_figure(study: ModelStudy) -> "Figure":
    """Dots: RMSE on held-out frequencies, a dot a seed; ticks: on those fitted."""
    rows = {name: study.ranked(name) for name in study.unfitted}
    height_in = 1.1 + _ROW_IN * max(map(len, rows.values()))
    figure, [panels] = new_figure(height_in, columns=len(rows))
    for panel, (name, cases) in zip(panels, rows.items(), strict=True):
        style = class_style(name)
        for place, trials in enumerate(cases):
            held, seen = trials["held_out_rmse_ips"], trials["fitted_rmse_ips"]
            panel.plot([seen.min(), held.max()], [place] * 2, color=FAINT, linewidth=HAIR_PT)
            panel.plot(seen, [place] * len(seen), "|", markersize=5, markeredgewidth=1)
            panel.plot(held, [place] * len(held), **dots(style["color"], 4.5))
        panel.axvline(study.unfitted[name].rmse_ips, linewidth=HAIR_PT, dashes=(4, 3))
        firsts = [trials.iloc[0] for trials in cases]
        labels = [f"{one['drive']}, {one['cells']}, {one['preindent_um']:g}" for one in firsts]
        panel.set_yticks(range(len(labels)), labels, fontsize=SMALL_TEXT_PT - 1)
        panel.set_ylim(len(labels) - 0.4, -0.6)
        panel.set_xlim(left=0)
        panel.set_title(name, **style)
        panel.set_xlabel("RMSE (impulses/s)", fontsize=TEXT_PT)
    figure.suptitle(
        "Rows: drive, cells, depth of the probe before time 0 (µm)\n"
        "dots: frequencies left out of the fit;  ticks: all fitted;  "
        "dashes: Table 2 as printed",
    )
    return figure
