"""Pads of models of Abaqus and Marc: CalculiX stands in for them, files have their formats."""

import json
import re

import numpy as np
import pytest
from numpy.testing import assert_allclose

import fembridge as fb
from fembridge.cli import main
from fembridge.errors import DeckError, FembridgeWarning, ResponseError, ResultError, UsageError
from fembridge.touching.force_runs import read_forces
from fembridge.touching.mesh_pad import tangents
from tests.fembridge.touching import stand_in_solvers as stand_in
from tests.fembridge.touching.mesh_models import block_deck, block_of

marc_text = stand_in.marc_block
SMALL = block_deck(across=2, down=2)
REQUEST = {"skin": "TOP", "afferents": "RUBBER:0.6"}
PULLED = (
    "*STEP, NLGEOM\n*STATIC\n0.25, 1.\n*CLOAD\nCORNERS, 1, 0.002\nCORNERS, 3, 0.002\n*END STEP\n"
)


def written(folder, text, name="mine.inp"):
    (folder / name).write_text(text)
    return folder / name


def brought(forces, responses, **form):
    """Write the results of all decks into the folder of the forces."""
    first = 0
    for deck, path in zip(forces.decks, forces.results, strict=True):
        count = int((deck[:, 2] > 0).sum())
        if forces.solver == "abaqus":
            path.write_text(stand_in.dat_text(responses, range(first, first + count), **form))
        else:
            path.write_bytes(stand_in.post_file(responses, deck, force_n=1e-4, **form))
        first += count


def assert_same_pad(pad, expected, *, displacement, stress):
    """Shares of the largest displacement in each direction, and of the largest stress."""
    assert np.array_equal(pad.node, expected.node)
    for ours, theirs in zip(pad.down_mm, expected.down_mm, strict=True):
        assert_allclose(ours, theirs, atol=displacement * np.abs(theirs).max())
    tensors = [one.stress.astype(float) * one.stress_scale_pa for one in (pad, expected)]
    assert_allclose(pad.point_mm, expected.point_mm, atol=1e-3)
    assert_allclose(*tensors, atol=stress * np.abs(tensors[1]).max())


# ---- The same numbers as CalculiX


@pytest.mark.solver
@pytest.mark.parametrize(
    "form",
    [
        "load cases",
        *(pytest.param(form, marks=pytest.mark.slow) for form in ("steps", "several decks")),
    ],
)
def test_printed_tables_of_abaqus_make_the_pad_of_calculix(tmp_path, form):
    """Four printed digits: displacement within 5e-4 of the largest, stress within 1e-3."""
    text = block_deck(across=3)
    deck = written(tmp_path, text)
    options = {"step_per_force": True} if form == "steps" else {}
    options = {"forces_per_deck": 20} if form == "several decks" else options
    forces = fb.pad_decks(deck, tmp_path / "pad", target="abaqus", **REQUEST, **options)
    assert len(forces.decks) == (3 if form == "several decks" else 1) and forces.count == 48
    brought(
        forces, stand_in.calculix_responses(tmp_path / "ccx", text, forces), steps=form == "steps"
    )
    pad = fb.make_pad(base_deck=tmp_path / "pad")
    assert pad.origin["solver"] == "Abaqus"
    expected = fb.make_pad(base_deck=deck, solver=fb.Solver(threads=1), **REQUEST)
    assert_same_pad(pad, expected, displacement=5e-4, stress=1e-3)
    pad.write(tmp_path / "pad.npz")
    np.testing.assert_allclose(
        fb.Pad.read(tmp_path / "pad.npz").down_mm, pad.down_mm, rtol=2**-6, atol=1e-4
    )


