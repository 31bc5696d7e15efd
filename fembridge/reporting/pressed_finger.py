"""Studies of a finger under a probe: mesh, contact, material law, element.

`mesh`: convergence of the stress at the afferents with the mesh, and its limit. The meshes
form a family: every width of the `paper` finger's resolution times a factor, every number of
rows divided by it. `quick` is no member: it is finest near the afferents. The afferents'
nodes are at the same points on all meshes.

`contact_models`: indentation to 250 µm and back over the same depths, on the `quick` finger.
Closure is the criterion of `fembridge.response.indentation` for every response: the largest
difference between unloading and loading at the same depth, in percent of the stress there.

`stiffness`: stress at each afferent against the stiffness K of the contact springs. The
compression of the springs is proportional to 1/K, so a straight line in 1/K through the
stiffest springs ends at rigid contact.

`laws`: depth from which the material law matters. In decks the second Piola–Kirchhoff stress is
linear in Green's strain, with Table 1's moduli; a neo-Hookean skin has the same moduli at rest.

`incompressible`: the element for a dermis with a Poisson's ratio of 0.48, on the ring of
`fembridge.reporting.plane` and on the finger.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from pandas import DataFrame

from decks.contact_analysis import Contact, Model
from decks.dialects import LAWS
from decks.finger import AfferentSite, Finger, Resolution
from decks.mesh import refined
from decks.presets import PAPER, QUICK, model_of
from fembridge.errors import FingerError
from fembridge.reporting import plane
from fembridge.reporting.verification_runs import (
    DEPTH_UM,
    BoundCheck,
    Finding,
    Indented,
    Runs,
    depth_stimulus,
    exact,
    extrapolated,
    finish,
    indent,
    indentation_stimulus,
    line,
    panels,
    read_indented,
)
from fembridge.response.indentation import CLOSURE_PERCENT, LADDER, judge
from fembridge.stimulus import Stimulus
from fembridge.trace import AFFERENTS
from fembridge.typing import FloatArray

# Von Mises stress of SA, RA, PC at 200 um on an infinitely fine mesh: result of a full run of
# study `mesh` with CalculiX 2.20.
LIMIT_KPA = np.array([31.43, 19.24, 1.018])
# Factors of the family of meshes; the `paper` finger itself (factor 1) is added.
FACTORS, FACTORS_QUICK = (3.4, 2.6, 1.8, 1.5, 1.2, 0.8, 0.66), (3.4, 1.5)
# Orders of the fits: a node's stress comes from adjacent elements of first order.
ORDERS = (1.0, 2.0)
# Coarser meshes do not follow a power law.
FITTED_ELEMENTS = 8000
# The mesh is cut in three within these distances of the first touch, in turn.
_REFINED_MM = (0.2, 0.1)
_SAME_MM = 1.0e-6
_MESH_BOUND_PERCENT = {"quick": 10.0, "paper": 5.0}

# Contact models.
DEEPEST_UM = 250.0
NODE, SURFACE = "node-to-surface", "surface-to-surface"
# Stiffness.
STIFFNESS = (25.0, 50.0, 100.0, 200.0, 400.0, 800.0, 1600.0)
STIFFNESS_QUICK = (50.0, 100.0, 200.0, 400.0)

_CONTACT_STEPS, _CONTACT_STEPS_QUICK, _UNLOADING_STRIDE = 10, 6, 2
_STICK_SHARE = 0.1
_ACCEPTED = "accepted"
_CONTACTS = (
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
_CONTACTS_QUICK = (*_CONTACTS[1:3], *_CONTACTS[4:5], *_CONTACTS[7:8])
_STIFFNESS_BOUND_PERCENT = 3.0
_LAW_DEPTH_UM, _LAW_STEPS, _LAW_STEPS_QUICK = 400.0, 16, 8
_LAW_TABLED_UM = (50.0, 100.0, 200.0, 300.0, 400.0)
_LAW_BOUND_PERCENT = 0.5
LARGE_PERCENT = 5.0
# Meshes of study `incompressible`: the finger `quick` (None), and a member of the family.
_FACTORS, _FACTORS_QUICK = (None, 1.5), (None,)
# Additional site in the dermis under the tip of a papilla, where locking shows.
_SITES = {"DERMIS": AfferentSite("dermis", 0.125, 0.71)}
_ELEMENT_STEPS = 5


def member(factor: float) -> Finger:
    """Finger of the family: `paper` with elements `factor` times as wide everywhere."""
    if factor == 1.0:
        return PAPER
    paper = PAPER.resolution
    resolution = Resolution(
        contact_mm=paper.contact_mm * factor,
        contact_half_width_mm=paper.contact_half_width_mm,
        ridge_mm=paper.ridge_mm * factor,
        far_mm=paper.far_mm * factor,
        stratum_corneum_rows=round(paper.stratum_corneum_rows / factor),
        epidermis_rows=round(paper.epidermis_rows / factor),
        dermis_rows=round(paper.dermis_rows / factor),
    )
    return replace(PAPER, name=f"paper_x{factor:g}", resolution=resolution)


def mesh(runs: Runs) -> Finding:
    """Stress on each mesh, its extrapolated limits, and the errors of both presets."""
    family = [
        _press_mesh(runs, member(indented))
        for indented in (FACTORS_QUICK if runs.quick else FACTORS)
    ]
    presets = {"quick": _press_mesh(runs, QUICK), "paper": _press_mesh(runs, PAPER)}
    quick, paper = presets.values()
    meshes = sorted([*family, paper], key=lambda indented: indented.elements)
    limits = _limits([] if runs.quick else [m for m in meshes if m.elements > FITTED_ELEMENTS])
    for name, indented in presets.items():
        limits[f"{name}_percent"] = _difference_percent(indented, limits)
    names = ["`quick`", *("`paper`" if indented is paper else "family" for indented in meshes)]
    table = _table([quick, *meshes])
    table.insert(0, "mesh", names)
    contact = _table([quick, *_refined(runs)]).drop(columns="cpu_s")
    contact.insert(0, "cut_in", [1, 3, 9])
    return Finding(
        checks=tuple(
            BoundCheck(
                f"`{name}`: largest deviation of stress from the limit",
                float(limits[f"{name}_percent"].abs().max()),
                bound_percent,
                "%",
            )
            for name, bound_percent in _MESH_BOUND_PERCENT.items()
        ),
        tables={
            "mesh": table,
            "mesh_limit": limits.rename_axis("afferent").reset_index(),
            "mesh_contact": contact,
        },
        figure=_meshes_figure(meshes, presets, limits),
    )


def _press_mesh(runs: Runs, finger: Finger) -> Indented:
    model = model_of(finger)
    for name, site in finger.afferents.items():
        x_mm, y_mm = model.mesh.node_mm[model.mesh.node_at(site)].tolist()
        if math.hypot(x_mm - site.x_mm, y_mm + site.depth_mm) > _SAME_MM:
            raise FingerError(
                f"{finger.name}: {name} is at ({x_mm:g}, {y_mm:g}) mm, expected "
                f"({site.x_mm:g}, {-site.depth_mm:g}) mm as on the other meshes"
            )
    runs.log(f"mesh: solving {len(model.mesh.quad)} elements of {finger.name}")
    return indent(runs, f"mesh/{finger.name}", model)


def _limits(fitted: Sequence[Indented]) -> DataFrame:
    """Limits of the `fitted` meshes by afferent; without meshes, the limits of a full run.

    A limit is the mean of the fits of both orders; order and index are those of the last three
    meshes.
    """
    columns = ["limit_kpa", "fits_differ_percent", "order", "index_percent"]
    if not fitted:
        rows = [(kpa, 0.0, math.nan, math.nan) for kpa in LIMIT_KPA.tolist()]
        return DataFrame(rows, index=list(AFFERENTS), columns=columns)
    width = np.array([indented.elements**-0.5 for indented in fitted])
    stress_kpa = np.array([indented.last_pa for indented in fitted]) / 1000
    first, second = (np.polyfit(width**order, stress_kpa, 1)[1] for order in ORDERS)
    limit_kpa = 0.5 * (first + second)
    differ_percent = 100 * np.abs(second - first) / limit_kpa / 2
    orders, indices = zip(*(extrapolated(width, kpa)[1:] for kpa in stress_kpa.T), strict=True)
    values = (limit_kpa, differ_percent, orders, indices)
    return DataFrame(dict(zip(columns, values, strict=True)), index=list(AFFERENTS))


def _difference_percent(indented: Indented, limits: DataFrame) -> FloatArray:
    """Difference of the stress ``(afferent,)`` from its limit, in percent."""
    difference: FloatArray = 100 * (indented.last_pa / 1000 / limits.limit_kpa.to_numpy() - 1)
    return difference


def _refined(runs: Runs) -> list[Indented]:
    """Indentations of `quick` with elements a third and a ninth as wide at the contact."""
    base = model_of(QUICK)
    finer, results = base.mesh, []
    for number, radius_mm in enumerate(_REFINED_MM, start=1):
        finer = refined(finer, (0.0, 0.0), radius_mm)
        runs.log(f"mesh: solving {len(finer.quad)} elements of quick")
        results.append(indent(runs, f"mesh/quick_refined_{number}", Model(base.finger, finer)))
    return results


def _table(meshes: Sequence[Indented]) -> DataFrame:
    rows = [
        (
            indented.elements,
            *(indented.last_pa / 1000).tolist(),
            1000 * float(indented.force_n_per_mm[-1]),
            indented.touching,
            indented.cost.cpu_s,
        )
        for indented in meshes
    ]
    return DataFrame(rows, columns=["elements", *AFFERENTS, "force", "touching", "cpu_s"])


def _meshes_figure(
    meshes: list[Indented], presets: dict[str, Indented], limits: DataFrame
) -> Figure:
    elements = [indented.elements for indented in meshes]
    off_percent = np.array([_difference_percent(indented, limits) for indented in meshes]).T
    figure, all_panels = panels(len(limits))
    for column, (panel, name) in enumerate(zip(all_panels, AFFERENTS, strict=True)):
        panel.plot(elements[:: len(elements) - 1], [0, 0], label="limit", **exact(dashed=True))
        panel.plot(elements, off_percent[column], label=name, **line(1, name=name))
        for row, (preset, indented) in enumerate(presets.items(), start=2):
            off = [_difference_percent(indented, limits)[column]]
            panel.plot([indented.elements], off, label=preset, **line(row, mark="dots"))
        y = "" if column else "stress above the limit (%)"
        finish(panel, "elements", y, title=name, log="x")
    return figure


def contact_models(runs: Runs) -> Finding:
    """Closure, cost and stress of each contact model on loading and unloading."""
    steps = _CONTACT_STEPS_QUICK if runs.quick else _CONTACT_STEPS
    down_um = np.round(np.linspace(0.0, DEEPEST_UM, steps + 1), 3)
    up_um = down_um[steps - _UNLOADING_STRIDE : 0 : -_UNLOADING_STRIDE]
    stimulus = depth_stimulus(np.concatenate([down_um, up_um]), "there_and_back")
    models = _CONTACTS_QUICK if runs.quick else _CONTACTS
    rows, results = [], {}
    for element, contact in models:
        runs.log(f"contact: solving {element}, {contact}")
        model = replace(model_of(QUICK), element=element, contact=contact, support="prescribed")
        row, indented = _press_with_contact(runs, model, stimulus)
        rows.append(row)
        if indented is not None:
            results[element, contact] = indented
    table = DataFrame(rows)
    formulations = np.array([contact.formulation for _, contact in models])
    accepted = table.verdict[formulations == NODE] == _ACCEPTED
    default = table.iloc[models.index(("CPE4", LADDER[0]))]
    surface_percent = table.closure[formulations == SURFACE].dropna().tolist()
    numbers: dict[str, Any] = {
        "loading_steps": steps,
        "unloading_steps": steps // _UNLOADING_STRIDE - 1,
        "iterations": int(default.iterations),
        "node_to_surface": len(accepted),
        "node_to_surface_accepted": int(accepted.sum()),
        "surface_percent": [min(surface_percent), max(surface_percent)] if surface_percent else [],
        "unsolved": [
            f"{element}, {contact}"
            for element, contact in models
            if contact.formulation == NODE and (element, contact) not in results
        ],
    }
    with_friction, frictionless = (
        results.get(("CPE4", Contact(NODE, 200.0, friction=f))) for f in (0.4, 0.0)
    )
    if with_friction is not None and frictionless is not None:
        share = frictionless.stress_pa[steps] / with_friction.stress_pa[steps]
        numbers["friction_percent"] = 100 * float(np.abs(share - 1).max())
    check_name = f"closure of the default, {LADDER[0]}"
    return Finding(
        checks=(BoundCheck(check_name, float(default.closure), CLOSURE_PERCENT, "%"),),
        tables={"contact": table},
        numbers=numbers,
        figure=_contacts_figure(results, steps),
    )


def _press_with_contact(
    runs: Runs, model: Model, stimulus: Stimulus
) -> tuple[dict[str, Any], Indented | None]:
    """Row of the table, and the indentation; None if the model did not converge."""
    contact = model.contact
    name = (
        f"contact/{model.element}_{contact.formulation}_{contact.stiffness_mpa_per_mm:g}"
        f"_{contact.friction:g}_{contact.stick_share:g}"
    )
    attempt = runs.attempt(name, model, stimulus)
    indented, closure_percent, peak_pa = None, math.nan, np.full(len(AFFERENTS), np.nan)
    if attempt.failure is not None:
        verdict = attempt.failure.cause.value
    else:
        indented = read_indented(attempt, model, stimulus)
        peak_pa = indented.stress_pa[indented.depth_um.argmax()]
        closure_percent, refusal = judge(
            indented.depth_um, indented.stress_pa, indented.force_n_per_mm, indented.apex_um
        )
        verdict = _ACCEPTED if refusal is None else "path-dependent"
    stick = f", stick {contact.stick_share:g}" if contact.stick_share != _STICK_SHARE else ""
    return {
        "element": model.element,
        "contact": contact.formulation + stick,
        "stiffness": contact.stiffness_mpa_per_mm,
        "friction": contact.friction,
        "closure": closure_percent,
        "iterations": attempt.cost.iterations,
        "cpu_s": attempt.cost.cpu_s,
        **dict(zip(AFFERENTS, (peak_pa / 1000).tolist(), strict=True)),
        "verdict": verdict,
    }, indented


def _contacts_figure(results: dict[tuple[str, Contact], Indented], steps: int) -> Figure:
    """SA's stress on unloading relative to loading at the same depth."""
    figure, both_panels = panels(2)
    for panel, formulation in zip(both_panels, (NODE, SURFACE), strict=True):
        series = [
            (contact.stiffness_mpa_per_mm, indented)
            for (element, contact), indented in results.items()
            if (element, contact) == ("CPE4", Contact(formulation, contact.stiffness_mpa_per_mm))
        ]
        for row, (stiffness_mpa_per_mm, indented) in enumerate(series):
            unloading_um, unloading_pa = (
                indented.depth_um[steps + 1 :],
                indented.stress_pa[steps + 1 :, 0],
            )
            loading_row = np.abs(unloading_um[:, None] - indented.depth_um[:steps]).argmin(axis=1)
            off_percent = 100 * (unloading_pa / indented.stress_pa[loading_row, 0] - 1)
            label = f"{stiffness_mpa_per_mm:g} MPa/mm"
            panel.plot(unloading_um, off_percent, label=label, **line(row))
        y = "SA, unloading / loading − 1 (%)" if formulation == NODE else ""
        finish(panel, "depth (µm)", y, title=formulation)
    return figure


