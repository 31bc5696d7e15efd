"""What an own deck writes: U and S in every increment, at some nodes or at all."""

import numpy as np
import pytest

from decks.motion import Motion
from decks.own_model import AfferentSite, Request
from decks.own_model.inp_deck import rebase_inp, solver_of

MOTION = Motion(np.arange(3) * 5e-4, np.array([0.0, 0.1, 0.2]), 5e-4, 0)
MODEL = """\
*NODE, NSET=ALL
1, 0., 0., 0.
2, 1., 0., 0.
3, 1., 1., 0.
4, 0., 1., 0.
5, 2., 0., 0.
6, 2., 1., 0.
*ELEMENT, TYPE=CPE4, ELSET=SKIN
1, 1, 2, 3, 4
2, 2, 5, 6, 3
*AMPLITUDE, NAME=PRESS
0., 0., 1., 1.
"""
HEAD = """\
*STEP, NLGEOM
*STATIC, DIRECT
0.0005000, 0.0010000
*BOUNDARY, AMPLITUDE=PRESS
4, 2, 2, -1.
"""
WITH_SETS = {"SA": 3, "RA": 5}
SETS = """\
*NSET, NSET=AFFERENT_SA
3,
*NSET, NSET=AFFERENT_RA
5,
*NSET, NSET=FEMBRIDGE_OUTPUT
3, 5,
"""
BINARY = """\
*NODE OUTPUT, NSET=FEMBRIDGE_OUTPUT, FREQUENCY=1, DOUBLE
U
*ELEMENT OUTPUT, NSET=FEMBRIDGE_OUTPUT, FREQUENCY=1, DOUBLE
S
*END STEP
"""


def steps_of(model, requests, dialect=None, **request):
    """Rebase a deck with `requests` in its step; give what is after the model."""
    deck = f"{model}{HEAD}{requests}*END STEP\n".encode()
    rebased = rebase_inp(deck, MOTION, Request(**request), dialect=dialect)
    again = rebase_inp(rebased.deck, MOTION, Request(**request), dialect=dialect)
    assert again.deck == rebased.deck
    text = rebased.deck.decode()
    assert text.startswith(model[: model.index("0., 0., 1., 1.")])
    start = text.index("0.0000000, 0.000000000")
    return text[text.index("\n", start) + 1 :]


# ---- CalculiX


def test_the_last_increment_of_the_step_before_is_written_too():
    """It is the state at the waveform's start, which ccx writes in no other way."""
    settle = "*STEP\n*STATIC\n0.1, 1.\n"
    earlier = "*STEP\n*STATIC\n*NODE FILE, FREQUENCY=2\nU\n*END STEP\n"
    before = settle + "*NODE FILE, OUTPUT=3D\nU, RF\n*END STEP\n"
    at_end = BINARY.replace("FREQUENCY=1", "FREQUENCY=100000")
    text = steps_of(MODEL + earlier + before, "", afferents=WITH_SETS)
    assert text == SETS + earlier + settle + at_end + HEAD + BINARY


def test_expanded_results_of_the_first_step_are_made_flat_there():
    contact = "*CONTACT FILE, OUTPUT=3D\nCDIS\n"
    before = f"*STEP\n*STATIC\n0.1, 1.\n{contact}"
    text = steps_of(MODEL + before + "*END STEP\n", "", afferents=WITH_SETS)
    at_end = BINARY.replace("FREQUENCY=1", "FREQUENCY=100000, OUTPUT=2D")
    assert text == SETS + before + at_end + HEAD + BINARY


# ---- Included files


def test_nodes_and_sets_in_included_files_count():
    files = {
        "nodes.inp": b"9, 3., 4., 0.\n",
        "sets.inp": b"** sets\n*NSET, NSET=AFFERENT_PC\n9\n",
        "deeper.inp": b"*INCLUDE, INPUT=sets.inp\n",
    }
    table = MODEL.index("*ELEMENT")
    model = (
        MODEL[:table] + "*INCLUDE, INPUT=nodes.inp\n*include, input = deeper.inp\n" + MODEL[table:]
    )
    model = model.replace("2, 2, 5, 6, 3", "2, 2, 9, 6, 3")
    deck = f"{model}{HEAD}*END STEP\n".encode()
    request = Request(afferents={"PC": 9})
    rebased = rebase_inp(deck, MOTION, request, resolver=files.get)
    assert rebased.sites == {"PC": AfferentSite((3.0, 4.0))}
    assert rebased.needs == ("nodes.inp", "deeper.inp", "sets.inp")
    assert b"NSET=AFFERENT_PC" not in rebased.deck
    assert b"*NSET, NSET=FEMBRIDGE_OUTPUT\n9,\n" in rebased.deck
    assert not [remark for remark in rebased.remarks if "not read" in remark]


# ---- Abaqus: whose decks are its own, what they write, where their nodes are


FIELD = """\
*OUTPUT, FIELD, FREQUENCY=1
*NODE OUTPUT, NSET=FEMBRIDGE_OUTPUT
U,
*ELEMENT OUTPUT, ELSET=FEMBRIDGE_OUTPUT, POSITION=NODES
S,
*END STEP
"""


