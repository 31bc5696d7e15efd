"""Verdict on a finished run: accepted, or rejected with one cause.

CalculiX exits with 0 after a missing file, an unknown card and a full disk alike, so
the exit code is one of five criteria. A run is accepted when the exit code is 0, the log
has no error, no card of the deck was ignored, the last increment converged at the end of
the run, and the result file is closed and has that increment.
"""

import os
import re
import shutil
import signal
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path

from decks.dialects import JOB
from fembridge.errors import ResultError, SolverError
from fembridge.host.process import CANNOT_RUN
from fembridge.host.system import signal_numbers
from fembridge.io.run_folder import RunFolder
from fembridge.results.byte_file import ByteFile
from fembridge.results.frd import FrdIndex
from fembridge.results.status import StaRow, read_sta

MATRIX_SUFFIX = ".sti"
"""Suffix of the stiffness matrix that ``SOLVER=MATRIXSTORAGE`` writes."""

OUT_OF_MEMORY_EXIT = 16
CANNOT_EXECUTE = 126  # exit code of shells for a file that is not executable
NO_ROOM_BYTES = 64 * 1024
"""With fewer bytes free, a failure without another cause is reported as a full disk."""
SHOWN = 3
"""Number of messages quoted; the log has all."""
NO_CONVERGENCE = (
    "seems to diverge",
    "increment size smaller than minimum",
    "too many cutbacks",
    "too many iterations",
)
CRASHES = signal_numbers("SIGABRT", "SIGBUS", "SIGFPE", "SIGILL", "SIGSEGV", "SIGSYS")
TIME_TOLERANCE = 1.0e-5
"""Relative to the end time; times in the ``.sta`` have seven digits, in the ``.frd`` six."""
MIB = 1024**2

LAST_LINES = 5
NO_OUTPUT = "none"
MOST_MESSAGES = 50
LONGEST_MESSAGE = 300
DROPPED = (
    "cannot be inter",  # printed with a gap: "inter    preted"
    *("not recognized", "not applicable", "unknown", "nonexist", "not exist"),
    *("not been defined", "no set was defined", "exceeds the largest", "deactivated"),
    *("ignored", "yet no", "cannot be used", "must be strictly positive"),
)
"""Phrases of CalculiX warnings after which a part of the deck has no effect.

From the messages of version 2.20, which ends with exit code 0 after each of them.
"""
NO_ROOM = ("no space left on device", "file too large", "disk quota exceeded")
"""Messages of the Fortran runtime for a file that cannot grow."""

# A message: its line and at most five more, up to a blank line or the next message.
_MESSAGE = re.compile(
    r"\*(ERROR|WARNING)\b[ :]*"
    r"(.*(?:\n(?!\s*$|\s*\*INFO\b|.*\*(?:ERROR|WARNING)\b).*){0,5})",
    re.MULTILINE,
)
_CARD = re.compile(r"^(.*?)[. ]*Card image: *(\S.*)$")
_VERSION = re.compile(r"CalculiX Version (\S+?),")
_BANNER = (
    "CalculiX comes with",
    "CalculiX Version",
    "software, and you are",
    "certain conditions",
    "You are using an executable",
)
_SUMMARY = "at least one fatal error message"


class Cause(Enum):
    """Cause of a rejected run; the value is its sentence in messages."""

    NO_SOLVER = "the solver cannot be started"
    BAD_FOLDER = "this folder cannot be run"
    BUSY = "another run is at work in this folder"
    BAD_DECK = "CalculiX refused the deck"
    CARD_DROPPED = "CalculiX ignored a part of the deck"
    SOLVER_NOT_BUILT_IN = "this CalculiX lacks the equation solver that the deck requests"
    NEGATIVE_JACOBIAN = "an element of the mesh is turned inside out"
    INCREMENTS_EXHAUSTED = "the deck allows too few increments"
    DIVERGED = "an increment did not converge"
    ENDLESS_ITERATION = "an increment exceeded the iteration limit"
    STALLED = "the solver stopped making progress"
    TIME_LIMIT = "the time limit was reached"
    INTERRUPTED = "the run was interrupted"
    DISK_FULL = "the results could not be written to the end"
    OUT_OF_MEMORY = "the solver ran out of memory"
    KILLED = "the solver was killed from outside"
    CRASHED = "the solver crashed"
    WRONG_END = "the solver ended at another time than run.toml states"
    MISSING_OUTPUT = "the results are incomplete"
    UNKNOWN = "the solver failed for an unknown reason"


