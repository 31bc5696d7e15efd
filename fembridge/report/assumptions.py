"""Studies of what every deck assumes: the model of the contact, its stiffness, the material law.

`contact_models`: down to 250 µm and up again over the same depths, on the `quick` finger. Closure
is what `fembridge.response.indentation` judges every response by: the largest difference
between unloading and loading at the same depth, in percent of the stress there.

`stiffness`: the stress at each afferent against the springs' stiffness K. What they give
goes with 1/K, so a straight line in 1/K through the stiffest ends at rigid contact.

`laws`: from which depth on the law of the materials matters. Decks take the second
Piola–Kirchhoff stress to be linear in Green's strain, with Table 1's moduli; a neo-Hookean
skin has the same moduli at rest.
"""

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from decks.analysis import Contact, Model
from decks.presets import QUICK, model_of
from fembridge.report.plane import NEO_HOOKEAN
from fembridge.report.study import (
    DEPTH_UM,
    Check,
    Finding,
    Indented,
    Runs,
    down,
    finish,
    indent,
    line,
    panels,
    read_indented,
    through,
)
from fembridge.response.indentation import CLOSURE_PERCENT, LADDER, judge
from fembridge.stimulus import Stimulus
from fembridge.tables import AFFERENTS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DEEPEST_UM = 250.0
NODE, SURFACE = "node-to-surface", "surface-to-surface"
STIFFNESS = (25.0, 50.0, 100.0, 200.0, 400.0, 800.0, 1600.0)
STIFFNESS_QUICK = (50.0, 100.0, 200.0, 400.0)

_STEPS, _STEPS_QUICK, _BACK_EVERY = 10, 6, 2
_STICK_SHARE = 0.1
_MODELS = (
    ("CPE4", Contact(NODE, 20.0)),
    ("CPE4", Contact(NODE, 200.0)),
    ("CPE4", Contact(NODE, 200.0, friction=0.0)),
    ("CPE4", Contact(NODE, 200.0, stick_share=0.01)),
    ("CPE4", Contact(NODE, 1000.0)),
    ("CPE4", Contact(NODE, 5000.0)),
    ("CPE4", Contact(SURFACE, 20.0)),
    ("CPE4", Contact(SURFACE, 200.0)),
    ("CPE4", Contact(SURFACE, 200.0, friction=0.0)),
    ("CPE4", Contact(SURFACE, 1000.0)),
    ("CPE8R", Contact(NODE, 20.0)),
    ("CPE8R", Contact(NODE, 200.0)),
    ("CPE8R", Contact(SURFACE, 200.0)),
)
_MODELS_QUICK = (*_MODELS[1:3], *_MODELS[4:5], *_MODELS[7:8])
_STIFFNESS_BOUND_PERCENT = 3.0
_LAW_DEPTH_UM, _LAW_STEPS, _LAW_STEPS_QUICK = 400.0, 16, 8
_LAW_TABLED_UM = (50.0, 100.0, 200.0, 300.0, 400.0)
_LAW_BOUND_PERCENT = 0.5
_MUCH_PERCENT = 5.0


