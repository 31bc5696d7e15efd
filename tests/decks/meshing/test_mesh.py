"""Both stored meshes against the areas they should cover; bad meshes refused; finer ones."""

from zipfile import ZipFile

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import KDTree

from decks.finger import LAYERS, AfferentSite
from decks.mesh import Mesh, read_mesh, refined, scaled_jacobian, write_mesh
from decks.presets import PRESETS, mesh_of, stored_mesh
from decks.section import section_of
from fembridge.errors import FingerError

MESHES = {name: mesh_of(finger) for name, finger in PRESETS.items()}
COARSE = MESHES["quick"]
# Both boundaries of a layer are cut by chords alike, and most of that cancels.
LAYER_RTOL = {"quick": 1e-3, "paper": 2.5e-4}


@pytest.fixture(params=PRESETS)
def name(request):
    return request.param


@pytest.fixture
def mesh(name):
    return MESHES[name]


def areas_mm2(finger):
    """Area of each layer: between two depths f, the integral of f - curvature f^2/2."""
    section = section_of(finger)
    wide, high = finger.outline.half_width_mm, finger.outline.half_height_mm
    angle = np.linspace(0, np.pi, len(section.arc_mm))
    stretch = np.hypot(wide * np.cos(angle), high * np.sin(angle))
    curvature = wide * high / stretch**3

    def within(depth_mm, on_nail):
        there = section.arc_mm >= section.nail_arc_mm
        strip = (depth_mm - curvature * depth_mm**2 / 2) * stretch
        return 2 * np.trapezoid(np.where(there == on_nail, strip, 0.0), angle)

    depths = (section.surface, section.corneum, section.epidermis, section.dermis)
    pad, back = (
        [within(depth(section.arc_mm), on_nail) for depth in depths] for on_nail in (False, True)
    )
    areas = {
        layer: pad[k + 1] - pad[k] + back[k + 1] - back[k] for k, layer in enumerate(LAYERS[:3])
    }
    areas["nail"] = back[1] - back[0]
    areas["stratum_corneum"] -= areas["nail"]
    bone = finger.bone
    areas["bone"] = np.pi * bone.half_width_mm * bone.half_height_mm
    inside = np.pi * wide * high - pad[-1] - back[-1]
    areas["subcutaneous_tissue"] = inside - areas["bone"]
    return areas


def test_the_coarse_mesh_has_3100_elements_and_the_fine_one_as_many_as_the_paper():
    """The paper: 17 815 elements, 36 346 nodes (section 2.1)."""
    assert len(MESHES["quick"].quad) == 3100
    assert abs(len(MESHES["paper"].quad) - 17815) < 0.01 * 17815


def test_layers_cover_the_section_and_no_more(name, mesh):
    expected = areas_mm2(PRESETS[name])
    found = {layer: mesh.area_mm2()[mesh.in_layer(layer)].sum() for layer in LAYERS}
    for layer in (*LAYERS[:3], "nail"):
        assert_allclose(found[layer], expected[layer], rtol=LAYER_RTOL[name])
    # Chords of length c cut the integral of curvature c^2/12 off: pi c^2/6 in all.
    loss_mm2 = np.pi * PRESETS[name].resolution.far_mm ** 2 / 6
    assert_allclose(found["bone"], expected["bone"] - loss_mm2, atol=0.1 * loss_mm2)
    tissue = "subcutaneous_tissue"
    assert_allclose(found[tissue], expected[tissue], atol=loss_mm2)


def test_a_mesh_is_its_own_mirror_image_to_the_last_bit(mesh):
    image = mesh.node_mm * [-1.0, 1.0]
    order, turned = (np.lexsort(at.T) for at in (mesh.node_mm, image))
    assert_array_equal(mesh.node_mm[order], image[turned] + 0.0)
    partner = np.empty(len(order), dtype=int)
    partner[order] = turned
    sides, other = (
        np.column_stack([np.sort(quad, axis=1), mesh.layer])
        for quad in (mesh.quad, partner[mesh.quad])
    )
    assert_array_equal(sides[np.lexsort(sides.T)], other[np.lexsort(other.T)])


