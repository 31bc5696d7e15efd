"""Closed forms of the studies against their defining equations; limits of series."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from decks.finger import Material
from fembridge.reporting.hertz import E_STAR_MPA, MATERIAL, RADIUS_MM, Hertz, cylinder_on_block
from fembridge.reporting.plane import (
    INNER_DISPLACEMENT_MM,
    INNER_MM,
    NEO_HOOKEAN,
    OUTER_MM,
    ring_problem,
    ring_stress_mpa,
    uniform_stress_mpa,
)
from fembridge.reporting.verification_runs import extrapolated

WIDTH = np.array([0.8, 0.4, 0.2, 0.1])
forces = st.floats(1e-3, 1e3)
materials = st.builds(Material, st.floats(0.01, 10), st.floats(0, 0.499))


@given(force=forces)
def test_the_pressure_of_hertz_integrates_to_the_force(force):
    form = Hertz(force)
    angle = np.linspace(-np.pi / 2, np.pi / 2, 20_001)
    x_mm = form.half_width_mm * np.sin(angle)
    total = np.trapezoid(form.pressure_mpa(x_mm), x_mm)
    assert_allclose(total, force, rtol=1e-6)
    assert form.pressure_mpa(np.array([1.001 * form.half_width_mm])) == 0
    assert_allclose(form.peak_mpa, E_STAR_MPA * form.half_width_mm / (2 * RADIUS_MM))


@given(force=forces)
def test_stress_on_the_axis_starts_at_the_pressure_and_decays(force):
    """At depth 0 both are -p0; far below, stress along is that of a line load, 2P/(pi z)."""
    form = Hertz(force)
    far_mm = 200 * form.half_width_mm
    top, far = form.axis_mpa(np.array([0.0, far_mm]))
    assert_allclose(top[:2], [-form.peak_mpa] * 2)
    assert_allclose(far[1], -2 * force / (np.pi * far_mm), rtol=1e-4)
    assert_allclose(top[2], MATERIAL.poisson * top[:2].sum())
    assert abs(far[0]) < 1e-4 * abs(far[1])


def test_the_largest_shear_is_where_johnson_reports_it():
    """0.300 p0 at 0.786 a."""
    form = Hertz(1.0)
    depth_mm = form.half_width_mm * np.linspace(0, 2, 2001)
    across, along = form.axis_mpa(depth_mm)[:, :2].T
    shear = 0.5 * np.abs(across - along)
    assert_allclose(shear.max() / form.peak_mpa, 0.300, atol=5e-4)
    assert_allclose(depth_mm[shear.argmax()] / form.half_width_mm, 0.786, atol=2e-3)


@pytest.mark.parametrize("halvings", [0, 1])
def test_each_mesh_of_the_block_has_the_nodes_of_the_coarser_mesh(halvings):
    coarse, fine = (cylinder_on_block(k)[0].mesh for k in (halvings, halvings + 1))
    assert len(fine.quad) == 4 * len(coarse.quad)
    fine_nodes = set(map(tuple, fine.node_mm.tolist()))
    assert all(tuple(node) in fine_nodes for node in coarse.node_mm.tolist())


@given(angle=st.floats(-3, 3), material=materials, law=st.sampled_from(["linear", NEO_HOOKEAN]))
def test_a_rotation_causes_no_stress(angle, material, law):
    cos, sin = np.cos(angle), np.sin(angle)
    rotation = np.array([[cos - 1, -sin], [sin, cos - 1]])
    stress = uniform_stress_mpa(rotation, material, law, large_strain=True)
    assert_allclose(stress, 0, atol=1e-9 * material.young_mpa)


@given(
    parts=st.lists(st.floats(-1, 1), min_size=4, max_size=4),
    material=materials,
    law=st.sampled_from(["linear", NEO_HOOKEAN]),
)
def test_at_small_strain_both_laws_are_hooke_s(parts, material, law):
    gradient = 1e-7 * np.array(parts).reshape(2, 2)
    large = uniform_stress_mpa(gradient, material, law, large_strain=True)
    small = uniform_stress_mpa(gradient, material, law, large_strain=False)
    scale = 1e-7 * material.young_mpa / (1 - 2 * material.poisson)
    assert_allclose(large, small, atol=1e-5 * scale)


@given(material=materials)
def test_the_ring_is_in_equilibrium_and_free_outside(material):
    """``d sigma_rr / dr + (sigma_rr - sigma_tt) / r = 0``."""
    radius_mm = np.linspace(INNER_MM, OUTER_MM, 3001)
    radial, tangential, _ = ring_stress_mpa(radius_mm, material).T
    slope = np.gradient(radial, radius_mm)[1:-1]
    balance = slope + ((radial - tangential) / radius_mm)[1:-1]
    assert np.abs(balance).max() < 1e-4 * np.abs(slope).max()
    assert abs(radial[-1]) < 1e-9 * np.abs(radial).max()


@given(material=materials)
def test_the_rings_strain_moves_its_inner_side_as_prescribed(material):
    """By Hooke's law: the tangential strain is displacement over radius."""
    radial, tangential, axial = ring_stress_mpa(np.array([INNER_MM]), material)[0]
    strain = tangential - material.poisson * (radial + axial)
    assert_allclose(strain / material.young_mpa * INNER_MM, INNER_DISPLACEMENT_MM, rtol=1e-9)


@pytest.mark.parametrize("kind", ["CPE4", "CPE8R"])
def test_the_mesh_of_the_ring_has_its_sides_on_the_circles_and_cuts(kind):
    problem = ring_problem(kind, 4, Material(1.0, 0.3))
    corners = problem.node_mm[problem.element[:, :4]]
    ahead, across = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    doubled = ahead[:, 0] * across[:, 1] - ahead[:, 1] * across[:, 0]
    assert (doubled > 0).all()
    assert len(problem.element) == 4 * 8
    inner = np.isclose(np.linalg.norm(problem.node_mm, axis=1), INNER_MM)
    both_directions = ~np.isnan(problem.moved_mm).any(axis=1)
    inner_mm = problem.moved_mm[both_directions & np.isin(problem.moved, np.flatnonzero(inner))]
    assert len(inner_mm) == 9
    assert_allclose(np.linalg.norm(inner_mm, axis=1), abs(INNER_DISPLACEMENT_MM), rtol=1e-12)
    if kind == "CPE8R":  # mid-side nodes are in the middle
        middles = problem.node_mm[problem.element[:, 4:]]
        expected = 0.5 * (corners + np.roll(corners, -1, axis=1))
        assert_allclose(middles, expected, atol=1e-12)


@given(order=st.floats(0.5, 4), factor=st.floats(0.01, 5), limit=st.floats(1, 20))
def test_the_limit_and_order_of_a_power_law_and_an_index_of_1_25_times_the_error(
    order, factor, limit
):
    value = limit + factor * WIDTH**order
    limit_found, order_found, index_percent = extrapolated(WIDTH, value)
    assert_allclose([limit_found, order_found], [limit, order], rtol=1e-4)
    assert_allclose(index_percent, 1.25 * 100 * (value[-1] - limit) / value[-1], rtol=1e-3)


def test_a_series_that_scatters_has_no_limit_and_its_spread_as_uncertainty():
    limit, order, spread_percent = extrapolated(WIDTH, np.array([9.0, 10.0, 12.0, 11.0]))
    assert math.isnan(limit) and math.isnan(order)
    assert_allclose(spread_percent, 100 * (12 - 10) / 11)
