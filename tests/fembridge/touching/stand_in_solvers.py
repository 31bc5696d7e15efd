"""Stand-ins for Abaqus and Marc: CalculiX solves the forces, and files in their formats hold them.

`calculix_responses` takes displacement and stress at integration points from CalculiX' own printed
tables of one static step a force. `linear_responses` also works about a deformed state: by the
stiffness that CalculiX wrote there, and the law of the material at the integration points.
"""

import re
import subprocess
from itertools import product

import numpy as np

import fembridge as fb
from decks.inp import read_inp
from decks.perturbation import linear_state, stiffness_deck
from decks.shape_functions import BEST_POINTS, shape_functions
from decks.solid_model import read_solid_model
from fembridge.host.machine import find_ccx
from fembridge.touching import mesh_green
from tests.fembridge.results.marc import post_writer

_G = 3**-0.5
POINTS = {
    "hex8": np.array(list(product((-_G, _G), repeat=3)))[:, ::-1],
    "tet4": np.full((1, 3), 0.25),
    "tet10": BEST_POINTS["tet10"],
}


# Order in which Abaqus may print points, and in which Marc stores them (next to corner 1, 2, ...),
# by rows of `POINTS`.
PRINTED_ORDER = {"hex8": range(8), "tet4": [0], "tet10": [2, 0, 3, 1]}
MARC_ORDER = {"hex8": range(8), "tet10": [3, 0, 1, 2]}
MARC_TYPES = {"hex8": 7, "tet10": 127}


class Responses:
    """Displacement ``(K, N, 3)`` and stress at points ``(K, E, P, 6)`` under 1 N, in mm and MPa.

    Nodes and elements are those of the model, `state` ``(N, 3)`` their displacement before, and
    `state_stress` ``(E, P, 6)`` their stress; shears are xy, yz, zx.
    """

    def __init__(self, plan, moved, stress, state=None):
        self.plan, self.moved, self.stress = plan, moved, stress
        self.state = np.zeros_like(moved[0]) if state is None else state
        self.state_stress = np.full_like(stress[0], 0.125 * (state is not None))


def calculix_responses(folder, text, plan):
    """Responses to the positive forces of a plan, by one linear step of CalculiX a force."""
    folder.mkdir()
    request = "*NODE PRINT, NSET=ALL\nU\n*EL PRINT, ELSET=RUBBER\nS\n"
    forces = np.concatenate(plan.decks)
    forces = forces[forces[:, 2] > 0]
    steps = [
        f"*STEP\n*STATIC\n*CLOAD, OP=NEW\n{node}, {axis}, 1.\n{request}*END STEP\n"
        for node, axis, _ in forces.tolist()
    ]
    (folder / "own.inp").write_text(text + "".join(steps))
    subprocess.run([find_ccx(), "-i", "own"], cwd=folder, check=True, capture_output=True)
    tables = re.split(r"\n *(displacements|stresses) [^\n]*\n", (folder / "own.dat").read_text())
    numbers = {"displacements": [], "stresses": []}
    for name, body in zip(tables[1::2], tables[2::2], strict=True):
        rows = [line.split() for line in body.splitlines() if re.match(r" +\d+ ", line)]
        numbers[name].append(np.array(rows, dtype=float))
    moved = np.stack(numbers["displacements"])[..., 1:4]
    stress = np.stack(numbers["stresses"])[..., 2:8]  # xx, yy, zz, xy, xz, yz
    elements = plan.model.element_count
    stress = stress.reshape(len(forces), elements, -1, 6)[..., [0, 1, 2, 3, 5, 4]]
    return Responses(plan, moved, stress)


