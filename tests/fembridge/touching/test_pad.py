"""The stored pad: its symmetries, its balance of forces, and what an altered file does."""

import hashlib
import json
import tracemalloc
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fembridge.errors import ResponseError, UsageError
from fembridge.touching.pad import COMPONENTS, Pad
from fembridge.touching.pad_file import STORED, read_pad, resolve_pad, write_pad
from fembridge.touching.prism_pad import StressRow, cubic_weights
from fembridge.touching.stress import von_mises_pa

PAD = resolve_pad("reference")
MIRROR_X = np.array([1, 1, 1, -1, 1, -1])
MIRROR_Z = np.array([1, 1, 1, 1, -1, -1])


def at(nodes, column, row):
    return nodes.subset((nodes.column == PAD.x_mm.size // 2 + column) & (nodes.row == row))


def tensors(force, x_mm, z_mm, depth_mm=0.55, layer="epidermis"):
    places = np.atleast_1d(x_mm) * 1.0, np.atleast_1d(z_mm) * 1.0
    count = places[0].size
    return PAD.influence_pa(force, np.full(count, layer), *places, np.full(count, depth_mm))[
        :, :, 0
    ]


def test_a_force_here_moves_there_what_a_force_there_moves_here():
    downward = PAD.compliance[1]
    assert_allclose(downward, downward.transpose(1, 0, 2), atol=2.5e-4 * downward.max())
    # Of the continuum's compliance, positive definite where nodes are of one lattice.
    matrix = PAD.skin_nodes(half_length_mm=1.0).compliance().matrix
    assert np.linalg.eigvalsh(0.5 * (matrix + matrix.T)).min() > 0


def test_the_pad_is_its_own_mirror_image():
    compliance = PAD.compliance
    for direction, flip in ((0, -1), (1, 1), (2, 1)):
        assert_allclose(compliance[direction], flip * compliance[direction, ::-1, ::-1], atol=1e-9)
    nodes = PAD.skin_nodes()
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
    stress = tensors(at(PAD.skin_nodes(), 0, 0), here, along, 2.0, "subcutaneous_tissue")
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
    assert resolve_pad("reference") is PAD is resolve_pad(PAD)  # read once

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
        resolve_pad("nobody")


@pytest.mark.parametrize(
    ("layer", "depth_mm", "named"),
    [("dermis", 1.0, "dermis"), ("epidermis", 0.9, "0.9 mm"), ("bone", 8.0, "bone")],
)
def test_a_unit_where_the_pad_has_no_stress_is_refused(layer, depth_mm, named):
    with pytest.raises(UsageError, match=named):
        tensors(at(PAD.skin_nodes(), 0, 0), 0.0, 0.0, depth_mm, layer)


# ---- Pads that were altered and sealed again


def small_pad():
    """The middle five columns of the reference pad, the first elements and places."""
    centre = PAD.x_mm.size // 2
    middle, rows = slice(centre - 2, centre + 3), [0, 1, 2, 3, 4]
    half = PAD.rows[0].arc_mm.size
    return replace(
        PAD,
        x_mm=PAD.x_mm[middle],
        y_mm=PAD.y_mm[middle],
        z_mm=PAD.z_mm[:4],
        stress_z_mm=PAD.stress_z_mm[:3],
        down_mm=PAD.down_mm[:, :3, middle, :4],
        stress_pa=PAD.stress_pa[rows][:, :, :, :3, half - 3 : half + 3, :3],
        rows=tuple(StressRow(row.layer, row.arc_mm[:3], row.depth_mm[:3]) for row in PAD.rows),
    )


@pytest.fixture(scope="module")
def content(tmp_path_factory):
    """Arrays of a small stored pad, and its text `about`."""
    path = tmp_path_factory.mktemp("pad") / "small.npz"
    write_pad(path, small_pad())
    with np.load(path) as stored:
        arrays = {name: stored[name] for name in stored.files}
    arrays.pop("sha256")
    return arrays, json.loads(str(arrays.pop("about")))


def sealed(path, arrays, about):
    """Store a pad with a checksum that is right, whatever its content."""
    text = about if isinstance(about, str) else json.dumps(about, sort_keys=True)
    digest = hashlib.sha256(text.encode())
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode() + array.tobytes())
    np.savez(path, about=np.array(text), sha256=np.array(digest.hexdigest()), **arrays)
    return path


def changed(array, where, value):
    copy = np.array(array)
    copy[where] = value
    return copy


def refused(path, arrays, about, match="."):
    with pytest.raises(ResponseError, match=match) as error:
        read_pad(sealed(path, arrays, about))
    assert str(path) in str(error.value)


ARRAYS = (
    "x_mm", "y_mm", "z_mm", "stress_z_mm", "down_mm", "stress_scale_pa", "stress", "row_arc_mm",
    "row_depth_mm",
)  # fmt: skip


def test_a_pad_that_is_sealed_again_unchanged_is_read(tmp_path, content):
    again = read_pad(sealed(tmp_path / "pad.npz", *content))
    assert isinstance(again, Pad)
    assert_allclose(
        again.stress_pa, small_pad().stress_pa, atol=1e-3 * np.abs(again.stress_pa).max()
    )


@pytest.mark.parametrize("name", ARRAYS)
def test_an_array_that_no_pad_has_is_refused_by_its_name(tmp_path, content, name):
    """Missing, renamed, of another shape or kind, not finite, of another sign, 0, huge."""
    arrays, about = content
    path, array = tmp_path / "pad.npz", arrays[name]
    others = {key: value for key, value in arrays.items() if key != name}
    refused(path, others, about, f"no array {name}")
    refused(path, {**others, f"{name}x": array}, about, f"array '{name}x'.*{name}")
    refused(path, {**arrays, "extra": array}, about, "array 'extra' is of no pad")
    for altered in (array[:-1], array[None], np.append(array, array[:1], axis=0), array[..., :-1]):
        refused(path, {**arrays, name: altered}, about)
    for kind in (np.int64, np.complex128, np.longdouble, "U9"):
        refused(path, {**arrays, name: array.astype(kind)}, about, name)
    for value in (np.nan, np.inf, -np.inf):
        for where in ((0,) * array.ndim, (-1,) * array.ndim):
            refused(path, {**arrays, name: changed(array, where, value)}, about, f"{name} is not")
    for altered in (0 * array, (1e3 if name == "stress" else 1e9) * array):
        if name != "y_mm" or altered.any():  # y of a plane skin is 0
            refused(path, {**arrays, name: altered.astype(array.dtype)}, about)
    if name not in ("stress", "x_mm"):  # other signs of a force, a mirror image
        refused(path, {**arrays, name: -array}, about)
    if name in ("x_mm", "z_mm", "stress_z_mm", "row_arc_mm"):
        for altered in (array[..., ::-1], changed(array, (..., 1), array[..., 2])):
            refused(path, {**arrays, name: altered}, about)


@pytest.mark.parametrize("key", ["format", "spacing_mm", "finger", "layers", "origin"])
def test_a_key_that_is_missing_or_of_another_kind_is_named(tmp_path, content, key):
    arrays, about = content
    path = tmp_path / "pad.npz"
    others = {name: value for name, value in about.items() if name != key}
    refused(path, arrays, others, key)
    refused(path, arrays, {**others, f"{key}s": about[key]}, f"{key}s")
    for value in (None, "", [], {}, -1, True, [[]], 1e300, "é", 10**400):
        if (key, value) != ("origin", {}):
            refused(path, arrays, {**about, key: value}, "format" if key == "format" else key[:5])


def test_each_key_of_the_finger_of_a_pad_must_be_stated(tmp_path, content):
    """A missing one would be taken from a preset: another finger."""
    arrays, about = content
    for key, value in about["finger"].items():
        finger = {name: part for name, part in about["finger"].items() if name != key}
        refused(tmp_path / "pad.npz", arrays, {**about, "finger": finger}, key)
        for below in value if isinstance(value, dict) else ():
            part = {name: number for name, number in value.items() if name != below}
            lacking = {**about, "finger": {**about["finger"], key: part}}
            refused(tmp_path / "pad.npz", arrays, lacking, f"{key}.{below}")


@pytest.mark.parametrize(
    "text",
    ["", "null", "[]", "{", '{"format": NaN}', '{"format": 1, "spacing_mm": 1e999}', "[" * 9999],
)
def test_a_pad_without_a_table_of_itself_is_refused(tmp_path, content, text):
    refused(tmp_path / "pad.npz", content[0], text)


def test_layers_of_rows_must_be_those_of_a_finger_and_rise(tmp_path, content):
    arrays, about = content
    layers = about["layers"]
    for altered in (layers[:-1], [*layers[:-1], "subcutaneous"], layers[::-1], ["epidermis"] * 5):
        refused(tmp_path / "pad.npz", arrays, {**about, "layers": altered}, "layer|row_depth_mm")


def test_skin_that_gains_energy_or_is_not_reciprocal_is_refused(tmp_path, content):
    arrays, about = content
    down_mm = arrays["down_mm"]
    for where, factor, match in (
        ((1, 0, 2, 0), -1, "own force"),
        ((1, 0, 4, 3), 9, "other node|another node"),
        ((1, 0, 3, 0), 0.5, "reciprocal"),
        ((0, 1, 1, 1), 1e5, "along"),
    ):
        altered = {**arrays, "down_mm": changed(down_mm, where, factor * down_mm[where])}
        refused(tmp_path / "pad.npz", altered, about, match)


def test_a_small_file_of_a_huge_pad_is_refused_from_its_headers(tmp_path, monkeypatch, content):
    """Zeros that deflate packs a thousand times, in an array of a pad, of none, and in a text."""
    monkeypatch.setattr("fembridge.host.memory.SMALL_BYTES", 1 << 22)
    count = 1 << 23
    for name, zeros in (
        ("extra", np.zeros(count, np.float32)),
        ("stress", np.zeros(count, np.float32)),
        ("x_mm", np.zeros(count, np.float32)),
        ("about", np.zeros((), f"U{count}")),
    ):
        path = sealed(tmp_path / "pad.npz", *content)
        with np.load(path) as stored:
            arrays = {**stored, name: zeros}
        np.savez_compressed(path, **arrays)
        assert path.stat().st_size < 300_000
        tracemalloc.start()
        with pytest.raises(ResponseError):
            read_pad(path)
        _, peak_bytes = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert peak_bytes < 4_000_000


def test_an_array_whose_header_lies_is_refused(tmp_path, content):
    path = sealed(tmp_path / "pad.npz", *content)
    with zipfile.ZipFile(path) as archive:
        members = {file: archive.read(file) for file in archive.namelist()}
    for old, new in ((b"(5,)", b"(9,)"), (b"'<f8'", b"'<f4'"), (b"'<f8'", b"'|O8'")):
        altered = {**members, "x_mm.npy": members["x_mm.npy"].replace(old, new)}
        with zipfile.ZipFile(path, "w") as archive:
            for file, member in altered.items():
                archive.writestr(file, member)
        with pytest.raises(ResponseError, match="x_mm"):
            read_pad(path)


def test_a_byte_that_is_changed_anywhere_in_a_pad_is_noticed_or_changes_nothing(tmp_path, content):
    path = sealed(tmp_path / "pad.npz", *content)
    whole, undamaged = path.read_bytes(), read_pad(path)
    rng = np.random.default_rng(26)
    for position in rng.integers(0, len(whole), 150).tolist():
        damaged = bytearray(whole)
        damaged[position] ^= 1 << int(rng.integers(8))
        path.write_bytes(damaged)
        try:
            pad = read_pad(path)
        except ResponseError:
            continue
        assert pad.finger == undamaged.finger and pad.origin == undamaged.origin
        assert np.array_equal(pad.down_mm, undamaged.down_mm)
        assert np.array_equal(pad.stress_pa, undamaged.stress_pa)
