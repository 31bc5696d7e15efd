"""The table of meshes, against values whose limit is known."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from fembridge.deflection.profile import COMPARED_MM, Deflection, convergence, richardson
from fembridge.errors import ResponseError

DISTANCE_MM = np.linspace(0.0, 6.0, 61)


def mesh(elements, error=0.0, depth_mm=1.0):
    """Give a mesh whose deflection and force are wrong by `error` everywhere."""
    return Deflection(
        name=f"mesh {elements}",
        elements=elements,
        distance_mm=DISTANCE_MM,
        deflection_mm=1.0 - DISTANCE_MM / 8 + error,
        depth_mm=depth_mm,
        loading_mm=np.array([0.0, depth_mm]),
        loading_n_per_mm=np.array([0.0, 0.035 + error]),
    )


@given(
    limit=st.floats(-2, 2),
    factor=st.floats(0.1, 5) | st.floats(-5, -0.1),
    order=st.floats(0.5, 4),
    ratios=st.tuples(st.floats(1.3, 3), st.floats(1.3, 3)),
)
def test_three_meshes_give_limit_and_order_of_a_power_law(limit, factor, order, ratios):
    width = np.array([ratios[0] * ratios[1], ratios[1], 1.0])
    found, found_order = richardson(width, limit + factor * width**order)
    assert_allclose(found_order, order, rtol=1e-6)
    assert_allclose(found, limit, rtol=1e-6, atol=1e-6 * abs(factor))


@pytest.mark.parametrize(
    "values",
    [
        pytest.param([1.0, 1.2, 1.1], id="from both sides"),
        pytest.param([1.0, 1.0, 1.0], id="no change"),
        pytest.param([1.0, 1.1, 1.5], id="ever faster"),
        pytest.param([1.0, 1.1, np.nan], id="no number"),
    ],
)
def test_values_that_do_not_close_in_have_no_limit(values):
    limit, order = richardson(np.array([4.0, 2.0, 1.0]), np.array(values))
    assert math.isnan(limit)
    assert math.isnan(order)


def test_the_table_has_the_distances_and_the_force_and_finds_the_limit_of_each():
    """Errors go with the width squared, so with one over the number of elements."""
    meshes = [mesh(count, error=30 / count) for count in (18000, 3000, 8000)]
    *down, force = convergence(meshes)
    names = [f"deflection_mm at {x_mm:g} mm" for x_mm in COMPARED_MM]
    assert [row.quantity for row in down] == names
    for row, distance_mm in zip(down, COMPARED_MM, strict=True):
        exact = 1 - distance_mm / 8
        assert_allclose(row.values, [exact + 30 / n for n in (3000, 8000, 18000)])
        assert_allclose((row.limit, row.order), (exact, 2.0), rtol=1e-6)
        change = 100 * (30 / 18000 - 30 / 8000) / (exact + 30 / 18000)
        assert_allclose(row.change_percent, change)
    assert force.quantity == "force_n_per_mm"
    assert_allclose(force.limit, 0.035, rtol=1e-6)


def test_two_meshes_have_a_change_and_no_limit():
    row = convergence([mesh(3000, 0.02), mesh(8000, 0.01)])[0]
    assert_allclose(row.change_percent, -100 * 0.01 / 1.01)
    assert math.isnan(row.limit)


def test_one_mesh_or_two_depths_are_no_study():
    with pytest.raises(ResponseError, match="1 profiles of depths"):
        convergence([mesh(3000)])
    with pytest.raises(ResponseError, match=r"depths \[0\.5, 1\.0\] mm, expected two"):
        convergence([mesh(3000), mesh(8000, depth_mm=0.5)])