def linear_responses(folder, text, plan, monkeypatch):
    """The same about the state of a plan."""
    deck = read_inp(text.encode())
    model, state = read_solid_model(deck), linear_state(deck, plan.request.after_step)
    run, _ = mesh_green._run(folder, stiffness_deck(state), fb.Solver(threads=1))
    linear = mesh_green._LinearModel(model, state, run)
    factors = linear.factorise()
    forces = np.concatenate(plan.decks)
    forces = forces[forces[:, 2] > 0]
    loads = np.zeros((linear.size, len(forces)))
    rows = model.rows_of(forces[:, 0])
    loads[linear.unknown[rows, forces[:, 1] - 1], np.arange(len(forces))] = 1.0
    solved = factors.solve(loads, np.ones(linear.size, dtype=bool))
    moved = np.zeros((len(forces), *model.position.shape))
    free = linear.unknown >= 0
    moved[:, free] = solved[linear.unknown[free]].T
    (block,) = model.elements
    at = POINTS if not block.name.endswith("R") else BEST_POINTS
    with monkeypatch.context() as patch:
        patch.setattr(mesh_green, "BEST_POINTS", at)
        _, stress_rows = linear.stress_rows(block.number, np.eye(3))
    points, elements = len(at[block.kind]), len(block.number)
    stress = (stress_rows @ solved).T.reshape(len(forces), points, elements, 6)
    return Responses(plan, moved, stress.transpose(0, 2, 1, 3), linear.moved)


def made_up_responses(plan, seed=0):
    """Reciprocal displacements, and stress that is a polynomial: no solid, but files of one.

    The polynomial holds at each point of C3D10, else for the mean over the points of an element;
    ``polynomial(positions)`` is ``(K, P, 6)``.
    """
    rng = np.random.default_rng(seed)
    forces = np.concatenate(plan.decks)
    forces = forces[forces[:, 2] > 0]
    model = plan.model
    freedom = 3 * model.rows_of(forces[:, 0]) + forces[:, 1] - 1
    root = rng.normal(size=(3 * model.node.size, 3 * model.node.size))
    moved = (root @ root.T)[freedom].reshape(len(forces), -1, 3)
    (block,) = model.elements
    count = 1 if block.name.endswith("R") else len(POINTS[block.kind])
    factors = rng.normal(size=(len(forces), 10, 6))

    def polynomial(position):
        x, y, z = position.T
        terms = np.stack([x**0, x, y, z, x * x, y * y, z * z, x * y, y * z, z * x], -1)
        return np.einsum("pt,ktc->kpc", terms, factors)

    middles = model.position[block.rows].mean(axis=1)
    apart = rng.normal(size=(len(forces), len(block.number), count, 6))
    apart -= apart.mean(axis=2, keepdims=True)
    if block.kind == "tet10":
        share = np.stack([shape_functions("tet10", point)[0] for point in POINTS["tet10"]])
        places = np.einsum("pk,eki->epi", share, model.position[block.rows])
        at_points = polynomial(places.reshape(-1, 3)).reshape(apart.shape)
        apart = at_points - polynomial(middles)[:, :, None]
    responses = Responses(plan, moved, polynomial(middles)[:, :, None] + apart)
    responses.polynomial = polynomial
    return responses


# ---- Abaqus: printed tables of four digits


def printed(value):
    """A number as Abaqus prints it: fixed from 0.1 to 10 000, else with an exponent."""
    if value == 0 or 0.1 <= abs(value) < 9999.5:
        whole = len(str(int(abs(value)))) if abs(value) >= 1 else 0
        return f"{value:.{4 - whole}f}" + "." * (whole == 4)
    return f"{value:.3E}"


def _table(preamble, labels, columns, rows):
    body = "".join(
        "".join(f"{label:>11}" for label in of_row)
        + "    "
        + "".join(f" {printed(value):>11}" for value in values)
        + "\n"
        for of_row, values in rows
        if np.any(values)
    )
    names = "".join(f"{name:<12}" for name in columns)
    return (
        f"\n   THE FOLLOWING TABLE IS PRINTED {preamble}\n\n       {labels}FOOT-   {names}\n"
        f"            NOTE\n\n{body or '      ALL VALUES IN THIS TABLE ARE ZERO'}\n\n"
    )


def _head(step, time_s):
    return (
        f"\n                  S T E P       {step}     S T A T I C   A N A L Y S I S\n\n"
        "                                INCREMENT     1 SUMMARY\n\n\n"
        f" TIME INCREMENT COMPLETED  {time_s:.3E},  FRACTION OF STEP COMPLETED   1.00\n"
        f" STEP TIME COMPLETED       {time_s:.3E},  TOTAL TIME COMPLETED        {time_s:.3E}\n\n"
    )


