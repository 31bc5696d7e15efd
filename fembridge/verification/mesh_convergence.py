"""Study: how the stress at the afferents converges with the mesh, and to what.

A family of meshes made alike: every width of the `paper` finger's resolution times a
factor, every number of rows divided by it. `quick` is no member: it is finest where
the afferents are. The afferents' nodes sit at the same point on all meshes.
"""

import math
from dataclasses import dataclass

import numpy as np

from decks.finger import Finger
from decks.meshing.refinement import refined as refined_mesh
from decks.presets import PAPER, QUICK
from fembridge.build import Model, model_of
from fembridge.errors import FingerError
from fembridge.typing import FloatArray
from fembridge.verification.bench import Bench
from fembridge.verification.extrapolation import Extrapolation, extrapolation, power_law_limit
from fembridge.verification.finding import Chart, Check, Finding, Line, NumberTable, Panel
from fembridge.verification.indent import AFFERENTS, DEPTH_UM, Indented, indent
from fembridge.verification.mesh_family import LIMIT_KPA, member

NAME = "mesh"
TITLE = "Convergence with the mesh"

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
        return 50 * (self.high_pa - self.low_pa) / self.middle_pa


def study(bench: Bench) -> Finding:
    """Press into each mesh, extrapolate, and judge both presets."""
    factors = FACTORS_QUICK if bench.quick else FACTORS
    family = [_pressed(bench, member(factor)) for factor in factors]
    presets = {"quick": _pressed(bench, QUICK), "paper": _pressed(bench, PAPER)}
    meshes = sorted([*family, presets["paper"]], key=lambda each: each.elements)
    fitted = [each for each in meshes if each.elements > _FITTED_ELEMENTS]
    limits = _known_limits() if bench.quick else _limits(fitted)
    refined = _refined(bench)
    errors = {
        name: {
            afferent: 100 * (float(each.last_pa[column]) / limits[afferent].middle_pa - 1)
            for column, afferent in enumerate(AFFERENTS)
        }
        for name, each in presets.items()
    }
    return Finding(
        name=NAME,
        title=TITLE,
        question=(
            f"The 1 mm cylinder goes {DEPTH_UM:g} µm into the finger, "
            "on meshes made alike from coarse to fine, and on both presets. How far is "
            "the stress at each afferent from that of an endless mesh?"
        ),
        words=_words(meshes, limits, errors, presets["quick"], refined),
        checks=tuple(
            Check(
                f"`{name}`: stress furthest from the limit",
                max(map(abs, by_afferent.values())),
                _BOUND_PERCENT[name],
                "%",
            )
            for name, by_afferent in errors.items()
        ),
        tables=(
            NumberTable(
                name="mesh",
                caption=f"Von Mises stress at {DEPTH_UM:g} µm in kPa, force in mN/mm, "
                "nodes of the skin that touch the probe",
                columns=("mesh", "elements", *AFFERENTS, "force", "touching", "cpu_s"),
                rows=tuple(_row(each, presets) for each in [presets["quick"], *meshes]),
                formats=("", "d", ".2f", ".2f", ".4f", ".3f", "d", ".0f"),
            ),
            NumberTable(
                name="mesh_limit",
                caption="Limit for an endless mesh in kPa: between fits "
                "`limit + c h` and `limit + c h²` to the family of meshes with more "
                f"than {_FITTED_ELEMENTS} elements; Richardson's order of the last "
                "three, and 1.25 times their estimated error (where they do not "
                "close in from one side: their spread); errors of the presets",
                columns=(
                    *("afferent", "limit_kpa", "fits_differ_percent", "order"),
                    *("index_percent", "quick_percent", "paper_percent"),
                ),
                rows=tuple(
                    (
                        name,
                        each.middle_pa / 1000,
                        abs(each.spread_percent),
                        each.last_three.order,
                        each.last_three.uncertainty_percent,
                        errors["quick"][name],
                        errors["paper"][name],
                    )
                    for name, each in limits.items()
                ),
                formats=("", ".3f", ".2f", ".2f", ".2f", "+.2f", "+.2f"),
            ),
            NumberTable(
                name="mesh_contact",
                caption="`quick` with its elements under the probe as they are, cut in "
                "three, and in nine: von Mises stress in kPa, force in mN/mm",
                columns=("cut_in", "elements", *AFFERENTS, "force", "touching"),
                rows=tuple(
                    (cut, *_row(each, {})[1:-1])
                    for cut, each in zip((1, 3, 9), (presets["quick"], *refined), strict=True)
                ),
                formats=("d", "d", ".2f", ".2f", ".4f", ".3f", "d"),
            ),
        ),
        charts=(_chart(meshes, presets, limits),),
        reduced="three meshes, 4 increments; limits are those of a whole run"
        if bench.quick
        else "",
        cost=bench.spent,
    )


