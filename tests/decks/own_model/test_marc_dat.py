"""An own Marc deck gets the waveform, and keeps every other byte."""

import difflib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from decks.marc_grammar import read_marc_deck
from decks.marc_grammar.history import load_cases
from decks.marc_grammar.post import BOTH, FORMATTED, post
from decks.motion import Motion
from decks.own_model.marc_dat import rebase_marc
from decks.own_model.request import Request
from fembridge.errors import DeckError

MOTION = Motion(np.arange(4) * 5e-4, np.array([0.0, 0.125, -0.0625, 0.3]), 5e-4, 0)
LAYOUTS = ("extended", "fixed", "free")

decks = st.fixed_dictionaries(
    {
        "layout": st.sampled_from(LAYOUTS),
        "version": st.sampled_from((11, 14, 15)),
        "drive": st.sampled_from(("body", "disp")),
        "factor": st.sampled_from((-1.0, 1.0, -3.0, 0.5)),
        "stepping": st.sampled_from(("auto load", "auto step")),
        "post": st.sampled_from(((), (301,), (17,), (311, 17), (7, 311))),
        "post_head": st.dictionaries(st.sampled_from((4, 9)), st.integers(0, 1)),
        "end": st.sampled_from(("\n", "\r\n")),
    }
)
samples = st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=9)


def motion_of(depths, dt_s=5e-4):
    return Motion(np.arange(len(depths)) * dt_s, np.array(depths), dt_s, 0)


def table_of(data, name="wave"):
    (table,) = (each for each in read_marc_deck(data).tables if each.name == name)
    return table


@given(parts=decks, depths=samples, length_mm=st.sampled_from((1.0, 1000.0)))
def test_depth_times_factor_is_the_motion_in_the_unit_of_the_deck(
    marc_text, parts, depths, length_mm
):
    data = marc_text(**parts).text()
    rebased = rebase_marc(data, motion_of(depths), Request(length_mm=length_mm))
    points = table_of(rebased.deck).points
    assert_array_equal(points[:, 0], np.arange(len(depths)) * 5e-4)
    depth = points[:, 1] * abs(parts["factor"]) * length_mm
    assert_allclose(depth, depths, rtol=1e-13, atol=1e-30)


@given(parts=decks, depths=samples)
def test_the_load_case_has_an_increment_a_sample(marc_text, parts, depths):
    motion = motion_of(depths)
    rebased = rebase_marc(marc_text(**parts).text(), motion, Request())
    (case,) = load_cases(read_marc_deck(rebased.deck))
    assert case.stepping.keyword == "auto load"
    assert case.increments == len(depths) - 1
    assert_allclose(case.period, motion.time_s[-1], rtol=1e-12)


@given(parts=decks, results=st.sampled_from([None, "binary", "text", "both"]))
def test_stress_is_asked_for_at_every_increment(marc_text, parts, results):
    data = marc_text(**parts).text()
    before = post(read_marc_deck(data))
    wanted = post(read_marc_deck(rebase_marc(data, MOTION, Request(results=results)).deck))
    codes = [each.code for each in wanted.codes]
    assert codes[: len(parts["post"])] == list(parts["post"])
    assert sorted(codes) == sorted({*parts["post"], 17, 311})
    kinds = {None: before.head[FORMATTED], "binary": 0, "text": 1, "both": BOTH}
    assert (wanted.every, wanted.head[FORMATTED]) == (1, kinds[results])


@given(parts=decks, depths=samples)
def test_putting_the_same_in_again_changes_nothing(marc_text, parts, depths):
    once = rebase_marc(marc_text(**parts).text(), motion_of(depths), Request()).deck
    assert rebase_marc(once, motion_of(depths), Request()).deck == once


@given(parts=decks, depths=samples)
def test_lines_outside_table_steps_and_post_are_kept_in_order(marc_text, parts, depths):
    data = marc_text(**parts).text()
    deck = read_marc_deck(data)
    changed = {
        line.number
        for option in deck.options
        if option.keyword in ("table", "auto load", "auto step", "time step", "post")
        for line in option.lines
        if option.section.value != "parameter"
    }
    old = data.splitlines(keepends=True)
    new = rebase_marc(data, motion_of(depths), Request()).deck.splitlines(keepends=True)
    kept = [line for row, line in enumerate(old, 1) if row not in changed]
    rest = iter(new)
    assert all(line in rest for line in kept)  # a subsequence, in order
    assert {line[-2:] == b"\r\n" for line in new} == {parts["end"] == "\r\n"}


def test_only_numbers_that_must_change_do(marc_text):
    data = marc_text(post=(311, 17)).text()
    new = rebase_marc(data, MOTION, Request()).deck
    lines = [
        each
        for each in difflib.ndiff(data.decode().splitlines(), new.decode().splitlines())
        if each[0] in "+-"
    ]
    removed = [each[2:].split()[0] for each in lines if each[0] == "-"]
    # the count of points, the second point, the increments and their time
    assert removed == ["1", "1.000000000000000+0", "10", "1.000000000000000-1"]
    added = [each[2:] for each in lines if each[0] == "+"]
    assert added[0][:20] == "         1         4"
    assert added[-2:] == [
        "         3         0        10         0         0",
        " 5.000000000000000-4",
    ]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_the_layout_of_the_deck_is_kept_and_digits_are_not_lost(marc_text, layout):
    data = marc_text(layout=layout).text()
    table = table_of(rebase_marc(data, motion_of([0.0, 1 / 3]), Request()).deck)
    commas = ["," in line.text for line in table.rows]
    assert commas[:2] == [layout == "free"] * 2
    assert commas[2:] == [layout != "extended"] * 2
    assert_allclose(table.points[1], [5e-4, 1 / 3], rtol=1e-15)


