"""CalculiX in run folders: started, watched while it runs, stopped, and put on record.

``ccx -i solving/job`` is started in the run folder itself, so that an ``*INCLUDE``
in the deck finds its file where its author expects it.

``solving/``     while it runs: a copy of the deck, and all files of the solver
``failed/``      after a run that was not accepted: the same, with ``cause.txt``
``solver.toml``  of an accepted run: which deck the results answer, and their cost

An accepted run's files move up beside the deck, the record last; it is removed before
anything is replaced. So ``job.frd`` is always the whole result of a good run, whatever
became of later ones, and where the record's checksums agree it is of this deck.

Run folders of another solver are run by the function that a package has for it under the
entry point group ``fembridge.solvers``: the entry's name is the one in ``run.toml``, its
object is called as `run_ccx` is.
"""

import contextlib
import os
import re
import shutil
import subprocess
import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

from decks.dialects import DIALECTS, JOB
from fembridge import cache
from fembridge.errors import FembridgeError, LockedError, MissingError, OutputError, ResultError
from fembridge.machine import SOLVER_INSTALL_LINE, find_ccx
from fembridge.results.status import CvgRow, StaRow, read_cvg, read_sta
from fembridge.run_folder import SOLVER_FILE, RunFolder, read_run_folder
from fembridge.solver.process import signals_as_exits, start, stop
from fembridge.solver.settings import DEFAULTS, OnProgress, Progress, SolverSettings
from fembridge.solver.verdict import Cause, Failure, Outcome, find_card, judge, read_solver_log
from fembridge.store import (
    folder_lock,
    make_folder,
    read_toml,
    sha256_of,
    working_folder,
    write_text,
    write_toml,
)
from fembridge.typing import Table

ENTRY_POINTS = "fembridge.solvers"
FIRST_LOOK_S = 0.05
READING_S = 30.0
"""Longest reading of a deck without analysis."""
SLOWEST_LOOK_S = 1.0
"""Looks get rarer as a run gets longer."""

_END_STEP = re.compile(rb"^[ \t]*\*[ \t]*END[ \t]*STEP", re.MULTILINE | re.IGNORECASE)
_NO_ANALYSIS = "no analysis option"

WORK_FOLDER = "solving"
FAILED_FOLDER = "failed"
CAUSE_FILE = "cause.txt"
LOG_FILE = "solver.log"
LOCK_FILE = ".solver.lock"
FIXED_NAMES = ("spooles.out", "ResultsForLastIterations.frd")
"""Files that CalculiX writes where it was started, not beside its deck."""
OLD_RESULTS = (".frd", ".dat", ".sta", ".cvg", ".12d", ".cel")
"""What belongs to one run: none of it may stay beside the results of another."""
RECORD_FORMAT = 1
REFERS = re.compile(r"(?im)^\s*\*(?:INCLUDE|RESTART|SUBMODEL)|^\s*\*.*,\s*(?:INPUT|FILE)\s*=")
"""Cards of a deck that read another file."""

_GIVEN_UP = (Cause.DIVERGED, Cause.NEGATIVE_JACOBIAN)
"""Ends of a run that are kept: the solver's own, which it would come to again."""
_NAMED = (("finger", "name"), ("stimulus", "id"))
"""What of a run's inputs names it to a person."""


Solver: TypeAlias = Callable[[RunFolder, SolverSettings, threading.Event | None], Outcome]
"""Solve one run; a run that is not accepted is an outcome, not an exception."""


def run_folders(
    folders: Iterable[Path | RunFolder], settings: SolverSettings = DEFAULTS, *, force: bool = False
) -> list[Outcome]:
    """Outcomes, one a folder, in the order given; a duplicate is run once.

    Each is run with the solver that its ``run.toml`` names, ``settings.jobs`` at the
    same time; with `force` also where whole results of the same deck are. All that is
    wrong with one folder is the failure in its outcome; nothing of it is raised.

    Raises
    ------
    UsageError
        As `run_ccx`, before any run.
    """
    if settings.cache:
        cache.check_cache()
    halt = threading.Event()

    def solve(one: tuple[Path, RunFolder | None]) -> Outcome:
        folder, run = one
        if halt.is_set():
            return Outcome(folder, Failure(Cause.INTERRUPTED, "before it began"))
        try:
            run = run or read_run_folder(folder)
            solver = load_solver(run.solver)
            finished = None if force else finished_outcome(run)
            return finished or solver(run, settings, halt)
        except FembridgeError as error:
            problem = str(error).removeprefix(f"{folder}: ")
            return Outcome(folder, Failure(Cause.BAD_FOLDER, problem))
        except BaseException:
            halt.set()  # before this thread takes the next folder
            raise

    unique: dict[Path, tuple[Path, RunFolder | None]] = {}
    for one in folders:
        folder, run = (one, None) if isinstance(one, Path) else (one.folder, one)
        unique.setdefault(folder.resolve(), (folder, run))
    with signals_as_exits(), ThreadPoolExecutor(settings.jobs) as pool:
        try:
            return list(pool.map(solve, unique.values()))
        finally:  # after Ctrl-C the pool waits until each solver is stopped
            halt.set()