REMEDIES = {
    Cause.BUSY: "wait for it, or end it",
    Cause.SOLVER_NOT_BUILT_IN: "remove SOLVER=... from the deck",
    Cause.NEGATIVE_JACOBIAN: "list the nodes of 2D elements counter-clockwise",
    Cause.INCREMENTS_EXHAUSTED: "raise INC on the *STEP card",
    Cause.DIVERGED: "make increments smaller, or the contact softer",
    Cause.ENDLESS_ITERATION: "change the contact's stiffness or type, or make increments smaller",
    Cause.DISK_FULL: "make room and run again; ulimit -f counts",
    Cause.OUT_OF_MEMORY: "run fewer jobs at once, or a coarser mesh",
    Cause.CRASHED: "check the deck, for example for an element with an undefined node",
    Cause.WRONG_END: "build the deck again",
}
"""Next step for a cause, where the cause alone determines it."""

# Phrases in errors of the CalculiX log, checked in this order.
_LOG_PHRASES = (
    (Cause.OUT_OF_MEMORY, ("error allocating memory", "malloc failed")),
    (Cause.SOLVER_NOT_BUILT_IN, ("library is not linked",)),
    (Cause.NEGATIVE_JACOBIAN, ("nonpositive jacobian",)),
    (Cause.INCREMENTS_EXHAUSTED, ("max. # of increments reached",)),
    (Cause.DIVERGED, NO_CONVERGENCE),
)


@dataclass(frozen=True, slots=True)
class Failure:
    """Failure of a run: its `cause`, the `finding`, and a `remedy` other than the usual one.

    `deck_line` is the line of the deck in the solver's message.
    """

    cause: Cause
    finding: str
    remedy: str = ""
    deck_line: int | None = None

    def __str__(self) -> str:
        where = "" if self.deck_line is None else f" (job.inp:{self.deck_line})"
        remedy = self.remedy or REMEDIES.get(self.cause)
        sentence = f"{self.cause.value}: {self.finding}{where}"
        return f"{sentence}; {remedy}" if remedy else sentence


