"""Studies without contact, in plane strain, the boundary prescribed: a patch, a second solver.

`patch`: elements of any shape under a linear displacement. All nodes of the rim follow
``u = G x``; those inside are free. Whatever the shape of the elements, strain is that of G
everywhere, and stress has a closed form, for small strain and for both laws of large strain.

`second_solver`: the `quick` finger, small strain; the skin's nodes under the probe go down
by what is prescribed, the bone does not move. CalculiX against scikit-fem: another program's
shape functions, assembly and equation solver.
"""

import importlib.metadata
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from decks.analysis import ElementSet, Model
from decks.dialects import JOB, template
from decks.finger import LAYERS, TABLE_1, Material
from decks.keyword_deck import LINES
from decks.mesh import Mesh
from decks.presets import QUICK, mesh_of
from fembridge.report.study import Check, Finding, Runs, down, off_percent
from fembridge.results.printed import read_point_stress
from fembridge.results.readers import read_values
from fembridge.typing import FloatArray, IntArray

NEO_HOOKEAN = "neo-hookean"
BODY = "BODY"
# What is printed at integration points is of this set of elements.
PRINTED = "PRINTED"

# The patch.
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

# The second solver.
ELEMENTS = ("CPE4", "CPE8R")
PRESSED_HALF_MM, PRESSED_MM = 0.25, 0.02
BOUND_PERCENT = 0.1
_PA_PER_MPA = 1.0e6
# Every corner of the bone is fixed: it carries next to no stress to compare.
_FIXED = "bone"
# Gauss points of two in each direction on the unit square.
_HALF_WAY = 0.5 / np.sqrt(3)
_GAUSS = np.array([0.5 - _HALF_WAY, 0.5 + _HALF_WAY])


@dataclass(frozen=True, slots=True, eq=False)
class PlaneProblem:
    """Nodes ``(N, 2)`` in mm, elements ``(E, 4 or 8)`` as rows of nodes, and more.

    `materials` and `element_material` ``(E,)`` say what each element is made of, by
    `law`, one of `decks.analysis.LAWS`. `moved` ``(M,)`` are rows of nodes and
    `moved_mm` ``(M, 2)`` their displacement; NaN leaves a direction free.
    """

    kind: str
    node_mm: FloatArray
    element: IntArray
    materials: tuple[Material, ...]
    element_material: IntArray
    moved: IntArray
    moved_mm: FloatArray
    law: str = "linear"
    large_strain: bool = False
    increments: int = 1

    def deck(self) -> str:
        """Text of the deck; its step lasts a second an increment."""
        numbers = np.arange(len(self.element)) + 1
        mine = [self.element_material == one for one in range(len(self.materials))]
        node, axis = np.nonzero(~np.isnan(self.moved_mm))
        return template("plane.inp.j2").render(
            problem=self,
            sections=[
                ElementSet(f"{BODY}_{k}", numbers[rows], self.element[rows] + 1, material, self.law)
                for k, (rows, material) in enumerate(zip(mine, self.materials, strict=True))
            ],
            boundary=zip(
                (self.moved[node] + 1).tolist(),
                (axis + 1).tolist(),
                self.moved_mm[node, axis].tolist(),
                strict=True,
            ),
            printed=PRINTED,
            **LINES,
        )


def uniform_stress_mpa(
    gradient: FloatArray, material: Material, law: str, *, large_strain: bool
) -> FloatArray:
    """Cauchy stress ``(6,)`` of a displacement gradient ``(2, 2)`` in plane strain.

    Order xx yy zz xy yz zx, in closed form.

    Notes
    -----
    Small strain: Hooke. Large strain, ``linear``: the second Piola–Kirchhoff stress
    is Hooke's of Green's strain, ``sigma = F S Fᵀ / J``. ``neo-hookean``:
    ``U = G/2 (I1bar − 3) + K/2 (J − 1)²``, so that
    ``sigma = G/J dev(bbar) + K (J − 1) I`` with ``bbar = J^(−2/3) F Fᵀ``.
    """
    whole = np.zeros((3, 3))
    whole[:2, :2] = gradient
    if not large_strain:
        stress = _hooke_mpa(0.5 * (whole + whole.T), material)
    else:
        stretch = np.eye(3) + whole
        volume = float(np.linalg.det(stretch))
        if law == NEO_HOOKEAN:
            isochoric = volume ** (-2 / 3) * stretch @ stretch.T
            deviator = isochoric - np.trace(isochoric) / 3 * np.eye(3)
            stress = material.shear_mpa / volume * deviator
            stress += material.bulk_mpa * (volume - 1) * np.eye(3)
        else:
            green = 0.5 * (stretch.T @ stretch - np.eye(3))
            stress = stretch @ _hooke_mpa(green, material) @ stretch.T / volume
    order = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))
    return np.array([stress[place] for place in order])


def _hooke_mpa(strain: FloatArray, material: Material) -> FloatArray:
    lame_mpa = material.bulk_mpa - 2 * material.shear_mpa / 3
    stress: FloatArray = lame_mpa * np.trace(strain) * np.eye(3) + 2 * material.shear_mpa * strain
    return stress


def patch(runs: Runs) -> Finding:
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


def second_solver(runs: Runs) -> Finding:
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
