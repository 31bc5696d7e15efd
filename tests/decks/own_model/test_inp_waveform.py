"""The waveform in an own deck: its scale, its clock, and the increments under it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from decks.motion import Motion
from decks.own_model.inp import rebase_inp
from decks.own_model.request import Request

DT_S = 5e-4
MOTION = Motion(np.arange(5) * DT_S, np.array([0.0, 0.1, -0.2, 0.1, 0.0]), DT_S, 0)
FIRST = "*STEP\n*STATIC\n0.1, 2.5\n*END STEP\n*STEP\n*HEAT TRANSFER\n*END STEP\n"


def deck_of(amplitude="*AMPLITUDE, NAME=A", magnitude="-1.", first="", step="*STEP"):
    return (
        f"{amplitude}\n0., 0., 1., 1.\n{first}{step}\n*STATIC\n"
        f"*BOUNDARY, AMPLITUDE=A\nPROBE, 2, 2, {magnitude}\n*END STEP\n"
    )


def rebase(deck, motion=MOTION, **request):
    return rebase_inp(deck.encode(), motion, Request(**request))


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
@pytest.mark.parametrize("length_mm", [1.0, 1000.0, 25.4, 1e-3])
def test_magnitude_times_amplitude_times_unit_is_the_depth(magnitude, length_mm):
    rebased = rebase(deck_of(magnitude=magnitude), length_mm=length_mm)
    _, value = table_of(rebased)
    size = abs(float(magnitude.replace("D", "e")))
    assert_allclose(value * size * length_mm, MOTION.depth_mm, rtol=2e-12, atol=0)


def test_step_time_starts_with_the_step_whatever_was_before():
    rebased = rebase(deck_of(first=FIRST))
    assert rebased.before_s == 3.5
    time_s, value = table_of(rebased)
    assert time_s.tolist() == MOTION.time_s.tolist()
    assert value.tolist() == MOTION.depth_mm.tolist()


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
    ("step", "new"),
    [
        ("*STEP", "*STEP, INC=130"),
        ("*STEP, NLGEOM,", "*STEP, NLGEOM, INC=130"),
        ("*step,inc=7,nlgeom  ", "*step,INC=130,nlgeom  "),
        ("*STEP, INC=130", "*STEP, INC=130"),
        ("*STEP, INC = 100000", "*STEP, INC = 100000"),
    ],
)
def test_a_limit_of_increments_is_raised_where_it_is_too_small(step, new):
    motion = Motion(np.arange(131) * DT_S, np.zeros(131), DT_S, 0)
    rebased = rebase(deck_of(step=step), motion)
    assert f"\n{new}\n*STATIC, DIRECT\n0.0005000, 0.0650000\n" in rebased.deck.decode()


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
    ],
)
def test_increments_become_fixed_as_ccx_wants_it(procedure, new):
    rebased = rebase(deck_of().replace("*STATIC", procedure))
    assert f"\n{new}\n0.0005000, 0.0020000\n" in rebased.deck.decode()


def test_abaqus_has_fixed_increments_that_do_not_stop():
    deck = deck_of().replace("*STATIC", "*STATIC, DIRECT=NO STOP").encode()
    rebased = rebase_inp(deck, MOTION, Request(), dialect="abaqus")
    assert b"\n*STATIC, DIRECT=NO STOP\n0.0005000, 0.0020000\n" in rebased.deck
    deck = deck.replace(b"*STATIC, DIRECT=NO STOP", b"*VISCO")
    rebased = rebase_inp(deck, MOTION, Request(), dialect="abaqus")
    assert b"\n*VISCO\n0.0005000, 0.0020000\n" in rebased.deck


def test_a_deck_whose_last_line_has_no_end_is_taken():
    deck = deck_of().removesuffix("\n")
    assert rebase(deck).deck.endswith(b"S\n*END STEP")
    turned = "*STEP\n*STATIC\n*BOUNDARY, AMPLITUDE=A\n1, 2, 2, -1\n*END STEP\n"
    for table in ("*AMPLITUDE, NAME=A", "*AMPLITUDE, NAME=A\n0., 0."):
        rebased = rebase(turned + table).deck
        text = rebased.decode()
        assert text[text.index("*AMPL") :].splitlines()[1].startswith("0.0000000, 0.0")
        assert rebase(text).deck == rebased