def dat_text(responses, numbers, *, after_step=0, steps=False):
    """A ``.dat`` with the tables of the forces `numbers`, as the decks ask for them."""
    plan, model = responses.plan, responses.plan.model
    (block,) = model.elements
    title = "1\n{:78}Abaqus 2021  Date 01-Jan-2026\n".format("")
    parts = [title]
    nodes, skin = model.node, model.rows_of(plan.nodes)
    node_set = "FOR NODES BELONGING TO NODE SET FEMBRIDGE_{}"
    columns = ["U1", "U2", "U3"]
    if after_step:
        rows = [((n,), u) for n, u in zip(nodes.tolist(), responses.state.tolist(), strict=True)]
        parts += [_head(after_step, 1.0), _table(node_set.format("STATE"), "NODE ", columns, rows)]
    first = after_step + 1
    parts.append(_head(first, 2.22e-16))
    where = (
        f"AT THE INTEGRATION POINTS FOR ELEMENT TYPE {block.name} AND ELEMENT\n"
        "     SET FEMBRIDGE_LAYER"
    )
    chosen = np.flatnonzero(np.isin(block.number, plan.elements))
    order = list(PRINTED_ORDER[block.kind])[: responses.stress.shape[2]]
    if (plan.samples.count > 1).any():
        position = model.position + responses.state
        rows = []
        for row in chosen:
            for point, place in enumerate(POINTS[block.kind][order]):
                share, _ = shape_functions(block.kind, place)
                at = share @ position[block.rows[row]]
                rows.append(((int(block.number[row]), point + 1), at))
        parts.append(_table(where, "ELEMENT  PT ", ["COOR1", "COOR2", "COOR3"], rows))
        first += 1
        parts.append(_head(first, 2.22e-16))
    for count, number in enumerate(numbers):
        if steps and count:
            parts.append(_head(first + count, 2.22e-16))
        stress = responses.stress[number][:, order][..., [0, 1, 2, 3, 5, 4]]
        rows = [
            ((int(block.number[row]), point + 1), stress[row, point])
            for row in chosen
            for point in range(stress.shape[1])
        ]
        names = ["S11", "S22", "S33", "S12", "S13", "S23"]
        parts.append(_table(where, "ELEMENT  PT ", names, rows))
        moved = responses.moved[number][skin]
        rows = [((node,), u) for node, u in zip(plan.nodes.tolist(), moved.tolist(), strict=True)]
        parts.append(_table(node_set.format("SKIN"), "NODE ", columns, rows))
    return "".join(parts) + "\n          THE ANALYSIS HAS BEEN COMPLETED\n"


# ---- Marc: a deck, and post files


