"""What is missing or can be meant in two ways is refused, and its line is named."""

import numpy as np
import pytest

from decks.motion import Motion
from decks.own_model import Request
from decks.own_model.inp_deck import rebase_inp
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


ITS_STEP = DECK[DECK.index("*STEP") :]


def rebase(deck=DECK, dialect=None, resolver=None, **request):
    """A short motion put into a deck."""
    request = Request(**request)
    return rebase_inp(deck.encode(), MOTION, request, dialect=dialect, resolver=resolver)


def refused(deck, begin, **options):
    """Assert that a deck is refused, and how the message begins."""
    with pytest.raises(DeckError, match=f"^{begin}"):
        rebase(deck, **options)


def changed(old, new):
    """The deck with `new` for the one `old` in it."""
    assert DECK.count(old) == 1
    return DECK.replace(old, new)


# ---- One change of the deck: what was there, what is there instead, and how the message
# begins: with the file and the line, and with what was found there.

OWN_AMPLITUDE = [  # what keeps its amplitude, beside a waveform that gets one
    *(
        ("NAME=PRESS\n", f"NAME=PRESS, {option}\n")
        for option in ("DEFINITION=SMOOTH STEP", "VALUE=ABSOLUTE", "TIME=TOTAL", "SHIFTX=0.1")
    ),
    ("NAME=PRESS\n", "NAME=PRESS, USER\n"),
    ("NAME=PRESS\n", "NAME=PRESS, INPUT=wave.txt\n"),
    ("NAME=OTHER", "NAME=press"),
    ("*NODE FILE", "*CLOAD, AMPLITUDE=press\n3, 1, 5.\n*NODE FILE"),
    ("4, 2, 2, -1.", "4, 2, 2, -1.\n3, 11, 11, 20."),
    ("*STEP", "*BOUNDARY, AMPLITUDE=PRESS\n4, 2, 2, -1.\n*STEP"),
]
CONDITION = [
    ("4, 2, 2, -1.", "4, 2, 2, -1.\n3, 2, 2, -2.", "line 21: magnitude -2, but -1 at line 20"),
    (
        "*NODE FILE",
        "*BOUNDARY, AMPLITUDE=OTHER\n3, 2, 2, -1.\n*NODE FILE",
        ".*PRESS .line 19., OTHER .line 21.",
    ),
    ("4, 2, 2, -1.", "4, 2, 2, 0.\n3, 2, 2", "no .BOUNDARY .*PRESS .line 10."),
    ("4, 2, 2, -1.", "4, 2, 2, -one", "line 20: '-one'"),
    ("AMPLITUDE=PRESS", "AMPLITUDE=PRESS, USER", "line 19: .*USER: 4,2"),
    ("AMPLITUDE=PRESS", "AMPLITUDE=PRESS, FIXED", "line 19: .*FIXED"),
    ("AMPLITUDE=PRESS", "AMPLITUDE=PRESS, TIME DELAY=0.1", "line 19: .*TIMEDELAY"),
]
STEP = [
    ("*STATIC\n0.1, 1.", "*FREQUENCY\n10", "line 14: "),
    ("*STATIC", "*STATIC\n*VISCO", "line 14: .*STATIC, line 15; .VISCO, line 16"),
    ("*STATIC", "*STATIC, RIKS", "line 15: .STATIC, RIKS"),
    ("*STATIC", "*DYNAMIC, EXPLICIT", "line 15: .DYNAMIC, EXPLICIT"),
    ("INC=200", "PERTURBATION", "line 14: .*PERTURBATION"),
    ("*END STEP", "", "line 14: "),
    ("*BOUNDARY\n", "*STEP\n", "line 17: .*line 14"),
    ("*STEP, NAME=push, INC=200", "", "line 23: .END STEP"),
    ("*NODE FILE", "*CONTACT FILE, TIME POINTS=T\nCDIS\n*NODE FILE", "line 21: .CONTACT FILE"),
]
CLOCK = [  # before the step, on an amplitude that counts total time
    "*STEP\n*FREQUENCY\n10\n*END STEP\n",
    "*STEP\n*STATIC, TIME RESET\n1., 2.\n*END STEP\n",
    "*STEP\n*STATIC, TOTAL TIME AT START=5.\n*END STEP\n",
    "*STEP\n*STATIC\n1., long\n*END STEP\n",
]
NODES = [  # with the afferent SA at node 3
    ("3, 1., 1., 0.", "9, 1., 1., 0.", "no .NODE of the deck defines node 3"),
    ("3, 1., 1., 0.\n", "*NGEN\n1, 3, 1\n", ".*node 3; .NGEN, line 6"),
    ("*NODE, NSET=ALL", "*NODE, NSET=ALL, SYSTEM=C", "line 3: .NODE, SYSTEM=C: node 3"),
    ("3, 1., 1., 0.", "3, 1., one, 0.", "line 6: 'one'"),
    ("*NODE,", "*SYSTEM\n1., 2., 3.\n*NODE,", "line 3: "),
    *(
        ("*AMPLITUDE, NAME=OTHER", there + "*AMPLITUDE, NAME=OTHER", "line 12: set (AFF|FEM)")
        for there in (
            "*NSET, NSET=AFFERENT_SA\n2,\n",
            "*NSET, NSET=afferent_sa\n3, 4\n",
            "*NSET, NSET=AFFERENT_SA\nALL\n",
            "*NODE, NSET=AFFERENT_SA\n9, 0., 0.\n",
            "*NSET, NSET=FEMBRIDGE_OUTPUT, GENERATE\n2, 4\n",
        )
    ),
]


