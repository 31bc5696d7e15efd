"""The stored pad: its symmetries, its balance of forces, and what an altered file does."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fembridge.errors import ResponseError, UsageError
from fembridge.touching.contact import skin_nodes
from fembridge.touching.pad import COMPONENTS, STORED, cubic_weights, pad_named, read_pad, write_pad
from fembridge.touching.stress import influence_pa, von_mises_pa

PAD = pad_named("reference")
MIRROR_X = np.array([1, 1, 1, -1, 1, -1])
MIRROR_Z = np.array([1, 1, 1, 1, -1, -1])


def at(nodes, column, row):
    return nodes.subset((nodes.column == PAD.x_mm.size // 2 + column) & (nodes.row == row))


def tensors(force, x_mm, z_mm, depth_mm=0.55, layer="epidermis"):
    places = np.atleast_1d(x_mm) * 1.0, np.atleast_1d(z_mm) * 1.0
    count = places[0].size
    return influence_pa(PAD, force, np.full(count, layer), *places, np.full(count, depth_mm))[
        :, :, 0
    ]


def test_a_force_here_moves_there_what_a_force_there_moves_here():
    downward = PAD.compliance[1]
    assert_allclose(downward, downward.transpose(1, 0, 2), atol=2e-4 * downward.max())
    # Of the continuum's compliance, positive definite where nodes are of one lattice.
    matrix = skin_nodes(PAD, half_length_mm=1.0).compliance()
    assert np.linalg.eigvalsh(0.5 * (matrix + matrix.T)).min() > 0


def test_the_pad_is_its_own_mirror_image():
    compliance = PAD.compliance
    for direction, flip in ((0, -1), (1, 1), (2, 1)):
        assert_allclose(compliance[direction], flip * compliance[direction, ::-1, ::-1], atol=1e-9)
    nodes = skin_nodes(PAD)
    x, z = np.array([0.3, 1.1, -2.0]), np.array([0.2, -1.3, 3.0])
    here = tensors(at(nodes, 5, 3), x, z)
    scale = np.abs(here).max()
    assert_allclose(tensors(at(nodes, -5, 3), -x, z), MIRROR_X[:, None] * here, atol=1e-5 * scale)
    assert_allclose(tensors(at(nodes, 5, -3), x, -z), MIRROR_Z[:, None] * here, atol=1e-5 * scale)
    assert_allclose(tensors(at(nodes, 5, 7), x, z + 4 * PAD.spacing_mm), here, atol=1e-5 * scale)


def test_the_tissue_carries_what_the_skin_was_pressed_with():
    """Through the surface 2 mm under the skin goes the force, but for what the sides carry."""
    step = 0.25
    x = np.arange(-6.5, 6.5 + step / 2, step)
    z = np.arange(-12, 12 + step / 2, step)
    here, along = (each.ravel() for each in np.meshgrid(x, z))
    stress = tensors(at(skin_nodes(PAD), 0, 0), here, along, 2.0, "subcutaneous_tissue")
    named = dict(zip(COMPONENTS, stress, strict=True))
    # The inward normal of an ellipse of 8 x 6.5 mm, and the arc that a step in x is.
    slope = 6.5 / 64 * here / np.sqrt(1 - (here / 8) ** 2)
    shrunk = 1 - 2.0 * (6.5 / 64) / (1 - (here / 8) ** 2) ** 1.5 / (1 + slope**2) ** 1.5
    force = (-(named["yy"] + slope * named["xy"]) * shrunk).sum() * step**2 * 1e-6
    assert 0.9 < force < 1.01


def test_von_mises_stress_is_that_of_the_summed_tensor():
    rng = np.random.default_rng(3)
    influence = rng.normal(size=(6, 4, 5)).astype(np.float32)
    forces = rng.uniform(size=(7, 5))
    found = von_mises_pa(influence, forces)
    for time in range(7):
        for unit in range(4):
            xx, yy, zz, xy, yz, zx = influence[:, unit] @ forces[time]
            tensor = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
            deviator = tensor - np.trace(tensor) / 3 * np.eye(3)
            expected = np.sqrt(1.5 * (deviator**2).sum())
            assert_allclose(found[time, unit], expected, rtol=1e-5)


def test_cubic_weights_bring_a_cubic_back():
    grid = np.array([0.0, 0.3, 0.7, 1.5, 2.0, 4.0])
    at_ = np.linspace(0, 4, 33)
    place, weight = cubic_weights(grid, at_)
    assert_allclose((grid[place] ** 3 * weight).sum(axis=1), at_**3, atol=1e-12)


def test_a_stored_pad_comes_back_and_an_altered_one_does_not(tmp_path):
    path = tmp_path / "pad.npz"
    write_pad(path, PAD)
    again = read_pad(path)
    assert_allclose(again.down_mm, PAD.down_mm, rtol=1e-7)
    assert_allclose(again.stress_pa, PAD.stress_pa, atol=1e-3 * np.abs(PAD.stress_pa).max())
    assert again.finger == PAD.finger
    assert pad_named("reference") is PAD is pad_named(PAD)  # read once

    with np.load(path) as stored:
        arrays = dict(stored)
    arrays["down_mm"] = arrays["down_mm"] * 1.01
    np.savez_compressed(path, **arrays)
    with pytest.raises(ResponseError, match="checksum"):
        read_pad(path)
    path.write_bytes((STORED / "reference.npz").read_bytes()[:5000])
    with pytest.raises(ResponseError, match=str(path)):
        read_pad(path)
    with pytest.raises(UsageError, match="reference"):
        pad_named("nobody")


@pytest.mark.parametrize(
    ("layer", "depth_mm", "named"),
    [("dermis", 1.0, "dermis"), ("epidermis", 0.9, "0.9 mm"), ("bone", 8.0, "bone")],
)
def test_a_unit_where_the_pad_has_no_stress_is_refused(layer, depth_mm, named):
    with pytest.raises(UsageError, match=named):
        tensors(at(skin_nodes(PAD), 0, 0), 0.0, 0.0, depth_mm, layer)
