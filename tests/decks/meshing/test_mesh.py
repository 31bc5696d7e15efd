"""Both stored meshes against the areas they should cover, and bad meshes refused."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from decks.finger import LAYERS, AfferentSite
from decks.mesh import write_mesh
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


def test_no_node_within_reach_of_a_site_is_an_error():
    with pytest.raises(FingerError, match=r"is 1\.\d\d mm away, expected within 0\.3"):
        COARSE.node_at(AfferentSite("bone", 0.0, 5.0))


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
    write_mesh(tmp_path / "again.npz", mesh)
    assert (tmp_path / "again.npz").read_bytes() == stored_mesh(name).read_bytes()
