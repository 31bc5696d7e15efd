"""The benchmark of post files runs, and reads back what it wrote."""

import importlib
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_post_files_are_made_and_read_at_a_small_size(monkeypatch, capsys, tmp_path):
    monkeypatch.syspath_prepend(str(ROOT))
    program = importlib.import_module("benchmarks.marc_post")

    program.main(["--megabytes", "1", "--folder", str(tmp_path)])

    out = capsys.readouterr().out
    assert out.count("|") > 10
    assert "increments" in out