@pytest.mark.parametrize(("old", "new", "begin"), CONDITION + STEP)
def test_what_cannot_hold_the_waveform_is_refused_with_its_line(old, new, begin):
    refused(changed(old, new), begin)


@pytest.mark.parametrize(("old", "new", "begin"), NODES)
def test_what_cannot_give_an_afferents_stress_is_refused(old, new, begin):
    refused(changed(old, new), begin, afferents={"SA": 3})


@pytest.mark.parametrize(("old", "new"), OWN_AMPLITUDE)
def test_an_amplitude_that_cannot_be_the_waveforms_or_has_other_users_stays(old, new):
    deck = changed(old, new)
    rebased = rebase(deck, amplitude="press")
    assert "(PRESS has other users, or cannot hold a waveform)" in str(rebased.remarks)
    text = rebased.deck.decode()
    own = "*BOUNDARY, AMPLITUDE=FEMBRIDGE_WAVEFORM\n4, 2, 2, -1.\n"
    assert own in text and text.startswith(deck[: deck.index("*STEP")])
    assert rebase(text).deck.decode() == text


@pytest.mark.parametrize("first", CLOCK)
def test_where_the_clock_is_not_known_the_waveform_counts_the_time_of_its_step(first):
    deck = changed("NAME=PRESS", "NAME=PRESS, TIME=TOTAL TIME")
    rebased = rebase(deck.replace("*STEP, NAME=push", first + "*STEP, NAME=push"))
    assert b"*AMPLITUDE, NAME=FEMBRIDGE_WAVEFORM\n0.0000000, 0.0" in rebased.deck
    assert "at what total time the step begins is not known" in str(rebased.remarks)


@pytest.mark.parametrize(
    ("options", "begin"),
    [
        ({"amplitude": "wave"}, ".*WAVE; .*PRESS .line 10., OTHER .line 12."),
        ({"amplitude": "OTHER"}, ".*OTHER; .*PRESS .line 10."),
    ],
)
def test_an_amplitude_that_the_deck_does_not_have_is_refused_with_those_it_has(options, begin):
    refused(DECK, begin, **options)


@pytest.mark.parametrize(
    ("argument", "value", "found"),
    [
        ("step", "3", "3"),
        ("results", "both", "both"),
        ("afferents", {"SA": 3, "sa": 4}, "sa"),
        *(("afferents", {name: 3}, name) for name in ("S!", "", "SA,B", "ß", "SA\n*STEP")),
    ],
)
def test_a_request_that_the_deck_cannot_meet_is_refused(argument, value, found):
    with pytest.raises(DeckError) as caught:
        rebase(DECK, **{argument: value})
    assert (caught.value.argument, caught.value.found) == (argument, found)


def test_a_step_a_file_and_an_element_that_are_not_there_are_named():
    refused("", "no .STEP in the deck")
    refused("*NODE\n1, 0., 0.\n", "no .STEP in the deck")
    refused(changed("*ELEMENT", "*INCLUDE\n*ELEMENT"), "line 8: .INCLUDE")
    alone = changed("*ELEMENT", "9, 5., 5.\n*ELEMENT")
    refused(alone, "line 8: .*node 9", dialect="abaqus", afferents={"SA": 9})


@pytest.mark.parametrize(
    "option", ["DEFINITION=Tabular", "value = relative", "TIME=STEP TIME", "SMOOTH=0."]
)
def test_options_that_say_what_is_so_anyway_are_taken(option):
    deck = changed("NAME=PRESS\n", f"NAME=PRESS, {option}\n")
    assert option.encode() in rebase(deck).deck


def test_of_two_steps_with_the_amplitude_one_has_to_be_named():
    deck = DECK + ITS_STEP.replace("push", "pull")
    refused(deck, ".*step 1 .push., line 14; step 2 .pull., line 24")
    for name in ("2", "Pull"):
        rebased = rebase(deck, step=name).deck.decode()
        assert rebased.startswith(deck[: deck.index("0., 0.")])
        assert "*STATIC\n0.1, 1.\n" in rebased[: rebased.index("pull")]
        assert "*STATIC, DIRECT\n0.0005000" in rebased[rebased.index("pull") :]
    refused(deck + "*STEP\n*STATIC\n*END STEP\n", "line 34: ", step="3")


def test_expanded_results_from_a_step_before_are_refused_for_a_set_of_nodes():
    first = "*STEP\n*STATIC\n*NODE FILE, OUTPUT=3D\nU\n*END STEP\n"
    deck = changed("*STEP", first + first.replace(", OUTPUT=3D", "") + "*STEP")
    refused(deck, "line 16: .NODE FILE, OUTPUT=3D", afferents={"SA": 3})
    rebase(deck)
    rebase(changed("*STEP", first + "*STEP"), afferents={"SA": 3})


