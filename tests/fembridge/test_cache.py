"""Entries of the cache: whole or none; a deck that was solved here once is not solved again."""

import json
import os
import subprocess
import sys

import pytest

from fembridge import cache
from fembridge.cli import main
from fembridge.response.indentation import in_words, increment_s
from fembridge.solver.verdict import Cause

KEY = cache.key_of({"deck": "a", "version": "2.20"})


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def results(tmp_path):
    made = tmp_path / "results"
    made.mkdir()
    (made / "job.frd").write_bytes(b"stress" * 1000)
    (made / "job.dat").write_text("force")
    return sorted(made.iterdir())


def taken(tmp_path, key=KEY):
    place = tmp_path / "place"
    place.mkdir(exist_ok=True)
    record = cache.take(key, place)
    return record, {path.name: path.read_bytes() for path in place.iterdir()}


def test_what_was_kept_comes_back(tmp_path, results):
    assert taken(tmp_path) == (None, {})
    cache.keep(KEY, "finger quick", {"wall_s": 10.5}, results)
    record, files = taken(tmp_path)
    assert record == {"wall_s": 10.5}
    assert files == {path.name: path.read_bytes() for path in results}
    assert taken(tmp_path, cache.key_of({"deck": "b", "version": "2.20"}))[0] is None


@pytest.mark.parametrize("name", ["job.frd", "job.dat", cache.ENTRY_FILE])
@pytest.mark.parametrize("damage", ["cut", "altered", "gone"])
def test_a_damaged_entry_is_never_taken(tmp_path, folder, results, name, damage):
    cache.keep(KEY, "finger quick", {}, results)
    path = folder / KEY / name
    content = path.read_bytes()
    if damage == "gone":
        path.unlink()
    else:
        path.write_bytes(content[:-1] if damage == "cut" else content[:-1] + b"#")
    assert taken(tmp_path) == (None, {})
    cache.keep(KEY, "finger quick", {}, results)
    assert taken(tmp_path)[0] == {}


def test_off_keeps_and_takes_nothing(tmp_path, monkeypatch, results):
    cache.keep(KEY, "finger quick", {}, results)
    monkeypatch.setenv(cache.VARIABLE, cache.OFF)
    assert taken(tmp_path) == (None, {})
    cache.keep(KEY, "finger quick", {}, results)
    assert cache.entries() == []


def test_a_cache_that_cannot_be_written_is_no_error(tmp_path, monkeypatch, results):
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "file" / "cache"))
    cache.keep(KEY, "finger quick", {}, results)
    assert taken(tmp_path) == (None, {})


def test_the_entries_unused_longest_make_room(folder, monkeypatch, results):
    monkeypatch.setattr(cache, "LIMIT_BYTES", 15_000)
    for number in range(3):
        key = cache.key_of({"deck": number})
        cache.keep(key, f"run {number}", {}, results)
        os.utime(folder / key / cache.ENTRY_FILE, (number, number))
    assert [entry.what for entry in cache.entries()] == ["run 2", "run 1"]


KEEP_OFTEN = """
import sys
from pathlib import Path
from fembridge import cache
key, number, *results = sys.argv[1:]
for _ in range(20):
    cache.keep(key, f"process {number}", {"number": number}, map(Path, results))
"""


def test_several_processes_leave_a_whole_entry(tmp_path, results):
    words = [sys.executable, "-c", KEEP_OFTEN, KEY]
    processes = [subprocess.Popen([*words, number, *results]) for number in "12"]
    assert [process.wait() for process in processes] == [0, 0]
    record, files = taken(tmp_path)
    assert record["number"] in "12"
    assert files == {path.name: path.read_bytes() for path in results}


def test_the_command_lists_and_clears_entries_and_nothing_else(folder, results, capsys):
    cache.keep(KEY, "finger quick, 250 um", {}, results)
    (folder / "notes").mkdir()
    assert main(["cache"]) == 0
    assert "finger quick, 250 um" in capsys.readouterr().out
    assert main(["cache", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["count"] == 1
    assert summary["bytes"] > 6000
    assert main(["cache", "--clear"]) == 0
    assert cache.entries() == []
    assert (folder / "notes").is_dir()


def files_of(folder):
    names = ("job.frd", "job.sta", "job.cvg", "solver.log", "solver.toml")
    return [(folder / name).read_bytes() for name in names]


def test_the_same_deck_in_another_folder_takes_the_same_files(solve, fake_ccx, make_run):
    first, second = make_run(name="first"), make_run(name="second")
    assert not solve(first).cached
    outcome = solve(second)
    assert outcome.accepted
    assert outcome.cached
    assert (outcome.increments, outcome.iterations) == (4, 8)
    assert files_of(second) == files_of(first)
    assert not (second / "solving").exists()


@pytest.mark.parametrize("cards", ["*INCLUDE, INPUT=mesh.inp", "*RESTART, READ"])
def test_a_deck_that_reads_other_files_is_solved_each_time(solve, fake_ccx, make_run, cards):
    deck = f"** play normal\n*HEADING\n{cards}\n"
    outcomes = [solve(make_run(name=name, deck=deck)) for name in ("first", "second")]
    assert [outcome.cached for outcome in outcomes] == [False, False]


def test_another_deck_another_program_or_no_cache_is_solved(solve, fake_ccx, make_run):
    solve(make_run(name="first"))
    other = make_run(name="other", deck="** play normal\n*HEADING\nOTHER\n")
    assert not solve(other).cached
    assert not solve(make_run(name="asked"), cache=False).cached
    fake_ccx.write_text(fake_ccx.read_text() + "\n# a later version\n")
    assert not solve(make_run(name="later")).cached


def test_what_the_solver_gave_up_is_remembered_with_its_cause(solve, fake_ccx, make_run):
    first, second = (make_run("diverged", name=name) for name in ("first", "second"))
    failure = solve(first).failure
    outcome = solve(second)
    assert outcome.cached
    assert outcome.failure == failure
    assert outcome.failure.cause is Cause.DIVERGED
    assert (second / "failed" / "cause.txt").is_file()


def test_a_limit_of_the_users_is_no_result(solve, fake_ccx, make_run):
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
