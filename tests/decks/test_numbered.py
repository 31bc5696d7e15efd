"""Numbers are those of the mesh's rows, counted from one: plain loops tell."""

import numpy as np
import pytest

from decks.analysis import analyse
from decks.finger import LAYERS
from decks.half_section import half_section
from decks.numbered import QUADRATIC, numbered
from decks.presets import QUICK, mesh_of

SKIN = mesh_of(QUICK)
ELEMENTS = ("CPE4", "CPE4H", "CPE8", "CPE8R")
HALVES = ("CPE4", "CPE8R")


def whole_of(stimulus, element):
    return numbered(analyse(QUICK, SKIN, stimulus, element=element))


def half_of(stimulus, element):
    analysis = analyse(QUICK, SKIN, stimulus, element=element, drive="spring", section="half")
    return numbered(analysis, half_section(analysis))


@pytest.fixture(
    params=[*((whole_of, name) for name in ELEMENTS), *((half_of, n) for n in HALVES)],
    ids=lambda param: f"{param[0].__name__.removesuffix('_of')}-{param[1]}",
)
def model(request, short):
    make, element = request.param
    return make(short, element)


@pytest.fixture(params=HALVES)
def both(request, short):
    """Give a whole and its half."""
    return whole_of(short, request.param), half_of(short, request.param)


def kept_rows(model):
    """Rows of the mesh's elements that are there, by a plain loop."""
    if not model.is_half:
        return list(range(len(SKIN.quad)))
    x_mm = SKIN.node_mm[:, 0]
    return [row for row, quad in enumerate(SKIN.quad) if min(x_mm[quad]) >= 0]


def test_every_element_of_the_mesh_is_in_the_section_of_its_layer_once(model):
    seen = {}
    for layer in model.layers:
        for number, nodes in zip(layer.number, layer.node, strict=True):
            seen[int(number)] = (layer.name, tuple(nodes[:4].tolist()))
    assert len(seen) == sum(len(layer.number) for layer in model.layers)
    assert sorted(seen) == [row + 1 for row in kept_rows(model)]
    for row in kept_rows(model):
        quad = SKIN.quad[row]
        expected = LAYERS[SKIN.layer[row]], tuple(int(node) + 1 for node in quad)
        assert seen[row + 1] == expected


def test_a_mid_side_is_half_way_between_its_corners(model):
    for layer in model.layers:
        corners = model.node_mm[layer.node[:, :4] - 1]
        if model.analysis.element not in QUADRATIC:
            assert layer.node.shape[1] == 4
            continue
        middle = model.node_mm[layer.node[:, 4:] - 1]
        np.testing.assert_array_equal(middle, 0.5 * (corners + np.roll(corners, -1, axis=1)))


def test_the_probe_follows_the_finger_without_a_gap(model):
    assert model.first_probe_node == len(model.node_mm) + 1
    first, count = len(SKIN.quad) + 1, len(model.analysis.probe.quad)
    numbers = np.arange(first, first + count)
    nodes = model.first_probe_node + np.arange(len(model.probe_node_mm))
    if model.is_half:
        right = model.probe_node_mm[:, 0] >= 0
        numbers, nodes = numbers[count // 2 :], nodes[right]
    assert model.probe.number.tolist() == numbers.tolist()
    assert np.unique(model.probe.node).tolist() == nodes.tolist()
    assert model.probe_node.tolist() == nodes.tolist()


def test_the_lower_side_runs_from_left_to_right_and_touches_the_skin_from_above(model):
    x_mm, y_mm = model.lower_side_mm.T
    assert (np.diff(x_mm) > 0).all()
    apex_mm = model.node_mm[model.apex - 1]
    assert np.interp(apex_mm[0], x_mm, y_mm) == pytest.approx(apex_mm[1], abs=1e-6)


def test_held_nodes_are_those_of_the_bone_and_of_the_nails_outer_side(model):
    bone = next(layer for layer in model.layers if layer.name == "bone")
    nail = next(layer for layer in model.layers if layer.name == "nail")
    held = set(model.held.tolist())
    assert set(bone.node.ravel().tolist()) <= held
    assert held <= set(bone.node.ravel().tolist()) | set(nail.node.ravel().tolist())
    assert len(held - set(bone.node.ravel().tolist())) > 3


def test_afferents_and_apex_are_watched_each_once(model):
    watched = model.watched.tolist()
    assert watched == [*model.afferent.values(), model.apex]
    assert len(set(watched)) == len(watched)


def test_a_contact_face_lies_between_two_contact_nodes(model):
    nodes = {
        int(number): row
        for layer in model.layers
        for number, row in zip(layer.number, layer.node, strict=True)
    }
    found = set()
    for element, face in model.contact_face.tolist():
        row = nodes[element]
        found |= {int(row[face - 1]), int(row[face % 4])}
        if len(row) == 8:
            found.add(int(row[face + 3]))
    assert found == set(model.contact_node.tolist())


def test_each_site_tells_layer_and_depth(model):
    for name, words in model.sites.items():
        _, y_mm = model.node_mm[model.afferent[name] - 1]
        assert QUICK.afferents[name].layer in words
        assert f"depth = {-y_mm:.4f} mm" in words


def test_only_soft_layers_take_another_law(short):
    model = numbered(analyse(QUICK, SKIN, short, law="neo-hookean"))
    assert {layer.name for layer in model.layers if layer.law == "linear"} == {"bone", "nail"}
    assert model.probe.law == "linear"


def test_the_nodes_are_those_that_elements_use(model):
    used = {int(node) for layer in model.layers for node in layer.node.flat}
    assert model.node.tolist() == sorted(used)
    if not model.is_half:
        assert used == set(range(1, len(model.node_mm) + 1))


def test_a_half_has_the_numbers_of_the_whole_and_none_from_the_left(both):
    whole, half = both
    assert np.array_equal(half.node_mm, whole.node_mm)
    right = {n for n, (x, _) in enumerate(whole.node_mm, start=1) if x >= 0}
    assert set(half.node.tolist()) == right
    for name in ("held", "contact_node", "watched"):
        numbers = set(getattr(whole, name).tolist())
        assert set(getattr(half, name).tolist()) == numbers & right
    assert (half.afferent, half.apex) == (whole.afferent, whole.apex)
    elements = {n for layer in half.layers for n in layer.number.tolist()}
    faces = {tuple(face) for face in whole.contact_face.tolist() if face[0] in elements}
    assert {tuple(face) for face in half.contact_face.tolist()} == faces
    assert 2 * len(faces) == len(whole.contact_face)


def test_the_axis_of_a_half_is_at_x_0_and_a_whole_has_none(both):
    whole, half = both
    there = [n for n, (x, _) in enumerate(whole.node_mm, start=1) if x == 0]
    assert half.axis.tolist() == there
    assert len(there) > 10
    assert whole.axis.size == 0
    assert (whole.thickness_mm, half.thickness_mm) == (1.0, 2.0)
