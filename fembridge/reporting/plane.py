"""Studies without contact: plane strain with prescribed displacements on the boundary.

`patch`: elements of any shape under a linear displacement. All boundary nodes follow
``u = G x``, inner nodes are free. For any element shape the strain is that of G everywhere,
and stress has a closed form, for small strain and for both laws at large strain.

`second_solver`: the `quick` finger at small strain; the skin's nodes under the probe get a
prescribed displacement, the bone is fixed. CalculiX is compared with scikit-fem, which has
independent shape functions, assembly and equation solver.

`ring`: a thick ring of dermis with a Poisson's ratio of 0.48; its inner side moves outwards
by `u`, its outer side is free:

    u_r = A r + B / r,  A = mu B / ((lambda + mu) b^2),  u = A a + B / a
    sigma_rr, sigma_tt = 2 (lambda + mu) A -/+ 2 mu B / r^2,  sigma_zz = 2 lambda A

(Timoshenko & Goodier, Theory of Elasticity, section 28). As Poisson's ratio approaches 0.5
the volume of the ring becomes constant: A tends to 0 while its product with lambda stays
finite. An element that cannot keep its volume has a wrong mean stress.
"""

import importlib.metadata
from dataclasses import dataclass
from itertools import product

import numpy as np
from matplotlib.figure import Figure
from pandas import DataFrame

from decks.contact_analysis import ElementSet, Model
from decks.dialects import JOB, template
from decks.finger import LAYERS, TABLE_1, Material
from decks.keyword_deck import LINES
from decks.mesh import Mesh
from decks.presets import QUICK, mesh_of
from fembridge.reporting.verification_runs import (
    BoundCheck,
    Finding,
    Runs,
    finish,
    indentation_stimulus,
    largest_difference_percent,
    line,
    panels,
)
from fembridge.results.printed import read_point_stress
from fembridge.results.readers import read_values
from fembridge.results.von_mises import von_mises_pa
from fembridge.trace import PA_PER_MPA
from fembridge.typing import FloatArray, IntArray

NEO_HOOKEAN = "neo-hookean"
BODY = "BODY"
# Element set of the printed stress at integration points.
_PRINTED = "PRINTED"

# Patch test.
MATERIAL = TABLE_1["dermis"]
SMALL = np.array([[2e-3, -1e-3], [4e-3, 1.5e-3]])
LARGE = np.array([[0.20, -0.10], [0.15, -0.25]])
BOUND = 1.0e-6
# Five quads, none a parallelogram: an inner one, rotated and shifted, and four around it.
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
# Law, whether strain is large, and the label of both.
_LAWS = (
    ("linear", False, "small, Hooke"),
    ("linear", True, "large, linear law"),
    (NEO_HOOKEAN, True, "large, neo-Hookean"),
)
# CPE4R's hourglass control also acts on a linear displacement.
_EXPECTED_TO_FAIL = ("CPE4R", "distorted")
_INCREMENTS = 4

# Second solver.
ELEMENTS = ("CPE4", "CPE8R")
PRESSED_HALF_WIDTH_MM, PRESSED_DEPTH_MM = 0.25, 0.02
BOUND_PERCENT = 0.1
# Every corner of the bone is fixed, so its stress is almost 0 and is not compared.
_FIXED = "bone"
# Two Gauss points per direction on the unit square.
_GAUSS_OFFSET = 0.5 / np.sqrt(3)
_GAUSS_POINTS = np.array([0.5 - _GAUSS_OFFSET, 0.5 + _GAUSS_OFFSET])

# Ring.
RING_ELEMENTS = ("CPE4", "CPE4R", "CPE8R")
RING_ROWS, RING_ROWS_QUICK = (4, 8, 16, 32), (4, 8, 16)
RATIOS = (0.48, 0.499)
INNER_MM, OUTER_MM = 0.5, 2.0
INNER_DISPLACEMENT_MM = -0.005
_RING_BOUND_PERCENT = 3.0
_CORNERS = 4