def load_solver(name: str) -> Solver:
    """The function that runs the solver `name`."""
    if name == "calculix":
        return run_ccx
    import importlib.metadata

    rows = importlib.metadata.entry_points(group=ENTRY_POINTS)
    for row in rows.select(name=name):
        loaded: Solver = row.load()
        return loaded
    if name in DIALECTS:
        raise MissingError(
            f"{name.capitalize()} is run with your own solver, in the run folder: "
            f"{DIALECTS[name].how_to_run}"
        )
    known = ", ".join(sorted({"calculix", *rows.names}))
    raise MissingError(f"no solver {name!r} here; there is {known}")


def run_ccx(
    run: RunFolder, settings: SolverSettings = DEFAULTS, halt: threading.Event | None = None
) -> Outcome:
    """Solve `run`, so that its results are beside its deck.

    A run that is not accepted is an outcome, not an exception; what the solver left of
    it is in ``failed/``, and results of an earlier run are untouched. When another
    thread sets `halt`, the solver is stopped and the outcome is ``INTERRUPTED``.

    Raises
    ------
    UsageError
        The cache folder is no cache: see `fembridge.cache.check_cache`.
    """
    if settings.cache:
        cache.check_cache()
    failure = Failure(Cause.BAD_FOLDER, f"no {run.deck.name}", "build the deck again")
    if run.deck.is_file():
        try:
            if (program := find_ccx()) is not None:
                with signals_as_exits(), folder_lock(run.folder, LOCK_FILE, wait=False):
                    return _run(program, run, settings, halt)
            install = f"install it: {SOLVER_INSTALL_LINE}"
            failure = Failure(Cause.NO_SOLVER, "no ccx on the PATH", install)
        except MissingError as error:
            failure = Failure(Cause.NO_SOLVER, str(error))
        except LockedError as error:
            failure = Failure(Cause.BUSY, error.problem)
    return Outcome(run.folder, failure)


def solve_once(
    run: RunFolder, settings: SolverSettings = DEFAULTS, halt: threading.Event | None = None
) -> Outcome:
    """Outcome of `run`, which is solved unless whole results of its deck are there."""
    return finished_outcome(run) or run_ccx(run, settings, halt)


def warnings_of(run: RunFolder, deck: Path) -> list[str]:
    """What ccx will leave out of the deck of `run`: it reads it, without analysis.

    Lines are those of `deck`, from which that was made. None where there is no ccx; what
    was said until then, and that it was not read, where it takes longer than half a minute.
    """
    program = find_ccx()
    if program is None:
        return []
    with contextlib.suppress(OSError, OutputError), working_folder(run.folder) as work:
        for path in run.folder.iterdir():
            if path.is_file() and path.suffix not in (".frd", ".dat", ".toml"):
                shutil.copyfile(path, work / path.name)
        copy, log = work / f"{JOB}.inp", work / LOG_FILE
        copy.write_bytes(_END_STEP.sub(rb"*NO ANALYSIS\n\g<0>", copy.read_bytes()))
        process = start(program, ["-i", JOB], work, log, threads=1)
        try:
            process.wait(READING_S)
            unread = []
        except subprocess.TimeoutExpired:
            unread = [f"CalculiX had not read the deck after {READING_S:g} s: it may never"]
        finally:
            stop(process, grace_s=0)
        said = [each for each in read_solver_log(log).dropped if _NO_ANALYSIS not in each.text]
        lines = [each.card and find_card(deck, each.card) for each in said]
        places = [f"line {line}: " if line else "" for line in lines]
        warned = zip(places, said, strict=True)
        return [*(f"{at}CalculiX warns: {each}" for at, each in warned), *unread]
    return []


