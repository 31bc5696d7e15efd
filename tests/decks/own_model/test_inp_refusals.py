"""What is missing or can be meant in two ways is refused, and its line is named."""

import pytest


def test_the_deck_itself_is_taken(rebase):
    assert b"0.0005000, 0.100000000" in rebase().deck


# ---- The amplitude


@pytest.mark.parametrize(
    ("option", "told"),
    [
        ("DEFINITION=SMOOTH STEP", "DEFINITION=SMOOTH STEP, expected TABULAR"),
        ("VALUE=ABSOLUTE", "VALUE=ABSOLUTE, expected RELATIVE"),
        ("TIME=TOTAL", "TIME=TOTAL, expected STEPTIME or TOTALTIME"),
        ("SHIFTX=0.1", "SHIFTX: what it does to a waveform is not known"),
        ("USER", "USER: what it does"),
        ("INPUT=wave.txt", "its data is in another file"),
    ],
)
def test_an_amplitude_that_is_no_plain_table_is_refused(option, told, changed, refused):
    message = refused(changed("NAME=PRESS\n", f"NAME=PRESS, {option}\n"))
    assert message.startswith("line 10: ")
    assert told in message


@pytest.mark.parametrize(
    "option", ["DEFINITION=Tabular", "value = relative", "TIME=STEP TIME", "SMOOTH=0."]
)
def test_options_that_say_what_is_so_anyway_are_taken(option, changed, rebase):
    deck = changed("NAME=PRESS\n", f"NAME=PRESS, {option}\n")
    assert option.encode() in rebase(deck).deck


def test_an_amplitude_that_is_not_there_is_refused_and_those_there_are_named(refused):
    assert refused(amplitude="wave") == (
        "no *AMPLITUDE, NAME=WAVE in the deck; it has the amplitudes PRESS (line 10), "
        "OTHER (line 12)"
    )


def test_an_amplitude_that_is_there_twice_is_refused(changed, refused):
    message = refused(changed("NAME=OTHER", "NAME=press"))
    assert message == "*AMPLITUDE, NAME=PRESS: duplicate, at line 10 and line 12; keep one"


def test_a_deck_that_moves_nothing_by_an_amplitude_is_refused(changed, refused):
    message = refused(changed("*BOUNDARY, AMPLITUDE=PRESS", "*BOUNDARY"))
    assert "give the probe's one" in message
    assert "PRESS (line 10), OTHER (line 12)" in message


def test_several_amplitudes_that_move_something_have_to_be_told_apart(changed, rebase, refused):
    deck = changed("*NODE FILE", "*BOUNDARY, AMPLITUDE=OTHER\n3, 2, 2, -1.\n*NODE FILE")
    assert refused(deck) == (
        "several amplitudes move something: PRESS (line 19), OTHER (line 21); name one"
    )
    remarks = rebase(deck, amplitude="other").remarks
    assert any(remark.startswith("line 12: amplitude OTHER") for remark in remarks)


def test_an_amplitude_that_holds_or_heats_is_no_candidate(changed, rebase):
    deck = changed("*NODE FILE", "*BOUNDARY, AMPLITUDE=OTHER\n3, 1, 2\n3, 11, 11, 20.\n*NODE FILE")
    remarks = rebase(deck).remarks
    assert any("amplitude PRESS" in remark for remark in remarks)


def test_an_amplitude_that_a_load_uses_too_is_refused(changed, refused):
    deck = changed("*NODE FILE", "*CLOAD, AMPLITUDE=press\n3, 1, 5.\n*NODE FILE")
    assert refused(deck).startswith("line 21: *CLOAD uses amplitude PRESS too")


def test_an_amplitude_without_a_condition_is_refused(refused):
    message = refused(amplitude="OTHER")
    assert message == "line 12: no *BOUNDARY of a step uses amplitude OTHER"


# ---- The condition


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        ("4, 2, 2, -1.\n3, 2, 2, -2.", "line 21: magnitude -2, but -1 at line 20"),
        ("4, 2, 2, 0.\n3, 2, 2", "line 19: the magnitudes with amplitude PRESS are 0"),
        ("4, 6, 6, -1.", "line 20: degree of freedom 6 with amplitude PRESS is no"),
        ("4, 2, 2, -1.\n3, 11, 11, 20.", "line 21: degree of freedom 11"),
        ("4, 2, 2, -one", "line 20: '-one' where a number is expected"),
        ("4, 2, x, -1.", "line 20: 'x' where a whole number is expected"),
    ],
)
def test_a_condition_that_one_depth_cannot_fill_is_refused(lines, told, changed, refused):
    deck = changed("4, 2, 2, -1.", lines)
    assert refused(deck, amplitude="PRESS").startswith(told)


