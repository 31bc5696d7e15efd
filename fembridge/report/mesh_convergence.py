"""Study: how the stress at the afferents converges with the mesh, and to what.

A family of meshes made in one way: every width of the `paper` finger's resolution times a
factor, every number of rows divided by it. `quick` is no member: it is finest where
the afferents are. The afferents' nodes are at the same point on all meshes.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from decks.analysis import Model
from decks.finger import Finger, Resolution
from decks.mesh import refined as refined_mesh
from decks.presets import PAPER, QUICK, model_of
from fembridge.errors import FingerError
from fembridge.report.study import (
    DEPTH_UM,
    Check,
    Finding,
    Indented,
    Runs,
    exact,
    extrapolated,
    finish,
    indent,
    line,
    panels,
)
from fembridge.tables import AFFERENTS
from fembridge.typing import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

# Von Mises stress of SA, RA, PC at 200 um on an endless mesh: this study, whole run,
# with CalculiX 2.20.
LIMIT_KPA = np.array([31.43, 19.24, 1.018])

# The `paper` finger itself, 1, comes with them.
FACTORS = (3.4, 2.6, 1.8, 1.5, 1.2, 0.8, 0.66)
FACTORS_QUICK = (3.4, 1.5)
# Stress at a node is read from elements of first order beside it.
ORDERS = (1.0, 2.0)
# Coarser meshes do not follow a power law yet.
_FITTED_ELEMENTS = 8000
# The mesh is cut in three within these distances of the first touch, in turn.
_REFINED_MM = (0.2, 0.1)
_SAME_MM = 1.0e-6
_BOUND_PERCENT = {"quick": 10.0, "paper": 5.0}


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


def study(runs: Runs) -> Finding:
    """Press into each mesh, extrapolate, and judge both presets."""
    family = [_pressed(runs, member(each)) for each in (FACTORS_QUICK if runs.quick else FACTORS)]
    quick, paper = _pressed(runs, QUICK), _pressed(runs, PAPER)
    meshes = sorted([*family, paper], key=lambda each: each.elements)
    limits = _limits([] if runs.quick else [m for m in meshes if m.elements > _FITTED_ELEMENTS])
    for name, each in (("quick", quick), ("paper", paper)):
        limits[f"{name}_percent"] = _off_percent(each, limits)
    refined = _refined(runs)
    change_percent = 100 * np.abs(refined[-1].last_pa / quick.last_pa - 1).max()
    names = ["`quick`", *("`paper`" if mesh is paper else "family" for mesh in meshes)]
    table = _table([quick, *meshes])
    table.insert(0, "mesh", names)
    contact = _table([quick, *refined]).drop(columns="cpu_s")
    contact.insert(0, "cut_in", [1, 3, 9])
    worst = str(limits.fits_differ_percent.idxmax())
    return Finding(
        checks=tuple(
            Check(
                f"`{name}`: stress furthest from the limit",
                float(limits[f"{name}_percent"].abs().max()),
                bound_percent,
                "%",
            )
            for name, bound_percent in _BOUND_PERCENT.items()
        ),
        tables={
            "mesh": table,
            "mesh_limit": limits.rename_axis("afferent").reset_index(),
            "mesh_contact": contact,
        },
        numbers={
            "depth_um": DEPTH_UM,
            "fitted_elements": _FITTED_ELEMENTS,
            "off_percent": {n: limits[f"{n}_percent"].to_dict() for n in _BOUND_PERCENT},
            "worst": worst,
            "spread_percent": float(limits.fits_differ_percent[worst]),
            "touching": [quick.touching, meshes[-1].touching, refined[-1].touching],
            "refined_percent": float(change_percent),
        },
        figure=_figure(meshes, {"quick": quick, "paper": paper}, limits),
    )


def _pressed(runs: Runs, finger: Finger) -> Indented:
    model = model_of(finger)
    for name, site in finger.afferents.items():
        x_mm, y_mm = model.mesh.node_mm[model.mesh.node_at(site)].tolist()
        if math.hypot(x_mm - site.x_mm, y_mm + site.depth_mm) > _SAME_MM:
            raise FingerError(
                f"{finger.name}: {name} is at ({x_mm:g}, {y_mm:g}) mm, expected "
                f"({site.x_mm:g}, {-site.depth_mm:g}) as on the other meshes"
            )
    runs.log(f"mesh: {finger.name}, {len(model.mesh.quad)} elements")
    return indent(runs, f"mesh/{finger.name}", model)


def _limits(fitted: Sequence[Indented]) -> "DataFrame":
    """Limits that the `fitted` meshes tend to, by afferent; with none, those of a whole run.

    A limit is between the fits of both orders; order and index are of the last three meshes.
    """
    from pandas import DataFrame

    columns = ["limit_kpa", "fits_differ_percent", "order", "index_percent"]
    if not fitted:
        rows = [(kpa, 0.0, math.nan, math.nan) for kpa in LIMIT_KPA.tolist()]
        return DataFrame(rows, index=list(AFFERENTS), columns=columns)
    width = np.array([each.elements**-0.5 for each in fitted])
    stress_kpa = np.array([each.last_pa for each in fitted]) / 1000
    first, second = (np.polyfit(width**order, stress_kpa, 1)[1] for order in ORDERS)
    limit_kpa = 0.5 * (first + second)
    differ_percent = 100 * np.abs(second - first) / limit_kpa / 2
    orders, indices = zip(*(extrapolated(width, kpa)[1:] for kpa in stress_kpa.T), strict=True)
    values = (limit_kpa, differ_percent, orders, indices)
    return DataFrame(dict(zip(columns, values, strict=True)), index=list(AFFERENTS))


def _off_percent(mesh: Indented, limits: "DataFrame") -> FloatArray:
    """Difference of the stress ``(afferent,)`` from its limit."""
    off: FloatArray = 100 * (mesh.last_pa / 1000 / limits.limit_kpa.to_numpy() - 1)
    return off


def _refined(runs: Runs) -> list[Indented]:
    """Press into `quick` with elements a third, then a ninth as wide at the contact."""
    base = model_of(QUICK)
    mesh, found = base.mesh, []
    for number, radius_mm in enumerate(_REFINED_MM, start=1):
        mesh = refined_mesh(mesh, (0.0, 0.0), radius_mm)
        runs.log(f"mesh: quick, {len(mesh.quad)} elements")
        found.append(indent(runs, f"mesh/quick_refined_{number}", Model(base.finger, mesh)))
    return found


def _table(meshes: Sequence[Indented]) -> "DataFrame":
    from pandas import DataFrame

    rows = [
        (
            each.elements,
            *(each.last_pa / 1000).tolist(),
            1000 * float(each.force_n_per_mm[-1]),
            each.touching,
            each.cost.cpu_s,
        )
        for each in meshes
    ]
    return DataFrame(rows, columns=["elements", *AFFERENTS, "force", "touching", "cpu_s"])


def _figure(meshes: list[Indented], presets: dict[str, Indented], limits: "DataFrame") -> "Figure":
    elements = [each.elements for each in meshes]
    off_percent = np.array([_off_percent(each, limits) for each in meshes]).T
    figure, all_panels = panels(len(limits))
    for column, (panel, name) in enumerate(zip(all_panels, AFFERENTS, strict=True)):
        panel.plot(elements[:: len(elements) - 1], [0, 0], label="limit", **exact(dashed=True))
        panel.plot(elements, off_percent[column], label=name, **line(1, name=name))
        for row, (preset, each) in enumerate(presets.items(), start=2):
            off = [_off_percent(each, limits)[column]]
            panel.plot([each.elements], off, label=preset, **line(row, mark="dots"))
        y = "" if column else "stress above the limit (%)"
        finish(panel, "elements", y, title=name, log="x")
    return figure
