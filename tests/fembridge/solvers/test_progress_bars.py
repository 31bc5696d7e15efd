"""What a terminal shows, and that nothing else does."""

import io
import sys
from pathlib import Path

import pytest

from fembridge.solvers.progress_bars import ProgressBars, words_of
from fembridge.solvers.watchdog import Progress


def progress(elapsed_s=10.0, increment=5, folder="runs/sine_20_250", ended=False):
    return Progress(
        folder=Path(folder),
        increment=increment,
        increments=500,
        time_ms=0.5 * increment,
        end_ms=250.0,
        iterations=17,
        iterations_here=2,
        elapsed_s=elapsed_s,
        ended=ended,
    )


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.mark.parametrize(
    ("increment", "elapsed_s", "left"),
    [(5, 10.0, ", 16:30 left"), (5, 100.0, ", 2:45:00 left"), (0, 10.0, "")],
)
def test_the_time_left_is_at_the_pace_so_far(increment, elapsed_s, left):
    told = words_of(progress(elapsed_s, increment))
    assert told == f"{increment}/500 increments, 17 iterations{left}"


def test_a_terminal_shows_a_bar_a_run(monkeypatch):
    monkeypatch.setattr(sys, "stderr", Terminal())
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setenv("TERM", "xterm")
    long_name = "study/" + "x" * 40
    with ProgressBars() as bars:
        bars(progress())
        bars(progress(increment=250))
        bars(progress(folder=long_name))
    shown = sys.stderr.getvalue()
    assert "runs/sine_20_250" in shown
    assert "…" + long_name[-27:] in shown
    assert "1%" in shown


def test_a_bar_goes_when_its_run_ends(monkeypatch):
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setenv("TERM", "xterm")
    with ProgressBars() as bars:
        bars(progress())
        bars(progress(folder="runs/other", ended=True))  # it never had one
        bars(progress(ended=True))
        before = terminal.tell()
        bars(progress(folder="runs/next"))
    assert "runs/sine_20_250" in terminal.getvalue()[:before]
    assert "runs/next" in terminal.getvalue()[before:]
    assert bars.shown == ("runs/next",)


def test_the_first_two_seconds_show_nothing(monkeypatch):
    monkeypatch.setattr(sys, "stderr", Terminal())
    with ProgressBars() as bars:
        bars(progress(elapsed_s=1.9))
    assert sys.stderr.getvalue() == ""


def test_where_there_is_no_terminal_nothing_is_shown(capsys):
    with ProgressBars() as bars:
        bars(progress())
    assert capsys.readouterr().err == ""


def test_nothing_is_shown_after_the_end(monkeypatch):
    monkeypatch.setattr(sys, "stderr", Terminal())
    with ProgressBars() as bars:
        pass
    bars(progress())
    assert sys.stderr.getvalue() == ""
