"""Pads of meshes that CalculiX helps to compute, compared with its own runs."""

import json
import re
import subprocess

import numpy as np
import pytest
from numpy.testing import assert_allclose

import fembridge as fb
from decks.inp import read_inp
from decks.perturbation import linear_state, stiffness_deck
from decks.solid_model import read_solid_model
from fembridge.cli import main
from fembridge.errors import DeckError, ResponseError
from fembridge.host.machine import find_ccx
from fembridge.results import read_fields
from fembridge.solver.factorisation import Factors
from fembridge.touching import mesh_green
from fembridge.touching.contact import press_to
from fembridge.touching.mesh_green import AGREEMENT
from fembridge.touching.shape import Shape
from fembridge.touching.stress import von_mises_pa
from tests.fembridge.touching.mesh_models import block_deck, block_of

NEO_HOOKE = "*HYPERELASTIC, NEO HOOKE\n0.05, 1.\n"
PULLED = (
    "*STEP, NLGEOM\n*STATIC\n0.25, 1.\n*CLOAD\nCORNERS, 1, 0.005\nCORNERS, 3, 0.005\n*END STEP\n"
)


def solved(folder, text):
    """Results of a deck that CalculiX solves."""
    folder.mkdir(exist_ok=True)
    (folder / "own.inp").write_text(text)
    subprocess.run([find_ccx(), "-i", "own"], cwd=folder, check=True, capture_output=True)
    return folder / "own.frd"


def press(node, force_n):
    """A step with a small force, and results at all nodes."""
    return (
        f"*STEP, NLGEOM\n*STATIC\n1., 1.\n*CLOAD\n{node}, 3, {force_n}\n"
        "*NODE OUTPUT, DOUBLE\nU\n*ELEMENT OUTPUT, DOUBLE\nS\n*END STEP\n"
    )


def made(folder, text, **settings):
    deck = folder / "mine.inp"
    deck.write_text(text)
    words = {"skin": "TOP", "afferents": "INNER", "solver": fb.Solver(threads=1), **settings}
    return fb.make_pad(base_deck=deck, **words)


@pytest.mark.solver
@pytest.mark.parametrize("kind", ["C3D8", "C3D8R", "C3D8I"])
def test_displacements_are_those_of_calculix_itself(tmp_path, kind):
    pad = made(tmp_path, block_deck(kind=kind))
    assert pad.origin["difference"] < AGREEMENT
    node = int(pad.node[np.linalg.norm(pad.position_mm, axis=1).argmin()])
    load = f"*STEP\n*STATIC\n*CLOAD\n{node}, 3, -0.001\n*NODE OUTPUT, DOUBLE\nU\n*END STEP\n"
    (moved,) = read_fields(solved(tmp_path / "own", block_deck(kind=kind, more=load)), "DISP")
    at = np.searchsorted(moved.nodes, pad.node)
    expected = -1000 * moved.values[at, 2]
    assert_allclose(pad.down_mm[1][:, pad.node == node][:, 0], expected, atol=2e-6 * expected.max())
    across, along = (np.array(pad.origin[name]) for name in ("outward", "along"))
    aside = -1000 * moved.values[at][:, :3] @ -np.cross(across, along)
    # Reciprocity: what a force along x here moves into the skin there.
    assert_allclose(pad.down_mm[0][pad.node == node][0], aside, atol=2e-6 * expected.max())


