"""The clock of the day is moved: nothing that is decided may depend on it."""

import os
import threading
import time

import pytest

from fembridge.cli import main
from fembridge.io.run_folder import read_run_folder
from fembridge.solver.ccx import run_ccx, run_folders
from fembridge.solver.settings import Solver
from fembridge.solver.verdict import Cause

PATIENCE_S = 60.0
YEAR_S = 365 * 86400
YEARS = (1971, 2100)


def put_into(folder, year):
    moment_s = (year - 1970) * YEAR_S
    for path in (*folder.iterdir(), folder):
        os.utime(path, (moment_s, moment_s))


@pytest.fixture(params=[-YEAR_S, YEAR_S], ids=["back", "on"])
def moved_clock(request, monkeypatch):
    """Let the clock of the day go a year at every look."""
    now = [time.time()]

    def look():
        now[0] += request.param
        return now[0]

    monkeypatch.setattr(time, "time", look)
    monkeypatch.setattr(time, "time_ns", lambda: int(look() * 1e9))


def test_results_are_known_by_content_whatever_their_date(fake_ccx, make_run, capsys, as_in_table):
    folder = make_run("normal")
    run_folders([folder])
    for year in YEARS:
        put_into(folder, year)
        assert main(["run", str(folder)]) == 0
        as_in_table(capsys.readouterr().out.strip())

    for year, play in zip(YEARS, ("harmless", "normal"), strict=True):
        make_run(play)  # another deck
        put_into(folder, year)
        assert run_folders([folder])[0].skipped is False


def test_a_clock_that_moves_during_a_run_changes_neither_its_cost_nor_its_end(
    fake_ccx, make_run, moved_clock
):
    outcome = run_ccx(read_run_folder(make_run("normal")), Solver(time_limit_s=300))
    assert outcome.accepted
    assert 0 <= outcome.wall_s < 300


def test_a_clock_that_moves_does_not_put_off_a_limit(fake_ccx, make_run, moved_clock, as_in_table):
    halt = threading.Event()
    late = threading.Timer(PATIENCE_S, halt.set)
    late.start()
    try:
        settings = Solver(stall_limit_s=0.3)
        outcome = run_ccx(read_run_folder(make_run("hang")), settings, halt)
    finally:
        late.cancel()

    assert outcome.failure.cause is Cause.STALLED
    as_in_table(str(outcome))
