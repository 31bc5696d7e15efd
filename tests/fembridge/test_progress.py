"""What a terminal shows, and that nothing else does."""

import io
import sys
from dataclasses import replace
from pathlib import Path

import pytest

import fembridge as fb
from fembridge.cli import main
from fembridge.fitting.fit import SearchBar
from fembridge.host.progress import Progress, advance, showing
from fembridge.host.terminal import Bars, SolverBars, TaskBars, how_far
from neural.search import SearchProgress


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
        has_ended=ended,
    )


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def terminal(monkeypatch):
    def make():
        stream = Terminal()
        monkeypatch.setattr(sys, "stderr", stream)  # in the test: pytest sets it at its begin
        return stream

    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setenv("TERM", "xterm")
    return make


@pytest.mark.parametrize(
    ("increment", "elapsed_s", "left"),
    [(5, 10.0, ", 0:16:30 left"), (5, 100.0, ", 2:45:00 left"), (0, 10.0, "")],
)
def test_the_time_left_is_at_the_pace_so_far(increment, elapsed_s, left):
    assert how_far(progress(elapsed_s, increment)).endswith(f"17 iterations{left}")


def test_the_share_and_the_words_of_a_bar_are_of_one_quantity():
    late = replace(progress(increment=23), time_ms=170.0)  # automatic increments, after a step
    assert how_far(late).startswith("170 of 250 ms, 23 increments")
    assert late.fraction == 0.68


def test_a_terminal_shows_a_bar_a_run(terminal):
    stream = terminal()
    long_name = "study/" + "x" * 40
    with SolverBars(0) as bars:
        bars(progress())
        bars(progress(increment=250))
        bars(progress(folder=long_name))
    shown = stream.getvalue()
    assert "runs/sine_20_250" in shown
    assert "…" + long_name[-27:] in shown
    assert "1%" in shown


def test_a_bar_goes_when_its_run_ends(terminal):
    stream = terminal()
    with SolverBars(0) as bars:
        bars(progress())
        bars(progress(folder="runs/other", ended=True))  # it never had one
        bars(progress(ended=True))
        before = stream.tell()
        bars(progress(folder="runs/next"))
    assert "runs/sine_20_250" in stream.getvalue()[:before]
    assert "runs/next" in stream.getvalue()[before:]
    assert "runs/sine_20_250" not in stream.getvalue()[before:]


def test_a_terminal_shows_the_search_of_a_class(terminal):
    stream = terminal()
    with SearchBar(0) as bar:
        bar("RA", SearchProgress(200, 10_000, 31, 4.256))
        bar.remove("RA")
        bar("SA", SearchProgress(5000, 10_000, 31, 4.256))
    shown = stream.getvalue()
    assert "RA" in shown
    assert "5000/10000 evaluations" in shown
    assert "best RMSE 4.26 ips" in shown


def test_the_first_seconds_show_nothing_and_after_the_end_nothing_comes(terminal):
    stream = terminal()
    with Bars() as bars:
        bars.show("runs", 0.5)
    with Bars(0) as bars:
        pass
    bars.show("runs", 0.5)
    assert stream.getvalue() == ""


def test_where_there_is_no_terminal_a_run_gets_a_line_now_and_then(capsys, monkeypatch):
    clock_s = [0.0]
    monkeypatch.setattr("fembridge.host.terminal.perf_counter", lambda: clock_s[0])
    with SolverBars() as bars, SolverBars(shows=False) as silent:
        for clock_s[0] in range(100):
            bars(progress(elapsed_s=clock_s[0], increment=5 * clock_s[0]))
            silent(progress(elapsed_s=clock_s[0]))
        bars(progress(folder="runs/next"))
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(",")[0] for line in lines] == [
        *("runs/sine_20_250: 30%", "runs/sine_20_250: 60%", "runs/sine_20_250: 90%"),
        "runs/next: 1%",
    ]
    assert lines[0].endswith("150 increments, 17 iterations, 0:01:10 left")


def test_tasks_have_bars_on_a_terminal_and_no_lines_elsewhere(terminal, capsys, monkeypatch):
    clock_s = [0.0]
    monkeypatch.setattr("fembridge.host.terminal.perf_counter", lambda: clock_s[0])
    with TaskBars() as bars:
        for clock_s[0] in range(100):
            bars("contact", clock_s[0] / 100)
    assert capsys.readouterr().err == ""
    stream = terminal()
    with TaskBars(0) as bars:
        bars("contact", 0.5)
    assert "contact" in stream.getvalue()


@pytest.mark.parametrize(
    ("compute", "tasks"),
    [
        (lambda: fb.touch("sphere", press_um=100, population="one_each"), {"contact"}),
        (lambda: fb.touch("plate", press_um=400, population="one_each"), {"contact"}),
        (
            lambda: fb.touch(
                "dots",
                trajectory=fb.Trajectory.slide(40, press_um=150, duration_ms=30),
                population="one_each",
            ),
            {"contact"},
        ),
        (
            lambda: fb.receptive_field("SA", step_mm=2, depth_um=[200], units=1),
            {"field of SA"},
        ),
        (lambda: fb.threshold(["PC"], [100, 200]), {"thresholds of PC"}),
        (lambda: fb.PadProbe(ridges="none", positions=1).response, {"probe on the pad"}),
    ],
    ids=["press", "deep", "slide", "field", "threshold", "probe"],
)
def test_long_computations_report_their_progress_up_to_the_end(compute, tasks):
    reports = []
    with showing(lambda task, share: reports.append((task, share))):
        compute()
    assert {task for task, _ in reports} >= tasks
    for task in {task for task, _ in reports}:
        shares = [share for name, share in reports if name == task]
        assert min(shares) >= 0
        assert max(shares) == shares[-1] == 1
    count = len(reports)
    advance("contact", 0.5)  # nobody looks any more
    assert len(reports) == count


def test_a_slide_shows_a_bar_on_a_terminal_unless_it_is_quiet(terminal, here, monkeypatch):
    words = ["touch", "--shape", "dots", "--press-um", "150", "--slide-mm-per-s", "40"]
    words += ["--duration-ms", "30", "--population", "one_each", "--no-plot", "-o", "out"]
    monkeypatch.setattr("fembridge.host.terminal.PATIENCE_S", 0.0)
    monkeypatch.setattr(Bars.__init__, "__defaults__", (0.0,))
    stream = terminal()
    assert main(words) == 0
    assert "contact" in stream.getvalue()
    stream = terminal()
    assert main([*words, "--quiet"]) == 0
    assert "contact" not in stream.getvalue()
