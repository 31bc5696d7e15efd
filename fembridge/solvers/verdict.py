"""Whether a run that ended is good, and the cause if it is not.

CalculiX exits with 0 after a missing file, an unknown card and a full disk
alike, so the exit code is one witness of five. A run is good when it is 0, the
log holds no error and no part of the deck was left out, the last increment
converged at the end of the run, and the result file is closed and holds it.
"""

import os
import shutil
import signal
from pathlib import Path

from decks.dialects import JOB
from fembridge.errors import ResultError
from fembridge.results.byte_file import ByteFile
from fembridge.results.frd_format.index import FrdIndex, index_frd
from fembridge.results.printed.sta import StaRow, read_sta
from fembridge.run_folder import RunFolder
from fembridge.solvers.guard import CANNOT_RUN
from fembridge.solvers.outcome import Cause, Failure
from fembridge.solvers.solver_log import LogMessage, SolverLog, find_card

OUT_OF_MEMORY_EXIT = 16
CANNOT_EXECUTE = 126  # as shells have it
NO_ROOM_BYTES = 64 * 1024
"""With less free, a failure that tells no reason is taken for one of room."""

SHOWN = 3
"""Messages that are quoted; the log has them all."""

NO_CONVERGENCE = (
    "seems to diverge",
    "increment size smaller than minimum",
    "too many cutbacks",
    "too many iterations",
)
CRASHES = {
    signal.SIGABRT,
    signal.SIGBUS,
    signal.SIGFPE,
    signal.SIGILL,
    signal.SIGSEGV,
    signal.SIGSYS,
}
TIME_TOLERANCE = 1.0e-5
"""Of the end; times in the ``.sta`` have seven digits, in the ``.frd`` six."""

MIB = 1024**2


def judge(work: Path, run: RunFolder, exit_code: int, log: SolverLog) -> Failure | None:
    """Judge what the solver of `run` left in the folder `work`.

    The folder held nothing but the deck before, so all that is there is new.
    """
    deck = work / f"{JOB}.inp"
    told = (
        _from_errors(work, run, log, deck)
        or _from_exit(work, exit_code, log)
        or _from_warnings(log, deck)
    )
    if told is not None:
        return told
    found = _whole_results(work)
    if isinstance(found, FrdIndex):
        return _from_sta(work, run, log) or _from_blocks(found, run)
    if found.cause is Cause.DISK_FULL:  # which cuts the .sta as well
        return found
    return _from_sta(work, run, log) or found


def increments_made(work: Path) -> list[StaRow]:
    """Give the attempts that the ``.sta`` lists; none when it cannot be read."""
    try:
        return read_sta(work / f"{JOB}.sta")
    except ResultError:
        return []


def _from_errors(work: Path, run: RunFolder, log: SolverLog, deck: Path) -> Failure | None:
    if log.no_room:
        return _disk_full(work, log.no_room)
    if not log.errors:
        return None
    if log.says("error allocating memory", "malloc failed"):
        return _out_of_memory(log)
    missing = log.says("library is not linked")
    if missing:
        return Failure(Cause.SOLVER_NOT_BUILT_IN, missing.text, "take SOLVER=... out of the deck")
    inverted = log.says("nonpositive jacobian")
    if inverted:
        return Failure(
            Cause.NEGATIVE_JACOBIAN, inverted.text, "a 2D element lists its nodes counter-clockwise"
        )
    if log.says("max. # of increments reached"):
        return Failure(
            Cause.INCREMENTS_EXHAUSTED,
            _place(increments_made(work), run),
            "raise INC on the *STEP card",
        )
    diverged = log.says(*NO_CONVERGENCE)
    if diverged:
        return _diverged(increments_made(work), run)
    if increments_made(work):
        return Failure(Cause.UNKNOWN, _quote(log.errors))
    return Failure(Cause.BAD_DECK, _quote(log.errors), deck_line=_line(log.errors, deck))


def _from_exit(work: Path, exit_code: int, log: SolverLog) -> Failure | None:
    if exit_code == 0:
        return None
    if exit_code == -signal.SIGXFSZ:
        return _disk_full(work, "a limit of file size (ulimit -f) was reached")
    if exit_code < 0:
        return _from_signal(-exit_code, log)
    if exit_code == OUT_OF_MEMORY_EXIT:
        return _out_of_memory(log)
    if exit_code in (CANNOT_EXECUTE, CANNOT_RUN):
        return Failure(Cause.NO_SOLVER, log.end, "see fembridge doctor")
    if shutil.disk_usage(work).free < NO_ROOM_BYTES:
        return _disk_full(work, f"exit code {exit_code}")
    return Failure(Cause.UNKNOWN, f"exit code {exit_code}; last words: {log.end}")


