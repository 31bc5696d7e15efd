"""The bytes of a keyword deck: nothing is lost, and cards are where they stand."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from decks.own_model.inp_text import read_inp_text


def card_of(data, keyword, abaqus=False):
    text = read_inp_text(data, abaqus=abaqus)
    (card,) = (card for card in text.cards if card.keyword == keyword)
    return text, card


def rows_of(text, card):
    line = card.line + text.data.count(b"\n", card.start, card.body)
    return list(text.rows(card.body, card.stop, line))


lines = st.one_of(
    st.binary(max_size=12),
    st.sampled_from(
        [
            b"*STEP",
            b" *Step , inc = 7 ,",
            b"** comment",
            b"* * comment",
            b"*HEADING",
            b"1, 2, 3,",
            b'*NSET, NSET="a,b"',
            b"\t*\tnode file,",
            b"x=1",
            b"*",
            b"",
        ]
    ),
)
ends = st.sampled_from([b"\n", b"\r\n", b"\n\n"])
decks = st.lists(st.tuples(lines, ends), max_size=12).map(
    lambda pairs: b"".join(line + end for line, end in pairs)
)


@given(data=st.one_of(decks, st.binary(max_size=200)), abaqus=st.booleans())
def test_cards_one_after_another_are_the_deck(data, abaqus):
    text = read_inp_text(data, abaqus=abaqus)
    before = text.cards[0].start if text.cards else len(data)
    pieces = [data[card.start : card.stop] for card in text.cards]
    assert data[:before] + b"".join(pieces) == data
    for card in text.cards:
        assert card.start < card.head <= card.body <= card.stop
        assert card.line == data[: card.start].count(b"\n") + 1
        assert data[card.start : card.head].lstrip(b" \t").startswith(b"*")
        for row in rows_of(text, card):
            assert card.body <= row.start < row.stop <= card.stop
            assert row.line == data[: row.start].count(b"\n") + 1
        for option in card.options:
            assert card.start < option.start < option.stop <= card.head


@given(data=decks)
def test_data_lines_are_those_that_are_neither_keyword_nor_comment_nor_blank(data):
    """Beside a plain loop over lines, for a deck without heading or continuation."""
    data = data.replace(b"HEADING", b"NSET").replace(b"=", b"-")
    text = read_inp_text(data)
    told = []
    for number, line in enumerate(data.split(b"\n"), start=1):
        packed = re.sub(rb"[ \t]", b"", line.partition(b"\r")[0])
        if packed.strip(b"\0") and not packed.startswith(b"*"):
            told.append(number)
    first = text.cards[0].line if text.cards else data.count(b"\n") + 2
    found = [row.line for card in text.cards for row in rows_of(text, card)]
    assert found == [number for number in told if number > first]


@pytest.mark.parametrize(
    "line",
    [
        b"*Amplitude, name=Press, time=total time",
        b"\t* AMPLITUDE ,NAME = PRESS\t, TIME=TOTALTIME  ",
        b'*amplitude,Name="Press",Time = Total Time\r',
    ],
)
def test_blanks_case_and_quotes_do_not_count(line):
    text, card = card_of(b"** first\n" + line + b"\n0., 0.\n", "AMPLITUDE")
    assert card.line == 2
    assert [(one.name, one.word) for one in card.options] == [
        ("NAME", "PRESS"),
        ("TIME", "TOTALTIME"),
    ]
    (row,) = rows_of(text, card)
    assert (row.line, row.words) == (3, ("0.", "0."))
    assert text.data[card.start : card.head] == line.rstrip()


def test_a_comma_in_quotes_does_not_part_words():
    _, card = card_of(b'*NSET, NSET="a, b", UNSORTED\n1\n', "NSET")
    assert [(one.name, one.value) for one in card.options] == [("NSET", "a, b"), ("UNSORTED", None)]


def test_a_quote_without_its_other_half_is_a_letter():
    _, card = card_of(b'*STATIC, D"RECT, SOLVER=SPOOLES\n1.\n', "STATIC")
    assert [one.value for one in card.options] == [None, "SPOOLES"]


def test_what_stands_behind_a_carriage_return_is_not_read():
    text, card = card_of(b"*STATIC, DIRECT\rINC=3\n1., 2.\r, 3.\n\r4\n", "STATIC")
    assert [one.name for one in card.options] == ["DIRECT"]
    assert text.data[card.start : card.head] == b"*STATIC, DIRECT"
    assert [row.words for row in rows_of(text, card)] == [("1.", "2.")]


def test_a_keyword_line_that_ends_in_a_comma_goes_on_as_its_solver_has_it():
    file = b"*NODE FILE,\nU\n"
    text, card = card_of(file, "NODEFILE")  # ccx takes the next line for data
    assert [row.words for row in rows_of(text, card)] == [("U",)]
    text, card = card_of(file, "NODEFILE", abaqus=True)
    assert [one.name for one in card.options] == ["U"]

    step = b"*STEP, NLGEOM,\n  INC=7,\n** not this\nA title\n"
    text, card = card_of(step, "STEP")  # which ccx could not read as data
    assert card.option("INC").word == "7"
    assert text.data[card.start : card.head] == b"*STEP, NLGEOM,\n  INC=7,"
    assert text.data[card.option("INC").start : card.option("INC").stop] == b"INC=7"
    assert [row.line for row in rows_of(text, card)] == [4]


def test_a_heading_ends_at_a_star_in_the_first_column():
    deck = b"*HEADING\n  *STEP is what I say\n*NODE\n1, 0.\n"
    assert [card.keyword for card in read_inp_text(deck).cards] == ["HEADING", "NODE"]


def test_what_is_no_deck_has_no_cards():
    assert read_inp_text(b"").cards == ()
    assert read_inp_text("*STEP\n".encode("utf-16")).cards == ()


def test_the_title_is_the_keyword_as_people_write_it():
    _, card = card_of(b" *node \t file,NSET=A\n", "NODEFILE")
    assert card.title == "NODE FILE"


def test_new_lines_end_as_the_first_line_does():
    assert read_inp_text(b"*A\r\n*B\n").newline == b"\r\n"
    assert read_inp_text(b"*A\n*B\r\n").newline == b"\n"
    assert read_inp_text(b"*A").newline == b"\n"
