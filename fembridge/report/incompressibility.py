"""Study: the element for a dermis with a Poisson's ratio of 0.48, on a ring and the finger.

The ring is thick, in plane strain; its inner side moves by `u` away from the middle, its
outer side is free:

    u_r = A r + B / r,  A = mu B / ((lambda + mu) b^2),  u = A a + B / a
    sigma_rr, sigma_tt = 2 (lambda + mu) A -/+ 2 mu B / r^2,  sigma_zz = 2 lambda A

(Timoshenko & Goodier, Theory of Elasticity, section 28). Towards a Poisson's ratio of
0.5 the ring's volume stays the same: A goes to 0 while its product with lambda stays
finite. An element that cannot keep its volume pays with a mean stress that is wrong.
"""

from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from decks.analysis import Model
from decks.finger import TABLE_1, AfferentSite, Material
from decks.presets import QUICK, model_of
from fembridge.report.plane import PlaneProblem
from fembridge.report.pressed_finger import LIMIT_KPA, member
from fembridge.report.study import (
    Check,
    Finding,
    Runs,
    down,
    finish,
    indent,
    line,
    panels,
)
from fembridge.results.stress import von_mises_pa
from fembridge.tables import AFFERENTS
from fembridge.trace import PA_PER_MPA
from fembridge.typing import FloatArray, IntArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

ELEMENTS = ("CPE4", "CPE4R", "CPE8R")
RING_ROWS, RING_ROWS_QUICK = (4, 8, 16, 32), (4, 8, 16)
RATIOS = (0.48, 0.499)
INNER_MM, OUTER_MM = 0.5, 2.0
MOVED_MM = -0.005
# The finger `quick`, and a member of the family of the study of meshes.
FACTORS, FACTORS_QUICK = (None, 1.5), (None,)
_BOUND_PERCENT = 3.0
# In the dermis, under the tip of a papilla: no afferent, a place that shows locking.
_SITES = {"DERMIS": AfferentSite("dermis", 0.125, 0.71)}
_CORNERS = 4
_STEPS = 5


def study(runs: Runs) -> Finding:
    """Solve the ring and the finger with each element."""
    from pandas import DataFrame

    all_rows = RING_ROWS_QUICK if runs.quick else RING_ROWS
    ring = DataFrame(
        [
            (ratio, element, rows, *_ring_errors(runs, element, rows, ratio))
            for ratio, element, rows in product(RATIOS, ELEMENTS, all_rows)
        ],
        columns=[
            *("poisson", "element", "across", "von_mises_percent"),
            *("mean_stress_percent", "mean_stress_by_point_percent"),
        ],
    )
    finest = ring[(ring.across == all_rows[-1]) & (ring.poisson == RATIOS[0])]
    errors = finest.set_index("element").von_mises_percent
    return Finding(
        checks=tuple(
            Check(
                f"ring, {element}, ν 0.48, {all_rows[-1]} elements across: von Mises stress",
                float(errors[element]),
                _BOUND_PERCENT,
                "%",
            )
            for element in ELEMENTS
        ),
        tables={"ring": ring, "finger_elements": _finger(runs)},
        figure=_figure(ring),
    )


def _figure(ring: "DataFrame") -> "Figure":
    """Errors against elements across; whole lines Poisson's ratio 0.48, dashed 0.499."""
    figure, both = panels(2)
    shown = {
        "von_mises_percent": "von Mises stress, error (%)",
        "mean_stress_by_point_percent": "mean stress, error (%)",
    }
    for panel, (column, title) in zip(both, shown.items(), strict=True):
        for (row, element), ratio in product(enumerate(ELEMENTS), RATIOS):
            mine = ring[(ring.poisson == ratio) & (ring.element == element)]
            whole = ratio == RATIOS[0]
            style = line(row, mark="both" if whole else "dashed")
            panel.plot(mine.across, mine[column], label=element if whole else None, **style)
        finish(panel, "elements across the ring", title, log="xy")
    return figure


def _ring_errors(runs: Runs, element: str, rows: int, ratio: float) -> tuple[float, float, float]:
    """Von Mises stress, mean stress of elements, and of points: largest errors in %."""
    material = Material(TABLE_1["dermis"].young_mpa, ratio)
    problem = ring_problem(element, rows, material)
    name = f"incompressible/ring_{element}_{rows}_{ratio:g}"
    _, found = problem.solve(runs, name)
    exact = _exact_pa(problem.node_mm[problem.element[:, :_CORNERS]], found.shape[1], material)
    worst = np.abs(von_mises_pa(found) - von_mises_pa(exact)).max()
    mean, exact_mean = found[..., :3].mean(-1), exact[..., :3].mean(-1)
    scale = von_mises_pa(exact).max()
    return (
        100 * float(worst / scale),
        100 * float(np.abs(mean.mean(1) - exact_mean.mean(1)).max() / scale),
        100 * float(np.abs(mean - exact_mean).max() / scale),
    )


