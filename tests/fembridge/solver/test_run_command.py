"""The verb ``run``: a line a folder, exit codes; and however we are ended, the solver ends too."""

import json
import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from fembridge.cli import main
from fembridge.host.process import signals_as_exits, start, stop
from fembridge.solver.verdict import Cause

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


@pytest.mark.parametrize(
    ("number", "code"),
    [(signal.SIGINT, 130), pytest.param(signal.SIGTERM, 143, marks=pytest.mark.slow)],
)
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


RUN = """
import sys, threading
from pathlib import Path
from fembridge.io.run_folder import read_run_folder
from fembridge.solver.ccx import run_ccx
run = read_run_folder(Path(sys.argv[1]))
thread = threading.Thread(target=run_ccx, args=(run,))
thread.start()
thread.join()
"""


def test_killing_python_leaves_no_solver_of_any_thread(
    begin, make_run, pid_of, is_alive, wait_until
):
    folder = make_run("stubborn")
    child = begin("-c", RUN, str(folder))
    solver = pid_of(folder)
    assert is_alive(solver)
    child.kill()
    child.wait()
    wait_until(lambda: not is_alive(solver))
    assert not (folder / "job.frd").exists()


def test_a_second_run_in_a_folder_is_refused_until_the_first_is_killed(
    solve, begin, make_run, pid_of, is_alive, is_at_work, wait_until
):
    folder = make_run("hang")
    child = begin("-m", "fembridge.cli", "run", str(folder))
    solver = pid_of(folder)
    assert is_at_work(folder)

    outcome = solve(folder)

    assert outcome.failure.cause is Cause.BUSY
    assert f"process {child.pid} " in str(outcome.failure)
    assert is_alive(solver)
    os.kill(solver, signal.SIGKILL)  # both at once, whoever goes first
    child.kill()
    child.wait()
    make_run("normal")
    assert solve(folder).accepted
    assert not (folder / "solving").exists()
    wait_until(lambda: not is_alive(solver))


def test_another_thread_can_halt_a_run(solve, make_run, pid_of, is_alive):
    folder = make_run("hang")
    halt = threading.Event()
    found = []
    thread = threading.Thread(target=lambda: found.append(solve(folder, halt=halt)))
    thread.start()
    solver = pid_of(folder)
    halt.set()
    thread.join()
    assert found[0].failure.cause is Cause.INTERRUPTED
    assert not is_alive(solver)


@pytest.mark.parametrize("play", ["stubborn", "with_child"])
def test_stop_ends_one_that_will_not_and_all_it_started(
    fake_ccx, tmp_path, pid_of, is_alive, wait_until, play
):
    work = tmp_path / "solving"
    work.mkdir()
    (work / "job.inp").write_text(f"** play {play}\n")
    words = ["-i", "solving/job"]
    process = start(fake_ccx, words, tmp_path, tmp_path / "log")
    solver = pid_of(tmp_path)
    stop(process, grace_s=0.05)
    assert process.returncode in (-signal.SIGKILL, -signal.SIGTERM)
    wait_until(lambda: not is_alive(solver))
    stop(process)  # once more is harmless


def test_a_number_that_may_be_another_s_by_now_gets_no_signal(monkeypatch):
    """Ctrl-C came after the system had reaped the solver, before Python noted it."""
    process = subprocess.Popen([sys.executable, "-ISc", ""])
    os.waitpid(process.pid, 0)
    monkeypatch.setattr(os, "killpg", lambda *words: pytest.fail(f"signal to {words}"))
    stop(process)
    assert process.returncode is not None


def test_handlers_that_someone_has_set_are_respected():
    def mine(number, frame):
        raise AssertionError

    before = signal.signal(signal.SIGTERM, mine)
    hangup = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # not so under nohup
    try:
        with signals_as_exits():
            assert signal.getsignal(signal.SIGTERM) is mine
            with pytest.raises(SystemExit) as caught:
                os.kill(os.getpid(), signal.SIGHUP)
                time.sleep(10)
            assert caught.value.code == 129
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_DFL
    finally:
        signal.signal(signal.SIGTERM, before)
        signal.signal(signal.SIGHUP, hangup)
