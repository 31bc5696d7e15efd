"""What the end of a run means: accepted, or the one cause why it was not.

CalculiX exits with 0 after a missing file, an unknown card and a full disk
alike, so the exit code is one witness of five. A run is good when it is 0, the
log holds no error and no part of our deck was left out, the last increment
converged at the end of the run, and the result file is closed and holds it.
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
from fembridge.results.byte_file import ByteFile
from fembridge.results.frd import FrdIndex
from fembridge.results.status import StaRow, read_sta
from fembridge.run_folder import RunFolder
from fembridge.solver.process import CANNOT_RUN

OUT_OF_MEMORY_EXIT = 16
CANNOT_EXECUTE = 126  # as shells have it
NO_ROOM_BYTES = 64 * 1024
"""With less free, a failure without a reason is taken for one of room."""
SHOWN = 3
"""Messages that are quoted; the log has them all."""
NO_CONVERGENCE = (
    "seems to diverge",
    "increment size smaller than minimum",
    "too many cutbacks",
    "too many iterations",
)
CRASHES = {getattr(signal, f"SIG{name}") for name in ("ABRT", "BUS", "FPE", "ILL", "SEGV", "SYS")}
TIME_TOLERANCE = 1.0e-5
"""Of the end; times in the ``.sta`` have seven digits, in the ``.frd`` six."""
MIB = 1024**2

LAST_LINES = 5
NOTHING = "it said nothing"
MOST_MESSAGES = 50
LONGEST_MESSAGE = 300
DROPPED = (
    "cannot be inter",  # printed with a gap: "inter    preted"
    *("not recognized", "not applicable", "unknown", "nonexist", "not exist"),
    *("not been defined", "no set was defined", "exceeds the largest", "deactivated"),
    *("ignored", "yet no", "cannot be used", "must be strictly positive"),
)
"""Words of warnings after which the run is not the one the deck asked for.

From the messages of version 2.20; it ends with exit code 0 after each of them.
"""
NO_ROOM = ("no space left on device", "file too large", "disk quota exceeded")
"""What the Fortran runtime says when a file cannot grow."""

# A message: its line, and at most five more up to a blank one or the next message.
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
    """Why a run is not accepted; the value is the sentence a user reads."""

    NO_SOLVER = "the solver cannot be started"
    BAD_FOLDER = "not a run folder that can be run"
    BUSY = "another run is at work in this folder"
    BAD_DECK = "CalculiX refused the deck"
    CARD_DROPPED = "CalculiX left a part of the deck out"
    SOLVER_NOT_BUILT_IN = "this CalculiX has not the equation solver the deck wants"
    NEGATIVE_JACOBIAN = "an element of the mesh is turned inside out"
    INCREMENTS_EXHAUSTED = "the deck allows too few increments"
    DIVERGED = "an increment did not converge"
    ENDLESS_ITERATION = "an increment exceeded the iteration limit"
    STALLED = "the solver stopped making progress"
    TIME_LIMIT = "the time limit was reached"
    INTERRUPTED = "the run was interrupted"
    DISK_FULL = "the results could not be written to the end"
    OUT_OF_MEMORY = "the solver got no more memory"
    KILLED = "the solver was killed from outside"
    CRASHED = "the solver crashed"
    WRONG_END = "the solver ended at another time than the run should"
    MISSING_OUTPUT = "the results are not whole"
    UNKNOWN = "the solver failed without a reason we know"


REMEDIES = {
    Cause.BUSY: "wait for it, or end it",
    Cause.SOLVER_NOT_BUILT_IN: "take SOLVER=... out of the deck",
    Cause.NEGATIVE_JACOBIAN: "a 2D element lists its nodes counter-clockwise",
    Cause.INCREMENTS_EXHAUSTED: "raise INC on the *STEP card",
    Cause.DIVERGED: "make increments smaller, or the contact softer",
    Cause.ENDLESS_ITERATION: "change the contact's stiffness or type, or make increments smaller",
    Cause.DISK_FULL: "make room and run again; ulimit -f counts",
    Cause.OUT_OF_MEMORY: "run fewer jobs at once, or a coarser mesh",
    Cause.CRASHED: "an element with a node that is not there does this, for one",
    Cause.WRONG_END: "build the deck again",
}
"""The next step, where the cause alone says it."""

# Of an error of the log, in this order.
_BY_WORDS = (
    (Cause.OUT_OF_MEMORY, ("error allocating memory", "malloc failed")),
    (Cause.SOLVER_NOT_BUILT_IN, ("library is not linked",)),
    (Cause.NEGATIVE_JACOBIAN, ("nonpositive jacobian",)),
    (Cause.INCREMENTS_EXHAUSTED, ("max. # of increments reached",)),
    (Cause.DIVERGED, NO_CONVERGENCE),
)


@dataclass(frozen=True, slots=True)
class Failure:
    """Why a run failed: the `cause`, what was found, and the next step if it is not the usual.

    `deck_line` is the line of the deck that the solver complained about.
    """

    cause: Cause
    found: str
    remedy: str = ""
    deck_line: int | None = None

    def __str__(self) -> str:
        where = "" if self.deck_line is None else f" (job.inp:{self.deck_line})"
        remedy = self.remedy or REMEDIES.get(self.cause)
        sentence = f"{self.cause.value}: {self.found}{where}"
        return f"{sentence}; {remedy}" if remedy else sentence


@dataclass(frozen=True, slots=True)
class Outcome:
    """One run of `folder`: accepted when `failure` is None.

    `exit_code` is negative for a signal and None when nothing was started.
    `increments` counts those that converged, `iterations` all that were made.
    `skipped`: results of the same deck were there already, or, `cached`, in the cache.
    `as_built`: the deck is the one that ``run.toml`` names. `warnings` are what ccx said
    of someone's own deck.
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
        """Whether the results are there and whole."""
        return self.failure is None

    def __str__(self) -> str:
        if self.failure is not None:
            return f"{self.folder}: {self.failure}"
        cost = f"{self.increments} increments, {self.iterations} iterations"
        if self.cached:
            return f"{self.folder}: solved before, results from the cache, {cost}"
        if self.skipped:
            return f"{self.folder}: has the results of this deck, {cost}"
        return f"{self.folder}: {cost}, {self.wall_s:.1f} s"

    def to_error(self) -> SolverError:
        """The failure as an error that names folder, cause and next step."""
        return SolverError(str(self.failure), self.folder)

    def to_record(self) -> dict[str, object]:
        """The row of a summary."""
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
    """One message, on one line, and the image of the card it is about."""

    kind: str
    text: str
    card: str | None = None

    def __str__(self) -> str:
        return self.text if self.card is None else f"{self.text} [{self.card}]"


