"""Study: the element for a dermis with a Poisson's ratio of 0.48.

Twice: on a ring with a closed form, and on the finger.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from decks.dialects import JOB
from decks.finger import AfferentSite
from decks.material import TABLE_1, Material
from decks.presets import QUICK
from fembridge.build import Model, model_of
from fembridge.results.printed.dat import read_point_stress
from fembridge.results.stress import von_mises_pa
from fembridge.typing import FloatArray
from fembridge.verification.bench import Bench
from fembridge.verification.finding import Chart, Check, Finding, Line, NumberTable, Panel
from fembridge.verification.indent import AFFERENTS, DEPTH_UM, Indented, down, indent
from fembridge.verification.mesh_family import LIMIT_KPA, member
from fembridge.verification.plane_deck import PRINTED
from fembridge.verification.ring import ring_problem, ring_stress_mpa

NAME = "incompressible"
TITLE = "A nearly incompressible dermis"

ELEMENTS = ("CPE4", "CPE4R", "CPE8R")
RING_ROWS, RING_ROWS_QUICK = (4, 8, 16, 32), (4, 8, 16)
RATIOS = (0.48, 0.499)
# The finger `quick`, and a member of the family of the study of meshes.
FACTORS, FACTORS_QUICK = (None, 1.5), (None,)
_BOUND_PERCENT = 3.0
# In the dermis, under the tip of a papilla: no afferent, a place that shows locking.
_SITES = {"DERMIS": AfferentSite("dermis", 0.125, 0.71)}
_PA_PER_MPA = 1.0e6
_CORNERS = 4
_STEPS = 5


def study(bench: Bench) -> Finding:
    """Solve the ring and the finger with each element."""
    ring = [
        (ratio, element, rows, *_ring_errors(bench, element, rows, ratio))
        for ratio in RATIOS
        for element in ELEMENTS
        for rows in (RING_ROWS_QUICK if bench.quick else RING_ROWS)
    ]
    finger = {
        (elements, element): each
        for factor in (FACTORS_QUICK if bench.quick else FACTORS)
        for elements, element, each in _pressed(bench, factor)
    }
    finest = max(row[2] for row in ring)
    return Finding(
        name=NAME,
        title=TITLE,
        question=(
            "Elements that are integrated in full can lock where the material keeps "
            "its volume: too stiff, with a mean stress that jumps. First a thick ring "
            "whose inner side is moved inwards, in plane strain, whose stress is "
            f"known in closed form; then the finger at {DEPTH_UM:g} µm, with each "
            "element throughout."
        ),
        words=_words(ring, finger),
        checks=(
            *(
                Check(
                    f"ring, {element}, ν 0.48, {finest} elements across: von Mises stress",
                    next(row[3] for row in ring if row[:3] == (0.48, element, finest)),
                    _BOUND_PERCENT,
                    "%",
                )
                for element in ELEMENTS
            ),
        ),
        tables=(
            NumberTable(
                name="ring",
                caption="Ring: largest error of stress at integration points, in "
                "percent of the largest von Mises stress; mean stress (of the three "
                "normal ones) as a mean over each element and point by point",
                columns=(
                    *("poisson", "element", "across", "von_mises_percent"),
                    *("mean_stress_percent", "mean_stress_by_point_percent"),
                ),
                rows=tuple(ring),
                formats=("g", "", "d", ".2f", ".2f", ".2f"),
            ),
            NumberTable(
                name="finger_elements",
                caption="Finger: von Mises stress in kPa; dermis: at the node "
                "nearest to 0.1 mm under the tip of a papilla; in percent: "
                "difference from the limits that study `mesh` found with CPE4",
                columns=(
                    *("elements", "element", *AFFERENTS, "dermis"),
                    *(f"{name}_percent" for name in AFFERENTS),
                    "cpu_s",
                ),
                rows=tuple(
                    (
                        elements,
                        element,
                        *(each.last_pa / 1000).tolist(),
                        *(each.last_pa[:-1] / 10 / LIMIT_KPA - 100).tolist(),
                        each.cost.cpu_s,
                    )
                    for (elements, element), each in finger.items()
                ),
                formats=("d", "", ".2f", ".2f", ".4f", ".3f", *["+.1f"] * 3, ".0f"),
            ),
        ),
        charts=(_chart(ring),),
        reduced="rings to 16 elements across; `quick` finger alone" if bench.quick else "",
        cost=bench.spent,
    )


def _ring_errors(bench: Bench, element: str, rows: int, ratio: float) -> tuple[float, float, float]:
    """Von Mises stress, mean stress of elements, and of points: largest errors in %."""
    material = Material(TABLE_1["dermis"].young_mpa, ratio)
    problem = ring_problem(element, rows, material)
    folder = bench.solve_deck(f"{NAME}/ring_{element}_{rows}_{ratio:g}", problem.deck())
    _, _, tensor_pa = read_point_stress(folder.folder / f"{JOB}.dat", PRINTED)
    found = tensor_pa[0].reshape(len(problem.element), -1, 6)
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
    """Give the closed form ``(E, point, 6)`` at the integration points of elements.

    CalculiX gives a plane element a thickness of one layer: its points are those of
    the plane, one or four, first coordinate first, once or twice.
    """
    at_mm = _points_mm(corner_mm, points)
    radius_mm = np.linalg.norm(at_mm, axis=-1)
    radial, tangential, axial = np.moveaxis(ring_stress_mpa(radius_mm, material), -1, 0)
    cos, sin = np.moveaxis(at_mm / radius_mm[..., None], -1, 0)
    zero = np.zeros_like(axial)
    return _PA_PER_MPA * np.stack(
        [
            radial * cos**2 + tangential * sin**2,
            radial * sin**2 + tangential * cos**2,
            axial,
            (radial - tangential) * cos * sin,
            zero,
            zero,
        ],
        -1,
    )


def _points_mm(corner_mm: FloatArray, points: int) -> FloatArray:
    """Places ``(E, point, 2)`` of the integration points of bilinear quadrilaterals."""
    ends = np.array([0.0]) if points == 1 else np.array([-1.0, 1.0]) / np.sqrt(3)
    eta, xi = (each.ravel() for each in np.meshgrid(ends, ends, indexing="ij"))
    shape = 0.25 * np.stack(
        [(1 - xi) * (1 - eta), (1 + xi) * (1 - eta), (1 + xi) * (1 + eta), (1 - xi) * (1 + eta)], -1
    )
    at_mm: FloatArray = np.einsum("pc,ecx->epx", shape, corner_mm)
    return np.concatenate([at_mm] * (points // len(xi)), axis=1)


def _pressed(bench: Bench, factor: float | None) -> Iterator[tuple[int, str, Indented]]:
    """Press into one mesh with each element; give elements, their name, the result."""
    base = model_of(QUICK if factor is None else member(factor))
    finger = replace(base.finger, afferents={**base.finger.afferents, **_SITES})
    count = len(base.mesh.quad)
    for element in ELEMENTS:
        bench.tell(f"{NAME}: {count} elements, {element}")
        model = Model(finger, base.mesh, element=element)
        name = f"{NAME}/{finger.name}_{element}"
        yield count, element, indent(bench, name, model, down(steps=_STEPS))


def _words(
    ring: Sequence[tuple[float, str, int, float, float, float]],
    finger: Mapping[tuple[int, str], Indented],
) -> tuple[str, ...]:
    finest = max(row[2] for row in ring)
    at = {row[:2]: row for row in ring if row[2] == finest}
    count = max(elements for elements, _ in finger)
    best = finger[count, "CPE8R"]
    dermis = {
        element: 100 * float(finger[count, element].last_pa[-1] / best.last_pa[-1] - 1)
        for element in ELEMENTS[:2]
    }
    dearer = best.cost.cpu_s / finger[count, "CPE4"].cost.cpu_s
    return (
        f"The ring, {finest} elements across: CPE4's mean stress jumps from point to "
        f"point by {at[0.48, 'CPE4'][5]:.0f} % of the von Mises stress at Poisson's "
        f"ratio 0.48 and by {at[0.499, 'CPE4'][5]:.0f} % at 0.499, since CalculiX "
        "integrates the change of volume in full (study `solver`); averaged over an "
        f"element {at[0.48, 'CPE4'][4]:.2g} % are left at 0.48. Its von Mises "
        "stress, in which mean stress has no part, is off by "
        f"{at[0.48, 'CPE4'][3]:.1f} % at either ratio and converges to first order. "
        "CPE4R and CPE8R have none of it.",
        "The finger: no element is the best for every afferent. SA comes from below "
        "with elements of first order and from above with CPE8R, and what all of them "
        "tend to lies between. The dermis right under a papilla is another matter: "
        f"with {count} elements CPE4 is {dermis['CPE4']:.0f} % above CPE8R, and CPE4R, "
        f"which cannot lock, {dermis['CPE4R']:.0f} %. So it is not locking but the "
        "size of elements beside a layer 40 times as stiff.",
        "The choice: afferents read von Mises stress, in the epidermis (Poisson's "
        "ratio 0.3) and in the subcutaneous tissue (0.4). There CPE4 is as near to the "
        f"limit as CPE8R, which takes {dearer:.0f} times as long, and it passes the "
        "patch test, which CPE4R does not on distorted elements. So CPE4 is the "
        "default. **What reads stress in the dermis needs a finer mesh and "
        "`--element CPE8R`; what reads mean stress there (strain energy) must not "
        "take CPE4.**",
    )


def _chart(ring: list[tuple[float, str, int, float, float, float]]) -> Chart:
    panels = []
    for column, up in ((3, "von Mises stress, error (%)"), (5, "mean stress, error (%)")):
        lines = [
            Line(
                element,
                tuple(float(row[2]) for row in ring if row[:2] == (ratio, element)),
                tuple(float(row[column]) for row in ring if row[:2] == (ratio, element)),
                "both" if ratio == RATIOS[0] else "dashed",
            )
            for element in ELEMENTS
            for ratio in RATIOS
        ]
        panels.append(Panel("elements across the ring", up, tuple(lines), log="xy"))
    return Chart(
        name="incompressible",
        caption="Ring: largest error at any integration point, whole lines Poisson's "
        "ratio 0.48, dashed 0.499.",
        panels=tuple(panels),
    )