@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of one run, accepted where `failure` is None.

    Parameters
    ----------
    folder
        Run folder.
    failure
        Cause and finding of the rejection. Default: None, the run is accepted.
    skipped
        Whether results of the same deck were in the folder. Default: False.
    cached
        Whether the results come from the cache. Default: False.
    version
        Version of the solver. Default: None, unknown.
    exit_code
        Exit code of the solver, negative for a signal. Default: None, no solver was started.
    wall_s
        Duration in s. Default: 0.
    increments
        Number of converged increments. Default: 0.
    iterations
        Number of iterations in all. Default: 0.
    threads
        Threads of the solver. Default: None, as the environment sets them.
    as_built
        Whether the deck has the checksum in ``run.toml``. Default: True.
    warnings
        Warnings of ccx about a user's own deck. Default: none.
    """

    folder: Path
    failure: Failure | None = None
    skipped: bool = False
    cached: bool = False
    version: str | None = None
    exit_code: int | None = None
    wall_s: float = 0.0
    increments: int = 0
    iterations: int = 0
    threads: int | None = None
    as_built: bool = True
    warnings: tuple[str, ...] = ()

    @property
    def accepted(self) -> bool:
        """Whether the results exist and are complete."""
        return self.failure is None

    def __repr__(self) -> str:
        return f"Outcome({self})"

    def __str__(self) -> str:
        if self.failure is not None:
            return f"{self.folder}: {self.failure}"
        cost = f"{self.increments} increments, {self.iterations} iterations"
        if self.cached:
            return f"{self.folder}: results from the cache, {cost}"
        if self.skipped:
            return f"{self.folder}: already has the results of this deck, {cost}"
        return f"{self.folder}: {cost}, {self.wall_s:.1f} s"

    def to_error(self) -> SolverError:
        """Error of the failure, with folder, cause and next step."""
        return SolverError(str(self.failure), self.folder)

    def to_record(self) -> dict[str, object]:
        """Row of a summary."""
        failure = self.failure
        names = ("version", "exit_code", "wall_s", "increments", "iterations", "threads")
        return {
            "folder": str(self.folder),
            "ok": self.accepted,
            "skipped": self.skipped,
            "cached": self.cached,
            "cause": failure and failure.cause.name.lower(),
            "problem": failure and str(failure),
            "deck_line": failure and failure.deck_line,
            **{name: getattr(self, name) for name in names},
            "wall_s": round(self.wall_s, 3),
            "deck_as_built": self.as_built,
            "warnings": list(self.warnings),
        }


@dataclass(frozen=True, slots=True)
class LogMessage:
    """One message on one line, and the image of its card."""

    kind: str
    text: str
    card: str | None = None

    def __str__(self) -> str:
        return self.text if self.card is None else f"{self.text} [{self.card}]"


@dataclass(frozen=True, slots=True)
class SolverLog:
    """Errors, warnings about ignored cards, last lines and version in a solver log.

    `no_room` is the line about a full disk. `exit_code` is None for a solver that
    was stopped, and for a log alone.
    """

    errors: Sequence[LogMessage] = ()
    dropped: Sequence[LogMessage] = ()
    end: str = NO_OUTPUT
    version: str | None = None
    no_room: str | None = None
    exit_code: int | None = None


def read_solver_log(path: Path) -> SolverLog:
    """Contents of the solver log at `path`; empty where the file is absent.

    CalculiX's C and Fortran parts share one stream through two buffers, so lines
    come late and out of order: the log is read for its ``*ERROR`` and ``*WARNING``
    messages, not for progress.
    """
    if not path.exists():
        return SolverLog()
    text = path.read_text(encoding="utf-8", errors="replace")  # paths may have any bytes
    version = _VERSION.search(text)
    lines = [line.strip() for line in text.split("\n")]
    no_room = (line for line in lines if any(phrase in line.lower() for phrase in NO_ROOM))
    last_lines = [line for line in lines if set(line) - set("*_") and not line.startswith(_BANNER)]
    return SolverLog(
        *_messages(text),
        " | ".join(line[:LONGEST_MESSAGE] for line in last_lines[-LAST_LINES:]) or NO_OUTPUT,
        version and version[1],
        next(no_room, "")[:LONGEST_MESSAGE] or None,
    )


def find_card(deck: Path, card: str) -> int | None:
    """Line of `deck` with the card image `card`; None unless exactly one line matches.

    CalculiX prints a card without blanks and in capitals.
    """
    image = "".join(card.split()).upper()
    with deck.open(encoding="latin-1") as file:
        lines = [n for n, line in enumerate(file, 1) if "".join(line.split()).upper() == image]
    return lines[0] if len(lines) == 1 else None


def judge(work: Path, run: RunFolder, exit_code: int, log: SolverLog) -> Failure | None:
    """Failure of `run` according to the solver's files in `work`; None for an accepted run.

    Before the run `work` had the deck alone, so all other files are new.
    """
    try:
        rows = read_sta(work / f"{JOB}.sta")
        sta_problem = "no increment was solved"
    except ResultError as error:
        rows, sta_problem = [], str(error)
    failure = _from_log(work, run, log, rows) or _from_exit(work, exit_code, log)
    # Ignored cards of a base deck are warnings: ccx ignores them in the user's own runs too.
    if failure is None and log.dropped and "base_deck" not in run.inputs:
        line = _message_line(log.dropped, work / f"{JOB}.inp")
        failure = Failure(Cause.CARD_DROPPED, _quote(log.dropped), deck_line=line)
    if failure is not None:
        return failure
    unfinished = None
    if not run.increments:
        pass  # modes of unit forces: a step without time
    elif not rows:
        unfinished = Failure(Cause.MISSING_OUTPUT, f"{sta_problem}; last output: {log.end}")
    elif rows[-1].failed:
        unfinished = Failure(Cause.DIVERGED, _progress_text(rows, run), _diverged_remedy(run))
    elif not _is_end(rows[-1].total_time_ms, run):
        finding = f"{rows[-1].total_time_ms:g} ms, expected {run.end_ms:g} ms"
        unfinished = Failure(Cause.WRONG_END, finding)
    return _from_results(work, run, unfinished)


def _messages(text: str) -> tuple[list[LogMessage], list[LogMessage]]:
    """Errors, and warnings about ignored cards, without duplicates.

    CalculiX prints the card of a message in a separate message after it.
    """
    errors: list[LogMessage] = []
    dropped: list[LogMessage] = []
    previous: LogMessage | None = None
    for match in _MESSAGE.finditer(text):
        kind, body = match[1], " ".join(match[2].split())[:LONGEST_MESSAGE]
        image = _CARD.match(body)
        if image is None:
            message = LogMessage(kind, body.replace("inter preted", "interpreted").rstrip(":; "))
        elif previous and previous.kind == kind and previous.card in (None, image[2]):
            message = replace(previous, card=image[2])
        else:
            message = LogMessage(kind, image[1], image[2])
        collected = errors if kind == "ERROR" else dropped
        if image is not None and previous in collected:
            collected.remove(previous)
        previous = message
        is_relevant = kind == "ERROR" or any(phrase in message.text for phrase in DROPPED)
        if is_relevant and message not in collected and len(collected) < MOST_MESSAGES:
            collected.append(message)
    return [e for e in errors if _SUMMARY not in e.text] or errors, dropped


def _from_log(work: Path, run: RunFolder, log: SolverLog, rows: list[StaRow]) -> Failure | None:
    if log.no_room:
        return _disk_full(work, log.no_room)
    for cause, phrases in _LOG_PHRASES:
        for error in log.errors:
            if any(phrase in error.text.lower() for phrase in phrases):
                finding = error.text
                if cause is Cause.OUT_OF_MEMORY:
                    finding = log.end
                elif cause in (Cause.INCREMENTS_EXHAUSTED, Cause.DIVERGED):
                    finding = _progress_text(rows, run)
                return Failure(
                    cause, finding, _diverged_remedy(run) if cause is Cause.DIVERGED else ""
                )
    if not log.errors:
        return None
    if rows:
        return Failure(Cause.UNKNOWN, _quote(log.errors))
    line = _message_line(log.errors, work / f"{JOB}.inp")
    return Failure(Cause.BAD_DECK, _quote(log.errors), deck_line=line)


def _from_exit(work: Path, exit_code: int, log: SolverLog) -> Failure | None:
    if exit_code == 0:
        return None
    if -exit_code in signal_numbers("SIGXFSZ"):
        return _disk_full(work, "a limit of file size (ulimit -f) was reached")
    if exit_code < 0:
        is_known = -exit_code in set(signal.Signals)
        name = f"signal {-exit_code}" + (
            f" ({signal.Signals(-exit_code).name})" if is_known else ""
        )
        if -exit_code in CRASHES:
            return Failure(Cause.CRASHED, f"{name}; last output: {log.end}")
        if -exit_code in signal_numbers("SIGKILL"):
            name += ", which Linux also sends when memory runs out"
        return Failure(Cause.KILLED, name)
    if exit_code == OUT_OF_MEMORY_EXIT:
        return Failure(Cause.OUT_OF_MEMORY, log.end)
    if exit_code in (CANNOT_EXECUTE, CANNOT_RUN):
        return Failure(Cause.NO_SOLVER, log.end, "see fembridge doctor")
    if shutil.disk_usage(work).free < NO_ROOM_BYTES:
        return _disk_full(work, f"exit code {exit_code}")
    return Failure(Cause.UNKNOWN, f"exit code {exit_code}; last output: {log.end}")


def _from_results(work: Path, run: RunFolder, unfinished: Failure | None) -> Failure | None:
    """Failure seen in the result file; a file that is cut explains `unfinished`."""
    path = work / f"{JOB}.frd"
    try:
        with ByteFile(path) as file:
            index = FrdIndex(file)
    except ResultError as error:
        if path.exists():  # empty, or cut within its first line
            return _disk_full(work, f"{path.name}: {error.problem}")
        return unfinished or Failure(Cause.MISSING_OUTPUT, f"no {path.name}")
    if not index.ended:
        return _disk_full(work, f"{path.name} stops at byte {index.size} without its end line 9999")
    if index.damage:
        damage = index.damage[0]
        return _disk_full(work, f"{path.name}, byte {damage.offset}: {damage.problem}")
    if unfinished is not None:
        return unfinished
    last_block = index.blocks[-1] if index.blocks else None
    if not run.increments and (work / f"{JOB}{MATRIX_SUFFIX}").is_file():
        return None  # a stiffness matrix, and a mesh without results
    if last_block is None:
        finding = f"{path.name} has a mesh and no results"
        remedy = "request *NODE OUTPUT or *ELEMENT OUTPUT in the deck"
    elif run.increments and not _is_end(last_block.time_ms, run):
        finding = (
            f"{path.name} ends with {last_block} at {last_block.time_ms:g} ms, "
            f"expected {run.end_ms:g} ms"
        )
        remedy = ""
    elif last_block.records == 0:
        finding = f"{path.name} has no node in {last_block}"
        remedy = "remove NSET or OUTPUT=3D from the deck, they cannot be combined"
    else:
        return None
    return Failure(Cause.MISSING_OUTPUT, finding, remedy)


def _diverged_remedy(run: RunFolder) -> str:
    """Next step for a base deck that diverges; "" takes that of other decks."""
    base = run.inputs.get("base_deck")
    if base is None or base.get("request", {}).get("increments") == "automatic":
        return ""
    return f"--increments automatic, or {REMEDIES[Cause.DIVERGED]}"


def _progress_text(rows: list[StaRow], run: RunFolder) -> str:
    """Text of where a run stopped; the row of a failed attempt has the time of its start."""
    converged = sum(not row.failed for row in rows)
    count = f"{converged} of {run.increments_in_all} increments converged"
    if not rows:
        return count
    last_row = rows[-1]
    if not last_row.failed:
        return f"increment {last_row.increment} ended at {last_row.total_time_ms:g} ms; {count}"
    until_ms = last_row.total_time_ms + last_row.increment_time_ms
    return (
        f"increment {last_row.increment}, from {last_row.total_time_ms:g} to {until_ms:g} ms, "
        f"after {last_row.iterations} iterations; {count}"
    )


def _disk_full(work: Path, finding: str) -> Failure:
    free_mib = shutil.disk_usage(work).free / MIB
    free_text = f"{free_mib:.0f} MiB are free in {os.fspath(work.parent)}"
    return Failure(Cause.DISK_FULL, f"{finding}; {free_text}")


def _is_end(time_ms: float, run: RunFolder) -> bool:
    return abs(time_ms - run.end_ms) <= max(TIME_TOLERANCE * run.end_ms, 0.01 * run.dt_ms)


def _quote(messages: Sequence[LogMessage]) -> str:
    quoted = "; ".join(f'"{message}"' for message in messages[:SHOWN])
    hidden = len(messages) - SHOWN
    return f"{quoted}; and {hidden} more" if hidden > 0 else quoted


def _message_line(messages: Sequence[LogMessage], deck: Path) -> int | None:
    """Deck line of the first message with a card that is found in the deck."""
    lines = (find_card(deck, message.card) for message in messages if message.card)
    return next((line for line in lines if line is not None), None)
