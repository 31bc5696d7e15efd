"""``fembridge sweep``: words, counts and exit codes."""

import json

import pytest


def test_the_command_counts_and_ends_with_0(here, command, study_file, tmp_path, capsys):
    path = study_file('stimuli = ["sine_20_250"]\nstored = true\n')
    assert command(path, "-o", tmp_path / "out") == 0
    streams = capsys.readouterr()
    assert streams.out == f"1 of 1 items done; results.csv (3 rows): {tmp_path}/out\n"
    assert streams.err.startswith("1/1 quick, map: ")

    assert command(path, "-o", tmp_path / "out", "--json") == 0
    streams = capsys.readouterr()
    summary = json.loads(streams.out)
    assert (summary["done"], summary["finished_before"], summary["failed"]) == (1, 1, [])


def test_the_command_ends_with_1_and_one_line_when_something_failed(
    here, command, study_file, tmp_path, capsys
):
    path = study_file('stimuli = ["sine_20_500"]\nstored = true\nparameters = "published"\n')
    assert command(path, "-o", tmp_path / "out") == 1
    streams = capsys.readouterr()
    told = "fembridge: 1 of 1 items failed, first quick, map: sine_20_500 goes 500 um"
    assert streams.err.splitlines()[-1].startswith(told)
    assert (tmp_path / "out/results.csv").read_text().count("failed") == 3


def test_without_a_solver_the_whole_sweep_is_refused_at_once(
    here, command, study_file, tmp_path, capsys
):
    path = study_file('stimuli = ["sine_20_250"]\n')
    assert command(path, "-o", tmp_path / "out") == 1
    [line] = capsys.readouterr().err.splitlines()
    assert "no ccx on the PATH" in line
    assert "stored = true" in line
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--jobs", "0"], "jobs is 0"),
        (["--threads", "0"], "threads is 0"),
        (["--scheduler", "tcp://localhost:1"], "a scheduler is for the executor dask"),
    ],
)
def test_misuse_ends_with_2(here, command, study_file, tmp_path, capsys, words, told):
    path = study_file('stimuli = ["sine_20_250"]\nstored = true\n')
    assert command(path, "-o", tmp_path / "out", *words) == 2
    assert told in capsys.readouterr().err
