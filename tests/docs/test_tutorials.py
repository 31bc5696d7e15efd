"""Commands of Start and the tutorials work in order, in an empty folder, and print what is shown.

A comment before a block says what it needs: ``solver`` (CalculiX), ``slow``, or ``yours`` (files of
the reader, or another system), which is not run.
"""

import os
import re
import shlex
import shutil
from pathlib import Path

import pytest

from fembridge.cli import main

DOCS = Path(__file__).parents[2] / "docs"
BLOCK = re.compile(r"(?:^<!-- ([\w, ]+) -->\n)?^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def blocks(page):
    text = (DOCS / page).read_text(encoding="utf-8")
    return [
        (set((needs or "").split(", ")), language, body)
        for needs, language, body in BLOCK.findall(text)
    ]


def lines_shown(body, printed):
    for line in filter(None, map(str.strip, body.splitlines())):
        assert line in printed, f"not printed: {line}"


def follow(page, capsys, allowed):
    """Run the blocks of a page that need nothing but what is `allowed`; the number of commands."""
    count, printed, skipped = 0, "", False
    for needs, language, body in blocks(page):
        if language == "sh":
            skipped = bool(needs - {""} - allowed)
            if skipped:
                continue
            capsys.readouterr()
            for line in body.splitlines():
                words = shlex.split(line)
                if words[0] == "fembridge":
                    assert main(words[1:]) == 0, (line, capsys.readouterr().err)
                    count += 1
            captured = capsys.readouterr()
            printed = captured.out + captured.err
        elif language == "text" and not skipped:
            lines_shown(body, printed)
        elif language == "python" and not needs - {""}:
            exec(compile(body, page, "exec"), {})
    return count


@pytest.fixture(autouse=True)
def _empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def _no_solver(monkeypatch):
    monkeypatch.setenv("PATH", "")


@pytest.mark.usefixtures("_no_solver")
@pytest.mark.filterwarnings("default")
@pytest.mark.slow
@pytest.mark.parametrize(
    "page", ["start.md", "tutorials/neuroscience.md", "tutorials/engineering.md"]
)
def test_a_reader_without_a_solver_can_follow(page, capsys):
    assert follow(page, capsys, {"slow"}) >= 2


@pytest.mark.usefixtures("_no_solver")
@pytest.mark.filterwarnings("default")
def test_the_first_results_of_an_engineer_are_as_shown(capsys):
    needs, language, commands = blocks("tutorials/engineering.md")[0]
    assert (needs, language) == ({""}, "sh")
    for line in commands.splitlines():
        assert main(shlex.split(line)[1:]) == 0
    lines_shown(blocks("tutorials/engineering.md")[1][2], capsys.readouterr().out)


@pytest.mark.solver
@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_the_map_of_the_sample_deck_is_as_shown(capsys):
    assert shutil.which("ccx", path=os.environ["PATH"])
    assert follow("tutorials/engineering.md", capsys, {"solver"}) >= 9
