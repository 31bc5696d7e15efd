"""A keyword deck (``.inp``) as its bytes: keywords, options, data, and where each stands.

    *AMPLITUDE, NAME=PRESS, TIME=TOTAL TIME      a keyword line: keyword, options
    ** a comment
    0., 0., 0.1, 1.                              a data line

A block knows the bytes that it takes, so that a change of a few bytes keeps all others
(`decks.own_model`). Blanks and tabs count nowhere, case does not, a line may end in
CRLF, and bytes need not be any encoding.

Abaqus continues a keyword line that ends in a comma on the next line; ccx 2.20 takes
the next line for data. So in a deck for ccx it is continued only where the next line
has an ``=``, which ccx cannot read as data.

``*INCLUDE`` puts a file's lines in its own place: they may go on with the data of the
keyword before it, and what follows it may go on with the last keyword of the file. So a
block has its data in pieces, some of which may be in another file. What cannot be read is
a DeckError that names the file and the line.
"""

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from string import ascii_lowercase, ascii_uppercase

from fembridge.errors import DeckError
from fembridge.host.store import MAX_DECK_BYTES, read_bytes

Resolver = Callable[[str], bytes | None]
"""Bytes of a file by the name under which the deck includes it; None: it is absent."""

# A keyword: a star that no second star follows, after blanks if need be.
_KEYWORD_LINE = re.compile(rb"^[ \t]*\*(?![ \t]*\*)", re.MULTILINE)
_COMMENT = re.compile(rb"[ \t]*\*[ \t]*\*")
_HEAD_FIELD = re.compile(rb'(?:"[^"]*"|[^,])+')
_BLANK = b" \t\r\n\0"
# Of a to z alone: bytes beyond ASCII are kept, whatever letter they are somewhere.
_CAPITALS = str.maketrans(ascii_lowercase, ascii_uppercase)
# A number as Fortran reads it.
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([ED][+-]?\d+)?", re.IGNORECASE)
# Keywords whose data may be in a file that INPUT= names.
_DATA_ELSEWHERE = ("NODE", "ELEMENT", "NSET", "ELSET")
_MAX_DEPTH = 9  # ccx 2.20 includes no deeper
_MAX_FILES = 1000  # one file may be included by many lines
_MAX_DIGITS = 10


@dataclass(frozen=True, slots=True, eq=False)
class Text:
    """Bytes of a deck, or of a file that it includes; `name` is "" for the deck itself."""

    data: bytes
    name: str = ""

    @property
    def newline(self) -> bytes:
        """The line end that the first line has."""
        end = self.data.find(b"\n")
        return b"\r\n" if end > 0 and self.data[end - 1 : end] == b"\r" else b"\n"

    def location(self, line: int) -> str:
        """File and number of a line, for an error."""
        return f"{self.name}, line {line}" if self.name else f"line {line}"

    def lines(self, start: int, stop: int) -> Iterator[tuple[int, int]]:
        """Start and stop of each line between two bytes, line ends included."""
        while start < stop:
            end = self.data.find(b"\n", start, stop) + 1 or stop
            yield start, end
            start = end

    def end_of(self, first: int, last: int) -> int:
        """Byte at which a line ends, without blanks and line end.

        What is behind a carriage return is not read, as in ccx.
        """
        return first + len(self.data[first:last].partition(b"\r")[0].rstrip(_BLANK))


@dataclass(frozen=True, slots=True)
class Option:
    """``NAME=value`` or ``NAME`` on a keyword line, at the bytes `start` to `stop`."""

    name: str
    value: str | None
    start: int
    stop: int

    @property
    def normalized(self) -> str:
        """The value as solvers compare it: in capitals and without blanks."""
        return normalized_name(self.value or "")


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """A data line that is no comment: its bytes, line end included, and its fields."""

    text: Text
    line: int
    start: int
    stop: int
    fields: tuple[str, ...]

    @property
    def where(self) -> str:
        """File and line, for an error."""
        return self.text.location(self.line)

    def number(self, index: int, *, blank: float | None = None) -> float:
        """The number at `index`; `blank` if the field is empty."""
        packed = self._packed(index)
        if not packed and blank is not None:
            return blank
        if _NUMBER.fullmatch(packed):
            value = float(packed.upper().replace("D", "E"))
            if math.isfinite(value):
                return value
        raise DeckError(f"{self.where}: {packed[:40]!r} where a number is expected")

    def integer(self, index: int, *, blank: int | None = None) -> int:
        """The integer at `index`; `blank` if the field is empty."""
        packed = self._packed(index)
        return blank if not packed and blank is not None else parse_integer(packed, self.where)

    def _packed(self, index: int) -> str:
        return "".join(self.fields[index].split()) if index < len(self.fields) else ""


