"""Divisions of the outline, and the half that is mirrored into a whole."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from decks.finger import AfferentSite
from decks.mesh import Mesh
from decks.mesher import graded, snapped


@pytest.mark.parametrize(("start_mm", "stop_mm"), [(0.1, 0.4), (0.4, 0.1), (0.2, 0.2)])
def test_graded_steps_fill_the_length_and_grow_from_one_width_to_the_other(start_mm, stop_mm):
    division = graded(6.0, start_mm, stop_mm)
    steps = division.growth ** np.arange(division.count)
    steps *= 6.0 / steps.sum()
    assert division.count % 2 == 0
    assert abs(steps[0] / start_mm - 1) < 0.1
    assert abs(steps[-1] / stop_mm - 1) < 0.1


def half(x_mm=0.0):
    """Four squares of 0.1 mm, x from `x_mm`, the upper row in the epidermis."""
    x, y = np.meshgrid([0.0, 0.1, 0.2], [-0.5, -0.6, -0.7])
    quad = np.array([[3, 4, 1, 0], [4, 5, 2, 1], [6, 7, 4, 3], [7, 8, 5, 4]])
    nodes = np.stack([x.ravel() + x_mm, y.ravel()], -1)
    return Mesh(nodes, quad, np.array([1, 1, 2, 2]))


@given(st.floats(0.0, 0.25), st.floats(0.45, 0.65))
def test_the_axis_and_the_layers_boundaries_stay_where_they_are(x_mm, depth_mm):
    after = snapped(half(), [AfferentSite("epidermis", x_mm, depth_mm)]).node_mm
    assert after[3:].tolist() == half().node_mm[3:].tolist()
    assert after[0, 0] == 0.0


@pytest.mark.parametrize(
    "site",
    [
        AfferentSite("epidermis", 0.1, 0.65),  # below the epidermis
        AfferentSite("nail", 0.1, 0.5),  # no such layer here
    ],
)
def test_nothing_moves_where_elements_would_not_bear_it(site):
    assert snapped(half(), [site]).node_mm.tolist() == half().node_mm.tolist()
