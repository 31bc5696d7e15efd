"""What CalculiX said: errors, and warnings that a part of the deck was left out.

Its C and Fortran parts share one stream through two buffers, so lines come late
and out of order: the log is read for its ``*ERROR`` and ``*WARNING`` messages,
never for progress. A message is its line and the lines up to the next blank one;
the card it is about follows in a message of its own.
"""

import re
from collections import deque
from dataclasses import dataclass, replace
from pathlib import Path

LAST_LINES = 5
MOST_MESSAGES = 50
LONGEST_MESSAGE = 300
_MORE_LINES = 5  # of a message, after its first

_BEGIN = re.compile(r"\*(ERROR|WARNING)\b[ :]*(.*)")
_OTHER = re.compile(r"^\s*\*INFO\b")
_CARD = re.compile(r"^(.*?)[. ]*Card image: *(\S.*)$")
_VERSION = re.compile(r"CalculiX Version (\S+?),")
_FINISHED = "Job finished"
_BANNER = (
    "CalculiX comes with",
    "CalculiX Version",
    "software, and you are",
    "certain conditions",
    "You are using an executable",
)
_SUMMARY = "at least one fatal error message"

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


@dataclass(frozen=True, slots=True)
class LogMessage:
    """One message, on one line, and the image of the card it is about."""

    kind: str
    text: str
    card: str | None = None

    def __str__(self) -> str:
        return self.text if self.card is None else f"{self.text} [{self.card}]"

    @property
    def drops_a_card(self) -> bool:
        """Whether this warning tells that something was left out."""
        return self.kind == "WARNING" and any(word in self.text for word in DROPPED)


@dataclass(frozen=True, slots=True)
class SolverLog:
    """A log's messages, last lines and version.

    `no_room` is the line that tells of a full disk. `finished` says that the
    solver called the job finished, which it does on a full disk too.
    """

    errors: tuple[LogMessage, ...]
    dropped: tuple[LogMessage, ...]
    last_lines: tuple[str, ...]
    version: str | None = None
    finished: bool = False
    no_room: str | None = None

    def says(self, *words: str) -> LogMessage | None:
        """Give the first error that holds one of `words`."""
        lowered = [word.lower() for word in words]
        for message in self.errors:
            if any(word in message.text.lower() for word in lowered):
                return message
        return None

    @property
    def end(self) -> str:
        """The last lines, as one."""
        return " | ".join(self.last_lines) or "it said nothing"


def read_solver_log(path: Path) -> SolverLog:
    """Read the log at `path`, line by line; an absent one is empty."""
    gathered = _Gathered()
    last: deque[str] = deque(maxlen=LAST_LINES)
    version, finished, no_room = None, False, None
    try:
        file = path.open(encoding="latin-1")
    except FileNotFoundError:
        return SolverLog((), (), ())
    with file:
        for line in file:
            gathered.take(line)
            words = line.strip()
            if set(words) - set("*_") and not words.startswith(_BANNER):
                last.append(words[:LONGEST_MESSAGE])
            if version is None:
                found = _VERSION.search(line)
                version = found[1] if found else None
            finished = finished or words == _FINISHED
            if any(phrase in words.lower() for phrase in NO_ROOM):
                no_room = words[:LONGEST_MESSAGE]
    gathered.close()
    return SolverLog(
        errors=_without_summary(gathered.errors),
        dropped=tuple(gathered.dropped),
        last_lines=tuple(last),
        version=version,
        finished=finished,
        no_room=no_room,
    )


def find_card(deck: Path, card: str) -> int | None:
    """Give the line of `deck` that `card` is the image of, if it is just one.

    CalculiX shows a card without blanks and in capitals.
    """
    wanted, found = _image(card), None
    with deck.open(encoding="latin-1") as file:
        for number, line in enumerate(file, start=1):
            if _image(line) == wanted:
                if found is not None:
                    return None
                found = number
    return found


class _Gathered:
    """Messages so far, each once, and the one whose lines are being read."""

    def __init__(self) -> None:
        self.errors: list[LogMessage] = []
        self.dropped: list[LogMessage] = []
        self._kind = ""
        self._parts: list[str] = []
        self._before: LogMessage | None = None

    def take(self, line: str) -> None:
        """Begin a message, go on with it, or end it."""
        begin = _BEGIN.search(line)
        if begin:
            self.close()
            self._kind, self._parts = begin[1], [begin[2]]
        elif not self._parts:
            return
        elif line.isspace() or _OTHER.match(line) or len(self._parts) > _MORE_LINES:
            self.close()
        else:
            self._parts.append(line)

    def close(self) -> None:
        """Keep the message whose lines have been read, if it is one to keep."""
        if not self._parts:
            return
        text = " ".join(" ".join(self._parts).split())[:LONGEST_MESSAGE]
        self._parts = []
        image, before = _CARD.match(text), self._before
        if image is None:
            text = text.replace("inter preted", "interpreted").rstrip(":; ")
            message = LogMessage(self._kind, text)
        elif before and before.kind == self._kind and before.card in (None, image[2]):
            message = replace(before, card=image[2])
        else:
            message = LogMessage(self._kind, image[1], image[2])
        kept = self.errors if message.kind == "ERROR" else self.dropped
        if image is not None and before in kept:
            kept.remove(before)
        self._before = message
        wanted = message.kind == "ERROR" or message.drops_a_card
        if wanted and message not in kept and len(kept) < MOST_MESSAGES:
            kept.append(message)


def _without_summary(errors: list[LogMessage]) -> tuple[LogMessage, ...]:
    kept = tuple(error for error in errors if _SUMMARY not in error.text)
    return kept or tuple(errors)


def _image(card: str) -> str:
    return "".join(card.split()).upper()
