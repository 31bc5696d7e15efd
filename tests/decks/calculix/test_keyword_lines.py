"""Lines of a deck: no number is cut, no text becomes a card, no line is too long."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from decks.keyword_deck import (
    LONGEST_NUMBER,
    element_lines,
    fixed,
    list_lines,
    node_lines,
    pair_lines,
    plain,
    real,
)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_number_keeps_twelve_digits_in_twenty_characters(number):
    text = real(number)
    assert len(text) <= LONGEST_NUMBER
    assert_allclose(float(text), number, rtol=1e-12)


@given(st.floats(0, 1e6), st.integers(3, 9))
def test_a_number_of_fixed_decimals_gets_more_where_it_needs_them(number, digits):
    text = fixed(number, digits)
    assert len(text) <= LONGEST_NUMBER
    assert_allclose(float(text), number, rtol=1.1e-12)


def test_short_numbers_are_written_shortly():
    assert [real(x) for x in (200.0, 50, 1e-3, 0.1 * 3)] == [
        "200.0",
        "50.0",
        "0.001",
        "0.30000000000000004",
    ]
    assert [fixed(0.0005, 7), fixed(0.25, 7), fixed(0.0, 7)] == [
        "0.0005000",
        "0.2500000",
        "0.0000000",
    ]


@given(st.text())
def test_any_text_becomes_one_line_of_printable_ascii(text):
    line = plain(text)
    assert line.isascii()
    assert line.isprintable()


def test_lists_break_after_twelve_and_pairs_after_four():
    first, second = list_lines(range(1, 14))
    assert (first, second) == ("1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12,", "13,")
    assert list(pair_lines([(str(k), "0") for k in range(5)])) == ["0, 0, 1, 0, 2, 0, 3, 0", "4, 0"]


def test_nodes_are_numbered_and_flat_and_zero_has_no_sign():
    assert list(node_lines([7, 8], np.array([[-0.0, 1.5], [2, -3]]))) == [
        "7, 0.000000000, 1.500000000, 0.0",
        "8, 2.000000000, -3.000000000, 0.0",
    ]


def test_elements_and_their_numbers_belong_together():
    assert list(element_lines([4, 9], np.array([[1, 2], [3, 4]]))) == ["4, 1, 2", "9, 3, 4"]
    with pytest.raises(ValueError, match="zip"):
        list(element_lines([4], np.array([[1, 2], [3, 4]])))