@dataclass(frozen=True, slots=True)
class SolverLog:
    """A log's errors, its warnings of something left out, its end and version.

    `no_room` is the line about a full disk.
    """

    errors: Sequence[LogMessage] = ()
    dropped: Sequence[LogMessage] = ()
    end: str = NOTHING
    version: str | None = None
    no_room: str | None = None


def read_solver_log(path: Path) -> SolverLog:
    """Read the log at `path`; an absent one is empty.

    CalculiX's C and Fortran parts share one stream through two buffers, so lines
    come late and out of order: the log is read for its ``*ERROR`` and ``*WARNING``
    messages, never for progress.
    """
    if not path.exists():
        return SolverLog()
    text = path.read_text(encoding="utf-8", errors="replace")  # of paths, our own words
    version = _VERSION.search(text)
    lines = [line.strip() for line in text.split("\n")]
    no_room = (line for line in lines if any(phrase in line.lower() for phrase in NO_ROOM))
    last = [line for line in lines if set(line) - set("*_") and not line.startswith(_BANNER)]
    return SolverLog(
        *_messages(text),
        " | ".join(line[:LONGEST_MESSAGE] for line in last[-LAST_LINES:]) or NOTHING,
        version and version[1],
        next(no_room, "")[:LONGEST_MESSAGE] or None,
    )


def find_card(deck: Path, card: str) -> int | None:
    """The line of `deck` that `card` is the image of, if it is just one.

    CalculiX shows a card without blanks and in capitals.
    """
    wanted = "".join(card.split()).upper()
    with deck.open(encoding="latin-1") as file:
        found = [n for n, line in enumerate(file, 1) if "".join(line.split()).upper() == wanted]
    return found[0] if len(found) == 1 else None


def judge(work: Path, run: RunFolder, exit_code: int, log: SolverLog) -> Failure | None:
    """Judge what the solver of `run` left in the folder `work`.

    The folder held nothing but the deck before, so all that is there is new.
    """
    try:
        made = read_sta(work / f"{JOB}.sta")
        unread = "no increment was made"
    except ResultError as error:
        made, unread = [], str(error)
    failure = _from_log(work, run, log, made) or _from_exit(work, exit_code, log)
    # ccx does to someone's own deck what it always does to it: that is a remark, and no more.
    if failure is None and log.dropped and "base_deck" not in run.inputs:
        line = _line(log.dropped, work / f"{JOB}.inp")
        failure = Failure(Cause.CARD_DROPPED, _quoted(log.dropped), deck_line=line)
    if failure is not None:
        return failure
    unfinished = None
    if not run.increments:
        pass  # modes of unit forces: a step without time
    elif not made:
        unfinished = Failure(Cause.MISSING_OUTPUT, f"{unread}; last output: {log.end}")
    elif made[-1].failed:
        unfinished = Failure(Cause.DIVERGED, _place(made, run), _more(run))
    elif not _is_end(made[-1].total_time_ms, run):
        found = f"{made[-1].total_time_ms:g} ms, run.toml says {run.end_ms:g} ms"
        unfinished = Failure(Cause.WRONG_END, found)
    return _from_results(work, run, unfinished)


