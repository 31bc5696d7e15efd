"""The procedure: commands that public ones have, in an order that makes sense."""

import re

import pytest

from decks.analysis import Contact
from decks.dialects import DeckOptions
from decks.marc.write import marc_deck, marc_files, mentat_procedure

# Of public procedures and scripts; what may follow them is in the second column.
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


@pytest.mark.parametrize(
    ("results", "post"), [("binary", []), ("text", ["ascii"]), ("both", ["both"])]
)
def test_every_command_is_one_of_public_procedures_and_says_where_it_was_seen(results, post):
    text = mentat_procedure(results=results)
    for line in spoken(text):
        word, _, rest = line.partition(" ")
        assert re.fullmatch(KNOWN[word], rest), line
    assert len(re.findall(r"^\| Seen in: .*\.\n\*", text, re.MULTILINE)) == len(spoken(text))
    assert re.findall(r"post:(\w+)", text) == post
    assert text.isascii()
    assert all(line.isprintable() and len(line) <= 88 for line in text.splitlines())


def test_the_job_is_named_as_the_deck_is_titled_and_its_first_load_case(make_model):
    lines = marc_deck(make_model()).splitlines()
    (command,) = [line for line in spoken(mentat_procedure()) if line.startswith("*edit_job")]
    job = command.split()[1]
    assert lines[0] == f"title               {job}"
    (first, *_) = [line for line in lines if line.startswith("loadcase")]
    assert first == f"loadcase            {job}"


def test_without_friction_none_is_set(make_model):
    files = marc_files(make_model(contact=Contact(friction=0.0)), DeckOptions())
    assert "coulomb" not in "".join(files.values()).lower()