def marc_block(text, preload_n=0.0):
    """The deck of `block_deck` for Marc, after Mentat; a load case pulls at the set CORNERS."""
    model = read_solid_model(read_inp(text.encode()))
    (block,) = model.elements

    def reals(*values):
        return "".join(f"{value:20.13E}" for value in values)

    def integers(*values):
        return "".join(f"{value:10d}" for value in values)

    def members(numbers):
        rows = [numbers[k : k + 13] for k in range(0, len(numbers), 13)]
        for number, row in enumerate(rows):
            goes_on = "   c" if number < len(rows) - 1 else ""
            yield "".join(f"{member:12d}" for member in row) + goes_on

    corners, kind = model.node[block.rows], MARC_TYPES[block.kind]
    sets = [(name, "node", numbers) for name, numbers in model.node_sets.items()]
    sets.append(("RUBBER", "element", block.number))
    lines = [
        *("title               block", "extended"),
        "sizing".ljust(30) + integers(0, len(block.number), len(model.node), 0),
        *(f"elements            {kind:10d}", "version".ljust(20) + integers(15, 2, 0, 0)),
        "table".ljust(20) + integers(0, 0, 2, 1, 1, 0, 0, 1),
        *("large stra                   2         0", "all points", "end"),
        *("connectivity", integers(0, 0, 1, 0, 1, 1, 0, 0, 0)),
        *(integers(n, kind, *row) for n, row in zip(block.number, corners, strict=True)),
        *("coordinates", integers(3, len(model.node), 0, 1)),
        *(
            integers(n) + reals(*at)
            for n, at in zip(model.node, model.position.tolist(), strict=True)
        ),
    ]
    for name, of, numbers in sets:
        lines += [f"{'define':<20}{of:<20}{'set':<20}{name}", *members(numbers)]
    lines += [
        *("isotropic           structural", integers(0, 0, 0, 2)),
        f"{1:10d}{'elastic':<20}{'':<20}{integers(10, 0, 0, 0)}soft",
        *(reals(0.2, 0.45, 1, 0, 0, 0, 0, 0), integers(*[0] * 8), reals(0), integers(0), ""),
        *("table               ramp", integers(1, 1, 0, 0, 2)),
        integers(1, 2, 2, *(0, 0, 2) * 3, *[0] * 4),
        *(reals(0, 0), reals(1, 1)),
        *("fixed disp", "", integers(1, 0, 0, 0, 1, 0) + "held", reals(0, 0, 0)),
        *(integers(0, 0, 0), integers(1, 2, 3), integers(2), "BOTTOM"),
        *("point load", "", integers(1, 0, 0, 0, 0, 0) + "pull"),
        *(reals(preload_n, 0, preload_n), integers(1, 0, 1), integers(2), "CORNERS"),
        *("loadcase            job1", integers(1), "held", "no print"),
        *("post", integers(1, 16, 17, 0, 0, 19, 20, 0, 1, *[0] * 7), integers(17, 0)),
        *("end option", "title               pulled", "loadcase            pulled"),
        *(integers(2), "held", "pull"),
        *("control             structural", integers(50, 10, 0, 0, 0, 1, *[0] * 9)),
        *(reals(0.1, 0, 0, 0, 0, 0, -1, 0), "auto load", integers(4, 0, 10, 0, 0)),
        *("time step", reals(0.25), "continue"),
    ]
    return "\n".join(lines) + "\n"


def post_file(responses, forces, *, force_n, start_s, squared=0.0, left=0.0, binary=True):
    """A ``.t16`` with increments at the times of a deck of `forces`.

    `squared` of a response grows with the square of the force; `left` stays after all forces.
    """
    model = responses.plan.model
    (block,) = model.elements
    positive = np.concatenate(responses.plan.decks)
    positive = positive[positive[:, 2] > 0]
    row_of = {(node, axis): row for row, (node, axis, _) in enumerate(positive.tolist())}
    mesh = post_writer.Model(
        node_ids=tuple(model.node.tolist()),
        coordinates=tuple(map(tuple, model.position.tolist())),
        elements=tuple(
            (int(n), MARC_TYPES[block.kind], tuple(model.node[row].tolist()), (1, 1, 1, 3, 1))
            for n, row in zip(block.number, block.rows, strict=True)
        ),
        points=responses.stress.shape[2],
        codes=tuple((code, 0, "") for code in range(311, 317)),
        dimensions=3,
    )

    order = list(MARC_ORDER[block.kind])

    def increment(number, time_s, moved, stress):
        stress = stress[:, order]
        nodal = (post_writer.Quantity("Displacement", 1, 3, moved),)
        return post_writer.Increment(number=number, time_s=time_s, element=stress, nodal=nodal)

    quiet = responses.state, responses.state_stress
    increments = [increment(n, n * start_s / 4, *quiet) for n in range(5 if start_s else 1)]
    increments += [increment(0, start_s + k, *quiet) for k in (1, 2, 3)]
    largest = np.abs(responses.moved).max()
    for number, (node, axis, sign) in enumerate(forces.tolist()):
        row = row_of[node, axis]
        size = sign * force_n
        moved = responses.moved[row] * size
        moved = responses.state + moved + squared * np.abs(moved)
        stress = responses.state_stress + size * responses.stress[row]
        if number == 1:  # Marc has cut this increment
            increments.append(increment(0, start_s + 4.5, *quiet))
        increments.append(increment(0, start_s + 4.0 + number, moved, stress))
    last = responses.state + left * largest * force_n, responses.state_stress
    increments.append(increment(0, start_s + 4.0 + len(forces), *last))
    return post_writer.post_bytes(post_writer.Storage(binary=binary), mesh, increments)