@dataclass(frozen=True, slots=True, eq=False)
class PlaneProblem:
    """A plane-strain problem with prescribed displacements.

    `kind` is the element type, `node_mm` ``(N, 2)`` the nodes, `element` ``(E, 4 or 8)`` the
    node rows of each element. `element_material` ``(E,)`` are indices of `materials`; `law` is
    one of `decks.dialects.LAWS`. `moved` ``(M,)`` are rows of nodes and `moved_mm` ``(M, 2)``
    their displacement; NaN leaves a direction free.
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
        """Text of the deck; its step lasts one second per increment."""
        numbers = np.arange(len(self.element)) + 1
        masks = [self.element_material == number for number in range(len(self.materials))]
        node, axis = np.nonzero(~np.isnan(self.moved_mm))
        return template("plane.inp.j2").render(
            problem=self,
            sections=[
                ElementSet(f"{BODY}_{k}", numbers[rows], self.element[rows] + 1, material, self.law)
                for k, (rows, material) in enumerate(zip(masks, self.materials, strict=True))
            ],
            boundary=zip(
                (self.moved[node] + 1).tolist(),
                (axis + 1).tolist(),
                self.moved_mm[node, axis].tolist(),
                strict=True,
            ),
            printed=_PRINTED,
            **LINES,
        )

    def solve(self, runs: Runs, name: str) -> tuple[FloatArray, FloatArray]:
        """Displacement ``(N, 2)`` in mm and stress ``(E, point, 6)`` in Pa by CalculiX."""
        folder = runs.solve_deck(name, self.deck(), self.increments)
        nodes = list(range(1, len(self.node_mm) + 1))
        _, moved_mm = read_values(folder / f"{JOB}.frd", nodes, quantity="displacement")
        _, _, stress_pa = read_point_stress(folder / f"{JOB}.dat", _PRINTED)
        return moved_mm[-1, :, :2], stress_pa[-1].reshape(len(self.element), -1, 6)


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
    gradient_3d = np.zeros((3, 3))
    gradient_3d[:2, :2] = gradient
    if not large_strain:
        stress = _hooke_mpa(0.5 * (gradient_3d + gradient_3d.T), material)
    else:
        stretch = np.eye(3) + gradient_3d
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
    return np.array([stress[index] for index in order])


def _hooke_mpa(strain: FloatArray, material: Material) -> FloatArray:
    lame_mpa = material.bulk_mpa - 2 * material.shear_mpa / 3
    stress: FloatArray = lame_mpa * np.trace(strain) * np.eye(3) + 2 * material.shear_mpa * strain
    return stress


def patch(runs: Runs) -> Finding:
    """Errors of each element and law; stress relative to its largest component."""
    rows = [
        (element, mesh, strain, *_errors(runs, element, mesh, law, large))
        for (element, mesh), (law, large, strain) in product(_SHAPES, _LAWS)
    ]
    worst = max(row[-1] for row in rows if row[:2] != _EXPECTED_TO_FAIL)
    check_name = "largest error of stress, without CPE4R on distorted quadrilaterals"
    columns = ["element", "patch", "strain", "displacement_mm", "stress"]
    return Finding(
        checks=(BoundCheck(check_name, worst, BOUND),),
        tables={"patch": DataFrame(rows, columns=columns)},
    )


def _errors(runs: Runs, kind: str, patch: str, law: str, large: bool) -> tuple[float, float]:
    """Largest error of displacement in mm, and of stress relative to its largest component."""
    mesh = _DISTORTED if patch == "distorted" else _parallelograms()
    gradient = LARGE if large else SMALL
    node_mm, element = (
        mesh.with_midsides() if kind.startswith("CPE8") else (mesh.node_mm, mesh.quad)
    )
    expected_mm = node_mm @ gradient.T
    edge, _, _ = mesh.outline()
    rim_mm = np.concatenate([mesh.node_mm[np.unique(edge)], mesh.node_mm[edge].mean(axis=1)])
    rim_distance_mm = np.linalg.norm(node_mm[:, None] - rim_mm, axis=2).min(axis=1)
    rim = np.flatnonzero(rim_distance_mm < 1e-12)
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
    computed_mm, computed_pa = problem.solve(runs, name)
    stress_mpa = uniform_stress_mpa(gradient, MATERIAL, law, large_strain=large)
    error_mpa = np.abs(computed_pa / PA_PER_MPA - stress_mpa).max()
    return float(np.abs(computed_mm - expected_mm).max()), float(
        error_mpa / np.abs(stress_mpa).max()
    )


def _parallelograms() -> Mesh:
    """Mesh of nine parallelograms."""
    x, y = (grid.ravel() for grid in np.meshgrid(np.arange(4), np.arange(4)))
    first = (np.arange(3)[:, None] * 4 + np.arange(3)).ravel()
    quad = np.stack([first, first + 1, first + 5, first + 4], -1)
    return Mesh(np.stack([0.8 * x + 0.2 * y, 0.4 * y], -1), quad, np.full(9, 2))


def second_solver(runs: Runs) -> Finding:
    """Differences between CalculiX and scikit-fem; skipped if scikit-fem is not installed."""
    if skfem_version() is None:
        return Finding(skipped="scikit-fem is not installed: `pip install scikit-fem`")
    rows = [{"element": element, **_differences_percent(runs, element)} for element in ELEMENTS]
    table = DataFrame(rows)
    largest = table.drop(columns="element").max(axis=1).tolist()
    return Finding(
        checks=tuple(
            BoundCheck(f"{element}: largest difference", difference_percent, BOUND_PERCENT, "%")
            for element, difference_percent in zip(ELEMENTS, largest, strict=True)
        ),
        tables={"solver": table},
    )


def skfem_version() -> str | None:
    """Version of scikit-fem; None if it is not installed."""
    try:
        return importlib.metadata.version("scikit-fem")
    except importlib.metadata.PackageNotFoundError:
        return None


def _differences_percent(runs: Runs, element: str) -> dict[str, float]:
    """Largest differences in percent of the largest value: displacement, stress by layer."""
    runs.log(f"solver: solving with {element}")
    problem, layer = _problem(element)
    ccx_mm, ccx_pa = problem.solve(runs, f"solver/{element}")
    skfem_mm, skfem_mpa = plane_strain(problem)
    mean_mpa = ccx_pa.mean(axis=1) / PA_PER_MPA
    stress = {
        LAYERS[number]: largest_difference_percent(
            mean_mpa[layer == number], skfem_mpa[layer == number]
        )
        for number in np.unique(layer).tolist()
        if LAYERS[number] != _FIXED
    }
    return {"displacement": largest_difference_percent(ccx_mm, skfem_mm), **stress}


def _problem(element: str) -> tuple[PlaneProblem, IntArray]:
    """The problem, and the layer of each element."""
    mesh = mesh_of(QUICK)
    fixed = Model(QUICK, mesh).analysis(indentation_stimulus()).fixed_row
    pad = np.sort(mesh.pad())
    near = np.abs(mesh.node_mm[pad, 0]) <= PRESSED_HALF_WIDTH_MM + 1e-9
    moved = np.concatenate([fixed, pad[near]])
    moved_mm = np.zeros((len(moved), 2))
    moved_mm[len(fixed) :, 1] = -PRESSED_DEPTH_MM
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
    """Solution of a small-strain problem by scikit-fem; moved nodes move in both directions.

    Returns
    -------
    displacement_mm, stress_mpa
        ``(N, 2)`` at the problem's nodes and ``(E, 6)``, mean of four integration
        points of each element, order xx yy zz xy yz zx.
    """
    from scipy.spatial import cKDTree
    from skfem import Basis, ElementQuad1, ElementQuadS2, ElementVector, MeshQuad, condense, solve
    from skfem.helpers import sym_grad
    from skfem.models.elasticity import linear_elasticity, linear_stress

    corners = problem.element[:, :4]
    used, compact = np.unique(corners, return_inverse=True)
    mesh = MeshQuad(
        np.ascontiguousarray(problem.node_mm[used].T),
        np.ascontiguousarray(compact.reshape(corners.shape).T),
    )
    quadratic = problem.element.shape[1] == 8
    element = ElementVector(ElementQuadS2() if quadratic else ElementQuad1())
    eta, xi = (grid.ravel() for grid in np.meshgrid(_GAUSS_POINTS, _GAUSS_POINTS, indexing="ij"))
    basis = Basis(mesh, element, quadrature=(np.stack([xi, eta]), np.full(4, 0.25)))
    moduli = np.array([(material.bulk_mpa, material.shear_mpa) for material in problem.materials])
    bulk, shear = moduli[problem.element_material].T[..., None]
    lame = bulk - 2 * shear / 3
    matrix = linear_elasticity(lame, shear).assemble(basis)
    # Both unknowns of a node are at its position.
    _, unknown = cKDTree(basis.doflocs.T).query(problem.node_mm, k=2)
    unknown = np.sort(unknown, axis=1)
    moved = unknown[problem.moved]
    start = np.zeros(basis.N)
    start[moved.ravel()] = problem.moved_mm.ravel()
    solution = solve(*condense(matrix, x=start, D=moved.ravel()))
    strain = np.asarray(sym_grad(basis.interpolate(solution)))  # (2, 2, E, 4)
    (xx, xy), (_, yy) = linear_stress(lame, shear)(strain)
    zz, zero = lame * (strain[0, 0] + strain[1, 1]), np.zeros_like(xx)
    return solution[unknown], np.stack([xx, yy, zz, xy, zero, zero], -1).mean(axis=1)


def ring(runs: Runs) -> Finding:
    """Errors of the ring with each element, mesh and Poisson's ratio."""
    all_rows = RING_ROWS_QUICK if runs.quick else RING_ROWS
    table = DataFrame(
        [
            (ratio, element, rows, *_ring_errors(runs, element, rows, ratio))
            for ratio, element, rows in product(RATIOS, RING_ELEMENTS, all_rows)
        ],
        columns=[
            *("poisson", "element", "across", "von_mises_percent"),
            *("mean_stress_percent", "mean_stress_by_point_percent"),
        ],
    )
    finest = table[(table.across == all_rows[-1]) & (table.poisson == RATIOS[0])]
    errors = finest.set_index("element").von_mises_percent
    return Finding(
        checks=tuple(
            BoundCheck(
                f"ring, {element}, ν 0.48, {all_rows[-1]} elements across: von Mises stress",
                float(error),
                _RING_BOUND_PERCENT,
                "%",
            )
            for element, error in errors.items()
        ),
        tables={"ring": table},
        figure=_ring_figure(table),
    )


