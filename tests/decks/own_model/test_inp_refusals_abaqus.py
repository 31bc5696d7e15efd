"""Own decks for Abaqus that are refused, and where."""

import numpy as np
import pytest

from decks.analysis import Motion
from decks.own_model.inp_deck import rebase_inp
from decks.own_model.request import Request
from fembridge.errors import DeckError

MOTION = Motion(np.arange(5) * 5e-4, np.array([0.0, 0.1, 0.2, 0.1, 0.0]), 5e-4, 0)
DECK = """\
*HEADING
somebody's deck
*NODE, NSET=ALL
1, 0., 0., 0.
2, 1., 0., 0.
3, 1., 1., 0.
4, 0., 1., 0.
*ELEMENT, TYPE=CPE4, ELSET=SKIN
1, 1, 2, 3, 4
*AMPLITUDE, NAME=PRESS
0., 0., 1., 1.
*AMPLITUDE, NAME=OTHER
0., 0., 1., 1.
*STEP, NAME=push, INC=200
*STATIC
0.1, 1.
*BOUNDARY
1, 1, 2
*BOUNDARY, AMPLITUDE=PRESS
4, 2, 2, -1.
*NODE FILE
U
*END STEP
"""
STEP = DECK[DECK.index("*STEP") :]


def rebase(deck=DECK, dialect=None, resolver=None, **request):
    return rebase_inp(
        deck.encode(), MOTION, Request(**request), dialect=dialect, resolver=resolver
    )


def refused(deck=DECK, **options):
    with pytest.raises(DeckError) as caught:
        rebase(deck, **options)
    return str(caught.value)


def changed(old, new):
    assert DECK.count(old) == 1
    return DECK.replace(old, new)


def test_an_unknown_dialect_is_refused():
    assert refused(dialect="nastran") == (
        "dialect 'nastran', expected calculix or abaqus"
    )


def test_abaqus_rounds_an_amplitude_in_a_dynamic_step():
    deck = changed("*STATIC", "*DYNAMIC")
    assert refused(deck, dialect="abaqus").startswith("line 10: in *DYNAMIC Abaqus")
    for smooth, taken in (("0", True), ("0.", True), ("0.25", False)):
        smoothed = deck.replace("NAME=PRESS\n", f"NAME=PRESS, SMOOTH={smooth}\n")
        if taken:
            rebase(smoothed, dialect="abaqus")
        else:
            refused(smoothed, dialect="abaqus")
    rebase(deck, dialect="calculix")


def test_a_creep_tolerance_chooses_increments_in_abaqus():
    deck = changed("*STATIC", "*VISCO, CETOL=0.1")
    assert refused(deck, dialect="abaqus").startswith("line 15: *VISCO, CETOL chooses")
    assert b"*VISCO, CETOL=0.1, DIRECT\n" in rebase(deck, dialect="calculix").deck


PARTS = """\
*PART, NAME=FINGER
*NODE
1, 0., 0.
2, 1., 0.
3, 1., 1.
4, 0., 1.
*ELEMENT, TYPE=CPE4H
1, 1, 2, 3, 4
*END PART
*ASSEMBLY, NAME=A
*INSTANCE, NAME=LEFT, PART=FINGER
*END INSTANCE
*INSTANCE, NAME=RIGHT, PART=FINGER
5., 0.
*END INSTANCE
*END ASSEMBLY
*AMPLITUDE, NAME=PRESS
0., 0., 1., 1.
"""


def test_a_node_in_several_instances_is_refused():
    assert refused(PARTS + STEP, afferents={"SA": 3}) == (
        "node 3 is in several instances: LEFT (line 5), RIGHT (line 5); give one of "
        "them another number"
    )


def test_a_turned_instance_is_refused_for_its_nodes():
    deck = PARTS.replace("*INSTANCE, NAME=LEFT, PART=FINGER\n*END INSTANCE\n", "")
    deck = deck.replace("5., 0.\n", "5., 0.\n0., 0., 0., 0., 0., 1., 90.\n") + STEP
    assert refused(deck, afferents={"SA": 3}).startswith(
        "line 13: instance RIGHT is turned"
    )
    rebase(deck)


def test_an_instance_of_no_part_and_an_assembly_without_an_end_are_refused():
    deck = PARTS.replace("PART=FINGER\n5.", "PART=HAND\n5.") + STEP
    assert refused(deck, afferents={"SA": 3}) == (
        "line 13: *INSTANCE of part HAND, which stands nowhere before it"
    )
    one = PARTS.replace("*INSTANCE, NAME=LEFT, PART=FINGER\n*END INSTANCE\n", "")
    deck = one.replace("*END ASSEMBLY\n", "") + STEP
    assert refused(deck, afferents={"SA": 3}).startswith("0 *END ASSEMBLY in the deck")


@pytest.mark.parametrize(
    ("gone", "told"),
    [
        ("*END PART\n", "line 1: this *PART has no *END PART"),
        ("5., 0.\n*END INSTANCE\n", "line 12: this *INSTANCE has no *END INSTANCE"),
        ("NAME=RIGHT, ", "line 12: *INSTANCE without NAME="),
    ],
)
def test_parts_and_instances_that_are_not_whole_are_refused(gone, told):
    one = PARTS.replace("*INSTANCE, NAME=LEFT, PART=FINGER\n*END INSTANCE\n", "")
    one = one.replace("*ASSEMBLY", "** \n*ASSEMBLY")
    deck = one.replace(gone, "") + STEP
    assert refused(deck).startswith(told)


def test_a_node_of_no_element_has_no_stress():
    deck = changed("*ELEMENT", "9, 5., 5.\n*ELEMENT")
    assert refused(deck, dialect="abaqus", afferents={"SA": 9}) == (
        "line 8: no *ELEMENT of the deck has node 9, so it has no stress"
    )


def test_nodes_after_a_system_card_are_refused():
    deck = changed("*NODE,", "*SYSTEM\n1., 2., 3.\n*NODE,")
    assert refused(deck, afferents={"SA": 3}).startswith("line 3: *SYSTEM moves")
