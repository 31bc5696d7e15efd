"""A Marc deck as its options, with what is checked when it is read: the mesh."""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from decks.marc_grammar.elements import Elements, read_elements
from decks.marc_grammar.line import Line
from decks.marc_grammar.mesh import Coordinates, read_coordinates
from decks.marc_grammar.option import Option, Section
from decks.marc_grammar.table import Table, read_tables

_MENTAT = re.compile(r"\$\.+\s*MARC input file produced by (.*?)\s*\Z", re.IGNORECASE)
# What makes nodes and elements that stand on no line of their own.
_GENERATORS = (
    "conn fill",
    "conn gener",
    "node circle",
    "node fill",
    "node generation",
    "ufconn",
    "ufxord",
)


@dataclass(frozen=True, slots=True)
class Include:
    """A file that the deck includes, and whether it was read too."""

    name: str
    line: Line
    followed: bool


@dataclass(frozen=True, slots=True, eq=False)
class MarcDeck:
    """All of a deck: every line stands in one of `options`, in order.

    `elements`, `coordinates` and `tables` are read at once, since their counts show
    whether the deck is whole; other views take the deck.

    Raises
    ------
    DeckError
        Elements, nodes or points of a table are not as many as the deck says.
    """

    path: Path | None
    options: tuple[Option, ...]
    includes: tuple[Include, ...]
    elements: tuple[Elements, ...] = field(init=False)
    coordinates: Coordinates = field(init=False)
    tables: tuple[Table, ...] = field(init=False)

    def __post_init__(self) -> None:
        found = read_elements(self.find("connectivity", Section.MODEL))
        object.__setattr__(self, "elements", found)
        nodes = read_coordinates(self.find("coordinates", Section.MODEL))
        object.__setattr__(self, "coordinates", nodes)
        object.__setattr__(self, "tables", read_tables(self.find("table", Section.MODEL)))
        if not self._generates:
            self._check_sizes()

    def find(
        self, keyword: str, section: Section | None = None, case: int | None = None
    ) -> tuple[Option, ...]:
        """Give the options of that keyword, of one section, of one load case."""
        return tuple(
            option
            for option in self.options
            if option.keyword == keyword
            and section in (None, option.section)
            and case in (None, option.case)
        )

    @property
    def version(self) -> int | None:
        """The input version that the deck says: 11 for Mentat 2014, 15 from 2020."""
        for option in self.find("version", Section.PARAMETER):
            return (option.numbers or [0])[0]
        return None

    @property
    def mentat(self) -> str | None:
        """The program that wrote the deck, as the deck says."""
        for option in self.options:
            if option.section is not Section.PARAMETER:
                break
            for line in option.lines:
                found = _MENTAT.match(line.text)
                if found is not None:
                    return found[1]
        return None

    @property
    def sizes(self) -> tuple[int, int] | None:
        """Elements and nodes, pressure nodes too, that the deck says it has."""
        for option in self.find("sizing", Section.PARAMETER):
            numbers = option.numbers
            start = 1 if "," in option.head.text else 2  # a workspace comes before
            if len(numbers) >= start + 2:
                return numbers[start], numbers[start + 1]
        return None

    @property
    def cases(self) -> range:
        """Numbers of the load cases."""
        last = max((option.case for option in self.options), default=0)
        return range(1, last + 1)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a user should know about the deck."""
        told = [
            f"{each.line.place}: includes {each.name}, which was not read"
            for each in self.includes
            if not each.followed
        ]
        sizes, found = self.sizes, self._element_count
        if sizes is not None and found != sizes[0]:
            told.append(f"{found} elements, while `sizing` has room for {sizes[0]}")
        return tuple(told)

    @property
    def _element_count(self) -> int:
        return sum(len(each.number) for each in self.elements)

    @property
    def _generates(self) -> bool:
        """Whether there can be nodes and elements that are on no line read."""
        if any(not each.followed for each in self.includes):
            return True
        return any(option.keyword in _GENERATORS for option in self.options)

    def _check_sizes(self) -> None:
        """Compare counts: Mentat says how many there are, others how much room is."""
        sizes, found = self.sizes, self._element_count
        if sizes is None:
            return
        if found > sizes[0] or (found < sizes[0] and self.mentat is not None):
            line = self.find("sizing", Section.PARAMETER)[0].head
            raise line.refuse(
                f"`sizing` has {sizes[0]} elements, but the deck holds {found}"
                f"{_where(self.find('connectivity', Section.MODEL))}"
            )


def _where(options: Iterable[Option]) -> str:
    places = [option.head.place for option in options]
    return f" ({', '.join(places)})" if places else ""
