"""Both stored meshes against the areas they should cover, and bad meshes refused."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from decks.finger import LAYERS, AfferentSite
from decks.mesh import Mesh, read_mesh, write_mesh
from decks.mesh_checks import MIN_SCALED_JACOBIAN
from decks.presets import PRESETS, mesh_of, stored_mesh
from decks.section import section_of
from fembridge.errors import FingerError

MESHES = {name: mesh_of(finger) for name, finger in PRESETS.items()}
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
        [within(depth(section.arc_mm), on_nail) for depth in depths]
        for on_nail in (False, True)
    )
    areas = {
        layer: pad[k + 1] - pad[k] + back[k + 1] - back[k]
        for k, layer in enumerate(LAYERS[:3])
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


def test_elements_of_the_fine_mesh_are_as_wide_as_the_papers():
    """Section 2.1: from about 0.02 to 0.45 mm a side."""
    mesh = MESHES["paper"]
    nodes, _, _ = mesh.edges()
    sides_mm = np.linalg.norm(np.subtract(*mesh.node_mm[nodes.T]), axis=1)
    fine, coarse = np.percentile(sides_mm, [1, 99])
    assert 0.015 < fine < 0.025
    assert 0.25 < coarse < sides_mm.max() < 0.5


def test_every_element_is_a_sound_quad_that_runs_counter_clockwise(mesh):
    assert mesh.quad.shape == (len(mesh.quad), 4)
    assert (np.diff(np.sort(mesh.quad, axis=1), axis=1) > 0).all()
    assert mesh.area_mm2().min() > 0
    assert mesh.scaled_jacobian().min() >= MIN_SCALED_JACOBIAN


def chord_loss_mm2(finger):
    """Chords of length c cut the integral of curvature c^2/12 off: pi c^2/6 in all."""
    return np.pi * finger.resolution.far_mm**2 / 6


def test_layers_cover_the_section_and_no_more(name, mesh):
    expected = areas_mm2(PRESETS[name])
    found = {layer: mesh.area_mm2()[mesh.in_layer(layer)].sum() for layer in LAYERS}
    for layer in (*LAYERS[:3], "nail"):
        assert_allclose(found[layer], expected[layer], rtol=LAYER_RTOL[name])
    loss_mm2 = chord_loss_mm2(PRESETS[name])
    assert_allclose(found["bone"], expected["bone"] - loss_mm2, atol=0.1 * loss_mm2)
    tissue = "subcutaneous_tissue"
    assert_allclose(found[tissue], expected[tissue], atol=loss_mm2)


def test_the_whole_is_an_ellipse_less_its_ridges(name, mesh):
    """Steiner: a parallel curve at depth d encloses pi a b - perimeter d + pi d^2."""
    from scipy.special import ellipe

    perimeter_mm = 4 * 8.0 * ellipe(1 - (6.5 / 8.0) ** 2)
    beneath = np.pi * 8.0 * 6.5 - perimeter_mm * 1.75 + np.pi * 1.75**2
    areas = areas_mm2(PRESETS[name])
    inner = [areas["bone"], areas["subcutaneous_tissue"]]
    assert_allclose(sum(inner), beneath, rtol=1e-7)
    ridges = 2 * 0.05 * (3.0 - 0.25)  # mean height, faded over the last half
    whole = np.pi * 8.0 * 6.5 - ridges
    assert_allclose(sum(areas.values()), whole, rtol=1e-4)
    loss_mm2 = whole - mesh.area_mm2().sum()
    assert 0 < loss_mm2 < chord_loss_mm2(PRESETS[name])


def test_a_mesh_is_its_own_mirror_image_to_the_last_bit(mesh):
    image = mesh.node_mm * [-1.0, 1.0]
    order, turned = (np.lexsort(at.T) for at in (mesh.node_mm, image))
    assert_array_equal(mesh.node_mm[order], image[turned] + 0.0)
    partner = np.empty(len(order), dtype=int)
    partner[order] = turned
    sides = {frozenset(quad): layer for quad, layer in rows(mesh)}
    other = {frozenset(partner[list(quad)]): layer for quad, layer in rows(mesh)}
    assert sides == other


def rows(mesh):
    return zip(mesh.quad.tolist(), mesh.layer.tolist(), strict=True)


def test_layers_lie_on_each_other_as_in_a_finger(mesh):
    """Down the middle: each layer once, in order, to the bone and out of the back."""
    middle = mesh.node_mm[mesh.quad].mean(axis=1)
    near = np.flatnonzero((middle[:, 0] > 0) & (middle[:, 0] < 0.3))
    near = near[np.argsort(-middle[near, 1])]
    passed = [LAYERS[mesh.layer[near[0]]]]
    for above, below in pairwise(mesh.layer[near]):
        if above != below:
            passed.append(LAYERS[below])
    pad = list(LAYERS[:5])
    assert list(dict.fromkeys(passed)) == [*pad, "nail"]


def test_afferents_sit_exactly_at_their_sites_and_inside_one_layer(name, mesh):
    for site in PRESETS[name].afferents.values():
        row = mesh.node_at(site)
        assert tuple(mesh.node_mm[row]) == (site.x_mm, -site.depth_mm)
        around = (mesh.quad == row).any(axis=1)
        assert around.sum() >= 3
        assert (mesh.layer[around] == LAYERS.index(site.layer)).all()


def test_a_node_inside_a_layer_is_in_no_other(mesh):
    inside = [set(mesh.nodes_inside(layer).tolist()) for layer in LAYERS]
    assert sum(map(len, inside)) == len(set.union(*inside))
    corner = mesh.quad[mesh.in_layer("dermis")]
    shared = np.intersect1d(corner, mesh.quad[mesh.in_layer("epidermis")])
    assert shared.size
    assert not set(shared.tolist()) & set.union(*inside)


def test_no_node_within_reach_of_a_site_is_an_error(mesh):
    with pytest.raises(FingerError, match=r"is 1\.\d\d mm away, expected within 0\.3"):
        mesh.node_at(AfferentSite("bone", 0.0, 5.0))


def test_a_layer_of_one_row_has_no_node_inside():
    rows = grid(4, 3)
    flat = Mesh(rows.node_mm, rows.quad, np.repeat([0, 1, 2], 4))
    with pytest.raises(FingerError, match="no node lies inside epidermis: use more"):
        flat.node_at(AfferentSite("epidermis", 0.0, 0.0))


def test_the_outline_is_what_a_plain_count_of_edges_gives(mesh):
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


def test_mid_sides_lie_half_way_and_neighbours_share_them(mesh):
    node_mm, element = mesh.with_midsides()
    corner = node_mm[element[:, :4]]
    halfway = (corner + np.roll(corner, -1, axis=1)) / 2
    assert_allclose(node_mm[element[:, 4:]], halfway, atol=1e-15)
    edges, _, _ = mesh.edges()
    count = len({frozenset(edge) for edge in edges.tolist()})
    assert len(node_mm) == len(mesh.node_mm) + count
    assert_array_equal(element[:, :4], mesh.quad)


# ---- What a mesh is not


def grid(columns, count=3, step=1.0):
    """Squares in the epidermis, `columns` x `count`."""
    x, y = np.meshgrid(np.arange(columns + 1), -np.arange(count + 1))
    node_mm = np.stack([x.ravel(), y.ravel()], -1) * step
    upper = (np.arange(count)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    lower = upper + columns + 1
    quad = np.stack([lower, lower + 1, upper + 1, upper], -1)
    return Mesh(node_mm, quad, np.ones(len(quad), dtype=int))


def refused(words, node_mm, quad, layer=None):
    layer = np.ones(len(quad), dtype=int) if layer is None else layer
    with pytest.raises(FingerError, match=words):
        Mesh(node_mm, quad, layer)


SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
ONE = np.array([[0, 1, 2, 3]])


def test_a_clockwise_quad_is_refused():
    refused(r"element 1 at \(0\.500, 0\.500\) mm is clockwise", SQUARE, ONE[:, ::-1])


def test_a_folded_quad_is_refused():
    arrow = np.array([[0, 0], [1, 0], [0.2, 0.2], [0, 1]], dtype=float)
    refused("element 1 .* is folded: scaled Jacobian -0", arrow, ONE)


def test_a_quad_whose_edges_cross_is_refused():
    refused("is folded", SQUARE[[0, 1, 3, 2]], ONE)


def test_a_quad_with_a_flat_corner_is_refused():
    triangle = np.array([[0, 0], [1, 0], [0.5, 0.5], [0, 1]], dtype=float)
    refused("is folded: scaled Jacobian 0.00", triangle, ONE)


def test_a_skewed_quad_is_refused_and_a_less_skewed_one_taken():
    lean = np.array([0.0, 0.0, 1.0, 1.0])[:, None] * [1.0, 0.0]
    refused("too skewed: scaled Jacobian 0.27", SQUARE + 3.5 * lean, ONE)
    assert_allclose(Mesh(SQUARE + lean, ONE, [1]).scaled_jacobian(), 0.5**0.5)


def test_a_hole_is_a_gap():
    whole = grid(3)
    holed = np.delete(whole.quad, 4, axis=0)
    refused("not one closed line: layers leave a gap", whole.node_mm, holed)


def test_two_pieces_are_a_gap():
    apart = np.concatenate([SQUARE, SQUARE + 5])
    refused("layers leave a gap", apart, np.concatenate([ONE, ONE + 4]))


def test_two_pieces_that_share_one_node_are_a_gap():
    nodes = np.concatenate([SQUARE, [[2, 1], [2, 2], [1, 2]]])
    refused("layers leave a gap", nodes, [[0, 1, 2, 3], [2, 4, 5, 6]])


def test_a_hanging_node_is_a_gap():
    """A large square beside two small ones: their common node is in nobody's edge."""
    nodes = [[0, 0], [2, 0], [2, 2], [0, 2], [3, 0], [3, 1], [2, 1], [3, 2]]
    quads = [[0, 1, 2, 3], [1, 4, 5, 6], [6, 5, 7, 2]]
    refused(r"layers leave a gap|layers overlap", nodes, quads)


