"""Marc decks are cut into options without losing a byte; numbers as Marc lays them out."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from decks.marc.contents import read_marc_deck
from decks.marc.grammar import (
    FileSection,
    Layout,
    Line,
    format_free,
    format_real,
    integers_line,
    is_marc_deck,
    parse_real,
    read_list,
    reals_line,
)
from fembridge.errors import DeckError

SAMPLES = Path(__file__).parents[3] / "fixtures" / "marc_samples"
ANY_SAMPLE = pytest.mark.parametrize(
    "path", sorted(SAMPLES.glob("*.dat")), ids=lambda path: path.stem
)
SMALL = (SAMPLES / "nour_linear.dat").read_bytes()
CASE = SMALL.index(b"end option")


def joined(deck, data):
    return b"".join(data[option.lines[0].start : option.lines[-1].stop] for option in deck.options)


def keywords(data, section=None):
    deck = read_marc_deck(data)
    return [o.keyword for o in deck.options if section in (None, o.section)]


def with_model(*lines):
    """The small deck with lines before its end option."""
    text = "\n".join(lines) + "\n"
    return SMALL[:CASE] + text.encode() + SMALL[CASE:]


@ANY_SAMPLE
def test_every_byte_of_a_deck_belongs_to_one_option(path):
    data = path.read_bytes()
    deck = read_marc_deck(data)
    assert joined(deck, data) == data
    lines = [line.number for option in deck.options for line in option.lines]
    assert lines == list(range(1, data.count(b"\n") + 1))


@ANY_SAMPLE
def test_unix_and_windows_line_ends_read_alike(path):
    unix = path.read_bytes().replace(b"\r\n", b"\n")
    windows = unix.replace(b"\n", b"\r\n")
    assert joined(read_marc_deck(windows), windows) == windows
    assert keywords(unix) == keywords(windows)


LINES_TO_END_OPTION = SMALL[:CASE].count(b"\n") + 1
WITHOUT_LOAD_CASES = {LINES_TO_END_OPTION, LINES_TO_END_OPTION + 1}


@given(place=st.integers(1, SMALL.index(b"continue") + 6))
def test_a_deck_cut_at_any_byte_is_refused(place):
    assume(SMALL[:place].count(b"\n") + 1 not in WITHOUT_LOAD_CASES)
    assume(SMALL[:place].count(b"\n") not in WITHOUT_LOAD_CASES)
    with pytest.raises(DeckError):
        read_marc_deck(SMALL[:place])


def test_a_cut_deck_names_the_option_it_ends_in():
    lines = SMALL.splitlines(keepends=True)
    start = next(n for n, line in enumerate(lines, 1) if line.startswith(b"post"))
    with pytest.raises(DeckError) as caught:
        read_marc_deck(b"".join(lines[: start + 1]))
    assert str(caught.value).startswith(f"line {start + 1}: ")
    assert "`post`" in str(caught.value)
    assert "`end option`" in str(caught.value)


@given(data=st.data())
def test_mutated_decks_are_refused_or_read_whole(data):
    text = bytearray(SMALL)
    for _ in range(data.draw(st.integers(1, 5))):
        place = data.draw(st.integers(0, len(text) - 1))
        stop = place + data.draw(st.integers(0, 30))
        text[place:stop] = data.draw(st.binary(max_size=3))
    try:
        deck = read_marc_deck(bytes(text))
    except DeckError:
        return
    assert joined(deck, bytes(text)) == bytes(text)


@pytest.mark.parametrize(
    "data",
    [
        *(b"", b"\n\n", b"\x00\x01", b"   THE FOLLOWING TABLE\n", b"*NODE\n1, 0., 0.\n"),
        *(b"hello\nworld\n", b"title\nsizing\n", b"one\ntwo\nend\n"),
    ],
)
def test_what_is_no_marc_deck_is_refused(data):
    with pytest.raises(DeckError):
        read_marc_deck(data)


@pytest.mark.parametrize(
    ("name", "text", "is_deck"),
    [
        ("a.DAT", "$ a comment\n\nTITLE,mine\r\n", True),
        ("a.txt", "title\n", False),
        ("a.dat", " displacements (vx,vy,vz) for set ALL\n", False),
        ("a.dat", "", False),
    ],
)
def test_a_first_look_separates_decks_from_other_files(tmp_path, name, text, is_deck):
    path = tmp_path / name
    path.write_text(text)
    assert is_marc_deck(path) is is_deck
    assert not is_marc_deck(tmp_path / "absent.dat")


@pytest.mark.parametrize("name", ["control", "post", "table", "contact", "end option"])
def test_a_condition_may_be_called_like_a_keyword(name):
    lines = [
        *("define              node                set                 " + name, "1 to 3"),
        *("fixed disp", "", f"{1:10d}{0:10d}{0:10d}{0:10d}{1:10d}{0:10d}{name}"),
        *("1.0,", "0,", "1,", f"{2:10d}", name, "loadcase            job1"),
        *(f"{1:10d}", name),
    ]
    deck = read_marc_deck(with_model(*lines))
    assert deck.conditions()[-1].set_name == name
    (_, mine) = deck.find("loadcase", FileSection.MODEL)
    assert [line.text for line in mine.data] == [f"{1:10d}", name]


def test_an_included_file_is_refused_and_a_deck_of_several_domains_has_no_load_case():
    data = with_model("include, 'more.inc'")
    line = data.decode().splitlines().index("include, 'more.inc'") + 1
    with pytest.raises(DeckError, match=f"line {line}: an included file"):
        read_marc_deck(data)
    root = b"title\nextended\nsizing" + b" " * 24 + b"0         0\nend\n"
    assert read_marc_deck(root).load_cases() == []


# ---- Numbers: columns, commas, reals without a letter; read and written

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


def test_a_field_that_is_no_number_or_too_narrow_is_named_with_line_and_place():
    with pytest.raises(DeckError, match="line 7: field 2 is 'x'"):
        line_of(f"{1:10d}{'x':>10}").integers()
    with pytest.raises(DeckError, match="line 7: field 1 is 'a'"):
        line_of("a,").reals()
    with pytest.raises(DeckError, match=r"line 7: 123456 .* field 1"):
        line_of(f"{1:5d}", Layout.FIXED).with_integer(0, 123456)


@given(layout=layouts, values=small, free=st.booleans(), data=st.data())
def test_one_integer_of_a_line_is_replaced_and_no_other(layout, values, free, data):
    row = data.draw(st.integers(0, len(values) - 1))
    text = line_of(integers_line(values, layout, free=free), layout).with_integer(row, 501)
    assert line_of(text, layout).integers() == [*values[:row], 501, *values[row + 1 :]]


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
