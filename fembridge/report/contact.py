"""Studies of the contact: which model comes back on its way out, and how stiff it has to be.

`models`: down to 250 µm and up again over the same depths, on the `quick` finger. Closure
is what `fembridge.response.acceptance` judges every response by: the largest difference
between unloading and loading at the same depth, in percent of the stress there.

`stiffness`: the stress at each afferent against the springs' stiffness K. What they give
goes with 1/K, so a straight line in 1/K through the stiffest ends at rigid contact.
"""

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from decks.analysis import Contact, Model
from decks.presets import QUICK, model_of
from fembridge.report.indent import (
    AFFERENTS,
    DEPTH_UM,
    Indented,
    attempt_indent,
    indent,
    read_indented,
    through,
)
from fembridge.report.runs import Cost, Runs
from fembridge.report.study import Check, Finding, finish, line, panels
from fembridge.response.acceptance import CLOSURE_PERCENT, judge
from fembridge.response.solve import LADDER
from fembridge.stimulus import Stimulus
from fembridge.typing import FloatArray

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


@dataclass(frozen=True, slots=True)
class _Tried:
    """One contact model; without a result where it did not converge."""

    element: str
    contact: Contact
    cost: Cost
    verdict: str
    indented: Indented | None = None
    closure_percent: float = math.nan

    @property
    def peak_pa(self) -> FloatArray:
        """Stress ``(afferent,)`` at the deepest point."""
        if self.indented is None:
            return np.full(len(AFFERENTS), np.nan)
        peak: FloatArray = self.indented.stress_pa[self.indented.depth_um.argmax()]
        return peak


def models(runs: Runs) -> Finding:
    """Try each contact model on the way down and back."""
    from pandas import DataFrame

    steps = _STEPS_QUICK if runs.quick else _STEPS
    down_um = np.round(np.linspace(0.0, DEEPEST_UM, steps + 1), 3)
    up_um = down_um[steps - _BACK_EVERY : 0 : -_BACK_EVERY]
    stimulus = through(np.concatenate([down_um, up_um]), "there_and_back")
    base, tried = model_of(QUICK), []
    for element, contact in _MODELS_QUICK if runs.quick else _MODELS:
        runs.log(f"contact: {element}, {contact}")
        tried.append(_try(runs, replace(base, element=element, contact=contact), stimulus))
    default = next(each for each in tried if (each.element, each.contact) == ("CPE4", LADDER[0]))
    by_node = [each for each in tried if each.contact.formulation == NODE]
    off = [
        each.closure_percent
        for each in tried
        if each.contact.formulation == SURFACE and each.indented is not None
    ]
    return Finding(
        checks=(
            Check(
                f"closure of the default, {default.contact}",
                default.closure_percent,
                CLOSURE_PERCENT,
                "%",
            ),
        ),
        tables={
            "contact": DataFrame(
                [_row(each) for each in tried],
                columns=[
                    *("element", "contact", "stiffness", "friction", "closure"),
                    *("iterations", "cpu_s", *AFFERENTS, "verdict"),
                ],
            )
        },
        numbers={
            "depth_um": DEEPEST_UM,
            "down": steps,
            "back": steps // _BACK_EVERY - 1,
            "allowed_percent": CLOSURE_PERCENT,
            "accepted": sum(each.verdict == "accepted" for each in by_node),
            "by_node": len(by_node),
            "iterations": default.cost.iterations,
            "surface_percent": [min(off), max(off)] if off else [],
            "unsolved": [f"{t.element}, {t.contact}" for t in by_node if t.indented is None],
            **_friction(tried),
        },
        figure=_models_figure(tried),
    )


def _try(runs: Runs, model: Model, stimulus: Stimulus) -> _Tried:
    contact = model.contact
    name = (
        f"contact/{model.element}_{contact.formulation}_{contact.stiffness_mpa_per_mm:g}"
        f"_{contact.friction:g}_{contact.stick_share:g}"
    )
    attempt = attempt_indent(runs, name, model, stimulus)
    if attempt.failure is not None:
        return _Tried(model.element, contact, attempt.cost, attempt.failure.cause.value)
    found = read_indented(attempt, model, stimulus)
    judged = judge(found.depth_um, found.stress_pa, found.force_n_per_mm, found.apex_um)
    verdict = "accepted" if judged.problem is None else "does not come back"
    return _Tried(
        model.element, contact, attempt.cost, verdict, found, float(judged.closure_percent)
    )