def contact_models(runs: Runs) -> Finding:
    """Try each contact model on the way down and back."""
    from pandas import DataFrame

    steps = _STEPS_QUICK if runs.quick else _STEPS
    down_um = np.round(np.linspace(0.0, DEEPEST_UM, steps + 1), 3)
    up_um = down_um[steps - _BACK_EVERY : 0 : -_BACK_EVERY]
    stimulus = through(np.concatenate([down_um, up_um]), "there_and_back")
    rows, found = [], {}
    for element, contact in _MODELS_QUICK if runs.quick else _MODELS:
        runs.log(f"contact: {element}, {contact}")
        model = replace(model_of(QUICK), element=element, contact=contact, support="prescribed")
        row, indented = _try(runs, model, stimulus)
        rows.append(row)
        if indented is not None:
            found[element, contact] = indented
    table = DataFrame(rows)
    by_node = table.contact.str.startswith(NODE)
    default = table[table.model == f"CPE4, {LADDER[0]}"].iloc[0]
    off_percent = table.closure[~by_node].dropna().tolist()
    unsolved = table.model[by_node & table.closure.isna()].tolist()
    numbers: dict[str, Any] = {
        "depth_um": DEEPEST_UM,
        "down": steps,
        "back": steps // _BACK_EVERY - 1,
        "allowed_percent": CLOSURE_PERCENT,
        "accepted": int((table.verdict[by_node] == "accepted").sum()),
        "by_node": int(by_node.sum()),
        "iterations": int(default.iterations),
        "surface_percent": [min(off_percent), max(off_percent)] if off_percent else [],
        "unsolved": unsolved,
    }
    rubbing, smooth = (found.get(("CPE4", Contact(NODE, 200.0, friction=f))) for f in (0.4, 0.0))
    if rubbing is not None and smooth is not None:  # how much friction changes the stress
        share = smooth.stress_pa[steps] / rubbing.stress_pa[steps]
        numbers["friction_percent"] = 100 * float(np.abs(share - 1).max())
    what = f"closure of the default, {LADDER[0]}"
    return Finding(
        checks=(Check(what, float(default.closure), CLOSURE_PERCENT, "%"),),
        tables={"contact": table.drop(columns="model")},
        numbers=numbers,
        figure=_models_figure(found, steps),
    )


def _try(runs: Runs, model: Model, stimulus: Stimulus) -> tuple[dict[str, Any], Indented | None]:
    """Row of the table; without a result where the model did not converge."""
    contact = model.contact
    name = (
        f"contact/{model.element}_{contact.formulation}_{contact.stiffness_mpa_per_mm:g}"
        f"_{contact.friction:g}_{contact.stick_share:g}"
    )
    attempt = runs.attempt(name, model, stimulus)
    found, closure_percent, peak_pa = None, math.nan, np.full(len(AFFERENTS), np.nan)
    if attempt.failure is not None:
        verdict = attempt.failure.cause.value
    else:
        found = read_indented(attempt, model, stimulus)
        peak_pa = found.stress_pa[found.depth_um.argmax()]
        closure_percent, refusal = judge(
            found.depth_um, found.stress_pa, found.force_n_per_mm, found.apex_um
        )
        verdict = "accepted" if refusal is None else "does not come back"
    stick = f", stick {contact.stick_share:g}" if contact.stick_share != _STICK_SHARE else ""
    return {
        "model": f"{model.element}, {contact}",
        "element": model.element,
        "contact": contact.formulation + stick,
        "stiffness": contact.stiffness_mpa_per_mm,
        "friction": contact.friction,
        "closure": closure_percent,
        "iterations": attempt.cost.iterations,
        "cpu_s": attempt.cost.cpu_s,
        **dict(zip(AFFERENTS, (peak_pa / 1000).tolist(), strict=True)),
        "verdict": verdict,
    }, found


def _models_figure(found: dict[tuple[str, Contact], Indented], steps: int) -> "Figure":
    """SA's stress on the way back against that on the way in, at the same depth."""
    figure, both = panels(2)
    for panel, formulation in zip(both, (NODE, SURFACE), strict=True):
        shown = [
            (contact.stiffness_mpa_per_mm, each)
            for (element, contact), each in found.items()
            if (element, contact) == ("CPE4", Contact(formulation, contact.stiffness_mpa_per_mm))
        ]
        for row, (stiffness_mpa_per_mm, each) in enumerate(shown):
            back_um, back_pa = each.depth_um[steps + 1 :], each.stress_pa[steps + 1 :, 0]
            same = np.abs(back_um[:, None] - each.depth_um[:steps]).argmin(axis=1)
            off_percent = 100 * (back_pa / each.stress_pa[same, 0] - 1)
            label = f"{stiffness_mpa_per_mm:g} MPa/mm"
            panel.plot(back_um, off_percent, label=label, **line(row))
        y = "SA, unloading / loading − 1 (%)" if formulation == NODE else ""
        finish(panel, "depth (µm)", y, title=formulation)
    return figure


