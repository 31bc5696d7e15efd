"""What an own Marc deck leaves open is refused, with the line that leaves it so."""

import numpy as np
import pytest

from decks.marc_grammar import read_marc_deck
from decks.motion import Motion
from decks.own_model.marc_dat import rebase_marc
from decks.own_model.request import Request
from fembridge.errors import DeckError

MOTION = Motion(np.arange(3) * 5e-4, np.array([0.0, 0.1, 0.2]), 5e-4, 0)


def refused(data, words, request=None):
    with pytest.raises(DeckError, match=words) as caught:
        rebase_marc(data, MOTION, request or Request())
    return str(caught.value)


def line_of(data, text, which=0):
    found = [n for n, line in enumerate(data.decode().splitlines(), 1) if text in line]
    return f"line {found[which]}"


def test_a_table_that_is_not_there_is_named_with_those_that_are(marc_text):
    data = marc_text().text()
    told = refused(data, "no table 'other'", Request(amplitude="other"))
    assert f"wave ({line_of(data, 'table  ', 1)})" in told


def test_two_tables_that_drive_motions_have_to_be_told_apart(marc_text):
    deck = marc_text(drive="disp")
    lines = [*deck.conditions(), *deck.fixed("twist", 2.0, 2)]
    tables = [*deck.table(), *deck.table("second", 2)]
    cases = [line.replace("         2", "         3") for line in deck.case()]
    cases.insert(4, "twist")
    data = deck.text(table=tables, conditions=lines, cases=cases)
    told = refused(data, "2 tables drive a motion; name one: wave")
    assert told.startswith(line_of(data, "second"))
    new = rebase_marc(data, MOTION, Request(amplitude="SECOND"))
    points = {each.name: each.points for each in read_marc_deck(new.deck).tables}
    assert len(points["wave"]) == 2
    assert points["second"][-1, 1] == pytest.approx(0.1)  # 0.2 mm, factor 2


def test_the_same_name_twice_is_refused(marc_text):
    deck = marc_text()
    data = deck.text(table=[*deck.table(), *deck.table("wave", 2)])
    told = refused(data, "a second table 'wave'", Request(amplitude="wave"))
    assert told.startswith(line_of(data, "wave", 1))


def test_the_same_number_twice_is_refused(marc_text):
    deck = marc_text()
    data = deck.text(table=[*deck.table(), *deck.table("twin")])
    assert "as has 'wave'" in refused(data, "number 1", Request(amplitude="twin"))


def test_a_table_that_drives_nothing_is_refused(marc_text):
    deck = marc_text()
    data = deck.text(table=[*deck.table(), *deck.table("idle", 2)])
    told = refused(data, "drives no fixed displacement", Request(amplitude="idle"))
    assert told.startswith(line_of(data, "idle"))


def test_no_table_that_drives_a_motion_is_refused(marc_text):
    refused(marc_text(factor=0.0).text(), "no table drives a fixed displacement")


def test_different_factors_are_refused_with_both_lines(marc_text):
    deck = marc_text(drive="disp", factor=-2.0)
    lines = [*deck.conditions(), *deck.fixed("held", 3.0, 1)]
    told = refused(deck.text(conditions=lines), "with factor 3")
    assert "'indent'" in told and told.count("line ") == 2


def test_factors_of_either_sign_are_one(marc_text):
    deck = marc_text(drive="disp", factor=-2.0)
    lines = [*deck.conditions(), *deck.fixed("held", 2.0, 1)]
    new = rebase_marc(deck.text(conditions=lines), MOTION, Request())
    assert any("factor -2" in remark for remark in new.remarks)


def test_a_velocity_is_no_displacement(marc_text):
    deck = marc_text()
    lines = list(deck.contact())
    row = next(row for row, line in enumerate(lines) if line.endswith("probe") and row > 5)
    lines[row] = deck.named(1, 0, 0, 0, 1, 0, 0, -1, name="probe")
    told = refused(deck.text(contact=lines), "velocity or load", Request(amplitude="wave"))
    assert told.startswith("line ")


def test_a_rotation_is_no_displacement(marc_text):
    deck = marc_text(drive="disp")
    turn = [
        deck.named(1, 0, 0, 0, 1, 0, name="turn"),
        deck.reals(0.0, 1.0),
        deck.ints(0, 1),
        deck.ints(2, 4),
        deck.ints(2),
        "held_nodes",
    ]
    data = deck.text(conditions=[*deck.conditions(), *turn])
    told = refused(data, "also drives degree of freedom 4 of `fixed disp` 'turn'")
    assert told.startswith("line ")


