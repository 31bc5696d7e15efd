"""A keyword deck (``.inp``) as its bytes: cards, their options, and where each stands.

    *AMPLITUDE, NAME=PRESS, TIME=TOTAL TIME      a keyword line: keyword, options
    ** a comment
    0., 0., 0.1, 1.                              a data line

Nothing is rewritten: a card knows the bytes that it takes, and the cards one after
another, with what stands before the first, are the deck. Blanks and tabs count
nowhere, case does not, a line may end in CRLF, and bytes need not be any encoding.

Abaqus continues a keyword line that ends in a comma on the next line; ccx 2.20 takes
the next line for data. So in a deck for ccx it is continued only where the next line
has an ``=``, which ccx cannot read as data.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from string import ascii_lowercase, ascii_uppercase

# A keyword: a star that no second star follows, after blanks if need be.
_KEYWORD_LINE = re.compile(rb"^[ \t]*\*(?![ \t]*\*)", re.MULTILINE)
_COMMENT = re.compile(rb"[ \t]*\*[ \t]*\*")
_WORD = re.compile(rb'(?:"[^"]*"|[^,])+')
_BLANK = b" \t\r\n\0"
# Of a to z alone: bytes beyond ASCII are kept, whatever letter they are somewhere.
_CAPITALS = str.maketrans(ascii_lowercase, ascii_uppercase)


@dataclass(frozen=True, slots=True)
class Option:
    """``NAME=value`` or ``NAME`` on a keyword line, at the bytes `start` to `stop`."""

    name: str
    value: str | None
    start: int
    stop: int

    @property
    def word(self) -> str:
        """The value as it is compared: in capitals and without blanks."""
        return squeezed(self.value or "")


@dataclass(frozen=True, slots=True)
class Card:
    """A keyword with its options, and the bytes up to the next keyword.

    `keyword` is in capitals without blanks, `title` as people write it. The keyword
    line, number `line` from 1, begins at `start`; what it says ends at `head`. Data
    and comments are the lines from `body` to `stop`.
    """

    keyword: str
    title: str
    options: tuple[Option, ...]
    line: int
    start: int
    head: int
    body: int
    stop: int

    def option(self, name: str) -> Option | None:
        """Give the option `name`; None where the card has it not."""
        return next((one for one in self.options if one.name == name), None)


@dataclass(frozen=True, slots=True)
class Row:
    """A data line that says something: its bytes, line end included, and its words."""

    line: int
    start: int
    stop: int
    words: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class InpText:
    """A deck, or a file that it includes: `data` and the cards in it.

    `name` is that of an included file, "" for the deck itself.
    """

    data: bytes
    name: str
    cards: tuple[Card, ...]

    @property
    def newline(self) -> bytes:
        """The line end that the first line has."""
        end = self.data.find(b"\n")
        return b"\r\n" if end > 0 and self.data[end - 1 : end] == b"\r" else b"\n"

    def lines(self, start: int, stop: int) -> Iterator[tuple[int, int]]:
        """Give start and stop of each line between two bytes, line ends included."""
        while start < stop:
            end = self.data.find(b"\n", start, stop) + 1 or stop
            yield start, end
            start = end

    def rows(self, start: int, stop: int, line: int) -> Iterator[Row]:
        """Give what lines between two bytes say, the first of them number `line`.

        Comments and blank lines are left out.
        """
        for offset, (first, last) in enumerate(self.lines(start, stop)):
            text = self.data[first : _end_of(self.data, first, last)].strip(_BLANK)
            if text and not _COMMENT.match(text):
                words = text.decode("latin-1").split(",")
                yield Row(line + offset, first, last, tuple(map(str.strip, words)))


def _end_of(data: bytes, first: int, last: int) -> int:
    """Give where a line ends that ends at byte `last`, without blanks and line end.

    What stands behind a carriage return is not read, as in ccx.
    """
    return first + len(data[first:last].partition(b"\r")[0].rstrip(_BLANK))


def squeezed(text: str) -> str:
    """Give a keyword, a name or a value as solvers compare it."""
    return "".join(text.replace('"', "").split()).translate(_CAPITALS)


def read_inp_text(data: bytes, name: str = "", *, abaqus: bool = False) -> InpText:
    """Find the cards of a deck; `abaqus`: by the rules of Abaqus, not of ccx.

    There is no deck that this cannot read: what is before the first keyword, or in
    no keyword's place, belongs to no card or to the one before it.
    """
    starts = [match.start() for match in _KEYWORD_LINE.finditer(data)]
    cards: list[Card] = []
    line, counted, text = 1, 0, InpText(data, name, ())
    for index, start in enumerate(starts):
        in_heading = bool(cards) and cards[-1].keyword == "HEADING"
        if in_heading and not abaqus and data[start : start + 1] != b"*":
            continue  # ccx: a heading ends at a star in the first column
        line += data.count(b"\n", counted, start)
        counted = start
        stop = starts[index + 1] if index + 1 < len(starts) else len(data)
        head = _head_lines(text, start, stop, abaqus)
        title, options = _words(data, head)
        body = head[-1][1]
        said = _end_of(data, *head[-1])
        if cards:
            cards[-1] = _up_to(cards[-1], start)
        keyword = squeezed(title)
        cards.append(Card(keyword, title, options, line, start, said, body, stop))
    if cards:
        cards[-1] = _up_to(cards[-1], len(data))
    return InpText(data, name, tuple(cards))


def _up_to(card: Card, stop: int) -> Card:
    if card.stop == stop:
        return card
    return replace(card, stop=stop)


def _head_lines(text: InpText, start: int, stop: int, abaqus: bool) -> list[tuple[int, int]]:
    """Give the lines of a keyword: the first one, and those that continue it."""
    lines = text.lines(start, stop)
    head = [next(lines)]
    for first, last in lines:
        end = _end_of(text.data, *head[-1])
        if text.data[end - 1 : end] != b",":
            break
        line = text.data[first:last]
        if _COMMENT.match(line) or not (abaqus or b"=" in line):
            break
        head.append((first, last))
    return head


def _words(data: bytes, head: list[tuple[int, int]]) -> tuple[str, tuple[Option, ...]]:
    found = []
    for first, last in head:
        for match in _WORD.finditer(data, first, _end_of(data, first, last)):
            word = match.group()
            begin = match.start() + len(word) - len(word.lstrip(_BLANK))
            stripped = word.strip(_BLANK)
            if stripped:
                found.append((stripped.decode("latin-1"), begin, begin + len(stripped)))
    options = []
    for said, begin, end in found[1:]:
        key, sign, value = said.partition("=")
        bare = value.strip().strip('"') if sign else None
        options.append(Option(squeezed(key), bare, begin, end))
    title = " ".join(found[0][0].replace("*", " ").split()).translate(_CAPITALS)
    return title, tuple(options)