def stiffness(runs: Runs) -> Finding:
    """Stress with springs of each stiffness, and its limit for rigid contact."""
    springs = np.array(STIFFNESS_QUICK if runs.quick else STIFFNESS)
    results = []
    for stiffness_mpa_per_mm in springs.tolist():
        runs.log(f"penalty: solving {stiffness_mpa_per_mm:g} MPa/mm")
        model = replace(model_of(QUICK), contact=Contact(stiffness_mpa_per_mm=stiffness_mpa_per_mm))
        results.append(indent(runs, f"penalty/{stiffness_mpa_per_mm:g}", model))
    stress_pa = np.array([indented.last_pa for indented in results])
    slope, rigid_pa = np.polyfit(1 / springs[-3:], stress_pa[-3:], 1)
    off_percent = 100 * (stress_pa / rigid_pa - 1)
    default = float(LADDER[0].stiffness_mpa_per_mm)
    at_default = off_percent[springs == default][0]
    # The last row is the limit for rigid contact.
    table = DataFrame({"stiffness": [*springs, "limit"]}, dtype=object)
    table[list(AFFERENTS)] = np.vstack([stress_pa, rigid_pa]) / 1000
    table[[f"{name}_percent" for name in AFFERENTS]] = np.vstack([off_percent, 0 * rigid_pa])
    compression_percent = [
        100 * (1 - float(indented.apex_um[-1]) / DEPTH_UM) for indented in results
    ]
    table["behind_percent"] = [*compression_percent, 0.0]
    iterations: list[Any] = [*(indented.cost.iterations for indented in results), "–"]
    table["iterations"] = iterations
    figure, [panel] = panels(1)
    for row, name in enumerate(AFFERENTS):
        style = line(row, name=name, mark="dots")
        panel.plot(1 / springs, off_percent[:, row], label=name, **style)
        softest = 100 * slope[row] / rigid_pa[row] / springs[0]
        panel.plot([0, 1 / springs[0]], [0, softest], **line(row, name=name, mark="dashed"))
    finish(panel, "1 / K (mm/MPa)", "stress / limit − 1 (%)")
    worst = float(np.abs(at_default).max())
    check_name = f"{default:g} MPa/mm: largest deviation of stress from rigid contact"
    return Finding(
        checks=(BoundCheck(check_name, worst, _STIFFNESS_BOUND_PERCENT, "%"),),
        tables={"penalty": table},
        numbers={
            "default": default,
            "off_percent": dict(zip(AFFERENTS, at_default.tolist(), strict=True)),
        },
        figure=figure,
    )


