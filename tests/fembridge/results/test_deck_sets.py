"""Node sets as ccx reads them from a deck."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fembridge.errors import ResultError, UsageError
from fembridge.results.deck_sets import deck_beside, read_node_set, read_node_sets

PLAIN = """\
** a comment, with *NSET, NSET=NO
*HEADING
a model
* node , nset = All
1, 0., 0., 0.
2, 1., 0., 0.
7, 1., 1., 0.
*NODE PRINT, NSET=ALL
U
*Nset, Nset=probes, GENERATE
10, 20, 5
*NSET,
NSET=Both
7, PROBES, 7
ALL
*ELEMENT, TYPE=CPE4, ELSET=E
1, 1, 2, 7, 8
*NSET, NSET=PROBES
99
"""

# A thousand entries, named a thousand times.
TOO_MANY = "*NSET, NSET=B\n" + "1\n3\n" * 500 + "*NSET, NSET=A\n" + "B\n" * 1000


@pytest.fixture
def deck(tmp_path):
    """A function that writes a deck and gives its path."""

    def write(text, name="job.inp"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize(
    ("name", "nodes"),
    [
        ("ALL", [1, 2, 7]),
        ("all", [1, 2, 7]),
        ("Probes", [10, 15, 20, 99]),
        ("BOTH", [7, 10, 15, 20, 1, 2]),
    ],
)
def test_sets_come_in_deck_order_each_node_once_and_case_blind(deck, name, nodes):
    assert read_node_set(deck(PLAIN), name) == nodes


def test_a_print_card_and_a_comment_define_no_set(deck):
    assert list(read_node_sets(deck(PLAIN))) == ["ALL", "PROBES", "BOTH"]


def test_windows_line_ends_change_nothing(deck):
    path = deck(PLAIN)
    path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    assert read_node_set(path, "BOTH") == [7, 10, 15, 20, 1, 2]


def test_included_files_are_read_where_they_stand(deck):
    deck("*NSET, NSET=IN\n5, 6\n", "parts/mesh.inp")
    top = deck("*INCLUDE, INPUT=parts/mesh.inp\n*NSET, NSET=OUT\nIN, 9\n")
    assert read_node_set(top, "out") == [5, 6, 9]


def test_an_include_of_itself_and_of_nothing_are_errors(deck):
    with pytest.raises(ResultError, match="it includes itself"):
        read_node_sets(deck("*INCLUDE, INPUT=job.inp\n"))
    with pytest.raises(ResultError, match="no such file"):
        read_node_sets(deck("*INCLUDE, INPUT=nowhere.inp\n"))


def test_a_set_that_is_absent_is_named_beside_those_there(deck):
    with pytest.raises(UsageError, match=r"no node set 'NOPE'; it has ALL, PROBES, B"):
        read_node_set(deck(PLAIN), "NOPE")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("*NSET, NSET=A\n1, 1_0\n", r"job\.inp:2: set A names '1_0', no node and no"),
        ("*NSET, NSET=A, GENERATE\n9, 1\n", "expected first, last, step"),
        ("*NSET, NSET=A, GENERATE\n1, 9, 0\n", "expected first, last, step"),
        ("*NSET, NSET=A, GENERATE\n1, -9\n", "'-9' where a node is expected"),
        ("*NSET, NSET=A, ELSET=E\n", "is not of CalculiX"),
        ("*NSET\n1\n", "NSET without NSET="),
        ("*NODE, NSET=A\nx, 0., 0.\n", "'x' where a node is expected"),
        ("*NSET, NSET=A, GENERATE\n1, 2000000000\n", "are the most to read"),
        (TOO_MANY, "set A: more than 1000000 entries"),
        ("1" * 100_000, "no text of a solver"),
    ],
)
def test_what_cannot_be_a_set_is_an_error_with_its_line(deck, text, words):
    with pytest.raises(ResultError, match=words):
        read_node_set(deck(text), "A")


def test_the_deck_beside_a_result_has_its_stem(deck, tmp_path):
    path = deck(PLAIN)
    assert deck_beside(tmp_path / "job.frd") == path
    with pytest.raises(UsageError, match=r"no deck other\.inp beside it"):
        deck_beside(tmp_path / "other.frd")


@given(nodes=st.lists(st.integers(1, 10**9), min_size=1, max_size=60))
def test_any_list_of_nodes_comes_back_in_order(tmp_path_factory, nodes):
    path = tmp_path_factory.mktemp("deck") / "job.inp"
    rows = [nodes[k : k + 7] for k in range(0, len(nodes), 7)]
    lines = [", ".join(map(str, row)) + "," * (len(row) > 3) for row in rows]
    path.write_text("\n".join(["*NSET, NSET=N", *lines, ""]))
    assert read_node_set(path, "N") == list(dict.fromkeys(nodes))