def test_the_outline_is_what_a_plain_count_of_edges_gives():
    mesh = COARSE
    seen = {}
    for number, quad in enumerate(mesh.quad.tolist()):
        for face in range(4):
            key = frozenset((quad[face], quad[(face + 1) % 4]))
            seen.setdefault(key, []).append((number, face))
    alone = {places[0] for places in seen.values() if len(places) == 1}
    nodes, element, face = mesh.outline()
    assert set(zip(element.tolist(), face.tolist(), strict=True)) == alone
    assert_array_equal(nodes[:, 0], mesh.quad[element, face])
    assert_array_equal(nodes[:, 1], mesh.quad[element, (face + 1) % 4])


def test_mid_sides_lie_half_way_and_neighbours_share_them():
    mesh = COARSE
    node_mm, element = mesh.with_midsides()
    corner = node_mm[element[:, :4]]
    halfway = (corner + np.roll(corner, -1, axis=1)) / 2
    assert_allclose(node_mm[element[:, 4:]], halfway, atol=1e-15)
    edges, _, _ = mesh.edges()
    count = len({frozenset(edge) for edge in edges.tolist()})
    assert len(node_mm) == len(mesh.node_mm) + count
    assert_array_equal(element[:, :4], mesh.quad)


def test_a_stored_mesh_comes_back_and_gives_the_same_bytes(name, mesh, tmp_path):
    """The bytes of each array: versions of Python differ in a header of the archive."""
    write_mesh(tmp_path / "again.npz", mesh)
    with ZipFile(tmp_path / "again.npz") as again, ZipFile(stored_mesh(name)) as stored:
        assert again.namelist() == stored.namelist()
        for member in stored.namelist():
            assert again.read(member) == stored.read(member)


# ---- What is no mesh is refused, in memory and as a file; one made finer is no worse


def grid(columns, rows=3, width=1.0, height=1.0):
    """Rectangles in the epidermis; node 0 is the lower left one."""
    x, y = np.meshgrid(np.arange(columns + 1) * width, np.arange(rows + 1) * height)
    low = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    high = low + columns + 1
    quad = np.stack([low, low + 1, high + 1, high], -1)
    return Mesh(np.stack([x.ravel(), y.ravel()], -1), quad, np.ones(len(quad), int))


SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
ONE = np.array([[0, 1, 2, 3]])
LEAN = np.array([0.0, 0.0, 1.0, 1.0])[:, None] * [1.0, 0.0]


def with_node(place, node=2):
    nodes = SQUARE.copy()
    nodes[node] = place
    return nodes


# Nodes, quads, and what the message names.
NO_MESH = {
    "clockwise": (SQUARE, ONE[:, ::-1], r"element 1 at \(0\.500, 0\.500\) mm is clockwise"),
    "folded": (with_node([0.2, 0.2]), ONE, "element 1 .* folded: scaled Jacobian -0"),
    "crossed": (SQUARE[[0, 1, 3, 2]], ONE, "folded"),
    "flat corner": (with_node([0.5, 0.5]), ONE, r"folded: scaled Jacobian 0\.00"),
    "skewed": (SQUARE + 3.5 * LEAN, ONE, r"scaled Jacobian 0\.27"),
    "hole": (grid(3).node_mm, np.delete(grid(3).quad, 4, axis=0), "gap"),
    "two pieces": (np.concatenate([SQUARE, SQUARE + 5]), np.concatenate([ONE, ONE + 4]), "gap"),
    "hanging node": (  # a large square beside two small ones
        [[0, 0], [2, 0], [2, 2], [0, 2], [3, 0], [3, 1], [2, 1], [3, 2]],
        [[0, 1, 2, 3], [1, 4, 5, 6], [6, 5, 7, 2]],
        "gap",
    ),
    "unused node": (np.concatenate([SQUARE, [[9, 9]]]), ONE, "gap"),
    "slit": (  # two squares side by side that do not share their nodes
        np.concatenate([SQUARE, SQUARE + np.array([1, 0])]),
        np.concatenate([ONE, ONE + 4]),
        "gap",
    ),
}


