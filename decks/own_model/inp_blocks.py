"""A deck with the files that it includes, in the order in which a solver reads it.

``*INCLUDE`` puts a file's lines in its own place: they may go on with the data of the
card before it, and what follows it may go on with the last card of the file. So a
block is a card with its data in pieces, some of which may stand in another file.
Only the deck itself is ever changed; an error names the file and the line.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from decks.own_model.inp_text import Card, InpText, Option, Row, read_inp_text
from fembridge.errors import DeckError

Resolver = Callable[[str], bytes | None]

# Cards whose data may stand in a file that INPUT= names.
_DATA_ELSEWHERE = ("NODE", "ELEMENT", "NSET", "ELSET")
_DEEPEST = 9  # ccx 2.20 includes no deeper


@dataclass(frozen=True, slots=True)
class Piece:
    """Lines of `text` from byte `start` to `stop`, the first of them number `line`."""

    text: InpText
    start: int
    stop: int
    line: int


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """A card of `text` with all of its data, wherever that stands."""

    text: InpText
    card: Card
    pieces: list[Piece] = field(default_factory=list)

    @property
    def keyword(self) -> str:
        """In capitals, without star and blanks."""
        return self.card.keyword

    @property
    def title(self) -> str:
        """The keyword as people write it, star included."""
        return f"*{self.card.title}"

    @property
    def own(self) -> bool:
        """Whether the card stands in the deck itself."""
        return not self.text.name

    @property
    def where(self) -> str:
        """The keyword's place, as an error names it."""
        return place_of(self.text, self.card.line)

    def option(self, name: str) -> Option | None:
        """Give the option `name`; None where the card has it not."""
        return self.card.option(name)

    def word(self, name: str) -> str:
        """Give an option's value in capitals without blanks; "" for none."""
        option = self.card.option(name)
        return "" if option is None else option.word

    def placed_rows(self) -> Iterator[tuple[InpText, Row]]:
        """Give the data lines, each with the file that it stands in."""
        for piece in self.pieces:
            for row in piece.text.rows(piece.start, piece.stop, piece.line):
                yield piece.text, row

    def rows(self) -> list[Row]:
        """Give the data lines, all of which are in the deck itself.

        Raises
        ------
        DeckError
            One stands in an included file, where it cannot be changed.
        """
        rows = []
        for text, row in self.placed_rows():
            if text.name:
                raise DeckError(
                    f"{place_of(text, row.line)}: data of {self.title}, "
                    f"{self.where}, in an included file; put it into the deck itself"
                )
            rows.append(row)
        return rows

    def error(self, problem: str) -> DeckError:
        """Make the error that says `problem` about this card."""
        return DeckError(f"{self.where}: {problem}")


@dataclass(frozen=True, slots=True)
class Inclusion:
    """A file that the deck names, and where; `read` tells whether it was read."""

    name: str
    where: str
    read: bool


@dataclass(frozen=True, slots=True, eq=False)
class Blocks:
    """The blocks of a deck in a solver's order, and the files they come from."""

    block: tuple[Block, ...]
    inclusions: tuple[Inclusion, ...]

    def of(self, *keywords: str) -> list[Block]:
        """Give the blocks that have one of `keywords`."""
        return [block for block in self.block if block.keyword in keywords]

    @property
    def unread(self) -> str:
        """A remark on the files that were not read, for an error; "" for none."""
        names = [f"{one.name} ({one.where})" for one in self.inclusions if not one.read]
        return f"; not read: {', '.join(names)}" if names else ""


def place_of(text: InpText, line: int) -> str:
    """Name a line as an error does."""
    return f"{text.name}, line {line}" if text.name else f"line {line}"


def read_blocks(data: bytes, *, abaqus: bool, resolver: Resolver | None = None) -> Blocks:
    """Read a deck and, by `resolver`, the files that it includes.

    `resolver` takes a name as the deck has it, and gives None for what it cannot read.

    Raises
    ------
    DeckError
        ``*INCLUDE`` without a file, or files that include each other.
    """
    text = read_inp_text(data, abaqus=abaqus)
    reader = _Reader(abaqus, resolver)
    reader.take(text, ())
    return Blocks(tuple(reader.blocks), tuple(reader.inclusions))


class _Reader:
    """Blocks as they come together, file by file."""

    def __init__(self, abaqus: bool, resolver: Resolver | None) -> None:
        self._abaqus, self._resolver = abaqus, resolver
        self.blocks: list[Block] = []
        self.inclusions: list[Inclusion] = []

    def take(self, text: InpText, above: tuple[str, ...]) -> None:
        """Append the blocks of `text`, which was included by way of `above`."""
        before = text.cards[0].start if text.cards else len(text.data)
        self._continue(Piece(text, 0, before, 1))
        for card in text.cards:
            line = card.line + text.data.count(b"\n", card.start, card.body)
            data = Piece(text, card.body, card.stop, line)
            if card.keyword == "INCLUDE":
                self._include(text, card, above)
                self._continue(data)
                continue
            self.blocks.append(Block(text, card, [data]))
            named = card.option("INPUT")
            if named is not None and named.value:
                wanted = card.keyword in _DATA_ELSEWHERE
                where = place_of(text, card.line)
                found = self._open(named.value, where, wanted)
                if found is not None:
                    self.blocks[-1].pieces.append(Piece(found, 0, len(found.data), 1))

    def _continue(self, piece: Piece) -> None:
        if self.blocks and piece.start < piece.stop:
            self.blocks[-1].pieces.append(piece)

    def _include(self, text: InpText, card: Card, above: tuple[str, ...]) -> None:
        where = place_of(text, card.line)
        named = card.option("INPUT")
        if named is None or not named.value:
            raise DeckError(f"{where}: *INCLUDE without INPUT=")
        if named.value in above or len(above) >= _DEEPEST:
            raise DeckError(f"{where}: *INCLUDE of {named.value} includes itself")
        found = self._open(named.value, where, wanted=True)
        if found is not None:
            self.take(found, (*above, named.value))

    def _open(self, name: str, where: str, wanted: bool) -> InpText | None:
        data = None
        if wanted and self._resolver is not None:
            data = self._resolver(name)
        self.inclusions.append(Inclusion(name, where, data is not None or not wanted))
        if data is None:
            return None
        return read_inp_text(data, name, abaqus=self._abaqus)
