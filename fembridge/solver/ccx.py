"""CalculiX in run folders: starts it, watches it, stops it and records the outcome.

``ccx -i solving/job`` is started in the run folder itself, so that an ``*INCLUDE``
in the deck finds its file relative to the run folder.

``solving/``     during a run: a copy of the deck, and all files of the solver
``failed/``      after a rejected run: the same files, with ``cause.txt``
``solver.toml``  after an accepted run: checksums of deck and results, and their cost

The files of an accepted run are moved next to the deck, the record last; the old record is
removed before any file is replaced. So ``job.frd`` is always the complete result of an
accepted run, whether later runs fail or not, and where the checksums of the record match,
it is the result of this deck.

Another solver is run by the function that a package registers in the entry point group
``fembridge.solvers``. The entry has the solver's name in ``run.toml``; its object has the
signature of `run_ccx`.
"""

import contextlib
import os
import re
import shutil
import subprocess
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

from decks.dialects import DIALECTS, JOB
from fembridge.errors import (
    FembridgeError,
    LockedError,
    MissingError,
    OutputError,
    ResultError,
    UsageError,
    check_type,
)
from fembridge.host import cache
from fembridge.host.machine import SOLVER_INSTALL_LINE, find_ccx
from fembridge.host.process import signals_as_exits, start, stop
from fembridge.host.progress import OnProgress, Progress
from fembridge.host.store import (
    folder_lock,
    make_folder,
    read_toml,
    sha256_of,
    working_folder,
    write_text,
    write_toml,
)
from fembridge.io.run_folder import SOLVER_FILE, RunFolder, check_run_folder, read_run_folder
from fembridge.results.status import CvgRow, StaRow, read_cvg, read_sta
from fembridge.solver.settings import DEFAULTS, Solver
from fembridge.solver.verdict import (
    Cause,
    Failure,
    Outcome,
    SolverLog,
    find_card,
    judge,
    read_solver_log,
)
from fembridge.typing import Table

ENTRY_POINTS = "fembridge.solvers"
FIRST_LOOK_S = 0.05
READING_S = 30.0
"""Longest time in s for CalculiX to read a deck without analysis."""
SLOWEST_LOOK_S = 1.0
"""Longest pause in s between two looks at the files; pauses grow during a run."""

_END_STEP = re.compile(rb"^[ \t]*\*[ \t]*END[ \t]*STEP", re.MULTILINE | re.IGNORECASE)
_NO_ANALYSIS = "no analysis option"

WORK_FOLDER = "solving"
FAILED_FOLDER = "failed"
CAUSE_FILE = "cause.txt"
LOG_FILE = "solver.log"
LOCK_FILE = ".solver.lock"
FIXED_NAMES = ("spooles.out", "ResultsForLastIterations.frd")
"""Files that CalculiX writes in its working directory instead of next to its deck."""
OLD_RESULTS = (".frd", ".dat", ".sta", ".cvg", ".12d", ".cel")
"""Suffixes of a run's files; those of an earlier run are removed from the run folder."""
RECORD_FORMAT = 1
REFERS = re.compile(r"(?im)^\s*\*(?:INCLUDE|RESTART|SUBMODEL)|^\s*\*.*,\s*(?:INPUT|FILE)\s*=")
"""Cards of a deck that read another file."""

_CACHED_FAILURES = (Cause.DIVERGED, Cause.NEGATIVE_JACOBIAN)
"""Failures stored in the cache: those that the solver would repeat with the same deck."""
_LABEL_KEYS = (("finger", "name"), ("stimulus", "id"))
"""Keys of a run's inputs that label its entry in the cache."""


RunPath: TypeAlias = str | os.PathLike[str] | RunFolder
"""A run folder: its path, or its value."""

SolverFunction: TypeAlias = Callable[[RunFolder, Solver, threading.Event | None], Outcome]
"""Solves one run; a rejected run is an outcome, not an exception."""