@dataclass(frozen=True, slots=True)
class Piece:
    """Lines of `text` from byte `start` to `stop`, the first of them number `line`."""

    text: Text
    start: int
    stop: int
    line: int

    def rows(self, splits: int = -1) -> Iterator[Row]:
        """Its data lines, without comments and blank ones, split at the first commas."""
        data = self.text.data
        for offset, (first, last) in enumerate(self.text.lines(self.start, self.stop)):
            content = data[first:last].partition(b"\r")[0].strip(_BLANK)
            if content and not (content[:1] == b"*" and _COMMENT.match(content)):
                fields = tuple(map(str.strip, content.decode("latin-1").split(",", splits)))
                yield Row(self.text, self.line + offset, first, last, fields)


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """A keyword of `text` with its options, and all of its data, wherever that is.

    `keyword` is in capitals without star and blanks, `title` as people write it, star
    included. The keyword line, number `line` from 1, begins at byte `start`; what it
    says ends at `head`, its lines at `body`.
    """

    text: Text
    keyword: str
    title: str
    options: tuple[Option, ...]
    line: int
    start: int
    head: int
    body: int
    pieces: list[Piece] = field(default_factory=list)

    @property
    def where(self) -> str:
        """File and line of the keyword, for an error."""
        return self.text.location(self.line)

    def option(self, name: str) -> Option | None:
        """The option `name`; None where there is none."""
        return next((option for option in self.options if option.name == name), None)

    def value_of(self, name: str) -> str:
        """An option's value in capitals without blanks; "" for none."""
        option = self.option(name)
        return "" if option is None else option.normalized

    def rows(self, splits: int = -1) -> Iterator[Row]:
        """The data lines, split at the first commas."""
        for piece in self.pieces:
            yield from piece.rows(splits)

    def error(self, problem: str) -> DeckError:
        """A DeckError at this block."""
        return DeckError(f"{self.where}: {problem}")


@dataclass(frozen=True, slots=True)
class Inclusion:
    """A file that the deck names, and where; `read` is whether it was read."""

    name: str
    where: str
    read: bool


@dataclass(frozen=True, slots=True, eq=False)
class Deck:
    """The blocks of a deck in a solver's order, and the files that it includes."""

    blocks: tuple[Block, ...]
    inclusions: tuple[Inclusion, ...] = ()

    def blocks_of(self, *keywords: str) -> list[Block]:
        """The blocks that have one of `keywords`."""
        return [block for block in self.blocks if block.keyword in keywords]

    @property
    def unread(self) -> str:
        """A remark on the files that were not read, for an error; "" for none."""
        names = [
            f"{inclusion.name} ({inclusion.where})"
            for inclusion in self.inclusions
            if not inclusion.read
        ]
        return f"; not read: {', '.join(names)}" if names else ""


def block_text(block: Block) -> bytes:
    """The bytes of a block with its data, wherever they are; without ``INPUT=`` once it is read."""
    head = block.text.data[block.start : block.body]
    option = block.option("INPUT")
    if option is not None and any(piece.text is not block.text for piece in block.pieces):
        comma = block.text.data.rindex(b",", block.start, option.start)
        head = block.text.data[block.start : comma] + block.text.data[option.stop : block.body]
    data = b"".join(piece.text.data[piece.start : piece.stop] for piece in block.pieces)
    end = b"" if not data or data.endswith(b"\n") else b"\n"
    return head.rstrip(b"\r\n") + b"\n" + data + end


