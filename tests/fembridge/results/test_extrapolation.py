"""Extrapolation from integration points, against closed forms and plain loops."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from opened import naming

from fembridge.errors import UsageError
from fembridge.results.extrapolation import (
    ELEMENT_TYPES,
    node_positions,
    node_weights,
    point_positions,
)
from fembridge.results.read_options import ReadOptions
from fembridge.results.von_mises import von_mises_pa

ROOT3 = math.sqrt(3)
FULL = [n for n in ELEMENT_TYPES if ELEMENT_TYPES[n].points > 1]


def weights_of(number, method, stored=None):
    about = ELEMENT_TYPES[number]
    return node_weights(number, about.nodes, stored or about.points, method)


def shape_functions(about, places):
    """Of the corners alone, so that the sides are straight, ``(place, corner)``."""
    if about.family in ("tri", "tet"):
        return places
    if about.family == "wedge":
        flat, z = places[:, :3], places[:, 3:]
        return np.hstack([flat * (1 - z) / 2, flat * (1 + z) / 2])
    corners = node_positions(about)[: 2 ** places.shape[1]]
    return np.prod((1 + corners[None] * places[:, None]) / 2, axis=2)


@given(
    number=st.sampled_from(FULL),
    jitter=st.lists(st.floats(-0.25, 0.25), min_size=24, max_size=24),
    field=st.tuples(*[st.floats(-5, 5)] * 4),
)
def test_a_linear_field_in_a_parallelogram_comes_out_exactly(number, jitter, field):
    """Quadrilaterals and bricks sheared, the others distorted as they may be."""
    about = ELEMENT_TYPES[number]
    to, here = node_positions(about), point_positions(about.family, about.points)
    corners = shape_functions(about, to).shape[1]
    size = 2 if about.family in ("quad", "tri") else 3
    if about.family in ("tri", "tet"):
        base = np.vstack([np.zeros(size), np.eye(size)])
    elif about.family == "wedge":
        base = np.array([[*p, z] for z in (0, 1) for p in ((0, 0), (1, 0), (0, 1))])
    else:
        base = to[:corners]
    sheared = about.family in ("quad", "hex")
    rows = base if sheared else np.eye(corners)
    moved = np.array(jitter)[: rows.shape[1] * size].reshape(rows.shape[1], size)
    at_corners = base + rows @ moved
    value = lambda place: field[0] + place @ np.array(field[1 : 1 + size])  # noqa: E731

    found = weights_of(number, "linear") @ value(shape_functions(about, here) @ at_corners)

    wanted = value(shape_functions(about, to) @ at_corners)
    assert_allclose(found, wanted, rtol=0, atol=1e-12 * (1 + sum(map(abs, field))))


# Stress xx yy zz xy yz zx at the integration points of one brick of 5 x 5 x 10, and the
# same and von Mises stress that Marc printed at corners which no other element has:
# github.com/nightly/fedes, models/Example-3D-beam-small, element 2 of the .t19 and nodes
# 1, 2, 4, 3 of Model1-output-Marc.70.
MARC_POINTS = [
    [-77.6578, -208.941, -382.990, -2.15086, -324.550, 1.87901],
    [-50.5174, -142.860, -358.849, -65.5645, -314.374, -3.51541],
    [52.0788, 47.5861, 342.915, 17.3727, -309.267, 6.44237],
    [77.7992, 112.330, 363.590, -46.1048, -308.699, 2.50176],
    [-61.5738, -108.575, -340.881, 29.8893, 145.544, -1.15894],
    [-63.3622, -109.911, -345.773, -30.6024, 153.599, -6.72720],
    [78.1614, 152.041, 389.094, 30.1813, 159.389, 1.37250],
    [75.0017, 149.476, 380.860, -30.3692, 157.851, -2.73947],
]
MARC_CORNERS = {
    0: ([-136.96, -351.24, -666.39, 5.1577, -502.60, 3.4253], 985.24),
    1: ([-90.179, -237.35, -625.55, -104.60, -485.70, -5.9076], 984.96),
    2: ([131.85, 204.25, 624.59, -70.874, -475.57, 4.5053], 951.84),
    3: ([87.590, 92.495, 590.38, 39.038, -477.81, 11.352], 969.66),
}


@pytest.mark.parametrize("corner", MARC_CORNERS)
def test_linear_is_what_marc_prints_at_the_corners_of_a_brick(corner):
    printed, mises = MARC_CORNERS[corner]
    found = (weights_of(7, "linear") @ np.array(MARC_POINTS))[corner]
    assert_allclose(found, printed, rtol=0, atol=0.0021 * np.abs(printed).max())
    assert_allclose(von_mises_pa(found), mises, rtol=0.0019)
    direction = 1.73 / ROOT3 * (found - np.mean(MARC_POINTS, axis=0))
    direction += np.mean(MARC_POINTS, axis=0)
    share = direction / np.array(printed)
    assert_allclose(share, share[2], rtol=6e-5)  # five digits; one factor for all six


@pytest.mark.parametrize("number", [11, 27, 54, 125, 7, 21, 57, 127, 136])
def test_translate_takes_the_nearest_points_and_average_all(number):
    about = ELEMENT_TYPES[number]
    here, to = point_positions(about.family, about.points), node_positions(about)
    rng = np.random.default_rng(number)
    values = rng.normal(size=about.points)
    moved, mean = (weights_of(number, m) @ values for m in ("translate", "average"))
    for node, place in enumerate(to):
        away = [math.dist(place, point) for point in here]
        near = [v for v, d in zip(values, away, strict=True) if d < min(away) + 1e-9]
        assert moved[node] == pytest.approx(sum(near) / len(near), rel=1e-12)
        assert mean[node] == pytest.approx(sum(values) / len(values), rel=1e-12)


@pytest.mark.parametrize(
    ("asked", "shown"),
    [
        ((999, 5, 2, "linear"), (999,)),
        ((27, 8, 4, "average"), (27, 9, 4)),
        ((27, 4, 9, "average"), (27, 4, 8)),
    ],
)
def test_what_is_not_known_is_refused_and_average_is_left(asked, shown):
    with pytest.raises(ValueError, match=naming(*shown)):
        node_weights(*asked)
    assert node_weights(999, 3, 2, "average").tolist() == [[0.5, 0.5]] * 3
    with pytest.raises(UsageError, match=naming("extrapolate", "'cubic'", "linear")):
        ReadOptions(extrapolate="cubic")