def run(
    folders: "RunPath | Sequence[RunPath]",
    *,
    solver: Solver = DEFAULTS,
    force: bool = False,
) -> list[Outcome]:
    """Outcomes of the solver in run folders, in that order.

    The results of an accepted run are next to its deck. A folder with complete results of
    its deck is skipped, and results that this machine solved before come from its cache. The
    `failure` of an outcome is None, or the cause of the rejection.

    Parameters
    ----------
    folders
        Run folders: paths, values of `fembridge.build_deck`, or a list of these.
    solver
        Threads, simultaneous runs, limits and cache. Default: one run at a time, no time
        limit.
    force
        Whether to solve also folders with complete results, without the cache.
        Default: False.

    Raises
    ------
    ResultError
        A folder without ``run.toml``; raised before any run.
    UsageError
        `folders` is of another type, or the cache folder is no cache.

    Examples
    --------
    >>> import fembridge as fb
    >>> [folder] = fb.build_deck("sine_20_250", "runs")
    >>> [outcome] = fb.run(folder)  # with CalculiX installed, outcome.accepted is True
    """
    is_one = isinstance(folders, str | os.PathLike | RunFolder)
    items: Sequence[RunPath] = [folders] if is_one else folders  # type: ignore[list-item,assignment] # narrowed
    if not isinstance(items, Iterable):
        raise UsageError(
            argument="folders", found=folders, expected="a run folder, or a list of these"
        )
    check_type("solver", solver, Solver)
    runs = [item if isinstance(item, RunFolder) else Path(item) for item in items]
    for item in runs:
        if isinstance(item, Path):
            check_run_folder(item)
    settings = replace(solver, cache=False) if force else solver
    return run_folders(runs, settings, force=force)


def run_folders(
    folders: Iterable[Path | RunFolder], settings: Solver = DEFAULTS, *, force: bool = False
) -> list[Outcome]:
    """Outcomes of the runs in `folders`, in that order; a duplicate folder is run once.

    Each run uses the solver in its ``run.toml``. An error in one folder becomes the
    failure of its outcome and is not raised.

    Parameters
    ----------
    folders
        Run folders, or paths of run folders.
    settings
        How the solver is run; ``settings.jobs`` runs at the same time.
    force
        Also solve folders that have complete results of the same deck. Default: False.

    Raises
    ------
    UsageError
        The cache folder is no cache: raised before any run.
    """
    if settings.cache:
        cache.check_cache()
    halt = threading.Event()

    def solve(entry: tuple[Path, RunFolder | None]) -> Outcome:
        folder, run = entry
        if halt.is_set():
            return Outcome(folder, Failure(Cause.INTERRUPTED, "before it was started"))
        try:
            run = run or read_run_folder(folder)
            solver = load_solver(run.solver)
            finished = None if force else finished_outcome(run)
            return finished or solver(run, settings, halt)
        except (OutputError, ResultError) as error:
            in_folder = error.path == folder and error.line is None
            problem = error.problem if in_folder else str(error)
            return Outcome(folder, Failure(Cause.BAD_FOLDER, problem))
        except FembridgeError as error:
            return Outcome(folder, Failure(Cause.BAD_FOLDER, str(error)))
        except BaseException:
            halt.set()  # before this thread takes the next folder
            raise

    unique: dict[Path, tuple[Path, RunFolder | None]] = {}
    for entry in folders:
        folder, run = (entry, None) if isinstance(entry, Path) else (entry.folder, entry)
        unique.setdefault(folder.resolve(), (folder, run))
    with signals_as_exits(), ThreadPoolExecutor(settings.jobs) as pool:
        try:
            return list(pool.map(solve, unique.values()))
        finally:  # after Ctrl-C the pool waits until every solver has stopped
            halt.set()


def load_solver(name: str) -> SolverFunction:
    """The function that runs the solver `name`."""
    if name == "calculix":
        return run_ccx
    import importlib.metadata

    rows = importlib.metadata.entry_points(group=ENTRY_POINTS)
    for row in rows.select(name=name):
        loaded: SolverFunction = row.load()
        return loaded
    if name in DIALECTS:
        raise MissingError(
            f"{name.capitalize()} is not run by fembridge: start it in the run folder with "
            f"{DIALECTS[name].how_to_run}",
            found=name,
        )
    names = " or ".join(sorted({"calculix", *rows.names}))
    raise MissingError(f"no solver {name!r}, expected {names}", found=name, expected=names)


def run_ccx(
    run: RunFolder,
    settings: Solver = DEFAULTS,
    halt: threading.Event | None = None,
    on_start: Callable[[], None] | None = None,
) -> Outcome:
    """Outcome of `run`, solved here; accepted results are next to its deck.

    A rejected run is an outcome, not an exception; its files are in ``failed/``, and results
    of an earlier run are untouched. When another thread sets `halt`, the solver is stopped
    and the outcome is ``INTERRUPTED``. `on_start` is called before the solver starts, not for
    results from the cache.

    Raises
    ------
    UsageError
        The cache folder is no cache: see `fembridge.host.cache.check_cache`.
    """
    if settings.cache:
        cache.check_cache()
    failure = Failure(Cause.BAD_FOLDER, f"no {run.deck.name}", "build the deck again")
    if run.deck.is_file():
        try:
            if (program := find_ccx()) is not None:
                with signals_as_exits(), folder_lock(run.folder, LOCK_FILE, wait=False):
                    return _run(program, run, settings, halt, on_start)
            install = f"install it: {SOLVER_INSTALL_LINE}"
            failure = Failure(Cause.NO_SOLVER, "no ccx on the PATH", install)
        except MissingError as error:
            failure = Failure(Cause.NO_SOLVER, str(error))
        except LockedError as error:
            failure = Failure(Cause.BUSY, error.problem)
    return Outcome(run.folder, failure)


