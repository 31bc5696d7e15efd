"""Designs of fingers: ranges, one at a time, Latin hypercubes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fembridge.errors import UsageError
from fembridge.sweep.design import Range, hypercube_shares, latin_hypercube, one_at_a_time, range_of


@pytest.mark.parametrize("samples", [2, 7, 50, 201])
@pytest.mark.parametrize("parameters", [1, 3])
def test_each_slice_of_each_range_has_one_finger(samples, parameters):
    shares = np.array(hypercube_shares(parameters, samples, seed=3))

    assert shares.shape == (samples, parameters)
    slices = np.sort((shares * samples).astype(int), axis=0)
    np.testing.assert_array_equal(
        slices, np.repeat(np.arange(samples)[:, None], parameters, axis=1)
    )


def test_the_same_seed_draws_the_same_fingers_and_another_one_others():
    ranges = {"a": Range(0, 1), "b": Range(10, 20)}

    assert latin_hypercube(ranges, 9, 1) == latin_hypercube(ranges, 9, 1)
    assert latin_hypercube(ranges, 9, 1) != latin_hypercube(ranges, 9, 2)


def test_drawn_parameters_hardly_go_together():
    """Fifty fingers by chance would have pairs that correlate by 0.3."""
    shares = np.array(hypercube_shares(14, 50, seed=1))

    together = np.corrcoef(shares.T) - np.eye(14)
    assert abs(together).max() < 0.2


@given(
    low=st.floats(0.001, 10),
    times=st.floats(1.001, 100),
    share=st.floats(0, 1),
    logarithmic=st.booleans(),
)
def test_a_value_lies_in_its_range_and_even_steps_are_even(low, times, share, logarithmic):
    span = Range(low, low * times, logarithmic)
    value = span.at(share)

    assert span.low * (1 - 1e-5) <= value <= span.high * (1 + 1e-5)
    middle = (span.low * span.high) ** 0.5 if logarithmic else 0.5 * low * (1 + times)
    assert span.at(0.5) == pytest.approx(middle, rel=1e-5)


@pytest.mark.parametrize(
    ("asked", "low", "high", "logarithmic"),
    [
        ([0.9, 1.3], 0.9, 1.3, False),
        ([-1, 2], -1, 2, False),
        ("20 %", 0.4, 0.6, False),
        ("±20%", 0.4, 0.6, False),
        ("+-12.5 %", 0.4375, 0.5625, False),
        ("factor 2", 0.25, 1.0, True),
    ],
)
def test_a_range_is_two_numbers_or_told_about_the_base(asked, low, high, logarithmic):
    assert range_of(asked, 0.5, "here") == Range(low, high, logarithmic)


@pytest.mark.parametrize(
    ("asked", "base", "problem"),
    [
        ([1.3, 0.9], 1.0, "from 1.3 to 0.9, expected the lower value first"),
        ([1, 1], 1.0, "the lower value first"),
        ([1, 2, 3], 1.0, "expected .from, to., as"),
        ([1, "two"], 1.0, "'two', expected a number"),
        ([0, float("nan")], 1.0, "nan, expected a finite number"),
        ("much", 1.0, "'much', expected .from, to."),
        ("100 %", 1.0, "more than 0 % and below 100 %"),
        ("0 %", 1.0, "more than 0 %"),
        ("factor 1", 1.0, "a factor above 1"),
        ("20 %", 0.0, "'20 %' of 0: expected"),
        ("20 %", None, "'20 %' of nothing"),
        (0.5, 1.0, "0.5, expected"),
    ],
)
def test_what_is_no_range_is_refused_with_its_place(asked, base, problem):
    with pytest.raises(UsageError, match=f"^here: .*{problem}"):
        range_of(asked, base, "here")


def test_one_at_a_time_begins_with_the_base_and_moves_one_parameter_a_finger():
    base = {"a": 1.0, "b": 2.0, "c": 3.0}
    rows = one_at_a_time(base, {"a": Range(0, 2), "b": Range(2.0, 5), "c": Range(1, 4)})

    assert rows[0] == base
    moved = [{k: v for k, v in row.items() if v != base[k]} for row in rows[1:]]
    assert moved == [{"a": 0}, {"a": 2}, {"b": 5}, {"c": 1}, {"c": 4}]
