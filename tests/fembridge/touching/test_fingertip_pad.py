"""The pad of a round fingertip: its map, its stored pads, and whole contact runs of CalculiX."""

import json
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from numpy.testing import assert_allclose

import fembridge as fb
from decks.fingertip import HUMAN, MACAQUE
from decks.fingertip_deck import fingertip_deck
from decks.fingertip_mesh import mesh_fingertip
from fembridge.cli import main
from fembridge.errors import DeckError, UsageError
from fembridge.host.machine import find_ccx
from fembridge.results import read_fields
from fembridge.touching.contact import press_to
from fembridge.touching.mesh_pad import MeshPad
from fembridge.touching.pad_file import STORED, resolve_pad
from fembridge.touching.shape import Shape
from fembridge.touching.stress import von_mises_pa

COARSE = replace(
    HUMAN,
    name="coarse",
    resolution=replace(HUMAN.resolution, pad_mm=1.5, pad_radius_mm=3.0, far_mm=5.0, order=1),
)
TIPS = {"fingertip": HUMAN, "fingertip_macaque": MACAQUE}


@pytest.fixture(scope="module")
def coarse():
    pytest.importorskip("gmsh")
    return fb.make_pad(COARSE, reach_mm=7.0)


@pytest.mark.solver
def test_the_map_of_a_fingertip_begins_at_its_apex(coarse):
    assert coarse.name == "coarse"
    assert_allclose(coarse.origin["apex_mm"], 0, atol=1e-9)
    assert_allclose(coarse.origin["outward"], [0, 1, 0], atol=1e-12)
    assert_allclose(coarse.origin["along"], [0, 0, 1], atol=1e-12)
    ends_mm = coarse.outline().reshape(-1, 2)
    outline = HUMAN.outline
    assert_allclose(np.abs(ends_mm[:, 0]).max(), outline.half_width_mm, rtol=0.01)
    assert_allclose(ends_mm[:, 1].min(), -outline.shaft_mm)
    assert_allclose(ends_mm[:, 1].max(), outline.tip_mm, rtol=0.03)


