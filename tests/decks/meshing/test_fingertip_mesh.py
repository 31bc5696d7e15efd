"""Tetrahedra of a round fingertip: volume, layers, symmetry, sets, quality, and a solver run."""

import re
import shutil
import subprocess
import time
from collections import Counter
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from decks.finger import LAYERS
from decks.fingertip import HUMAN, MACAQUE
from decks.fingertip_deck import fingertip_deck
from decks.fingertip_mesh import mesh_fingertip, scaled_jacobian
from fembridge.errors import FingerError

gmsh = pytest.importorskip("gmsh", exc_type=ImportError)

COARSE = replace(
    HUMAN, resolution=replace(HUMAN.resolution, pad_mm=1.5, pad_radius_mm=3.0, far_mm=5.0)
)


@pytest.fixture(scope="module")
def mesh():
    return mesh_fingertip(COARSE)


def test_a_regular_tetrahedron_has_quality_one_and_a_flat_one_zero():
    regular = np.array([[1, 1, 1], [-1, 1, -1], [1, -1, -1], [-1, -1, 1]], dtype=float)
    flat = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], dtype=float)
    assert_allclose(np.abs(scaled_jacobian(np.stack([regular, flat]))), [1, 0], atol=1e-15)


def test_the_volume_is_that_of_ellipsoid_and_cylinder(mesh):
    """Chords cut off up to some percent of a coarse mesh."""
    outline = COARSE.outline
    section_mm2 = np.pi * outline.half_width_mm * outline.half_height_mm
    whole_mm3 = section_mm2 * (2 / 3 * outline.tip_mm + outline.shaft_mm)
    assert 0.93 * whole_mm3 < mesh.volume_mm3().sum() < whole_mm3
    assert mesh.volume_mm3().min() > 0
    assert mesh.corner_jacobian().min() > 0.3


def test_elements_share_their_faces_and_leave_no_gap(mesh):
    """Free faces are those of the skin, the nail and the end, each once; others belong to two."""
    corner = mesh.tet[:, :4]
    count = Counter(tuple(sorted(face)) for row in corner.tolist() for face in combinations(row, 3))
    free = {face for face, number in count.items() if number == 1}
    assert set(count.values()) == {1, 2}
    outer = {tuple(sorted(row)) for row in corner[np.r_[mesh.skin, mesh.nail], :3].tolist()}
    assert outer <= free
    end_mm = -COARSE.outline.shaft_mm
    at_end = np.array(sorted(free - outer))
    assert_array_equal(mesh.node_mm[at_end, 2], np.full(at_end.shape, end_mm))


def test_the_first_faces_of_the_skin_look_outwards(mesh):
    first, second, third = (mesh.node_mm[mesh.tet[mesh.skin, k]] for k in range(3))
    inwards = np.cross(second - first, third - first)
    normal = COARSE.normal((first + second + third) / 3)
    cosine = -(inwards * normal).sum(axis=1) / np.linalg.norm(inwards, axis=1)
    assert cosine.min() > 0.9


def test_the_mesh_is_its_own_mirror_image(mesh):
    image_mm = mesh.node_mm * [-1, 1, 1] + 0.0
    in_order = [np.lexsort(node_mm.T) for node_mm in (mesh.node_mm, image_mm)]
    assert_array_equal(mesh.node_mm[in_order[0]], image_mm[in_order[1]])


@pytest.mark.parametrize("name", ["SA", "PC"])
def test_afferents_are_at_their_depth_inside_their_layer(mesh, name):
    site, rows = COARSE.afferents[name], mesh.afferents[name]
    skin = np.unique(mesh.tet[mesh.skin, :3])
    apart = mesh.node_mm[rows][:, None] - mesh.node_mm[skin][None]
    nearest_mm = np.linalg.norm(apart, axis=2).min(axis=1)
    assert_allclose(nearest_mm, site.depth_mm, rtol=1e-6)
    around = np.isin(mesh.tet, rows).any(axis=1)
    assert {LAYERS[index] for index in mesh.layer[around]} == {site.layer}
    assert len(rows) > 50