@pytest.mark.parametrize("kind", NO_MESH)
def test_what_is_no_mesh_is_refused(kind):
    node_mm, quad, words = NO_MESH[kind]
    with pytest.raises(FingerError, match=words):
        Mesh(node_mm, quad, np.ones(len(quad), dtype=int)).checked()


def test_a_less_skewed_quad_is_taken():
    mesh = Mesh(SQUARE + LEAN, ONE, [1]).checked()
    assert_allclose(scaled_jacobian(mesh.node_mm, mesh.quad), 0.5**0.5)


@given(st.integers(2, 6), st.integers(2, 6), st.integers(0, 2**32 - 1))
def test_a_shaken_grid_is_a_mesh(columns, count, seed):
    still = grid(columns, count)
    shaken = np.random.default_rng(seed).uniform(-0.2, 0.2, still.node_mm.shape)
    mesh = Mesh(still.node_mm + shaken, still.quad, still.layer).checked()
    assert len(mesh.outline()[0]) == 2 * (columns + count)


def test_a_site_without_a_node_is_an_error():
    with pytest.raises(FingerError, match=r"is 1\.\d\d mm away, expected within 0\.3"):
        COARSE.node_at(AfferentSite("bone", 0.0, 5.0))
    rows = grid(4, 3)
    flat = Mesh(rows.node_mm, rows.quad, np.repeat([0, 1, 2], 4))
    with pytest.raises(FingerError, match="no node inside epidermis"):
        flat.node_at(AfferentSite("epidermis", 0.0, 0.0))


@pytest.mark.parametrize("kind", ["absent", "empty", "cut", "text", "array", "folder"])
def test_what_is_no_stored_mesh_is_refused(kind, tmp_path):
    path = tmp_path / "mesh.npz"
    whole = stored_mesh("quick").read_bytes()
    if kind == "folder":
        path.mkdir()
    elif kind == "array":
        with path.open("wb") as file:
            np.save(file, np.zeros(3))
    elif kind != "absent":
        path.write_bytes({"empty": b"", "cut": whole[:9000], "text": b"mesh"}[kind])
    with pytest.raises(FingerError, match="not a stored mesh"):
        read_mesh(path)


FINE = refined(refined(COARSE, (0.0, 0.0), 0.2), (0.0, 0.0), 0.1)


def layer_areas(mesh):
    return [mesh.area_mm2()[mesh.layer == k].sum() for k in range(len(LAYERS))]


@given(
    place=st.tuples(st.floats(0, 8), st.floats(0, 3)),
    radius=st.floats(0.75, 9),
    size=st.tuples(st.floats(0.5, 1), st.floats(0.5, 1)),
)
def test_nothing_hangs_and_no_area_is_lost_wherever_it_is_refined(place, radius, size):
    """`Mesh` refuses gaps, folds and what is too skewed."""
    coarse = grid(8, 6, *size)
    fine = refined(coarse, (place[0] * size[0], place[1] * size[1]), radius)
    assert_allclose(fine.area_mm2().sum(), coarse.area_mm2().sum(), rtol=1e-7)
    assert len(fine.quad) > len(coarse.quad)
    assert_array_equal(fine.node_mm[: len(coarse.node_mm)], coarse.node_mm)


def test_a_preset_keeps_its_layers_its_symmetry_and_the_shape_of_its_elements():
    assert_allclose(layer_areas(FINE), layer_areas(COARSE), rtol=1e-7)
    way_mm, image = KDTree(FINE.node_mm).query(FINE.node_mm * [-1.0, 1.0])
    assert way_mm.max() <= 2e-9  # they are rounded to 1e-9
    assert_array_equal(np.sort(image), np.arange(len(image)))
    assert scaled_jacobian(FINE.node_mm, FINE.quad).min() >= 0.37


def test_twice_makes_the_elements_at_the_apex_of_a_preset_nine_times_narrower():
    def narrowest_mm(mesh):
        edge, _, _ = mesh.outline()
        x_mm, y_mm = mesh.node_mm[np.unique(edge)].T
        return np.sort(x_mm[(x_mm > 0) & (y_mm > -0.1)])[0]

    assert_allclose(narrowest_mm(FINE), narrowest_mm(COARSE) / 9, rtol=1e-6)
