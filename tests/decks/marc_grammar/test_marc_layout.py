"""How Marc lays out numbers: columns, commas, reals without a letter."""

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from decks.marc_grammar.layout import (
    Layout,
    cut,
    fields,
    integer,
    integers,
    node_fields,
    only_integers,
    real,
    reals,
    with_integer,
)
from decks.marc_grammar.line import Line, split_lines
from fembridge.errors import DeckError

numbers = st.floats(allow_nan=False, allow_infinity=False)
layouts = st.sampled_from(Layout)
small = st.lists(st.integers(-999, 9999), min_size=1, max_size=16)


def line_of(text):
    return Line(7, text, 0, len(text))


def without_letter(value, digits=15):
    mantissa, exponent = f"{value:.{digits}e}".split("e")
    return f"{mantissa}{int(exponent):+d}"


@given(value=numbers)
def test_a_real_without_the_letter_of_its_exponent_is_that_real(value):
    assert real(without_letter(value, 17)) == value


@given(value=numbers, letter=st.sampled_from("eEdD"))
def test_every_letter_of_an_exponent_is_read(value, letter):
    assert real(repr(value).replace("e", letter)) == value


@pytest.mark.parametrize(
    ("text", "value"), [("1", 1.0), ("1.", 1.0), (".5", 0.5), ("-.5+1", -5.0), ("2.5-10", 2.5e-10)]
)
def test_reals_may_be_short(text, value):
    assert real(text) == value


def test_an_exponent_that_its_field_cuts_off_is_zero():
    assert real("10.000000000000000+") == 10.0


@pytest.mark.parametrize(
    "text", ["", "nan", "inf", "1_0", "1.0 2", "e5", "1e999", "0x1", "--1", "1" * 60]
)
def test_other_texts_are_no_reals(text):
    with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
        real(text)


@pytest.mark.parametrize("text", ["", "1.", "1_0", "a", "1 2", "9" * 60])
def test_other_texts_are_no_integers(text):
    with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
        integer(text)


@given(layout=layouts, values=small)
def test_integers_stand_in_columns_or_between_commas(layout, values):
    columns = "".join(f"{value:{layout.integer}d}" for value in values)
    assert integers(line_of(columns), layout) == values
    assert integers(line_of(", ".join(map(str, values)) + ","), layout) == values


@given(values=st.lists(st.floats(-1e9, 1e9), min_size=1, max_size=8))
def test_reals_that_touch_are_told_apart_by_their_columns(values):
    text = "".join(without_letter(value, 13).rjust(20) for value in values)
    found = reals(line_of(text), Layout.EXTENDED)
    assert found == [float(f"{value:.13e}") for value in values]


@given(number=st.integers(1, 10**9), place=st.lists(st.floats(-1e9, 1e9), min_size=3, max_size=3))
def test_the_short_way_to_read_a_node_is_the_long_way(number, place):
    text = f"{number:10d}" + "".join(without_letter(x, 15)[:20].rjust(20) for x in place)
    line = line_of(text)
    short = node_fields(line, Layout.EXTENDED, 3)
    first, *rest = fields(line, Layout.EXTENDED, "irrr")
    assert short == (first, rest)


def test_blank_fields_are_zero():
    text = " " * 10 + f"{5:10d}" + " " * 10 + f"{7:10d}"
    assert integers(line_of(text), Layout.EXTENDED) == [0, 5, 0, 7]
    assert integers(line_of("2,1,,,2"), Layout.EXTENDED) == [2, 1, 0, 0, 2]
    assert node_fields(line_of(f"{3:10d}"), Layout.EXTENDED, 2) == (3, [0.0, 0.0])


def test_the_rest_of_a_line_is_a_name_commas_and_all():
    text = f"{1:10d}{0:10d}probe tip"
    assert cut(text, Layout.EXTENDED, "iit") == ["1", "0", "probe tip"]
    assert cut("1, 0, probe, tip", Layout.EXTENDED, "iit") == ["1", "0", "probe,tip"]


def test_a_field_that_is_no_number_is_named_with_line_and_place():
    with pytest.raises(DeckError, match="line 7: field 2 is 'x', expected an integer"):
        integers(line_of(f"{1:10d}{'x':>10}"), Layout.EXTENDED)
    with pytest.raises(DeckError, match="line 7: field 1 is 'a', expected a real"):
        reals(line_of("a,"), Layout.EXTENDED)


def test_lines_of_integers_alone_are_counted():
    assert only_integers(f"{1:10d}{2:10d}", Layout.EXTENDED) == 2
    assert only_integers("1,", Layout.FIXED) == 1
    assert only_integers(f"{1:10d} 1.000", Layout.EXTENDED) == 0
    assert only_integers("   ", Layout.EXTENDED) == 0


@given(layout=layouts, values=small, free=st.booleans(), data=st.data())
def test_one_integer_of_a_line_is_replaced_and_no_other(layout, values, free, data):
    joined = (
        ", ".join(map(str, values)) + ","
        if free
        else "".join(f"{value:{layout.integer}d}" for value in values)
    )
    row = data.draw(st.integers(0, len(values) - 1))
    text = with_integer(joined, layout, row, 501)
    assert integers(line_of(text), layout) == [*values[:row], 501, *values[row + 1 :]]


def test_an_integer_with_more_digits_than_columns_is_refused():
    with pytest.raises(ValueError, match="123456"):
        with_integer(f"{1:5d}", Layout.FIXED, 0, 123456)


@given(data=st.binary(max_size=200))
def test_lines_cover_all_bytes(data):
    lines = split_lines(data, None)
    assert b"".join(data[line.start : line.stop] for line in lines) == data
    assert [line.number for line in lines] == list(range(1, len(lines) + 1))
    ends = {data[line.start + len(line.text) : line.stop] for line in lines}
    assert ends <= {b"\n", b"\r\n", b"", b"\r"}


def test_infinity_is_never_read():
    assert all(math.isfinite(real(text)) for text in ("1.7e308", "1-400"))
