"""A Marc deck is cut into options without losing a byte."""

from pathlib import Path

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from decks.marc.contents import read_marc_deck
from decks.marc.grammar import Section, is_marc_deck
from fembridge.errors import DeckError

SAMPLES = Path(__file__).parents[3] / "fixtures" / "marc_samples"
DECKS = sorted(SAMPLES.glob("*.dat"))
SMALL = (SAMPLES / "nour_linear.dat").read_bytes()
CASE = SMALL.index(b"end option")


@pytest.fixture(params=DECKS, ids=lambda path: path.stem)
def sample(request):
    return request.param


def joined(deck, data):
    return b"".join(data[option.lines[0].start : option.lines[-1].stop] for option in deck.options)


def keywords(data, section=None):
    deck = read_marc_deck(data)
    return [o.keyword for o in deck.options if section in (None, o.section)]


def with_model(*lines):
    """The small deck with lines before its end option."""
    text = "\n".join(lines) + "\n"
    return SMALL[:CASE] + text.encode() + SMALL[CASE:]


def test_every_byte_of_a_deck_belongs_to_one_option(sample):
    data = sample.read_bytes()
    deck = read_marc_deck(data)
    assert joined(deck, data) == data
    lines = [line.number for option in deck.options for line in option.lines]
    assert lines == list(range(1, data.count(b"\n") + 1))


def test_unix_and_windows_line_ends_read_alike(sample):
    unix = sample.read_bytes().replace(b"\r\n", b"\n")
    windows = unix.replace(b"\n", b"\r\n")
    assert joined(read_marc_deck(windows), windows) == windows
    assert keywords(unix) == keywords(windows)


LINES_TO_END_OPTION = SMALL[:CASE].count(b"\n") + 1
WITHOUT_LOAD_CASES = {LINES_TO_END_OPTION, LINES_TO_END_OPTION + 1}


@given(place=st.integers(1, SMALL.index(b"continue") + 6))
def test_a_deck_cut_at_any_byte_is_refused(place):
    assume(SMALL[:place].count(b"\n") + 1 not in WITHOUT_LOAD_CASES)
    assume(SMALL[:place].count(b"\n") not in WITHOUT_LOAD_CASES)
    with pytest.raises(DeckError):
        read_marc_deck(SMALL[:place])


def test_a_cut_deck_names_the_option_it_ends_in():
    lines = SMALL.splitlines(keepends=True)
    start = next(n for n, line in enumerate(lines, 1) if line.startswith(b"post"))
    with pytest.raises(DeckError) as caught:
        read_marc_deck(b"".join(lines[: start + 1]))
    assert str(caught.value).startswith(f"line {start + 1}: ")
    assert "`post`" in str(caught.value)
    assert "`end option`" in str(caught.value)


@given(data=st.data())
def test_mutated_decks_are_refused_or_read_whole(data):
    text = bytearray(SMALL)
    for _ in range(data.draw(st.integers(1, 5))):
        place = data.draw(st.integers(0, len(text) - 1))
        stop = place + data.draw(st.integers(0, 30))
        text[place:stop] = data.draw(st.binary(max_size=3))
    try:
        deck = read_marc_deck(bytes(text))
    except DeckError:
        return
    assert joined(deck, bytes(text)) == bytes(text)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\n\n",
        b"\x00\x01",
        b"   THE FOLLOWING TABLE\n",
        b"*NODE\n1, 0., 0.\n",
        b"hello\nworld\n",
        b"title\nsizing\n",
        b"one\ntwo\nend\n",
    ],
)
def test_what_is_no_marc_deck_is_refused(data):
    with pytest.raises(DeckError):
        read_marc_deck(data)


@pytest.mark.parametrize(
    ("name", "text", "is_deck"),
    [
        ("a.DAT", "$ a comment\n\nTITLE,mine\r\n", True),
        ("a.txt", "title\n", False),
        ("a.dat", " displacements (vx,vy,vz) for set ALL\n", False),
        ("a.dat", "", False),
    ],
)
def test_a_first_look_separates_decks_from_other_files(tmp_path, name, text, is_deck):
    path = tmp_path / name
    path.write_text(text)
    assert is_marc_deck(path) is is_deck
    assert not is_marc_deck(tmp_path / "absent.dat")


@pytest.mark.parametrize("name", ["control", "post", "table", "contact", "end option"])
def test_a_condition_may_be_called_like_a_keyword(name):
    lines = [
        *("define              node                set                 " + name, "1 to 3"),
        *("fixed disp", "", f"{1:10d}{0:10d}{0:10d}{0:10d}{1:10d}{0:10d}{name}"),
        *("1.0,", "0,", "1,", f"{2:10d}", name, "loadcase            job1"),
        *(f"{1:10d}", name),
    ]
    deck = read_marc_deck(with_model(*lines))
    assert deck.conditions()[-1].where == name
    (_, mine) = deck.find("loadcase", Section.MODEL)
    assert [line.text for line in mine.data] == [f"{1:10d}", name]


def test_an_included_file_is_refused_with_its_line():
    data = with_model("include, 'more.inc'")
    line = data.decode().splitlines().index("include, 'more.inc'") + 1
    with pytest.raises(DeckError, match=f"line {line}: an included file"):
        read_marc_deck(data)


def test_the_first_deck_of_several_domains_has_parameters_alone():
    root = b"title\nextended\nsizing" + b" " * 24 + b"0         0\nend\n"
    assert read_marc_deck(root).load_cases() == []
