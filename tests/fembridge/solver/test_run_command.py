"""The verb ``run``: one line a folder, the exit code, the summary."""

import json
import signal

import pytest

from fembridge.cli import main

pytestmark = pytest.mark.usefixtures("fake_ccx")


def test_a_good_run_says_what_it_cost_and_then_that_it_is_there(make_run, capsys):
    folder = make_run("normal")
    assert main(["run", str(folder)]) == 0
    out, err = capsys.readouterr()
    assert out.startswith(f"{folder}: 4 increments, 8 iterations, ")
    assert err == ""
    for words, is_there in (([], True), (["--force"], False)):
        assert main(["run", str(folder), *words]) == 0
        assert ("has the results" in capsys.readouterr().out) is is_there


def test_one_bad_folder_is_one_line_and_exit_code_1_and_json_names_its_cause(make_run, capsys):
    good, bad = make_run("normal", "good"), make_run("bad_deck", "wrong")

    assert main(["run", str(bad), str(good), "--jobs", "2"]) == 1
    out, err = capsys.readouterr()
    assert (out.count("\n"), err.count("\n")) == (1, 1)
    assert out.startswith(str(good)) and err.startswith(f"fembridge: {bad}: ")

    assert main(["run", str(bad), str(good), "--json"]) == 1
    summary = json.loads(capsys.readouterr().out)
    assert (summary["count"], summary["failed"], summary["skipped"]) == (2, 1, 1)
    first, second = summary["runs"]
    assert (first["folder"], first["ok"], first["cause"]) == (str(bad), False, "bad_deck")
    assert (second["ok"], second["increments"], second["problem"]) == (True, 4, None)


def test_a_deck_changed_by_hand_is_said(make_run, capsys):
    folder = make_run("normal")
    with (folder / "job.inp").open("a") as deck:
        deck.write("** changed\n")
    assert main(["run", str(folder)]) == 0
    assert str(folder) in capsys.readouterr().err


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupted_command_leaves_no_solver_no_result_and_the_evidence(
    begin, make_run, pid_of, is_alive, number, code
):
    folder = make_run("hang")
    child = begin("-m", "fembridge.cli", "run", folder)
    solver = pid_of(folder)
    child.send_signal(number)
    _, err = child.communicate(timeout=120)
    assert child.returncode == code
    assert not is_alive(solver)
    assert "Traceback" not in err
    assert sorted(path.name for path in folder.iterdir()) == ["failed", "job.inp", "run.toml"]
    assert "interrupted" in (folder / "failed" / "cause.txt").read_text()
