"""The waveform in an own deck: its scale, its clock, and the increments under it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from decks.motion import Motion
from decks.own_model import AfferentSite, Request
from decks.own_model.inp_deck import rebase_inp
from decks.unit_system import LENGTH_UNITS, UNIT_SYSTEMS
from fembridge.errors import DeckError, UsageError

DT_S = 5e-4
MOTION = Motion(np.arange(5) * DT_S, np.array([0.0, 0.1, -0.2, 0.1, 0.0]), DT_S, 0)
FIRST = "*STEP\n*STATIC\n0.1, 2.5\n*END STEP\n*STEP\n*HEAT TRANSFER\n*END STEP\n"


def deck_of(amplitude="*AMPLITUDE, NAME=A", magnitude="-1.", first="", step="*STEP"):
    return (
        f"{amplitude}\n0., 0., 1., 1.\n{first}{step}\n*STATIC\n"
        f"*BOUNDARY, AMPLITUDE=A\nPROBE, 2, 2, {magnitude}\n*END STEP\n"
    )


def rebase(deck, motion=MOTION, dialect=None, **request):
    """The deck with the waveform, which changes nothing when it is put in again."""
    rebased = rebase_inp(deck.encode(), motion, Request(**request), dialect=dialect)
    again = rebase_inp(rebased.deck, motion, Request(**request), dialect=dialect)
    assert again.deck == rebased.deck
    return rebased


def table_of(rebased):
    """Times and values of the first amplitude, by a plain reading of its lines."""
    lines = rebased.deck.decode().splitlines()
    start = next(k for k, line in enumerate(lines) if line.startswith("*AMPLITUDE"))
    numbers = []
    for line in lines[start + 1 :]:
        if line.startswith("*"):
            break
        assert line.count(",") <= 7
        numbers += [float(word) for word in line.split(",")]
        assert max(len(word.strip()) for word in line.split(",")) <= 20
    return np.array(numbers).reshape(-1, 2).T


@pytest.mark.parametrize("magnitude", ["-1.", "1", "+2.5D-1", "-0.05", "-3e-4", ".7"])
def test_magnitude_times_amplitude_times_unit_is_the_depth(magnitude):
    size = abs(float(magnitude.replace("D", "e")))
    for name, unit in LENGTH_UNITS.items():
        _, value = table_of(rebase(deck_of(magnitude=magnitude), length_unit=name))
        assert_allclose(value * size * unit.length_mm, MOTION.depth_mm, rtol=2e-12, atol=0)


def test_total_time_starts_where_the_steps_before_end_and_is_zero_until_then():
    total = "*AMPLITUDE, TIME=TOTAL TIME, NAME=A"
    time_s, value = table_of(rebase(deck_of(total)))
    assert time_s.tolist() == MOTION.time_s.tolist()

    rebased = rebase(deck_of(total, first=FIRST))  # 2.5 s, and 1 s without a number
    time_s, value = table_of(rebased)
    assert_allclose(time_s, [0.0, *(3.5 + MOTION.time_s)], rtol=1e-15)
    assert value.tolist() == [0.0, *MOTION.depth_mm]
    assert any("begins at 3.5 s of total time" in one for one in rebased.remarks)
    assert rebased.before_s == 3.5


@pytest.mark.parametrize(
    ("procedure", "new"),
    [
        ("*STATIC", "*STATIC, DIRECT"),
        ("*STATIC,", "*STATIC, DIRECT"),
        ("*static,solver=SPOOLES ", "*static,solver=SPOOLES, DIRECT "),
        ("*Static, direct", "*Static, direct"),
        ("*STATIC, DIRECT=NO STOP", "*STATIC, DIRECT"),
        ("*DYNAMIC, ALPHA=-0.1", "*DYNAMIC, ALPHA=-0.1, DIRECT"),
        ("*VISCO, CETOL=1.E-3", "*VISCO, CETOL=1.E-3, DIRECT"),
        ("*Static, Solver=Pardiso", "*Static, DIRECT"),
        ("*STATIC, SOLVER=PASTIX, DIRECT", "*STATIC, DIRECT"),
    ],
)
def test_increments_become_fixed_as_ccx_wants_it(procedure, new):
    rebased = rebase(deck_of().replace("*STATIC", procedure))
    assert f"\n{new}\n0.0005000, 0.0020000\n" in rebased.deck.decode()


def test_abaqus_has_fixed_increments_that_do_not_stop():
    for procedure in ("*STATIC, DIRECT=NO STOP", "*VISCO"):
        rebased = rebase(deck_of().replace("*STATIC", procedure), dialect="abaqus")
        assert f"\n{procedure}\n0.0005000, 0.0020000\n".encode() in rebased.deck


def test_a_deck_whose_last_line_has_no_end_is_taken():
    deck = deck_of().removesuffix("\n")
    assert rebase(deck).deck.endswith(b"S\n*END STEP")
    turned = "*STEP\n*STATIC\n*BOUNDARY, AMPLITUDE=A\n1, 2, 2, -1\n*END STEP\n"
    for table in ("*AMPLITUDE, NAME=A", "*AMPLITUDE, NAME=A\n0., 0."):
        rebased = rebase(turned + table).deck
        text = rebased.decode()
        assert text[text.index("*AMPL") :].splitlines()[1].startswith("0.0000000, 0.0")
        assert rebase(text).deck == rebased


# ---- Where the steps before have put the probe


def two_steps(first, curve="0., 0.", second="*BOUNDARY, AMPLITUDE=A\nPROBE, 2, 2, -0.5"):
    return (
        "*NODE, NSET=PROBE\n7, 0., 1.\n8, 1., 1.\n*NSET, NSET=MORE\nPROBE, 9\n"
        f"*AMPLITUDE, NAME=A\n{curve}\n*STEP, NLGEOM\n*STATIC\n0.1, 2.\n{first}*END STEP\n"
        f"*STEP\n*STATIC\n{second}\n*END STEP\n"
    )


@pytest.mark.parametrize(
    ("first", "stands_mm"),
    [
        ("*BOUNDARY\nPROBE, 2, 2, -0.3\n", 0.3),
        ("*BOUNDARY\nprobe, 1, 3, 0.1\n", -0.1),
        ("*BOUNDARY\nMORE, 2, 2, -0.3\n", 0.3),  # a set that has all its nodes
        ("*BOUNDARY\nPROBE, 2, 2, -0.3\nPROBE, 2, 2, -0.4\n", 0.4),
        ("*BOUNDARY\n7, 1, 1, -0.3\n", None),  # another direction: free along y
        ("*BOUNDARY\nPROBE, 2, 2\n9, 2, 2, -1.\n", 0.0),
        ("*CLOAD\n7, 2, -1.\n", None),
        ("", 0.0),
        ("*BOUNDARY\n7, 2, 2, -0.3\n", None),  # a part of it
        ("*BOUNDARY, TYPE=VELOCITY\nPROBE, 2, 2, -0.3\n", None),
        ("*BOUNDARY, AMPLITUDE=B\nPROBE, 2, 2, -0.4\n", 0.2),
        ("*BOUNDARY, AMPLITUDE=T\nPROBE, 2, 2, -0.4\n", 0.4),
        ("*BOUNDARY\nPROBE, 2, 2, -0.3\n*END STEP\n*STEP\n*STATIC\n1., 1.\n", 0.3),
        (
            "*BOUNDARY\nPROBE, 2, 2, -0.3\n*END STEP\n*STEP\n*STATIC\n1., 1.\n"
            "*BOUNDARY, OP=NEW\n9, 2, 2, -0.1\n",
            None,
        ),
        (
            "*BOUNDARY\nPROBE, 2, 2, -0.3\n*END STEP\n*STEP\n*STATIC\n1., 1.\n"
            "*BOUNDARY, FIXED\nPROBE, 2, 2\n",
            0.3,
        ),
    ],
)
@pytest.mark.parametrize("curve", ["0., 0., 1., 1.", "0., 0.6, 1., 1."])
def test_the_waveform_begins_where_the_steps_before_leave_the_probe(first, stands_mm, curve):
    """A probe that jumped up by its pre-indentation left no word of it."""
    curves = (
        "\n*AMPLITUDE, NAME=B\n0., 0., 4., 1.\n*AMPLITUDE, NAME=T, TIME=TOTAL TIME\n0., 0., 2., 1."
    )
    deck = two_steps(first, curve + curves)
    if stands_mm is None:
        with pytest.raises(DeckError, match=r"^line \d+: .*(PROBE|VELOCITY|displacement)"):
            rebase(deck, amplitude="A")
        return
    rebased = rebase(deck, amplitude="A")
    _, value = table_of(rebased)
    assert_allclose(0.5 * value, stands_mm + MOTION.depth_mm, rtol=1e-12, atol=1e-15)
    assert rebased.stands_mm == pytest.approx(stands_mm)
    assert any(f"leave PROBE {stands_mm:g} mm deep" in one for one in rebased.remarks) == bool(
        stands_mm
    )


def test_an_amplitude_that_another_step_needs_stays_and_the_waveform_gets_its_own():
    first = "*BOUNDARY, AMPLITUDE=A\nPROBE, 2, 2, -0.5\n"
    deck = two_steps(first, "0., 0., 2., 1.")
    rebased = rebase(deck, step="2")
    text = rebased.deck.decode()
    assert "*AMPLITUDE, NAME=A\n0., 0., 2., 1.\n*AMPLITUDE, NAME=FEMBRIDGE_WAVEFORM\n" in text
    assert text.count("*BOUNDARY, AMPLITUDE=A\n") == 1
    assert "*BOUNDARY, AMPLITUDE=FEMBRIDGE_WAVEFORM\nPROBE, 2, 2, -0.5\n" in text
    assert rebased.stands_mm == pytest.approx(0.5)
    assert rebase(text, step="2", amplitude="A").deck == rebased.deck


# ---- A displacement without an amplitude


RAMP = """\
*STEP, NLGEOM
*STATIC
*Boundary, op=New
** Name: Press
*Boundary
PROBE, 1, 1, 0
PROBE, 2, 2, -0.0002
** after
*Cload, op=New
*END STEP
"""
MOVED = "*BOUNDARY, AMPLITUDE=FEMBRIDGE_WAVEFORM\nPROBE, 2, 2, -0.0002\n** after\n"


@pytest.mark.parametrize("move", [None, "PROBE,2", "probe, 2", "PROBE,-2"])
def test_a_ramp_becomes_the_waveform_by_an_amplitude_of_its_own(move):
    rebased = rebase(RAMP, move=move)
    text = rebased.deck.decode()
    assert text.startswith("*AMPLITUDE, NAME=FEMBRIDGE_WAVEFORM\n")
    assert f"** Name: Press\n*Boundary\nPROBE, 1, 1, 0\n{MOVED}" in text
    _, value = table_of(rebased)
    assert_allclose(2e-4 * value, MOTION.depth_mm, rtol=1e-12, atol=1e-15)
    assert rebase(text).deck == rebased.deck


@pytest.mark.parametrize(("move", "sign"), [("PROBE,-1", -1), ("PROBE,+2", 1), ("PROBE,-2", 0)])
def test_a_sign_says_which_way_is_into_the_skin(move, sign):
    rebased = rebase(RAMP, move=move)
    text = rebased.deck.decode()
    axis = move[-1]
    line = f"PROBE, {axis}, {axis}, {sign}." if sign else "PROBE, 2, 2, -0.0002"
    assert f"*BOUNDARY, AMPLITUDE=FEMBRIDGE_WAVEFORM\n{line}\n" in text
    _, value = table_of(rebased)
    assert_allclose(value * (1 if sign else 2e-4), MOTION.depth_mm, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize(
    ("deck", "move", "said"),
    [
        (RAMP, "PROBE,1", "line 6: PROBE,1 is held at 0"),
        (RAMP, "PIN,2", "no .BOUNDARY .* PIN,2; .*: PROBE,2 .line 7.; PROBE,1"),
        (RAMP.replace("0.0002", "0"), None, "no .BOUNDARY of a step moves anything"),
        (RAMP.replace("1, 1, 0", "1, 1, 3."), None, "line 1: several .*PROBE,1 .* --move PROBE,1"),
        (RAMP.replace("2, 2, -", "2, 3, -"), "PROBE,2", "line 7: degrees of freedom 2 to 3"),
        (RAMP.replace("Boundary\n", "Boundary, fixed\n"), "PROBE,2", "line 5: .*FIXED"),
    ],
)
def test_a_displacement_that_cannot_be_meant_is_refused_and_the_others_named(deck, move, said):
    with pytest.raises(DeckError, match=f"^{said}"):
        rebase(deck, move=move)


@pytest.mark.parametrize("move", ["PROBE", "PROBE,", ",2", "PROBE,4", "PROBE,y", "PROBE,0"])
def test_a_word_that_is_no_set_and_degree_of_freedom_is_misuse(move):
    with pytest.raises(UsageError, match="expected NSET,DOF"):
        Request(move=move)


def test_a_displacement_of_another_size_keeps_its_amplitude():
    deck = deck_of(magnitude="-0.05").replace("-0.05", "-0.05\nWALL, 1, 1, 0.3")
    with pytest.raises(DeckError, match="--move WALL,1 gives"):
        rebase(deck)
    rebased = rebase(deck, move="PROBE,2")
    text = rebased.deck.decode()
    assert text.startswith(deck[: deck.index("*STEP")])
    assert "*BOUNDARY, AMPLITUDE=FEMBRIDGE_WAVEFORM\nPROBE, 2, 2, -0.05\n" in text


def test_steps_after_the_waveform_are_left_out():
    """A run that went on past the waveform was solved and then refused."""
    later = "*STEP\n*STATIC\n*BOUNDARY\nPROBE, 2, 2, 0.\n*END STEP\n"
    rebased = rebase(RAMP + later + "** end\n" + later, move="PROBE,2", step="1")
    assert rebased.deck == rebase(RAMP + "** end\n").deck
    assert sum("left out to *END STEP" in one for one in rebased.remarks) == 2


# ---- Increments and units


def test_automatic_increments_end_at_the_samples():
    rebased = rebase(RAMP, increments="automatic")
    text = rebased.deck.decode()
    points = "*TIME POINTS, NAME=FEMBRIDGE_TIMES, GENERATE\n0.0005000, 0.0020000, 0.0005000\n"
    assert points + "*STEP" in text
    assert "\n*STATIC\n0.0005000, 0.0020000, 0.000000050, 0.0005000\n" in text
    assert "*NODE OUTPUT, TIME POINTS=FEMBRIDGE_TIMES, DOUBLE\n" in text
    fixed = rebase(RAMP).deck.decode()
    assert "*STATIC\n0.0005" in rebase(fixed, increments="automatic").deck.decode()
    longer = Motion(np.arange(9) * DT_S, np.zeros(9), DT_S, 0)
    again = rebase(text, longer, increments="automatic").deck
    assert again == rebase(RAMP, longer, increments="automatic").deck


@pytest.mark.parametrize(
    ("card", "large"),
    [("", True), ("*CONTACT PAIR, TYPE=NODE TO SURFACE\n", False), ("*HYPERELASTIC\n", False)],
)
def test_a_linear_step_which_ccx_makes_in_one_increment_becomes_nonlinear(card, large):
    deck = card + RAMP.replace(", NLGEOM", "")
    rebased = rebase(deck)
    assert (b"*STEP, NLGEOM\n" in rebased.deck) == large
    assert any("NLGEOM put in" in one for one in rebased.remarks) == large
    assert b"NLGEOM" not in rebase(deck, dialect="abaqus").deck


HEADING = "*Heading\nHash: x, Date: 1/2/2024, Unit system: {}\n"


@pytest.mark.parametrize("name", UNIT_SYSTEMS)
def test_the_heading_says_in_which_unit_the_waveform_is(name):
    units = UNIT_SYSTEMS[name]
    rebased = rebase(HEADING.format(name) + RAMP)
    _, value = table_of(rebased)
    assert_allclose(2e-4 * value * units.length_mm, MOTION.depth_mm, rtol=1e-12, atol=1e-15)
    assert rebased.units == units
    assert any(f"line 1: *HEADING: unit system {name}" in one for one in rebased.remarks)
    rebased = rebase(HEADING.format(name) + RAMP, length_unit="mm")  # an option counts
    assert rebased.units.length_unit == "mm"
    said = any("taken to be in mm all the same" in one for one in rebased.remarks)
    assert said == (units.length_unit != "mm")
    assert rebase(HEADING.format("UNIT_LESS") + RAMP).units.length_unit == "mm"


@pytest.mark.parametrize(
    ("nodes", "unit", "said"),
    [
        ("1, 0., 0.\n2, 0.016, 0.02\n", None, "waveform moves 0.3 mm and the model is 0.02 mm"),
        ("1, 0., 0.\n2, 16., 20.\n", None, ""),
        ("1, 0., 0.\n2, 0.016, 0.02\n", "m", ""),
    ],
)
def test_a_model_of_no_likely_size_is_said(nodes, unit, said):
    remarks = rebase(f"*NODE\n{nodes}{RAMP}", length_unit=unit).remarks
    assert any("unit of length" in one and said in one for one in remarks) == bool(said)


@pytest.mark.parametrize(("kind", "place"), [("C3D8", (1.0, 2.0, 3.0)), ("CPE4", (1.0, 2.0))])
def test_a_node_of_a_solid_model_has_z(kind, place):
    deck = f"*NODE\n5, 1., 2., 3.\n*ELEMENT, TYPE={kind}\n1, 5\n" + RAMP
    assert rebase(deck, afferents={"SA": 5}).sites == {"SA": AfferentSite(place)}
