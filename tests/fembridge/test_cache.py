"""Entries of the cache: whole or none; a deck that was solved here once is not solved again."""

import json
import os
import resource
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from decks.presets import QUICK, model_of
from fembridge.cli import main
from fembridge.errors import UsageError
from fembridge.host import cache
from fembridge.host.store import DRAFT_PREFIX, write_sealed
from fembridge.response.indentation import format_duration, increment_s, solve_response
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
    assert [entry.title for entry in cache.entries()] == ["run 2", "run 1"]


DAMAGES = {
    "folder": Path.mkdir,
    "pipe": os.mkfifo,
    "link": lambda path: path.symlink_to("/dev/zero"),
    "huge": lambda path: (path.touch(), os.truncate(path, 1 << 40)),
}


@pytest.mark.parametrize("name", ["job.frd", cache.ENTRY_FILE])
@pytest.mark.parametrize("damage", DAMAGES)
def test_an_entry_with_a_file_of_another_kind_is_made_again(
    tmp_path, folder, results, name, damage
):
    cache.keep(KEY, "finger quick", {}, results)
    path = folder / KEY / name
    path.unlink()
    DAMAGES[damage](path)
    assert taken(tmp_path) == (None, {})
    cache.keep(KEY, "finger quick", {}, results)
    assert taken(tmp_path)[0] == {}


def test_a_run_with_a_damaged_entry_is_solved_again(solve, fake_ccx, make_run, folder):
    solve(make_run(name="first"))
    (entry,) = cache.entries()
    (entry.folder / "job.frd").unlink()
    os.mkfifo(entry.folder / "job.frd")
    outcome = solve(make_run(name="second"))
    assert outcome.accepted
    assert not outcome.cached
    assert solve(make_run(name="third")).cached


def test_an_entry_of_another_key_is_none(tmp_path, folder, results):
    cache.keep(KEY, "finger quick", {}, results)
    other = cache.key_of({"deck": "b"})
    (folder / KEY).rename(folder / other)
    assert taken(tmp_path, other) == (None, {})


def test_an_entry_replaces_no_file_of_the_run(tmp_path, results):
    cache.keep(KEY, "finger quick", {}, results)
    place = tmp_path / "place"
    place.mkdir()
    (place / "job.dat").write_text("of the run")
    assert taken(tmp_path) == (None, {"job.dat": b"of the run"})


def reseal(path, change):
    table = tomllib.loads(path.read_text())
    del table["sha256"]
    change(table)
    write_sealed(path, table)


@pytest.mark.parametrize(
    "record",
    [
        {"cause": "NONE", "found": "", "version": ""},
        {"cause": ["DIVERGED"], "found": "", "version": ""},
        {"cause": "DIVERGED", "found": 1, "version": ""},
        {"cause": "KILLED", "found": "", "version": ""},
    ],
)
def test_an_entry_with_a_cause_that_is_never_kept_is_solved(solve, fake_ccx, make_run, record):
    solve(make_run("diverged", name="first"))
    (entry,) = cache.entries()
    reseal(entry.folder / cache.ENTRY_FILE, lambda table: table.update(record=record))
    outcome = solve(make_run("diverged", name="second"))
    assert not outcome.cached
    assert outcome.failure.cause is Cause.DIVERGED


def test_an_entry_without_the_files_of_a_run_is_solved(solve, fake_ccx, make_run):
    solve(make_run(name="first"))
    (entry,) = cache.entries()
    reseal(entry.folder / cache.ENTRY_FILE, lambda table: table["files"].pop("job.frd"))
    outcome = solve(make_run(name="second"))
    assert outcome.accepted
    assert not outcome.cached


@pytest.mark.parametrize(
    "record",
    [
        {"wall_s": "1", "increments": [], "deck_bytes": {}},
        {"wall_s": float("nan"), "increments": float("inf"), "deck_bytes": -1},
        {"wall_s": 1.0, "increments": 10, "deck_bytes": 0},
        {"wall_s": 1.0, "increments": 10},
    ],
)
def test_a_forecast_leaves_out_a_record_without_costs(folder, results, record):
    cache.keep(KEY, "finger quick", record, results)
    usual_s = increment_s(3100)
    cache.clear()
    assert usual_s == increment_s(3100)