def solve_once(
    run: RunFolder,
    settings: Solver = DEFAULTS,
    halt: threading.Event | None = None,
    on_start: Callable[[], None] | None = None,
) -> Outcome:
    """Outcome of `run`, solved unless complete results of its deck exist; see `run_ccx`."""
    return finished_outcome(run) or run_ccx(run, settings, halt, on_start)


def deck_warnings(run: RunFolder, deck: Path) -> list[str]:
    """Warnings of ccx about cards that it ignores in the deck of `run`.

    Line numbers are those of `deck`, from which the deck of `run` was made. Empty without ccx;
    where the time is over, the warnings so far and a note.
    """
    with contextlib.suppress(OSError, OutputError), working_folder(run.folder) as work:
        paths = [path for path in run.folder.iterdir() if path.is_file()]
        includable = [path for path in paths if path.suffix not in (".frd", ".dat", ".toml")]
        log = read_without_analysis(run.deck.read_bytes(), includable, work)
        if log is None:
            return []
        lines = [message.card and find_card(deck, message.card) for message in log.dropped]
        prefixes = [f"line {line}: " if line else "" for line in lines]
        numbered = zip(prefixes, log.dropped, strict=True)
        return [
            *(f"{prefix}CalculiX warns: {message}" for prefix, message in numbered),
            *([unread_text()] if log.exit_code is None else []),
        ]
    return []


def unread_text() -> str:
    """The warning about a deck that `read_without_analysis` stopped."""
    return f"CalculiX had not read the deck after {READING_S:g} s"


def read_without_analysis(deck: bytes, includable: Iterable[Path], work: Path) -> SolverLog | None:
    """Log of CalculiX that reads `deck` in the folder `work`; None without ccx.

    It solves nothing and gets at most 30 s. The files `includable` are copied, for the deck
    may include them.
    """
    program = find_ccx()
    if program is None:
        return None
    for path in includable:
        if path.name != f"{JOB}.inp":
            shutil.copyfile(path, work / path.name)
    log = work / LOG_FILE
    (work / f"{JOB}.inp").write_bytes(_END_STEP.sub(rb"*NO ANALYSIS\n\g<0>", deck))
    process = start(program, ["-i", JOB], work, log, threads=1)
    exit_code = None
    try:
        exit_code = process.wait(READING_S)
    except subprocess.TimeoutExpired:
        pass
    finally:
        stop(process, grace_s=0)
    messages = read_solver_log(log)
    dropped = [message for message in messages.dropped if _NO_ANALYSIS not in message.text]
    return replace(messages, dropped=dropped, exit_code=exit_code)