def _exact_pa(corner_mm: FloatArray, points: int, material: Material) -> FloatArray:
    """Closed form ``(E, point, 6)`` at the integration points of elements.

    CalculiX gives a plane element a thickness of one layer: its points are those of
    the plane, one or four, first coordinate first, once or twice.
    """
    ends = np.array([0.0]) if points == 1 else np.array([-1.0, 1.0]) / np.sqrt(3)
    eta, xi = (each.ravel() for each in np.meshgrid(ends, ends, indexing="ij"))
    shape = 0.25 * np.stack(
        [(1 - xi) * (1 - eta), (1 + xi) * (1 - eta), (1 + xi) * (1 + eta), (1 - xi) * (1 + eta)], -1
    )
    at_mm = np.einsum("pc,ecx->epx", shape, corner_mm)
    at_mm = np.concatenate([at_mm] * (points // len(xi)), axis=1)
    radius_mm = np.linalg.norm(at_mm, axis=-1)
    radial, tangential, axial = np.moveaxis(ring_stress_mpa(radius_mm, material), -1, 0)
    cos, sin = np.moveaxis(at_mm / radius_mm[..., None], -1, 0)
    stress = np.zeros((*axial.shape, 6))
    stress[..., 0] = radial * cos**2 + tangential * sin**2
    stress[..., 1] = radial * sin**2 + tangential * cos**2
    stress[..., 2] = axial
    stress[..., 3] = (radial - tangential) * cos * sin
    return PA_PER_MPA * stress


def _finger(runs: Runs) -> "DataFrame":
    """Stress in kPa after pressing into each mesh with each element, and what it cost."""
    from pandas import DataFrame

    rows = []
    for factor in FACTORS_QUICK if runs.quick else FACTORS:
        base = model_of(QUICK if factor is None else member(factor))
        finger = replace(base.finger, afferents={**base.finger.afferents, **_SITES})
        count = len(base.mesh.quad)
        for element in ELEMENTS:
            runs.log(f"incompressible: {count} elements, {element}")
            model = Model(finger, base.mesh, element=element)
            name = f"incompressible/{finger.name}_{element}"
            each = indent(runs, name, model, down(steps=_STEPS))
            off_percent = each.last_pa[:-1] / 10 / LIMIT_KPA - 100
            kpa = (each.last_pa / 1000).tolist()
            rows.append((count, element, *kpa, *off_percent.tolist(), each.cost.cpu_s))
    return DataFrame(
        rows,
        columns=[
            *("elements", "element", *AFFERENTS, "dermis"),
            *(f"{name}_percent" for name in AFFERENTS),
            "cpu_s",
        ],
    )


def ring_stress_mpa(radius_mm: FloatArray, material: Material) -> FloatArray:
    """Radial, tangential and axial stress ``(..., 3)``."""
    shear_mpa, bulk_mpa = material.shear_mpa, material.bulk_mpa
    lame_mpa = bulk_mpa - 2 * shear_mpa / 3
    share = shear_mpa / ((bulk_mpa + shear_mpa / 3) * OUTER_MM**2)
    b = MOVED_MM / (share * INNER_MM + 1 / INNER_MM)
    a = share * b
    plane = 2 * (lame_mpa + shear_mpa) * a
    turn = 2 * shear_mpa * b / radius_mm**2
    axial = np.full_like(radius_mm, 2 * lame_mpa * a)
    return np.stack([plane - turn, plane + turn, axial], -1)


def ring_problem(kind: str, rows: int, material: Material) -> PlaneProblem:
    """A quarter of the ring with `rows` elements across the wall; the cuts slide."""
    quadratic = kind in ("CPE8", "CPE8R")
    step = 2 if quadratic else 1
    across, along = step * rows + 1, step * 2 * rows + 1
    share = np.linspace(0.0, 1.0, across)
    radius_mm = INNER_MM * (OUTER_MM / INNER_MM) ** share
    if quadratic:  # mid-sides in the middle of straight sides
        radius_mm[1::2] = 0.5 * (radius_mm[:-1:2] + radius_mm[2::2])
    angle = np.linspace(0.0, np.pi / 2, along)
    at = np.stack([np.outer(radius_mm, np.cos(angle)), np.outer(radius_mm, np.sin(angle))], -1)
    if quadratic:
        at[:, 1::2] = 0.5 * (at[:, :-1:2] + at[:, 2::2])
    element = _ring_elements(np.arange(across * along).reshape(across, along), quadratic)
    used, compact = np.unique(element, return_inverse=True)
    node_mm = at.reshape(-1, 2)[used]
    row, column = np.unravel_index(used, (across, along))
    moved_mm = np.full_like(node_mm, np.nan)  # NaN is free
    moved_mm[column == 0, 1] = 0.0
    moved_mm[column == along - 1, 0] = 0.0
    inner = row == 0
    moved_mm[inner] = MOVED_MM * node_mm[inner] / INNER_MM
    moved = np.flatnonzero(~np.isnan(moved_mm).all(axis=1))
    return PlaneProblem(
        kind=kind,
        node_mm=node_mm,
        element=compact.reshape(element.shape),
        materials=(material,),
        element_material=np.zeros(len(element), dtype=np.int64),
        moved=moved,
        moved_mm=moved_mm[moved],
    )


def _ring_elements(number: IntArray, quadratic: bool) -> IntArray:
    """Rows of nodes, counter-clockwise: outwards first, then along the ring."""
    step = 2 if quadratic else 1
    low, high = number[:-1:step, :-1:step], number[step::step, :-1:step]
    corners = [low, high, number[step::step, step::step], number[:-1:step, step::step]]
    if quadratic:
        corners += [number[1::2, :-1:2], number[2::2, 1::2], number[1::2, 2::2]]
        corners.append(number[:-1:2, 1::2])
    return np.stack([each.ravel() for each in corners], -1)
