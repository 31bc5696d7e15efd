"""The table of faults: its tests are there, its words are the program's and the page's."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TESTS = ROOT / "tests"
SHORTEST = 8
"""Letters of a piece of a message that say something about where it is from."""


@cache
def functions_of(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


@pytest.fixture(scope="module")
def words_of_the_program():
    """The text of our packages, with the strings whole that are written in several lines."""
    packages = (ROOT / package for package in ("fembridge", "decks", "neural"))
    texts = (path.read_text("utf-8") for each in packages for path in each.rglob("*.py"))
    return re.sub(r'"\s*\n\s*f?"', "", "\n".join(texts))


def test_every_row_names_tests_that_there_are(table):
    assert len(table) > 30
    for row in table:
        assert all((row.fault, row.done, row.seen, row.survived, row.tests)), row
        for name in row.tests:
            file, _, function = name.partition("::")
            function, _, kind = function.partition("[")
            path = TESTS / file
            assert path.is_file(), name
            assert function in functions_of(path), name
            assert kind.removesuffix("]") in path.read_text(encoding="utf-8"), name


def test_every_test_of_a_fault_has_its_row(table):
    """A fault that is tried and not documented is of use to nobody."""
    named = {name.partition("[")[0] for row in table for name in row.tests}
    for path in Path(__file__).parent.glob("test_*.py"):
        if path != Path(__file__):
            for function in functions_of(path):
                if function.startswith("test_"):
                    assert f"faults/{path.name}::{function}" in named


def test_the_words_of_every_row_are_the_program_s(table, words_of_the_program):
    """A text after "expected" may be a field of an error; `as_in_table` checks rows of faults."""
    for row in table:
        if not any(name.startswith("faults/") for name in row.tests):
            for message in row.messages:
                pieces = (piece.strip(" :;,") for piece in message.split("…"))
                for piece in pieces:
                    for part in re.split(r": |; |,? ?\bexpected ", piece):
                        if len(part) >= SHORTEST:
                            assert part in words_of_the_program, (row.fault, part)


def test_every_message_of_the_page_is_in_the_table(table):
    known = {message for row in table for message in row.messages}
    page = (ROOT / "docs" / "how_to" / "faults.md").read_text(encoding="utf-8")
    checked = set()
    for lines in re.findall(r"^\| .*\n\|[-|]+\n(?:\|.*\n)+", page, re.M):
        header, _, *rows = lines.splitlines()
        names = header.split(" | ")
        if "message" in header:
            column = next(n for n, name in enumerate(names) if "message" in name)
            messages = {
                m for row in rows for m in re.findall("`([^`]+)`", row.split(" | ")[column])
            }
            checked |= {message for message in messages if "…" in message}
    assert len(checked) > 50
    assert checked <= known
