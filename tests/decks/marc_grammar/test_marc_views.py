"""Tables, materials, conditions, contact, load cases and output of Marc decks."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from decks.marc_grammar import describe_marc_deck, read_marc_deck
from decks.marc_grammar.conditions import conditions
from decks.marc_grammar.contact import (
    COULOMB_BILINEAR,
    POSITION,
    contact,
    contact_tables,
    interactions,
)
from decks.marc_grammar.history import initial_conditions, load_cases
from decks.marc_grammar.material import isotropic
from decks.marc_grammar.post import post
from fembridge.errors import DeckError

SAMPLES = Path(__file__).parents[3] / "fixtures" / "marc_samples"
PATHS = {path.stem: path for path in SAMPLES.glob("*.dat")}
PFL = read_marc_deck(PATHS["pfl_example_model_0"].read_bytes())
LINEAR = PATHS["nour_linear"].read_bytes()
PLASTIC = read_marc_deck(PATHS["nour_plastic"].read_bytes())


def model(*lines, version=15, table=True):
    """A deck of these lines, free layout, one number a comma."""
    head = ["title", f"version,{version}", *(["table,0"] if table else []), "end"]
    return read_marc_deck("\n".join([*head, *lines, "end option"]).encode())


# ---- real decks


def test_a_condition_is_values_tables_directions_and_a_set():
    found = {each.name: each for each in conditions(PFL)}
    first = found["apply1"]
    assert (first.family, first.where, first.list_kind) == (*("fixed disp", "apply1_nodes", 2),)
    assert (first.values, first.directions) == ((0.0, 0.0), (1, 2))
    load = found["apply3"]
    assert (load.family, load.where, load.list_kind) == ("dist loads", "apply3_edges", 13)
    assert (load.values, load.tables) == ((0.025,), (1,))


def test_load_cases_name_their_conditions():
    (case,) = load_cases(PFL)
    assert case.name == "lcase1"
    assert case.active == ("apply1", "apply2", "apply3") == initial_conditions(PFL)
    assert (case.stepping.keyword, case.increments, case.period) == (*("auto step", None, 1.0),)


def test_load_cases_of_even_increments_count_them():
    (case,) = load_cases(read_marc_deck(LINEAR))
    assert (case.stepping.keyword, case.increments, case.period) == (*("auto load", 1, 1.0),)


def test_tables_are_points_of_a_variable():
    force, stress = PLASTIC.tables
    assert (force.name, force.number, force.variables) == ("force_table", 1, (1,))
    assert_array_equal(force.points, [[0, 0], [1, 1]])
    assert (stress.number, stress.variables) == (2, (15,))
    assert_array_equal(stress.points, [[0, 6.5e4], [0.5, 1.565e6]])


def test_a_material_is_eight_numbers_and_their_tables():
    (steel,) = isotropic(PLASTIC)
    assert (steel.name, steel.criterion, steel.hardening) == (*("steel", "von mises", "isotropic"),)
    assert (steel.young, steel.poisson) == (3.0e7, 0.3)
    assert (steel.values[4], steel.tables[4]) == (1.0, 2)


def test_contact_has_bodies_and_bilinear_friction():
    found = contact(PFL)
    assert found.friction_type == COULOMB_BILINEAR
    (body,) = found.bodies
    assert (body.number, body.name, body.kind) == (1, "cbody1", 1)
    (touching,) = interactions(PFL)
    assert (touching.name, touching.kinds) == ("interact1", (1, 1))
    (table,) = contact_tables(PFL)
    assert (table.name, table.pairs) == ("ctable1", ((1, 1, 1),))


def test_output_is_element_codes_and_nodal_codes():
    found = post(PFL)
    assert [each.code for each in found.codes] == [681]
    assert (found.nodal, found.formatted, found.every) == ((1,), False, 1)
    assert [each.code for each in post(PLASTIC).codes] == [431]


@pytest.mark.parametrize("name", PATHS)
def test_a_description_holds_what_the_views_do(name):
    held = describe_marc_deck(PATHS[name])
    deck = read_marc_deck(PATHS[name].read_bytes())
    assert held["version"] == 15
    assert held["bytes"] == PATHS[name].stat().st_size
    assert held["elements"] == {str(each.kind): len(each.number) for each in deck.elements}
    assert held["nodes"] == len(deck.coordinates.number)
    assert [each["name"] for each in held["tables"]] == [t.name for t in deck.tables]
    assert held["remarks"] == []


def test_a_description_keeps_going_where_a_view_refuses(tmp_path):
    path = tmp_path / "mine.dat"
    path.write_bytes(LINEAR.replace(b"\n         1         0         0", b"\n1, 0", 1))
    wrong = LINEAR.replace(b"post\n         0", b"post\n         5", 1)
    assert wrong != LINEAR
    path.write_bytes(wrong)
    held = describe_marc_deck(path)
    assert held["post"] is None
    assert any("5 element codes announced" in each for each in held["remarks"])


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(DeckError, match=r"gone\.dat: No such file"):
        describe_marc_deck(tmp_path / "gone.dat")


# ---- other versions and layouts


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


def test_a_rigid_body_has_a_curve_and_a_position():
    deck = model(
        *CONTACT,
        *("1,0,0,0,0,0,0,-1,skin", "1,1,0,0", *BODY[1:], "1 to 5"),
        *("2,1,0,0,1,-1,0,-1,probe", *BODY, *CURVE),
    )
    skin, probe = contact(deck).bodies
    assert (skin.name, skin.kind, skin.shapes) == ("skin", 1, ())
    assert (probe.control, probe.motion[1], probe.motion_table[1]) == (POSITION, -3, 1)
    (curve,) = probe.shapes
    assert (curve.counts, curve.orders) == ((2,), (2,))
    assert_array_equal(curve.point, [[0, 0], [1, 0]])
    assert_array_equal(curve.knot, [0, 0, 1, 1])


def test_a_rigid_surface_has_two_directions():
    point = [f"{x}.,{y}.,0." for y in range(2) for x in range(2)]
    surface = ["9,2,2,2,2,1,1,0", *point, *["1.,"] * 4, *["0.,", "0.,", "1.,", "1.,"] * 2]
    deck = model(
        *("contact,5", "1,0,9,6", "0,0", "0.,", "0."), *("1,1,0,0,1,0,0,-1,base", *BODY, *surface)
    )
    (shape,) = contact(deck).bodies[0].shapes
    assert (shape.counts, shape.orders, shape.knot.shape) == ((2, 2), (2, 2), (8,))
    assert_array_equal(shape.point[3], [1, 1, 0])


def test_a_shape_of_another_kind_is_left_and_the_next_body_found():
    deck = model(
        *CONTACT,
        *("1,1,0,0,1,0,0,-1,old", *BODY, "1,3", "0.,0.", "1.,0.", "1.,1."),
        *("2,1,0,0,1,-1,0,-1,probe", *BODY, *CURVE),
    )
    old, probe = contact(deck).bodies
    assert (old.shapes, len(probe.shapes)) == ((), 1)


def test_up_to_version_11_materials_list_their_elements():
    lines = ["isotropic", "", "1,elastic,,10,0,0,0,skin", "2.,.3", "0,0", "1 to 3"]
    (skin,) = isotropic(model(*lines, version=11))
    assert (skin.name, skin.young, skin.elements) == ("skin", 2.0, (1, 2, 3))
    (plain,) = isotropic(model(*lines[:4], "7,", version=11, table=False))
    assert (plain.elements, set(plain.tables)) == ((7,), {0})


def test_a_formula_and_a_table_of_two_variables_have_no_points():
    formula = ["table,f", "1,1,0,0,3", "1,0,2", "v1"]
    plane = ["table,p", "2,2,0,0,2", "1,2,1,5,2,1", "0.,1.", "0.,1.", "1.,2.,3.,4."]
    first, second = model(*formula, *plane).tables
    assert (first.kind, first.points) == (3, None)
    assert (second.variables, second.counts, second.points) == ((1, 5), (2, 2), None)


# ---- what does not agree


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (["table,t", "1,1,0,0,2", "1,3,2", "0.,0."], "has 1 lines of points"),
        (["table,t"], "has no lines of numbers"),
        ([*CONTACT, "1,0,0,0,0,0,0,-1,skin", *BODY], "2 contact bodies announced"),
        (["contact,5", "1,0"], "`contact` has 1 lines"),
        (["con table,1", "1,2,0,c", "1,1,1"], "2 pairs of bodies announced"),
        (["con intera,3", "1,0,c"], "cut short"),
        (["post", "3,16,17", "311,0"], "3 element codes announced"),
        (["fixed disp", "", "1,0,0,0,1,0,a", "1.,", "0,", "1,"], "has 4 lines"),
        (["fixed disp", "1.,", "1,", "3,"], "not in the table-driven style"),
        (
            ["fixed disp", "", "1,0,0,0,1,0,a", "1.,1.", "0,0", "1,", "2,", "s"],
            "1 degrees of freedom for 2 values",
        ),
        (["isotropic", "", "1,elastic,,10,0,0,0,skin"], "without its values"),
    ],
)
def test_counts_that_do_not_agree_are_refused_with_their_line(lines, words):
    def all_of(deck):
        return (
            conditions(deck),
            contact(deck),
            interactions(deck),
            contact_tables(deck),
            post(deck),
            isotropic(deck),
        )

    with pytest.raises(DeckError, match=rf"line \d+: .*{words}"):
        all_of(model(*lines))


def test_a_load_case_with_fewer_conditions_than_it_says_is_refused():
    start = LINEAR.index(b"loadcase", LINEAR.index(b"end option"))
    history = LINEAR[start:].replace(b"\n         2\n", b"\n        20\n", 1)
    deck = read_marc_deck(LINEAR[:start] + history)
    with pytest.raises(DeckError, match=r"line \d+: 20 conditions announced"):
        load_cases(deck)


def test_curves_that_end_early_are_refused():
    deck = model(*CONTACT[:1], "1,0", *CONTACT[2:], "1,1,0,0,1,-1,0,-1,p", *BODY, *CURVE[:5])
    with pytest.raises(DeckError, match="a rigid curve of 2 points is cut short"):
        contact(deck)


def test_hostile_counts_take_no_memory():
    head = ["9,2000000000,2000000000,2,2,1,1,0"]
    deck = model(*CONTACT[:1], "1,0", *CONTACT[2:], "1,1,0,0,1,-1,0,-1,p", *BODY, *head)
    with pytest.raises(DeckError, match="cut short"):
        contact(deck)


def test_a_deck_without_an_option_has_no_view_of_it():
    deck = model("no print")
    assert (contact(deck), post(deck)) == (None, None)
    assert conditions(deck) == isotropic(deck) == deck.tables == ()
    assert np.size(deck.coordinates.number) == 0