def test_two_elements_on_the_same_side_of_an_edge_overlap():
    nodes = np.concatenate([SQUARE, [[1.2, 1.5], [-0.2, 1.5]]])
    refused("same side of an edge: layers overlap", nodes, [[0, 1, 2, 3], [0, 1, 4, 5]])


def test_elements_that_go_around_and_over_the_first_overlap():
    """A ring that closes on itself without a common edge: every quad is sound."""
    angle = np.radians(np.linspace(0, 410, 21))
    around = np.stack([np.cos(angle), np.sin(angle)], -1)
    nodes = np.concatenate([around, 2 * around])
    start = np.arange(20)
    quads = np.stack([start, start + 21, start + 22, start + 1], -1)
    refused(r"the outline crosses itself near .* layers overlap", nodes, quads)


def test_a_strip_may_go_around_without_touching_itself():
    angle = np.radians(np.linspace(0, 340, 18))
    around = np.stack([np.cos(angle), np.sin(angle)], -1)
    start = np.arange(17)
    quads = np.stack([start, start + 18, start + 19, start + 1], -1)
    mesh = Mesh(np.concatenate([around, 2 * around]), quads, np.ones(17))
    assert len(mesh.outline()[0]) == 36


def test_a_node_that_no_element_uses_is_refused():
    nodes = np.concatenate([SQUARE, [[9, 9]]])
    refused("node 5 belongs to no element", nodes, ONE)


