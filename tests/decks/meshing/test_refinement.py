"""A mesh made finer around a point: the same section, nothing hanging, no worse."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import KDTree

from decks.finger import LAYERS
from decks.mesh import Mesh, refined, scaled_jacobian
from decks.presets import QUICK, mesh_of

COARSE = mesh_of(QUICK)
FINE = refined(refined(COARSE, (0.0, 0.0), 0.2), (0.0, 0.0), 0.1)


def grid(columns, rows, width=1.0, height=1.0):
    """Rectangles in the epidermis; node 0 is the lower left one."""
    x, y = np.meshgrid(np.arange(columns + 1) * width, np.arange(rows + 1) * height)
    low = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    high = low + columns + 1
    quad = np.stack([low, low + 1, high + 1, high], -1)
    return Mesh(np.stack([x.ravel(), y.ravel()], -1), quad, np.ones(len(quad), int))


def layer_areas(mesh):
    return [mesh.area_mm2()[mesh.layer == k].sum() for k in range(len(LAYERS))]


@given(
    place=st.tuples(st.floats(0, 8), st.floats(0, 3)),
    radius=st.floats(0.75, 9),
    size=st.tuples(st.floats(0.5, 1), st.floats(0.5, 1)),
)
def test_nothing_hangs_and_no_area_is_lost_wherever_it_is_refined(place, radius, size):
    """`Mesh` refuses gaps, folds and what is too skewed."""
    coarse = grid(8, 6, *size)
    fine = refined(coarse, (place[0] * size[0], place[1] * size[1]), radius)
    assert_allclose(fine.area_mm2().sum(), coarse.area_mm2().sum(), rtol=1e-7)
    assert len(fine.quad) > len(coarse.quad)
    assert_array_equal(fine.node_mm[: len(coarse.node_mm)], coarse.node_mm)


def test_a_preset_keeps_its_layers_its_symmetry_and_the_shape_of_its_elements():
    assert_allclose(layer_areas(FINE), layer_areas(COARSE), rtol=1e-7)
    way_mm, image = KDTree(FINE.node_mm).query(FINE.node_mm * [-1.0, 1.0])
    assert way_mm.max() <= 2e-9  # they are rounded to 1e-9
    assert_array_equal(np.sort(image), np.arange(len(image)))
    assert scaled_jacobian(FINE.node_mm, FINE.quad).min() >= 0.37


def test_twice_makes_the_elements_at_the_apex_of_a_preset_nine_times_narrower():
    def narrowest_mm(mesh):
        edge, _, _ = mesh.outline()
        x_mm, y_mm = mesh.node_mm[np.unique(edge)].T
        return np.sort(x_mm[(x_mm > 0) & (y_mm > -0.1)])[0]

    assert_allclose(narrowest_mm(FINE), narrowest_mm(COARSE) / 9, rtol=1e-6)
