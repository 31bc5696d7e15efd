"""Entries of the cache: whole or none, whatever happens to them."""

import json
import os
import subprocess
import sys

import pytest

from fembridge import cache
from fembridge.cli import main

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