def finished_outcome(run: RunFolder) -> Outcome | None:
    """The outcome on record, if the results are whole and of the deck there; else None."""
    try:
        table = read_toml(run.folder / SOLVER_FILE, FembridgeError)
        recorded = {name: text for name, text in table.items() if name.endswith("_sha256")}
        if table["format"] != RECORD_FORMAT or recorded != _digests(run.folder):
            return None
        return Outcome(
            folder=run.folder,
            skipped=True,
            version=str(table["version"]) or None,
            exit_code=int(table["exit_code"]),
            wall_s=float(table["wall_s"]),
            increments=int(table["increments"]),
            iterations=int(table["iterations"]),
            threads=table.get("threads"),
            as_built=table["deck_sha256"] == run.deck_sha256,
        )
    except (FembridgeError, OSError, KeyError, TypeError, ValueError):  # also: no TOML
        return None


class Watchdog:
    """Watches the files that the solver of `run` writes in the folder `work`.

    CalculiX flushes its ``.sta`` and ``.cvg`` line by line; when they have grown, what is new
    in them is read. The caller brings the time: seconds since the start.
    """

    def __init__(self, work: Path, run: RunFolder, settings: SolverSettings) -> None:
        self._work, self._run, self._settings = work, run, settings
        self._sizes: dict[str, int] = {}
        self._grown_at_s = 0.0
        self._sta: list[StaRow] = []
        self._cvg: list[CvgRow] = []

    def look(self, elapsed_s: float) -> Progress:
        """Look at the files: how far the run is."""
        before, self._sizes = self._sizes, {}
        try:
            with os.scandir(self._work) as entries:
                for entry in entries:
                    with contextlib.suppress(FileNotFoundError):  # a scratch file of the solver
                        self._sizes[entry.name] = entry.stat().st_size
        except OSError as error:
            raise OutputError(f"gone during the run: {error.strerror}", self._work) from error
        changed = {name for name, _ in before.items() ^ self._sizes.items()}
        if changed:
            self._grown_at_s = elapsed_s
        # A line that cannot be read changes nothing here; the verdict will report it.
        with contextlib.suppress(ResultError):
            if f"{JOB}.sta" in changed:
                self._sta += read_sta(self._work / f"{JOB}.sta", len(self._sta))
        with contextlib.suppress(ResultError):
            if f"{JOB}.cvg" in changed:
                self._cvg += read_cvg(self._work / f"{JOB}.cvg", len(self._cvg))
        good = [row for row in self._sta if not row.failed]
        attempts = [(row.step, row.increment, row.attempt) for row in self._cvg]
        here = next((n for n, one in enumerate(reversed(attempts)) if one != attempts[-1]), None)
        return Progress(
            folder=self._run.folder,
            increment=len(good),
            increments=self._run.increments_in_all,
            time_ms=good[-1].total_time_ms if good else 0.0,
            end_ms=self._run.end_ms,
            iterations=len(attempts),
            iterations_here=len(attempts) if here is None else here,
            elapsed_s=elapsed_s,
        )

    def complaint(self, progress: Progress) -> Failure | None:
        """The reason to stop the run, if what `look` has seen is one."""
        settings, elapsed_s = self._settings, progress.elapsed_s
        place = (
            f"after {progress.increment} of {progress.increments} increments, "
            f"{progress.time_ms:g} of {progress.end_ms:g} ms"
        )
        most = settings.iteration_limit
        if most is not None and progress.iterations_here > most:
            found = f"{progress.iterations_here} iterations, limit {most}, {place}"
            return Failure(Cause.ENDLESS_ITERATION, found)
        if settings.time_limit_s is not None and elapsed_s > settings.time_limit_s:
            return Failure(Cause.TIME_LIMIT, f"{settings.time_limit_s:g} s were over {place}")
        still_s = elapsed_s - self._grown_at_s
        if settings.stall_limit_s is not None and still_s > settings.stall_limit_s:
            return Failure(Cause.STALLED, f"no file has grown for {still_s:.0f} s {place}")
        return None


