"""Thresholds and plateaus of curves drawn by hand and by formula."""

import doctest
import math
from importlib import import_module
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from neural.threshold import Plateau, entrainment_plateau, threshold_amplitude_um

curves = st.lists(
    st.tuples(st.integers(1, 2000), st.integers(0, 60)),
    min_size=1,
    max_size=9,
    unique_by=lambda point: point[0],
)


def plain_rate_ips(amplitude_um, curve):
    """The curve's rate at any amplitude: straight lines over the logarithm."""
    curve = sorted(curve)
    for (low, low_ips), (high, high_ips) in pairwise(curve):
        if low <= amplitude_um <= high:
            share = math.log(amplitude_um / low) / math.log(high / low)
            return low_ips + share * (high_ips - low_ips)
    raise AssertionError(f"{amplitude_um} is outside the curve")


@given(curves, st.integers(1, 60))
def test_a_threshold_is_where_the_curve_first_has_the_criterion(curve, criterion_ips):
    amplitude_um, rate = zip(*curve, strict=True)

    found_um = threshold_amplitude_um(amplitude_um, rate, criterion_ips)

    if max(rate) < criterion_ips:
        assert found_um == math.inf
        return
    below = [a for a, ips in sorted(curve) if a < found_um * (1 - 1e-12)]
    assert all(ips < criterion_ips for a, ips in curve if a in below)
    if below:
        assert plain_rate_ips(found_um, curve) == pytest.approx(criterion_ips, rel=1e-9)
    else:
        assert found_um == min(amplitude_um)
        assert dict(curve)[found_um] >= criterion_ips


def test_an_amplitude_whose_rate_is_the_criterion_is_given_exactly():
    amplitude_um = [6.71, 9.32, 12.5, 18.0]
    for tie in (10.0, 10.0 - 1e-12):
        found_um = threshold_amplitude_um(amplitude_um, [0.0, 3.0, tie, 40.0], criterion_ips=10.0)
        assert found_um == 12.5


def test_a_plateau_reaches_to_where_the_curve_leaves_its_range():
    """45 and 55 ips are 0.9 of the way up and 0.1 of the way on, a decade each."""
    plateau = entrainment_plateau([1.0, 10.0, 100.0, 1000.0], [0.0, 50.0, 50.0, 100.0], 50.0)
    assert plateau.low_um == pytest.approx(10.0**0.9, rel=1e-14)
    assert plateau.high_um == pytest.approx(10.0**2.1, rel=1e-14)
    assert plateau.decades == pytest.approx(1.2, rel=1e-13)


def test_of_two_plateaus_the_wider_is_given():
    amplitude_um = [1.0, 2.0, 4.0, 8.0, 80.0, 160.0]
    rate = [50.0, 50.0, 0.0, 50.0, 50.0, 0.0]
    plateau = entrainment_plateau(amplitude_um, rate, 50.0)
    assert plateau.low_um == pytest.approx(4.0 * 2.0**0.9, rel=1e-14)
    assert plateau.high_um == pytest.approx(80.0 * 2.0**0.1, rel=1e-14)


def test_the_edges_of_the_range_belong_to_it():
    """0.9 · 50 and 1.1 · 50 are 45 and 55.000000000000007: rounding has no say."""
    plateau = entrainment_plateau([1.0, 2.0, 4.0, 8.0], [0.0, 45.0, 55.0, 100.0], 50.0)
    assert (plateau.low_um, plateau.high_um) == pytest.approx((2.0, 4.0), rel=1e-12)
    assert entrainment_plateau([2.0, 4.0], [44.9, 55.1], 50.0) is None
    narrow = entrainment_plateau(
        [1.0, 2.0, 4.0], [0.0, 50.0, 55.0], 50.0, impulses_per_cycle=(1.0, 1.0)
    )
    assert narrow == Plateau(2.0, 2.0)


@given(curves)
def test_within_a_plateau_the_curve_stays_in_its_range(curve):
    plateau = entrainment_plateau(*zip(*curve, strict=True), 30.0)

    if plateau is None:
        assert not any(27 <= ips <= 33 for _, ips in curve)
        return
    assume(plateau.high_um > plateau.low_um)
    inside_um = np.geomspace(plateau.low_um, plateau.high_um, 21)[1:-1]
    within = [plain_rate_ips(amplitude_um, curve) for amplitude_um in inside_um]
    assert min(within) >= 27.0 - 1e-6
    assert max(within) <= 33.0 + 1e-6
    for edge_um in (plateau.low_um, plateau.high_um):
        if edge_um not in (min(curve)[0], max(curve)[0]):
            edge_ips = plain_rate_ips(edge_um, curve)
            assert min(abs(edge_ips - 27), abs(edge_ips - 33)) < 1e-6


EXAMPLES = ["agreement", "encoder", "parameters", "parameter_sets", "rates", "threshold", "timing"]


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_examples_of_the_docstrings_are_true(name):
    outcome = doctest.testmod(import_module(f"neural.{name}"))
    assert outcome.attempted > 0
    assert outcome.failed == 0