def _ring_figure(ring: DataFrame) -> Figure:
    """Errors against elements across; solid lines Poisson's ratio 0.48, dashed 0.499."""
    figure, both_panels = panels(2)
    titles = {
        "von_mises_percent": "von Mises stress, error (%)",
        "mean_stress_by_point_percent": "mean stress, error (%)",
    }
    for panel, (column, title) in zip(both_panels, titles.items(), strict=True):
        for (row, element), ratio in product(enumerate(RING_ELEMENTS), RATIOS):
            rows = ring[(ring.poisson == ratio) & (ring.element == element)]
            solid = ratio == RATIOS[0]
            style = line(row, mark="both" if solid else "dashed")
            panel.plot(rows.across, rows[column], label=element if solid else None, **style)
        finish(panel, "elements across the ring", title, log="xy")
    return figure


def _ring_errors(runs: Runs, element: str, rows: int, ratio: float) -> tuple[float, float, float]:
    """Largest errors in %: von Mises stress, mean stress by element, mean stress by point."""
    material = Material(TABLE_1["dermis"].young_mpa, ratio)
    problem = ring_problem(element, rows, material)
    name = f"incompressible/ring_{element}_{rows}_{ratio:g}"
    _, computed_pa = problem.solve(runs, name)
    exact_pa = _exact_pa(
        problem.node_mm[problem.element[:, :_CORNERS]], computed_pa.shape[1], material
    )
    worst = np.abs(von_mises_pa(computed_pa) - von_mises_pa(exact_pa)).max()
    mean, exact_mean = computed_pa[..., :3].mean(-1), exact_pa[..., :3].mean(-1)
    scale = von_mises_pa(exact_pa).max()
    return (
        100 * float(worst / scale),
        100 * float(np.abs(mean.mean(1) - exact_mean.mean(1)).max() / scale),
        100 * float(np.abs(mean - exact_mean).max() / scale),
    )


