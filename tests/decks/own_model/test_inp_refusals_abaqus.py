"""Own decks for Abaqus that are refused, and where."""

import pytest


def test_an_unknown_dialect_is_refused(refused):
    assert refused(dialect="nastran") == ("dialect 'nastran', expected calculix or abaqus")


def test_abaqus_rounds_an_amplitude_in_a_dynamic_step(changed, rebase, refused):
    deck = changed("*STATIC", "*DYNAMIC")
    assert refused(deck, dialect="abaqus").startswith("line 10: in *DYNAMIC Abaqus")
    for smooth, taken in (("0", True), ("0.", True), ("0.25", False)):
        smoothed = deck.replace("NAME=PRESS\n", f"NAME=PRESS, SMOOTH={smooth}\n")
        if taken:
            rebase(smoothed, dialect="abaqus")
        else:
            refused(smoothed, dialect="abaqus")
    rebase(deck, dialect="calculix")


def test_a_creep_tolerance_chooses_increments_in_abaqus(changed, rebase, refused):
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


def test_a_node_in_several_instances_is_refused(step, refused):
    assert refused(PARTS + step, afferents={"SA": 3}) == (
        "node 3 is in several instances: LEFT (line 5), RIGHT (line 5); give one of "
        "them another number"
    )


def test_a_turned_instance_is_refused_for_its_nodes(step, rebase, refused):
    deck = PARTS.replace("*INSTANCE, NAME=LEFT, PART=FINGER\n*END INSTANCE\n", "")
    deck = deck.replace("5., 0.\n", "5., 0.\n0., 0., 0., 0., 0., 1., 90.\n") + step
    assert refused(deck, afferents={"SA": 3}).startswith("line 13: instance RIGHT is turned")
    rebase(deck)


def test_an_instance_of_no_part_and_an_assembly_without_an_end_are_refused(step, refused):
    deck = PARTS.replace("PART=FINGER\n5.", "PART=HAND\n5.") + step
    assert refused(deck, afferents={"SA": 3}) == (
        "line 13: *INSTANCE of part HAND, which is nowhere before it"
    )
    one = PARTS.replace("*INSTANCE, NAME=LEFT, PART=FINGER\n*END INSTANCE\n", "")
    deck = one.replace("*END ASSEMBLY\n", "") + step
    assert refused(deck, afferents={"SA": 3}).startswith("0 *END ASSEMBLY in the deck")


@pytest.mark.parametrize(
    ("gone", "told"),
    [
        ("*END PART\n", "line 1: this *PART has no *END PART"),
        ("5., 0.\n*END INSTANCE\n", "line 12: this *INSTANCE has no *END INSTANCE"),
        ("NAME=RIGHT, ", "line 12: *INSTANCE without NAME="),
    ],
)
def test_parts_and_instances_that_are_not_whole_are_refused(gone, told, step, refused):
    one = PARTS.replace("*INSTANCE, NAME=LEFT, PART=FINGER\n*END INSTANCE\n", "")
    one = one.replace("*ASSEMBLY", "** \n*ASSEMBLY")
    deck = one.replace(gone, "") + step
    assert refused(deck).startswith(told)


def test_a_node_of_no_element_has_no_stress(changed, refused):
    deck = changed("*ELEMENT", "9, 5., 5.\n*ELEMENT")
    assert refused(deck, dialect="abaqus", afferents={"SA": 9}) == (
        "line 8: no *ELEMENT of the deck has node 9, so it has no stress"
    )


def test_nodes_after_a_system_card_are_refused(changed, refused):
    deck = changed("*NODE,", "*SYSTEM\n1., 2., 3.\n*NODE,")
    assert refused(deck, afferents={"SA": 3}).startswith("line 3: *SYSTEM moves")