@pytest.mark.slow
@pytest.mark.solver
@pytest.mark.parametrize(
    ("material", "more", "after_step"),
    [(NEO_HOOKE, "", 0), (NEO_HOOKE, PULLED, 1), ("*ELASTIC\n0.2, 0.45\n", PULLED, 1)],
    ids=["neo-hooke", "pulled neo-hooke", "pulled elastic"],
)
def test_a_state_is_linearised_as_a_small_further_force_moves_it(
    tmp_path, material, more, after_step
):
    """Elements with one point, in whose middle CalculiX computes stress too."""
    text = block_deck(kind="C3D8R", material=material, more=more)
    pad = made(tmp_path, text, after_step=after_step)
    node = int(pad.node[np.linalg.norm(pad.position_mm, axis=1).argmin()])
    force_n = 1e-3
    printed = "*EL PRINT, ELSET=RUBBER\nS\n*END STEP\n"
    stress, moved = [], []
    for sign in (1, -1):
        further = press(node, sign * force_n).replace("*END STEP\n", printed)
        results = solved(tmp_path / f"own{sign}", text + further)
        moved.append(list(read_fields(results, "DISP"))[-1])
        rows = (tmp_path / f"own{sign}" / "own.dat").read_text().splitlines()
        table = [line.split() for line in rows if re.match(r" +\d+ +1 +[-\d]", line)]
        stress.append(np.array([list(map(float, row[2:8])) for row in table[-6 * 6 * 4 :]]))
    at = np.searchsorted(moved[0].nodes, pad.node)
    expected = (moved[0].values[at, 2] - moved[1].values[at, 2]) / (2 * force_n)
    outward = np.array(pad.origin["outward"])
    if after_step == 0:  # all normals are the direction of the force
        own = pad.down_mm[1][:, pad.node == node][:, 0]
        assert_allclose(own, expected * outward[2], atol=2e-4 * np.abs(expected).max())
    deck = read_inp(text.encode())
    model, state = read_solid_model(deck), linear_state(deck, after_step)
    run, _ = mesh_green._run(tmp_path / "again", stiffness_deck(state), fb.Solver(threads=1))
    linear = mesh_green._LinearModel(model, state, run)
    _, rows = linear.stress_rows(model.element_sets["RUBBER"], np.eye(3))
    load = np.zeros((linear.size, 1))
    load[linear.unknown[model.rows_of(np.array([node]))[0], 2]] = 1.0
    found = rows @ linear.factorise().solve(load, np.ones(linear.size, dtype=bool))
    change = (stress[0] - stress[1]) / (2 * force_n)  # xx, yy, zz, xy, xz, yz
    expected_mpa = change[:, [0, 1, 2, 3, 5, 4]].ravel()
    assert_allclose(found[:, 0], expected_mpa, atol=4e-3 * np.abs(expected_mpa).max())


@pytest.mark.slow
@pytest.mark.solver
@pytest.mark.parametrize("kind", ["C3D4", "C3D6", "C3D8", "C3D10", "C3D15", "C3D20", "C3D20R"])
def test_elements_of_all_kinds_answer_a_ball_alike(tmp_path, kind):
    """Bricks, and the wedges and tetrahedra that they are cut into; linear ones are stiffer."""
    pad = made(tmp_path, block_of(kind), skin="SKIN", afferents="RUBBER:0.9")
    assert pad.origin["difference"] < AGREEMENT
    nodes, forces, _ = press_to(pad, Shape.sphere(8.0), np.array([150.0]))
    place = np.array(["RUBBER"]), np.zeros(1), np.zeros(1), np.array([0.9])
    stress_pa = von_mises_pa(pad.influence_pa(nodes, *place), forces)[0, 0]
    is_linear = kind in ("C3D4", "C3D6", "C3D8")
    # The means of the quadratic kinds.
    assert_allclose(forces.sum(), 0.0498, rtol=0.25 if is_linear else 0.05)
    assert_allclose(stress_pa, 17_700, rtol=0.12 if is_linear else 0.03)


@pytest.mark.slow
@pytest.mark.solver
def test_an_interrupted_pad_goes_on_where_it_stopped(tmp_path, monkeypatch):
    runs = tmp_path / "runs"
    solver = fb.Solver(threads=1, runs_folder=runs)
    whole = made(tmp_path, block_deck(), solver=solver)
    parts = sorted(runs.glob("forces_*/part_*.npy"))
    parts[-1].unlink()
    solve, sizes = Factors.solve, []

    def counted(factors, loads, required):
        sizes.append(loads.shape[1])
        return solve(factors, loads, required)

    monkeypatch.setattr(Factors, "solve", counted)
    again = made(tmp_path, block_deck(), solver=solver)
    assert len(parts) > 1 and sizes == [3, whole.origin["unit_forces"] - 96 * (len(parts) - 1)]
    assert np.array_equal(again.down_mm, whole.down_mm)


