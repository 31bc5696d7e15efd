"""Study: from which depth on the law of the materials matters.

Decks take the second Piola–Kirchhoff stress to be linear in Green's strain, with
Table 1's moduli; a neo-Hookean skin has the same moduli at rest.
"""

import numpy as np

from decks.presets import QUICK, model_of
from fembridge.report.plane import NEO_HOOKEAN
from fembridge.report.runs import AFFERENTS, Runs, down, indent
from fembridge.report.study import Check, Finding, finish, line, panels

DEPTH_UM, STEPS, STEPS_QUICK = 400.0, 16, 8
_TABLED_UM = (50.0, 100.0, 200.0, 300.0, 400.0)
_BOUND_PERCENT = 0.5
_MUCH_PERCENT = 5.0


def study(runs: Runs) -> Finding:
    """Press with both laws."""
    from pandas import DataFrame

    model = model_of(QUICK)
    stimulus = down(DEPTH_UM, STEPS_QUICK if runs.quick else STEPS)
    found = {}
    for law in ("linear", NEO_HOOKEAN):
        runs.log(f"laws: {law}")
        found[law] = indent(runs, f"laws/{law}", model, stimulus, law=law)
    linear, other = found["linear"], found[NEO_HOOKEAN]
    depth_um = linear.depth_um[1:]
    off = 100 * (other.stress_pa[1:] / linear.stress_pa[1:] - 1)
    force_off = 100 * (other.force_n_per_mm[1:] / linear.force_n_per_mm[1:] - 1)
    at_rest = off[0] - (off[1] - off[0]) / (depth_um[1] - depth_um[0]) * depth_um[0]
    rows = [int(np.abs(depth_um - one).argmin()) for one in _TABLED_UM]
    much = (np.abs(off) > _MUCH_PERCENT).T
    table = DataFrame({"depth_um": depth_um[rows]})
    table[list(AFFERENTS)] = linear.stress_pa[1:][rows] / 1000
    table[[f"{name}_percent" for name in AFFERENTS]] = off[rows]
    table["force_percent"] = force_off[rows]
    figure, [panel] = panels(1)
    for row, name in enumerate(AFFERENTS):
        panel.plot(depth_um, off[:, row], label=name, **line(row, name=name, mark="line"))
    panel.plot(depth_um, force_off, label="force", **line(len(AFFERENTS), mark="line"))
    finish(panel, "depth (µm)", "neo-Hookean / linear − 1 (%)")
    worst = float(np.abs(at_rest).max())
    return Finding(
        checks=(
            Check("difference of stress, extrapolated to depth 0", worst, _BOUND_PERCENT, "%"),
        ),
        tables={"laws": table},
        numbers={
            "depth_um": DEPTH_UM,
            "off_percent": dict(zip(AFFERENTS, off[-1].tolist(), strict=True)),
            "force_percent": float(force_off[-1]),
            "much_percent": _MUCH_PERCENT,
            "much_from_um": {
                name: float(depth_um[over.argmax()])
                for name, over in zip(AFFERENTS, much, strict=True)
                if over.any()
            },
            "steps": STEPS,
            "steps_quick": STEPS_QUICK,
        },
        figure=figure,
    )
