"""Plane strain with scikit-fem: the only module that knows it, imported when asked."""

import importlib.metadata
from typing import Any

import numpy as np

from fembridge.errors import ResponseError
from fembridge.typing import FloatArray, IntArray
from fembridge.verification.plane_deck import PlaneProblem, moduli_mpa

_SAME_MM = 1.0e-9
# Gauss points of two in each direction on the unit square.
_HALF_WAY = 0.5 / np.sqrt(3)
_GAUSS = np.array([0.5 - _HALF_WAY, 0.5 + _HALF_WAY])


def skfem_version() -> str | None:
    """Version of scikit-fem; None where it is not installed."""
    try:
        return importlib.metadata.version("scikit-fem")
    except importlib.metadata.PackageNotFoundError:
        return None


def plane_strain(problem: PlaneProblem) -> tuple[FloatArray, FloatArray]:
    """Solve a small-strain problem whose displaced nodes have both directions given.

    Returns
    -------
    displacement_mm, stress_mpa
        ``(N, 2)`` at the problem's nodes and ``(E, 6)``, mean of four integration
        points of each element, order xx yy zz xy yz zx.
    """
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
    moduli = np.array([moduli_mpa(material) for material in problem.materials])
    shear, bulk = moduli[problem.element_material].T
    lame = bulk - 2 * shear / 3
    points = np.ones((1, 4))
    given = {"shear": shear[:, None] * points, "lame": lame[:, None] * points}

    @BilinearForm  # type: ignore[untyped-decorator]  # an untyped library
    def stiffness(u: Any, v: Any, w: Any) -> Any:  # noqa: ANN401 - untyped library
        strain, tested = sym_grad(u), sym_grad(v)
        return w.lame * trace(strain) * trace(tested) + 2 * w.shear * ddot(strain, tested)

    matrix = stiffness.assemble(basis, **given)
    number = _dofs(basis.doflocs, problem.node_mm)
    moved = number[problem.moved]
    start = np.zeros(basis.N)
    start[moved.ravel()] = problem.moved_mm.ravel()
    solution = solve(*condense(matrix, x=start, D=moved.ravel()))
    strain = np.asarray(sym_grad(basis.interpolate(solution)))  # (2, 2, E, 4)
    volume = strain[0, 0] + strain[1, 1]
    pressure, double = given["lame"] * volume, 2 * given["shear"]
    zero = np.zeros_like(volume)
    stress = np.stack(
        [
            pressure + double * strain[0, 0],
            pressure + double * strain[1, 1],
            pressure,
            double * strain[0, 1],
            zero,
            zero,
        ],
        -1,
    )
    return solution[number], stress.mean(axis=1)


def _dofs(places_mm: FloatArray, node_mm: FloatArray) -> IntArray:
    """Numbers ``(N, 2)`` of the unknowns at nodes, by their place ``(2, K)``."""
    from scipy.spatial import cKDTree

    away_mm, near = cKDTree(places_mm.T).query(node_mm, k=2)
    if away_mm.max() > _SAME_MM:
        raise ResponseError(f"no unknown within {away_mm.max():g} mm of a node")
    number: IntArray = np.sort(near, axis=1)
    return number
