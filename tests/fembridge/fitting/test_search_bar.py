"""What a terminal shows of a search, and that nothing else does."""

import io
import sys

import pytest

from fembridge.fitting import search_bar
from fembridge.fitting.search_bar import SearchBar, words_of
from neural.search import Progress


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def at_once(monkeypatch):
    monkeypatch.setattr(search_bar, "PATIENCE_S", 0.0)
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setenv("TERM", "xterm")


def progress(evaluations=200):
    return Progress(evaluations, 10_000, 31, 4.256)


def test_evaluations_the_front_and_its_best_are_told():
    told = words_of(progress())
    assert told == "200/10000 evaluations, front of 31, best RMSE 4.26 ips"


def test_a_terminal_shows_the_search_of_a_class(monkeypatch, at_once):
    monkeypatch.setattr(sys, "stderr", Terminal())
    with SearchBar() as bar:
        bar("RA", progress())
        bar.end("RA")
        bar("SA", progress())
        bar("SA", progress(5000))
    shown = sys.stderr.getvalue()
    assert "RA" in shown
    assert "5000/10000 evaluations" in shown
    assert "best RMSE 4.26 ips" in shown
    assert "SA" in shown


def test_a_pipe_gets_nothing(monkeypatch, at_once):
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with SearchBar() as bar:
        bar("RA", progress())
        bar.end("RA")
    assert sys.stderr.getvalue() == ""


def test_a_search_that_is_soon_done_shows_no_bar(monkeypatch):
    monkeypatch.setattr(sys, "stderr", Terminal())
    with SearchBar() as bar:
        bar("RA", progress())
    assert sys.stderr.getvalue() == ""
