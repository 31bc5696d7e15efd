"""Every command and every line of Python in docs/results.md works as it stands."""

import re
import shlex
import shutil
from pathlib import Path

import pytest

from fembridge.cli import main
from fembridge.run_folder import AfferentNode, RunFolder

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
COMMANDS = re.findall(r"^fembridge (ingest [^#\n]+)", PAGE, re.MULTILINE)
PYTHON = re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


@pytest.fixture(autouse=True)
def jobs(tmp_path, monkeypatch):
    """A folder with a user's job and a run folder of fembridge."""
    samples = ROOT / "fixtures" / "frd_samples"
    for suffix in ("frd", "dat", "sta", "cvg"):
        shutil.copy(samples / f"cpe4_ascii.{suffix}", tmp_path / f"job.{suffix}")
    (tmp_path / "job.inp").write_text("*NSET, NSET=PROBES\n11, 25\n")
    folder = tmp_path / "run_folder"
    folder.mkdir()
    shutil.copy(samples / "cpe4_bin_f64.frd", folder / "job.frd")
    places = (AfferentNode("SA", 25, "epidermis", 1.5, 0.75, 0.25),)
    RunFolder(folder, "calculix", 4, 0.5, 0.0, places, "0").write()
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_of_the_page_works(command, jobs, capsys):
    words = shlex.split(command)
    assert main(words) == 0
    assert capsys.readouterr().out
    outputs = [words[k + 1] for k, word in enumerate(words) if word in ("-o", "--vtu")]
    assert all((jobs / output).exists() for output in outputs)


@pytest.mark.parametrize("lines", PYTHON)
def test_the_python_of_the_page_works(lines):
    exec(compile(lines, "results.md", "exec"), {"fembridge": __import__("fembridge")})


def test_the_page_has_commands_python_and_a_place_for_the_benchmark():
    assert len(COMMANDS) >= 10
    assert len(PYTHON) >= 3
    assert "<!-- benchmark -->" in PAGE
    assert "<!-- /benchmark -->" in PAGE