def test_comments_between_points_stay(marc_text):
    deck = marc_text()
    head, first, *rest = list(deck.table())[:1], *list(deck.table())[1:]
    lines = [*head, "$ mine", first, "$ and this", *rest]
    new = rebase_marc(deck.text(table=lines), MOTION, Request()).deck
    assert new.count(b"$ mine\n") == new.count(b"$ and this\n") == 1


def test_a_waveform_starts_when_its_load_case_does(marc_text):
    """Time of tables runs on: 20 increments of 0.1 come before."""
    deck = marc_text()
    cases = [*deck.case("rest", 20), *deck.case("press")]
    new = rebase_marc(deck.text(cases=cases), MOTION, Request(step="press"))
    points = table_of(new.deck).points
    assert_allclose(points[0], [0.0, 0.0])
    assert_allclose(points[1:, 0], 2.0 + MOTION.time_s, rtol=1e-15)
    rest, press = load_cases(read_marc_deck(new.deck))
    assert (rest.increments, press.increments) == (20, 3)
    assert any("starts at 2 s" in remark for remark in new.remarks)


def test_a_load_case_is_named_by_number_too(marc_text):
    deck = marc_text()
    data = deck.text(cases=[*deck.case("rest"), *deck.case("press")])
    by_number = rebase_marc(data, MOTION, Request(step="2"))
    assert by_number == rebase_marc(data, MOTION, Request(step="PRESS"))


def test_a_load_case_without_increments_is_never_meant(marc_text):
    deck = marc_text()
    cases = [*deck.case("press", stepping="none"), *deck.case("press")]
    new = rebase_marc(deck.text(cases=cases), MOTION, Request())
    assert [c.increments for c in load_cases(read_marc_deck(new.deck))] == [0, 3]


def test_control_is_raised_only_where_it_is_too_small(marc_text):
    deck = marc_text()
    small = deck.text(cases=list(deck.case(most=2)))
    assert b"     99999        10" in rebase_marc(small, MOTION, Request()).deck
    enough = deck.text(cases=list(deck.case(most=3)))
    assert b"         3        10" in rebase_marc(enough, MOTION, Request()).deck


def test_a_time_step_is_added_where_only_the_count_was(marc_text):
    deck = marc_text()
    cases = [line for line in deck.case() if line.strip() != "time step"]
    cases.pop(-2)  # its number
    (case,) = load_cases(
        read_marc_deck(rebase_marc(deck.text(cases=cases), MOTION, Request()).deck)
    )
    assert (case.increments, case.period) == (3, pytest.approx(1.5e-3))


def test_an_output_interval_of_the_history_becomes_one(marc_text):
    deck = marc_text()
    cases = list(deck.case())
    cases[-1:] = ["post increment", deck.ints(2, 0), "continue"]
    new = rebase_marc(deck.text(cases=cases), MOTION, Request()).deck
    assert b"post increment\n" + deck.ints(1, 0).encode() + b"\n" in new


def test_a_deck_without_a_post_option_gets_one(marc_text):
    data = marc_text().text(output=["no print"])
    wanted = post(read_marc_deck(rebase_marc(data, MOTION, Request()).deck))
    assert [each.code for each in wanted.codes] == [17, 311]


def test_the_place_of_an_afferent_is_in_mm(marc_text):
    data = marc_text().text()
    request = Request(afferents={"SA": 6, "PC": 2}, length_mm=1000.0)
    places = rebase_marc(data, MOTION, request).place_mm
    assert places == {"SA": (2000.0, -1000.0), "PC": (1000.0, 0.0)}


def test_remarks_name_the_lines_of_what_was_chosen(marc_text):
    new = rebase_marc(marc_text(factor=-3.0).text(), MOTION, Request())
    deck = read_marc_deck(marc_text(factor=-3.0).text())
    line = table_of(marc_text().text()).line.number
    (body,) = deck.find("contact")
    assert f"line {line}: table 'wave' is the waveform" in new.remarks
    told = " ".join(new.remarks)
    assert "factor -3" in told and "divided by 3" in told
    assert any(f"line {body.head.number + 10}:" in remark for remark in new.remarks)


@given(data=st.data())
def test_a_mutated_deck_is_refused_in_words_or_taken(marc_text, data):
    text = bytearray(marc_text(**data.draw(decks)).text())
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(text) - 1))
        new = data.draw(st.sampled_from((b"", b"9", b"-", b"x", b" ", b"\n", b",")))
        text[place : place + data.draw(st.integers(0, 3))] = new
    try:
        rebased = rebase_marc(bytes(text), MOTION, Request(afferents={"SA": 1}))
    except DeckError:
        return
    read_marc_deck(rebased.deck)
