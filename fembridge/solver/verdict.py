"""What the end of a run means: accepted, or the one cause why it was not.

CalculiX exits with 0 after a missing file, an unknown card and a full disk
alike, so the exit code is one witness of five. A run is good when it is 0, the
log holds no error and no part of the deck was left out, the last increment
converged at the end of the run, and the result file is closed and holds it.
"""

import os
import re
import shutil
import signal
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from enum import Enum
from itertools import chain
from pathlib import Path

from decks.dialects import JOB
from fembridge.errors import ResultError, SolverError
from fembridge.results.byte_file import ByteFile
from fembridge.results.frd import FrdIndex
from fembridge.results.printed import StaRow, read_sta
from fembridge.run_folder import RunFolder
from fembridge.solver.guard import CANNOT_RUN

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

LAST_LINES = 5
MOST_MESSAGES = 50
LONGEST_MESSAGE = 300
DROPPED = (
    "cannot be inter",  # printed with a gap: "inter    preted"
    "not recognized",
    "not applicable",
    "unknown",
    "nonexist",
    "not exist",
    "not been defined",
    "no set was defined",
    "exceeds the largest",
    "deactivated",
    "ignored",
    "yet no",
    "cannot be used",
    "must be strictly positive",
)
"""Words of warnings after which the run is not the one the deck asked for.

From the messages of version 2.20; it ends with exit code 0 after each of them.
"""
NO_ROOM = ("no space left on device", "file too large", "disk quota exceeded")
"""What the Fortran runtime says when a file cannot grow."""

_MORE_LINES = 5  # of a message, after its first
_BEGIN = re.compile(r"\*(ERROR|WARNING)\b[ :]*(.*)")
_OTHER = re.compile(r"^\s*\*INFO\b")
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


@dataclass(frozen=True, slots=True)
class Failure:
    """Why a run failed: the `cause`, what was found, and the next step if one is.

    `deck_line` is the line of the deck that the solver complained about.
    """

    cause: Cause
    found: str
    remedy: str = ""
    deck_line: int | None = None

    def __str__(self) -> str:
        where = "" if self.deck_line is None else f" (job.inp:{self.deck_line})"
        sentence = f"{self.cause.value}: {self.found}{where}"
        return f"{sentence}; {self.remedy}" if self.remedy else sentence


