"""Study: the same mesh and materials in an independent solver, without contact.

The `quick` finger, small strain, plane strain: the skin's nodes under the probe go
down by what is prescribed, the bone does not move. CalculiX against scikit-fem, of
whose elements this module asks nothing but shape functions.
"""

from dataclasses import dataclass

import numpy as np

from decks.analysis import analyse
from decks.dialects import JOB
from decks.finger import LAYERS
from decks.presets import QUICK, mesh_of
from fembridge.results.frd import read_displacement
from fembridge.results.printed.dat import read_point_stress
from fembridge.typing import FloatArray, IntArray
from fembridge.verification.bench import Bench
from fembridge.verification.finding import Check, Finding, NumberTable
from fembridge.verification.indent import down
from fembridge.verification.plane_deck import PRINTED, PlaneProblem
from fembridge.verification.skfem_plane import plane_strain, skfem_version

NAME = "solver"
TITLE = "A second solver"

ELEMENTS = ("CPE4", "CPE8R")
PRESSED_HALF_MM, PRESSED_MM = 0.25, 0.02
BOUND_PERCENT = 0.1
_PA_PER_MPA = 1.0e6
# All of its corners are: it carries next to no stress that could be compared.
_HELD = "bone"


@dataclass(frozen=True, slots=True)
class _Off:
    """Largest difference, in percent of the largest value."""

    displacement_percent: float
    stress_percent: dict[str, float]


def study(bench: Bench) -> Finding:
    """Solve with both, if the second is installed."""
    version = skfem_version()
    question = (
        "The `quick` finger without a probe: the skin's nodes within "
        f"{PRESSED_HALF_MM:g} mm of the apex go {1000 * PRESSED_MM:g} µm down and not "
        "aside, bone and nail's outside do not move; small strain, plane strain, "
        "Table 1. CalculiX and scikit-fem (another program, other people's shape "
        "functions, assembly and equation solver) get the same nodes, elements and "
        "displacements."
    )
    if version is None:
        return Finding(
            name=NAME,
            title=TITLE,
            question=question,
            words=(),
            checks=(),
            tables=(),
            skipped="scikit-fem is not installed: `pip install scikit-fem`",
            cost=bench.spent,
        )
    found = {element: _compared(bench, element) for element in ELEMENTS}
    worst = {
        element: max(each.displacement_percent, *each.stress_percent.values())
        for element, each in found.items()
    }
    layers = tuple(found[ELEMENTS[0]].stress_percent)
    return Finding(
        name=NAME,
        title=TITLE,
        question=question,
        words=(
            f"scikit-fem {version} and CalculiX agree to {max(worst.values()):.2g} %: "
            "what is left are the seven digits with which CalculiX prints.",
        ),
        checks=tuple(
            Check(f"{element}: largest difference", off, BOUND_PERCENT, "%")
            for element, off in worst.items()
        ),
        tables=(
            NumberTable(
                name="solver",
                caption="Largest difference in percent of the largest: displacement of "
                "all nodes; components of stress, mean over an element, by layer "
                "(the bone is held)",
                columns=("element", "displacement", *layers),
                rows=tuple(
                    (element, each.displacement_percent, *each.stress_percent.values())
                    for element, each in found.items()
                ),
                formats=("", *[".1e"] * (1 + len(layers))),
            ),
        ),
        cost=bench.spent,
    )


def _compared(bench: Bench, element: str) -> _Off:
    bench.tell(f"{NAME}: {element}")
    problem, layer = _problem(element)
    folder = bench.solve_deck(f"{NAME}/{element}", problem.deck()).folder
    nodes = list(range(1, len(problem.node_mm) + 1))
    _, found_mm = read_displacement(folder / f"{JOB}.frd", nodes)
    _, _, tensor_pa = read_point_stress(folder / f"{JOB}.dat", PRINTED)
    stress_pa = tensor_pa[0].reshape(len(problem.element), -1, 6).mean(axis=1)
    other_mm, other_mpa = plane_strain(problem)
    off_mm = np.abs(found_mm[0, :, :2] - other_mm).max() / np.abs(other_mm).max()
    return _Off(
        100 * float(off_mm),
        {
            LAYERS[number]: _off_percent(
                stress_pa[layer == number], _PA_PER_MPA * other_mpa[layer == number]
            )
            for number in np.unique(layer).tolist()
            if LAYERS[number] != _HELD
        },
    )


def _off_percent(found: FloatArray, expected: FloatArray) -> float:
    return 100 * float(np.abs(found - expected).max() / np.abs(expected).max())


def _problem(element: str) -> tuple[PlaneProblem, IntArray]:
    """Give the problem, and the layer of each element."""
    mesh = mesh_of(QUICK)
    held = analyse(QUICK, mesh, down()).fixed_row
    edge, _, _ = mesh.outline()
    skin = np.unique(edge)
    near = np.abs(mesh.node_mm[skin, 0]) <= PRESSED_HALF_MM + 1e-9
    pad = mesh.node_mm[skin, 1] > 0.5 * mesh.node_mm[:, 1].min()
    pressed = skin[near & pad]
    moved = np.concatenate([held, pressed])
    moved_mm = np.zeros((len(moved), 2))
    moved_mm[len(held) :, 1] = -PRESSED_MM
    node_mm, nodes = mesh.node_mm, mesh.quad
    if element == "CPE8R":
        node_mm, nodes = mesh.with_midsides()
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
