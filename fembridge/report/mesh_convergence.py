"""Study: how the stress at the afferents converges with the mesh, and to what.

A family of meshes made alike: every width of the `paper` finger's resolution times a
factor, every number of rows divided by it. `quick` is no member: it is finest where
the afferents are. The afferents' nodes are at the same point on all meshes.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from decks.analysis import Model
from decks.finger import Finger, Resolution
from decks.presets import PAPER, QUICK, model_of
from decks.refinement import refined as refined_mesh
from fembridge.errors import FingerError
from fembridge.report.extrapolation import Extrapolation, extrapolation, power_law_limit
from fembridge.report.indent import AFFERENTS, DEPTH_UM, Indented, indent
from fembridge.report.runs import Runs
from fembridge.report.study import Check, Finding, exact, finish, line, panels

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


@dataclass(frozen=True, slots=True)
class _Limit:
    """Of one afferent: between the fits of both orders, and how far they differ."""

    low_pa: float
    high_pa: float
    last_three: Extrapolation

    @property
    def middle_pa(self) -> float:
        return 0.5 * (self.low_pa + self.high_pa)

    @property
    def spread_percent(self) -> float:
        return abs(50 * (self.high_pa - self.low_pa) / self.middle_pa)

    def off_percent(self, stress_pa: float) -> float:
        return 100 * (stress_pa / self.middle_pa - 1)


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
    from pandas import DataFrame

    factors = FACTORS_QUICK if runs.quick else FACTORS
    family = [_pressed(runs, member(factor)) for factor in factors]
    presets = {"quick": _pressed(runs, QUICK), "paper": _pressed(runs, PAPER)}
    meshes = sorted([*family, presets["paper"]], key=lambda each: each.elements)
    limits = _limits([] if runs.quick else [m for m in meshes if m.elements > _FITTED_ELEMENTS])
    refined = _refined(runs)
    off = {
        name: [
            limit.off_percent(float(pa))
            for limit, pa in zip(limits.values(), each.last_pa, strict=True)
        ]
        for name, each in presets.items()
    }
    worst = max(limits, key=lambda name: limits[name].spread_percent)
    quick = presets["quick"]
    change = 100 * np.abs(refined[-1].last_pa / quick.last_pa - 1).max()
    names = ["`quick`", *("`paper`" if m is presets["paper"] else "family" for m in meshes)]
    table = _table([quick, *meshes])
    table.insert(0, "mesh", names)
    contact = _table([quick, *refined]).drop(columns="cpu_s")
    contact.insert(0, "cut_in", [1, 3, 9])
    return Finding(
        checks=tuple(
            Check(
                f"`{name}`: stress furthest from the limit",
                max(map(abs, by_afferent)),
                _BOUND_PERCENT[name],
                "%",
            )
            for name, by_afferent in off.items()
        ),
        tables={
            "mesh": table,
            "mesh_limit": DataFrame(
                {
                    "afferent": list(limits),
                    "limit_kpa": [each.middle_pa / 1000 for each in limits.values()],
                    "fits_differ_percent": [each.spread_percent for each in limits.values()],
                    "order": [each.last_three.order for each in limits.values()],
                    "index_percent": [
                        each.last_three.uncertainty_percent for each in limits.values()
                    ],
                    "quick_percent": off["quick"],
                    "paper_percent": off["paper"],
                }
            ),
            "mesh_contact": contact,
        },
        numbers={
            "depth_um": DEPTH_UM,
            "fitted_elements": _FITTED_ELEMENTS,
            "off_percent": {
                name: dict(zip(AFFERENTS, each, strict=True)) for name, each in off.items()
            },
            "worst": worst,
            "spread_percent": limits[worst].spread_percent,
            "touching": [quick.touching, meshes[-1].touching, refined[-1].touching],
            "refined_percent": float(change),
        },
        figure=_figure(meshes, presets, limits),
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


def _limits(fitted: Sequence[Indented]) -> dict[str, _Limit]:
    """Limits that the `fitted` meshes tend to; with none, those of a whole run."""
    if not fitted:
        unknown = Extrapolation(math.nan, math.nan, math.nan)
        known_pa = (1000 * LIMIT_KPA).tolist()
        return {n: _Limit(pa, pa, unknown) for n, pa in zip(AFFERENTS, known_pa, strict=True)}
    width = np.array([each.elements**-0.5 for each in fitted])
    stress_pa = np.array([each.last_pa for each in fitted])
    limits = {}
    for column, name in enumerate(AFFERENTS):
        ends_pa = [power_law_limit(width, stress_pa[:, column], p)[0] for p in ORDERS]
        last_three = extrapolation(width, stress_pa[:, column])
        limits[name] = _Limit(min(ends_pa), max(ends_pa), last_three)
    return limits


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

    return DataFrame(
        [
            (
                each.elements,
                *(each.last_pa / 1000).tolist(),
                1000 * float(each.force_n_per_mm[-1]),
                each.touching,
                each.cost.cpu_s,
            )
            for each in meshes
        ],
        columns=["elements", *AFFERENTS, "force", "touching", "cpu_s"],
    )


def _figure(
    meshes: list[Indented], presets: dict[str, Indented], limits: dict[str, _Limit]
) -> "Figure":
    elements = [each.elements for each in meshes]
    figure, all_panels = panels(len(limits))
    for column, (panel, (name, limit)) in enumerate(zip(all_panels, limits.items(), strict=True)):
        panel.plot(elements[:: len(elements) - 1], [0, 0], label="limit", **exact(dashed=True))
        off = [limit.off_percent(float(each.last_pa[column])) for each in meshes]
        panel.plot(elements, off, label=name, **line(1, name=name))
        for row, (preset, each) in enumerate(presets.items(), start=2):
            off_percent = limit.off_percent(float(each.last_pa[column]))
            panel.plot([each.elements], [off_percent], label=preset, **line(row, mark="dots"))
        finish(
            panel, "elements", "" if column else "stress above the limit (%)", title=name, log="x"
        )
    return figure
