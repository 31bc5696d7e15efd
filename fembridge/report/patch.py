"""Study: the patch test. Elements of any shape under a linear displacement.

All nodes of the rim follow ``u = G x``; those inside are free. Whatever the shape of
the elements, strain is that of G everywhere, and stress has a closed form, for small
strain and for both laws of large strain.
"""

from itertools import product

import numpy as np

from decks.dialects import JOB
from decks.finger import TABLE_1
from decks.mesh import Mesh
from fembridge.report.plane import NEO_HOOKEAN, PRINTED, PlaneProblem, uniform_stress_mpa
from fembridge.report.runs import Runs
from fembridge.report.study import Check, Finding
from fembridge.results.printed import read_point_stress
from fembridge.results.source import read_values

MATERIAL = TABLE_1["dermis"]
SMALL = np.array([[2e-3, -1e-3], [4e-3, 1.5e-3]])
LARGE = np.array([[0.20, -0.10], [0.15, -0.25]])
BOUND = 1.0e-6
# Five quads, none a parallelogram: one within a rectangle, rotated and shifted.
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
_SHAPES = (
    *((element, "distorted") for element in ("CPE4", "CPE8", "CPE8R", "CPE4R")),
    ("CPE4R", "parallelograms"),
)
# Law, whether strain is large, and both in words.
_LAWS = (
    ("linear", False, "small, Hooke"),
    ("linear", True, "large, linear law"),
    (NEO_HOOKEAN, True, "large, neo-Hookean"),
)
# CPE4R's hourglass control answers to a linear displacement as well.
_EXPECTED_TO_FAIL = ("CPE4R", "distorted")
_MM_A_PA = 1.0e-6
_INCREMENTS = 4


def study(runs: Runs) -> Finding:
    """Solve each case; errors are shares of the largest component."""
    from pandas import DataFrame

    rows = [
        (element, mesh, strain, *_errors(runs, element, mesh, law, large))
        for (element, mesh), (law, large, strain) in product(_SHAPES, _LAWS)
    ]
    failing = {True: 0.0, False: 0.0}
    for row in rows:
        expected = row[:2] == _EXPECTED_TO_FAIL
        failing[expected] = max(failing[expected], row[-1])
    what = "largest error of stress, CPE4R on distorted quadrilaterals left out"
    columns = ["element", "patch", "strain", "displacement_mm", "stress"]
    return Finding(
        checks=(Check(what, failing[False], BOUND),),
        tables={"patch": DataFrame(rows, columns=columns)},
        numbers={"failed_percent": 100 * failing[True]},
    )


def _errors(runs: Runs, kind: str, patch: str, law: str, large: bool) -> tuple[float, float]:
    """Largest error of displacement in mm, and of stress as a share."""
    mesh = _DISTORTED if patch == "distorted" else _parallelograms()
    gradient = LARGE if large else SMALL
    node_mm, element = (
        mesh.with_midsides() if kind.startswith("CPE8") else (mesh.node_mm, mesh.quad)
    )
    expected_mm = node_mm @ gradient.T
    edge, _, _ = mesh.outline()
    rim_mm = np.concatenate([mesh.node_mm[np.unique(edge)], mesh.node_mm[edge].mean(axis=1)])
    away_mm = np.linalg.norm(node_mm[:, None] - rim_mm, axis=2).min(axis=1)
    rim = np.flatnonzero(away_mm < 1e-12)
    problem = PlaneProblem(
        kind=kind,
        node_mm=node_mm,
        element=element,
        materials=(MATERIAL,),
        element_material=np.zeros(len(element), dtype=np.int64),
        moved=rim,
        moved_mm=expected_mm[rim],
        law=law,
        large_strain=large,
        increments=_INCREMENTS if large else 1,
    )
    name = f"patch/{kind}_{patch}_{law}_{'large' if large else 'small'}"
    folder = runs.solve_deck(name, problem.deck(), problem.increments)
    nodes = list(range(1, len(node_mm) + 1))
    _, found_mm = read_values(folder / f"{JOB}.frd", nodes, quantity="displacement")
    _, _, found_pa = read_point_stress(folder / f"{JOB}.dat", PRINTED)
    stress_mpa = uniform_stress_mpa(gradient, MATERIAL, law, large_strain=large)
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
