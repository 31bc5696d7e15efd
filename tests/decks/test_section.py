"""The section's curves against the geometry of ellipses and cosines."""

from dataclasses import replace

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.special import ellipe

from decks.finger import Finger, Nail, Outline, Papillae, Ridges
from decks.presets import QUICK
from decks.section import section_of
from fembridge.errors import FingerError

SECTION = section_of(QUICK)


def half_perimeter_mm(outline):
    short, long = sorted((outline.half_width_mm, outline.half_height_mm))
    return 2 * long * ellipe(1 - (short / long) ** 2)


@settings(max_examples=10)
@given(st.floats(6.5, 12.0), st.floats(6.5, 9.0))
def test_the_outline_is_half_an_ellipse_from_apex_to_back(width_mm, height_mm):
    outline = Outline(width_mm, height_mm)
    section = section_of(replace(QUICK, outline=outline))
    x, y = section.point_mm.T
    around = (x / width_mm) ** 2 + (y / height_mm + 1) ** 2
    assert_allclose(around, 1.0, rtol=1e-12)
    assert_allclose(section.end_arc_mm, half_perimeter_mm(outline), rtol=1e-8)
    assert_allclose(section.point_mm[[0, -1]], [[0, 0], [0, -2 * height_mm]], atol=1e-9)


def test_normals_are_of_length_1_across_the_outline_and_point_inwards():
    inward = SECTION.normal
    along = np.gradient(SECTION.point_mm, SECTION.arc_mm, axis=0)
    assert_allclose(np.linalg.norm(inward, axis=1), 1.0, rtol=1e-12)
    assert_allclose((inward * along).sum(axis=1), 0.0, atol=1e-4)
    middle = np.array([0.0, -6.5])
    assert ((middle - SECTION.point_mm) * inward).sum(axis=1).min() > 6.0


@settings(max_examples=8)
@given(st.floats(0.0, 1.75))
def test_a_curve_at_one_depth_is_that_far_from_the_outline(depth_mm):
    arc_mm = np.linspace(0.0, SECTION.end_arc_mm, 11)
    points = SECTION.curve(lambda arc: np.full_like(arc, depth_mm), arc_mm)
    away_mm = [np.linalg.norm(SECTION.point_mm - point, axis=1).min() for point in points]
    assert_allclose(away_mm, depth_mm, atol=4e-4)  # half of the sampling's step


def test_the_epidermis_is_deepest_under_ridges_and_papillae_stand_beside_them():
    at = np.array([0.0, 0.125, 0.25, 0.375, 0.5])
    assert_allclose(SECTION.epidermis(at), [0.70, 0.60, 0.70, 0.60, 0.70], rtol=1e-12)
    assert_allclose(SECTION.epidermis(np.array([3.0, 9.0])), 0.65, rtol=1e-12)


@given(st.floats(0.0, 0.2), st.floats(0.0, 0.3), st.floats(0.1, 1.0), st.floats(0.3, 1.0))
def test_no_layer_of_a_finger_that_is_taken_is_thinner_than_nothing(
    ridge_mm, papilla_mm, epidermis_mm, dermis_mm
):
    skin = replace(QUICK.skin, epidermis_mm=epidermis_mm, dermis_mm=dermis_mm)
    try:
        finger = Finger(
            "f",
            skin=skin,
            ridges=Ridges(height_mm=ridge_mm),
            papillae=Papillae(papilla_mm),
            nail=Nail(thickness_mm=0.3),
        )
    except FingerError:
        assume(False)
    section = section_of(finger)
    arc_mm = np.linspace(0, section.end_arc_mm, 2001)
    depths = [
        boundary(arc_mm)
        for boundary in (section.surface, section.corneum, section.epidermis, section.dermis)
    ]
    assert np.diff(depths, axis=0).min() > 0