@pytest.mark.solver
def test_units_lie_in_named_layers_at_the_depths_of_the_fingertip(coarse):
    assert coarse.layers == ("EPIDERMIS", "SUBCUTANEOUS_TISSUE")
    for name, site in COARSE.afferents.items():
        assert coarse.sites[name].layer == site.layer.upper()
        assert coarse.sites[name].depth_mm == site.depth_mm
    below_mm = COARSE.normal(coarse.position_mm)  # at nodes of the skin
    assert_allclose(below_mm[coarse.node.size // 2], coarse.normal[coarse.node.size // 2], atol=0.1)
    # Each point lies below a node of the skin, by its depth along the normal of the ellipsoid.
    skin_mm = coarse.position_mm[:, None] - coarse.point_mm
    nearest = np.linalg.norm(skin_mm, axis=2).argmin(axis=0)
    away_mm = coarse.position_mm[nearest] - coarse.point_mm
    assert_allclose(np.linalg.norm(away_mm, axis=1), coarse.point_depth_mm, rtol=0.02)


@pytest.mark.solver
def test_the_file_of_a_symmetric_fingertip_has_half_of_its_forces(coarse, tmp_path):
    coarse.write(tmp_path / "pad.npz")
    with np.load(tmp_path / "pad.npz") as stored:
        assert stored["down_mm"].shape[2] < 0.6 * coarse.node.size
    again = fb.Pad.read(tmp_path / "pad.npz")
    assert_allclose(again.down_mm[1], coarse.down_mm[1], rtol=1e-4, atol=1e-4)
    assert_allclose(again.outline(), coarse.outline())


@pytest.mark.slow
@pytest.mark.solver
def test_a_finger_file_becomes_a_pad_that_touch_takes(tmp_path, capsys, monkeypatch):
    pytest.importorskip("gmsh")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text(
        'base = "fingertip"\n[outline]\nhalf_width_mm = 9.0\n'
        "[resolution]\npad_mm = 1.5\npad_radius_mm = 3.0\nfar_mm = 5.0\norder = 1\n"
    )
    words = "pad --finger mine.toml --reach-mm 5 -o mine.npz --runs runs --json"
    assert main(words.split()) == 0
    assert json.loads(capsys.readouterr().out)["elements"] > 1000
    touch = "touch --pad mine.npz --shape plate --press-um 200 --population one_each -o out --json"
    assert main(touch.split()) == 0
    assert json.loads(capsys.readouterr().out)["force_n"] > 0
    assert_allclose(np.abs(fb.Pad.read("mine.npz").outline()).max(axis=0)[0], 9.0, rtol=0.01)


@pytest.mark.slow
@pytest.mark.solver
def test_a_deck_of_a_fingertip_has_its_map_at_the_node_set_apex(tmp_path):
    pytest.importorskip("gmsh")
    deck = fb.write_fingertip(tmp_path / "tip.inp", COARSE)
    words = {"base_deck": deck.path, "reach_mm": 3.0, "afferents": {"SA": "AFFERENTS_SA"}}
    pad = fb.make_pad(skin="PAD", **words)
    assert_allclose(pad.origin["apex_mm"], 0, atol=1e-9)
    assert_allclose(pad.origin["outward"], [0, 1, 0], atol=0.1)
    # Nodes of AFFERENTS_SA beside PAD are left out, and depths are those below the skin.
    assert 0 < len(pad.point_mm) < deck.afferents["SA"]
    assert_allclose(pad.point_depth_mm, 0.5, rtol=0.15)
    with pytest.raises(DeckError) as error:
        fb.make_pad(skin="PAD", **words | {"afferents": "HELD"})
    assert error.value.argument == "afferents"


@pytest.mark.parametrize(
    ("argument", "value"), [("spacing_mm", 0.2), ("ridges", True), ("plane", True)]
)
def test_options_of_a_section_are_refused(argument, value):
    with pytest.raises(UsageError) as error:
        fb.make_pad("fingertip", **{argument: value})
    assert error.value.argument == argument and error.value.found == value


# ---- Stored pads


@pytest.mark.parametrize("name", list(TIPS))
def test_a_stored_pad_is_that_of_its_fingertip(name):
    pad, tip = resolve_pad(name), TIPS[name]
    assert isinstance(pad, MeshPad) and pad.source == pad.name == name
    assert (STORED / f"{name}.npz").stat().st_size < 10e6
    assert {key: (site.layer, site.depth_mm) for key, site in pad.sites.items()} == {
        key: (site.layer.upper(), site.depth_mm) for key, site in tip.afferents.items()
    }
    x, y, z = pad.position_mm.T
    outline = tip.outline
    on_skin = (x / outline.half_width_mm) ** 2 + (y / outline.half_height_mm + 1) ** 2
    on_skin += (np.maximum(z, 0) / outline.tip_mm) ** 2
    assert_allclose(on_skin, 1, atol=1e-6)
    assert np.linalg.eigvalsh(pad.down_mm[1].astype(float)).min() > 0


@pytest.mark.filterwarnings("ignore:parameter set")
def test_a_touch_of_the_stored_fingertip_is_symmetric_and_has_its_outline_in_the_picture():
    sides = []
    for x_mm in (-1.5, 1.5):
        units = fb.Population.at(
            ["SA", "RA", "PC"] * 2,
            [x_mm] * 3 + [-x_mm] * 3,
            [1.0] * 6,
            finger=resolve_pad("fingertip"),
        ).with_endings(0.0)
        words = {"press_um": 300, "population": units, "pad": "fingertip", "at_mm": (x_mm, 1.0)}
        sides.append(fb.touch("sphere", **words))
    assert_allclose(sides[0].force_n, sides[1].force_n, rtol=2e-3)
    assert_allclose(sides[0].stress_pa, sides[1].stress_pa, rtol=0.03, atol=50)
    below, beside = np.split(sides[0].stress_pa.max(axis=0), 2)
    assert (below > beside).all()
    panel = sides[0].plot("pad").axes[0]
    (outline,) = (a for a in panel.collections if isinstance(a, LineCollection))
    ends_mm = np.concatenate(outline.get_segments())
    assert_allclose(np.abs(ends_mm[:, 0]).max(), 8.0, rtol=0.01)
    low, high = panel.get_ylim()
    assert low < ends_mm[:, 1].min() and ends_mm[:, 1].max() < high


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::fembridge.errors.FembridgeWarning")
def test_a_receptive_field_of_the_stored_fingertip_has_its_hot_spot_above_the_unit():
    field = fb.receptive_field(
        "SA", units=1, depth_um=[400], times_threshold=[], step_mm=1.0, pad="fingertip"
    )
    ((impulses,),) = field.impulses
    hot = np.argwhere(impulses == impulses.max()).mean(axis=0)
    assert_allclose(hot, (np.array(impulses.shape) - 1) / 2, atol=1.0)


# ---- Whole contact


@pytest.mark.slow
@pytest.mark.solver
def test_a_plate_on_the_round_tip_is_the_contact_of_calculix(tmp_path):
    """Force within 3 %, von Mises stress at the afferents' nodes within 5 % of the largest."""
    pytest.importorskip("gmsh")
    resolution = replace(COARSE.resolution, pad_mm=1.2, order=2)
    tip, depth_mm = replace(COARSE, resolution=resolution), 0.5
    mesh = mesh_fingertip(tip)
    (tmp_path / "job.inp").write_text(fingertip_deck(tip, mesh, plate_mm=depth_mm))
    subprocess.run([find_ccx(), "-i", "job"], cwd=tmp_path, check=True, capture_output=True)
    lines = (tmp_path / "job.dat").read_text().splitlines()
    force_n = -np.array([float(line.split()[1]) for line in lines if line.count("E") == 3])
    pad = fb.make_pad(tip, reach_mm=8.0)
    depth_um = 1e3 * depth_mm * np.array([0.5, 0.75, 1.0])
    nodes, forces, _ = press_to(pad, Shape.plate(), depth_um)
    assert_allclose(forces.sum(axis=1), force_n[1:], rtol=0.03)
    *_, stress = read_fields(tmp_path / "job.frd", "STRESS")
    for name in ("SA", "PC"):
        rows = mesh.pad_afferents[name]
        expected = stress.values[np.searchsorted(stress.nodes, rows + 1)]
        expected_pa = von_mises_pa(expected.T[:, :, None], np.ones((1, 1)))[0]
        places, depths_mm = pad._surface.below(mesh.node_mm[rows])
        site = pad.sites[name]
        found_pa = von_mises_pa(
            pad.influence_pa(
                nodes, np.full(rows.size, site.layer), *places.T, np.full(rows.size, site.depth_mm)
            ),
            forces,
        )[-1]
        error = (found_pa - expected_pa) / expected_pa.max()
        assert np.sqrt(np.mean(error**2)) < 0.05, (name, depths_mm)