@pytest.mark.solver
def test_increments_of_marc_make_the_pad_of_calculix(tmp_path):
    """Binary numbers of single precision; the file has an increment that Marc cut."""
    text = block_deck(across=3)
    expected = fb.make_pad(
        base_deck=written(tmp_path, text), solver=fb.Solver(threads=1), **REQUEST
    )
    deck = written(tmp_path, stand_in.marc_block(text), "mine.dat")
    forces = fb.pad_decks(deck, tmp_path / "pad", forces_per_deck=30, **REQUEST)
    assert len(forces.decks) > 1
    brought(forces, stand_in.calculix_responses(tmp_path / "ccx", text, forces), start_s=0.0)
    pad = fb.make_pad(base_deck=tmp_path / "pad")
    assert pad.origin["nonlinear"] < 1e-6 and pad.origin["drift"] == 0
    assert_same_pad(pad, expected, displacement=1e-6, stress=2e-3)
    # A .t19 has six digits.
    forces.results[0].unlink()
    text_file = stand_in.post_file(
        stand_in.calculix_responses(tmp_path / "again", text, forces), forces.decks[0],
        force_n=1e-4, start_s=0.0, binary=False,
    )  # fmt: skip
    forces.results[0].with_suffix(".t19").write_bytes(text_file)
    printed = fb.make_pad(base_deck=tmp_path / "pad")
    assert_same_pad(printed, pad, displacement=1e-5, stress=2e-3)
    # The deck again instead of the folder.
    again = fb.make_pad(base_deck=deck, results=forces.results, forces_per_deck=30, **REQUEST)
    assert np.array_equal(again.down_mm, printed.down_mm)


@pytest.mark.solver
@pytest.mark.parametrize(
    "material",
    [
        pytest.param("*ELASTIC\n0.2, 0.45\n", marks=pytest.mark.slow),
        "*HYPERELASTIC, NEO HOOKE\n0.05, 1.\n",
    ],
)
def test_a_preload_is_the_state_about_which_the_forces_act(tmp_path, monkeypatch, material):
    """Elements with one point, in whose middle CalculiX' pad has stress too."""
    text = block_deck(across=4, kind="C3D8R", material=material, more=PULLED)
    deck = written(tmp_path, text)
    request = {**REQUEST, "afferents": "INNER", "after_step": 1}
    expected = fb.make_pad(base_deck=deck, solver=fb.Solver(threads=1), **request)
    forces = fb.pad_decks(deck, tmp_path / "pad", target="abaqus", **request)
    responses = stand_in.linear_responses(tmp_path / "linear", text, forces, monkeypatch)
    assert np.abs(responses.state).max() > 0.05
    brought(forces, responses, after_step=1)
    pad = fb.make_pad(base_deck=tmp_path / "pad")
    assert_same_pad(pad, expected, displacement=1e-3, stress=2e-3)
    assert_allclose(pad.position_mm, expected.position_mm, atol=5e-4)


@pytest.mark.slow
@pytest.mark.solver
def test_load_cases_of_marc_are_the_preload(tmp_path, monkeypatch):
    text = block_deck(across=4, more=PULLED)
    request = {**REQUEST, "after_step": 1}
    expected = fb.make_pad(
        base_deck=written(tmp_path, text), solver=fb.Solver(threads=1), **request
    )
    deck = written(tmp_path, stand_in.marc_block(text, preload_n=0.002), "mine.dat")
    forces = fb.pad_decks(deck, tmp_path / "pad", **request)
    plan = fb.pad_decks(tmp_path / "mine.inp", tmp_path / "other", target="abaqus", **request)
    solved = stand_in.linear_responses(tmp_path / "linear", text, plan, monkeypatch)
    responses = stand_in.Responses(forces, solved.moved, solved.stress, solved.state)
    brought(forces, responses, start_s=1.0)
    pad = fb.make_pad(base_deck=tmp_path / "pad")
    for ours, theirs in zip(pad.down_mm, expected.down_mm, strict=True):
        assert_allclose(ours, theirs, atol=5e-5 * np.abs(theirs).max())
    assert_allclose(pad.position_mm, expected.position_mm, atol=1e-6)


# ---- What is read, beside plain loops