@dataclass(frozen=True, slots=True)
class Outcome:
    """One run of `folder`: accepted when `failure` is None.

    `exit_code` is negative for a signal and None when nothing was started.
    `increments` counts those that converged, `iterations` all that were made.
    `skipped`: results of the same deck were there already. `as_built`: the deck is
    the one that ``run.toml`` names.
    """

    folder: Path
    failure: Failure | None = None
    skipped: bool = False
    version: str | None = None
    exit_code: int | None = None
    wall_s: float = 0.0
    increments: int = 0
    iterations: int = 0
    threads: int | None = None
    as_built: bool = True

    @property
    def accepted(self) -> bool:
        """Whether the results are there and whole."""
        return self.failure is None

    def __str__(self) -> str:
        if self.failure is not None:
            return f"{self.folder}: {self.failure}"
        cost = f"{self.increments} increments, {self.iterations} iterations"
        if self.skipped:
            return f"{self.folder}: has the results of this deck, {cost}"
        return f"{self.folder}: {cost}, {self.wall_s:.1f} s"

    def to_error(self) -> SolverError:
        """The failure as an error that names folder, cause and next step."""
        return SolverError(str(self.failure), self.folder)

    def to_record(self) -> dict[str, object]:
        """The row of a summary."""
        failure = self.failure
        return {
            "folder": str(self.folder),
            "ok": self.accepted,
            "skipped": self.skipped,
            "cause": failure and failure.cause.name.lower(),
            "problem": failure and str(failure),
            "deck_line": failure and failure.deck_line,
            "version": self.version,
            "exit_code": self.exit_code,
            "wall_s": round(self.wall_s, 3),
            "increments": self.increments,
            "iterations": self.iterations,
            "threads": self.threads,
            "deck_as_built": self.as_built,
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
    """A log's errors, its warnings of something left out, last lines and version.

    `no_room` is the line about a full disk.
    """

    errors: tuple[LogMessage, ...] = ()
    dropped: tuple[LogMessage, ...] = ()
    last_lines: tuple[str, ...] = ()
    version: str | None = None
    no_room: str | None = None

    def error_with(self, *words: str) -> LogMessage | None:
        """The first error that holds one of `words`, which are lower case."""
        found = (e for e in self.errors if any(word in e.text.lower() for word in words))
        return next(found, None)

    @property
    def end(self) -> str:
        """The last lines, as one."""
        return " | ".join(self.last_lines) or "it said nothing"


def read_solver_log(path: Path) -> SolverLog:
    """Read the log at `path`, line by line; an absent one is empty.

    CalculiX's C and Fortran parts share one stream through two buffers, so lines
    come late and out of order: the log is read for its ``*ERROR`` and ``*WARNING``
    messages, never for progress.
    """
    last: deque[str] = deque(maxlen=LAST_LINES)
    version, no_room = None, None
    if not path.exists():
        return SolverLog()
    with path.open(encoding="latin-1") as file:
        errors, dropped = _messages(file)
        file.seek(0)
        for line in file:
            words = line.strip()
            if set(words) - set("*_") and not words.startswith(_BANNER):
                last.append(words[:LONGEST_MESSAGE])
            if version is None and (found := _VERSION.search(line)):
                version = found[1]
            if any(phrase in words.lower() for phrase in NO_ROOM):
                no_room = words[:LONGEST_MESSAGE]
    return SolverLog(tuple(errors), tuple(dropped), tuple(last), version, no_room)


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
    deck = work / f"{JOB}.inp"
    failure = _from_errors(work, run, log, deck) or _from_exit(work, exit_code, log)
    if failure is None and log.dropped:
        line = _line(log.dropped, deck)
        failure = Failure(Cause.CARD_DROPPED, _quoted(log.dropped), deck_line=line)
    return failure or _from_files(work, run, log)


def _messages(lines: Iterable[str]) -> tuple[list[LogMessage], list[LogMessage]]:
    """Errors, and warnings that something was left out, each once.

    The card that a message is about follows in a message of its own.
    """
    errors: list[LogMessage] = []
    dropped: list[LogMessage] = []
    before: LogMessage | None = None
    for kind, text in _blocks(lines):
        image = _CARD.match(text)
        if image is None:
            text = text.replace("inter preted", "interpreted").rstrip(":; ")
            message = LogMessage(kind, text)
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


def _blocks(lines: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Kind and text of each message: its line and those up to the next blank one."""
    kind, parts = "", list[str]()
    for line in chain(lines, "\n"):
        begin = _BEGIN.search(line)
        over = line.isspace() or _OTHER.match(line) or len(parts) > _MORE_LINES
        if parts and (begin or over):
            yield kind, " ".join(" ".join(parts).split())[:LONGEST_MESSAGE]
            parts = []
        if begin:
            kind, parts = begin[1], [begin[2]]
        elif parts:
            parts.append(line)


def _from_errors(work: Path, run: RunFolder, log: SolverLog, deck: Path) -> Failure | None:
    if log.no_room:
        return _disk_full(work, log.no_room)
    if not log.errors:
        return None
    if log.error_with("error allocating memory", "malloc failed"):
        return _out_of_memory(log)
    if missing := log.error_with("library is not linked"):
        return Failure(Cause.SOLVER_NOT_BUILT_IN, missing.text, "take SOLVER=... out of the deck")
    if inverted := log.error_with("nonpositive jacobian"):
        return Failure(
            Cause.NEGATIVE_JACOBIAN, inverted.text, "a 2D element lists its nodes counter-clockwise"
        )
    try:
        made = read_sta(work / f"{JOB}.sta")
    except ResultError:
        made = []
    if log.error_with("max. # of increments reached"):
        return Failure(Cause.INCREMENTS_EXHAUSTED, _place(made, run), "raise INC on the *STEP card")
    if log.error_with(*NO_CONVERGENCE):
        return _diverged(made, run)
    if made:
        return Failure(Cause.UNKNOWN, _quoted(log.errors))
    return Failure(Cause.BAD_DECK, _quoted(log.errors), deck_line=_line(log.errors, deck))


def _from_exit(work: Path, exit_code: int, log: SolverLog) -> Failure | None:
    if exit_code == 0:
        return None
    if exit_code == -signal.SIGXFSZ:
        return _disk_full(work, "a limit of file size (ulimit -f) was reached")
    if exit_code < 0:
        name = f"signal {-exit_code}"
        if -exit_code in set(signal.Signals):
            name += f" ({signal.Signals(-exit_code).name})"
        if -exit_code in CRASHES:
            remedy = "an element with a node that is not there does this, for one"
            return Failure(Cause.CRASHED, f"{name}; last output: {log.end}", remedy)
        if exit_code == -signal.SIGKILL:
            name += ", which Linux also sends when memory runs out"
        return Failure(Cause.KILLED, name)
    if exit_code == OUT_OF_MEMORY_EXIT:
        return _out_of_memory(log)
    if exit_code in (CANNOT_EXECUTE, CANNOT_RUN):
        return Failure(Cause.NO_SOLVER, log.end, "see fembridge doctor")
    if shutil.disk_usage(work).free < NO_ROOM_BYTES:
        return _disk_full(work, f"exit code {exit_code}")
    return Failure(Cause.UNKNOWN, f"exit code {exit_code}; last output: {log.end}")


def _from_files(work: Path, run: RunFolder, log: SolverLog) -> Failure | None:
    """What is wrong with the result file or the increments; a cut file explains the rest."""
    unfinished = _unfinished(work, run, log)
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
    found, remedy = "", ""
    if not index.blocks:
        found = f"{path.name} holds the mesh alone"
        remedy = "the deck asks for no *NODE OUTPUT and no *ELEMENT OUTPUT"
    elif not _is_end(index.blocks[-1].time_ms, run):
        last = index.blocks[-1]
        found = f"{path.name} ends with {last} at {last.time_ms:g} ms, expected {run.end_ms:g} ms"
    elif index.blocks[-1].records == 0:
        found = f"{path.name} holds no node in {index.blocks[-1]}"
        remedy = "NSET does not go with OUTPUT=3D"
    return Failure(Cause.MISSING_OUTPUT, found, remedy) if found else None


def _unfinished(work: Path, run: RunFolder, log: SolverLog) -> Failure | None:
    """Why the increments are not those of the whole run, if they are not."""
    try:
        rows = read_sta(work / f"{JOB}.sta")
    except ResultError as error:
        return Failure(Cause.MISSING_OUTPUT, f"{error}; last output: {log.end}")
    if not rows:
        return Failure(Cause.MISSING_OUTPUT, f"no increment was made; last output: {log.end}")
    if rows[-1].failed:
        return _diverged(rows, run)
    if not _is_end(rows[-1].total_time_ms, run):
        return Failure(
            Cause.WRONG_END,
            f"{rows[-1].total_time_ms:g} ms, run.toml says {run.end_ms:g} ms",
            "build the deck again",
        )
    return None


def _diverged(rows: list[StaRow], run: RunFolder) -> Failure:
    return Failure(
        Cause.DIVERGED, _place(rows, run), "make increments smaller, or the contact softer"
    )


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
    return Failure(Cause.DISK_FULL, f"{found}; {room}", "make room and run again; ulimit -f counts")


def _out_of_memory(log: SolverLog) -> Failure:
    return Failure(Cause.OUT_OF_MEMORY, log.end, "run fewer jobs at once, or a coarser mesh")


def _is_end(time_ms: float, run: RunFolder) -> bool:
    return abs(time_ms - run.end_ms) <= max(TIME_TOLERANCE * run.end_ms, 0.01 * run.dt_ms)


def _quoted(messages: tuple[LogMessage, ...]) -> str:
    quoted = "; ".join(f'"{message}"' for message in messages[:SHOWN])
    more = len(messages) - SHOWN
    return f"{quoted}; and {more} more" if more > 0 else quoted


def _line(messages: tuple[LogMessage, ...], deck: Path) -> int | None:
    """Line of the deck whose card the first message with one complains about."""
    lines = (find_card(deck, message.card) for message in messages if message.card)
    return next((line for line in lines if line is not None), None)
