"""The verb ``run``: one line a folder, the exit code, the summary."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from fembridge.cli import main
from fembridge.run_folder import RunFolder
from fembridge.store import sha256_of

PLAY = """#!{python} -IS
import pathlib, sys, time
job = pathlib.Path(sys.argv[2])
words = job.with_suffix(".inp").read_text().split()
if "hang" in words:
    job.with_suffix(".pid").write_text("here")
    time.sleep(600)
if "bad" in words:
    print(" *ERROR reading *BOUNDARY: node set NOPE\\n  has not been defined.\\n")
    sys.exit(201)
job.with_suffix(".sta").write_text("SUMMARY\\n STEP\\n" + {sta!r})
job.with_suffix(".cvg").write_text("SUMMARY\\n\\n\\n\\n")
job.with_suffix(".frd").write_text({frd!r})
"""
STA = "     1          1     1     2  0.500000E-03  0.500000E-03  0.500000E-03\n"
FRD = """    1C
    1PSTEP                         1           1           1
  100CL  101 5.00000E-04           1                     0    1           1
 -4  STRESS      1    1
 -5  SXX         1    4    1    1
 -1         1 2.86526E-03
 -3
 9999
"""


@pytest.fixture
def ccx(tmp_path, monkeypatch):
    program = tmp_path / "ccx"
    program.write_text(PLAY.format(python=sys.executable, sta=STA, frd=FRD))
    program.chmod(0o755)
    monkeypatch.setenv("FEMBRIDGE_CCX", str(program))
    return program


@pytest.fixture
def make_run(tmp_path):
    def make(name, word):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "job.inp").write_text(f"** {word}\n")
        sha256 = sha256_of(folder / "job.inp")
        RunFolder(folder, "calculix", 1, 0.5, 0.0, (), sha256).write()
        return folder

    return make


def test_a_good_run_says_what_it_cost(ccx, make_run, capsys):
    folder = make_run("good", "good")

    assert main(["run", str(folder)]) == 0

    out, err = capsys.readouterr()
    assert out.startswith(f"{folder}: 1 increments, 0 iterations, ")
    assert err == ""


def test_results_that_are_there_are_said_to_be(ccx, make_run, capsys):
    folder = make_run("good", "good")
    main(["run", str(folder)])
    capsys.readouterr()

    assert main(["run", str(folder)]) == 0
    assert "has the results of this deck" in capsys.readouterr().out
    assert main(["run", "--force", str(folder)]) == 0
    assert "has the results" not in capsys.readouterr().out


def test_one_bad_folder_is_one_line_and_exit_code_1(ccx, make_run, capsys):
    good, bad = make_run("good", "good"), make_run("wrong", "bad")

    assert main(["run", str(bad), str(good), "--jobs", "2"]) == 1

    out, err = capsys.readouterr()
    assert out.count("\n") == 1
    assert out.startswith(str(good))
    assert err.count("\n") == 1
    assert err.startswith(f"fembridge: {bad}: CalculiX refused the deck: ")


def test_json_is_all_that_stdout_holds(ccx, make_run, capsys):
    good, bad = make_run("good", "good"), make_run("wrong", "bad")

    assert main(["run", str(bad), str(good), "--json"]) == 1

    summary = json.loads(capsys.readouterr().out)
    assert (summary["count"], summary["failed"], summary["skipped"]) == (2, 1, 0)
    first, second = summary["runs"]
    assert (first["folder"], first["ok"], first["cause"]) == (str(bad), False, "bad_deck")
    assert (second["ok"], second["increments"], second["problem"]) == (True, 1, None)


def test_a_deck_changed_by_hand_is_said(ccx, make_run, capsys):
    folder = make_run("good", "good")
    (folder / "job.inp").write_text("** changed\n")

    assert main(["run", str(folder)]) == 0
    assert "the deck was changed" in capsys.readouterr().err


@pytest.mark.parametrize(
    "options",
    [
        ["--jobs", "0"],
        ["--threads", "0"],
        ["--time-limit", "-1"],
        ["--stall-limit", "nan"],
        ["--iteration-limit", "0"],
        ["--jobs", "two"],
    ],
)
def test_a_number_that_means_nothing_is_misuse(tmp_path, capsys, options):
    assert main(["run", str(tmp_path), *options]) == 2
    assert capsys.readouterr().err


def test_a_folder_is_asked_for(capsys):
    assert main(["run"]) == 2
    assert "DIR" in capsys.readouterr().err


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupted_command_leaves_no_result(ccx, make_run, number, code):
    folder = make_run("long", "hang")
    command = [sys.executable, "-m", "fembridge.cli", "run", str(folder)]
    child = subprocess.Popen(command, stderr=subprocess.PIPE, env=os.environ)
    try:
        until_s = time.monotonic() + 120
        while not (folder / "solving" / "job.pid").exists():
            assert time.monotonic() < until_s
            time.sleep(0.01)
        child.send_signal(number)
        _, err = child.communicate(timeout=120)
    finally:
        child.kill()
        child.wait()

    assert child.returncode == code
    assert b"Traceback" not in err
    assert sorted(path.name for path in folder.iterdir()) == ["failed", "job.inp", "run.toml"]
