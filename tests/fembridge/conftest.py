"""What tests of pictures, sweeps, commands that are refused, and of a run that is read share."""

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from fembridge.cli import main
from fembridge.host.executor import HereExecutor
from fembridge.io.run_folder import AfferentNode, RunFolder

FIXTURES = Path(__file__).parents[2] / "fixtures"
sys.path.insert(0, str(Path(__file__).parent))  # where own_block is


@pytest.fixture
def refused(tmp_path, monkeypatch, capsys):
    """Run a command in the test's folder: an exit code, one line on stderr, and no file.

    `expected` are fields of the error, such as ``argument``, ``found``, ``path`` and ``line``,
    or a text that the line contains.
    """
    monkeypatch.chdir(tmp_path)

    def check(words, expected, code=2):
        before = sorted(tmp_path.rglob("*"))
        assert main([*map(str, words), "--json"]) == code
        out, err = capsys.readouterr()
        error = json.loads(out)["error"]
        if isinstance(expected, dict):
            assert {name: error.get(name) for name in expected} == expected
        else:
            assert expected in err
        assert err == f"fembridge: {' '.join(error['message'].splitlines())}\n"
        assert sorted(tmp_path.rglob("*")) == before
        return err

    return check


@pytest.fixture
def run_folder(tmp_path):
    """A run folder with the results of the two-layer block, 4 x 0.5 ms."""
    folder = tmp_path / "run_folder"
    folder.mkdir()
    shutil.copy(FIXTURES / "frd_samples/cpe4_bin_f64.frd", folder / "job.frd")
    places = (
        AfferentNode("SA", 25, "epidermis", 1.5, 0.75, 0.25),
        AfferentNode("RA", 11, "dermis", 1.5, 0.25, 0.75),
    )
    RunFolder(folder, "calculix", 4, 0.5, 0.0, places, "0").write()
    return folder


@pytest.fixture
def unrendered(monkeypatch):
    """Let no figure be rendered, which is most of the time, nor those of many panels be made."""
    from matplotlib.figure import Figure

    def save(figure, path, dpi=None):
        path.write_bytes(b"<svg/>" if path.suffix == ".svg" else b"\x89PNG\r\n\x1a\n")

    monkeypatch.setattr("fembridge.plots.style.save_figure", save)
    for name in ("effects_figure", "regressions_figure"):
        monkeypatch.setattr(f"fembridge.plots.sensitivity_charts.{name}", lambda *of: Figure())


@pytest.fixture(scope="session")
def words_of():
    """Words of a figure that are drawn: not those of ticks beyond an axis' ends."""
    from matplotlib.text import Text

    def found(figure):
        figure.draw_without_rendering()
        hidden = set()
        for panel in figure.axes:
            for axis in (panel.xaxis, panel.yaxis):
                low, high = sorted(axis.get_view_interval())
                for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks()):
                    hidden.add(tick.label2)
                    if not low <= tick.get_loc() <= high:
                        hidden.add(tick.label1)
        words = set(figure.findobj(Text)) - hidden
        return [text for text in words if text.get_text().strip() and text.get_visible()]

    return found


@pytest.fixture(scope="session")
def check_words(words_of):
    """Words of a figure are on its page, apart, and of `least_pt` points or more."""

    def check(figure, least_pt=0.0):
        shown = words_of(figure)
        assert shown
        page = figure.bbox
        for text in shown:
            box = text.get_window_extent()
            assert text.get_fontsize() >= least_pt, text
            assert box.x0 >= page.x0 - 0.5 and box.x1 <= page.x1 + 0.5, text
            assert box.y0 >= page.y0 - 0.5 and box.y1 <= page.y1 + 0.5, text
        edges = np.array([text.get_window_extent().extents for text in shown])
        low = np.maximum(edges[:, None, :2], edges[:, :2])
        high = np.minimum(edges[:, None, 2:], edges[:, 2:])
        over = np.argwhere(np.triu(((high - low) > 1.0).all(axis=-1), k=1))
        assert not over.size, [(shown[a], shown[b]) for a, b in over[:5]]

    return check


@pytest.fixture
def in_this_process(monkeypatch):
    """A sweep starts no process."""

    def made(jobs, on_message):
        return HereExecutor(on_message)

    monkeypatch.setattr("fembridge.sweeps.sweep.LocalExecutor", made)
    return made
