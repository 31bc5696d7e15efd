"""A Marc deck cut into options, without losing a byte.

A keyword starts in column 1 with a letter; what follows it up to the next keyword is
its data. Which lines start so and are names nevertheless: `decks.marc_grammar.names`.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from decks.marc_grammar.deck import Include, MarcDeck
from decks.marc_grammar.keywords import CONDITIONS, OPENING, name_of, significant
from decks.marc_grammar.layout import Layout
from decks.marc_grammar.line import Line, split_lines
from decks.marc_grammar.names import condition_name, is_name
from decks.marc_grammar.option import Option, Section
from fembridge.errors import DeckError

Resolver = Callable[[str], bytes | None]

_INCLUDE = re.compile(r"include(?:\s*,\s*|\s+)(?P<name>\S.*)", re.IGNORECASE)
# What Mentat writes before a load case.
_STARTS = re.compile(r"\$\.*start of loadcase\b", re.IGNORECASE)
_DEEPEST = 16  # files included by one another
_LOOK = 4096  # bytes in which a deck's first keyword stands
_END = "end"
_END_OPTION = "end option"
_CONTINUE = "continue"


def read_marc_deck(
    data: bytes, name: Path | None = None, resolver: Resolver | None = None
) -> MarcDeck:
    """Read a Marc deck.

    Parameters
    ----------
    data
        Its bytes.
    name
        Its file, for messages.
    resolver
        Gives the bytes of an included file by the name in the deck, None where it
        has none. Without it, included files are noted and not followed.

    Raises
    ------
    DeckError
        No Marc deck, cut short, or its counts do not agree; names the line.
    """
    if b"\0" in data:
        raise _no_deck(name, "zero bytes, expected text")
    includes = _Includes(name, resolver)
    cutter = _Cutter()
    for line in includes.lines(split_lines(data, name)):
        if not cutter.keyword and not (line.comment or line.blank or line.lettered):
            raise line.refuse(
                f"no Marc deck: starts with {line.text.strip()[:40]!r}, expected a "
                "parameter such as `title`, from column 1"
            )
        cutter.take(line)
    cutter.close()
    return _checked(name, cutter.options, includes.found)


def looks_like_marc(data: bytes) -> bool:
    """Whether the first line of a file that is no comment opens a Marc deck."""
    for line in split_lines(data[:_LOOK], None):
        if not (line.comment or line.blank):
            return significant(line.text) in OPENING
    return False


def _checked(path: Path | None, options: list[Option], includes: list[Include]) -> MarcDeck:
    keywords = {option.keyword for option in options}
    if _END not in keywords or not keywords.intersection(OPENING):
        raise _no_deck(path, "no parameters such as `sizing` that end with `end`")
    missing = _is_cut(options)
    followed = all(each.followed for each in includes)
    if missing is not None and followed:
        last = options[-1]
        raise last.lines[-1].refuse(
            f"the deck ends in `{last.keyword}`, which starts on {last.head.place}; "
            f"expected `{missing}` before the end: the file is cut short"
        )
    return MarcDeck(path, tuple(options), tuple(includes))


def _no_deck(name: Path | None, found: str) -> DeckError:
    where = "" if name is None else f"{name}: "
    return DeckError(f"{where}no Marc deck: {found}")


@dataclass(slots=True)
class _Includes:
    """Lines of the deck and, where they can be had, of the files it includes."""

    path: Path | None  # of the deck
    resolver: Resolver | None
    found: list[Include] = field(default_factory=list)

    def lines(self, lines: list[Line], opened: tuple[str, ...] = ()) -> Iterator[Line]:
        """Give `lines`, with those of an included file behind its mention."""
        for line in lines:
            match = _INCLUDE.match(line.text)
            if match is None:
                yield line
                continue
            name = match["name"].strip().strip(",").strip().strip("\"'")
            inner = None if self.resolver is None else self.resolver(name)
            self.found.append(Include(name, line, inner is not None))
            if inner is None:
                yield line
                continue
            yield line._replace(followed=True)
            if name in opened or len(opened) == _DEEPEST:
                raise line.refuse(f"{name} includes itself, or is nested too deep")
            path = Path(name)
            behind = [
                Line(each.number, each.text, line.stop, line.stop, path, included=True)
                for each in split_lines(inner, path)
            ]
            yield from self.lines(behind, (*opened, name))


@dataclass(slots=True)
class _Cutter:
    """The options so far, and the one that is being read."""

    options: list[Option] = field(default_factory=list)
    section: Section = Section.PARAMETER
    case: int = 0
    layout: Layout = Layout.FIXED
    keyword: str = ""
    known: bool = True
    lines: list[Line] = field(default_factory=list)
    rows: list[Line] = field(default_factory=list)
    conditions: set[str] = field(default_factory=set)

    def take(self, line: Line) -> None:
        """Add one line: it opens an option or belongs to the one that is open."""
        if line.comment:
            self.lines.append(line)
        elif self._opens(line):
            self.close()
            name = name_of(line.text)
            self.known = name is not None
            self.keyword = name or significant(line.text)
            if self.section is Section.PARAMETER:
                self.keyword = significant(line.text)
            self.lines, self.rows = [line], []
        else:
            self.lines.append(line)
            self.rows.append(line)

    def close(self) -> None:
        """End the open option."""
        if not self.lines:
            return
        self.options.append(
            Option(self.keyword, tuple(self.lines), self.section, self.case, self.layout)
        )
        if self.keyword in CONDITIONS:
            names = (condition_name(row.text, self.layout) for row in self.rows)
            self.conditions.update(filter(None, names))
        if self.section is Section.PARAMETER:
            if self.keyword == "extended":
                self.layout = Layout.EXTENDED
            elif self.keyword == _END:
                self.section = Section.MODEL
        elif self.keyword == _END_OPTION:
            self.section, self.case = Section.HISTORY, 1
        elif self.keyword == _CONTINUE:
            self.case += 1

    def _opens(self, line: Line) -> bool:
        if not line.lettered or _INCLUDE.match(line.text):
            return False
        if self.section is Section.PARAMETER and self.keyword != _END:
            return True
        return not is_name(
            self.keyword, self.rows, line, self.layout, known=self.known, conditions=self.conditions
        )


def _is_cut(options: list[Option]) -> str | None:
    """Name what is missing where a deck ends."""
    last = options[-1]
    if last.section is Section.PARAMETER:
        return None if last.keyword == _END and _is_root(options) else _END_OPTION
    whole = _END_OPTION if last.section is Section.MODEL else _CONTINUE
    if last.keyword != whole:
        return whole
    announced = any(_STARTS.match(line.text) for line in last.lines)
    return _CONTINUE if announced else None


def _is_root(options: list[Option]) -> bool:
    """Whether this is the first deck of several domains, which holds no mesh."""
    return not any(any(each.numbers) for each in options if each.keyword == "sizing")