def normalized_name(text: str) -> str:
    """A keyword, a name or a value as solvers compare it."""
    return "".join(text.replace('"', "").split()).translate(_CAPITALS)


def parse_integer(text: str, where: str) -> int:
    """The integer in `text`; `where` is named in an error."""
    packed = "".join(text.split())
    if not (packed.isascii() and packed.isdigit() and len(packed) <= _MAX_DIGITS):
        raise DeckError(f"{where}: {text.strip()[:40]!r} where a whole number is expected")
    return int(packed)


# ---- Reading


def read_inp(
    data: bytes, *, abaqus: bool = False, resolver: Resolver | None = None, name: str = ""
) -> Deck:
    """Read a deck and, by `resolver`, the files that it includes.

    `abaqus`: by the rules of Abaqus, not of ccx; `name` is put before line numbers. All bytes are
    accepted: text before the first keyword belongs to no block, other text to the block before it.

    Raises
    ------
    DeckError
        ``*INCLUDE`` without a file, or files that include each other.
    """
    reader = _Reader(abaqus, resolver)
    reader.take(Text(data, name), ())
    return Deck(tuple(reader.blocks), tuple(reader.inclusions))


def folder_resolver(path: Path) -> Resolver:
    """Resolver of included files: by name, in the folder of the deck at `path`."""

    def resolve(name: str) -> bytes | None:
        try:
            return read_bytes(path.parent / name, MAX_DECK_BYTES, DeckError)
        except (DeckError, ValueError):
            return None

    return resolve


class _Reader:
    """Reader that collects blocks file by file."""

    def __init__(self, abaqus: bool, resolver: Resolver | None) -> None:
        self._abaqus, self._resolver = abaqus, resolver
        self.blocks: list[Block] = []
        self.inclusions: list[Inclusion] = []

    def take(self, text: Text, above: tuple[str, ...]) -> None:
        """Append the blocks of `text`, which was included by way of `above`."""
        blocks = blocks_in(text, abaqus=self._abaqus)
        before = blocks[0].start if blocks else len(text.data)
        self._continue(Piece(text, 0, before, 1))
        for block in blocks:
            name = (option := block.option("INPUT")) and option.value
            if block.keyword == "INCLUDE":
                if not name:
                    raise block.error("*INCLUDE without INPUT=")
                if name in above or len(above) >= _MAX_DEPTH:
                    raise block.error(f"*INCLUDE of {name} includes itself")
                included = self._open(name, block.where, required=True)
                if included is not None:
                    self.take(included, (*above, name))
                self._continue(block.pieces[0])
                continue
            self.blocks.append(block)
            if name:
                required = block.keyword in _DATA_ELSEWHERE
                if (file := self._open(name, block.where, required)) is not None:
                    block.pieces.append(Piece(file, 0, len(file.data), 1))

    def _continue(self, piece: Piece) -> None:
        if self.blocks and piece.start < piece.stop:
            self.blocks[-1].pieces.append(piece)

    def _open(self, name: str, where: str, required: bool) -> Text | None:
        if len(self.inclusions) >= _MAX_FILES:
            raise DeckError(f"{where}: more than {_MAX_FILES} files are included")
        data = self._resolver(name) if required and self._resolver is not None else None
        self.inclusions.append(Inclusion(name, where, data is not None or not required))
        return None if data is None else Text(data, name)


def blocks_in(text: Text, *, abaqus: bool = False) -> list[Block]:
    """The blocks of one file, each with its lines up to the next one; no file is included."""
    data, blocks = text.data, list[Block]()
    starts = [match.start() for match in _KEYWORD_LINE.finditer(data)]
    line, counted = 1, 0
    for start, stop in zip(starts, [*starts[1:], len(data)], strict=False):
        in_heading = bool(blocks) and blocks[-1].keyword == "HEADING"
        if in_heading and not abaqus and data[start : start + 1] != b"*":
            continue  # ccx: a heading ends at a star in the first column
        line += data.count(b"\n", counted, start)
        counted = start
        head = _head_lines(text, start, stop, abaqus)
        title, options = _split_head(text, head)
        end, body = text.end_of(*head[-1]), head[-1][1]
        blocks.append(
            Block(text, normalized_name(title), f"*{title}", options, line, start, end, body)
        )
    ends = [*(block.start for block in blocks[1:]), len(data)]
    for block, end in zip(blocks, ends, strict=False):
        first = block.line + data.count(b"\n", block.start, block.body)
        block.pieces.append(Piece(text, block.body, end, first))
    return blocks


