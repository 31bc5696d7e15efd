"""Elements, nodes and sets of Marc decks; counts that do not agree are refused."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from decks.marc_grammar import read_marc_deck
from decks.marc_grammar.elements import NODES, read_elements
from decks.marc_grammar.line import split_lines
from decks.marc_grammar.mesh import read_coordinates, read_sets
from decks.marc_grammar.number_list import read_list
from fembridge.errors import DeckError

SAMPLES = Path(__file__).parents[3] / "fixtures" / "marc_samples"
PFL = read_marc_deck((SAMPLES / "pfl_example_model_0.dat").read_bytes())
SMALL = (SAMPLES / "nour_linear.dat").read_bytes()


def deck_of(elements, nodes=1, layout="extended"):
    """A deck of elements (number, type, nodes) and so many nodes."""
    ints = "".join if layout == "free" else None
    width = 10 if layout == "extended" else 5

    def row(values):
        if ints:
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


def list_of(*texts, **options):
    data = "\n".join(texts).encode()
    return read_list(split_lines(data, None), **options)


# ---- a real deck


def test_a_deck_of_mixed_elements_has_a_pressure_node_each():
    """Counts are those of its status file: 2461 elements, 5043 nodes with pressure."""
    (elements,) = PFL.elements
    assert (elements.kind, elements.node.shape) == (118, (2461, 5))
    assert (elements.geometry, elements.material, elements.body) == (1, 1, 1)
    assert len(PFL.coordinates.number) == 2582
    assert PFL.sizes == (2461, 2582 + 2461)
    pressure = elements.node[:, 4]
    assert len(np.unique(pressure)) == 2461
    assert not np.isin(pressure, PFL.coordinates.number).any()
    assert np.isin(elements.node[:, :4], PFL.coordinates.number).all()


def test_its_elements_turn_counter_clockwise():
    (elements,) = PFL.elements
    row = {int(n): r for r, n in enumerate(PFL.coordinates.number)}
    corner = np.array([[row[int(n)] for n in each[:4]] for each in elements.node])
    x, y = PFL.coordinates.position[corner, :2].transpose(2, 0, 1)
    twice = (x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(axis=1)
    assert (twice > 0).all()


def test_its_sets_have_their_members():
    sets = read_sets(PFL.find("define"))
    assert_array_equal(sets["apply1_nodes"].member, [1])
    edges = sets["apply3_edges"]
    assert (edges.kind, edges.member.shape) == ("edgemt", (42, 2))
    assert_array_equal(edges.member[[0, -1]], [[1, 0], [43, 0]])


def test_a_node_without_coordinates_has_no_place():
    assert_array_equal(PFL.coordinates.of(3), [25.0, 25.0, 0.0])
    assert PFL.coordinates.of(2591) is None


# ---- elements


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
    assert (found.geometry, found.material, found.body) == (7, 8, 9)


@pytest.mark.parametrize("count", [5, 14, 20, 27])
def test_elements_of_a_type_not_known_keep_all_their_nodes(count):
    nodes = list(range(1000, 1000 + count))
    (found,) = deck_of([(1, 999, nodes), (2, 999, nodes)]).elements
    assert_array_equal(found.node, [nodes, nodes])


def test_types_of_one_option_are_told_apart():
    found = deck_of([(1, 11, [1, 2, 3, 4]), (2, 6, [1, 2, 3])]).elements
    assert [each.kind for each in found] == [11, 6]


def test_an_element_with_too_few_nodes_is_refused():
    with pytest.raises(DeckError, match="line 6: element 1 of type 11 has 3 nodes"):
        deck_of([(1, 11, [1, 2, 3])])


def test_elements_of_a_type_have_as_many_nodes_as_its_first():
    with pytest.raises(DeckError, match="line 7: element 2 of type 999 has 3 nodes"):
        deck_of([(1, 999, [1, 2, 3, 4]), (2, 999, [1, 2, 3])])


def test_an_element_twice_is_refused_with_both_lines():
    with pytest.raises(DeckError, match="line 7: element 1 again, first on line 6"):
        deck_of([(1, 6, [1, 2, 3]), (1, 6, [1, 2, 3])])


def test_an_empty_option_holds_nothing():
    assert read_elements([]) == ()
    assert read_coordinates([]).line is None


# ---- counts


@pytest.mark.parametrize("count", [7, 9])
def test_a_deck_by_mentat_has_as_many_elements_as_it_says(count):
    said = b"         8        18         0"
    data = SMALL.replace(said, f"{count:10d}".encode() + said[10:], 1)
    with pytest.raises(DeckError, match=f"line 7: `sizing` has {count} elements"):
        read_marc_deck(data)


def test_a_deck_by_hand_may_leave_room_but_not_have_more():
    hand = SMALL.replace(b"MARC input file produced by", b"by hand, not by", 1)
    said = b"         8        18         0"
    deck = read_marc_deck(hand.replace(said, b"        12" + said[10:], 1))
    assert deck.remarks == ("8 elements, while `sizing` has room for 12",)
    with pytest.raises(DeckError, match="the deck holds 8"):
        read_marc_deck(hand.replace(said, b"         7" + said[10:], 1))


def test_a_node_that_was_lost_is_noticed():
    lines = SMALL.splitlines(keepends=True)
    start = lines.index(b"coordinates\n")
    with pytest.raises(DeckError, match=rf"line {start + 2}: 18 nodes announced"):
        read_marc_deck(b"".join(lines[: start + 5] + lines[start + 6 :]))


def test_a_line_that_is_no_node_is_named():
    data = SMALL.replace(b"coordinates\n         3", b"coordinates\n         9", 1)
    with pytest.raises(DeckError, match="9 coordinates a node, expected 1 to 6"):
        read_marc_deck(data)


# ---- lists


@given(start=st.integers(1, 50), stop=st.integers(1, 50), step=st.integers(1, 9))
def test_spans_go_up_and_down(start, stop, step):
    way = 1 if stop >= start else -1
    expected = list(range(start, stop + way, way * step))
    assert list_of(f"{start} to {stop} by {step}") == expected


@given(members=st.lists(st.integers(1, 99), min_size=1, unique=True))
def test_a_list_goes_on_behind_a_c(members):
    rows = [members[at : at + 3] for at in range(0, len(members), 3)]
    lines = ["".join(f"{each:12d}" for each in row) + "   c" for row in rows]
    lines[-1] = lines[-1].removesuffix("   c")
    assert list_of(*lines) == members


@given(first=st.sets(st.integers(1, 30)), second=st.sets(st.integers(1, 30)))
def test_lists_are_joined_as_sets_are(first, second):
    earlier = {"First": sorted(first), "second": sorted(second)}
    for word, joined in (
        ("and", first | second),
        ("except", first - second),
        ("intersect", first & second),
    ):
        assert set(list_of(f"FIRST {word} second", earlier=earlier)) == joined


def test_a_member_that_is_said_twice_is_there_once():
    assert list_of("3 1 to 4 3") == [3, 1, 2, 4]


def test_sides_of_elements_are_pairs():
    assert list_of("1:0 to 3:0 7:2", paired=True) == [(1, 0), (2, 0), (3, 0), (7, 2)]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1 to", "a list ends in 'to'"),
        ("1 tp 3", "'tp' in a list"),
        ("1:0", "'1:0' in a list"),
        ("1 to 999999999", "more than 20000000 members"),
    ],
)
def test_what_is_no_list_is_refused_with_its_line(text, words):
    with pytest.raises(DeckError, match=f"line 1: .*{words}|line 1: {words}"):
        list_of(text)


def test_a_span_from_side_to_side_is_refused():
    with pytest.raises(DeckError, match="from one side"):
        list_of("1:0 to 3:1", paired=True)


def test_a_set_without_members_is_a_set():
    text = "define              node                set                 none\n\n"
    data = SMALL.replace(b"define", text.encode() + b"define", 1)
    assert read_sets(read_marc_deck(data).find("define"))["none"].member.shape == (0,)