def finished_outcome(run: RunFolder) -> Outcome | None:
    """Recorded outcome, where the results are complete and match the deck; else None."""
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

    CalculiX flushes its ``.sta`` and ``.cvg`` line by line; new lines are read. The caller
    passes the time in seconds since the start.
    """

    def __init__(self, work: Path, run: RunFolder, settings: Solver) -> None:
        self._work, self._run, self._settings = work, run, settings
        self._sizes: dict[str, int] = {}
        self._grown_at_s = 0.0
        self._sta: list[StaRow] = []
        self._cvg: list[CvgRow] = []

    def read_progress(self, elapsed_s: float) -> Progress:
        """Progress of the run, from the files at `elapsed_s`."""
        earlier_sizes, self._sizes = self._sizes, {}
        try:
            with os.scandir(self._work) as entries:
                for entry in entries:
                    with contextlib.suppress(FileNotFoundError):  # a scratch file of the solver
                        self._sizes[entry.name] = entry.stat().st_size
        except OSError as error:
            raise OutputError(
                f"disappeared during the run: {error.strerror}", self._work
            ) from error
        changed = {name for name, _ in earlier_sizes.items() ^ self._sizes.items()}
        if changed:
            self._grown_at_s = elapsed_s
        # A line that cannot be read is ignored here and reported by the verdict.
        with contextlib.suppress(ResultError):
            if f"{JOB}.sta" in changed:
                self._sta += read_sta(self._work / f"{JOB}.sta", len(self._sta))
        with contextlib.suppress(ResultError):
            if f"{JOB}.cvg" in changed:
                self._cvg += read_cvg(self._work / f"{JOB}.cvg", len(self._cvg))
        converged = [row for row in self._sta if not row.failed]
        attempts = [(row.step, row.increment, row.attempt) for row in self._cvg]
        attempt_iterations = next(
            (n for n, attempt in enumerate(reversed(attempts)) if attempt != attempts[-1]), None
        )
        return Progress(
            folder=self._run.folder,
            increment=len(converged),
            increments=self._run.increments_in_all,
            time_ms=converged[-1].total_time_ms if converged else 0.0,
            end_ms=self._run.end_ms,
            iterations=len(attempts),
            iterations_here=len(attempts) if attempt_iterations is None else attempt_iterations,
            elapsed_s=elapsed_s,
        )

    def stop_reason(self, progress: Progress) -> Failure | None:
        """Failure for which the run must be stopped, or None."""
        settings, elapsed_s = self._settings, progress.elapsed_s
        progress_text = (
            f"after {progress.increment} of {progress.increments} increments, "
            f"{progress.time_ms:g} of {progress.end_ms:g} ms"
        )
        max_iterations = settings.iteration_limit
        if max_iterations is not None and progress.iterations_here > max_iterations:
            finding = (
                f"{progress.iterations_here} iterations, limit {max_iterations}, {progress_text}"
            )
            return Failure(Cause.ENDLESS_ITERATION, finding)
        if settings.time_limit_s is not None and elapsed_s > settings.time_limit_s:
            finding = f"{settings.time_limit_s:g} s were over {progress_text}"
            return Failure(Cause.TIME_LIMIT, finding)
        idle_s = elapsed_s - self._grown_at_s
        if settings.stall_limit_s is not None and idle_s > settings.stall_limit_s:
            return Failure(Cause.STALLED, f"no file has grown for {idle_s:.0f} s {progress_text}")
        return None


def _run(
    program: Path,
    run: RunFolder,
    settings: Solver,
    halt: threading.Event | None,
    on_start: Callable[[], None] | None,
) -> Outcome:
    """Outcome of a run in the locked folder: solved, judged, files moved to their place."""
    work = run.folder / WORK_FOLDER
    try:
        deck_sha256 = _prepare_work_folder(run, work)
        key = _cache_key(program, run.deck, deck_sha256) if settings.cache else None
        if key is not None and (record := cache.take(key, work)) is not None:
            if (outcome := _outcome_from_cache(run, work, record)) is not None:
                return outcome
            _prepare_work_folder(run, work)
    except OutputError:  # an incomplete deck or cache entry on a full disk
        shutil.rmtree(work, ignore_errors=True)
        raise
    if on_start is not None:
        on_start()
    watchdog = Watchdog(work, run, settings)
    begin_s = time.monotonic()
    arguments = ["-i", os.path.join(WORK_FOLDER, JOB)]  # noqa: PTH118 - an argument of ccx
    process = start(program, arguments, run.folder, work / LOG_FILE, settings.threads)
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
    progress = watchdog.read_progress(wall_s)
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
        _store_in_cache(key, run, work, outcome)
    if failure is None:
        _publish(run, work)
    else:
        _keep_evidence(run, work, failure)
    return outcome


def _cache_key(program: Path, deck: Path, deck_sha256: str) -> str | None:
    """Cache key of a run from deck and solver; None where the deck includes other files."""
    if REFERS.search(deck.read_text(encoding="ascii", errors="replace")):
        return None
    made_from = {"deck": deck_sha256, "solver": sha256_of(program), "record": RECORD_FORMAT}
    return cache.key_of(made_from)


def _prepare_work_folder(run: RunFolder, work: Path) -> str:
    """Checksum of the deck in `work`, a new folder with a copy of the deck.

    A killed run leaves `work` and files outside of it; both are removed.
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


def _outcome_from_cache(run: RunFolder, work: Path, record: Table) -> Outcome | None:
    """Outcome of a run from the cache with its files in `work`; None for an invalid entry."""
    cause, finding, version = (record.get(name) for name in ("cause", "found", "version"))
    if cause is not None:
        causes = {end.name: end for end in _CACHED_FAILURES if end.name == cause}
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