def stiffness(runs: Runs) -> Finding:
    """Press with springs of each stiffness and extrapolate to rigid contact."""
    from pandas import DataFrame

    springs = np.array(STIFFNESS_QUICK if runs.quick else STIFFNESS)
    found = []
    for one in springs.tolist():
        runs.log(f"penalty: {one:g} MPa/mm")
        model = replace(model_of(QUICK), contact=Contact(stiffness_mpa_per_mm=one))
        found.append(indent(runs, f"penalty/{one:g}", model))
    stress_pa = np.array([each.last_pa for each in found])
    slope, rigid_pa = np.polyfit(1 / springs[-3:], stress_pa[-3:], 1)
    off_percent = 100 * (stress_pa / rigid_pa - 1)
    default = float(LADDER[0].stiffness_mpa_per_mm)
    at_default = off_percent[springs == default][0]
    # The last row is the limit, which is no spring.
    table = DataFrame({"stiffness": [*springs, "limit"]}, dtype=object)
    table[list(AFFERENTS)] = np.vstack([stress_pa, rigid_pa]) / 1000
    table[[f"{name}_percent" for name in AFFERENTS]] = np.vstack([off_percent, 0 * rigid_pa])
    behind = [100 * (1 - float(each.apex_um[-1]) / DEPTH_UM) for each in found]
    table["behind_percent"] = [*behind, 0.0]
    iterations: list[Any] = [*(each.cost.iterations for each in found), "–"]
    table["iterations"] = iterations
    figure, [panel] = panels(1)
    for row, name in enumerate(AFFERENTS):
        style = line(row, name=name, mark="dots")
        panel.plot(1 / springs, off_percent[:, row], label=name, **style)
        softest = 100 * slope[row] / rigid_pa[row] / springs[0]
        panel.plot([0, 1 / springs[0]], [0, softest], **line(row, name=name, mark="dashed"))
    finish(panel, "1 / K (mm/MPa)", "stress / limit − 1 (%)")
    worst = float(np.abs(at_default).max())
    what = f"{default:g} MPa/mm: stress furthest from rigid contact"
    return Finding(
        checks=(Check(what, worst, _STIFFNESS_BOUND_PERCENT, "%"),),
        tables={"penalty": table},
        numbers={
            "depth_um": DEPTH_UM,
            "softest": float(springs[0]),
            "stiffest": float(springs[-1]),
            "default": default,
            "off_percent": dict(zip(AFFERENTS, at_default.tolist(), strict=True)),
        },
        figure=figure,
    )


def laws(runs: Runs) -> Finding:
    """Press with both laws."""
    from pandas import DataFrame

    model = model_of(QUICK)
    stimulus = down(_LAW_DEPTH_UM, _LAW_STEPS_QUICK if runs.quick else _LAW_STEPS)
    found = {}
    for law in ("linear", NEO_HOOKEAN):
        runs.log(f"laws: {law}")
        found[law] = indent(runs, f"laws/{law}", model, stimulus, law=law)
    linear, other = found["linear"], found[NEO_HOOKEAN]
    depth_um = linear.depth_um[1:]
    off = 100 * (other.stress_pa[1:] / linear.stress_pa[1:] - 1)
    force_off = 100 * (other.force_n_per_mm[1:] / linear.force_n_per_mm[1:] - 1)
    at_rest = off[0] - (off[1] - off[0]) / (depth_um[1] - depth_um[0]) * depth_um[0]
    rows = [int(np.abs(depth_um - one).argmin()) for one in _LAW_TABLED_UM]
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
            Check("difference of stress, extrapolated to depth 0", worst, _LAW_BOUND_PERCENT, "%"),
        ),
        tables={"laws": table},
        numbers={
            "depth_um": _LAW_DEPTH_UM,
            "off_percent": dict(zip(AFFERENTS, off[-1].tolist(), strict=True)),
            "force_percent": float(force_off[-1]),
            "much_percent": _MUCH_PERCENT,
            "much_from_um": {
                name: float(depth_um[over.argmax()])
                for name, over in zip(AFFERENTS, much, strict=True)
                if over.any()
            },
            "steps": _LAW_STEPS,
            "steps_quick": _LAW_STEPS_QUICK,
        },
        figure=figure,
    )
