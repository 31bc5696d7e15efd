r"""What goes to a terminal: an error in one line, and nothing that steers it.

A file that somebody sent may have a title with escape sequences, which a terminal
would obey: it could be renamed, cleared, or made to show what is not there. What is
printed passes through `PlainStream`, which shows them as ``\x1b``.
"""

import os
import re
import tempfile
from collections.abc import Callable
from typing import TextIO, cast

LONGEST_ERROR = 300
"""Characters of an error; the rest is in a file that the line names."""

_TAIL = 80
# C0 but tab and line feed, DEL, C1, line separators, and what turns text around.
_STEERING = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069]")


def plain(text: str) -> str:
    """`text` with control characters shown, not sent."""
    return _STEERING.sub(lambda one: one[0].encode("unicode_escape").decode(), text)


def error_line(problem: object) -> str:
    """``fembridge: ...`` in one line of at most `LONGEST_ERROR` characters.

    Of a longer one beginning and end are kept, and the whole is written to a file for
    temporary ones, which the line names.
    """
    words = str(problem)
    line = plain(f"fembridge: {' '.join(words.splitlines())}")
    if len(line) <= LONGEST_ERROR:
        return line
    whole = ""
    try:
        handle, path = tempfile.mkstemp(prefix="fembridge-", suffix=".txt")
        with os.fdopen(handle, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(f"{words}\n")
        whole = f" (whole: {path})"
    except OSError:  # then the line is all there is
        pass
    end = f" ... {line[-_TAIL:]}{whole}"
    return line[: max(0, LONGEST_ERROR - len(end))] + end


class PrintError(OSError):
    """What we print cannot be written."""


class PlainStream:
    """The text stream `stream`, to which only `plain` text is written.

    What keeps it from being written is a `PrintError`, but for a reader that has left.
    """

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    @classmethod
    def of(cls, stream: TextIO) -> TextIO:
        """A `PlainStream`, which can whatever `stream` can."""
        return cast("TextIO", cls(stream))

    def write(self, text: str) -> int:
        """Write `text`, control characters shown."""
        self._do(lambda: self.stream.write(plain(text)))
        return len(text)

    def flush(self) -> None:
        """Write what is in the buffer."""
        self._do(self.stream.flush)

    @staticmethod
    def _do(write: Callable[[], object]) -> None:
        try:
            write()
        except BrokenPipeError:
            raise
        except OSError as error:
            raise PrintError(error.errno, error.strerror) from error

    def __getattr__(self, name: str) -> object:
        return getattr(self.stream, name)
