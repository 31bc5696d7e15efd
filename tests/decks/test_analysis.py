"""What an analysis holds, its numbers, and when half of it will do: plain loops show it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from decks.contact_analysis import SAME_MM, Contact, Model
from decks.finger import AfferentSite
from decks.mesh import Mesh
from decks.presets import QUICK, mesh_of
from decks.probe import Probe
from fembridge.errors import DeckError

SKIN = mesh_of(QUICK)
HALVES = ("CPE4", "CPE8R")


def half_of(stimulus, element="CPE4", watched=None, **options):
    """`quick` with half of it asked for."""
    return Model(QUICK, SKIN, element=element, **options).analysis(stimulus, watched=watched)


@pytest.fixture(scope="module", params=HALVES)
def both(request, short):
    """Give a whole and its half."""
    half = half_of(short, request.param)
    return half_of(short, request.param, support="prescribed"), half


# ---- Contact


@pytest.mark.parametrize(
    "wrong",
    [
        {"formulation": "mortar"},
        {"stiffness_mpa_per_mm": 0.0},
        {"stiffness_mpa_per_mm": np.nan},
        {"friction": -0.1},
        {"stick_share": 0},
        {"stick_share": np.inf},
    ],
)
def test_a_contact_that_no_solver_takes_is_a_deck_error(wrong):
    with pytest.raises(DeckError, match=next(iter(wrong)).split("_")[0]):
        Contact(**wrong)


# ---- The half


def test_a_half_has_the_numbers_of_the_whole_none_from_the_left_and_an_axis(both):
    whole, half = both
    assert np.array_equal(half.node_mm, whole.node_mm)
    right = {n for n, (x, _) in enumerate(whole.node_mm, start=1) if x >= 0}
    assert set(half.node.tolist()) == right
    for name in ("fixed", "contact_node", "watched"):
        numbers = set(getattr(whole, name).tolist())
        assert set(getattr(half, name).tolist()) == numbers & right
    assert (half.afferent, half.apex) == (whole.afferent, whole.apex)
    elements = {n for layer in half.layers for n in layer.number.tolist()}
    faces = {tuple(face) for face in whole.contact_face.tolist() if face[0] in elements}
    assert {tuple(face) for face in half.contact_face.tolist()} == faces
    assert 2 * len(faces) == len(whole.contact_face)
    there = [n for n, (x, _) in enumerate(whole.node_mm, start=1) if x == 0]
    assert half.axis.tolist() == there
    assert len(there) > 10
    assert whole.axis.size == 0
    assert (whole.thickness_mm, half.thickness_mm) == (1.0, 2.0)
    assert half.watched_on_axis == (half.afferent["SA"], half.afferent["PC"], half.apex)
    assert half.full_section().watched_on_axis == ()


@pytest.mark.parametrize(
    "options",
    [
        {"section": "whole"},
        {"support": "prescribed"},
        {"inertia": True},
        {"contact": Contact("surface-to-surface")},
        {"probe": Probe(x_mm=0.25)},
    ],
)
def test_all_is_computed_where_it_was_asked_for_or_half_would_not_do(options, short):
    assert not half_of(short, **options).is_half


def test_all_is_computed_where_an_afferent_or_a_watched_node_is_on_the_left(short):
    sites = {**QUICK.afferents, "RA": AfferentSite("epidermis", -0.125, 0.52)}
    finger = replace(QUICK, afferents=sites)
    analysis = Model(finger, SKIN, support="spring", section="half").analysis(short)
    assert "RA is at x = -0.125 mm" in analysis.why_whole
    row = int(SKIN.node_mm[:, 0].argmin())
    assert f"node {row + 1} is at x = -" in half_of(short, watched=np.array([row])).why_whole


@pytest.mark.parametrize(("way_mm", "same"), [(0.0, True), (0.5 * SAME_MM, True), (1e-7, False)])
def test_a_mesh_with_one_node_moved_is_no_mirror_image(way_mm, same, short):
    moved_mm = SKIN.node_mm.copy()
    row = int(np.argmax((moved_mm[:, 0] > 0.3) & (moved_mm[:, 1] < -0.3)))
    moved_mm[row, 0] += way_mm
    analysis = replace(half_of(short), mesh=Mesh(moved_mm, SKIN.quad, SKIN.layer))
    assert analysis.is_half == same
    layer = SKIN.layer.copy()
    layer[int(np.argmax(SKIN.in_layer("dermis")))] += 1
    assert not replace(half_of(short), mesh=Mesh(SKIN.node_mm, SKIN.quad, layer)).is_half


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
        fixed_row=image[[3]],
        afferent={},
        apex=3,
        contact_edge=np.zeros((0, 2), dtype=int),
    )
    assert analysis.is_half == same


def grid(x_mm):
    """One row of elements between `x_mm`, below y = 0."""
    x_mm = np.asarray(x_mm, dtype=float)
    count = len(x_mm)
    top, low = np.zeros(count), np.full(count, -1.0)
    node_mm = np.stack([np.tile(x_mm, 2), np.concatenate([top, low])], -1)
    left = np.arange(count - 1)
    quad = np.stack([left + count, left + 1 + count, left + 1, left], -1)
    return Mesh(node_mm, quad, np.zeros(count - 1))


usual_half = cache(half_of)


def strip(stimulus, mesh):
    """An analysis of a made-up mesh, fixed below, nothing else."""
    return replace(
        usual_half(stimulus),
        mesh=mesh,
        fixed_row=np.flatnonzero(mesh.node_mm[:, 1] < -0.5),
        afferent={},
        apex=int(np.abs(mesh.node_mm[:, 0]).argmin()) + 1,
        contact_edge=np.stack([np.arange(len(mesh.quad)), np.full(len(mesh.quad), 2)], -1),
    )


def test_a_mirrored_mesh_with_elements_across_the_axis_is_computed_whole(short):
    assert strip(short, grid([-1.0, 0.0, 1.0])).is_half
    across = strip(short, grid([-1.5, -0.5, 0.5, 1.5]))
    assert not replace(across, apex=3).is_half  # at x = 0.5


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
    (layer,) = strip(short, shuffled).layers
    assert len(layer.number) == len(widths_mm)
    assert shuffled.node_mm[layer.node - 1, 0].min() >= 0
