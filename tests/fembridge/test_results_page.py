"""Every command and every line of Python in docs/how_to/results.md works as it stands."""

import re
import shlex
import shutil
from pathlib import Path

import pytest

from fembridge.cli import main

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "how_to" / "results.md").read_text(encoding="utf-8")
COMMANDS = re.findall(r"^fembridge (ingest [^#\n]+)", PAGE, re.MULTILINE)
PYTHON = re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


@pytest.fixture(autouse=True)
def jobs(tmp_path, monkeypatch, run_folder):
    """A folder with a user's job beside a run folder of fembridge."""
    samples = ROOT / "fixtures" / "frd_samples"
    for suffix in ("frd", "dat", "sta", "cvg"):
        shutil.copy(samples / f"cpe4_ascii.{suffix}", tmp_path / f"job.{suffix}")
    (tmp_path / "job.inp").write_text("*NSET, NSET=PROBES\n11, 25\n")
    monkeypatch.syspath_prepend(Path(__file__).parent / "results" / "marc")
    _write_marc_job(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def _write_marc_job(folder):
    """A post file with a layer boundary at x = 4, a deck, a status file, a plot."""
    import post_writer as writer
    import stress_models as models

    plane = models.Plane(11, *models.grid(6, 3), layers=[0, 0, 0, 0, 1, 1] * 3)
    increments = plane.increments(
        lambda x, y, layer, t: [t * x, 0, 0, 0, 0, 0], (0.0, 0.001, 0.002)
    )
    model = plane.model(sets=(("probes", 1, (13, 21), ()),))
    content = writer.post_bytes(writer.Storage(), model, increments)
    (folder / "job.t16").write_bytes(content)
    samples = ROOT / "fixtures" / "marc_samples"
    shutil.copy(samples / "nour_plastic.sts", folder / "marc.sts")
    shutil.copy(samples / "nour_plastic.dat", folder / "deck.dat")
    rows = "".join(f"{k * 0.0005:g}\t{k}\n" for k in range(6))
    head = "Time Node 2\tEquivalent Von Mises Stress Node 2\n"
    (folder / "history.txt").write_text(head + rows)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_of_the_page_works(command, jobs, capsys):
    words = shlex.split(command)
    assert main(words) == 0
    assert capsys.readouterr().out
    outputs = [words[k + 1] for k, word in enumerate(words) if word in ("-o", "--vtu")]
    assert all((jobs / output).exists() for output in outputs)


@pytest.mark.parametrize("lines", PYTHON)
def test_the_python_of_the_page_works(lines):
    exec(compile(lines, "results.md", "exec"), {"fb": __import__("fembridge")})
