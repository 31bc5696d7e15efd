"""Many folders, each with its outcome, and the table of solvers that run them."""

import importlib.metadata
import threading

import pytest

from fembridge.errors import MissingError
from fembridge.solver import ccx
from fembridge.solver.ccx import load_solver, run_folders
from fembridge.solver.settings import SolverSettings
from fembridge.solver.verdict import Cause


def test_outcomes_come_in_the_order_of_the_folders(fake_ccx, make_run, tmp_path):
    good = make_run("normal", "good")
    bad = make_run("diverged", "bad")
    marc = make_run("normal", "marc", solver="marc")
    odd = make_run("normal", "odd", solver="abacus")
    absent = tmp_path / "absent"

    outcomes = run_folders([bad, absent, good, marc, odd], SolverSettings(jobs=2))

    assert [outcome.folder for outcome in outcomes] == [bad, absent, good, marc, odd]
    causes = [outcome.failure and outcome.failure.cause for outcome in outcomes]
    folder_is_bad = Cause.BAD_FOLDER
    assert causes == [Cause.DIVERGED, folder_is_bad, None, folder_is_bad, folder_is_bad]
    assert "Marc is run with your own solver" in str(outcomes[3])
    assert "no solver 'abacus' here; there is calculix" in str(outcomes[4])
    assert str(outcomes[1]).count(str(absent)) == 1


def test_a_folder_named_twice_is_run_once(fake_ccx, make_run, tmp_path):
    folder = make_run("normal")
    assert len(run_folders([folder, tmp_path / "bin" / ".." / "run"], SolverSettings(jobs=2))) == 1


def test_results_are_made_again_when_something_changed_them(fake_ccx, make_run):
    """Of results, one byte: in the table of faults."""
    folder = make_run("normal")
    run_folders([folder])
    record = folder / "solver.toml"
    record.write_text(record.read_text()[:40])

    assert run_folders([folder])[0].skipped is False
    assert (folder / "job.frd").read_text().endswith(" 9999\n")


def test_jobs_run_at_the_same_time(fake_ccx, make_run):
    """Each has a line only while both are at work; one alone would wait for ever."""
    meeting = threading.Barrier(2, timeout=120)
    met = set()

    def meet(progress):
        if progress.folder not in met:
            meeting.wait()
            met.add(progress.folder)
        raise ZeroDivisionError  # ends this run

    folders = [make_run("hang", "a"), make_run("hang", "b")]
    with pytest.raises(ZeroDivisionError):
        run_folders(folders, SolverSettings(jobs=2, on_progress=meet))
    assert met


def test_one_that_breaks_ends_the_others(fake_ccx, make_run, pid_of, is_alive):
    folders = [make_run("hang", name) for name in ("a", "b", "c")]
    pids = []

    def fail(progress):
        if progress.folder == folders[0] and (folders[1] / "solving/job.pid").exists():
            pids.append(pid_of(folders[1]))
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run_folders(folders, SolverSettings(jobs=2, on_progress=fail))

    assert not is_alive(pids[0])
    assert not (folders[2] / "failed").exists()


def test_another_package_can_add_a_solver(monkeypatch):
    row = importlib.metadata.EntryPoint("mine", "math:hypot", ccx.ENTRY_POINTS)
    rows = importlib.metadata.EntryPoints([row])
    monkeypatch.setattr(importlib.metadata, "entry_points", lambda group: rows.select(group=group))

    assert load_solver("mine")(3.0, 4.0) == 5.0
    with pytest.raises(MissingError, match=r"no solver 'nine' here.*calculix, mine"):
        load_solver("nine")
