"""CalculiX as a process: one run folder in, accepted results or one cause out.

``ccx -i solving/job`` is started in the run folder itself, so that an
``*INCLUDE`` in the deck finds its file where its author expects it.
"""

import contextlib
import os
import subprocess
import threading
import time
from dataclasses import replace
from pathlib import Path

from decks.dialects import JOB
from fembridge.errors import MissingError, OutputError
from fembridge.machine import SOLVER_INSTALL_LINE, find_ccx
from fembridge.run_folder import RunFolder, read_run_folder
from fembridge.solvers.folder_lock import folder_lock
from fembridge.solvers.outcome import Cause, Failure, Outcome
from fembridge.solvers.process import signals_as_exits, start, stop
from fembridge.solvers.record import remove_record, write_record
from fembridge.solvers.solver_log import read_solver_log
from fembridge.solvers.verdict import judge
from fembridge.solvers.watchdog import (
    ITERATION_LIMIT,
    STALL_LIMIT_S,
    Limits,
    OnProgress,
    Progress,
    Watchdog,
)
from fembridge.solvers.workplace import WORK_FOLDER, Workplace
from fembridge.store import sha256_of

FIRST_LOOK_S = 0.05
SLOWEST_LOOK_S = 1.0
"""Looks get rarer as a run gets longer: each reads the growing files again."""


def run_calculix(
    folder: Path,
    *,
    threads: int | None = None,
    time_limit_s: float | None = None,
    stall_limit_s: float | None = STALL_LIMIT_S,
    iteration_limit: int | None = ITERATION_LIMIT,
    on_progress: OnProgress | None = None,
) -> Outcome:
    """Solve the run folder `folder`, so that its results stand beside its deck.

    Parameters
    ----------
    threads
        Threads of the solver; None leaves it to the environment.
    time_limit_s, stall_limit_s
        Give up after so long in all, or so long without a file that grows.
    iteration_limit
        Give up when one attempt at an increment takes more iterations.
    on_progress
        Told how far the run is, at the latest every second, and when it ends.

    Returns
    -------
    Outcome
        Of an accepted run: what it cost.

    Raises
    ------
    SolverError
        The run is not accepted; the message says why. What the solver left is
        in ``failed/``, and results of an earlier run are untouched.
    ResultError
        `folder` is no run folder.
    OutputError
        `folder` cannot be written.
    """
    limits = Limits(time_limit_s, stall_limit_s, iteration_limit)
    outcome = attempt_calculix(folder, threads=threads, limits=limits, on_progress=on_progress)
    if not outcome.accepted:
        raise outcome.to_error()
    return outcome


def attempt_calculix(
    folder: Path,
    *,
    threads: int | None = None,
    limits: Limits | None = None,
    on_progress: OnProgress | None = None,
    halt: threading.Event | None = None,
) -> Outcome:
    """Do what `run_calculix` does, and give a failure instead of raising it.

    Parameters
    ----------
    halt
        When another thread sets it, the solver is stopped and the outcome is
        ``INTERRUPTED``.
    """
    run = read_run_folder(folder)
    program = _find(run)
    if isinstance(program, Failure):
        return Outcome(folder, program)
    with signals_as_exits(), folder_lock(folder) as busy:
        if busy:
            return Outcome(folder, busy)
        attempt = _Attempt(run, limits or Limits(), on_progress, halt)
        return attempt.make(program, threads)


def _find(run: RunFolder) -> Path | Failure:
    if not run.deck.is_file():
        return Failure(Cause.BAD_FOLDER, f"no {run.deck.name}", "build the deck again")
    try:
        program = find_ccx()
    except MissingError as error:
        return Failure(Cause.NO_SOLVER, str(error))
    if program is None:
        return Failure(Cause.NO_SOLVER, "no ccx on the PATH", f"install it: {SOLVER_INSTALL_LINE}")
    return program


class _Attempt:
    """One attempt at `run`, in a folder that is locked for it."""

    def __init__(
        self,
        run: RunFolder,
        limits: Limits,
        on_progress: OnProgress | None,
        halt: threading.Event | None,
    ) -> None:
        self._run = run
        self._place = Workplace(run)
        self._watchdog = Watchdog(self._place.folder, run, limits)
        self._on_progress, self._halt = on_progress, halt

    def make(self, program: Path, threads: int | None) -> Outcome:
        """Run, judge, and put the files where they belong."""
        run, place = self._run, self._place
        place.prepare()
        deck_sha256 = sha256_of(place.deck)
        begin_s = time.monotonic()
        words = ["-i", os.path.join(WORK_FOLDER, JOB)]  # noqa: PTH118 - a word for ccx
        process = start(program, words, run.folder, place.log, threads)
        try:
            failure = self._watch(process, begin_s)
        except BaseException as error:
            stop(process)
            with contextlib.suppress(OSError, OutputError):
                place.collect()
                place.keep_evidence(Failure(Cause.INTERRUPTED, type(error).__name__))
            raise
        wall_s = time.monotonic() - begin_s
        place.collect()
        log = read_solver_log(place.log)
        failure = failure or judge(place.folder, run, process.returncode, log)
        progress = self._watchdog.look(wall_s)
        outcome = Outcome(
            folder=run.folder,
            failure=failure,
            version=log.version,
            exit_code=process.returncode,
            wall_s=wall_s,
            increments=progress.increment,
            iterations=progress.iterations,
            threads=threads,
            as_built=deck_sha256 == run.deck_sha256,
        )
        if failure is not None:
            place.keep_evidence(failure)
            return outcome
        remove_record(run.folder)
        place.publish()
        write_record(run, outcome, deck_sha256)
        return outcome

    def _watch(self, process: subprocess.Popen[bytes], begin_s: float) -> Failure | None:
        """Wait for the end; stop the solver when the watchdog or `halt` says so."""
        pause_s = FIRST_LOOK_S
        while True:
            try:
                process.wait(timeout=pause_s)
            except subprocess.TimeoutExpired:
                pause_s = min(1.2 * pause_s, SLOWEST_LOOK_S)
            progress = self._watchdog.look(time.monotonic() - begin_s)
            if process.returncode is not None:
                self._tell(replace(progress, ended=True))
                return None
            self._tell(progress)
            failure = self._watchdog.complaint(progress) or self._halted(progress)
            if failure is not None:
                stop(process)
                self._tell(replace(progress, ended=True))
                return failure

    def _tell(self, progress: Progress) -> None:
        if self._on_progress is not None:
            self._on_progress(progress)

    def _halted(self, progress: Progress) -> Failure | None:
        if self._halt is None or not self._halt.is_set():
            return None
        return Failure(
            Cause.INTERRUPTED, f"after {progress.increment} of {progress.increments} increments"
        )
