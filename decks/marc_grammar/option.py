"""An option of a Marc deck: its keyword line and all lines up to the next one."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from decks.marc_grammar.keywords import SIGNIFICANT
from decks.marc_grammar.layout import Layout, cut, integer, is_free
from decks.marc_grammar.line import Line


class Section(Enum):
    """Where an option stands."""

    PARAMETER = "parameter"
    MODEL = "model definition"
    HISTORY = "history"


@dataclass(frozen=True, slots=True)
class Option:
    """A keyword and what belongs to it, comments too.

    `lines` starts with the keyword's; comments before the first keyword of a deck
    are an option without one. `case` is the load case, from 1, and 0 before the
    history. `layout` is that of its lines, but for those with commas.
    """

    keyword: str
    lines: tuple[Line, ...]
    section: Section
    case: int
    layout: Layout

    @property
    def head(self) -> Line:
        """The keyword's line."""
        return self.lines[0]

    @property
    def start(self) -> int:
        """Its first byte."""
        return self.lines[0].start

    @property
    def stop(self) -> int:
        """The byte behind its last."""
        return self.lines[-1].stop

    @property
    def data(self) -> list[Line]:
        """Its lines after the keyword's, without comments."""
        return [line for line in self.lines[1:] if not line.comment]

    @property
    def name(self) -> str:
        """What follows the keyword on its line: the name of a table, a title."""
        text = self.head.text
        if is_free(text):
            first, _, rest = text.partition(",")
            named = rest.strip().rstrip(",").strip()
            return named or first[self.layout.real :].strip()
        return text[self.layout.real :].strip() or text[SIGNIFICANT:].strip()

    @property
    def words(self) -> list[str]:
        """Words of the keyword's line, the keyword first."""
        return cut(self.head.text, self.layout, "w*")

    @property
    def numbers(self) -> list[int]:
        """Integers on the keyword's line; other fields there are 0."""
        text = self.head.text
        if is_free(text):
            texts = cut(text, self.layout, "w*")[1:]
        else:
            texts = cut(text[self.layout.real :], self.layout, "i*")
        return [_integer(each) for each in texts]


def blocks(rows: Sequence[Line], starts: Sequence[int]) -> list[Sequence[Line]]:
    """Cut `rows` at the rows `starts`; what lies before the first is left out."""
    stops = [*starts[1:], len(rows)]
    return [rows[at:stop] for at, stop in zip(starts, stops, strict=False)]


def _integer(text: str) -> int:
    try:
        return integer(text)
    except ValueError:
        return 0
