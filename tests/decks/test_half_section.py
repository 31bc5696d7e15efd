"""When half of a section will do: plain loops over nodes and elements tell."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from decks.analysis import Contact, analyse
from decks.finger import AfferentSite
from decks.half_section import SAME_MM, half_section, nodes_on_axis, on_axis, why_whole
from decks.meshing.mesh import Mesh
from decks.presets import PRESETS, QUICK, mesh_of
from decks.probe import Probe
from fembridge.errors import DeckError

MESHES = {name: mesh_of(finger) for name, finger in PRESETS.items()}
SKIN = MESHES["quick"]


def half_of(stimulus, **options):
    """`quick` with half of it asked for."""
    asked = {"drive": "spring", "section": "half", **options}
    return analyse(QUICK, SKIN, stimulus, **asked)


def grid(x_mm, layers=None):
    """One row of elements between `x_mm`, below y = 0."""
    x_mm = np.asarray(x_mm, dtype=float)
    count = len(x_mm)
    top, low = np.zeros(count), np.full(count, -1.0)
    node_mm = np.stack([np.tile(x_mm, 2), np.concatenate([top, low])], -1)
    left = np.arange(count - 1)
    quad = np.stack([left + count, left + 1 + count, left + 1, left], -1)
    return Mesh(node_mm, quad, np.zeros(count - 1) if layers is None else layers)


def strip(stimulus, mesh):
    """An analysis of a made-up mesh, held below, nothing else."""
    below = np.flatnonzero(mesh.node_mm[:, 1] < -0.5)
    return replace(
        half_of(stimulus),
        mesh=mesh,
        held=below,
        afferent={},
        apex=int(np.abs(mesh.node_mm[:, 0]).argmin()),
        contact_edge=np.stack([np.arange(len(mesh.quad)), np.full(len(mesh.quad), 2)], -1),
    )


@pytest.mark.parametrize("name", PRESETS)
def test_half_of_a_finger_is_what_lies_right_of_the_axis_and_half_of_its_area(name, short):
    finger, mesh = PRESETS[name], MESHES[name]
    analysis = analyse(finger, mesh, short, drive="spring", section="half")
    half = half_section(analysis)
    for row, quad in enumerate(mesh.quad):
        right = all(mesh.node_mm[node, 0] >= 0 for node in quad)
        left = all(mesh.node_mm[node, 0] <= 0 for node in quad)
        assert right != left
        assert half.element[row] == right
    area_mm2 = mesh.area_mm2()
    assert_allclose(area_mm2[half.element].sum(), 0.5 * area_mm2.sum(), rtol=1e-12)
    probe = analysis.probe
    x_mm = probe.node_mm[probe.quad[half.probe_quad], 0]
    assert half.probe_quad.sum() == len(probe.quad) / 2
    assert x_mm.min() == 0.0


def test_the_watched_nodes_on_the_axis_are_told_by_their_numbers(short):
    analysis = half_of(short)
    rows = {*analysis.afferent.values(), analysis.apex}
    there = {row + 1 for row in rows if SKIN.node_mm[row, 0] == 0}
    assert set(nodes_on_axis(analysis)) == there
    assert analysis.afferent["SA"] + 1 in there
    assert analysis.afferent["RA"] + 1 not in there
    assert nodes_on_axis(replace(analysis, section="whole")) == ()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"section": "whole"}, "the whole section was asked for"),
        ({"drive": "prescribed"}, "each of the probe's nodes is prescribed"),
        ({"inertia": True}, "inertia counts"),
        ({"contact": Contact("surface-to-surface")}, "contact is surface to surface"),
        ({"probe": Probe(x_mm=0.25)}, "the probe is no mirror image of itself"),
    ],
)
def test_all_is_computed_where_it_was_asked_for_or_half_would_not_do(options, words, short):
    analysis = half_of(short, **options)
    assert why_whole(analysis) == words
    assert half_section(analysis) is None


def test_all_is_computed_of_a_probe_that_slides(short):
    assert why_whole(half_of(short.sliding(10.0))) == "the probe slides"


def test_all_is_computed_where_an_afferent_is_on_the_left(short):
    sites = {**QUICK.afferents, "RA": AfferentSite("epidermis", -0.125, 0.52)}
    finger = replace(QUICK, afferents=sites)
    analysis = analyse(finger, SKIN, short, drive="spring", section="half")
    assert why_whole(analysis) == "afferent RA is at x = -0.125 mm"


def test_all_is_computed_where_a_watched_node_is_on_the_left(short):
    row = int(SKIN.node_mm[:, 0].argmin())
    analysis = half_of(short, watched=np.array([row]))
    assert why_whole(analysis).startswith(f"watched node {row + 1} is at x = -")


@pytest.mark.parametrize(("way_mm", "same"), [(0.0, True), (0.5 * SAME_MM, True), (1e-7, False)])
def test_a_mesh_with_one_node_moved_is_no_mirror_image(way_mm, same, short):
    moved_mm = SKIN.node_mm.copy()
    row = int(np.argmax((moved_mm[:, 0] > 0.3) & (moved_mm[:, 1] < -0.3)))
    moved_mm[row, 0] += way_mm
    analysis = replace(half_of(short), mesh=Mesh(moved_mm, SKIN.quad, SKIN.layer))
    words = None if same else "the mesh is no mirror image of itself"
    assert why_whole(analysis) == words


def test_a_mesh_with_one_element_of_another_layer_is_no_mirror_image(short):
    layer = SKIN.layer.copy()
    row = int(np.argmax(SKIN.in_layer("dermis")))
    layer[row] += 1
    analysis = replace(half_of(short), mesh=Mesh(SKIN.node_mm, SKIN.quad, layer))
    assert why_whole(analysis) == "the mesh is no mirror image of itself"


@pytest.mark.parametrize(("first", "same"), [(0, False), (1, True)])
def test_nodes_that_are_images_but_joined_otherwise_are_none(first, same, short):
    """Two hexagons with a node inside, which three quads fill in either of two ways."""
    angle = np.radians(30 + 60 * np.arange(6))
    x_mm, y_mm = np.append(np.cos(angle), 0.0), np.append(np.sin(angle), 0.0)
    right_mm = np.stack([x_mm + np.cos(np.pi / 6), y_mm], -1)
    right_mm[2:4, 0] = 0.0  # two corners lie on the axis
    image = np.array([7, 8, 2, 3, 9, 10, 11])
    node_mm = np.concatenate([right_mm, right_mm[[0, 1, 4, 5, 6]] * [-1.0, 1.0]])

    def joined(start):
        around = np.arange(start, start + 6, 2)
        return [[6, k % 6, (k + 1) % 6, (k + 2) % 6] for k in around]

    left = [image[quad][::-1] for quad in joined(first)]
    mesh = Mesh(node_mm, np.array([*joined(1), *left]), np.zeros(6))
    analysis = replace(
        half_of(short),
        mesh=mesh,
        held=image[[3]],
        afferent={},
        apex=2,
        contact_edge=np.zeros((0, 2), dtype=int),
    )
    words = None if same else "the mesh is no mirror image of itself"
    assert why_whole(analysis) == words


def test_a_mirrored_mesh_with_elements_across_the_axis_is_computed_whole(short):
    assert why_whole(strip(short, grid([-1.0, 0.0, 1.0]))) is None
    across = strip(short, grid([-1.5, -0.5, 0.5, 1.5]))
    across = replace(across, apex=2)  # at x = 0.5
    assert why_whole(across) == "the mesh is no mirror image of itself"


@given(
    widths_mm=st.lists(st.floats(0.5, 2.0), min_size=1, max_size=6),
    order=st.randoms(use_true_random=False),
)
def test_any_row_of_elements_and_its_image_is_halved_however_numbered(short, widths_mm, order):
    right_mm = np.cumsum([0.0, *widths_mm])
    mesh = grid([*-right_mm[:0:-1], *right_mm])
    nodes, elements = list(range(len(mesh.node_mm))), list(range(len(mesh.quad)))
    order.shuffle(nodes)
    order.shuffle(elements)
    number = np.argsort(nodes)
    shuffled = Mesh(mesh.node_mm[nodes], number[mesh.quad[elements]], mesh.layer)
    analysis = strip(short, shuffled)
    half = half_section(analysis)
    assert half.element.sum() == len(widths_mm)
    for row in np.flatnonzero(half.element):
        assert shuffled.node_mm[shuffled.quad[row], 0].min() >= 0


def test_what_is_held_or_may_touch_on_one_side_alone_is_no_mirror_image(short):
    plain = strip(short, grid([-2.0, -1.0, 0.0, 1.0, 2.0]))
    assert why_whole(plain) is None
    held = replace(plain, held=plain.held[1:])
    assert why_whole(held) == "what is held is no mirror image of itself"
    touched = replace(plain, contact_edge=plain.contact_edge[1:])
    assert why_whole(touched) == ("the skin that may touch is no mirror image of itself")


def test_a_place_within_the_tolerance_of_the_axis_is_on_it():
    x_mm = np.array([0.0, 0.9 * SAME_MM, -0.9 * SAME_MM, 2 * SAME_MM, -0.1])
    places = np.stack([x_mm, np.ones(5)], -1)
    assert on_axis(places).tolist() == [True, True, True, False, False]


def test_a_section_that_is_none_is_refused(short):
    with pytest.raises(DeckError, match="section 'left', expected one of whole, half"):
        half_of(short, section="left")