@pytest.mark.parametrize(
    ("solver", "kind", "across"),
    [
        *[("abaqus", "C3D8", 3), ("abaqus", "C3D8R", 3), ("abaqus", "C3D4", 2)],
        *[("abaqus", "C3D10", 2), ("marc", "C3D8", 3), ("marc", "C3D10", 2)],
    ],
)
def test_forces_along_axes_become_those_along_normals_and_tangents(tmp_path, solver, kind, across):
    """Plain loops. A fit takes stress at the points of C3D10, else their mean in the middle.

    The order of the points of C3D10 differs between the solvers.
    """
    text = block_of(kind, across=across, down=across)
    name, text = ("mine.inp", text) if solver == "abaqus" else ("mine.dat", marc_text(text))
    target = "abaqus" if solver == "abaqus" else None
    forces = fb.pad_decks(written(tmp_path, text, name), tmp_path / "pad", target=target, **REQUEST)
    responses = stand_in.made_up_responses(forces)
    assert (forces.samples.count == (4 if kind == "C3D10" else 1)).all()
    brought(forces, responses, **({} if solver == "abaqus" else {"start_s": 0.0}))
    pad = fb.make_pad(base_deck=tmp_path / "pad")
    model, count = forces.model, forces.nodes.size
    skin = model.rows_of(forces.nodes)
    outward, forward = (np.array(pad.origin[name]) for name in ("outward", "along"))
    axes = np.stack([np.cross(outward, forward), outward, forward])
    across, along = tangents(pad.normal)
    directions = np.stack([across, -pad.normal, along], axis=1) @ axes
    positive = [force for force in np.concatenate(forces.decks).tolist() if force[2] > 0]
    rows = {(node, axis): row for row, (node, axis, _) in enumerate(positive)}
    places = pad.point_mm @ axes + np.array(pad.origin["apex_mm"])
    stress = responses.polynomial(places)
    rng = np.random.default_rng(1)
    for i, j, d, p in zip(
        *(rng.integers(0, high, 20) for high in (count, count, 3, len(places))), strict=True
    ):
        into, tensor = 0.0, np.zeros((3, 3))
        for axis in (1, 2, 3):
            number = rows[int(forces.nodes[j]), axis]
            share = directions[j, d, axis - 1]
            into += share * responses.moved[number][skin[i]] @ directions[i, 1]
            xx, yy, zz, xy, yz, zx = stress[number, p]
            tensor += share * np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
        assert_allclose(pad.down_mm[d, i, j], into, atol=1e-3 * np.abs(responses.moved).max())
        turned = axes @ tensor @ axes.T * 1e6
        expected = [turned[a, b] for a, b in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))]
        own = pad.stress[d, :, p, j].astype(float) * pad.stress_scale_pa[d, 0, p, 0]
        assert_allclose(own, expected, atol=2e-3 * pad.stress_scale_pa[d, 0, p, 0])


def test_the_size_of_the_results_is_known_before(tmp_path):
    deck = written(tmp_path, block_deck(across=3))
    forces = fb.pad_decks(deck, tmp_path / "pad", target="abaqus", **REQUEST)
    brought(forces, stand_in.made_up_responses(forces))
    assert_allclose(forces.results[0].stat().st_size, forces.expected_bytes[0], rtol=0.15)
    marc = written(tmp_path, stand_in.marc_block(block_deck(across=4)), "mine.dat")
    forces = fb.pad_decks(marc, tmp_path / "marc", **REQUEST)
    brought(forces, stand_in.made_up_responses(forces), start_s=0.0)
    assert_allclose(forces.results[0].stat().st_size, forces.expected_bytes[0], rtol=0.15)


# ---- The decks


def test_the_deck_of_abaqus_has_a_load_case_for_each_force_of_one_step(tmp_path):
    deck = written(tmp_path, block_deck(across=3, more=PULLED))
    forces = fb.pad_decks(deck, tmp_path / "pad", target="abaqus", after_step=1, **REQUEST)
    text = (tmp_path / "pad" / "forces_01.inp").read_text()
    before, perturbed = text.split("*STEP, NAME=FORCES, PERTURBATION\n*STATIC\n")
    assert perturbed.count("*LOAD CASE, NAME=") == perturbed.count("*CLOAD\n") == forces.count == 48
    assert perturbed.count("*NODE PRINT, NSET=FEMBRIDGE_SKIN") == 1
    assert perturbed.count("*EL PRINT, ELSET=FEMBRIDGE_LAYER") == 1
    assert before.endswith(
        "*NODE PRINT, NSET=FEMBRIDGE_STATE, FREQUENCY=100000, SUMMARY=NO, TOTALS=NO\nU\n*END STEP\n"
    )
    assert PULLED.removesuffix("*END STEP\n") in before
    steps = fb.pad_decks(
        deck, tmp_path / "steps", target="abaqus", after_step=1, step_per_force=True, **REQUEST
    )
    text = (tmp_path / "steps" / "forces_01.inp").read_text()
    assert text.count(", PERTURBATION\n") == steps.count and "*LOAD CASE" not in text


def test_the_undeformed_model_is_held_where_step_1_moves_it(tmp_path):
    text = block_deck(across=3, more="*STEP\n*STATIC\n*BOUNDARY\nCORNERS, 3, 3, -0.1\n*END STEP\n")
    forces = fb.pad_decks(written(tmp_path, text), tmp_path / "pad", target="abaqus", **REQUEST)
    corners = forces.model.node_sets["CORNERS"]
    of_corners = np.isin(forces.decks[0][:, 0], corners)
    assert set(forces.decks[0][of_corners, 1].tolist()) == {1, 2}
    deck = (tmp_path / "pad" / "forces_01.inp").read_text()
    assert "*BOUNDARY\nBOTTOM, 1, 3\n*BOUNDARY\nCORNERS, 3, 3\n" in deck and "-0.1" not in deck