@pytest.mark.slow
@pytest.mark.solver
@pytest.mark.filterwarnings("ignore::fembridge.errors.FembridgeWarning")
def test_the_command_makes_a_pad_that_touch_takes(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.inp").write_text(block_deck(across=8))
    words = "pad --base-deck mine.inp --skin TOP --afferents SA=RUBBER:0.6 --afferents PC=1 --json"
    assert main([*words.split(), "-o", "pad.npz"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["unit_forces"] == 3 * 81 and summary["difference"] < AGREEMENT
    touch = "touch --pad pad.npz --shape sphere --press-um 200 --tilt-deg 5 0 --json -o out"
    assert main([*touch.split(), "--population", "one_each"]) == 0
    assert json.loads(capsys.readouterr().out)["force_n"] > 0
    assert (tmp_path / "out" / "pad.png").is_file()


@pytest.mark.solver
def test_a_model_that_is_not_held_and_nodes_that_follow_others_are_reported(tmp_path):
    free = block_deck().replace("BOTTOM, 1, 3", "BOTTOM, 3, 3")
    with pytest.raises((ResponseError, fb.errors.SolverError)):
        made(tmp_path, free)
    inner = next(iter(read_solid_model(read_inp(block_deck().encode())).node_sets["INNER"]))
    follows = f"*EQUATION\n2\n{inner}, 3, 1., {inner + 1}, 3, -1.\n"
    with pytest.raises(DeckError, match=f"node {inner} "):
        made(tmp_path, block_deck().replace("*BOUNDARY", f"{follows}*BOUNDARY"))


# ---- Whole contact


def ball_deck(order, size_mm, radius_mm=4.0):
    """A ball of tetrahedra that is held below; sets SKIN and INNER, and its numbers."""
    gmsh = pytest.importorskip("gmsh")
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.occ.addSphere(0, 0, 0, radius_mm)
        gmsh.model.occ.synchronize()
        field = gmsh.model.mesh.field
        field.add("Ball", 1)
        near = {"ZCenter": radius_mm, "Radius": 1.3, "Thickness": 4, "VIn": size_mm, "VOut": 1.6}
        for name, value in near.items():
            field.setNumber(1, name, value)
        field.setAsBackgroundMesh(1)
        for name in ("ExtendFromBoundary", "FromPoints", "FromCurvature"):
            gmsh.option.setNumber(f"Mesh.MeshSize{name}", 0)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(order)
        tag, at, _ = gmsh.model.mesh.getNodes()
        _, _, (element,) = gmsh.model.mesh.getElements(3)
    finally:
        gmsh.finalize()
    width = {1: 4, 2: 10}[order]
    element = element.reshape(-1, width)[:, [*range(min(width, 8)), *((9, 8) if order > 1 else ())]]
    used = np.isin(tag, element)
    tag, at = tag[used], at.reshape(-1, 3)[used]
    x, y, z = at.T
    away = np.linalg.norm(at, axis=1)
    sets = {
        "SKIN": (away > radius_mm - 0.01 * order) & (z > 1.5),
        "FIXED": z < -1,
        "INNER": (np.hypot(x, y) < 0.7) & (z < radius_mm - 0.45) & (z > radius_mm - 1.5),
    }
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{n}, {a:.9f}, {b:.9f}, {c:.9f}" for n, (a, b, c) in zip(tag, at, strict=True)]
    lines.append(f"*ELEMENT, TYPE=C3D{width}, ELSET=RUBBER")
    lines += [f"{n}, " + ", ".join(map(str, row)) for n, row in enumerate(element.tolist(), 1)]
    for name, chosen in sets.items():
        lines += [f"*NSET, NSET={name}", *(f"{n}," for n in tag[chosen])]
    lines += ["*MATERIAL, NAME=SOFT", "*ELASTIC", "0.2, 0.45"]
    lines += ["*SOLID SECTION, ELSET=RUBBER, MATERIAL=SOFT", "*BOUNDARY", "FIXED, 1, 3"]
    return "\n".join(lines) + "\n", int(tag.max()) + 1, len(element) + 1, float(z.max())


@pytest.mark.slow
@pytest.mark.solver
@pytest.mark.parametrize(("order", "size_mm"), [(1, 0.15), (2, 0.25)])
def test_a_plate_on_a_ball_of_tetrahedra_is_the_contact_of_calculix(tmp_path, order, size_mm):
    """Force within 3 %, von Mises stress at inner nodes within an rms of 5 % of each."""
    text, node, element, top_mm = ball_deck(order, size_mm)
    pad = made(tmp_path, text, skin="SKIN", skin_map=fb.SkinMap(outward=(0, 0, 1), along=(0, 1, 0)))
    square, depth_mm = ((-4, -4), (4, -4), (4, 4), (-4, 4)), 0.15
    corners = [(x, y, z) for z in (top_mm, top_mm + 1) for x, y in square]
    plate = "*NODE, NSET=PLATE\n" + "".join(
        f"{node + n}, {x}, {y}, {z:.9f}\n" for n, (x, y, z) in enumerate(corners)
    )
    numbers = ", ".join(str(node + n) for n in range(8))
    contact = (
        f"{plate}*ELEMENT, TYPE=C3D8, ELSET=STIFF\n{element}, {numbers}\n"
        "*MATERIAL, NAME=STEEL\n*ELASTIC\n1000., 0.3\n"
        "*SOLID SECTION, ELSET=STIFF, MATERIAL=STEEL\n"
        f"*SURFACE, NAME=MASTER\n{element}, S1\n*SURFACE, NAME=SLAVE, TYPE=NODE\nSKIN\n"
        "*SURFACE INTERACTION, NAME=HARD\n"
        "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR\n200., 0.001\n"
        "*CONTACT PAIR, INTERACTION=HARD, TYPE=NODE TO SURFACE\nSLAVE, MASTER\n"
        "*STEP, INC=100\n*STATIC\n0.5, 1., 1.E-4, 0.5\n*BOUNDARY\nPLATE, 1, 2\n"
        f"PLATE, 3, 3, {-depth_mm}\n*NODE OUTPUT, DOUBLE\nU\n*ELEMENT OUTPUT, DOUBLE\nS\n"
        "*NODE PRINT, NSET=PLATE, TOTALS=ONLY\nRF\n*END STEP\n"
    )
    stress = list(read_fields(solved(tmp_path / "whole", text + contact), "STRESS"))
    force_n = float((tmp_path / "whole" / "own.dat").read_text().split()[-1])
    nodes, forces, _ = press_to(pad, Shape.plate(), np.array([1e3 * depth_mm]))
    assert_allclose(forces.sum(), -force_n, rtol=0.03)
    inner = read_solid_model(read_inp(text.encode())).node_sets["INNER"]
    theirs = stress[-1].values[np.searchsorted(stress[-1].nodes, inner)]
    theirs_pa = von_mises_pa(theirs.T[:, :, None], np.ones((1, 1)))[0]
    places = np.full(inner.size, "INNER"), *pad._stress_map_mm.T, pad.point_depth_mm
    ours_pa = von_mises_pa(pad.influence_pa(nodes, *places), forces)[0]
    assert np.sqrt(np.mean((ours_pa / theirs_pa - 1) ** 2)) < 0.05


@pytest.mark.slow
@pytest.mark.solver
def test_a_ball_on_a_block_of_bricks_is_hertz(tmp_path):
    """Bricks of 0.15 mm that grow to 40 mm: force within 3 %, stress on the axis within 5 %."""
    step_mm, side = [0.15 * n for n in range(8)], 0.15
    while step_mm[-1] < 40:
        side *= 1.45
        step_mm.append(step_mm[-1] + side)
    axis = np.array([*(-each for each in step_mm[:0:-1]), *step_mm])
    down = -np.array(step_mm[::-1])
    count = axis.size
    number = np.arange(1, count**2 * down.size + 1).reshape(down.size, count, count)
    z, y, x = (each.ravel() for each in np.meshgrid(down, axis, axis, indexing="ij"))
    lower, upper = number[:-1], number[1:]
    ring = [(slice(None, -1), slice(None, -1)), (slice(None, -1), slice(1, None)),
            (slice(1, None), slice(1, None)), (slice(1, None), slice(None, -1))]  # fmt: skip
    element = np.stack([part[:, a, b].ravel() for part in (lower, upper) for a, b in ring], -1)
    far = np.concatenate(
        [number[0].ravel(), number[:, [0, -1]].ravel(), number[..., [0, -1]].ravel()]
    )
    near = np.flatnonzero(np.abs(axis) < 1.06)
    lines = [
        "*NODE",
        *(
            f"{n}, {a:.6f}, {b:.6f}, {c:.6f}"
            for n, (a, b, c) in enumerate(zip(x, y, z, strict=True), 1)
        ),
    ]
    lines += ["*ELEMENT, TYPE=C3D8, ELSET=RUBBER"]
    lines += [f"{n}, " + ", ".join(map(str, row)) for n, row in enumerate(element.tolist(), 1)]
    for name, nodes in (("FAR", np.unique(far)), ("TOP", number[-1][np.ix_(near, near)].ravel())):
        lines += [f"*NSET, NSET={name}", *(f"{n}," for n in nodes)]
    young, poisson = 0.2, 0.4
    lines += ["*MATERIAL, NAME=SOFT", "*ELASTIC", f"{young}, {poisson}"]
    lines += ["*SOLID SECTION, ELSET=RUBBER, MATERIAL=SOFT", "*BOUNDARY", "FAR, 1, 3"]
    pad = made(tmp_path, "\n".join(lines) + "\n", afferents="RUBBER:0.5")
    radius_mm, depth_mm, modulus = 4.0, 0.1, young / (1 - poisson**2)
    nodes, forces, _ = press_to(pad, Shape.sphere(2 * radius_mm), np.array([1e3 * depth_mm]))
    expected_n = 4 / 3 * modulus * radius_mm**0.5 * depth_mm**1.5
    assert_allclose(forces.sum(), expected_n, rtol=0.03)
    contact_mm = (radius_mm * depth_mm) ** 0.5
    pressure = 1.5 * expected_n / (np.pi * contact_mm**2)
    ratio = 0.5 / contact_mm
    along = -1 / (1 + ratio**2)
    beside = -(1 + poisson) * (1 - ratio * np.arctan(1 / ratio)) + 0.5 / (1 + ratio**2)
    place = np.array(["RUBBER"]), np.zeros(1), np.zeros(1), np.array([0.5])
    found_pa = von_mises_pa(pad.influence_pa(nodes, *place), forces)[0, 0]
    assert_allclose(found_pa, 1e6 * pressure * abs(along - beside), rtol=0.05)
