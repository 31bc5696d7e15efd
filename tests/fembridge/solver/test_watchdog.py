"""Progress and complaints, from files that grow by hand and a clock of our own."""

import pytest

from fembridge.errors import UsageError
from fembridge.run_folder import read_run_folder
from fembridge.solver.ccx import Watchdog
from fembridge.solver.settings import SolverSettings
from fembridge.solver.verdict import Cause

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
        return work, Watchdog(work, run, SolverSettings(**limits))

    return make


def test_progress_is_the_time_of_the_last_increment_that_converged(watch):
    work, dog = watch()
    failed = sta_row(3, 0.001, mark="U")
    (work / "job.sta").write_text(STA + sta_row(1, 0.0005) + sta_row(2, 0.001) + failed)
    rows = [cvg_row(1, 1), cvg_row(1, 2), cvg_row(2, 1), cvg_row(3, 1), cvg_row(3, 2)]
    (work / "job.cvg").write_text(CVG + "".join(rows))

    progress = dog.look(8.0)

    assert (progress.increment, progress.increments) == (2, 10)
    assert (progress.iterations, progress.iterations_here) == (5, 2)
    assert progress.fraction == pytest.approx(0.2, rel=1e-9)
    assert progress.left_s == pytest.approx(32.0, rel=1e-9)


def test_a_line_that_cannot_be_read_keeps_what_was_known(watch):
    work, dog = watch()
    (work / "job.sta").write_text(STA + sta_row(1, 0.0005))
    dog.look(1.0)
    (work / "job.sta").write_text(STA + sta_row(1, 0.0005) + "what is this\n")
    assert dog.look(2.0).increment == 1


def test_a_new_attempt_counts_its_iterations_anew(watch):
    work, dog = watch(iteration_limit=3)
    (work / "job.cvg").write_text(
        CVG + "".join(cvg_row(1, n, attempt) for attempt in (1, 2) for n in (1, 2, 3))
    )
    assert dog.complaint(dog.look(1.0)) is None

    with (work / "job.cvg").open("a") as file:
        file.write(cvg_row(1, "****", attempt=2))
    assert dog.complaint(dog.look(2.0)).cause is Cause.ENDLESS_ITERATION


def test_growth_of_any_file_puts_the_stall_off(watch):
    work, dog = watch(stall_limit_s=10.0)
    (work / "job.frd").write_text("a")
    assert dog.complaint(dog.look(1.0)) is None
    assert dog.complaint(dog.look(10.9)) is None
    (work / "job.frd").write_text("ab")
    assert dog.complaint(dog.look(11.5)) is None
    assert dog.complaint(dog.look(21.4)) is None
    assert dog.complaint(dog.look(21.6)).cause is Cause.STALLED


def test_the_time_limit_counts_though_files_grow(watch):
    work, dog = watch(time_limit_s=10.0)
    (work / "job.frd").write_text("a")
    assert dog.complaint(dog.look(10.0)) is None
    (work / "job.frd").write_text("ab")
    complaint = dog.complaint(dog.look(10.1))
    assert complaint.cause is Cause.TIME_LIMIT
    assert "10 s were over after 0 of 10 increments, 0 of 5 ms" in str(complaint)


@pytest.mark.parametrize("name", ["time_limit_s", "stall_limit_s", "iteration_limit"])
@pytest.mark.parametrize("limit", [0, -1, float("nan")])
def test_a_limit_that_is_not_positive_is_misuse(name, limit):
    with pytest.raises(UsageError, match=name):
        SolverSettings(**{name: limit})