def _messages(text: str) -> tuple[list[LogMessage], list[LogMessage]]:
    """Errors, and warnings that something was left out, each once.

    The card that a message is about follows in a message of its own.
    """
    errors: list[LogMessage] = []
    dropped: list[LogMessage] = []
    before: LogMessage | None = None
    for match in _MESSAGE.finditer(text):
        kind, words = match[1], " ".join(match[2].split())[:LONGEST_MESSAGE]
        image = _CARD.match(words)
        if image is None:
            message = LogMessage(kind, words.replace("inter preted", "interpreted").rstrip(":; "))
        elif before and before.kind == kind and before.card in (None, image[2]):
            message = replace(before, card=image[2])
        else:
            message = LogMessage(kind, image[1], image[2])
        kept = errors if kind == "ERROR" else dropped
        if image is not None and before in kept:
            kept.remove(before)
        before = message
        wanted = kind == "ERROR" or any(word in message.text for word in DROPPED)
        if wanted and message not in kept and len(kept) < MOST_MESSAGES:
            kept.append(message)
    return [e for e in errors if _SUMMARY not in e.text] or errors, dropped


def _from_log(work: Path, run: RunFolder, log: SolverLog, made: list[StaRow]) -> Failure | None:
    if log.no_room:
        return _disk_full(work, log.no_room)
    for cause, phrases in _BY_WORDS:
        for error in log.errors:
            if any(phrase in error.text.lower() for phrase in phrases):
                found = error.text
                if cause is Cause.OUT_OF_MEMORY:
                    found = log.end
                elif cause in (Cause.INCREMENTS_EXHAUSTED, Cause.DIVERGED):
                    found = _place(made, run)
                return Failure(cause, found, _more(run) if cause is Cause.DIVERGED else "")
    if not log.errors:
        return None
    if made:
        return Failure(Cause.UNKNOWN, _quoted(log.errors))
    line = _line(log.errors, work / f"{JOB}.inp")
    return Failure(Cause.BAD_DECK, _quoted(log.errors), deck_line=line)


def _from_exit(work: Path, exit_code: int, log: SolverLog) -> Failure | None:
    if exit_code == 0:
        return None
    if exit_code == -signal.SIGXFSZ:
        return _disk_full(work, "a limit of file size (ulimit -f) was reached")
    if exit_code < 0:
        known = -exit_code in set(signal.Signals)
        name = f"signal {-exit_code}" + (f" ({signal.Signals(-exit_code).name})" if known else "")
        if -exit_code in CRASHES:
            return Failure(Cause.CRASHED, f"{name}; last output: {log.end}")
        if exit_code == -signal.SIGKILL:
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
    """What is wrong with the result file; where it is cut, that explains `unfinished`."""
    path = work / f"{JOB}.frd"
    try:
        with ByteFile(path) as file:
            index = FrdIndex(file)
    except ResultError as error:
        if path.exists():  # empty, or cut before its first line was whole
            return _disk_full(work, f"{path.name}: {error.problem}")
        return unfinished or Failure(Cause.MISSING_OUTPUT, f"no {path.name}")
    if not index.ended:
        return _disk_full(work, f"{path.name} stops at byte {index.size} without its end line 9999")
    if index.damage:
        harm = index.damage[0]
        return _disk_full(work, f"{path.name}, byte {harm.offset}: {harm.problem}")
    if unfinished is not None:
        return unfinished
    last = index.blocks[-1] if index.blocks else None
    if last is None:
        found = f"{path.name} holds the mesh alone"
        remedy = "the deck asks for no *NODE OUTPUT and no *ELEMENT OUTPUT"
    elif run.increments and not _is_end(last.time_ms, run):
        found = f"{path.name} ends with {last} at {last.time_ms:g} ms, expected {run.end_ms:g} ms"
        remedy = ""
    elif last.records == 0:
        found = f"{path.name} holds no node in {last}"
        remedy = "NSET does not go with OUTPUT=3D"
    else:
        return None
    return Failure(Cause.MISSING_OUTPUT, found, remedy)


def _more(run: RunFolder) -> str:
    """What else to do of someone's own deck that diverges."""
    own = "base_deck" in run.inputs
    return f"build-deck --increments automatic, or {REMEDIES[Cause.DIVERGED]}" if own else ""


def _place(rows: list[StaRow], run: RunFolder) -> str:
    """Where a run stopped: of a failed attempt the times are its start's."""
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
    return Failure(Cause.DISK_FULL, f"{found}; {room}")


def _is_end(time_ms: float, run: RunFolder) -> bool:
    return abs(time_ms - run.end_ms) <= max(TIME_TOLERANCE * run.end_ms, 0.01 * run.dt_ms)


def _quoted(messages: Sequence[LogMessage]) -> str:
    quoted = "; ".join(f'"{message}"' for message in messages[:SHOWN])
    more = len(messages) - SHOWN
    return f"{quoted}; and {more} more" if more > 0 else quoted


def _line(messages: Sequence[LogMessage], deck: Path) -> int | None:
    """Line of the deck whose card the first message with one complains about."""
    lines = (find_card(deck, message.card) for message in messages if message.card)
    return next((line for line in lines if line is not None), None)