KEEP_OFTEN = """
import sys
from pathlib import Path
from fembridge.host import cache
key, number, *results = sys.argv[1:]
for _ in range(20):
    cache.check_cache()
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


def files_below(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def make_foreign(parent):
    """Files of a user, in a folder that earlier versions took for an entry."""
    parent.mkdir(exist_ok=True)
    (parent / "mine").mkdir()
    (parent / "mine" / cache.ENTRY_FILE).write_text("title = 'thesis'")
    (parent / "mine" / "thesis.tex").write_bytes(b"x" * 20_000)
    return {path: path.read_bytes() for path in (parent / "mine").iterdir()}


def test_making_room_removes_entries_alone(folder, monkeypatch, results):
    monkeypatch.setattr(cache, "LIMIT_BYTES", 15_000)
    cache.keep(KEY, "finger quick", {}, results)
    before = make_foreign(folder)
    for number in range(4):
        cache.keep(cache.key_of({"deck": number}), f"run {number}", {}, results)
    assert len(cache.entries()) == 2
    assert all(path.read_bytes() == content for path, content in before.items())


@pytest.mark.parametrize("words", [["run", "run"], ["cache"], ["cache", "--clear"]])
def test_a_folder_with_files_of_others_is_refused_as_a_cache(
    here, folder, fake_ccx, make_run, capsys, words
):
    run = make_run()
    make_foreign(folder)
    before = files_below(folder)
    assert main(words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert cache.VARIABLE in line
    assert str(folder) in line
    assert files_below(folder) == before
    assert {path.name for path in run.iterdir()} == {"job.inp", "run.toml"}
    if words[0] == "run":
        assert main([*words, "--no-cache"]) == 0


def test_a_file_is_refused_as_a_cache(folder):
    folder.write_text("notes")
    with pytest.raises(UsageError, match="a file, expected a folder"):
        cache.check_cache()


def test_a_refused_cache_is_neither_read_nor_written(tmp_path, folder, results):
    cache.keep(KEY, "finger quick", {}, results)
    (folder / cache.TAG_FILE).unlink()
    make_foreign(folder)
    assert taken(tmp_path) == (None, {})
    assert cache.entries() == []
    cache.keep(cache.key_of({"deck": "b"}), "b", {}, results)
    assert {path.name for path in folder.iterdir()} == {KEY, "mine"}


def test_a_cache_of_an_earlier_version_is_taken_over(tmp_path, folder, results):
    cache.keep(KEY, "finger quick", {"wall_s": 1.5}, results)
    (folder / cache.TAG_FILE).unlink()
    reseal(folder / KEY / cache.ENTRY_FILE, lambda table: table.pop("key"))
    unfinished = folder / cache.key_of({"deck": "b"})  # a kill has left it
    unfinished.mkdir()
    (unfinished / "job.frd").touch()
    (folder / f"{DRAFT_PREFIX}abc").mkdir()
    (folder / ".DS_Store").touch()
    cache.check_cache()
    assert taken(tmp_path)[0] == {"wall_s": 1.5}
    cache.keep(cache.key_of({"deck": "c"}), "c", {}, results)
    assert (folder / cache.TAG_FILE).is_file()
    assert len(cache.entries()) == 2
    assert main(["cache", "--clear"]) == 0
    names = {path.name for path in folder.iterdir()}
    assert names == {cache.TAG_FILE, ".DS_Store", unfinished.name}


@pytest.mark.parametrize("state", ["absent", "empty", "looked at", "link"])
def test_a_new_folder_becomes_a_cache(tmp_path, folder, results, state):
    if state == "link":
        (tmp_path / "disk").mkdir()
        folder.symlink_to(tmp_path / "disk")
    elif state != "absent":
        folder.mkdir()
    if state == "looked at":
        (folder / ".DS_Store").write_bytes(b"icons")
    cache.check_cache()
    cache.keep(KEY, "finger quick", {}, results)
    assert taken(tmp_path)[0] == {}
    make_foreign(folder)
    cache.check_cache()  # it is marked


def test_a_link_as_the_mark_is_none(tmp_path, folder):
    folder.mkdir()
    (tmp_path / "tag").write_text(cache.TAG)
    (folder / cache.TAG_FILE).symlink_to(tmp_path / "tag")
    with pytest.raises(UsageError):
        cache.check_cache()


def test_the_cache_of_the_user_is_never_refused_nor_a_link_in_it_written(
    tmp_path, monkeypatch, results
):
    monkeypatch.delenv(cache.VARIABLE)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    folder = cache.cache_folder()
    folder.mkdir(parents=True)
    before = make_foreign(folder)
    (folder / cache.TAG_FILE).symlink_to(folder / "mine" / "thesis.tex")
    cache.check_cache()
    cache.keep(KEY, "finger quick", {}, results)
    assert taken(tmp_path)[0] == {}
    assert cache.clear() > 6000
    assert all(path.read_bytes() == content for path, content in before.items())


def test_a_full_disk_while_an_entry_is_kept_leaves_the_others(tmp_path, folder, results):
    cache.keep(KEY, "finger quick", {}, results)
    before = files_below(folder)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, hard))
    try:
        cache.keep(cache.key_of({"deck": "b"}), "b", {}, results)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert files_below(folder) == before
    assert len(list(folder.iterdir())) == 2


@pytest.mark.parametrize("time_s", [-1e12, 2**40])
def test_an_entry_with_an_odd_date_is_listed(folder, results, capsys, time_s):
    cache.keep(KEY, "finger quick", {}, results)
    os.utime(folder / KEY / cache.ENTRY_FILE, (0, time_s))
    assert main(["cache"]) == 0
    assert "finger quick" in capsys.readouterr().out


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
    assert [format_duration(s) for s in times_s] == [
        "1 s",
        "10 s",
        "41 s",
        "4 min",
        "5.7 h",
        "140 h",
    ]


def test_a_forecast_learns_from_the_runs_in_the_cache(fake_ccx, make_run, tmp_path):
    unknown_s = increment_s(3100)
    file = tmp_path / "job.frd"
    file.write_text("x")
    record = {"wall_s": 400.0, "increments": 100, "deck_bytes": 69.4 * 3100}
    cache.keep(cache.key_of({"deck": "a"}), "a", record, [file])
    assert increment_s(3100) == pytest.approx(4.0)
    assert increment_s(6200) == pytest.approx(4.0 * 2**1.15)
    assert 0 < unknown_s < 4.0


def test_a_forecast_is_of_the_first_run_that_the_cache_cannot_answer(
    replaying_ccx, tmp_path, logged
):
    """Asked again, the cache answers and nothing is forecast; a new deck is forecast again."""
    model = model_of(QUICK)
    forecasts = []
    for run, solved in (
        ("first", model),
        ("again", model),
        ("law", replace(model, law="neo-hookean")),
    ):
        before = len(logged)
        solve_response(tmp_path / run, solved)
        forecasts.append([line for line in logged[before:] if line.startswith("indentation to ")])
    assert [len(lines) for lines in forecasts] == [1, 0, 1]
    assert "39 increments" in forecasts[0][0]
