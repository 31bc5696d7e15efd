"""Decks of forces for Marc, read back by the grammar: what acts at which time."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from decks.marc.contents import read_marc_deck
from decks.marc.grammar import FileSection
from decks.marc.solid_model import held_freedoms, marc_solid_model
from decks.own_model.marc_forces import (
    SETTLING,
    linear_checks,
    marc_force_deck,
    marc_state,
    pulse_times_s,
)
from fembridge.errors import DeckError
from tests.fembridge.touching.mesh_models import block_deck
from tests.fembridge.touching.stand_in_solvers import marc_block

TEXT = marc_block(block_deck(across=2, down=2), preload_n=0.002)
FORCES = np.array([[20, 1], [20, 3], [21, 3], [20, 3]])
RAMP = "ramp\n         1         1         0         0         2\n"
SIZES = np.array([1e-4, 1e-4, 1e-4, -1e-4])


def forced(text=TEXT, after_case=1):
    """State, and the deck of `FORCES` read again."""
    state = marc_state(read_marc_deck(text.encode()), after_case)
    return state, read_marc_deck(marc_force_deck(text.encode(), state, FORCES, SIZES))


def acting(deck, time_s):
    """Force by node and axis at a time, of the last load case: values times tables."""
    tables, sets = {table.number: table for table in deck.tables}, deck.sets()
    *_, case = deck.load_cases()
    total = {}
    for condition in deck.conditions():
        if condition.family == "point load" and condition.name in case.active:
            for axis, (value, table, _) in enumerate(condition.drives, start=1):
                share = np.interp(time_s, *tables[table].points.T) if table else 1.0
                for node in sets[condition.set_name].member.tolist():
                    if value * share:
                        total[node, axis] = total.get((node, axis), 0.0) + value * share
    return total


@pytest.mark.parametrize("after_case", [0, 1])
def test_each_force_acts_alone_at_its_time_and_none_at_the_ends(after_case):
    state, deck = forced(after_case=after_case)
    preload = {}
    if after_case:
        preload = {(node, axis): 0.002 for node in (19, 21, 25, 27) for axis in (1, 3)}
    times_s = pulse_times_s(state, len(FORCES))
    assert times_s[0] == state.start_s + SETTLING == 3 + after_case
    for time_s, force in zip(times_s, [None, *range(len(FORCES)), None], strict=True):
        expected = dict(preload)
        if force is not None:
            key = tuple(FORCES[force].tolist())
            expected[key] = expected.get(key, 0.0) + SIZES[force]
        found = acting(deck, float(time_s))
        assert found.keys() == expected.keys()
        assert_allclose([found[key] for key in expected], list(expected.values()))


def test_the_load_case_takes_increments_of_one_second_and_the_options_of_the_last_one():
    _, deck = forced()
    first, case = deck.load_cases()
    assert (first.name, first.increments, first.period) == ("pulled", 4, 1.0)
    assert case.increments == SETTLING + len(FORCES) + 1 and case.period == case.increments
    assert case.active[:2] == ("held", "pull")
    controls = [
        option for option in deck.find("control", FileSection.HISTORY) if option.case == case.number
    ]
    assert controls[0].data[1].reals()[0] == 1e-3
    assert deck.post().codes == (341,) and deck.post().nodal == (1,)
    assert forced(after_case=0)[1].post().codes == (311,)


def test_later_load_cases_are_removed_and_tables_keep_their_value():
    """A ramp that would go on to 2 s stays at what it was at the end of the first load case."""
    end = TEXT[TEXT.index("title               pulled") :]
    text = TEXT + end.replace("pulled", "further")
    text = text.replace(
        " 1.0000000000000E+00 1.0000000000000E+00\nfixed",
        " 2.0000000000000E+00 2.0000000000000E+00\nfixed",
    )
    assert [case.name for case in read_marc_deck(text.encode()).load_cases()][1] == "further"
    _, deck = forced(text)
    assert [case.name for case in deck.load_cases()] == ["pulled", "fembridge_forces"]
    ramp = next(table for table in deck.tables if table.name == "ramp")
    assert_allclose(ramp.points, [[0, 0], [1, 1], [2, 1]])


def test_displacements_of_the_undeformed_model_are_held_at_0():
    moved = TEXT.replace(
        "held\n" + " 0.0000000000000E+00" * 3, "held\n" + " 1.0000000000000E-01" * 3
    )
    assert moved != TEXT
    _, deck = forced(moved, after_case=0)
    (held,) = [condition for condition in deck.conditions() if condition.name == "held"]
    assert [value for value, *_ in held.drives] == [0.0, 0.0, 0.0]
    assert all("pull" not in case.active for case in deck.load_cases())


def test_the_solid_model_is_that_of_the_same_keyword_deck():
    deck = read_marc_deck(TEXT.encode())
    model = marc_solid_model(deck)
    assert (model.node.size, model.element_count) == (27, 8)
    assert model.node_sets["TOP"].tolist() == list(range(19, 28))
    assert model.element_sets["RUBBER"].size == model.element_sets["SOFT"].size == 8
    held = held_freedoms(deck, model, ("held",))
    assert held[:9].all() and not held[9:].any()
    assert model.skin("TOP").triangles.shape == (8, 3)


@pytest.mark.parametrize(
    ("old", "new", "after_case"),
    [
        ("isotropic ", "work hard\n\nisotropic ", 0),
        ("auto load\n", "dynamic change\n", 1),
        ("time step\n", "no print\n", 1),
        (RAMP, RAMP.replace("1         0", "2         0", 1), 1),
    ],
    ids=["yielding", "inertia", "no time", "two variables"],
)
def test_a_state_that_cannot_be_held_is_refused_with_its_line(old, new, after_case):
    text = TEXT.replace(old, new, 1)
    assert text != TEXT
    with pytest.raises(DeckError, match=r"^line \d+: "):
        forced(text, after_case)


def test_a_load_case_that_is_not_there_is_refused():
    with pytest.raises(DeckError) as refused:
        forced(after_case=3)
    assert (refused.value.argument, refused.value.found) == ("after_step", 3)


def test_checks_are_spread_over_the_forces():
    assert linear_checks(11, 3) == [0, 5, 10] and linear_checks(2, 3) == [0, 1]
