"""The bytes of a keyword deck: nothing is lost, and blocks and sets are found where they are."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from decks.inp import Text, blocks_in, node_sets, read_inp
from decks.unit_system import UNIT_SYSTEMS, unit_system_in
from fembridge.errors import DeckError


def block_of(data, keyword, abaqus=False):
    text = Text(data)
    (block,) = (one for one in blocks_in(text, abaqus=abaqus) if one.keyword == keyword)
    return text, block


lines = st.one_of(
    st.binary(max_size=12),
    st.sampled_from(
        [
            b"*STEP",
            b" *Step , inc = 7 ,",
            b"** comment",
            b"* * comment",
            b"*HEADING",
            b"1, 2, 3,",
            b'*NSET, NSET="a,b"',
            b"\t*\tnode file,",
            b"x=1",
            b"*",
            b"",
        ]
    ),
)
ends = st.sampled_from([b"\n", b"\r\n", b"\n\n"])
decks = st.lists(st.tuples(lines, ends), max_size=12).map(
    lambda pairs: b"".join(line + end for line, end in pairs)
)


@given(data=st.one_of(decks, st.binary(max_size=200)), abaqus=st.booleans())
def test_blocks_one_after_another_are_the_deck(data, abaqus):
    cards = blocks_in(Text(data), abaqus=abaqus)
    before = cards[0].start if cards else len(data)
    pieces = [data[card.start : card.pieces[0].stop] for card in cards]
    assert data[:before] + b"".join(pieces) == data
    for card in cards:
        assert card.start < card.head <= card.body <= card.pieces[0].stop
        assert card.line == data[: card.start].count(b"\n") + 1
        assert data[card.start : card.head].lstrip(b" \t").startswith(b"*")
        for row in card.rows():
            assert card.body <= row.start < row.stop <= card.pieces[0].stop
            assert row.line == data[: row.start].count(b"\n") + 1
        for option in card.options:
            assert card.start < option.start < option.stop <= card.head


@pytest.mark.parametrize(
    "line",
    [
        b"*Amplitude, name=Press, time=total time",
        b"\t* AMPLITUDE ,NAME = PRESS\t, TIME=TOTALTIME  ",
        b'*amplitude,Name="Press",Time = Total Time\r',
    ],
)
def test_blanks_case_and_quotes_do_not_count(line):
    text, card = block_of(b"** first\n" + line + b"\n0., 0.\n", "AMPLITUDE")
    assert card.line == 2
    assert [(one.name, one.normalized) for one in card.options] == [
        ("NAME", "PRESS"),
        ("TIME", "TOTALTIME"),
    ]
    (row,) = card.rows()
    assert (row.line, row.fields) == (3, ("0.", "0."))
    assert text.data[card.start : card.head] == line.rstrip()


def test_a_keyword_line_that_ends_in_a_comma_goes_on_as_its_solver_has_it():
    file = b"*NODE FILE,\nU\n"
    text, card = block_of(file, "NODEFILE")  # ccx takes the next line for data
    assert [row.fields for row in card.rows()] == [("U",)]
    text, card = block_of(file, "NODEFILE", abaqus=True)
    assert [one.name for one in card.options] == ["U"]

    step = b"*STEP, NLGEOM,\n  INC=7,\n** not this\nA title\n"
    text, card = block_of(step, "STEP")  # which ccx could not read as data
    assert card.option("INC").normalized == "7"
    assert text.data[card.start : card.head] == b"*STEP, NLGEOM,\n  INC=7,"
    assert text.data[card.option("INC").start : card.option("INC").stop] == b"INC=7"
    assert [row.line for row in card.rows()] == [4]


def test_a_comma_in_quotes_parts_no_words_and_a_star_in_the_first_column_ends_a_heading():
    _, card = block_of(b'*NSET, NSET="a, b", UNSORTED\n1\n', "NSET")
    assert [(one.name, one.value) for one in card.options] == [("NSET", "a, b"), ("UNSORTED", None)]
    deck = b"*HEADING\n  *STEP is what I say\n*NODE\n1, 0.\n"
    assert [card.keyword for card in blocks_in(Text(deck))] == ["HEADING", "NODE"]


# ---- Sets of nodes

SETS = b"""\
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


def nodes_of(deck, **options):
    found = node_sets(read_inp(deck, **options))
    return {name: [n for run in runs for n in run] for name, runs in found.items()}


@pytest.mark.parametrize("end", [b"\n", b"\r\n"])
def test_sets_come_in_deck_order_and_may_name_sets_before_them(end):
    assert nodes_of(SETS.replace(b"\n", end)) == {
        "ALL": [1, 2, 7],
        "PROBES": [10, 15, 20, 99],
        "BOTH": [7, 10, 15, 20, 7, 1, 2, 7],
    }


def test_included_files_are_read_where_they_are():
    files = {"parts/mesh.inp": b"*NSET, NSET=IN\n5, 6\n"}
    top = b"*INCLUDE, INPUT=parts/mesh.inp\n*NSET, NSET=OUT\nIN, 9\n"
    assert nodes_of(top, resolver=files.get) == {"IN": [5, 6], "OUT": [5, 6, 9]}
    top = b"*INCLUDE, INPUT=job.inp\n"  # itself
    with pytest.raises(DeckError, match=r"job\.inp"):
        read_inp(top, resolver={"job.inp": top}.get)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("*NSET, NSET=A\n1, 1_0\n", 2),
        ("*NSET, NSET=A\n\nNOPE\n", 3),
        ("*NSET, NSET=A, GENERATE\n9, 1\n", 2),
        ("*NSET, NSET=A, GENERATE\n1, 9, 0\n", 2),
        ("*NSET, NSET=A, GENERATE\n1, -9\n", 2),
        ("*NSET, NSET=A, ELSET=E\n", 1),
        ("*NSET\n1\n", 1),
        ("*NODE, NSET=A\nx, 0., 0.\n", 2),
    ],
)
def test_what_cannot_be_a_set_is_an_error_with_its_line(text, line):
    with pytest.raises(DeckError, match=f"^line {line}: "):
        nodes_of(text.encode())


@given(nodes=st.lists(st.integers(1, 10**9), min_size=1, max_size=60))
def test_any_list_of_nodes_comes_back_in_order(nodes):
    rows = [nodes[k : k + 7] for k in range(0, len(nodes), 7)]
    lines = [", ".join(map(str, row)) + "," * (len(row) > 3) for row in rows]
    assert nodes_of("\n".join(["*NSET, NSET=N", *lines, ""]).encode()) == {"N": nodes}


# ---- Units by the name that a heading gives

METRES = {"mm": 1e-3, "m": 1.0, "in": 0.0254}


@pytest.mark.parametrize("name", UNIT_SYSTEMS)
def test_stress_is_force_over_length_squared(name):
    found = unit_system_in(f"Hash: wQ2k, Date: 04/23/2022, Unit system: {name}\n")
    assert found is not None and found.name == name
    metre = METRES[found.length_unit]
    assert found.length_mm == pytest.approx(1e3 * metre, rel=1e-15)
    assert found.stress_pa == pytest.approx(found.force_n / metre**2, rel=1e-14)


@pytest.mark.parametrize(
    "heading",
    ["", "Unit system: UNIT_LESS", "Unit system: Undefined", "in M_KG_S_C", "Unit system"],
)
def test_a_heading_that_names_no_units_says_nothing(heading):
    assert unit_system_in(heading) is None