def laws(runs: Runs) -> Finding:
    """Stress with both material laws."""
    model = model_of(QUICK)
    stimulus = indentation_stimulus(_LAW_DEPTH_UM, _LAW_STEPS_QUICK if runs.quick else _LAW_STEPS)
    results = {}
    for law in LAWS:
        runs.log(f"laws: solving the {law} law")
        results[law] = indent(runs, f"laws/{law}", model, stimulus, law=law)
    linear, neo_hookean = results.values()
    depth_um = linear.depth_um[1:]
    off = 100 * (neo_hookean.stress_pa[1:] / linear.stress_pa[1:] - 1)
    force_off = 100 * (neo_hookean.force_n_per_mm[1:] / linear.force_n_per_mm[1:] - 1)
    at_rest = off[0] - (off[1] - off[0]) / (depth_um[1] - depth_um[0]) * depth_um[0]
    rows = [int(np.abs(depth_um - tabled_um).argmin()) for tabled_um in _LAW_TABLED_UM]
    much = (np.abs(off) > LARGE_PERCENT).T
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
            BoundCheck(
                "difference of stress, extrapolated to depth 0", worst, _LAW_BOUND_PERCENT, "%"
            ),
        ),
        tables={"laws": table},
        numbers={
            "large_difference_from_um": {
                name: float(depth_um[is_above.argmax()])
                for name, is_above in zip(AFFERENTS, much, strict=True)
                if is_above.any()
            }
        },
        figure=figure,
    )


