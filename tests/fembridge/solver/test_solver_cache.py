"""A deck that was solved once on this machine is not solved again."""

import pytest

from fembridge import cache
from fembridge.response.indentation import in_words, increment_s
from fembridge.run_folder import read_run_folder
from fembridge.solver.ccx import run_ccx
from fembridge.solver.settings import SolverSettings
from fembridge.solver.verdict import Cause


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


def solve(folder, **settings):
    return run_ccx(read_run_folder(folder), SolverSettings(**settings))


def files_of(folder):
    names = ("job.frd", "job.sta", "job.cvg", "solver.log", "solver.toml")
    return [(folder / name).read_bytes() for name in names]


def test_the_same_deck_in_another_folder_takes_the_same_files(fake_ccx, make_run):
    first, second = make_run(name="first"), make_run(name="second")
    assert not solve(first).cached

    outcome = solve(second)

    assert outcome.accepted
    assert outcome.cached
    assert (outcome.increments, outcome.iterations) == (4, 8)
    assert files_of(second) == files_of(first)
    assert not (second / "solving").exists()


@pytest.mark.parametrize("cards", ["*INCLUDE, INPUT=mesh.inp", "*RESTART, READ"])
def test_a_deck_that_reads_other_files_is_solved_each_time(fake_ccx, make_run, cards):
    deck = f"** play normal\n*HEADING\n{cards}\n"
    outcomes = [solve(make_run(name=name, deck=deck)) for name in ("first", "second")]
    assert [outcome.cached for outcome in outcomes] == [False, False]


def test_another_deck_another_program_or_no_cache_is_solved(fake_ccx, make_run):
    solve(make_run(name="first"))
    other = make_run(name="other", deck="** play normal\n*HEADING\nOTHER\n")
    assert not solve(other).cached
    assert not solve(make_run(name="asked"), cache=False).cached
    fake_ccx.write_text(fake_ccx.read_text() + "\n# a later version\n")
    assert not solve(make_run(name="later")).cached


def test_what_the_solver_gave_up_is_remembered_with_its_cause(fake_ccx, make_run):
    first, second = (make_run("diverged", name=name) for name in ("first", "second"))
    failure = solve(first).failure

    outcome = solve(second)

    assert outcome.cached
    assert outcome.failure == failure
    assert outcome.failure.cause is Cause.DIVERGED
    assert (second / "failed" / "cause.txt").is_file()


def test_a_limit_of_the_users_is_no_result(fake_ccx, make_run):
    solve(make_run("hang", name="first"), time_limit_s=0.2)
    assert cache.entries() == []


def test_a_time_in_words():
    times_s = (0.2, 9.7, 41.3, 240, 20_500, 500_000)
    assert [in_words(s) for s in times_s] == ["1 s", "10 s", "41 s", "4 min", "5.7 h", "140 h"]


def test_a_forecast_learns_from_the_runs_in_the_cache(fake_ccx, make_run, tmp_path):
    unknown_s = increment_s(3100)
    file = tmp_path / "job.frd"
    file.write_text("x")
    record = {"wall_s": 400.0, "increments": 100, "deck_bytes": 69.4 * 3100}
    cache.keep(cache.key_of({"deck": "a"}), "a", record, [file])
    assert increment_s(3100) == pytest.approx(4.0)
    assert increment_s(6200) == pytest.approx(4.0 * 2**1.15)
    assert 0 < unknown_s < 4.0