def test_a_table_that_a_load_shares_is_refused(marc_text):
    deck = marc_text()
    load = [
        "point load",
        "",
        deck.named(1, 0, 0, 0, 0, 0, name="push"),
        deck.reals(0.0, 5.0),
        deck.ints(0, 1),
        deck.ints(2),
        "held_nodes",
    ]
    data = deck.text(conditions=[*deck.conditions(), *load])
    refused(data, "also drives `point load` 'push'")


@pytest.mark.parametrize(
    ("row", "numbers", "words"),
    [(1, (1, 1, 0, 0, 3), "formula"), (2, (12, 2, 2, 0, 0, 2), "variable type 12")],
)
def test_a_table_of_another_kind_is_refused(marc_text, row, numbers, words):
    deck = marc_text()
    lines = list(deck.table())
    lines[row] = deck.ints(*numbers)
    if row == 1:
        lines[3:] = ["v1"]
    assert refused(deck.text(table=lines), words).startswith("line ")


def test_two_load_cases_have_to_be_told_apart(marc_text):
    deck = marc_text()
    data = deck.text(cases=[*deck.case("rest"), *deck.case("press")])
    told = refused(data, "2 load cases have increments")
    assert "1 rest" in told and "2 press" in told


def test_a_load_case_that_is_not_there_is_named_with_those_that_are(marc_text):
    data = marc_text().text()
    assert "1 press" in refused(data, "no load case 'lift'", Request(step="lift"))


def test_a_condition_that_does_not_act_is_refused(marc_text):
    deck = marc_text(drive="disp")
    cases = [line for line in deck.case() if line != "indent"]
    cases[1] = deck.ints(1)
    assert "'indent'" in refused(deck.text(cases=cases), "does not act in 1 press")


def test_other_ways_of_stepping_are_refused_with_their_line(marc_text):
    data = marc_text(stepping="dynamic change").text()
    told = refused(data, "steps by `dynamic change`")
    assert told.startswith(line_of(data, "dynamic change"))


def test_a_time_before_the_waveform_that_is_not_told_is_refused(marc_text):
    deck = marc_text()
    cases = [*deck.case("rest", stepping="dynamic change"), *deck.case("press")]
    refused(deck.text(cases=cases), "how long it takes", Request(step="press"))


def test_two_ways_of_stepping_in_one_load_case_are_refused(marc_text):
    deck = marc_text()
    cases = list(deck.case())
    cases[-1:] = [*list(deck.case(stepping="auto step"))[-4:]]
    refused(deck.text(cases=cases), "a second way of stepping, `auto step`")


def test_a_node_without_coordinates_is_refused(marc_text):
    data = marc_text().text()
    told = refused(data, "afferent SA: node 7", Request(afferents={"SA": 7}))
    assert told.startswith(line_of(data, "coordinates"))


def test_included_files_are_told_and_can_be_read(marc_text):
    deck = marc_text()
    mesh = list(deck.mesh())
    split = mesh.index("coordinates")
    inner = "\n".join(mesh[split:]).encode() + b"\n"
    data = deck.text(mesh=[*mesh[:split], "include nodes.inc"])
    request = Request(afferents={"SA": 2})
    assert "nodes.inc" in refused(data, "not read: nodes.inc", request)
    assert rebase_marc(data, MOTION, Request()).needs == ("nodes.inc",)
    followed = rebase_marc(data, MOTION, request, {"nodes.inc": inner}.get)
    assert followed.place_mm == {"SA": (1.0, 0.0)}
    assert b"include nodes.inc\n" in followed.deck
    assert inner not in followed.deck


def test_points_in_an_included_file_are_no_points_of_the_deck(marc_text):
    deck = marc_text()
    lines = list(deck.table())
    data = deck.text(table=[*lines[:3], "include wave.inc"])
    refused(data, "a formula or")
    inner = "\n".join(lines[3:]).encode()
    with pytest.raises(DeckError, match=r"wave\.inc:1: would have to"):
        rebase_marc(data, MOTION, Request(), {"wave.inc": inner}.get)


def test_a_table_in_an_included_file_is_refused(marc_text):
    deck = marc_text()
    inner = "\n".join(deck.table()).encode() + b"\n"
    data = deck.text(table=["include wave.inc"])
    with pytest.raises(DeckError, match=r"wave\.inc:3: would have to"):
        rebase_marc(data, MOTION, Request(), {"wave.inc": inner}.get)


def test_what_is_no_marc_deck_is_refused():
    refused(b"*NODE\n1, 0., 0.\n", "no Marc deck")
    refused(b"", "no Marc deck")
