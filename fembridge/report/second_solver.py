"""Study: the same mesh and materials in an independent solver, without contact.

The `quick` finger, small strain, plane strain: the skin's nodes under the probe go
down by what is prescribed, the bone does not move. CalculiX against scikit-fem:
another program's shape functions, assembly and equation solver.
"""

import importlib.metadata
from typing import Any

import numpy as np

from decks.analysis import Model
from decks.dialects import JOB
from decks.finger import LAYERS
from decks.presets import QUICK, mesh_of
from fembridge.report.plane import PRINTED, PlaneProblem
from fembridge.report.runs import Runs, down
from fembridge.report.study import Check, Finding, off_percent
from fembridge.results.printed import read_point_stress
from fembridge.results.source import read_values
from fembridge.typing import FloatArray, IntArray

ELEMENTS = ("CPE4", "CPE8R")
PRESSED_HALF_MM, PRESSED_MM = 0.25, 0.02
BOUND_PERCENT = 0.1
_PA_PER_MPA = 1.0e6
# Every corner of the bone is fixed: it carries next to no stress to compare.
_FIXED = "bone"
# Gauss points of two in each direction on the unit square.
_HALF_WAY = 0.5 / np.sqrt(3)
_GAUSS = np.array([0.5 - _HALF_WAY, 0.5 + _HALF_WAY])


def study(runs: Runs) -> Finding:
    """Solve with both, if the second is installed."""
    from pandas import DataFrame

    version = skfem_version()
    if version is None:
        return Finding(skipped="scikit-fem is not installed: `pip install scikit-fem`")
    rows = [{"element": element, **_differences_percent(runs, element)} for element in ELEMENTS]
    table = DataFrame(rows)
    worst = table.drop(columns="element").max(axis=1).tolist()
    return Finding(
        checks=tuple(
            Check(f"{element}: largest difference", off, BOUND_PERCENT, "%")
            for element, off in zip(ELEMENTS, worst, strict=True)
        ),
        tables={"solver": table},
        numbers={"version": version, "worst_percent": max(worst)},
    )


def skfem_version() -> str | None:
    """Version of scikit-fem; None where it is not installed."""
    try:
        return importlib.metadata.version("scikit-fem")
    except importlib.metadata.PackageNotFoundError:
        return None


def _differences_percent(runs: Runs, element: str) -> dict[str, float]:
    """Largest differences in percent of the largest value: displacement, stress by layer."""
    runs.log(f"solver: {element}")
    problem, layer = _problem(element)
    folder = runs.solve_deck(f"solver/{element}", problem.deck())
    nodes = list(range(1, len(problem.node_mm) + 1))
    _, found_mm = read_values(folder / f"{JOB}.frd", nodes, quantity="displacement")
    _, _, tensor_pa = read_point_stress(folder / f"{JOB}.dat", PRINTED)
    stress_pa = tensor_pa[0].reshape(len(problem.element), -1, 6).mean(axis=1)
    other_mm, other_mpa = plane_strain(problem)
    differences = {"displacement": off_percent(found_mm[0, :, :2], other_mm)}
    for number in np.unique(layer).tolist():
        if LAYERS[number] != _FIXED:
            mine, other_pa = stress_pa[layer == number], _PA_PER_MPA * other_mpa[layer == number]
            differences[LAYERS[number]] = off_percent(mine, other_pa)
    return differences


def _problem(element: str) -> tuple[PlaneProblem, IntArray]:
    """Problem, and the layer of each element."""
    mesh = mesh_of(QUICK)
    fixed = Model(QUICK, mesh).analysis(down()).fixed_row
    edge, _, _ = mesh.outline()
    skin = np.unique(edge)
    near = np.abs(mesh.node_mm[skin, 0]) <= PRESSED_HALF_MM + 1e-9
    pad = mesh.node_mm[skin, 1] > 0.5 * mesh.node_mm[:, 1].min()
    moved = np.concatenate([fixed, skin[near & pad]])
    moved_mm = np.zeros((len(moved), 2))
    moved_mm[len(fixed) :, 1] = -PRESSED_MM
    node_mm, nodes = mesh.with_midsides() if element == "CPE8R" else (mesh.node_mm, mesh.quad)
    problem = PlaneProblem(
        kind=element,
        node_mm=node_mm,
        element=nodes,
        materials=tuple(QUICK.materials[layer] for layer in LAYERS),
        element_material=mesh.layer,
        moved=moved,
        moved_mm=moved_mm,
    )
    return problem, mesh.layer


def plane_strain(problem: PlaneProblem) -> tuple[FloatArray, FloatArray]:
    """Solve a small-strain problem with scikit-fem; moved nodes are so in both directions.

    Returns
    -------
    displacement_mm, stress_mpa
        ``(N, 2)`` at the problem's nodes and ``(E, 6)``, mean of four integration
        points of each element, order xx yy zz xy yz zx.
    """
    from scipy.spatial import cKDTree
    from skfem import (
        Basis,
        BilinearForm,
        ElementQuad1,
        ElementQuadS2,
        ElementVector,
        MeshQuad,
        condense,
        solve,
    )
    from skfem.helpers import ddot, sym_grad, trace

    corners = problem.element[:, :4]
    used, compact = np.unique(corners, return_inverse=True)
    mesh = MeshQuad(
        np.ascontiguousarray(problem.node_mm[used].T),
        np.ascontiguousarray(compact.reshape(corners.shape).T),
    )
    quadratic = problem.element.shape[1] == 8
    element = ElementVector(ElementQuadS2() if quadratic else ElementQuad1())
    eta, xi = (each.ravel() for each in np.meshgrid(_GAUSS, _GAUSS, indexing="ij"))
    basis = Basis(mesh, element, quadrature=(np.stack([xi, eta]), np.full(4, 0.25)))
    moduli = np.array([(one.shear_mpa, one.bulk_mpa) for one in problem.materials])
    shear, bulk = moduli[problem.element_material].T
    points = np.ones((1, 4))
    given = {"shear": shear[:, None] * points, "lame": (bulk - 2 * shear / 3)[:, None] * points}

    @BilinearForm  # type: ignore[untyped-decorator]  # an untyped library
    def stiffness(u: Any, v: Any, w: Any) -> Any:  # noqa: ANN401 - untyped library
        strain, tested = sym_grad(u), sym_grad(v)
        return w.lame * trace(strain) * trace(tested) + 2 * w.shear * ddot(strain, tested)

    matrix = stiffness.assemble(basis, **given)
    # Both unknowns of a node are at its place.
    _, unknown = cKDTree(basis.doflocs.T).query(problem.node_mm, k=2)
    unknown = np.sort(unknown, axis=1)
    moved = unknown[problem.moved]
    start = np.zeros(basis.N)
    start[moved.ravel()] = problem.moved_mm.ravel()
    solution = solve(*condense(matrix, x=start, D=moved.ravel()))
    strain = np.asarray(sym_grad(basis.interpolate(solution)))  # (2, 2, E, 4)
    pressure, double = given["lame"] * (strain[0, 0] + strain[1, 1]), 2 * given["shear"]
    stress = np.zeros((*pressure.shape, 6))
    stress[..., :3] = pressure[..., None]
    stress[..., 0] += double * strain[0, 0]
    stress[..., 1] += double * strain[1, 1]
    stress[..., 3] = double * strain[0, 1]
    return solution[unknown], stress.mean(axis=1)
