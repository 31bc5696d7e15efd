"""Numbers of a deck: none is cut."""

from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from decks.keyword_deck import LONGEST_NUMBER, fixed, real


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
