"""The section's curves against the geometry of ellipses and cosines."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.special import ellipe

from decks.finger import Finger, Nail, Outline, Papillae, Ridges
from decks.presets import QUICK
from decks.section import section_of
from fembridge.errors import FingerError

SECTION = section_of(QUICK)


def half_perimeter_mm(outline):
    short, long = sorted((outline.half_width_mm, outline.half_height_mm))
    return 2 * long * ellipe(1 - (short / long) ** 2)


@settings(max_examples=25)
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


@settings(max_examples=20)
@given(st.floats(0.0, 1.75))
def test_a_curve_at_one_depth_is_that_far_from_the_outline(depth_mm):
    arc_mm = np.linspace(0.0, SECTION.end_arc_mm, 11)
    points = SECTION.curve(lambda arc: np.full_like(arc, depth_mm), arc_mm)
    away_mm = [np.linalg.norm(SECTION.point_mm - point, axis=1).min() for point in points]
    assert_allclose(away_mm, depth_mm, atol=4e-4)  # half of the sampling's step


def test_every_curve_begins_and_ends_on_the_axis_to_the_last_bit():
    ends = np.array([0.0, SECTION.end_arc_mm])
    for depth in (SECTION.surface, SECTION.corneum, SECTION.epidermis, SECTION.dermis):
        assert_array_equal(SECTION.curve(depth, ends)[:, 0], 0.0)
    assert_array_equal(SECTION.bone(np.array([0.0, np.pi]))[:, 0], 0.0)


def test_ridges_are_half_a_millimetre_apart_and_a_tenth_high():
    tops, grooves = np.arange(0, 2.6, 0.5), np.arange(0.25, 2.5, 0.5)
    assert_allclose(SECTION.surface(tops), 0.0, atol=1e-15)
    assert_allclose(SECTION.surface(grooves), 0.1, rtol=1e-12)
    assert SECTION.surface(np.linspace(0, 20, 999)).min() >= 0


def test_ridges_fade_over_the_last_one_and_leave_a_smooth_skin():
    beyond = np.linspace(3.0, SECTION.end_arc_mm, 99)
    assert_array_equal(SECTION.surface(beyond), 0.0)
    assert 0.04 < SECTION.surface(np.array([2.75]))[0] < 0.06


def test_the_corneum_takes_up_half_of_the_ridges():
    tops, grooves = np.array([0.0, 0.5]), np.array([0.25, 0.75])
    assert_allclose(SECTION.corneum(tops), 0.25, rtol=1e-12)
    assert_allclose(SECTION.corneum(grooves), 0.30, rtol=1e-12)


def test_the_nail_is_as_thick_as_it_says_from_where_it_begins():
    on_nail = np.linspace(SECTION.nail_arc_mm, SECTION.end_arc_mm, 9)
    assert_allclose(SECTION.corneum(on_nail), 0.45, rtol=1e-12)


@settings(max_examples=25)
@given(st.floats(95, 170))
def test_the_nail_begins_at_its_angle(start_deg):
    section = section_of(replace(QUICK, nail=Nail(start_deg=start_deg)))
    at = np.array([section.nail_arc_mm])
    ((x, y),) = section.curve(lambda arc: np.zeros_like(arc), at)
    assert_allclose(np.degrees(np.arctan2(x, y + 6.5)), start_deg, atol=0.01)


def test_the_epidermis_is_deepest_under_ridges_and_papillae_stand_beside_them():
    at = np.array([0.0, 0.125, 0.25, 0.375, 0.5])
    assert_allclose(SECTION.epidermis(at), [0.70, 0.60, 0.70, 0.60, 0.70], rtol=1e-12)
    assert_allclose(SECTION.epidermis(np.array([3.0, 9.0])), 0.65, rtol=1e-12)


def test_merkel_and_meissner_sites_lie_in_the_epidermis_near_its_lower_side():
    for name, above_mm in (("SA", 0.1125), ("RA", 0.08)):
        site = QUICK.afferents[name]
        (lower_mm,) = SECTION.epidermis(np.array([site.x_mm]))
        assert_allclose(lower_mm - site.depth_mm, above_mm, rtol=1e-9)


def test_without_ridges_and_papillae_layers_are_parallel():
    plain = replace(QUICK, ridges=Ridges(height_mm=0), papillae=Papillae(0))
    section = section_of(plain)
    arc_mm = np.linspace(0, section.nail_arc_mm - 2.0, 50)
    assert_array_equal(section.surface(arc_mm), 0.0)
    assert_allclose(section.corneum(arc_mm), 0.25, rtol=1e-12)
    assert_allclose(section.epidermis(arc_mm), 0.65, rtol=1e-12)
    assert_allclose(section.dermis(arc_mm), 1.75, rtol=1e-12)


@settings(max_examples=50)
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


def test_the_bone_is_an_ellipse_at_its_depth():
    x, y = SECTION.bone(np.linspace(0, np.pi, 50)).T
    assert_allclose((x / 3.2) ** 2 + ((y + 8.5) / 2.2) ** 2, 1.0, rtol=1e-12)
    assert (y[0], y[-1]) == pytest.approx((-6.3, -10.7))
