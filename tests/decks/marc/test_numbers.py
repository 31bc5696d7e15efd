"""How Marc lays out numbers: columns, commas, reals without a letter; read and written."""

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from decks.marc.grammar import (
    Layout,
    Line,
    format_free,
    format_real,
    integers_line,
    parse_real,
    read_list,
    reals_line,
)
from decks.marc.write import _node_lines
from fembridge.errors import DeckError

numbers = st.floats(allow_nan=False, allow_infinity=False)
layouts = st.sampled_from(Layout)
small = st.lists(st.integers(-999, 9999), min_size=1, max_size=16)


def line_of(text, layout=Layout.EXTENDED):
    return Line(7, text, 0, len(text), layout)


# ---- Reals


@given(value=numbers)
def test_a_real_without_the_letter_of_its_exponent_is_that_real(value):
    mantissa, exponent = f"{value:.17e}".split("e")
    assert parse_real(f"{mantissa}{int(exponent):+d}") == value


@pytest.mark.parametrize(
    ("text", "value"),
    [
        *(("1", 1.0), ("1.", 1.0), (".5", 0.5), ("-.5+1", -5.0), ("2.5-10", 2.5e-10)),
        ("10.000000000000000+", 10.0),  # the field cuts its exponent off
    ],
)
def test_reals_may_be_short(text, value):
    assert parse_real(text) == value


@pytest.mark.parametrize(
    "text", ["", "nan", "inf", "1_0", "1.0 2", "e5", "1e999", "1-400+", "0x1", "--1", "1" * 60]
)
def test_other_texts_are_no_reals(text):
    with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
        parse_real(text)


@given(numbers)
def test_a_real_is_written_in_twenty_columns_with_fourteen_digits_or_more(number):
    text = format_real(number)
    assert len(text) == 20
    assert not set(text) - set(" -+.0123456789")
    assert math.isclose(parse_real(text.strip()), number, rel_tol=1e-13, abs_tol=0)
    assert parse_real(format_free(number)) == number


# Copied from columns of the samples, but for the last two; the numbers are those of
# their meaning.
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
    -1.5e-100: "-1.5000000000000-100",
}


@pytest.mark.parametrize("number", MENTAT)
def test_reals_are_written_as_mentat_does(number):
    assert format_real(number) == MENTAT[number]
    assert format_real(-0.0) == MENTAT[0.0]


@pytest.mark.parametrize("name", ["pfl_example_model_0", "nour_plastic"])
def test_mentats_coordinates_come_out_of_our_writer_but_for_a_last_digit(sample, name):
    """Mentat rounds the sixteenth digit of a few numbers another way."""
    deck = sample(name)
    _, *rows = deck.one("coordinates").rows
    same = 0
    for row, (number, (x, y, z)) in zip(rows, deck.nodes.items(), strict=True):
        assert z == 0
        (line,) = _node_lines(np.array([[x, y]]), number)
        same += line == row
        for start in (10, 30):
            ours, theirs = line[start : start + 20], row[start : start + 20]
            assert ours[:17] + ours[18:] == theirs[:17] + theirs[18:]
    assert same > 0.85 * len(rows)


# ---- Fields of a line


@given(layout=layouts, values=small, free=st.booleans())
def test_integers_are_in_columns_or_between_commas(layout, values, free):
    assert line_of(integers_line(values, layout, free=free), layout).integers() == values


@given(layout=layouts, values=st.lists(st.floats(-1e9, 1e9), min_size=1, max_size=8))
def test_reals_that_touch_are_separated_by_their_columns(layout, values):
    rtol = 1e-13 if layout is Layout.EXTENDED else 0
    found = line_of(reals_line(values, layout), layout).reals()
    np.testing.assert_allclose(found, values, rtol=rtol, atol=0)


def test_blank_fields_are_zero():
    text = " " * 10 + f"{5:10d}" + " " * 10 + f"{7:10d}"
    assert line_of(text).integers() == [0, 5, 0, 7]
    assert line_of("2,1,,,2").integers() == [2, 1, 0, 0, 2]
    assert line_of(f"{3:10d}").fields("irr") == [3, 0.0, 0.0]


def test_a_field_that_is_no_number_is_named_with_line_and_place():
    with pytest.raises(DeckError, match="line 7: field 2 is 'x'"):
        line_of(f"{1:10d}{'x':>10}").integers()
    with pytest.raises(DeckError, match="line 7: field 1 is 'a'"):
        line_of("a,").reals()


@given(layout=layouts, values=small, free=st.booleans(), data=st.data())
def test_one_integer_of_a_line_is_replaced_and_no_other(layout, values, free, data):
    row = data.draw(st.integers(0, len(values) - 1))
    text = line_of(integers_line(values, layout, free=free), layout).with_integer(row, 501)
    assert line_of(text, layout).integers() == [*values[:row], 501, *values[row + 1 :]]


def test_an_integer_with_more_digits_than_columns_is_refused():
    with pytest.raises(DeckError, match=r"line 7: 123456 .* field 1"):
        line_of(f"{1:5d}", Layout.FIXED).with_integer(0, 123456)


# ---- Lists


def list_of(*texts, **options):
    return read_list([Line(n, text) for n, text in enumerate(texts, start=1)], **options)


@given(start=st.integers(1, 50), stop=st.integers(1, 50), step=st.integers(1, 9))
def test_spans_go_up_and_down(start, stop, step):
    way = 1 if stop >= start else -1
    expected = list(range(start, stop + way, way * step))
    assert list_of(f"{start} to {stop} by {step}") == expected


def test_lists_go_on_with_and_and_over_the_end_of_a_line_and_sides_are_pairs():
    assert list_of("1:0 to 3:0 7:2", paired=True) == [(1, 0), (2, 0), (3, 0), (7, 2)]
    assert list_of("1 to 5 by 2 and c", "9 AND 12") == [1, 3, 5, 9, 12]
    assert list_of("1 to c", "4 by c", "2 7") == [1, 3, 7]
    with pytest.raises(DeckError, match=r"line 2: .*'x'"):
        list_of("1 to c", "x 7")


@pytest.mark.parametrize(
    ("text", "paired", "found"),
    [
        ("1 to", False, "'to'"),
        ("1 to 5 by", False, "'by'"),
        ("1 tp 3", False, "'tp'"),
        ("1:0", False, "'1:0'"),
        ("1 to 999999999", False, "20000000"),
        ("1:0 to 3:1", True, "side"),
    ],
)
def test_what_is_no_list_is_refused_with_its_line(text, paired, found):
    with pytest.raises(DeckError, match=f"line 2: .*{found}"):
        list_of("", text, paired=paired)
