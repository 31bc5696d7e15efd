"""Study: the patch test. Elements of any shape under a linear displacement.

All nodes of the rim follow ``u = G x``; those inside are free. Whatever the shape of
the elements, strain is that of G everywhere, and stress has a closed form, for small
strain and for both laws of large strain.
"""

from dataclasses import dataclass

import numpy as np

from decks.dialects import JOB
from decks.material import TABLE_1
from decks.meshing.mesh import Mesh
from fembridge.results.frd import read_displacement
from fembridge.results.printed.dat import read_point_stress
from fembridge.typing import BoolArray, FloatArray
from fembridge.verification.bench import Bench
from fembridge.verification.finding import Check, Finding, NumberTable
from fembridge.verification.plane_deck import NEO_HOOKEAN, PRINTED, PlaneProblem, uniform_stress_mpa

NAME = "patch"
TITLE = "Patch test"

MATERIAL = TABLE_1["dermis"]
SMALL = np.array([[2e-3, -1e-3], [4e-3, 1.5e-3]])
LARGE = np.array([[0.20, -0.10], [0.15, -0.25]])
BOUND = 1.0e-6
# Five quads, none a parallelogram: one within a rectangle, turned and shifted.
_DISTORTED = Mesh(
    np.array(
        [
            *([0, 0], [2.4, 0], [2.4, 1.2], [0, 1.2]),
            *([0.4, 0.2], [1.8, 0.3], [1.6, 0.8], [0.8, 0.8]),
        ]
    ),
    np.array([[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7], [4, 5, 6, 7]]),
    np.full(5, 2),
)
_MM_A_PA = 1.0e-6
_INCREMENTS = 4


@dataclass(frozen=True, slots=True)
class _Case:
    element: str
    mesh: str
    law: str
    large: bool

    @property
    def strain(self) -> str:
        if not self.large:
            return "small, Hooke"
        return f"large, {'neo-Hookean' if self.law == NEO_HOOKEAN else 'linear law'}"


_SHAPES = (
    *((element, "distorted") for element in ("CPE4", "CPE8", "CPE8R", "CPE4R")),
    ("CPE4R", "parallelograms"),
)
_LAWS = (("linear", False), ("linear", True), (NEO_HOOKEAN, True))
# Its control of hourglasses answers to a linear displacement as well.
_EXPECTED_TO_FAIL = ("CPE4R", "distorted")


def study(bench: Bench) -> Finding:
    """Solve each case; errors are shares of the largest component."""
    rows, worst, failed = [], 0.0, 0.0
    for element, mesh in _SHAPES:
        for law, large in _LAWS:
            case = _Case(element, mesh, law, large)
            off_mm, off_share = _solved(bench, case)
            rows.append((element, mesh, case.strain, off_mm, off_share))
            if (element, mesh) == _EXPECTED_TO_FAIL:
                failed = max(failed, off_share)
            else:
                worst = max(worst, off_share)
    return Finding(
        name=NAME,
        title=TITLE,
        question=(
            "Five quadrilaterals, none a parallelogram, whose rim follows a linear "
            "displacement: every integration point must carry the one stress of the "
            "closed form, with small strain (0.4 %) and with large strain (stretched "
            "by 20 %, squeezed by 25 %, sheared and turned), for both laws of "
            "materials that decks have. Dermis, Poisson's ratio 0.48."
        ),
        words=(
            "CPE4, CPE8 and CPE8R pass with any shape and either law.",
            f"CPE4R does not pass on distorted quadrilaterals ({100 * failed:.2g} % of "
            "the largest component): CalculiX's control of hourglasses also answers "
            "to a linear displacement. On parallelograms it passes. It is not used "
            "by any deck unless asked for.",
        ),
        checks=(
            Check(
                "largest error of stress, CPE4R on distorted quadrilaterals left out", worst, BOUND
            ),
        ),
        tables=(
            NumberTable(
                name="patch",
                caption="Largest error of displacement inside, and of stress at "
                "integration points as a share of its largest component",
                columns=("element", "patch", "strain", "displacement_mm", "stress"),
                rows=tuple(rows),
                formats=("", "", "", ".1e", ".1e"),
            ),
        ),
        cost=bench.spent,
    )


def _solved(bench: Bench, case: _Case) -> tuple[float, float]:
    """Give the largest error of displacement in mm, and of stress as a share."""
    mesh = _DISTORTED if case.mesh == "distorted" else _parallelograms()
    gradient = LARGE if case.large else SMALL
    node_mm, element = mesh.node_mm, mesh.quad
    if case.element.startswith("CPE8"):
        node_mm, element = mesh.with_midsides()
    expected_mm = node_mm @ gradient.T
    rim = np.flatnonzero(_on_rim(mesh, node_mm))
    problem = PlaneProblem(
        kind=case.element,
        node_mm=node_mm,
        element=element,
        materials=(MATERIAL,),
        element_material=np.zeros(len(element), dtype=np.int64),
        moved=rim,
        moved_mm=expected_mm[rim],
        law=case.law,
        large_strain=case.large,
        increments=_INCREMENTS if case.large else 1,
    )
    strain = "large" if case.large else "small"
    name = f"{NAME}/{case.element}_{case.mesh}_{case.law}_{strain}"
    folder = bench.solve_deck(name, problem.deck(), problem.increments).folder
    nodes = list(range(1, len(node_mm) + 1))
    _, found_mm = read_displacement(folder / f"{JOB}.frd", nodes)
    _, _, found_pa = read_point_stress(folder / f"{JOB}.dat", PRINTED)
    stress_mpa = uniform_stress_mpa(gradient, MATERIAL, case.law, large_strain=case.large)
    off_mpa = np.abs(found_pa[-1] * _MM_A_PA - stress_mpa).max()
    return (
        float(np.abs(found_mm[-1, :, :2] - expected_mm).max()),
        float(off_mpa / np.abs(stress_mpa).max()),
    )


def _parallelograms() -> Mesh:
    """Nine of them."""
    x, y = (at.ravel() for at in np.meshgrid(np.arange(4), np.arange(4)))
    first = (np.arange(3)[:, None] * 4 + np.arange(3)).ravel()
    quad = np.stack([first, first + 1, first + 5, first + 4], -1)
    return Mesh(np.stack([0.8 * x + 0.2 * y, 0.4 * y], -1), quad, np.full(9, 2))


def _on_rim(mesh: Mesh, node_mm: FloatArray) -> BoolArray:
    """Which nodes, mid-sides among them, lie on the outline."""
    edge, _, _ = mesh.outline()
    rim_mm = np.concatenate([mesh.node_mm[np.unique(edge)], mesh.node_mm[edge].mean(axis=1)])
    away_mm = np.linalg.norm(node_mm[:, None] - rim_mm, axis=2).min(axis=1)
    on_rim: BoolArray = away_mm < 1e-12
    return on_rim
