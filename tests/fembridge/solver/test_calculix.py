"""One run folder under a solver that plays each way a run can end."""

import pytest

from fembridge.run_folder import read_run_folder
from fembridge.solver import ccx
from fembridge.solver.ccx import run_ccx
from fembridge.solver.settings import SolverSettings
from fembridge.solver.verdict import Cause
from fembridge.store import sha256_of

ENDINGS = {
    "bad_deck": (Cause.BAD_DECK, "NOPE has not yet been defined. [NOPE,1,1]"),
    "diverged": (Cause.DIVERGED, "increment 2, from 0.5 to 1 ms, after 2 iterations"),
    "silent_divergence": (Cause.DIVERGED, "3 of 4 increments are good"),
    "odd_error": (Cause.UNKNOWN, "the moon is full"),
    "inverted": (Cause.NEGATIVE_JACOBIAN, "determinant in element 7"),
    "starved": (Cause.OUT_OF_MEMORY, "fewer jobs"),
    "cut": (Cause.DISK_FULL, "job.frd stops at byte 900"),
    "no_room": (Cause.DISK_FULL, "No space left on device"),
    "too_large": (Cause.DISK_FULL, "ulimit -f"),
    "no_output": (Cause.MISSING_OUTPUT, "job.frd holds the mesh alone"),
    "no_frd": (Cause.MISSING_OUTPUT, "no job.frd"),
    "nothing": (Cause.MISSING_OUTPUT, "nothing to do"),
    "odd_exit": (Cause.UNKNOWN, "exit code 7"),
    "aborted": (Cause.CRASHED, "(SIGABRT); last output: realloc(): invalid old size"),
}
"""What faults in a deck CalculiX itself shows is in ``test_real_calculix``."""


def solve(folder, halt=None, **settings):
    return run_ccx(read_run_folder(folder), SolverSettings(**settings), halt)


def files_of(folder):
    return {path.name for path in folder.iterdir()}


def test_an_accepted_run_leaves_its_results_and_their_record(fake_ccx, make_run):
    folder = make_run("normal")

    outcome = solve(folder)

    assert outcome.accepted
    assert (outcome.increments, outcome.iterations) == (4, 8)
    assert (outcome.exit_code, outcome.version) == (0, "2.20")
    assert files_of(folder) == {
        "job.inp",
        "run.toml",
        "job.frd",
        "job.sta",
        "job.cvg",
        "solver.log",
        "solver.toml",
    }
    assert sha256_of(folder / "job.frd") in (folder / "solver.toml").read_text()


@pytest.mark.parametrize("play", ENDINGS)
def test_a_run_that_is_not_good_has_one_cause(fake_ccx, make_run, play):
    folder = make_run(play)
    cause, words = ENDINGS[play]

    outcome = solve(folder)

    assert outcome.failure.cause is cause
    assert words in str(outcome.failure)
    assert files_of(folder) == {"job.inp", "run.toml", "failed"}
    evidence = files_of(folder / "failed")
    assert {"job.inp", "solver.log", "cause.txt"} <= evidence
    assert words in (folder / "failed" / "cause.txt").read_text()


def test_a_failed_run_leaves_earlier_results_as_they_were(fake_ccx, make_run):
    folder = make_run("normal")
    solve(folder)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    make_run("cut")

    outcome = solve(folder)

    assert not outcome.accepted
    for name in ("job.frd", "job.sta", "job.cvg", "solver.log", "solver.toml"):
        assert (folder / name).read_bytes() == before[name]


def test_a_good_run_clears_away_what_earlier_ones_left(fake_ccx, make_run):
    folder = make_run("cut")
    solve(folder)
    (folder / "job.dat").write_text("of a run long ago\n")
    (folder / "solving").mkdir()
    (folder / "solving" / "job.frd").write_text("of a run that was killed\n")
    make_run("normal")

    solve(folder)

    assert not {"failed", "solving", "job.dat"} & files_of(folder)
    assert (folder / "job.frd").read_text().endswith(" 9999\n")


def test_a_solver_whose_files_do_not_grow_is_stopped(fake_ccx, make_run, is_at_work):
    folder = make_run("hang")

    outcome = solve(folder, stall_limit_s=0.3)

    assert outcome.failure.cause is Cause.STALLED
    assert not is_at_work(folder)


def test_an_increment_that_iterates_for_ever_is_stopped(fake_ccx, make_run):
    folder = make_run("endless")

    outcome = solve(folder, iteration_limit=50)

    assert outcome.failure.cause is Cause.ENDLESS_ITERATION
    assert "limit 50, after 1 of 4 increments" in str(outcome.failure)
    assert 50 < outcome.iterations < 90_000


@pytest.mark.parametrize("play", ["normal", "diverged"])
def test_the_last_word_of_progress_is_that_the_run_ended(fake_ccx, make_run, play):
    shown = []

    outcome = solve(make_run(play), on_progress=shown.append)

    assert [progress.ended for progress in shown] == [False] * (len(shown) - 1) + [True]
    assert shown[-1].increment == outcome.increments


def test_threads_asked_for_overrule_the_environment(fake_ccx, make_run, monkeypatch):
    monkeypatch.setenv("NUMBER_OF_CPUS", "7")
    folder = make_run("environment")

    solve(folder, threads=3)
    log = (folder / "solver.log").read_text()
    assert "threads 3" in log
    assert "override None" in log

    solve(folder)
    log = (folder / "solver.log").read_text()
    assert "threads None" in log
    assert "override 7" in log


def test_without_a_solver_the_line_that_installs_it_is_said(make_run, monkeypatch, tmp_path):
    monkeypatch.delenv("FEMBRIDGE_CCX", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    folder = make_run("normal")

    outcome = solve(folder)

    assert outcome.failure.cause is Cause.NO_SOLVER
    assert "apt-get install -y calculix-ccx" in str(outcome.failure)
    assert files_of(folder) == {"job.inp", "run.toml"}


def test_a_solver_that_the_system_cannot_run_is_said(fake_ccx, make_run):
    fake_ccx.write_text("#!/no/such/interpreter\n")

    outcome = solve(make_run("normal"))

    assert outcome.failure.cause is Cause.NO_SOLVER
    assert f"{fake_ccx} cannot be run" in str(outcome.failure)


def test_a_deck_that_ccx_never_finishes_reading_is_named(fake_ccx, make_run, monkeypatch):
    monkeypatch.setattr(ccx, "READING_S", 0.5)
    folder = make_run("hang")
    (shown,) = ccx.warnings_of(read_run_folder(folder), folder / "job.inp")
    assert "had not read the deck after 0.5 s" in shown
