"""The procedure: commands that public ones have, in an order that makes sense."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from decks.analysis import Contact
from decks.dialects import DIALECTS, DeckOptions
from decks.marc.deck import marc_deck
from decks.marc.files import marc_files
from decks.marc.post import KINDS
from decks.marc.procedure import commands, mentat_procedure, rewritten_name
from fembridge.errors import DeckError

# Of public procedures and scripts; what may stand after them is in the second column.
KNOWN = {
    "*new_model": r"yes",
    "*import": r'marc_read "[^"]+\.dat"',
    "*edit_job": r"\w+",
    "*job_option": r"(contact_method:segment_segment|"
    r"friction_model:coulomb_bilinear|post:(both|ascii))",
    "*update_job": r"",
    "*write_marc": r'"[^"]+\.dat" yes',
}


def spoken(text):
    """Lines that Mentat acts on."""
    return [line for line in text.splitlines() if not line.startswith("|")]


@pytest.mark.parametrize("post", KINDS)
def test_every_command_is_one_of_public_procedures(post):
    for line in spoken(mentat_procedure(post=post)):
        word, _, rest = line.partition(" ")
        assert re.fullmatch(KNOWN[word], rest), line


def test_the_deck_is_read_told_and_written_under_another_name():
    assert spoken(mentat_procedure("job.dat")) == [
        "*new_model yes",
        '*import marc_read "job.dat"',
        "*edit_job job1",
        "*job_option contact_method:segment_segment",
        "*job_option friction_model:coulomb_bilinear",
        "*job_option post:both",
        "*update_job",
        '*write_marc "job_s2s.dat" yes',
    ]


def test_the_job_is_named_as_the_deck_is_titled_and_its_first_load_case(make_model):
    lines = marc_deck(make_model()).splitlines()
    (command,) = [line for line in spoken(mentat_procedure()) if line.startswith("*edit_job")]
    job = command.split()[1]
    assert lines[0] == f"title               {job}"
    (first, *_) = [line for line in lines if line.startswith("loadcase")]
    assert first == f"loadcase            {job}"


@pytest.mark.parametrize(
    ("post", "options"), [("binary", []), ("formatted", ["ascii"]), ("both", ["both"])]
)
def test_the_kind_of_post_file_is_the_decks(post, options):
    found = re.findall(r"post:(\w+)", mentat_procedure(post=post))
    assert found == options


def test_each_command_says_what_it_is_for_and_where_it_was_seen():
    text = mentat_procedure("mine.dat")
    for command in commands("mine.dat", "both"):
        assert f"Seen in: {command.source}.\n{command.text}\n" in text
        assert command.purpose.splitlines()[0] in text
    assert "none was run here" in text


def test_lines_are_printable_ascii():
    text = mentat_procedure()
    assert text.isascii()
    assert all(line.isprintable() and len(line) <= 88 for line in text.splitlines())


@given(st.text(max_size=20))
def test_a_name_is_taken_whole_or_refused(name):
    try:
        text = mentat_procedure(name)
    except DeckError:
        return
    assert f'*import marc_read "{name}"' in text.splitlines()
    assert name != rewritten_name(name)


@pytest.mark.parametrize("name", ["", 'a".dat', "a\nb.dat", "größe.dat", "a|b", "#.dat"])
def test_a_name_that_ends_the_command_is_refused(name):
    with pytest.raises(DeckError, match="deck name"):
        mentat_procedure(name)


def test_an_unknown_kind_of_post_file_is_refused():
    with pytest.raises(DeckError, match="post 'text', expected one of binary"):
        mentat_procedure(post="text")


@pytest.mark.parametrize(
    ("results", "post"),
    [(None, "both"), ("both", "both"), ("text", "formatted"), ("binary", "binary")],
)
def test_a_run_folder_has_the_deck_and_its_procedure(make_model, results, post):
    analysis = make_model()
    files = marc_files(analysis, DeckOptions(results=results, probe="meshed"))
    assert files == {
        DIALECTS["marc"].deck: marc_deck(analysis, probe="meshed", post=post),
        "job.proc": mentat_procedure("job.dat", post=post),
    }


def test_without_friction_mentat_is_told_of_none(make_model):
    analysis = make_model(contact=Contact(friction=0.0))
    files = marc_files(analysis, DeckOptions())
    assert "coulomb" not in "".join(files.values()).lower()
    assert "contact with no friction" in files["job.dat"]


def test_the_dialect_writes_through_it(make_model):
    model = make_model()
    files = DIALECTS["marc"].write(model, DeckOptions())
    assert files["job.dat"] == marc_deck(model)
