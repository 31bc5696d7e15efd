"""The procedure: commands that public ones have, in an order that makes sense."""

import re

import pytest

from decks.dialects import DeckOptions
from decks.marc.write import mentat_procedure

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
def test_every_command_is_one_of_public_procedures_and_says_where_it_was_seen(
    results, post, make_model
):
    text = mentat_procedure(make_model(), DeckOptions(results))
    for line in spoken(text):
        word, _, rest = line.partition(" ")
        assert re.fullmatch(KNOWN[word], rest), line
    assert len(re.findall(r"^\| Seen in: .*\.\n\*", text, re.MULTILINE)) == len(spoken(text))
    assert re.findall(r"post:(\w+)", text) == post
    assert text.isascii()
    assert all(line.isprintable() and len(line) <= 88 for line in text.splitlines())
