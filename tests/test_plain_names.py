"""Placeholder names (`one`, `found`, `what`) stay rare in each package."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
WORDS = (
    "one ones each every found held given word words known asked wanted chosen taken there here "
    "whose what which of whole place own usual unlike such thing things way ways mine ours "
    "theirs trouble"
)
PLACEHOLDERS = frozenset(WORDS.split())
# Highest share of placeholder names in percent.
MAX_PERCENT = {"decks": 0.5, "fembridge": 0.5, "neural": 0.5}


def introduced_names(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Name and line of each assignment, loop variable, parameter, function and class."""
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name, ctx=ast.Store()) | ast.arg(arg=name):
                yield name, node.lineno
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                yield name, node.lineno
            case ast.ClassDef(name=name):
                yield name, node.lineno


def is_placeholder(name: str) -> bool:
    return name.strip("_").lower() in PLACEHOLDERS


def test_names_of_every_construct_are_counted():
    source = (
        "def what(word, *, asked=1):\n"
        "    for each in asked: pass\n"
        "    with open(word) as found: pass\n"
        "    whole: int = 1\n"
        "    if (here := 1): print(given)\n"
        "    return [one for one in found]\n"
        "class _Place: ours.taken = 1\n"
    )
    names = [name for name, _ in introduced_names(ast.parse(source)) if is_placeholder(name)]
    expected = "what word asked each found whole here one _Place"
    assert sorted(names) == sorted(expected.split())


@pytest.mark.slow
@pytest.mark.parametrize("package", MAX_PERCENT)
def test_placeholder_names_are_rare(package: str):
    count = 0
    placeholders = []
    for path in sorted((ROOT / package).rglob("*.py")):
        for name, line in introduced_names(ast.parse(path.read_text(encoding="utf-8"))):
            count += 1
            if is_placeholder(name):
                placeholders.append(f"{path.relative_to(ROOT)}:{line}: {name}")
    percent = 100 * len(placeholders) / count
    assert percent <= MAX_PERCENT[package], "\n".join(placeholders)