# ---- What is refused


@pytest.fixture
def forces(tmp_path):
    forces = fb.pad_decks(
        written(tmp_path, SMALL), tmp_path / "pad", target="abaqus", forces_per_deck=15, **REQUEST
    )
    brought(forces, stand_in.made_up_responses(forces))
    return forces


def test_results_of_other_forces_are_not_reciprocal(forces):
    """The forces in another order, and the files of the decks in another order."""
    assert fb.make_pad(base_deck=forces.folder).origin["difference"] < 1e-3
    responses = stand_in.made_up_responses(forces)
    responses.moved = responses.moved[::-1]
    brought(forces, responses)
    with pytest.raises(ResponseError) as refused:
        fb.make_pad(base_deck=forces.folder)
    assert refused.value.found > 0.05
    brought(forces, stand_in.made_up_responses(forces))
    with pytest.raises(ResultError) as swapped:
        fb.make_pad(base_deck=forces.folder, results=forces.results[::-1])
    assert (swapped.value.found, swapped.value.expected) == (12, "15")


def test_files_that_lack_tables_are_refused_with_their_name(forces):
    path, other = forces.results
    text = path.read_text()
    path.write_text(text.replace("          THE ANALYSIS HAS BEEN COMPLETED\n", ""))
    with pytest.raises(ResultError) as refused:
        fb.make_pad(base_deck=forces.folder)
    assert refused.value.path == path
    path.write_text(stand_in.dat_text(stand_in.made_up_responses(forces), range(5)))
    with pytest.raises(ResultError) as refused:
        fb.make_pad(base_deck=forces.folder)
    assert (refused.value.path, refused.value.found, refused.value.expected) == (path, 5, "15")
    path.write_text(text.replace("FEMBRIDGE_SKIN", "OTHER"))
    with pytest.raises(ResultError) as refused:
        fb.make_pad(base_deck=forces.folder)
    assert refused.value.path == path
    path.write_text(re.sub("\n *19  ", "\n      900019  ", text))
    with pytest.raises(ResultError) as refused:
        fb.make_pad(base_deck=forces.folder)
    assert refused.value.path == path and refused.value.line is not None
    with pytest.raises(UsageError) as misused:
        fb.make_pad(base_deck=forces.folder, results=[other])
    assert (misused.value.argument, misused.value.found) == ("results", 1)
    path.unlink()
    with pytest.raises(ResultError) as refused:
        fb.make_pad(base_deck=forces.folder)
    assert refused.value.path == path


def test_increments_that_are_missing_not_linear_or_left_behind_are_reported(tmp_path):
    deck = written(tmp_path, stand_in.marc_block(SMALL), "mine.dat")
    forces = fb.pad_decks(deck, tmp_path / "pad", **REQUEST)
    responses = stand_in.made_up_responses(forces)
    brought(forces, responses, start_s=0.0, squared=0.04)
    with pytest.warns(FembridgeWarning) as warned:
        pad = fb.make_pad(base_deck=forces.folder)
    assert len(warned) == 1 and pad.origin["nonlinear"] == pytest.approx(0.04, rel=0.1)
    brought(forces, responses, start_s=0.0, left=0.03)
    with pytest.warns(FembridgeWarning) as warned:
        pad = fb.make_pad(base_deck=forces.folder)
    assert len(warned) == 1 and 0.01 < pad.origin["drift"] < 0.06
    shorter = stand_in.post_file(responses, forces.decks[0][:10], force_n=1e-4, start_s=0.0)
    forces.results[0].write_bytes(shorter)
    with pytest.raises(ResultError) as refused:
        fb.make_pad(base_deck=forces.folder)
    assert refused.value.path == forces.results[0] and refused.value.found == pytest.approx(14.0)


