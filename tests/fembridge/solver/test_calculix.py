"""Run folders under a solver that plays each way a run can end; who watches it, what it prints."""

import importlib.metadata
import threading

import pytest

from fembridge.errors import MissingError, UsageError
from fembridge.host.machine import SOLVER_INSTALL_LINE
from fembridge.host.store import sha256_of
from fembridge.io.run_folder import read_run_folder
from fembridge.solver import ccx
from fembridge.solver.ccx import Watchdog, load_solver, run_folders
from fembridge.solver.settings import Solver
from fembridge.solver.verdict import REMEDIES, Cause, read_solver_log

ENDINGS = {
    "bad_deck": (Cause.BAD_DECK, "NOPE has not yet been defined. [NOPE,1,1]"),
    "diverged": (Cause.DIVERGED, "increment 2, from 0.5 to 1 ms, after 2 iterations"),
    "silent_divergence": (Cause.DIVERGED, "3 of 4 increments"),
    "odd_error": (Cause.UNKNOWN, "the moon is full"),
    "inverted": (Cause.NEGATIVE_JACOBIAN, "determinant in element 7"),
    "starved": (Cause.OUT_OF_MEMORY, REMEDIES[Cause.OUT_OF_MEMORY]),
    "cut": (Cause.DISK_FULL, "job.frd stops at byte 900"),
    "no_room": (Cause.DISK_FULL, "No space left on device"),
    "too_large": (Cause.DISK_FULL, REMEDIES[Cause.DISK_FULL]),
    "no_output": (Cause.MISSING_OUTPUT, "job.frd"),
    "no_frd": (Cause.MISSING_OUTPUT, "no job.frd"),
    "nothing": (Cause.MISSING_OUTPUT, "nothing to do"),
    "odd_exit": (Cause.UNKNOWN, "exit code 7"),
    "aborted": (Cause.CRASHED, "(SIGABRT); last output: realloc(): invalid old size"),
}
"""What faults in a deck CalculiX itself shows is in ``test_real_calculix``."""


def files_of(folder):
    return {path.name for path in folder.iterdir()}


def test_an_accepted_run_leaves_its_results_and_their_record(solve, fake_ccx, make_run):
    folder = make_run("normal")
    outcome = solve(folder)
    assert outcome.accepted
    assert (outcome.increments, outcome.iterations) == (4, 8)
    assert (outcome.exit_code, outcome.version) == (0, "2.20")
    results = {"job.frd", "job.sta", "job.cvg", "solver.log", "solver.toml"}
    assert files_of(folder) == {"job.inp", "run.toml", *results}
    assert sha256_of(folder / "job.frd") in (folder / "solver.toml").read_text()


@pytest.mark.parametrize("play", ENDINGS)
def test_a_run_that_is_not_good_has_one_cause(solve, fake_ccx, make_run, play):
    folder = make_run(play)
    cause, words = ENDINGS[play]
    outcome = solve(folder)
    assert outcome.failure.cause is cause
    assert words in str(outcome.failure)
    assert files_of(folder) == {"job.inp", "run.toml", "failed"}
    evidence = files_of(folder / "failed")
    assert {"job.inp", "solver.log", "cause.txt"} <= evidence
    assert words in (folder / "failed" / "cause.txt").read_text()


def test_a_failed_run_leaves_earlier_results_as_they_were(solve, fake_ccx, make_run):
    folder = make_run("normal")
    solve(folder)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    make_run("cut")
    outcome = solve(folder)
    assert not outcome.accepted
    for name in ("job.frd", "job.sta", "job.cvg", "solver.log", "solver.toml"):
        assert (folder / name).read_bytes() == before[name]


def test_a_good_run_clears_away_what_earlier_ones_left(solve, fake_ccx, make_run):
    folder = make_run("cut")
    solve(folder)
    (folder / "job.dat").write_text("of a run long ago\n")
    (folder / "solving").mkdir()
    (folder / "solving" / "job.frd").write_text("of a run that was killed\n")
    make_run("normal")
    solve(folder)
    assert not {"failed", "solving", "job.dat"} & files_of(folder)
    assert (folder / "job.frd").read_text().endswith(" 9999\n")


def test_a_solver_whose_files_do_not_grow_is_stopped(solve, fake_ccx, make_run, is_at_work):
    folder = make_run("hang")
    outcome = solve(folder, stall_limit_s=0.3)
    assert outcome.failure.cause is Cause.STALLED
    assert not is_at_work(folder)


def test_an_increment_that_iterates_for_ever_is_stopped(solve, fake_ccx, make_run):
    folder = make_run("endless")
    outcome = solve(folder, iteration_limit=50)
    assert outcome.failure.cause is Cause.ENDLESS_ITERATION
    for limit_and_place in ("limit 50", "1 of 4 increments"):
        assert limit_and_place in outcome.failure.finding
    assert 50 < outcome.iterations < 90_000


