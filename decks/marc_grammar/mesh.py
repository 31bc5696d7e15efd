"""Nodes of a Marc deck, and its sets of nodes, elements, edges and faces.

    coordinates
             3      2582         0         1
             1 0.000000000000000+0 0.000000000000000+0 0.000000000000000+0
    define              node                set                 held
               1          to          15

Pressure nodes of mixed elements have no coordinates.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from decks.marc_grammar.layout import integers, node_fields
from decks.marc_grammar.line import Line
from decks.marc_grammar.number_list import NumberList, read_list
from decks.marc_grammar.option import Option
from fembridge.typing import FloatArray, IntArray

MOST_COORDINATES = 6
_PAIRED = ("edge", "face")  # sets of these hold pairs element:side


@dataclass(frozen=True, slots=True, eq=False)
class Coordinates:
    """Nodes, `number` ``(N,)``, and where they lie, `position` ``(N, d)``.

    In length units of the deck. `line` is where the option starts, None without.
    """

    number: IntArray
    position: FloatArray
    line: Line | None

    def of(self, node: int) -> FloatArray | None:
        """Where a node lies ``(d,)``; None when it has no place."""
        rows = np.flatnonzero(self.number == node)
        if not rows.size:
            return None
        place: FloatArray = self.position[rows[-1]]  # the last one counts
        return place


@dataclass(frozen=True, slots=True, eq=False)
class NamedSet:
    """A set: `kind` is the deck's word, such as ``node``, ``element``, ``edgemt``.

    `member` ``(M,)`` are numbers; of edges and faces ``(M, 2)`` element and side.
    """

    name: str
    kind: str
    member: IntArray
    line: Line


def read_coordinates(options: Iterable[Option]) -> Coordinates:
    """Read all ``coordinates`` options.

    Raises
    ------
    DeckError
        Not as many nodes as the option says, or a line that is no node.
    """
    numbers: list[int] = []
    places: list[list[float]] = []
    first: Line | None = None
    for option in options:
        first = first or option.head
        _read_nodes(option, numbers, places)
    width = max(map(len, places), default=3)
    return Coordinates(
        np.array(numbers, dtype=np.int64),
        np.array([each + [0.0] * (width - len(each)) for each in places]).reshape(
            len(places), width
        ),
        first,
    )


def read_sets(options: Iterable[Option]) -> Mapping[str, NamedSet]:
    """Read all ``define`` options; a set may name sets before it.

    Raises
    ------
    DeckError
        A list that cannot be read, or a set of no name.
    """
    found: dict[str, NamedSet] = {}
    members: dict[str, NumberList] = {}
    for option in options:
        kind, name = _kind_and_name(option)
        paired = kind.startswith(_PAIRED)
        earlier = {each: members[each] for each in found if each in members}
        listed = read_list(option.data, paired=paired, earlier=earlier)
        members[name] = listed
        member = np.array(listed, dtype=np.int64)
        shape = (len(listed), 2) if paired else (len(listed),)
        found[name] = NamedSet(name, kind, member.reshape(shape), option.head)
    return found


def _read_nodes(option: Option, numbers: list[int], places: list[list[float]]) -> None:
    rows = [line for line in option.data if not (line.blank or line.lettered)]
    if not rows:
        return
    head = [*integers(rows[0], option.layout), 0, 0]
    width, count, before = head[0] or 3, head[1], len(numbers)
    if not 1 <= width <= MOST_COORDINATES:
        raise rows[0].refuse(f"{width} coordinates a node, expected 1 to {MOST_COORDINATES}")
    for line in rows[1:]:
        number, place = node_fields(line, option.layout, width)
        numbers.append(number)
        places.append(place)
    found = len(numbers) - before
    if count and found != count and not any(line.lettered for line in option.data):
        raise rows[0].refuse(f"{count} nodes announced, but {found} lines of them")


def _kind_and_name(option: Option) -> tuple[str, str]:
    """Take the words of ``define KIND set NAME`` apart."""
    text = option.head.text
    if "," in text:
        words = [each.strip() for each in text.split(",")]
        name = ",".join(words[3:]).strip(",").strip()
    else:
        width = option.layout.real
        words = [text[at : at + width].strip() for at in range(0, 3 * width, width)]
        name = text[3 * width :].strip()
        if len(words) < 3 or not name:
            words = text.split(maxsplit=3)
            name = words[3].strip() if len(words) > 3 else ""
    kind = words[1].lower() if len(words) > 1 else ""
    if not kind or not name:
        raise option.head.refuse("expected `define`, what, `set` and a name")
    return kind, name