@pytest.mark.parametrize(
    ("option", "told"),
    [
        ("TYPE=VELOCITY", "TYPE=VELOCITY with amplitude PRESS: the waveform is a displ"),
        ("USER", "USER and amplitude PRESS: it would not follow"),
        ("FIXED", "FIXED and"),
        ("TIME DELAY=0.1", "TIMEDELAY and"),
    ],
)
def test_a_condition_that_would_not_follow_is_refused(option, told, changed, refused):
    deck = changed("AMPLITUDE=PRESS", f"AMPLITUDE=PRESS, {option}")
    message = refused(deck, amplitude="PRESS")
    assert message.startswith("line 19: ")
    assert told in message


def test_a_condition_before_the_steps_is_refused(changed, refused):
    deck = changed("*STEP", "*BOUNDARY, AMPLITUDE=PRESS\n4, 2, 2, -1.\n*STEP")
    assert refused(deck).startswith("line 14: *BOUNDARY with amplitude PRESS is in no")


# ---- The step


def test_two_steps_with_the_amplitude_have_to_be_told_apart(deck, step, rebase, refused):
    deck = deck + step.replace("push", "pull")
    assert refused(deck) == (
        "several steps use amplitude PRESS: step 1 (push), line 14; step 2 (pull), "
        "line 24; name one"
    )
    for name in ("2", "Pull"):
        rebased = rebase(deck, step=name).deck.decode()
        assert rebased.startswith(deck[: deck.index("0., 0.")])
        assert "*STATIC\n0.1, 1.\n" in rebased[: rebased.index("pull")]
        assert "*STATIC, DIRECT\n0.0005000" in rebased[rebased.index("pull") :]


def test_a_step_that_is_not_there_or_does_not_use_it_is_refused(deck, refused):
    assert refused(step="3") == ("no step '3' in the deck; it has: step 1 (push), line 14")
    deck = deck + "*STEP\n*STATIC\n*END STEP\n"
    assert refused(deck, step="2").startswith("line 24: no *BOUNDARY here uses")


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("*STATIC\n0.1, 1.", "*FREQUENCY\n10", "line 14: a waveform needs one of"),
        ("*STATIC", "*STATIC\n*VISCO", "line 14: a waveform needs one of"),
        ("*STATIC", "*STATIC, RIKS", "line 15: *STATIC, RIKS chooses its increments"),
        ("*STATIC", "*DYNAMIC, EXPLICIT", "line 15: *DYNAMIC, EXPLICIT chooses"),
        ("INC=200", "PERTURBATION", "line 14: a PERTURBATION step"),
        ("INC=200", "INC=many", "line 14: 'many' where a whole number"),
        ("*END STEP", "", "line 14: this *STEP has no *END STEP"),
        ("*BOUNDARY\n", "*STEP\n", "line 17: *STEP inside the step of line 14"),
        ("*STEP, NAME=push, INC=200", "", "line 23: *END STEP without a *STEP"),
    ],
)
def test_a_step_that_has_no_fixed_increments_is_refused(old, new, told, changed, refused):
    assert refused(changed(old, new)).startswith(told)


def test_a_deck_without_a_step_is_refused(refused):
    assert refused("*NODE\n1, 0., 0.\n") == "no *STEP in the deck"
    assert refused("") == "no *STEP in the deck"


# ---- Total time


@pytest.fixture
def total(changed):
    return changed("NAME=PRESS", "NAME=PRESS, TIME=TOTAL TIME")


@pytest.fixture
def after(total):
    """Give a function that puts steps before that one, on the total clock."""
    return lambda first: total.replace("*STEP, NAME=push", first + "*STEP, NAME=push")


@pytest.mark.parametrize(
    ("first", "told"),
    [
        ("*STEP\n*FREQUENCY\n10\n*END STEP\n", "line 14: how long this step takes"),
        ("*STEP\n*STATIC, TIME RESET\n1., 2.\n*END STEP\n", "line 15: TIMERESET sets"),
        ("*STEP\n*STATIC, TOTAL TIME AT START=5.\n*END STEP\n", "line 15: TOTALTIMEATSTART sets"),
        ("*STEP\n*STATIC\n1., long\n*END STEP\n", "line 16: 'long' where a number"),
        ("*RESTART, READ\n", "line 14: *RESTART, READ: the total time"),
    ],
)
def test_a_clock_that_cannot_be_told_is_refused_where_it_counts(
    first, told, after, rebase, refused
):
    assert refused(after(first)).startswith(told)
    rebased = rebase(after(first).replace(", TIME=TOTAL TIME", ""))  # needs none
    assert "at what total time the step begins is not known" in str(rebased.remarks)


def test_a_step_that_sets_its_own_clock_is_refused_where_total_time_counts(total, refused):
    deck = total.replace("*STATIC", "*STATIC, TIME RESET")
    assert refused(deck).startswith("line 15: TIMERESET sets the clock")
