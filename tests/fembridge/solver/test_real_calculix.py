"""CalculiX itself on one plane-strain element: does it end as we say it does?"""

import signal
from pathlib import Path

import pytest

from fembridge.host.machine import find_ccx
from fembridge.solver.verdict import Cause

pytestmark = pytest.mark.solver

ENDINGS = {
    "set": ("NOPE", Cause.BAD_DECK, "NOPE has not yet been defined"),
    "model": ("*INCLUDE, INPUT=nope.inc", Cause.BAD_DECK, "cannot open file nope.inc"),
    "request": ("*EL OUTPUT\nS", Cause.CARD_DROPPED, "[*ELOUTPUT]"),
    "solver": (", SOLVER=PARDISO", Cause.SOLVER_NOT_BUILT_IN, "PARDISO"),
    "nodes": ("1, 4, 3, 2", Cause.NEGATIVE_JACOBIAN, "in element 1"),
    "most": (2, Cause.INCREMENTS_EXHAUSTED, "2 of 4 increments"),
    "end_s": (0.0015, Cause.WRONG_END, "1.5 ms, expected 2 ms"),
    "load": (
        "*CLOAD\n3, 1, 1e9\n4, 1, -1e8\n3, 2, 5e6",
        Cause.DIVERGED,
        "increment 1, from 0 to 0.5 ms, after 2 iterations",
    ),
}
MANY = {"end_s": 1000.0}


def test_a_good_deck_is_accepted(solve, make_run, patch):
    folder = make_run(deck=patch())
    outcome = solve(folder, threads=1)
    assert (outcome.increments, outcome.exit_code) == (4, 0)
    assert outcome.version
    assert outcome.iterations >= 4
    results = {"job.12d", "job.cvg", "job.frd", "job.sta", "solver.log", "solver.toml"}
    assert {path.name for path in folder.iterdir()} == {"job.inp", "run.toml", *results}


def test_a_deck_finds_the_files_it_includes(solve, make_run, patch):
    folder = make_run(deck=patch(load="*INCLUDE, INPUT=load.inc"))
    (folder / "load.inc").write_text("*BOUNDARY\n3, 2, 2, 0.01\n4, 2, 2, 0.01\n")
    assert solve(folder).accepted


@pytest.mark.parametrize("part", ENDINGS)
def test_a_fault_in_the_deck_has_its_cause(solve, make_run, patch, part):
    text, cause, words = ENDINGS[part]
    outcome = solve(make_run(deck=patch(**{part: text})))
    assert outcome.failure.cause is cause
    assert words in str(outcome.failure)


@pytest.mark.parametrize("signal_is", ["ignored", "obeyed"])
def test_a_file_that_cannot_grow_is_a_full_disk(
    solve, make_run, patch, tmp_path, monkeypatch, signal_is
):
    """Ignored, it acts as a full disk does: CalculiX ends with exit code 0."""
    program = tmp_path / "ccx-in-little-room"
    trap = "trap '' XFSZ\n" if signal_is == "ignored" else ""
    program.write_text(f'#!/bin/sh\n{trap}ulimit -f 16\nexec {find_ccx()} "$@"\n')
    program.chmod(0o755)
    monkeypatch.setenv("FEMBRIDGE_CCX", str(program))
    folder = make_run(deck=patch(end_s=0.05), increments=100)

    outcome = solve(folder)

    assert outcome.failure.cause is Cause.DISK_FULL
    assert outcome.exit_code == (0 if signal_is == "ignored" else -signal.SIGXFSZ)
    assert not (folder / "job.frd").exists()


def test_a_long_run_is_stopped_by_its_limit(solve, make_run, patch):
    folder = make_run(deck=patch(**MANY), increments=2_000_000)
    outcome = solve(folder, time_limit_s=0.5)
    assert outcome.failure.cause is Cause.TIME_LIMIT
    assert not (folder / "job.frd").exists()


def test_killing_python_leaves_no_calculix_behind(begin, make_run, patch, is_alive, wait_until):
    folder = make_run(deck=patch(**MANY), increments=2_000_000)
    child = begin("-m", "fembridge.cli", "run", folder)
    wait_until(lambda: (folder / "solving" / "job.frd").exists())
    (solver,) = children_of(child.pid)
    assert is_alive(solver)
    child.kill()
    wait_until(lambda: not is_alive(solver))
    assert not (folder / "job.frd").exists()


def children_of(parent):
    """Processes that any thread of `parent` has started."""
    tasks = Path(f"/proc/{parent}/task").iterdir()
    words = " ".join((task / "children").read_text() for task in tasks)
    return [int(word) for word in words.split()]