def _pressed(bench: Bench, finger: Finger) -> Indented:
    model = model_of(finger)
    for name, site in finger.afferents.items():
        x_mm, y_mm = model.mesh.node_mm[model.mesh.node_at(site)].tolist()
        if math.hypot(x_mm - site.x_mm, y_mm + site.depth_mm) > _SAME_MM:
            raise FingerError(
                f"{finger.name}: {name} sits at ({x_mm:g}, {y_mm:g}) mm, expected "
                f"({site.x_mm:g}, {-site.depth_mm:g}) as on the other meshes"
            )
    bench.tell(f"{NAME}: {finger.name}, {len(model.mesh.quad)} elements")
    return indent(bench, f"{NAME}/{finger.name}", model)


def _known_limits() -> dict[str, _Limit]:
    """Give those of a whole run."""
    unknown = Extrapolation(math.nan, math.nan, math.nan)
    pa = (1000 * LIMIT_KPA).tolist()
    pairs = zip(AFFERENTS, pa, strict=True)
    return {name: _Limit(limit, limit, unknown) for name, limit in pairs}


def _limits(fitted: list[Indented]) -> dict[str, _Limit]:
    width = np.array([each.elements**-0.5 for each in fitted])
    stress_pa = np.array([each.last_pa for each in fitted])
    limits = {}
    for column, name in enumerate(AFFERENTS):
        ends_pa = [power_law_limit(width, stress_pa[:, column], p)[0] for p in ORDERS]
        limits[name] = _Limit(
            min(ends_pa), max(ends_pa), extrapolation(width, stress_pa[:, column])
        )
    return limits


def _row(each: Indented, presets: dict[str, Indented]) -> tuple[str | int | float, ...]:
    name = next((name for name, one in presets.items() if one is each), "family")
    kpa: FloatArray = each.last_pa / 1000
    return (
        f"`{name}`" if name != "family" else name,
        each.elements,
        *kpa.tolist(),
        1000 * float(each.force_n_per_mm[-1]),
        each.touching,
        each.cost.cpu_s,
    )


def _refined(bench: Bench) -> list[Indented]:
    """Press into `quick` with elements a third, then a ninth as wide at the contact."""
    base = model_of(QUICK)
    mesh, found = base.mesh, []
    for number, radius_mm in enumerate(_REFINED_MM, start=1):
        mesh = refined_mesh(mesh, (0.0, 0.0), radius_mm)
        bench.tell(f"{NAME}: quick, {len(mesh.quad)} elements")
        name = f"{NAME}/quick_refined_{number}"
        found.append(indent(bench, name, Model(base.finger, mesh)))
    return found


def _words(
    meshes: list[Indented],
    limits: dict[str, _Limit],
    errors: dict[str, dict[str, float]],
    quick: Indented,
    refined: list[Indented],
) -> tuple[str, ...]:
    told = {
        name: ", ".join(f"{afferent} {off:+.1f} %" for afferent, off in by.items())
        for name, by in errors.items()
    }
    worst = max(limits, key=lambda name: abs(limits[name].spread_percent))
    finest, change = refined[-1], refined[-1].last_pa / quick.last_pa - 1
    scatter = (
        f"The limit itself is known to about {abs(limits[worst].spread_percent):.1f} % "
        f"({worst}), by what the two fits differ, and to the scatter from mesh to "
        "mesh: SA and RA sit in stiff epidermis close to soft dermis, beside papillae, "
        "where stress is steep. Below 8 000 elements they follow no power law.",
    )
    known = limits[worst].spread_percent == 0  # a whole run's
    return (
        f"Errors against the limit: `quick` {told['quick']}; `paper` {told['paper']}.",
        *(() if known else scatter),
        f"What surprised: at {DEPTH_UM:g} µm only {quick.touching} node of `quick` "
        f"touches the probe, and {meshes[-1].touching} of the finest mesh. The top "
        "of a ridge has a radius of 0.13 mm, so that Hertz's contact with the probe is "
        "about 0.04 mm wide, one element of `quick`. It does not matter where the "
        "afferents are: with elements a ninth as wide under the probe, of which "
        f"{finest.touching} nodes touch, stress changes by "
        f"{100 * float(np.abs(change).max()):.2g} % at most (last table). Within a "
        "few of its widths from the contact it would.",
    )


def _chart(
    meshes: list[Indented], presets: dict[str, Indented], limits: dict[str, _Limit]
) -> Chart:
    elements = tuple(float(each.elements) for each in meshes)
    panels = []
    for column, name in enumerate(AFFERENTS):
        limit = limits[name].middle_pa
        off = tuple(100 * (float(m.last_pa[column]) / limit - 1) for m in meshes)
        marked = [
            Line(
                f"`{preset}`".strip("`"),
                (float(one.elements),),
                (100 * (float(one.last_pa[column]) / limit - 1),),
                "dots",
            )
            for preset, one in presets.items()
        ]
        panels.append(
            Panel(
                along="elements",
                up="stress above the limit (%)" if not column else "",
                lines=(
                    Line("limit", (elements[0], elements[-1]), (0.0, 0.0), "dashed"),
                    Line(name, elements, off),
                    *marked,
                ),
                log="x",
                title=name,
            )
        )
    return Chart(
        name="mesh",
        caption=f"Stress at {DEPTH_UM:g} µm against the extrapolated limit.",
        panels=tuple(panels),
    )