def incompressible(runs: Runs) -> Finding:
    """Errors of the ring, and stress in the finger, with each element."""
    finding = plane.ring(runs)
    return replace(finding, tables={**finding.tables, "finger_elements": _elements(runs)})


def _elements(runs: Runs) -> DataFrame:
    """Stress in kPa and processor time, with each mesh and element."""
    rows = []
    for factor in _FACTORS_QUICK if runs.quick else _FACTORS:
        base = model_of(QUICK if factor is None else member(factor))
        finger = replace(base.finger, afferents={**base.finger.afferents, **_SITES})
        count = len(base.mesh.quad)
        for element in plane.RING_ELEMENTS:
            runs.log(f"incompressible: solving {count} elements, {element}")
            model = Model(finger, base.mesh, element=element)
            name = f"incompressible/{finger.name}_{element}"
            indented = indent(runs, name, model, indentation_stimulus(steps=_ELEMENT_STEPS))
            difference_percent = indented.last_pa[:-1] / 10 / LIMIT_KPA - 100
            kpa = (indented.last_pa / 1000).tolist()
            rows.append((count, element, *kpa, *difference_percent.tolist(), indented.cost.cpu_s))
    return DataFrame(
        rows,
        columns=[
            *("elements", "element", *AFFERENTS, "dermis"),
            *(f"{name}_percent" for name in AFFERENTS),
            "cpu_s",
        ],
    )