@pytest.mark.parametrize("play", ["normal", "diverged"])
def test_the_last_word_of_progress_is_that_the_run_ended(solve, fake_ccx, make_run, play):
    shown = []
    outcome = solve(make_run(play), on_progress=shown.append)
    assert [progress.has_ended for progress in shown] == [False] * (len(shown) - 1) + [True]
    assert shown[-1].increment == outcome.increments


def test_threads_asked_for_overrule_the_environment(solve, fake_ccx, make_run, monkeypatch):
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


def test_without_a_solver_the_line_that_installs_it_is_said(solve, make_run, monkeypatch, tmp_path):
    monkeypatch.delenv("FEMBRIDGE_CCX", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    folder = make_run("normal")
    outcome = solve(folder)
    assert outcome.failure.cause is Cause.NO_SOLVER
    assert SOLVER_INSTALL_LINE in outcome.failure.remedy
    assert files_of(folder) == {"job.inp", "run.toml"}


def test_a_solver_that_the_system_cannot_run_is_said(solve, fake_ccx, make_run):
    fake_ccx.write_text("#!/no/such/interpreter\n")
    outcome = solve(make_run("normal"))
    assert outcome.failure.cause is Cause.NO_SOLVER
    assert str(fake_ccx) in outcome.failure.finding


def test_a_deck_that_ccx_never_finishes_reading_is_named(fake_ccx, make_run, monkeypatch):
    monkeypatch.setattr(ccx, "READING_S", 0.5)
    folder = make_run("hang")
    (shown,) = ccx.deck_warnings(read_run_folder(folder), folder / "job.inp")
    assert "0.5 s" in shown


def test_outcomes_come_in_the_order_of_the_folders(fake_ccx, make_run, tmp_path):
    good = make_run("normal", "good")
    bad = make_run("diverged", "bad")
    marc = make_run("normal", "marc", solver="marc")
    odd = make_run("normal", "odd", solver="abacus")
    absent = tmp_path / "absent"

    outcomes = run_folders([bad, absent, good, marc, odd], Solver(jobs=2))

    assert [outcome.folder for outcome in outcomes] == [bad, absent, good, marc, odd]
    causes = [outcome.failure and outcome.failure.cause for outcome in outcomes]
    folder_is_bad = Cause.BAD_FOLDER
    assert causes == [Cause.DIVERGED, folder_is_bad, None, folder_is_bad, folder_is_bad]
    assert "Marc" in outcomes[3].failure.finding
    for name in ("abacus", "calculix"):
        assert name in outcomes[4].failure.finding
    assert str(outcomes[1]).count(str(absent)) == 1


def test_a_folder_named_twice_is_run_once(fake_ccx, make_run, tmp_path):
    folder = make_run("normal")
    assert len(run_folders([folder, tmp_path / "bin" / ".." / "run"], Solver(jobs=2))) == 1


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
        run_folders(folders, Solver(jobs=2, on_progress=meet))
    assert met


def test_one_that_breaks_ends_the_others(fake_ccx, make_run, pid_of, is_alive):
    folders = [make_run("hang", name) for name in ("a", "b", "c")]
    pids = []

    def fail(progress):
        if progress.folder == folders[0] and (folders[1] / "solving/job.pid").exists():
            pids.append(pid_of(folders[1]))
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run_folders(folders, Solver(jobs=2, on_progress=fail))

    assert not is_alive(pids[0])
    assert not (folders[2] / "failed").exists()


def test_another_package_can_add_a_solver(monkeypatch):
    row = importlib.metadata.EntryPoint("mine", "math:hypot", ccx.ENTRY_POINTS)
    rows = importlib.metadata.EntryPoints([row])
    monkeypatch.setattr(importlib.metadata, "entry_points", lambda group: rows.select(group=group))
    assert load_solver("mine")(3.0, 4.0) == 5.0
    with pytest.raises(MissingError) as refused:
        load_solver("nine")
    assert (refused.value.found, refused.value.expected) == ("nine", "calculix or mine")


STA = "SUMMARY OF JOB INFORMATION\n STEP\n"
CVG = "SUMMARY OF C0NVERGENCE INFORMATION\n\n\n\n"


def sta_row(increment, end_s, mark=" ", attempt=1):
    times = f"{end_s:14.6E}{end_s:14.6E}{0.0005:14.6E}"
    return f"{1:6d}{increment:11d}{attempt:6d}{mark}{2:5d}{times}\n"


def cvg_row(increment, iteration, attempt=1):
    place = f"{1:6d}{increment:6d}{attempt:6d}{iteration:>6}{0:9d}"
    return place + "  0.0000E+00" * 4 + "\n"


@pytest.fixture
def watch(make_run, tmp_path):
    run = read_run_folder(make_run(increments=10))
    work = tmp_path / "solving"
    work.mkdir()

    def make(**limits):
        return work, Watchdog(work, run, Solver(**limits))

    return make


def test_progress_is_the_time_of_the_last_increment_that_converged(watch):
    work, dog = watch()
    failed = sta_row(3, 0.001, mark="U")
    (work / "job.sta").write_text(STA + sta_row(1, 0.0005) + sta_row(2, 0.001) + failed)
    rows = [cvg_row(1, 1), cvg_row(1, 2), cvg_row(2, 1), cvg_row(3, 1), cvg_row(3, 2)]
    (work / "job.cvg").write_text(CVG + "".join(rows))
    progress = dog.read_progress(8.0)
    assert (progress.increment, progress.increments) == (2, 10)
    assert (progress.iterations, progress.iterations_here) == (5, 2)
    assert progress.fraction == pytest.approx(0.2, rel=1e-9)
    assert progress.left_s == pytest.approx(32.0, rel=1e-9)


def test_a_line_that_cannot_be_read_keeps_what_was_known(watch):
    work, dog = watch()
    (work / "job.sta").write_text(STA + sta_row(1, 0.0005))
    dog.read_progress(1.0)
    (work / "job.sta").write_text(STA + sta_row(1, 0.0005) + "what is this\n")
    assert dog.read_progress(2.0).increment == 1


def test_a_new_attempt_counts_its_iterations_anew(watch):
    work, dog = watch(iteration_limit=3)
    (work / "job.cvg").write_text(
        CVG + "".join(cvg_row(1, n, attempt) for attempt in (1, 2) for n in (1, 2, 3))
    )
    assert dog.stop_reason(dog.read_progress(1.0)) is None
    with (work / "job.cvg").open("a") as file:
        file.write(cvg_row(1, "****", attempt=2))
    assert dog.stop_reason(dog.read_progress(2.0)).cause is Cause.ENDLESS_ITERATION


def test_growth_of_any_file_puts_the_stall_off(watch):
    work, dog = watch(stall_limit_s=10.0)
    (work / "job.frd").write_text("a")
    assert dog.stop_reason(dog.read_progress(1.0)) is None
    assert dog.stop_reason(dog.read_progress(10.9)) is None
    (work / "job.frd").write_text("ab")
    assert dog.stop_reason(dog.read_progress(11.5)) is None
    assert dog.stop_reason(dog.read_progress(21.4)) is None
    assert dog.stop_reason(dog.read_progress(21.6)).cause is Cause.STALLED


def test_the_time_limit_counts_though_files_grow(watch):
    work, dog = watch(time_limit_s=10.0)
    (work / "job.frd").write_text("a")
    assert dog.stop_reason(dog.read_progress(10.0)) is None
    (work / "job.frd").write_text("ab")
    failure = dog.stop_reason(dog.read_progress(10.1))
    assert failure.cause is Cause.TIME_LIMIT
    for value in ("10 s", "0 of 10 increments", "0 of 5 ms"):
        assert value in failure.finding


@pytest.mark.parametrize("name", ["time_limit_s", "stall_limit_s", "iteration_limit"])
@pytest.mark.parametrize("limit", [0, -1, float("nan")])
def test_a_limit_that_is_not_positive_is_misuse(name, limit):
    with pytest.raises(UsageError, match=name):
        Solver(**{name: limit})


HEAD = """
************************************************************

CalculiX Version 2.20, Copyright(C) 1998-2022 Guido Dhondt
"""


@pytest.fixture
def read(file):
    return lambda text: read_solver_log(file("solver.log", HEAD + text))


@pytest.mark.parametrize(
    "warning",
    [
        "in modaldynamics: parameter not recognized:\n          FOO=3",
        "reading *NODE PRINT: node set NOPE does not exist",
        "in calinput: PEEQ-output requested\n         yet no (visco)plastic analysis",
        "reading *STATIC: unknown solver;\n           the default solver is used",
    ],
)
def test_a_warning_that_leaves_something_out_is_seen(read, warning):
    assert len(read(f" *WARNING {warning}\n\n").dropped) == 1


def test_a_thousand_warnings_do_not_hide_the_error_after_them(read):
    many = "".join(f" *WARNING: parameter not recognized: P{n}\n" for n in range(1000))
    assert [e.text for e in read(many + " *ERROR in here: no\n").errors] == ["in here: no"]


def test_a_message_ends_at_the_blank_line_and_a_summary_counts_only_when_it_is_alone(read):
    log = read(" *ERROR: seems to diverge; try \n automatic incrementation\n\n something else\n")
    assert [str(error) for error in log.errors] == [
        "seems to diverge; try automatic incrementation"
    ]
    summary = " *ERROR in calinput: at least one fatal\n    error message\n\n"
    assert len(read(summary).errors) == 1
    assert [str(e) for e in read(" *ERROR in x: y\n\n" + summary).errors] == ["in x: y"]
