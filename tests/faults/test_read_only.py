"""A folder that can be read and not written; root is kept out by the mount alone."""

import json
import os
from pathlib import Path

import pytest

from decks.presets import stored_mesh
from fembridge.cli import main

NOBODY = 65534
PROGRAM = """
import contextlib, io, json, sys
from fembridge.cli import main
shown = []
for words in json.loads(sys.argv[1]):
    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
        code = main(words)
    shown.append([code, said.getvalue().splitlines()])
print(json.dumps(shown))
"""
BUILD = ["build-deck", "--stimulus", "sine_20_250", "-o"]
COMMANDS = [
    [*BUILD, "{place}/runs"],
    ["stimuli", "--export", "csv", "sine_20_250", "-o", "{place}/a.csv"],
    ["run", "{place}"],
    ["simulate", "--stored", "--no-plot", "--stimulus", "sine_20_250", "-o", "{place}"],
]


@pytest.mark.slow
def test_a_read_only_folder_is_said_in_one_line_and_finished_results_in_it_are_taken(
    fake_ccx, apart, make_run, files_below, as_in_table
):
    folder, finished = make_run("normal", "read only"), make_run("normal", "finished")
    assert main(["run", str(finished)]) == 0
    mount = "\n".join(
        f'mount --bind "{each}" "{each}"; mount -o remount,bind,ro "{each}"'
        for each in (folder, finished)
    )
    before = [files_below(each) for each in (folder, finished)]
    commands = [[word.format(place=folder) for word in words] for words in COMMANDS]

    shown = json.loads(apart(mount, PROGRAM, json.dumps([*commands, ["run", str(finished)]])))

    assert [code for code, _ in shown] == [1, 1, 1, 1, 0]
    *_, (_, last) = shown
    del last[last.index("next:") :]
    assert [len(lines) for _, lines in shown] == [1, 1, 1, 3, 1]  # of simulate two on the model
    for _, lines in shown:
        as_in_table(lines[-1].removeprefix("fembridge: "))
    assert [files_below(each) for each in (folder, finished)] == before


@pytest.fixture
def not_ours(make_run, monkeypatch, tmp_path):
    """Work in a run folder that belongs to somebody else, who lets us read it."""
    folder = make_run("normal")
    monkeypatch.setenv("FEMBRIDGE_CCX", "/bin/sh")  # found, never started
    assert main([*BUILD, str(tmp_path)]) == 0  # all is imported while we may
    before = os.geteuid()
    monkeypatch.chdir(folder)
    folder.chmod(0o555)
    if before == 0:
        os.seteuid(NOBODY)
    try:
        if not os.access(stored_mesh("quick"), os.R_OK, effective_ids=True):
            pytest.skip("not root, and this package is for root alone")
        yield folder
    finally:
        os.seteuid(before)
        folder.chmod(0o755)


@pytest.mark.parametrize("verb", ["build-deck", "run"])
def test_a_folder_without_permission_is_said_in_one_line(not_ours, capsys, refused, verb):
    capsys.readouterr()
    refused(*(["run", "."] if verb == "run" else [*BUILD, "runs"]))
    names = sorted(path.name for path in Path().iterdir())
    assert names == ["job.inp", "run.toml"]
