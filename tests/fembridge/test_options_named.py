"""Options that messages name are options that there are."""

import argparse
import ast
import re
from importlib import import_module
from pathlib import Path

import pytest

import fembridge
from fembridge import cli

ROOT = Path(fembridge.__file__).parents[1]
OTHERS = {"--help", "--version", "--json"}
"""Of every verb; added by the command line itself."""


def options_of(parser):
    found = set(parser._option_string_actions)
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            found.update(*map(options_of, action.choices.values()))
    return found


@pytest.fixture(scope="module")
def options():
    found = set(OTHERS)
    for verb in cli.VERBS:
        parser = argparse.ArgumentParser()
        import_module(f"fembridge.commands.{verb.replace('-', '_')}").add_arguments(parser)
        found |= options_of(parser)
    return found


@pytest.mark.parametrize("package", ["fembridge", "decks", "neural"])
def test_every_option_in_a_text_of_ours_exists(options, package):
    unknown = {}
    own_script = ROOT / "fembridge" / "solver_export.py"  # with options of its own
    named = re.compile(r"(?<![\w-])--[a-z][a-z-]+[a-z]\b")
    for path in {*(ROOT / package).rglob("*.py")} - {own_script}:
        text = path.read_text(encoding="utf-8")
        if options.issuperset(named.findall(text)):  # also of comments and names: most files
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                for word in set(named.findall(node.value)) - options:
                    unknown[f"{path.relative_to(ROOT)}:{node.lineno}"] = word
    assert not unknown