def test_afferents_of_the_pad_are_below_the_pad(mesh):
    rows = mesh.pad_afferents["PC"]
    pad_mm = mesh.node_mm[np.unique(mesh.tet[mesh.pad, :3])]
    nearest_mm = np.linalg.norm(mesh.node_mm[rows][:, None] - pad_mm[None], axis=2).min(axis=1)
    assert len(rows) == len(pad_mm)
    assert_allclose(nearest_mm, COARSE.afferents["PC"].depth_mm, rtol=1e-6)
    assert np.isin(rows, mesh.afferents["PC"]).all()


def test_bone_and_outer_nail_are_held(mesh):
    bone = np.unique(mesh.tet[mesh.layer == LAYERS.index("bone")])
    assert np.isin(bone, mesh.fixed).all()
    assert np.isin(mesh.tet[mesh.nail, :3], mesh.fixed).all()
    assert not np.isin(mesh.tet[mesh.pad], mesh.fixed).any()


@pytest.mark.slow
def test_the_same_fingertip_gives_the_same_deck_and_linear_elements_the_same_corners(mesh):
    assert fingertip_deck(COARSE) == fingertip_deck(COARSE, mesh)
    linear = mesh_fingertip(replace(COARSE, resolution=replace(COARSE.resolution, order=1)))
    assert linear.tet.shape == (len(mesh.tet), 4)
    assert_array_equal(linear.node_mm[linear.tet], mesh.node_mm[mesh.tet[:, :4]])


@pytest.mark.slow
def test_too_many_elements_are_refused():
    fine = replace(HUMAN, resolution=replace(HUMAN.resolution, pad_mm=0.1, far_mm=0.11))
    with pytest.raises(FingerError) as caught:
        mesh_fingertip(fine)
    assert caught.value.argument == "resolution"


@pytest.mark.slow
@pytest.mark.parametrize("tip", [HUMAN, MACAQUE])
def test_a_preset_has_sound_elements_within_a_minute(tip):
    start_s = time.monotonic()
    mesh = mesh_fingertip(tip)
    assert time.monotonic() - start_s < 60
    assert 15_000 < len(mesh.tet) < 25_000
    quality = mesh.scaled_jacobian()
    # The worst are flat rows of the epidermis away from the pad.
    assert quality.min() > 0.015
    assert quality[mesh.layer == LAYERS.index("subcutaneous_tissue")].min() > 0.03
    assert mesh.corner_jacobian().min() > 0.5


# ---- CalculiX


def solve(folder, deck):
    """Numbers in the printed results of a deck, a list for each line."""
    (folder / "job.inp").write_text(deck, encoding="ascii")
    subprocess.run(
        [shutil.which("ccx"), "-i", "job"], cwd=folder, check=True, capture_output=True, timeout=900
    )
    lines = (folder / "job.dat").read_text().splitlines()
    number = re.compile(r"-?\d\.\d+E[+-]\d+")
    rows = [[float(text) for text in number.findall(line)] for line in lines]
    return [row for row in rows if len(row) == 3]


@pytest.mark.solver
def test_a_force_on_the_apex_is_carried_by_bone_and_nail(tmp_path):
    """Equilibrium, and a motion within the plane of symmetry."""
    tip = replace(COARSE, resolution=replace(COARSE.resolution, order=1))
    step = (
        "*STEP\n*STATIC\n*CLOAD\nAPEX, 2, -0.01\n*NODE PRINT, NSET=HELD, TOTALS=ONLY\nRF\n"
        "*NODE PRINT, NSET=APEX\nU\n*END STEP\n"
    )
    held_n, apex_mm = solve(tmp_path, fingertip_deck(tip) + step)
    assert_allclose(held_n[:2], [0, 0.01], atol=1e-8)
    assert abs(apex_mm[0]) < 1e-9
    assert -0.2 < apex_mm[1] < -0.001


@pytest.mark.solver
@pytest.mark.slow
def test_a_plate_presses_the_pad_with_a_plausible_force_that_stiffens(tmp_path):
    rows = solve(tmp_path, fingertip_deck(COARSE, plate_mm=1.0))
    force_n = -np.array(rows)[:, 1]
    assert_allclose(np.array(rows)[:, 0], 0, atol=1e-6)
    assert force_n.shape == (4,)
    assert (np.diff(force_n, n=2) > 0).all()
    assert 0.05 < force_n[-1] < 2