def test_two_nodes_in_one_place_are_refused():
    """Two squares side by side that do not share their nodes: a slit."""
    nodes = np.concatenate([SQUARE, SQUARE + np.array([1, 0])])
    words = r"two nodes in one place, at \(1\.0+, 0\.0+\) mm"
    refused(words, nodes, np.concatenate([ONE, ONE + 4]))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_node_without_a_place_is_refused(value):
    nodes = SQUARE.copy()
    nodes[2, 1] = value
    refused("node 3 is at", nodes, ONE)


def test_tables_that_do_not_belong_together_are_refused():
    refused(r"expected nodes \(N, 2\), got \(4, 3\)", np.zeros((4, 3)), ONE)
    refused(r"expected quads \(E, 4\), got \(1, 3\)", SQUARE, ONE[:, :3])
    refused(r"expected quads \(E, 4\), got \(0, 4\)", SQUARE, ONE[:0])
    refused("quads name nodes 1 to 5, there are 1 to 4", SQUARE, [[0, 1, 2, 4]])
    refused("quads name nodes 0 to 3", SQUARE, ONE - 1)
    refused("expected a layer for 1 quads, got", SQUARE, ONE, [1, 1])
    refused("layers 6 to 6, expected 0 to 5", SQUARE, ONE, [6])
    refused("layers -1 to -1", SQUARE, ONE, [-1])


@given(st.integers(2, 6), st.integers(2, 6), st.integers(0, 2**32 - 1))
def test_a_shaken_grid_is_a_mesh(columns, count, seed):
    still = grid(columns, count)
    shaken = np.random.default_rng(seed).uniform(-0.2, 0.2, still.node_mm.shape)
    mesh = Mesh(still.node_mm + shaken, still.quad, still.layer)
    assert len(mesh.outline()[0]) == 2 * (columns + count)


def test_a_mesh_cannot_be_changed_and_keeps_its_own_arrays(mesh):
    with pytest.raises(ValueError, match="read-only"):
        mesh.node_mm[0, 0] = 1.0
    nodes = SQUARE.copy()
    own = Mesh(nodes, ONE, [1])
    nodes[0, 0] = 99.0
    assert own.node_mm[0, 0] == 0.0


# ---- Stored


def test_a_stored_mesh_comes_back_and_gives_the_same_bytes(name, mesh, tmp_path):
    write_mesh(tmp_path / "again.npz", mesh)
    assert (tmp_path / "again.npz").read_bytes() == stored_mesh(name).read_bytes()


def test_a_mesh_may_be_stored_under_any_name(tmp_path):
    write_mesh(tmp_path / "mine.mesh", grid(2))
    assert_array_equal(read_mesh(tmp_path / "mine.mesh").quad, grid(2).quad)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.mesh"]


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


def test_a_flipped_bit_in_a_stored_mesh_is_noticed(tmp_path):
    whole = bytearray(stored_mesh("quick").read_bytes())
    whole[5000] ^= 0x10
    path = tmp_path / "mesh.npz"
    path.write_bytes(whole)
    with pytest.raises(FingerError, match=r"mesh\.npz"):
        read_mesh(path)


def test_a_stored_mesh_that_is_not_sound_is_refused_by_its_name(tmp_path):
    path = tmp_path / "mesh.npz"
    np.savez(path, node_mm=SQUARE, quad=ONE[:, ::-1], layer=[1])
    with pytest.raises(FingerError, match=r"mesh\.npz: element 1 .* clockwise"):
        read_mesh(path)
