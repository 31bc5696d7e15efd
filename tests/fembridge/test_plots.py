"""Pictures: what they show, where it stands, and what becomes of the file."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from decks.finger import AfferentSite, Material
from decks.presets import PAPER, QUICK, mesh_of
from decks.probe import Probe
from fembridge.plots.mesh import (
    afferent_nodes,
    boundaries,
    close_window,
    mesh_figure,
    probe_outline,
)
from fembridge.plots.style import spread

CROWDED = replace(
    QUICK,
    afferents={
        "SA": AfferentSite("epidermis", -0.25, 0.55),
        "RA": AfferentSite("epidermis", 0.25, 0.55),
        "PC": AfferentSite("epidermis", 0.0, 0.5),
    },
)
FAR = replace(
    QUICK,
    afferents={
        "SA": AfferentSite("epidermis", -1.5, 0.7),
        "PC": AfferentSite("subcutaneous_tissue", 1.0, 4.0),
    },
)


def test_a_boundary_is_an_edge_between_layers_or_with_one_element():
    mesh = mesh_of(QUICK)
    found = {}
    for element, quad in enumerate(mesh.quad.tolist()):
        for start, end in zip(quad, quad[1:] + quad[:1], strict=True):
            found.setdefault(frozenset((start, end)), []).append(mesh.layer[element])
    expected = {edge for edge, layers in found.items() if layers[0] != layers[-1]}
    expected |= {edge for edge, layers in found.items() if len(layers) == 1}
    row_of = {tuple(point): row for row, point in enumerate(mesh.node_mm.tolist())}
    ends = boundaries(mesh)
    drawn = [frozenset(row_of[tuple(end)] for end in pair) for pair in ends.tolist()]
    assert len(drawn) == len(expected)
    assert set(drawn) == expected


@pytest.mark.parametrize(
    ("shape", "diameter_mm"), [("cylinder", 0.05), ("cylinder", 1.0), ("flat", 0.2), ("flat", 3.0)]
)
def test_the_drawn_probe_is_as_wide_as_it_is_said_to_be_and_touches(shape, diameter_mm):
    mesh = mesh_of(QUICK)
    probe = Probe(shape=shape, diameter_mm=diameter_mm, x_mm=0.3)
    body_mm = probe_outline(probe, mesh)
    assert_allclose(np.ptp(body_mm[:, 0]), diameter_mm, rtol=1e-6)
    assert_allclose(body_mm[:, 0].mean(), 0.3, atol=0.02 * diameter_mm)
    skin_mm = np.linspace(boundaries(mesh)[:, 0], boundaries(mesh)[:, 1], 21)
    low = body_mm[body_mm[:, 1] <= body_mm[:, 1].min() + 0.1 * diameter_mm]
    gap_mm = np.linalg.norm(skin_mm.reshape(-1, 1, 2) - low, axis=-1).min()
    assert gap_mm < 0.02


@pytest.mark.parametrize("finger", [QUICK, PAPER])
def test_a_marked_afferent_is_the_node_that_a_deck_would_watch(finger):
    mesh = mesh_of(finger)
    for place in afferent_nodes(finger, mesh):
        row = mesh.node_at(finger.afferents[place.afferent])
        assert place.node == row + 1
        assert_array_equal(mesh.node_mm[row], [place.x_mm, place.y_mm])
        assert place.depth_mm == -place.y_mm


@pytest.mark.parametrize(
    ("finger", "probe"),
    [
        pytest.param(QUICK, Probe(), id="quick", marks=pytest.mark.slow),
        pytest.param(PAPER, Probe(diameter_mm=0.05, x_mm=-1.2), id="paper", marks=pytest.mark.slow),
        pytest.param(CROWDED, Probe(shape="flat", diameter_mm=4.0), id="crowded"),
        pytest.param(FAR, Probe(x_mm=2.0), id="far apart"),
    ],
)
def test_no_words_overlap_and_none_leave_the_page(finger, probe, check_words):
    mesh = mesh_of(replace(finger, afferents=QUICK.afferents))
    figure = mesh_figure(finger, mesh, probe)
    check_words(figure)
    section, pad = figure.axes
    for site in afferent_nodes(finger, mesh):
        assert pad.viewLim.contains(site.x_mm, site.y_mm)
    assert all(section.viewLim.contains(*corner) for corner in pad.viewLim.corners())


def test_materials_are_named_with_the_numbers_they_have(words_of):
    dermis = Material(young_mpa=0.085, poisson=0.495)
    finger = replace(QUICK, materials={**QUICK.materials, "dermis": dermis})
    figure = mesh_figure(finger, mesh_of(finger), Probe())
    shown = [text.get_text() for text in words_of(figure)]
    assert "Dermis\n$E$ = 85 kPa, $\\nu$ = 0.495" in shown
    assert "Bone\n$E$ = 17 GPa, $\\nu$ = 0.30" in shown
    assert "Probe\nrigid, cylinder, 1 mm" in shown


@given(heights=st.lists(st.floats(-5, 5), min_size=1, max_size=6), step=st.floats(0.01, 1.5))
def test_names_are_moved_apart_in_order_and_stay_on_the_panel(heights, step):
    wanted = sorted(heights, reverse=True)
    placed = np.array(spread(wanted, step, -5.0, 5.0))
    assert (-np.diff(placed) >= step - 1e-9).all()
    assert placed.max() <= 5 + 1e-9
    assert placed.min() >= -5 - 1e-9
    if (-np.diff(wanted) >= step).all():
        assert_allclose(placed, wanted, atol=1e-12)


@given(
    sites=st.lists(st.tuples(st.floats(-3, 3), st.floats(-5, -0.1)), min_size=1, max_size=4),
    x_mm=st.floats(-3, 3),
    aspect=st.floats(0.4, 1.5),
)
def test_the_close_view_has_its_shape_and_all_that_matters_in_it(sites, x_mm, aspect):
    body_mm = np.array([[x_mm - 0.5, 0.5], [x_mm, -0.1], [x_mm + 0.5, 0.5]])
    window = close_window(np.array(sites), body_mm, aspect)
    assert window.aspect == pytest.approx(aspect)
    assert np.diff(window.x_mm)[0] >= 2.0 - 1e-9
    assert window.y_mm[0] <= -2.3 + 1e-9
    for x, y in [*sites, (x_mm, -0.1)]:
        assert window.x_mm[0] < x < window.x_mm[1]
        assert window.y_mm[0] < y < window.y_mm[1]