def _row(each: _Tried) -> tuple[str | int | float, ...]:
    contact = each.contact
    stick = f", stick {contact.stick_share:g}" if contact.stick_share != _STICK_SHARE else ""
    return (
        each.element,
        contact.formulation + stick,
        contact.stiffness_mpa_per_mm,
        contact.friction,
        each.closure_percent,
        each.cost.iterations,
        each.cost.cpu_s,
        *(each.peak_pa / 1000).tolist(),
        each.verdict,
    )


def _friction(tried: list[_Tried]) -> dict[str, float]:
    """How much friction changes the stress of the default model, if both were solved."""
    pair = {
        each.contact.friction: each.peak_pa
        for each in tried
        if (each.element, replace(each.contact, friction=0.4)) == ("CPE4", Contact(NODE, 200.0))
        and each.indented is not None
    }
    if len(pair) < 2:
        return {}
    return {"friction_percent": 100 * float(np.abs(pair[0.0] / pair[0.4] - 1).max())}


def _models_figure(tried: list[_Tried]) -> "Figure":
    """SA's stress on the way back against that on the way in, at the same depth."""
    figure, both = panels(2)
    for panel, formulation in zip(both, (NODE, SURFACE), strict=True):
        shown = [
            (each.contact, each.indented)
            for each in tried
            if each.indented is not None
            and (each.element, each.contact.formulation) == ("CPE4", formulation)
            and (each.contact.friction, each.contact.stick_share) == (0.4, _STICK_SHARE)
        ]
        for row, (contact, found) in enumerate(shown):
            deepest = int(found.depth_um.argmax())
            back_um, back_pa = found.depth_um[deepest + 1 :], found.stress_pa[deepest + 1 :, 0]
            in_um, in_pa = found.depth_um[:deepest], found.stress_pa[:deepest, 0]
            same = np.abs(back_um[:, None] - in_um).argmin(axis=1)
            label = f"{contact.stiffness_mpa_per_mm:g} MPa/mm"
            panel.plot(back_um, 100 * (back_pa / in_pa[same] - 1), label=label, **line(row))
        y = "SA, unloading / loading − 1 (%)" if formulation == NODE else ""
        finish(panel, "depth (µm)", y, title=formulation)
    return figure


def stiffness(runs: Runs) -> Finding:
    """Press with springs of each stiffness and extrapolate to rigid contact."""
    from pandas import DataFrame

    springs = np.array(STIFFNESS_QUICK if runs.quick else STIFFNESS)
    base = model_of(QUICK)
    found = []
    for one in springs.tolist():
        runs.log(f"penalty: {one:g} MPa/mm")
        model = replace(base, contact=Contact(stiffness_mpa_per_mm=one))
        found.append(indent(runs, f"penalty/{one:g}", model))
    stress_pa = np.array([each.last_pa for each in found])
    slope, rigid_pa = np.polyfit(1 / springs[-3:], stress_pa[-3:], 1)
    off_percent = 100 * (stress_pa / rigid_pa - 1)
    default = float(LADDER[0].stiffness_mpa_per_mm)
    at_default = off_percent[springs == default][0]
    table = DataFrame(
        [
            (
                one,
                *(pa / 1000).tolist(),
                *off.tolist(),
                100 * (1 - float(each.apex_um[-1]) / DEPTH_UM),
                each.cost.iterations,
            )
            for one, pa, off, each in zip(
                springs.tolist(), stress_pa, off_percent, found, strict=True
            )
        ],
        columns=[
            *("stiffness", *AFFERENTS, *(f"{n}_percent" for n in AFFERENTS)),
            *("behind_percent", "iterations"),
        ],
        dtype=object,  # the last row is the limit, which is no spring
    )
    table.loc[len(table)] = ["limit", *(rigid_pa / 1000).tolist(), 0.0, 0.0, 0.0, 0.0, "–"]
    figure, [panel] = panels(1)
    for row, name in enumerate(AFFERENTS):
        panel.plot(
            1 / springs, off_percent[:, row], label=name, **line(row, name=name, mark="dots")
        )
        softest = 100 * slope[row] / rigid_pa[row] / springs[0]
        panel.plot([0, 1 / springs[0]], [0, softest], **line(row, name=name, mark="dashed"))
    finish(panel, "1 / K (mm/MPa)", "stress / limit − 1 (%)")
    return Finding(
        checks=(
            Check(
                f"{default:g} MPa/mm: stress furthest from rigid contact",
                float(np.abs(at_default).max()),
                _STIFFNESS_BOUND_PERCENT,
                "%",
            ),
        ),
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