def _run(
    program: Path, run: RunFolder, settings: SolverSettings, halt: threading.Event | None
) -> Outcome:
    """Run, judge, and put the files where they belong; the folder is locked for it."""
    work = run.folder / WORK_FOLDER
    try:
        deck_sha256 = _begin(run, work)
        key = _cache_key(program, run.deck, deck_sha256) if settings.cache else None
        if key is not None and (record := cache.take(key, work)) is not None:
            if (outcome := _solved_before(run, work, record)) is not None:
                return outcome
            _begin(run, work)
    except OutputError:  # half a deck, or half an entry, on a full disk
        shutil.rmtree(work, ignore_errors=True)
        raise
    watchdog = Watchdog(work, run, settings)
    begin_s = time.monotonic()
    words = ["-i", os.path.join(WORK_FOLDER, JOB)]  # noqa: PTH118 - a word for ccx
    process = start(program, words, run.folder, work / LOG_FILE, settings.threads)
    try:
        failure = _watch(process, watchdog, begin_s, settings.on_progress, halt)
    except BaseException as error:
        stop(process)
        with contextlib.suppress(OSError, OutputError):
            _collect(run, work)
            _keep_evidence(run, work, Failure(Cause.INTERRUPTED, type(error).__name__))
        raise
    wall_s = time.monotonic() - begin_s
    _collect(run, work)
    log = read_solver_log(work / LOG_FILE)
    failure = failure or judge(work, run, process.returncode, log)
    progress = watchdog.look(wall_s)
    outcome = Outcome(
        folder=run.folder,
        failure=failure,
        version=log.version,
        exit_code=process.returncode,
        wall_s=wall_s,
        increments=progress.increment,
        iterations=progress.iterations,
        threads=settings.threads,
        as_built=deck_sha256 == run.deck_sha256,
        warnings=tuple(map(str, log.dropped)) if failure is None else (),
    )
    if failure is None:
        write_record(work, run.solver, outcome)
    if key is not None:
        _into_cache(key, run, work, outcome)
    if failure is None:
        _publish(run, work)
    else:
        _keep_evidence(run, work, failure)
    return outcome


def _cache_key(program: Path, deck: Path, deck_sha256: str) -> str | None:
    """Key of a run by what it is made from; None where files beside the deck count too."""
    if REFERS.search(deck.read_text(encoding="ascii", errors="replace")):
        return None
    made_from = {"deck": deck_sha256, "solver": sha256_of(program), "record": RECORD_FORMAT}
    return cache.key_of(made_from)


def _begin(run: RunFolder, work: Path) -> str:
    """Make `work` anew, with the deck in it; the checksum of that.

    Where `work` is there, a kill has left it, and what the solver had written outside.
    """
    if work.is_dir():
        for name in FIXED_NAMES:
            with contextlib.suppress(OSError):
                (run.folder / name).unlink()
    for folder in (work, run.folder / FAILED_FOLDER):
        _remove(folder)
    make_folder(work)
    try:
        shutil.copyfile(run.deck, work / f"{JOB}.inp")
    except OSError as error:
        raise OutputError(f"the deck cannot be copied: {error.strerror}", work) from error
    return sha256_of(work / f"{JOB}.inp")


def _solved_before(run: RunFolder, work: Path, record: Table) -> Outcome | None:
    """The outcome of a run from the cache, whose files are in `work`; None: they are of none."""
    cause, finding, version = (record.get(name) for name in ("cause", "found", "version"))
    if cause is not None:
        causes = {end.name: end for end in _GIVEN_UP if end.name == cause}
        if not (causes and isinstance(finding, str) and isinstance(version, str)):
            return None
        failure = Failure(causes[cause], finding)
        _keep_evidence(run, work, failure)
        return Outcome(run.folder, failure, cached=True, version=version)
    outcome = finished_outcome(replace(run, folder=work))
    if outcome is None:
        return None
    _publish(run, work)
    return replace(outcome, folder=run.folder, cached=True)


def _into_cache(key: str, run: RunFolder, work: Path, outcome: Outcome) -> None:
    """Keep a whole run, or that the solver itself gave it up; no limit of a user's."""
    failure = outcome.failure
    made_from = ((run.inputs.get(part) or {}).get(key) for part, key in _NAMED)
    what = ", ".join(str(name) for name in made_from if name) or run.folder.name
    record: Table = {"version": outcome.version or "", "deck_bytes": run.deck.stat().st_size}
    kept: tuple[str, ...] = (LOG_FILE,)
    if failure is None:
        record |= {"wall_s": outcome.wall_s, "increments": outcome.increments}
        kept += (SOLVER_FILE, *(f"{JOB}{suffix}" for suffix in (".frd", ".dat", ".sta", ".cvg")))
    elif failure.cause in _GIVEN_UP:
        record |= {"cause": failure.cause.name, "found": failure.found}
        what = f"{what}: {failure.cause.value}"
    else:
        return
    cache.keep(key, what, record, [file for file in work.iterdir() if file.name in kept])