@pytest.mark.parametrize(
    ("options", "argument"),
    [
        ({"target": "calculix"}, "base_deck"),
        ({"target": "abaqus", "force_n": 0.1}, "force_n"),
        ({"target": "abaqus", "forces_per_deck": 0}, "forces_per_deck"),
        ({"target": "abaqus", "skin": None}, "skin"),
        ({"target": "abaqus", "afferents": {"XX": "0.6"}}, "afferents"),
    ],
)
def test_options_of_another_solver_are_refused(tmp_path, options, argument):
    deck = written(tmp_path, block_deck(across=3))
    with pytest.raises(UsageError) as refused:
        fb.pad_decks(deck, tmp_path / "pad", **{**REQUEST, **options})
    assert refused.value.argument == argument
    assert not (tmp_path / "pad").exists()


@pytest.mark.parametrize(
    ("card", "old"),
    [
        ("*TRANSFORM, NSET=TOP\n1., 1., 0., -1., 1., 0.\n", "*MATERIAL"),
        ("*SOLID SECTION, ORIENTATION=OWN, ELSET=RUBBER", "*SOLID SECTION, ELSET=RUBBER"),
        ("*AMPLITUDE, NAME=A, INPUT=a.csv\n", "*MATERIAL"),
        ("*INCLUDE, INPUT=absent.inp\n", "*MATERIAL"),
    ],
    ids=["transform", "orientation", "data elsewhere", "include"],
)  # fmt: skip
def test_a_deck_whose_forces_or_stress_have_other_axes_is_refused(tmp_path, card, old):
    keeps = "" if card.startswith("*SOLID") else old
    deck = written(tmp_path, block_deck(across=3).replace(old, card + keeps))
    with pytest.raises(DeckError) as refused:
        fb.pad_decks(deck, tmp_path / "pad", target="abaqus", **REQUEST)
    assert refused.value.path == deck


def test_a_deck_for_another_solver_needs_results(tmp_path, forces):
    marc = written(tmp_path, stand_in.marc_block(block_deck(across=3)), "mine.dat")
    with pytest.raises(UsageError) as refused:
        fb.make_pad(base_deck=marc, **REQUEST)
    assert refused.value.argument == "results"
    with pytest.raises(UsageError) as refused:
        fb.make_pad(base_deck=forces.folder, skin="TOP")
    assert refused.value.argument == "skin"
    with pytest.raises(UsageError) as refused:
        fb.make_pad(base_deck=tmp_path / "mine.inp", results=["a.dat"], **REQUEST)
    assert refused.value.argument == "results"
    with pytest.raises(DeckError):
        read_forces(tmp_path)


def test_the_command_writes_decks_and_reads_their_results(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    written(tmp_path, SMALL)
    words = "pad --base-deck mine.inp --solver abaqus --skin TOP --afferents RUBBER:0.6 --runs own"
    assert main([*words.split(), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["unit_forces"] == 27 and summary["decks"] == ["own/forces_01.inp"]
    forces = read_forces(tmp_path / "own")
    assert summary["expected_bytes"] == forces.expected_bytes
    brought(forces, stand_in.made_up_responses(forces))
    assert main(["pad", "own", "-o", "first.npz"]) == 0
    again = "--results own/forces_01.dat -o second.npz"
    assert main([*words.removesuffix(" --runs own").split(), *again.split()]) == 0
    first, second = (fb.Pad.read(f"{name}.npz") for name in ("first", "second"))
    assert np.array_equal(first.down_mm, second.down_mm)
    assert main(["pad", "own", "--skin", "TOP"]) == 2
    assert main(["pad", "own", "--base-deck", "mine.inp", "--skin", "TOP"]) == 2


def test_a_deck_in_inches_has_responses_to_newtons_in_millimetres(tmp_path):
    """1 lbf is 4.448 N: displacement is 25.4 / 4.448, stress 6894.8 Pa / 4.448 of the numbers."""
    deck = written(tmp_path, block_deck(across=2, down=2, size_mm=0.1, kind="C3D8R"))
    pads = {}
    for unit, depth_mm in (("mm", 0.12), ("in", 0.12 * 25.4)):
        folder = tmp_path / unit
        forces = fb.pad_decks(
            deck, folder, target="abaqus", skin="TOP", afferents=f"RUBBER:{depth_mm}",
            length_unit=unit,
        )  # fmt: skip
        brought(forces, stand_in.made_up_responses(forces))
        pads[unit] = fb.make_pad(base_deck=folder)
    assert_allclose(pads["in"].down_mm, pads["mm"].down_mm * (25.4 / 4.4482216152605), rtol=1e-5)
    scales = [pads[unit].stress_scale_pa for unit in ("in", "mm")]
    assert_allclose(scales[0], scales[1] * (6894.757293168361e-6 / 4.4482216152605), rtol=1e-3)