# ---- Included files


FILES = {
    "mesh.inp": b"9, 3., 4.\n*NSET, NSET=INNER\n9\n",
    "table.txt": b"2., 0.\n",
    "boundary.inp": b"*BOUNDARY, AMPLITUDE=PRESS\n4, 2, 2, -2.\n",
    "request.inp": b"*EL FILE\nS\n",
    "end.inp": b"*END STEP\n",
    "static.inp": b"*STATIC\n0.1, 1.\n",
    "self.inp": b"*INCLUDE, INPUT=self.inp\n",
}


def test_an_amplitude_with_data_in_an_included_file_stays():
    deck = changed("*AMPLITUDE, NAME=OTHER", "*INCLUDE, INPUT=table.txt\n*AMPLITUDE, NAME=OTHER")
    assert b"AMPLITUDE=FEMBRIDGE_WAVEFORM" in rebase(deck, resolver=FILES.get).deck


@pytest.mark.parametrize(
    ("before", "name", "begin"),
    [
        ("*ELEMENT", "self.inp", "self.inp, line 1: "),
        ("*NODE FILE", "boundary.inp", "boundary.inp, line 2: magnitude -2, but -1 at line 20"),
        ("*NODE FILE", "request.inp", "request.inp, line 1: "),
        ("*NODE FILE\nU\n*END STEP\n", "end.inp", "end.inp, line 1: "),
        ("*STATIC\n0.1, 1.\n", "static.inp", "static.inp, line 1: "),
    ],
)
def test_what_would_have_to_change_in_an_included_file_is_refused(before, name, begin):
    replaced = before if name in ("end.inp", "static.inp") else ""
    new = f"*INCLUDE, INPUT={name}\n" + before.removeprefix(replaced)
    refused(changed(before, new), begin, resolver=FILES.get)


def test_a_file_that_was_not_read_is_named():
    deck = changed("*ELEMENT", "*INCLUDE, INPUT=mesh.inp\n*ELEMENT")
    refused(deck, ".*node 9; not read: mesh.inp .line 8.", afferents={"SA": 9})
    assert rebase(deck).remarks[-1].startswith("line 8: mesh.inp ")


# ---- Abaqus


def test_abaqus_rounds_an_amplitude_in_a_dynamic_step():
    deck = changed("*STATIC", "*DYNAMIC")
    refused(deck, "line 10: ", dialect="abaqus")
    for smooth in ("0", "0."):
        taken = deck.replace("NAME=PRESS\n", f"NAME=PRESS, SMOOTH={smooth}\n")
        rebase(taken, dialect="abaqus")
    refused(taken.replace("=0.\n", "=0.25\n"), "line 10: ", dialect="abaqus")
    rebase(deck, dialect="calculix")
    deck = changed("*STATIC", "*VISCO, CETOL=0.1")  # which chooses increments there
    refused(deck, "line 15: .VISCO, CETOL", dialect="abaqus")
    assert b"*VISCO, CETOL=0.1, DIRECT\n" in rebase(deck, dialect="calculix").deck


LEFT = "*INSTANCE, NAME=LEFT, PART=FINGER\n*END INSTANCE\n"
PARTS = f"""\
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
{LEFT}*INSTANCE, NAME=RIGHT, PART=FINGER
5., 0.
*END INSTANCE
*END ASSEMBLY
*AMPLITUDE, NAME=PRESS
0., 0., 1., 1.
"""


@pytest.mark.parametrize(
    ("old", "new", "begin"),
    [
        ("** none", "", ".*node 3 .*LEFT .line 5., RIGHT .line 5."),
        ("PART=FINGER\n5.", "PART=HAND\n5.", "line 13: .*HAND"),
    ],
)
def test_instances_in_which_a_node_is_ambiguous_or_absent_are_refused(old, new, begin):
    refused(PARTS.replace(old, new) + ITS_STEP, begin, afferents={"SA": 3})


def test_a_node_of_a_turned_instance_is_where_the_assembly_has_it():
    """(1, 1) of the part, shifted to (6, 1), and 90 degrees about the origin."""
    turned = "5., 0.\n0., 0., 0., 0., 0., 1., 90.\n"
    deck = PARTS.replace(LEFT, "").replace("5., 0.\n", turned) + ITS_STEP
    site = rebase(deck, afferents={"SA": 3}).sites["SA"]
    assert site.position_mm == pytest.approx((-1.0, 6.0))


@pytest.mark.parametrize(
    ("gone", "begin"),
    [
        ("*END PART\n", "line 1: "),
        ("5., 0.\n*END INSTANCE\n", "line 11: "),
        ("NAME=RIGHT, ", "line 11: .*NAME="),
        ("*END ASSEMBLY\n", "0 .END ASSEMBLY"),
    ],
)
def test_parts_and_instances_that_are_not_whole_are_refused(gone, begin):
    deck = PARTS.replace(LEFT, "").replace(gone, "") + ITS_STEP
    refused(deck, begin, afferents={"SA": 3})
