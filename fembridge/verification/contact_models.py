"""Study: which contact model comes back on its way out, and what each costs.

Down to 250 µm and up again over the same depths, on the `quick` finger. Closure is
what `fembridge.response.acceptance` judges every response by: the largest difference
between unloading and loading at the same depth, in percent of the stress there.
"""

from dataclasses import dataclass, replace

import numpy as np

from decks.analysis import Contact
from decks.presets import QUICK
from fembridge.build import Model, model_of
from fembridge.response.acceptance import CLOSURE_PERCENT, Acceptance, judge
from fembridge.response.solve import LADDER
from fembridge.stimulus import Stimulus
from fembridge.verification.bench import Bench, Cost
from fembridge.verification.finding import Chart, Check, Finding, Line, NumberTable, Panel
from fembridge.verification.indent import AFFERENTS, Indented, attempt_indent, read_indented, way

NAME = "contact"
TITLE = "Contact models"

DEPTH_UM = 250.0
_STEPS, _STEPS_QUICK, _BACK_EVERY = 10, 6, 2
NODE, SURFACE = "node-to-surface", "surface-to-surface"
_ROWS = (
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
_ROWS_QUICK = (*_ROWS[1:3], *_ROWS[4:5], *_ROWS[7:8])


@dataclass(frozen=True, slots=True)
class _Tried:
    element: str
    contact: Contact
    cost: Cost
    indented: Indented | None
    judged: Acceptance | None
    problem: str

    @property
    def closure_percent(self) -> float:
        return float("nan") if self.judged is None else self.judged.closure_percent


def study(bench: Bench) -> Finding:
    """Try each model."""
    steps = _STEPS_QUICK if bench.quick else _STEPS
    base, stimulus = model_of(QUICK), _there_and_back(steps)
    tried = []
    for element, contact in _ROWS_QUICK if bench.quick else _ROWS:
        bench.tell(f"{NAME}: {element}, {contact}")
        model = replace(base, element=element, contact=contact)
        tried.append(_try(bench, model, stimulus))
    default = next(each for each in tried if (each.element, each.contact) == ("CPE4", LADDER[0]))
    return Finding(
        name=NAME,
        title=TITLE,
        question=(
            f"The `quick` finger under the 1 mm cylinder: {steps} increments down to "
            f"{DEPTH_UM:g} µm and {steps // _BACK_EVERY - 1} back. A response map is "
            "made only of a contact model that finds on its way up the stress that it "
            f"had at the same depth on its way down, within {CLOSURE_PERCENT:g} %."
        ),
        words=_words(tried, default),
        checks=(
            Check(
                f"closure of the default, {default.contact}",
                default.closure_percent,
                CLOSURE_PERCENT,
                "%",
            ),
        ),
        tables=(
            NumberTable(
                name="contact",
                caption="Closure in percent, cost, stress at the deepest point in kPa; "
                "1 iteration solves the equations once",
                columns=(
                    *("element", "contact", "stiffness", "friction", "closure"),
                    *("iterations", "cpu_s", *AFFERENTS, "verdict"),
                ),
                rows=tuple(_row(each) for each in tried),
                formats=("", "", "g", "g", ".3g", "d", ".0f", ".2f", ".2f", ".4f", ""),
            ),
        ),
        charts=(_chart(tried),),
        reduced="four of thirteen contact models, half the increments" if bench.quick else "",
        cost=bench.spent,
    )


def _there_and_back(steps: int) -> Stimulus:
    down_um = np.round(np.linspace(0.0, DEPTH_UM, steps + 1), 3)
    up_um = down_um[steps - _BACK_EVERY : 0 : -_BACK_EVERY]
    return way(np.concatenate([down_um, up_um]), "there_and_back")


def _try(bench: Bench, model: Model, stimulus: Stimulus) -> _Tried:
    contact = model.contact
    name = (
        f"{NAME}/{model.element}_{contact.formulation}_{contact.stiffness_mpa_per_mm:g}"
        f"_{contact.friction:g}_{contact.stick_share:g}"
    )
    attempt = attempt_indent(bench, name, model, stimulus)
    if attempt.failure is not None:
        problem = attempt.failure.cause.value
        return _Tried(model.element, contact, attempt.cost, None, None, problem)
    found = read_indented(attempt, model, stimulus)
    judged = judge(found.depth_um, found.stress_pa, found.force_n_per_mm, found.apex_um)
    return _Tried(
        model.element,
        contact,
        attempt.cost,
        found,
        judged,
        "accepted" if judged.problem is None else "does not come back",
    )


def _row(each: _Tried) -> tuple[str | int | float, ...]:
    contact, found = each.contact, each.indented
    peak_pa = [float("nan")] * len(AFFERENTS)
    if found is not None:
        peak_pa = found.stress_pa[found.depth_um.argmax()].tolist()
    stick = f", stick {contact.stick_share:g}" if contact.stick_share != 0.1 else ""
    return (
        each.element,
        contact.formulation + stick,
        contact.stiffness_mpa_per_mm,
        contact.friction,
        each.closure_percent,
        each.cost.iterations,
        each.cost.cpu_s,
        *(pa / 1000 for pa in peak_pa),
        each.problem,
    )


def _words(tried: list[_Tried], default: _Tried) -> tuple[str, ...]:
    by_node = [t for t in tried if t.contact.formulation == NODE]
    by_surface = [t for t in tried if t.contact.formulation == SURFACE]
    good = sum(t.problem == "accepted" for t in by_node)
    words = [
        f"Node to surface: {good} of {len(by_node)} accepted, with "
        f"{default.cost.iterations} iterations for the default."
    ]
    off = [t.closure_percent for t in by_surface if t.judged is not None]
    if off:
        words.append(
            f"Surface to surface remembers: {min(off):.2g} to {max(off):.2g} % off on "
            "the way back, with or without friction, the less the stiffer its springs, "
            "and with about twice the iterations. It stays at the end of the ladder, "
            "with 1000 MPa/mm and more. How much it remembers depends on the mesh: "
            "17 to 20 % were seen on an early one."
        )
    left = [t for t in by_node if t.judged is None]
    if left:
        words.append(
            f"Not solved: {'; '.join(f'{t.element}, {t.contact}' for t in left)}. A "
            "stiffer or a softer spring does converge: no rung alone is safe, which is "
            "why there is a ladder."
        )
    pair = {
        t.contact.friction: t.indented
        for t in tried
        if t.element == "CPE4"
        and t.contact.formulation == NODE
        and t.contact.stiffness_mpa_per_mm == 200.0
        and t.contact.stick_share == 0.1
        and t.indented is not None
    }
    if len(pair) == 2:
        with_it, without = (pair[f].stress_pa[pair[f].depth_um.argmax()] for f in (0.4, 0.0))
        worst = 100 * float(np.abs(without / with_it - 1).max())
        words.append(
            f"Friction changes the stress at the afferents by {worst:.2g} % at most: "
            "where one node or little more touches (study `mesh`), nothing can slip."
        )
    return tuple(words)


def _chart(tried: list[_Tried]) -> Chart:
    """Show the way back against the way in, of SA."""
    shown = [
        each
        for each in tried
        if each.indented is not None
        and each.element == "CPE4"
        and each.contact.friction
        and each.contact.stick_share == 0.1
    ]
    return Chart(
        name="contact",
        caption="Stress on the way back against that on the way in at the same depth, "
        "CPE4, friction 0.4. Left node to surface, right surface to surface; mind "
        "the scales.",
        panels=tuple(
            Panel(
                along="depth (µm)",
                up="SA, unloading / loading − 1 (%)" if formulation == NODE else "",
                lines=tuple(
                    _back(each) for each in shown if each.contact.formulation == formulation
                ),
                title=formulation,
            )
            for formulation in (NODE, SURFACE)
        ),
    )


def _back(each: _Tried) -> Line:
    found = each.indented
    assert found is not None  # only those are shown
    deepest = int(found.depth_um.argmax())
    rows = range(deepest + 1, found.depth_um.size)
    loading = [int(np.abs(found.depth_um[:deepest] - found.depth_um[r]).argmin()) for r in rows]
    off = 100 * (found.stress_pa[list(rows), 0] / found.stress_pa[loading, 0] - 1)
    return Line(
        f"{each.contact.stiffness_mpa_per_mm:g} MPa/mm",
        tuple(found.depth_um[list(rows)].tolist()),
        tuple(off.tolist()),
    )
