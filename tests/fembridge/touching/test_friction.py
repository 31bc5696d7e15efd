"""A shape sticks to the skin before it slips: closed forms, and touches that start and turn."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import fembridge as fb
from fembridge.touching.friction import friction_shares, slid_before

SLIP_MM = 0.3


def shares_of(x_mm, z_mm=None, slip_mm=SLIP_MM, touches=True):
    x_mm = np.asarray(x_mm, dtype=float)
    z_mm = np.zeros_like(x_mm) if z_mm is None else np.asarray(z_mm, dtype=float)
    every = np.ones(x_mm.size)
    return friction_shares(x_mm, z_mm, slip_mm * every, np.broadcast_to(touches, x_mm.shape))


def test_resistance_grows_with_the_way_from_a_stop_and_turns_over():
    """1 - exp(-way / slip) from rest, whatever the steps; from 1 to -1 after a turn."""
    rest, way_mm = np.zeros(5), np.cumsum(np.tile([0.01, 0.002, 0.03], 40))
    after_rest = shares_of(np.concatenate([rest, way_mm]))
    assert_allclose(after_rest[5:, 0], 1 - np.exp(-way_mm / SLIP_MM), rtol=1e-12)
    assert not after_rest[:5].any()
    assert not after_rest[:, 1].any()
    there = np.linspace(0, 2, 201)
    turned = shares_of(np.concatenate([there, there[-2::-1]]))[201:, 0]
    assert_allclose(turned, 2 * np.exp(-there[1:] / SLIP_MM) - 1, rtol=1e-9)


def test_a_shape_that_stops_holds_the_skin_and_one_that_lifts_lets_it_go():
    x_mm = np.append(np.linspace(0, 1, 51), np.ones(20))
    assert_allclose(shares_of(x_mm), np.tile([1.0, 0.0], (71, 1)), rtol=1e-12)
    touches = np.arange(71) < 40
    shares = shares_of(x_mm, touches=touches)
    assert_allclose(shares[:40, 0], 1.0)
    assert not shares[40:].any()


def test_at_a_right_angle_the_skin_is_pulled_round_the_corner():
    side = np.linspace(0, 1, 101)
    x_mm, z_mm = np.append(side, np.ones(100)), np.append(np.zeros(101), side[1:])
    shares = shares_of(x_mm, z_mm)
    assert_allclose(shares[101:, 0], np.exp(-side[1:] / SLIP_MM), rtol=1e-9)
    assert_allclose(shares[101:, 1], 1 - np.exp(-side[1:] / SLIP_MM), rtol=1e-9)


@given(
    st.lists(st.tuples(st.floats(-2, 2), st.floats(-2, 2)), min_size=1, max_size=60),
    st.floats(0.0, 3.0),
)
def test_the_resistance_is_never_larger_than_friction(places_mm, slip_mm):
    x_mm, z_mm = np.array(places_mm).T
    assert np.hypot(*shares_of(x_mm, z_mm, slip_mm).T).max() <= 1 + 1e-12


def test_what_slid_before_begins_straight_and_at_full_speed():
    even, still = np.linspace(0, 1, 101), np.zeros(101)
    begins = 0.5 * (1 - np.cos(np.pi * even))
    noise = np.random.default_rng(0).normal(0, 0.001, 101)
    assert slid_before(even, still)
    assert slid_before(even + noise / 100, still)
    assert slid_before(np.append(even, even[::-1]), np.zeros(202), SLIP_MM)
    for x_mm in (still, begins, noise, np.append(still, even), np.zeros(1)):
        assert not slid_before(x_mm, np.zeros(x_mm.size)), x_mm[:3]


TIMES_MS = np.arange(0, 200, 0.5)


def touch_along(x_mm, units):
    path = fb.Trajectory(depth_um=np.full(TIMES_MS.size, 250.0), x_mm=x_mm, z_mm=0 * TIMES_MS)
    return fb.touch("plate", path, population=units, ridges="none")


@pytest.fixture(scope="module")
def units():
    return fb.Population.line(1.0, 3.0, "x", ("RA", "PC"))


def test_a_hand_that_trembles_on_the_skin_does_not_rub_it(units):
    """Half a micrometre of noise in the path: friction once followed its direction."""
    noise_mm = np.random.default_rng(1).normal(0, 0.0005, TIMES_MS.size)
    held, trembling = (touch_along(x_mm, units) for x_mm in (0 * TIMES_MS, noise_mm))
    change_pa = np.abs(trembling.stress_pa - held.stress_pa[:1]).max(axis=0)
    assert (change_pa < 0.03 * held.stress_pa.max()).all()
    assert not trembling.fired.unit.size


def test_a_slide_from_rest_comes_to_that_of_a_steady_slide(units):
    speed_mm_per_ms = 0.04
    from_rest = speed_mm_per_ms * np.maximum(TIMES_MS - 50, 0)
    steady = speed_mm_per_ms * (TIMES_MS - 50)
    started, sliding = (touch_along(x_mm, units).stress_pa for x_mm in (from_rest, steady))
    last = TIMES_MS > 100  # 2 mm, twenty times friction times depth
    assert_allclose(started[last], sliding[last], atol=0.03 * sliding.max())
    # From sample to sample it changes no more than over the first slip length of 0.1 mm.
    step = np.abs(np.diff(started, axis=0)).max()
    assert step < 0.5 * np.abs(started[-1] - started[0]).max()