def _from_signal(number: int, log: SolverLog) -> Failure:
    name = f"signal {number}"
    if number in set(signal.Signals):
        name += f" ({signal.Signals(number).name})"
    if number in CRASHES:
        return Failure(
            Cause.CRASHED,
            f"{name}; last words: {log.end}",
            "an element with a node that is not there does this, for one",
        )
    if number == signal.SIGKILL:
        name += ", which Linux also sends when memory runs out"
    return Failure(Cause.KILLED, name)


def _from_warnings(log: SolverLog, deck: Path) -> Failure | None:
    if not log.dropped:
        return None
    return Failure(Cause.CARD_DROPPED, _quote(log.dropped), deck_line=_line(log.dropped, deck))


def _from_sta(work: Path, run: RunFolder, log: SolverLog) -> Failure | None:
    try:
        rows = read_sta(work / f"{JOB}.sta")
    except ResultError as error:
        return Failure(Cause.MISSING_OUTPUT, f"{error}; last words: {log.end}")
    if not rows:
        return Failure(Cause.MISSING_OUTPUT, f"no increment was made; last words: {log.end}")
    if rows[-1].failed:
        return _diverged(rows, run)
    if not _is_end(rows[-1].total_time_ms, run):
        return Failure(
            Cause.WRONG_END,
            f"{rows[-1].total_time_ms:g} ms, run.toml says {run.end_ms:g} ms",
            "build the deck again",
        )
    return None


def _whole_results(work: Path) -> FrdIndex | Failure:
    path = work / f"{JOB}.frd"
    try:
        with ByteFile(path) as file:
            index = index_frd(file)
    except ResultError as error:
        if path.exists():  # empty, or cut before its first line was whole
            return _disk_full(work, f"{path.name}: {error.problem}")
        return Failure(Cause.MISSING_OUTPUT, f"no {path.name}")
    if not index.ended:
        return _disk_full(work, f"{path.name} stops at byte {index.size} without its end line 9999")
    if index.damage:
        harm = index.damage[0]
        return _disk_full(work, f"{path.name}, byte {harm.offset}: {harm.problem}")
    return index


def _from_blocks(index: FrdIndex, run: RunFolder) -> Failure | None:
    if not index.blocks:
        return Failure(
            Cause.MISSING_OUTPUT,
            f"{JOB}.frd holds the mesh alone",
            "the deck asks for no *NODE OUTPUT and no *ELEMENT OUTPUT",
        )
    last = index.blocks[-1]
    if not _is_end(last.time_ms, run):
        return Failure(
            Cause.MISSING_OUTPUT,
            f"{JOB}.frd ends with {last} at {last.time_ms:g} ms, expected {run.end_ms:g} ms",
        )
    if last.records == 0:
        return Failure(
            Cause.MISSING_OUTPUT,
            f"{JOB}.frd holds no node in {last}",
            "NSET does not go with OUTPUT=3D",
        )
    return None


def _diverged(rows: list[StaRow], run: RunFolder) -> Failure:
    return Failure(
        Cause.DIVERGED, _place(rows, run), "make increments smaller, or the contact softer"
    )


def _place(rows: list[StaRow], run: RunFolder) -> str:
    """Tell where a run stopped: of a failed attempt the times are its start's."""
    good = sum(not row.failed for row in rows)
    count = f"{good} of {run.increments_in_all} increments are good"
    if not rows:
        return count
    last = rows[-1]
    if not last.failed:
        return f"increment {last.increment} ended at {last.total_time_ms:g} ms; {count}"
    until_ms = last.total_time_ms + last.increment_time_ms
    return (
        f"increment {last.increment}, from {last.total_time_ms:g} to {until_ms:g} ms, "
        f"after {last.iterations} iterations; {count}"
    )


def _disk_full(work: Path, found: str) -> Failure:
    free_mib = shutil.disk_usage(work).free / MIB
    room = f"{free_mib:.0f} MiB are free in {os.fspath(work.parent)}"
    return Failure(Cause.DISK_FULL, f"{found}; {room}", "make room and run again; ulimit -f counts")


def _out_of_memory(log: SolverLog) -> Failure:
    return Failure(Cause.OUT_OF_MEMORY, log.end, "run fewer jobs at once, or a coarser mesh")


def _is_end(time_ms: float, run: RunFolder) -> bool:
    return abs(time_ms - run.end_ms) <= max(TIME_TOLERANCE * run.end_ms, 0.01 * run.dt_ms)


def _quote(messages: tuple[LogMessage, ...]) -> str:
    quoted = "; ".join(f'"{message}"' for message in messages[:SHOWN])
    more = len(messages) - SHOWN
    return f"{quoted}; and {more} more" if more > 0 else quoted


def _line(messages: tuple[LogMessage, ...], deck: Path) -> int | None:
    for message in messages:
        line = find_card(deck, message.card) if message.card else None
        if line is not None:
            return line
    return None