def _head_lines(text: Text, start: int, stop: int, abaqus: bool) -> list[tuple[int, int]]:
    """The lines of a keyword: the first one, and those that continue it."""
    lines = text.lines(start, stop)
    head = [next(lines)]
    for first, last in lines:
        end = text.end_of(*head[-1])
        if text.data[end - 1 : end] != b",":
            break
        line = text.data[first:last]
        if _COMMENT.match(line) or not (abaqus or b"=" in line):
            break
        head.append((first, last))
    return head


def _split_head(text: Text, head: list[tuple[int, int]]) -> tuple[str, tuple[Option, ...]]:
    """The keyword, without star, and the options of its lines."""
    fields = []
    for first, last in head:
        for match in _HEAD_FIELD.finditer(text.data, first, text.end_of(first, last)):
            field = match.group()
            begin = match.start() + len(field) - len(field.lstrip(_BLANK))
            stripped = field.strip(_BLANK)
            if stripped:
                fields.append((stripped.decode("latin-1"), begin, begin + len(stripped)))
    options = []
    for content, begin, end in fields[1:]:
        key, sign, value = content.partition("=")
        bare = value.strip().strip('"') if sign else None
        options.append(Option(normalized_name(key), bare, begin, end))
    title = " ".join(fields[0][0].replace("*", " ").split()).translate(_CAPITALS)
    return title, tuple(options)


# ---- Sets


def node_sets(deck: Deck) -> dict[str, list[range]]:
    """The node sets of a deck for CalculiX by name, in capitals, as runs of numbers.

    A set may be spread over the deck, and may name sets before it.
    """
    sets: dict[str, list[range]] = {}
    for block in deck.blocks_of("NSET", "NODE"):
        name = block.value_of("NSET")
        if not name and block.keyword == "NODE":
            continue
        foreign = [option.name for option in block.options if option.name in ("ELSET", "INSTANCE")]
        if not name or foreign:
            raise block.error(f"{block.title} {f'with {foreign[0]}=' if name else 'without NSET='}")
        runs = sets.setdefault(name, [])
        for run in members(block, sets):
            last = runs[-1] if runs else range(0)
            if runs and last.step == run.step and last.stop == run.start:
                runs[-1] = range(last.start, run.stop, run.step)
            else:
                runs.append(run)
    return sets


def members(block: Block, sets: Mapping[str, list[range]]) -> Iterator[range]:
    """Numbers that a block puts into its set; sets that it names are in `sets`.

    ``*NODE`` and ``*ELEMENT`` put in the number that each of their lines begins with.
    """
    listed = block.keyword in ("NSET", "ELSET")
    generated = block.option("GENERATE") is not None
    for row in block.rows() if listed else block.rows(splits=1):
        fields = [text for text in (row.fields if listed else row.fields[:1]) if text]
        if listed and generated:
            first, last, step = (*(_member(text, row.where) for text in fields), 1, 0, 0)[:3]
            if len(fields) not in (2, 3) or step < 1 or last < first:
                content = ",".join(fields)
                raise DeckError(f"{row.where}: {content!r}, expected first, last, step")
            yield range(first, last + 1, step)
            continue
        for text in fields:
            if listed and not text.isdigit() and normalized_name(text) in sets:
                yield from list(sets[normalized_name(text)])
            else:
                number = _member(text, row.where)
                yield range(number, number + 1)


def _member(text: str, where: str) -> int:
    """The number in a field of a set; unlike CalculiX, ``5 3`` is not read as 53."""
    if len(text.split()) > 1:
        raise DeckError(f"{where}: {text.strip()[:40]!r}, expected one number between commas")
    return parse_integer(text, where)