@pytest.mark.parametrize(
    ("deck", "whose"),
    [
        (MODEL + HEAD, "calculix"),
        ("*OUTPUT, FREQUENCY=2", "calculix"),
        ("*NODE FILE,\nU\n", "calculix"),
        ("", "calculix"),
        ("*Output, field, variable=PRESELECT", "abaqus"),
        ("*OUTPUT, HISTORY", "abaqus"),
        (" *Part, name=FINGER", "abaqus"),
        ("*Preprint, echo=NO", "abaqus"),
        ("*ELEMENT, TYPE=CPE4RH, ELSET=E", "abaqus"),
        ("*BOUNDARY,\n  AMPLITUDE=A\n", "abaqus"),
    ],
)
def test_whose_deck_it_is_shows_in_what_ccx_could_not_read(deck, whose):
    assert solver_of(deck.encode()) == whose


def test_abaqus_writes_displacement_and_the_stress_of_the_elements_around():
    around = "*ELSET, ELSET=FEMBRIDGE_OUTPUT\n1, 2,\n"
    text = steps_of(MODEL, "", afferents=WITH_SETS, dialect="abaqus")
    assert text == SETS + around + HEAD + FIELD


def test_field_requests_of_nodes_and_elements_go_and_history_and_contact_stay():
    requests = (
        "*Restart, write, frequency=0\n** FIELD\n"
        "*Output, field\n*Node Output\nU, RF\n*Element Output, directions=YES\nS,\n"
        "*Output, field, frequency=10\n*Node Output, nset=ALL\nU\n"
        "*Contact Output\nCSTRESS\n"
        "*Output, field, variable=PRESELECT\n"
        "*EL PRINT, ELSET=SKIN\nS\n*NODE FILE\nU\n"
        "*Output, history\n*Node Output, nset=ALL\nU2\n*Energy Output\nALLSE\n"
    )
    stay = (
        "*Restart, write, frequency=0\n** FIELD\n"
        "*Output, field, frequency=10\n*Contact Output\nCSTRESS\n"
        "*EL PRINT, ELSET=SKIN\nS\n*NODE FILE\nU\n"
        "*Output, history\n*Node Output, nset=ALL\nU2\n*Energy Output\nALLSE\n"
    )
    everywhere = FIELD.replace(", NSET=FEMBRIDGE_OUTPUT", "")
    everywhere = everywhere.replace(", ELSET=FEMBRIDGE_OUTPUT", "")
    assert steps_of(MODEL, requests) == HEAD + stay + everywhere


PARTS = """\
*Part, name=FINGER
*Node
1, 0., 0.
2, 1., 0.
3, 1., 1.
4, 0., 1.
*Element, type=CPE4H
1, 1, 2,
 3, 4
*Nset, nset=AFFERENT_SA
1,
*End Part
*Part, name=TIP
*Node
30, 0., 0.
*End Part
*Assembly, name=A
*Instance, name=Finger-1, part=FINGER
 0.5, -2., 0.
*End Instance
*Instance, name=Tip-1, part=TIP
*Node
31, 7., 7.
*Element, type=MASS
1, 31
*End Instance
*Node
99, 0., 0.
*End Assembly
*Amplitude, name=PRESS
0., 0., 1., 1.
"""


def test_in_an_assembly_sets_name_their_instance_and_nodes_stand_where_it_puts_them():
    deck = f"{PARTS}{HEAD}*End Step\n".encode()
    request = Request(afferents={"SA": 3, "RA": 4, "PC": 31})
    rebased = rebase_inp(deck, MOTION, request)
    positions = {name: site.position_mm for name, site in rebased.sites.items()}
    assert positions == {"SA": (1.5, -1.0), "RA": (0.5, -1.0), "PC": (7.0, 7.0)}
    names = "AFFERENT_SA, AFFERENT_RA, AFFERENT_PC, FEMBRIDGE_OUTPUT"
    assert any(remark.endswith(f"sets {names}") for remark in rebased.remarks)
    text = rebased.deck.decode()
    assert text[text.index("99, 0., 0.\n") : text.index("*Amplitude")] == (
        "99, 0., 0.\n"
        "*NSET, NSET=AFFERENT_SA, INSTANCE=Finger-1\n3,\n"
        "*NSET, NSET=AFFERENT_RA, INSTANCE=Finger-1\n4,\n"
        "*NSET, NSET=AFFERENT_PC, INSTANCE=Tip-1\n31,\n"
        "*NSET, NSET=FEMBRIDGE_OUTPUT, INSTANCE=Finger-1\n3, 4,\n"
        "*NSET, NSET=FEMBRIDGE_OUTPUT, INSTANCE=Tip-1\n31,\n"
        "*ELSET, ELSET=FEMBRIDGE_OUTPUT, INSTANCE=Finger-1\n1,\n"
        "*ELSET, ELSET=FEMBRIDGE_OUTPUT, INSTANCE=Tip-1\n1,\n"
        "*End Assembly\n"
    )
    assert rebase_inp(rebased.deck, MOTION, request).deck == rebased.deck