def _watch(
    process: subprocess.Popen[bytes],
    watchdog: Watchdog,
    begin_s: float,
    on_progress: OnProgress | None,
    halt: threading.Event | None,
) -> Failure | None:
    """Wait for the end; stop the solver when the watchdog or `halt` says so."""
    pause_s = FIRST_LOOK_S
    failure = None
    while process.returncode is None and failure is None:
        try:
            process.wait(timeout=pause_s)
        except subprocess.TimeoutExpired:
            pause_s = min(1.2 * pause_s, SLOWEST_LOOK_S)
        progress = watchdog.look(time.monotonic() - begin_s)
        if process.returncode is None:
            if on_progress is not None:
                on_progress(progress)
            failure = watchdog.complaint(progress)
            if failure is None and halt is not None and halt.is_set():
                done = f"after {progress.increment} of {progress.increments} increments"
                failure = Failure(Cause.INTERRUPTED, done)
            if failure is not None:
                stop(process)
    if on_progress is not None:
        on_progress(replace(progress, ended=True))
    return failure


def _collect(run: RunFolder, work: Path) -> None:
    """Bring in what the solver wrote outside of `work`."""
    for name in FIXED_NAMES:
        with contextlib.suppress(FileNotFoundError):
            (run.folder / name).replace(work / name)


def _publish(run: RunFolder, work: Path) -> None:
    """Move the results of an accepted run beside the deck, the record last.

    Empty files are left out: a ``.dat`` that nobody asked for, say.
    """
    found = (path for path in work.iterdir() if path.is_file() and path.stat().st_size)
    new = {path.name for path in found} - {f"{JOB}.inp", SOLVER_FILE}
    try:
        (run.folder / SOLVER_FILE).unlink(missing_ok=True)
        for name in sorted({f"{JOB}{suffix}" for suffix in OLD_RESULTS} - new):
            (run.folder / name).unlink(missing_ok=True)
        for name in (*sorted(new), SOLVER_FILE):
            (work / name).replace(run.folder / name)
    except OSError as error:
        problem = f"the results in {work} cannot be moved here: {error.strerror}"
        raise OutputError(problem, run.folder) from error
    _remove(work)


def _keep_evidence(run: RunFolder, work: Path, failure: Failure) -> None:
    """Keep the files of a run that failed, and why, under ``failed/``."""
    with contextlib.suppress(OutputError):  # on a full disk the cause is printed
        write_text(work / CAUSE_FILE, f"{failure}\n")
    try:
        work.replace(run.folder / FAILED_FOLDER)
    except OSError as error:
        raise OutputError(f"cannot become {FAILED_FOLDER}/: {error.strerror}", work) from error


def write_record(folder: Path, solver: str, outcome: Outcome) -> None:
    """Write ``solver.toml`` beside the deck and the results that `outcome` is of."""
    table: Table = {
        "format": RECORD_FORMAT,
        "solver": solver,
        "version": outcome.version or "",
        "exit_code": outcome.exit_code,
        "wall_s": round(outcome.wall_s, 3),
        "increments": outcome.increments,
        "iterations": outcome.iterations,
        **_digests(folder),
        **({} if outcome.threads is None else {"threads": outcome.threads}),
    }
    write_toml(folder / SOLVER_FILE, table)


def _digests(folder: Path) -> dict[str, str]:
    """Checksums of the deck, the results, and the forces where the deck asks for them."""
    digests = {
        "deck_sha256": sha256_of(folder / f"{JOB}.inp"),
        "results_sha256": sha256_of(folder / f"{JOB}.frd"),
    }
    printed = folder / f"{JOB}.dat"
    if printed.is_file() and printed.stat().st_size:
        digests["printed_sha256"] = sha256_of(printed)
    return digests


def _remove(folder: Path) -> None:
    """Remove a folder of ours; a file or a link in its place is not ours."""
    try:
        shutil.rmtree(folder)
    except FileNotFoundError:
        return
    except OSError as error:
        raise OutputError(
            f"cannot be removed to make room for a run: {error.strerror or error}", folder
        ) from error
