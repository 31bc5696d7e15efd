"""What a Marc deck asks for in the post file.

    post
             1        16        17         0         0        19        20         0 ...
           311         0
    nodal                        1

Fields of the first line: 1 element codes; 4 is 0 for binary, 1 for formatted; 9 every
n-th increment; 13 nodal codes, where 0 stands for displacement and forces. A code of
a user's own, below 0, has a label behind it.
"""

from dataclasses import dataclass

from decks.marc_grammar.deck import MarcDeck
from decks.marc_grammar.layout import fields, integers
from decks.marc_grammar.line import Line
from decks.marc_grammar.option import Option, Section

COUNT, FORMATTED, EVERY, NODAL_COUNT = 0, 3, 8, 12
"""Fields of the first line, from 0."""
BOTH = 2
"""Field 4 of a deck that asks for binary and formatted results: inferred, as what
Mentat offers third beside the two that are documented."""


@dataclass(frozen=True, slots=True)
class PostCode:
    """An element quantity: `code`, layer, and the label of a user's own."""

    code: int
    layer: int
    label: str
    line: Line


@dataclass(frozen=True, slots=True)
class Post:
    """The output wanted; `head` are the numbers of its first line, `head_line`."""

    codes: tuple[PostCode, ...]
    nodal: tuple[int, ...]
    head: tuple[int, ...]
    head_line: Line
    option: Option

    @property
    def formatted(self) -> bool:
        """Whether it is text."""
        return self.head[FORMATTED] == 1

    @property
    def every(self) -> int:
        """Every how many increments."""
        return max(self.head[EVERY], 1)


def post(deck: MarcDeck) -> Post | None:
    """Read ``post`` of the model definition, the last one; None for a deck without.

    Raises
    ------
    DeckError
        Fewer codes than it says.
    """
    found = deck.find("post", Section.MODEL)
    if not found:
        return None
    option = found[-1]
    rows = [line for line in option.data if not line.blank]
    if not rows:
        raise option.head.refuse("`post` without a line of numbers")
    head = integers(rows[0], option.layout)
    head += [0] * (NODAL_COUNT + 1 - len(head))
    codes = [line for line in rows[1:] if not line.lettered]
    nodal = [line for line in rows[1:] if line.lettered]
    if len(codes) < head[COUNT]:
        raise rows[0].refuse(
            f"{head[COUNT]} element codes announced, but {len(codes)} lines of them"
        )
    return Post(
        tuple(_code(line, option) for line in codes[: head[COUNT]]),
        tuple(_nodal(line, option) for line in nodal),
        tuple(head),
        rows[0],
        option,
    )


def _code(line: Line, option: Option) -> PostCode:
    code, layer, label = fields(line, option.layout, "iit")
    return PostCode(int(code), int(layer), str(label), line)


def _nodal(line: Line, option: Option) -> int:
    _, code = fields(line, option.layout, "wi")
    return int(code)
