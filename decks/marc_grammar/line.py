"""One line of a Marc deck, and how a problem on it is told."""

from pathlib import Path
from typing import NamedTuple

from fembridge.errors import DeckError

COMMENT = "$"


class Line(NamedTuple):
    """A line: `text` without its end, and the bytes `start` to `stop` with it.

    Bytes stand for characters one to one (Latin-1), so that nothing is lost. A line
    of an included file has the empty span behind the line that includes it, and
    that file's `path` and `number`; the line that includes it is `followed`.
    """

    number: int
    text: str
    start: int
    stop: int
    path: Path | None = None
    included: bool = False
    followed: bool = False

    @property
    def comment(self) -> bool:
        """Whether no data stand on it: a comment, or the mention of a file read."""
        return self.followed or self.text.lstrip().startswith(COMMENT)

    @property
    def blank(self) -> bool:
        """Whether nothing stands on the line; such a line can still mean zeros."""
        return not self.text.strip()

    @property
    def lettered(self) -> bool:
        """Whether it starts in column 1 with a letter, as keywords and names do."""
        return self.text[:1].isalpha()

    @property
    def place(self) -> str:
        """Where it is: file and number, or its number alone."""
        if self.path is None:
            return f"line {self.number}"
        return f"{self.path}:{self.number}"

    def refuse(self, problem: str) -> DeckError:
        """Make the error that names this line."""
        return DeckError(f"{self.place}: {problem}")


def split_lines(data: bytes, path: Path | None) -> list[Line]:
    """Split `data` at its line feeds; a carriage return before one belongs to it."""
    lines = []
    start = 0
    for number, text in enumerate(data.decode("latin-1").split("\n"), start=1):
        stop = min(start + len(text) + 1, len(data))
        if stop > start:
            lines.append(Line(number, text.removesuffix("\r"), start, stop, path))
        start = stop
    return lines
