"""What Marc decks hold; counts that do not agree are refused."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from decks.marc.contents import NODES, POSITION, describe_marc_deck, read_marc_deck
from decks.marc.grammar import FileSection
from fembridge.errors import DeckError

SAMPLES = Path(__file__).parents[3] / "fixtures" / "marc_samples"
PATHS = {path.stem: path for path in SAMPLES.glob("*.dat")}
PFL = read_marc_deck(PATHS["pfl_example_model_0"].read_bytes())
LINEAR = PATHS["nour_linear"].read_bytes()
PLASTIC = read_marc_deck(PATHS["nour_plastic"].read_bytes())


def deck_of(elements, nodes=1, layout="extended"):
    """A deck of elements (number, type, nodes) and so many nodes."""
    width = 10 if layout == "extended" else 5

    def row(values):
        if layout == "free":
            return ",".join(map(str, values)) + ","
        return "".join(f"{value:{width}d}" for value in values)

    lines = ["title", *(["extended"] if layout == "extended" else []), "end"]
    lines += ["connectivity", row([0, 0, 1, 0, 7, 8, 0, 9])]
    for number, kind, each in elements:
        lines.append(row([number, kind, *each[:14]]))
        lines += [row(each[at : at + 14]) for at in range(14, len(each), 14)]
    lines += ["coordinates", row([3, nodes, 0, 1])]
    lines += [f"{node}, 1., 2., 3.," for node in range(1, nodes + 1)]
    return read_marc_deck("\n".join([*lines, "end option"]).encode())


def model(*lines, version=15, table=True):
    """A deck of these lines, free layout, one number a comma."""
    head = ["title", f"version,{version}", *(["table,0"] if table else []), "end"]
    return read_marc_deck("\n".join([*head, *lines, "end option"]).encode())


# ---- Real decks


def test_a_deck_of_mixed_elements_has_a_pressure_node_each():
    """Counts are those of its status file: 2461 elements, 5043 nodes with pressure."""
    (elements,) = PFL.elements
    assert (elements.kind, elements.node.shape) == (118, (2461, 5))
    assert elements.material == 1
    assert len(PFL.coordinates.number) == 2582
    assert PFL.sizes == (2461, 2582 + 2461)
    pressure = elements.node[:, 4]
    assert len(np.unique(pressure)) == 2461
    assert not np.isin(pressure, PFL.coordinates.number).any()
    assert np.isin(elements.node[:, :4], PFL.coordinates.number).all()
    assert_array_equal(PFL.coordinates.position_of(3), [25.0, 25.0, 0.0])
    assert PFL.coordinates.position_of(2591) is None


def test_a_real_deck_has_conditions_load_cases_and_tables():
    found = {each.name: each for each in PFL.conditions()}
    first, load = found["apply1"], found["apply3"]
    assert (first.family, first.set_name) == ("fixed disp", "apply1_nodes")
    assert first.drives == ((0.0, 0, 1), (0.0, 0, 2))
    assert (load.family, load.set_name) == ("dist loads", "apply3_edges")
    assert load.drives == ((0.025, 1, 0),)
    (adaptive,) = PFL.load_cases()
    assert (adaptive.name, adaptive.active) == ("lcase1", ("apply1", "apply2", "apply3"))
    assert (adaptive.stepping.keyword, adaptive.increments) == ("auto step", None)
    assert adaptive.period == 1.0
    (even,) = read_marc_deck(LINEAR).load_cases()
    assert (even.stepping.keyword, even.increments, even.period) == ("auto load", 1, 1.0)
    force, stress = PLASTIC.tables
    assert (force.name, force.number, force.variable) == ("force_table", 1, 1)
    assert_array_equal(force.points, [[0, 0], [1, 1]])
    assert (stress.number, stress.variable) == (2, 15)
    assert_array_equal(stress.points, [[0, 6.5e4], [0.5, 1.565e6]])


# ---- Descriptions


def test_a_description_keeps_going_where_an_option_is_refused(tmp_path):
    path = tmp_path / "mine.dat"
    wrong = LINEAR.replace(b"post\n         0", b"post\n         5", 1)
    assert wrong != LINEAR
    path.write_bytes(wrong)
    held = describe_marc_deck(path)
    line = wrong[: wrong.index(b"post\n")].count(b"\n") + 1
    assert held["post"] is None
    assert [f"line {line}: `post`" in each for each in held["remarks"]] == [True]


# ---- Elements


@given(
    kind=st.sampled_from(sorted(NODES)),
    layout=st.sampled_from(("extended", "fixed", "free")),
    count=st.integers(1, 4),
)
def test_elements_of_every_known_type_come_back(kind, layout, count):
    nodes = [[10 * row + k + 1 for k in range(NODES[kind])] for row in range(count)]
    rows = [(row + 1, kind, each) for row, each in enumerate(nodes)]
    (found,) = deck_of(rows, layout=layout).elements
    assert_array_equal(found.number, np.arange(count) + 1)
    assert_array_equal(found.node, nodes)
    assert found.material == 8


@pytest.mark.parametrize(
    ("elements", "found"),
    [
        ([(1, 11, [1, 2, 3])], "line 6: element 1 of type 11 has 3 nodes"),
        ([(1, 999, [1, 2, 3, 4]), (2, 999, [1, 2, 3])], "line 7: element 2 of type 999 has 3 "),
        ([(1, 6, [1, 2, 3]), (1, 6, [1, 2, 3])], "line 7: element 1 .* line 6"),
    ],
)
def test_elements_that_cannot_be_are_refused(elements, found):
    with pytest.raises(DeckError, match=found):
        deck_of(elements)


# ---- Counts of a mesh


SAID = b"         8        18         0"


def test_a_deck_by_mentat_has_as_many_as_it_says_and_one_by_hand_not_more():
    for count in (b"         7", b"         9"):
        with pytest.raises(DeckError, match=f"line 7: `sizing` has {int(count)} elements"):
            read_marc_deck(LINEAR.replace(SAID, count + SAID[10:], 1))
    lines = LINEAR.splitlines(keepends=True)
    start = lines.index(b"coordinates\n")
    with pytest.raises(DeckError, match=rf"line {start + 2}: 18 nodes"):
        read_marc_deck(b"".join(lines[: start + 5] + lines[start + 6 :]))
    hand = LINEAR.replace(b"MARC input file produced by", b"by hand, not by", 1)
    deck = read_marc_deck(hand.replace(SAID, b"        12" + SAID[10:], 1))
    assert deck.remarks == ("8 elements, while `sizing` has room for 12",)
    with pytest.raises(DeckError, match=r"line 7: .* 8"):
        read_marc_deck(hand.replace(SAID, b"         7" + SAID[10:], 1))


# ---- Other versions and layouts

BODY = [
    "2,0,0,0,1,1,1,1",
    "0.,0.,0.,0.,0.,0.,1.",
    "0.,0.,0.,0.",
    "0.,-3.,0.,0.,0.,0.,0.,0.",
    "0,1,0,0,0,0,0,0",
    "0,0,0,0",
]
CURVE = ["9,2,2,1", "0.,0.", "1.,0.", "1.,", "1.,", "0.,", "0.,", "1.,", "1.,"]
CONTACT = ["contact,5", "2,0,9,6", "0,0", "0.,", "0.,"]


def test_a_rigid_body_has_a_position_and_its_curve_is_passed_over():
    deck = model(
        *CONTACT,
        *("1,0,0,0,0,0,0,-1,skin", "1,1,0,0", *BODY[1:], "1 to 5"),
        *("2,1,0,0,1,-1,0,-1,probe", *BODY, *CURVE),
    )
    skin, probe = deck.bodies()
    assert (skin.name, skin.kind) == ("skin", 1)
    assert (probe.name, probe.kind, probe.control) == ("probe", 2, POSITION)
    assert probe.drives[1] == (-3, 1)


def test_up_to_version_11_materials_list_their_elements():
    lines = ["isotropic", "", "1,elastic,,10,0,0,0,skin", "2.,.3", "0,0", "1 to 3"]
    (skin,) = model(*lines, version=11).materials()
    assert (skin.name, skin.values[0], skin.elements) == ("skin", 2.0, (1, 2, 3))
    (plain,) = model(*lines[:4], "7,", version=11, table=False).materials()
    assert plain.elements == (7,)


def test_a_formula_and_a_table_of_two_variables_have_no_points():
    formula = ["table,f", "1,1,0,0,3", "1,0,2", "v1"]
    plane = ["table,p", "2,2,0,0,2", "1,2,1,5,2,1", "0.,1.", "0.,1.", "1.,2.,3.,4."]
    first, second = model(*formula, *plane).tables
    assert (first.number, first.points) == (1, None)
    assert (second.number, second.points) == (2, None)


@pytest.mark.parametrize(
    ("lines", "keyword"),
    [
        (["table,t", "1,1,0,0,2", "1,3,2", "0.,0."], "`table` 't'"),
        (["table,t"], "`table` 't'"),
        ([*CONTACT, "1,0,0,0,0,0,0,-1,skin", *BODY], "`contact`"),
        (["contact,5", "1,0"], "`contact`"),
        (["post", "3,16,17", "311,0"], "`post`"),
        (["fixed disp", "", "1,0,0,0,1,0,a", "1.,1.", "0,0", "1,2"], "`fixed disp`"),
        (["fixed disp", "1.,", "1,", "3,"], "`fixed disp` is not in the table-driven style"),
        (["fixed disp", "", "1,0,0,0,1,0,a", "1.,1.", "0,0", "1,", "2,", "s"], "`fixed disp`"),
        (["isotropic", "", "1,elastic,,10,0,0,0,skin"], "`isotropic`"),
    ],
)
def test_counts_that_do_not_agree_are_refused_with_the_line_of_their_option(lines, keyword):
    with pytest.raises(DeckError, match=rf"line \d+: {keyword}"):
        everything_of(model(*lines))


def everything_of(deck):
    return (
        *(deck.conditions(), deck.bodies(), deck.post(), deck.materials()),
        *(deck.sets(), deck.load_cases(), deck.find("title", FileSection.MODEL)),
    )


def test_a_load_case_with_fewer_conditions_than_it_says_is_refused():
    start = LINEAR.index(b"loadcase", LINEAR.index(b"end option"))
    history = LINEAR[start:].replace(b"\n         2\n", b"\n        20\n", 1)
    deck = read_marc_deck(LINEAR[:start] + history)
    with pytest.raises(DeckError, match=r"line 128: `loadcase`"):
        deck.load_cases()
