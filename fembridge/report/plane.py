"""Studies without contact, in plane strain, the boundary prescribed.

`patch`: elements of any shape under a linear displacement. All nodes of the rim follow
``u = G x``; those inside are free. Whatever the shape of the elements, strain is that of G
everywhere, and stress has a closed form, for small strain and for both laws of large strain.

`second_solver`: the `quick` finger, small strain; the skin's nodes under the probe go down
by what is prescribed, the bone does not move. CalculiX against scikit-fem: another program's
shape functions, assembly and equation solver.

`ring`: thick, of a dermis with a Poisson's ratio of 0.48; its inner side moves by `u` away from
the middle, its outer side is free:

    u_r = A r + B / r,  A = mu B / ((lambda + mu) b^2),  u = A a + B / a
    sigma_rr, sigma_tt = 2 (lambda + mu) A -/+ 2 mu B / r^2,  sigma_zz = 2 lambda A

(Timoshenko & Goodier, Theory of Elasticity, section 28). Towards a Poisson's ratio of
0.5 the ring's volume stays the same: A goes to 0 while its product with lambda stays
finite. An element that cannot keep its volume pays with a mean stress that is wrong.
"""

import importlib.metadata
from dataclasses import dataclass
from itertools import product

import numpy as np
from matplotlib.figure import Figure
from pandas import DataFrame

from decks.analysis import ElementSet, Model
from decks.dialects import JOB, template
from decks.finger import LAYERS, TABLE_1, Material
from decks.keyword_deck import LINES
from decks.mesh import Mesh
from decks.presets import QUICK, mesh_of
from fembridge.report.study import (
    Check,
    Finding,
    Runs,
    down,
    finish,
    line,
    off_percent,
    panels,
)
from fembridge.results.printed import read_point_stress
from fembridge.results.readers import read_values
from fembridge.results.stress import von_mises_pa
from fembridge.trace import PA_PER_MPA
from fembridge.typing import FloatArray, IntArray

NEO_HOOKEAN = "neo-hookean"
BODY = "BODY"
# What is printed at integration points is of this set of elements.
_PRINTED = "PRINTED"

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
_INCREMENTS = 4

# The second solver.
ELEMENTS = ("CPE4", "CPE8R")
PRESSED_HALF_MM, PRESSED_MM = 0.25, 0.02
BOUND_PERCENT = 0.1
# Every corner of the bone is fixed: it carries next to no stress to compare.
_FIXED = "bone"
# Gauss points of two in each direction on the unit square.
_HALF_WAY = 0.5 / np.sqrt(3)
_GAUSS = np.array([0.5 - _HALF_WAY, 0.5 + _HALF_WAY])

# The ring.
RING_ELEMENTS = ("CPE4", "CPE4R", "CPE8R")
RING_ROWS, RING_ROWS_QUICK = (4, 8, 16, 32), (4, 8, 16)
RATIOS = (0.48, 0.499)
INNER_MM, OUTER_MM = 0.5, 2.0
MOVED_MM = -0.005
_RING_BOUND_PERCENT = 3.0
_CORNERS = 4


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
    rows = [
        (element, mesh, strain, *_errors(runs, element, mesh, law, large))
        for (element, mesh), (law, large, strain) in product(_SHAPES, _LAWS)
    ]
    worst = max(row[-1] for row in rows if row[:2] != _EXPECTED_TO_FAIL)
    what = "largest error of stress, CPE4R on distorted quadrilaterals left out"
    columns = ["element", "patch", "strain", "displacement_mm", "stress"]
    return Finding(
        checks=(Check(what, worst, BOUND),),
        tables={"patch": DataFrame(rows, columns=columns)},
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
    found_mm, found_pa = problem.solve(runs, name)
    stress_mpa = uniform_stress_mpa(gradient, MATERIAL, law, large_strain=large)
    off_mpa = np.abs(found_pa / PA_PER_MPA - stress_mpa).max()
    return float(np.abs(found_mm - expected_mm).max()), float(off_mpa / np.abs(stress_mpa).max())


def _parallelograms() -> Mesh:
    """Nine of them."""
    x, y = (at.ravel() for at in np.meshgrid(np.arange(4), np.arange(4)))
    first = (np.arange(3)[:, None] * 4 + np.arange(3)).ravel()
    quad = np.stack([first, first + 1, first + 5, first + 4], -1)
    return Mesh(np.stack([0.8 * x + 0.2 * y, 0.4 * y], -1), quad, np.full(9, 2))


def second_solver(runs: Runs) -> Finding:
    """Solve with both, if the second is installed."""
    if skfem_version() is None:
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
    found_mm, found_pa = problem.solve(runs, f"solver/{element}")
    other_mm, other_mpa = plane_strain(problem)
    mean_mpa = found_pa.mean(axis=1) / PA_PER_MPA
    stress = {
        LAYERS[number]: off_percent(mean_mpa[layer == number], other_mpa[layer == number])
        for number in np.unique(layer).tolist()
        if LAYERS[number] != _FIXED
    }
    return {"displacement": off_percent(found_mm, other_mm), **stress}


def _problem(element: str) -> tuple[PlaneProblem, IntArray]:
    """Problem, and the layer of each element."""
    mesh = mesh_of(QUICK)
    fixed = Model(QUICK, mesh).analysis(down()).fixed_row
    pad = np.sort(mesh.pad())
    near = np.abs(mesh.node_mm[pad, 0]) <= PRESSED_HALF_MM + 1e-9
    moved = np.concatenate([fixed, pad[near]])
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
    eta, xi = (each.ravel() for each in np.meshgrid(_GAUSS, _GAUSS, indexing="ij"))
    basis = Basis(mesh, element, quadrature=(np.stack([xi, eta]), np.full(4, 0.25)))
    moduli = np.array([(one.bulk_mpa, one.shear_mpa) for one in problem.materials])
    bulk, shear = moduli[problem.element_material].T[..., None]
    lame = bulk - 2 * shear / 3
    matrix = linear_elasticity(lame, shear).assemble(basis)
    # Both unknowns of a node are at its place.
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
    """Solve it with each element, finer and finer, at both ratios."""
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
            Check(
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
    """Errors against elements across; whole lines Poisson's ratio 0.48, dashed 0.499."""
    figure, both = panels(2)
    shown = {
        "von_mises_percent": "von Mises stress, error (%)",
        "mean_stress_by_point_percent": "mean stress, error (%)",
    }
    for panel, (column, title) in zip(both, shown.items(), strict=True):
        for (row, element), ratio in product(enumerate(RING_ELEMENTS), RATIOS):
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