def _exact_pa(corner_mm: FloatArray, points: int, material: Material) -> FloatArray:
    """Closed form ``(E, point, 6)`` at the integration points of elements.

    CalculiX expands a plane element to one layer of solid elements, so the one or four points of
    the plane occur once or twice, first coordinate first.
    """
    ends = np.array([0.0]) if points == 1 else np.array([-1.0, 1.0]) / np.sqrt(3)
    eta, xi = (grid.ravel() for grid in np.meshgrid(ends, ends, indexing="ij"))
    shape = 0.25 * np.stack(
        [(1 - xi) * (1 - eta), (1 + xi) * (1 - eta), (1 + xi) * (1 + eta), (1 - xi) * (1 + eta)], -1
    )
    point_mm = np.einsum("pc,ecx->epx", shape, corner_mm)
    point_mm = np.concatenate([point_mm] * (points // len(xi)), axis=1)
    radius_mm = np.linalg.norm(point_mm, axis=-1)
    radial, tangential, axial = np.moveaxis(ring_stress_mpa(radius_mm, material), -1, 0)
    cos, sin = np.moveaxis(point_mm / radius_mm[..., None], -1, 0)
    stress = np.zeros((*axial.shape, 6))
    stress[..., 0] = radial * cos**2 + tangential * sin**2
    stress[..., 1] = radial * sin**2 + tangential * cos**2
    stress[..., 2] = axial
    stress[..., 3] = (radial - tangential) * cos * sin
    return PA_PER_MPA * stress


def ring_stress_mpa(radius_mm: FloatArray, material: Material) -> FloatArray:
    """Radial, tangential and axial stress ``(..., 3)`` in the ring."""
    shear_mpa, bulk_mpa = material.shear_mpa, material.bulk_mpa
    lame_mpa = bulk_mpa - 2 * shear_mpa / 3
    share = shear_mpa / ((bulk_mpa + shear_mpa / 3) * OUTER_MM**2)
    b = INNER_DISPLACEMENT_MM / (share * INNER_MM + 1 / INNER_MM)
    a = share * b
    plane = 2 * (lame_mpa + shear_mpa) * a
    turn = 2 * shear_mpa * b / radius_mm**2
    axial = np.full_like(radius_mm, 2 * lame_mpa * a)
    return np.stack([plane - turn, plane + turn, axial], -1)


def ring_problem(kind: str, rows: int, material: Material) -> PlaneProblem:
    """A quarter of the ring with `rows` elements across the wall; the cut faces slide freely."""
    quadratic = kind in ("CPE8", "CPE8R")
    step = 2 if quadratic else 1
    across, along = step * rows + 1, step * 2 * rows + 1
    share = np.linspace(0.0, 1.0, across)
    radius_mm = INNER_MM * (OUTER_MM / INNER_MM) ** share
    if quadratic:  # mid-side nodes in the middle of straight sides
        radius_mm[1::2] = 0.5 * (radius_mm[:-1:2] + radius_mm[2::2])
    angle = np.linspace(0.0, np.pi / 2, along)
    grid_mm = np.stack([np.outer(radius_mm, np.cos(angle)), np.outer(radius_mm, np.sin(angle))], -1)
    if quadratic:
        grid_mm[:, 1::2] = 0.5 * (grid_mm[:, :-1:2] + grid_mm[:, 2::2])
    element = _ring_elements(np.arange(across * along).reshape(across, along), quadratic)
    used, compact = np.unique(element, return_inverse=True)
    node_mm = grid_mm.reshape(-1, 2)[used]
    row, column = np.unravel_index(used, (across, along))
    moved_mm = np.full_like(node_mm, np.nan)  # NaN is free
    moved_mm[column == 0, 1] = 0.0
    moved_mm[column == along - 1, 0] = 0.0
    inner = row == 0
    moved_mm[inner] = INNER_DISPLACEMENT_MM * node_mm[inner] / INNER_MM
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
    return np.stack([corner.ravel() for corner in corners], -1)
