"""The probe: its shape, and that it stands on the skin without pressing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from decks.mesh import scaled_jacobian
from decks.presets import QUICK, mesh_of
from decks.probe import SHAPES, Probe, mesh_probe
from fembridge.errors import FingerError

SKIN = mesh_of(QUICK)
PROBES = {
    "cylinder": Probe(),
    "50 um": Probe(diameter_mm=0.05),
    "5 mm": Probe(diameter_mm=5.0),
    "flat": Probe("flat", 1.0, 0.1),
    "flat and sharp": Probe("flat", 1.0, 0.0),
    "flat and round": Probe("flat", 1.0, 0.5),
    "flat and narrow": Probe("flat", 0.05, 0.01),
    "left": Probe(x_mm=-2.3),
    "groove": Probe(x_mm=0.25, diameter_mm=0.3),
    "flat aside": Probe("flat", 2.0, 0.2, x_mm=3.0),
}


@pytest.fixture(params=PROBES)
def probe(request):
    return PROBES[request.param]


PIECES = [
    piece[np.argsort(piece[:, 0])]
    for piece in SKIN.node_mm[SKIN.outline()[0]]
    if piece[:, 1].min() > -6.5
]


def least_gap_mm(probe_mm):
    """Smallest vertical way between two polylines, both ends of every piece tried."""
    gaps = [np.inf]
    for left, right in PIECES:
        low, high = max(left[0], probe_mm[0, 0]), min(right[0], probe_mm[-1, 0])
        if low > high:
            continue
        within = probe_mm[(probe_mm[:, 0] >= low) & (probe_mm[:, 0] <= high), 0]
        x_mm = np.array([low, *within, high])
        skin_mm = left[1] + (right[1] - left[1]) * (x_mm - left[0]) / (right[0] - left[0])
        gaps.append((np.interp(x_mm, *probe_mm.T) - skin_mm).min())
    return min(gaps)


def test_a_cylinder_is_round_to_the_chord_of_its_segments():
    x, y = Probe().lower_side().T
    assert_allclose(np.hypot(x, y - 0.5), 0.5, atol=1e-9)
    assert_array_equal(x, -x[::-1])
    assert (x[len(x) // 2], y[len(x) // 2]) == (0.0, 0.0)
    assert np.hypot(*np.diff([x, y])).max() < 0.025


def test_a_flat_punch_is_flat_between_its_fillets():
    x, y = Probe("flat", 1.0, 0.1).lower_side().T
    assert (y[np.abs(x) < 0.4] == 0).all()
    assert_allclose(np.abs(x).max(), 0.5)
    corner = np.abs(x) > 0.4
    away_mm = np.hypot(np.abs(x[corner]) - 0.4, y[corner] - 0.1)
    assert_allclose(away_mm, 0.1, atol=1e-9)


def test_every_quad_of_a_probe_runs_counter_clockwise_and_is_sound(probe):
    mesh, _ = mesh_probe(probe, SKIN)
    assert scaled_jacobian(mesh.node_mm, mesh.quad).min() > 0.1
    assert_array_equal(np.unique(mesh.quad), np.arange(len(mesh.node_mm)))


@given(st.floats(-5.0, 5.0), st.floats(0.02, 3.0), st.sampled_from(SHAPES))
def test_a_probe_of_any_size_and_place_touches_exactly(x_mm, diameter_mm, shape):
    probe = Probe(shape, diameter_mm, 0.25 * diameter_mm, x_mm)
    mesh, _ = mesh_probe(probe, SKIN)
    assert abs(least_gap_mm(mesh.node_mm[mesh.lower_node])) <= 1.1e-9


@pytest.mark.parametrize(
    "probe", [*(Probe(x_mm=x) for x in (-7.9, 7.7, 30.0, 1e9)), Probe(diameter_mm=18.0)]
)
def test_a_probe_beside_or_wider_than_the_pad_is_refused(probe):
    with pytest.raises(FingerError, match=r"-7\.98483 to 7\.98483 mm"):
        mesh_probe(probe, SKIN)


@pytest.mark.parametrize(
    ("fields", "argument", "found"),
    [
        ({"shape": "cone"}, "shape", "cone"),
        ({"diameter_mm": 0.0}, "diameter_mm", 0.0),
        ({"diameter_mm": 21}, "diameter_mm", 21),
        ({"diameter_mm": np.inf}, "diameter_mm", np.inf),
        ({"fillet_mm": -0.1}, "fillet_mm", -0.1),
        ({"shape": "flat", "fillet_mm": 0.51}, "fillet_mm", 0.51),
        ({"shape": "flat", "fillet_mm": 1e-9}, "fillet_mm", 1e-9),
        ({"x_mm": np.inf}, "x_mm", np.inf),
    ],
)
def test_a_probe_that_cannot_be_is_refused(fields, argument, found):
    with pytest.raises(FingerError) as caught:
        Probe(**fields)
    assert (caught.value.argument, caught.value.found) == (argument, found)


@pytest.mark.parametrize(("diameter_mm", "fillet_mm"), [(2.0, 0.1), (0.4, 0.1), (0.1, 0.025)])
def test_a_narrow_punch_has_a_fillet_that_fits(diameter_mm, fillet_mm):
    assert Probe("flat", diameter_mm).fillet_mm == fillet_mm
    assert Probe("flat", diameter_mm, 0.05 * diameter_mm).fillet_mm == 0.05 * diameter_mm


# ---- The node it touches first


def test_the_first_node_touched_is_nearer_the_probe_than_any_other(probe):
    mesh, row = mesh_probe(probe, SKIN)
    lower_mm = mesh.node_mm[mesh.lower_node]
    nodes = np.unique(SKIN.outline()[0])
    under = nodes[
        (SKIN.node_mm[nodes, 0] >= lower_mm[0, 0])
        & (SKIN.node_mm[nodes, 0] <= lower_mm[-1, 0])
        & (SKIN.node_mm[nodes, 1] > -6.5)
    ]
    gap_mm = np.interp(SKIN.node_mm[under, 0], *lower_mm.T) - SKIN.node_mm[under, 1]
    if under.size:
        assert row in under[gap_mm < gap_mm.min() + 1e-6]
