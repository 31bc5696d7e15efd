"""The page for Marc users asks for nothing that does not exist."""

import argparse
import re
import shlex
from importlib import import_module
from pathlib import Path

import pytest

from decks.dialects import DIALECTS, PROBES, DeckOptions
from decks.marc.write import WAVEFORM

DOCS = Path(__file__).parents[3] / "docs"
PAGE = (DOCS / "marc.md").read_text(encoding="utf-8")
COMMANDS = [
    line
    for block in re.findall(r"```sh\n(.*?)```", PAGE, flags=re.DOTALL)
    for line in block.splitlines()
] + [" ".join(words.split()) for words in re.findall(r"`(fembridge [a-z][^`]*)`", PAGE)]


@pytest.mark.parametrize("command", [c for c in COMMANDS if c.startswith("fembridge")])
def test_every_fembridge_command_is_understood(command):
    _, verb, *words = shlex.split(command.partition(" > ")[0])
    module = import_module(f"fembridge.commands.{verb.replace('-', '_')}")
    parser = argparse.ArgumentParser(exit_on_error=False)
    module.add_arguments(parser)
    parser.parse_args(words)


def test_what_the_page_says_of_the_deck_is_in_it(make_model):
    files = DIALECTS["marc"].write(make_model(), DeckOptions())
    assert set(files) == {"job.dat", "job.proc"}
    deck = files["job.dat"]
    for name in ("afferent_sa", "afferent_ra", "afferent_pc", "skin_apex", "held_nodes"):
        assert f"`{name}`" in PAGE
        assert re.search(rf"^define +node +set +{name}$", deck, flags=re.MULTILINE)
    assert f"`{WAVEFORM}`" in PAGE
    assert all(f"`{name}`" in PAGE or f" {name}`" in PAGE for name in PROBES)
    for number in DIALECTS["marc"].elements.values():
        assert f"{number}`" in PAGE
    for written in re.findall(r"`(job[_a-z0-9]*\.dat)`", PAGE):
        assert written in files or written in files["job.proc"]
