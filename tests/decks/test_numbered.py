"""Numbers are those of the mesh's rows, counted from one: plain loops tell."""

import numpy as np
import pytest

from decks.analysis import analyse
from decks.finger import LAYERS
from decks.numbered import QUADRATIC, numbered
from decks.presets import QUICK, mesh_of

SKIN = mesh_of(QUICK)
ELEMENTS = ("CPE4", "CPE4H", "CPE8", "CPE8R")


@pytest.fixture(params=ELEMENTS)
def model(request, short):
    return numbered(analyse(QUICK, SKIN, short, element=request.param))


def test_every_element_of_the_mesh_is_in_the_section_of_its_layer_once(model):
    seen = {}
    for layer in model.layers:
        for number, nodes in zip(layer.number, layer.node, strict=True):
            seen[int(number)] = (layer.name, tuple(nodes[:4].tolist()))
    assert len(seen) == sum(len(layer.number) for layer in model.layers)
    assert sorted(seen) == list(range(1, len(SKIN.quad) + 1))
    for row, quad in enumerate(SKIN.quad):
        expected = LAYERS[SKIN.layer[row]], tuple(int(node) + 1 for node in quad)
        assert seen[row + 1] == expected


def test_a_mid_side_is_half_way_between_its_corners(model):
    for layer in model.layers:
        corners = model.node_mm[layer.node[:, :4] - 1]
        if model.analysis.element not in QUADRATIC:
            assert layer.node.shape[1] == 4
            continue
        middle = model.node_mm[layer.node[:, 4:] - 1]
        np.testing.assert_array_equal(
            middle, 0.5 * (corners + np.roll(corners, -1, axis=1))
        )


def test_the_probe_follows_the_finger_without_a_gap(model):
    count = sum(len(layer.number) for layer in model.layers)
    assert model.first_probe_node == len(model.node_mm) + 1
    assert model.probe.number[0] == count + 1
    used = np.unique(model.probe.node)
    assert used[0] == model.first_probe_node
    assert used.size == len(model.probe_node_mm)
    assert used[-1] == used[0] + used.size - 1


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
    assert {layer.name for layer in model.layers if layer.law == "linear"} == {
        "bone",
        "nail",
    }
    assert model.probe.law == "linear"
