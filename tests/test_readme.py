"""What the README shows works as it stands there."""

import re
import tomllib
from pathlib import Path

import pytest

from decks.finger_file import finger_from
from fembridge.cli import VERBS

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


@pytest.mark.parametrize("code", blocks("python"))
def test_the_python_shown_runs(code, monkeypatch, capsys):
    monkeypatch.chdir(ROOT)

    exec(compile(code, "README.md", "exec"), {})

    assert capsys.readouterr().out.split() == ["SA", "5", "RA", "1", "PC", "4"]


@pytest.mark.parametrize("table", blocks("toml"))
def test_the_finger_shown_is_one(table):
    finger = finger_from(tomllib.loads(table), name="mine")

    assert finger.skin.epidermis_mm == 0.5
    assert finger.afferents["SA"].depth_mm == 0.70


def test_every_verb_stands_in_the_readme_and_no_other():
    shown = set(re.findall(r"`fembridge ([a-z-]+)", README))

    assert shown == set(VERBS)


def test_pictures_and_pages_that_the_readme_names_are_there():
    for name in re.findall(r"\]\((docs/[^)]+)\)", README):
        assert (ROOT / name).is_file(), name
    for name in re.findall(r"`((?:docs|tests|fixtures)/[\w./]+)`", README):
        assert (ROOT / name).exists(), name