def _store_in_cache(key: str, run: RunFolder, work: Path, outcome: Outcome) -> None:
    """Store an accepted run or a failure of `_CACHED_FAILURES`; no run stopped by a limit."""
    failure = outcome.failure
    labels = ((run.inputs.get(part) or {}).get(key) for part, key in _LABEL_KEYS)
    label = ", ".join(str(name) for name in labels if name) or run.folder.name
    record: Table = {"version": outcome.version or "", "deck_bytes": run.deck.stat().st_size}
    kept_names: tuple[str, ...] = (LOG_FILE,)
    if failure is None:
        record |= {"wall_s": outcome.wall_s, "increments": outcome.increments}
        kept_names += (
            SOLVER_FILE,
            *(f"{JOB}{suffix}" for suffix in (".frd", ".dat", ".sta", ".cvg")),
        )
    elif failure.cause in _CACHED_FAILURES:
        record |= {"cause": failure.cause.name, "found": failure.finding}
        label = f"{label}: {failure.cause.value}"
    else:
        return
    cache.keep(key, label, record, [file for file in work.iterdir() if file.name in kept_names])


def _watch(
    process: subprocess.Popen[bytes],
    watchdog: Watchdog,
    begin_s: float,
    on_progress: OnProgress | None,
    halt: threading.Event | None,
) -> Failure | None:
    """Failure for which the solver was stopped, by the watchdog or `halt`; None at its own end."""
    pause_s = FIRST_LOOK_S
    failure = None
    while process.returncode is None and failure is None:
        try:
            process.wait(timeout=pause_s)
        except subprocess.TimeoutExpired:
            pause_s = min(1.2 * pause_s, SLOWEST_LOOK_S)
        progress = watchdog.read_progress(time.monotonic() - begin_s)
        if process.returncode is None:
            if on_progress is not None:
                on_progress(progress)
            failure = watchdog.stop_reason(progress)
            if failure is None and halt is not None and halt.is_set():
                done = f"after {progress.increment} of {progress.increments} increments"
                failure = Failure(Cause.INTERRUPTED, done)
            if failure is not None:
                stop(process)
    if on_progress is not None:
        on_progress(replace(progress, has_ended=True))
    return failure


def _collect(run: RunFolder, work: Path) -> None:
    """Move files that the solver wrote outside of `work` into it."""
    for name in FIXED_NAMES:
        with contextlib.suppress(FileNotFoundError):
            (run.folder / name).replace(work / name)


def _publish(run: RunFolder, work: Path) -> None:
    """Move the results of an accepted run next to the deck, the record last.

    Empty files are left out, such as a ``.dat`` without requested output.
    """
    result_files = (path for path in work.iterdir() if path.is_file() and path.stat().st_size)
    new_names = {path.name for path in result_files} - {f"{JOB}.inp", SOLVER_FILE}
    try:
        (run.folder / SOLVER_FILE).unlink(missing_ok=True)
        for name in sorted({f"{JOB}{suffix}" for suffix in OLD_RESULTS} - new_names):
            (run.folder / name).unlink(missing_ok=True)
        for name in (*sorted(new_names), SOLVER_FILE):
            (work / name).replace(run.folder / name)
    except OSError as error:
        problem = f"the results in {work} cannot be moved to this folder: {error.strerror}"
        raise OutputError(problem, run.folder) from error
    _remove(work)


def _keep_evidence(run: RunFolder, work: Path, failure: Failure) -> None:
    """Move the files of a rejected run to ``failed/``, with the cause."""
    with contextlib.suppress(OutputError):  # on a full disk the cause is printed
        write_text(work / CAUSE_FILE, f"{failure}\n")
    try:
        work.replace(run.folder / FAILED_FOLDER)
    except OSError as error:
        raise OutputError(f"cannot be moved to {FAILED_FOLDER}/: {error.strerror}", work) from error


def write_record(folder: Path, solver: str, outcome: Outcome) -> None:
    """Write ``solver.toml`` of `outcome` into the `folder` with its deck and results."""
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
    """Checksums of the deck, the results, and the forces where the deck requests them."""
    digests = {
        "deck_sha256": sha256_of(folder / f"{JOB}.inp"),
        "results_sha256": sha256_of(folder / f"{JOB}.frd"),
    }
    printed = folder / f"{JOB}.dat"
    if printed.is_file() and printed.stat().st_size:
        digests["printed_sha256"] = sha256_of(printed)
    return digests


def _remove(folder: Path) -> None:
    """Remove a folder that fembridge made; a file or a link of that name is an OutputError."""
    try:
        shutil.rmtree(folder)
    except FileNotFoundError:
        return
    except OSError as error:
        raise OutputError(
            f"cannot be removed before a run: {error.strerror or error}", folder
        ) from error
