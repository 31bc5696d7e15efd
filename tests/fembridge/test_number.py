"""A number in a text is finite and in ASCII digits; the rest is damage."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fembridge.io.number import parse_number, parse_whole_number


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_every_finite_number_comes_back(value):
    assert parse_number(repr(value)) == value
    assert parse_number(f" {value:e} ") == float(f"{value:e}")


@given(st.integers(-(10**30), 10**30))
def test_every_whole_number_comes_back(value):
    assert parse_whole_number(str(value)) == value


@pytest.mark.parametrize(
    "text", ["", "1_000", "nan", "-inf", "Infinity", "1e999", "١٢", "１", "1,5"]
)
def test_other_words_are_no_numbers(text):
    with pytest.raises(ValueError, match=r"."):
        parse_number(text)
    with pytest.raises(ValueError, match=r"."):
        parse_whole_number(text)


@given(st.text(max_size=6))
def test_what_is_accepted_is_finite(text):
    try:
        value = parse_number(text)
    except ValueError:
        return
    assert math.isfinite(value)
