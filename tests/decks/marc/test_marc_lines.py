"""Lines of a Marc deck: columns that Mentat writes, and nothing that overflows them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from decks.marc.lines import (
    comment,
    element_lines,
    integers,
    list_lines,
    named,
    node_lines,
    option,
    real,
    reals,
    zeros,
)
from fembridge.errors import DeckError


def value_of(text):
    """Put the letter back that Marc leaves out, then read as Python does."""
    mantissa, sign = text[:18].rstrip("+-0123456789"), None
    for at in range(len(text) - 1, 0, -1):
        if text[at] in "+-":
            mantissa, sign = text[:at], at
            break
    return float(f"{mantissa}E{text[sign:]}")


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_real_fills_twenty_columns_and_keeps_fourteen_digits_or_more(number):
    text = real(number)
    assert len(text) == 20
    assert "E" not in text
    assert text[0] in " -"
    assert math.isclose(value_of(text), number, rel_tol=1e-13, abs_tol=0)


@given(st.floats(1e-9, 9.99e9))
def test_a_real_of_one_exponent_digit_keeps_sixteen_digits(number):
    assert math.isclose(value_of(real(number)), number, rel_tol=5.1e-16)


# Copied from columns of the samples; the numbers are those of their meaning.
MENTAT = {
    0.0: " 0.000000000000000+0",
    1.0: " 1.000000000000000+0",
    -0.5: "-5.000000000000000-1",
    20.0: " 2.000000000000000+1",
    0.0005: " 5.000000000000000-4",
    1e30: " 1.00000000000000+30",
    1e20: " 1.00000000000000+20",
    8.854187817e-12: " 8.85418781700000-12",
    6.93889390390723e-18: " 6.93889390390723-18",
    1.256637061e-6: " 1.256637061000000-6",
}


@pytest.mark.parametrize("number", MENTAT)
def test_reals_are_written_as_mentat_does(number):
    assert real(number) == MENTAT[number]


def test_minus_zero_has_no_sign():
    assert real(-0.0) == real(0.0)


def test_an_exponent_of_three_digits_takes_two_decimals():
    assert real(-1.5e-100) == "-1.5000000000000-100"


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
def test_a_number_that_is_not_finite_is_refused(number):
    with pytest.raises(DeckError, match="expected a finite one"):
        real(number)


@given(st.lists(st.integers(-999_999_999, 9_999_999_999), max_size=16))
def test_whole_numbers_have_ten_columns_each(numbers):
    line = integers(numbers)
    fields = [line[k : k + 10] for k in range(0, len(line), 10)]
    assert [int(field) for field in fields] == numbers


def test_a_whole_number_that_would_run_into_its_neighbour_is_refused():
    with pytest.raises(DeckError, match="10000000000 is wider than 10 columns"):
        integers([1, 10_000_000_000])


def test_keywords_have_twenty_columns_and_their_numbers_ten():
    assert option("alloc", 25) == "alloc                       25"
    assert option("optimize") == "optimize"
    assert named("define", "node", "set", "tip") == (
        "define              node                set                 tip"
    )


def test_zeros_but_for_fields_counted_from_one():
    assert zeros(4, f1=2.0, f3=0.4) == [2.0, 0.0, 0.4, 0.0]
    assert reals(zeros(2, f2=1.0)) == real(0.0) + real(1.0)


@given(st.text(), st.text())
def test_any_comment_is_short_printable_ascii_and_a_comment(text, more):
    words = f"{text} {more}"
    for line in comment(words):
        assert line.isascii()
        assert line.isprintable()
        assert line.startswith("$....")
        longest = max([len(word) for word in line[5:].split(" ")])
        assert len(line) <= max(80, 5 + longest)


def test_a_long_comment_goes_on_in_the_next_line_and_loses_no_word():
    words = " ".join(f"word{k}" for k in range(60))
    lines = list(comment(words))
    assert len(lines) > 4
    assert " ".join(line[5:] for line in lines) == words


@given(st.lists(st.integers(1, 10**9), min_size=1, max_size=60))
def test_a_list_has_thirteen_items_a_line_and_says_where_it_goes_on(numbers):
    *most, last = list_lines(numbers)
    assert all(len(line) == 160 and line.endswith("   c") for line in most)
    flat = "".join(line[:-4] for line in most) + last
    assert [int(flat[k : k + 12]) for k in range(0, len(flat), 12)] == numbers


# ---- The same bytes as Mentat, out of the numbers of its own decks


@pytest.mark.parametrize("name", ["pfl_example_model_0", "nour_plastic"])
def test_mentats_coordinates_come_out_of_our_writer_but_for_a_last_digit(sample, name):
    """Mentat rounds the sixteenth digit of a few numbers another way."""
    deck = sample(name)
    _, *rows = deck.one("coordinates").rows
    same = 0
    for row, (number, (x, y, z)) in zip(rows, deck.nodes().items(), strict=True):
        assert z == 0
        (line,) = node_lines(np.array([[x, y]]), first=number)
        same += line == row
        for start in (10, 30):
            ours, theirs = line[start : start + 20], row[start : start + 20]
            assert ours[:17] + ours[18:] == theirs[:17] + theirs[18:]
    assert same > 0.85 * len(rows)


@pytest.mark.parametrize("name", ["pfl_example_model_0", "nour_plastic"])
def test_mentats_elements_come_out_of_our_writer_as_they_were(sample, name):
    deck = sample(name)
    rows = [row for block in deck.all("connectivity") for row in block.rows[1:]]
    for row, (number, (kind, *nodes)) in zip(rows, deck.elements().items(), strict=True):
        assert list(element_lines([number], kind, np.array([nodes]))) == [row]


def test_mentats_set_comes_out_of_our_writer_as_it_was(sample):
    deck = sample("nour_plastic")
    numbers = deck.members("node", "fixed_nodes")
    option_ = deck.one("define", f"{'node':<20}{'set':<20}fixed_nodes")
    assert list(list_lines(numbers)) == option_.rows
    assert named("define", "node", "set", "fixed_nodes") == option_.line


def test_elements_and_their_numbers_belong_together():
    with pytest.raises(ValueError, match="zip"):
        list(element_lines([4], 11, np.array([[1, 2], [3, 4]])))
