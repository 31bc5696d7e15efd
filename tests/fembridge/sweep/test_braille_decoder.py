"""The worked example of a decoder: its script, with few letters and places."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
SCRIPT = ROOT / "docs" / "examples_long" / "braille_decoder.py"


@pytest.mark.slow
def test_the_decoder_reads_letters_at_places_it_has_not_seen_and_shuffled_labels_are_chance(
    tmp_path,
):
    pytest.importorskip("sklearn")
    words = [sys.executable, str(SCRIPT), "--letters", "abcd", "--places", "10", "--jobs", "1"]
    done = subprocess.run(
        words,
        cwd=tmp_path,
        env={"PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin", "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=True,
    )

    [best] = re.findall(r"spike counts +all .* 500: ([\d.]+)", done.stdout)
    [(chance, shuffled)] = re.findall(r"chance ([\d.]+); .*: ([\d.]+)", done.stdout)
    assert float(best) > 0.8  # 1.00 when this was written
    assert float(chance) == 0.25
    assert abs(float(shuffled) - 0.25) < 0.1  # 3 seeds x 40 touches: a deviation of 0.04
    assert (tmp_path / "braille_accuracy.png").is_file()
    assert (tmp_path / "braille_confusion.png").is_file()
