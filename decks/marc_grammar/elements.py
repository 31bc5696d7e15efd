"""Elements of a Marc deck.

    connectivity
             0         0         1         0         1         1         0         1
             1       118       220       221      2589      2590      2591

The first line's fifth, sixth and eighth field name geometry, material and contact
body of all elements below, from input version 12 on. An element is its number, its
type and its nodes: 14 of them on the first line, 14 on each further one.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from decks.marc_grammar.layout import integers
from decks.marc_grammar.line import Line
from decks.marc_grammar.option import Option
from fembridge.typing import IntArray

FIRST_LINE = 14

# Nodes of an element by type, those of pressure included: the types of the decks
# tried, and those that third parties list from the element library, Volume B.
NODES = {
    **dict.fromkeys((9, 31, 52, 98), 2),
    **dict.fromkeys((2, 6, 138, 158, 201), 3),
    **dict.fromkeys((3, 10, 11, 18, 75, 114, 115, 116, 134, 135, 139, 140), 4),
    **dict.fromkeys((80, 82, 83, 118, 119, 157), 5),
    **dict.fromkeys((124, 125, 126, 128, 129, 136, 137, 200), 6),
    **dict.fromkeys((7, 22, 26, 27, 28, 30, 32, 33, 43, 53, 54, 55), 8),
    **dict.fromkeys((58, 59, 63, 66, 117, 123, 149), 8),
    **dict.fromkeys((84, 120), 9),
    **dict.fromkeys((34, 47, 60, 127, 130, 133), 10),
    **dict.fromkeys((202, 203), 15),
    **dict.fromkeys((21, 23, 35, 44, 57, 61, 150), 20),
}


@dataclass(frozen=True, slots=True, eq=False)
class Elements:
    """Elements of one type in one ``connectivity``, `number` ``(E,)``.

    `node` ``(E, k)`` are their nodes. `geometry`, `material` and `body` are 0 where
    the deck does not say them there. `line` is where the option starts.
    """

    kind: int
    number: IntArray
    node: IntArray
    geometry: int
    material: int
    body: int
    line: Line


def read_elements(options: Iterable[Option]) -> tuple[Elements, ...]:
    """Read all ``connectivity`` options, one value a type in each.

    Raises
    ------
    DeckError
        An element has too few nodes, or a number twice; names its line.
    """
    seen: dict[int, Line] = {}
    return tuple(each for option in options for each in _read(option, seen))


def _read(option: Option, seen: dict[int, Line]) -> list[Elements]:
    # A line with letters mentions a file that was not read.
    rows = [line for line in option.data if not (line.blank or line.lettered)]
    if not rows:
        return []
    head = integers(rows[0], option.layout) + [0] * 9
    found: dict[int, tuple[list[int], list[list[int]]]] = {}
    row = 1
    while row < len(rows):
        line = rows[row]
        values = integers(line, option.layout)
        row += 1
        if len(values) < 3:
            raise line.refuse("expected an element: number, type, nodes")
        number, kind = values[:2]
        if number in seen:
            raise line.refuse(f"element {number} again, first on {seen[number].place}")
        seen[number] = line
        count = NODES.get(kind, 0)
        while row < len(rows) and _goes_on(values, count, rows[row], option):
            values += integers(rows[row], option.layout)
            row += 1
        numbers, nodes = found.setdefault(kind, ([], []))
        expected = len(nodes[0]) if nodes else count or len(values) - 2
        if len(values) - 2 != expected:
            raise line.refuse(
                f"element {number} of type {kind} has {len(values) - 2} nodes, expected {expected}"
            )
        numbers.append(number)
        nodes.append(values[2:])
    return [
        Elements(
            kind,
            np.array(numbers, dtype=np.int64),
            np.array(nodes, dtype=np.int64),
            *(head[4], head[5], head[7]),
            option.head,
        )
        for kind, (numbers, nodes) in found.items()
    ]


def _goes_on(values: list[int], count: int, line: Line, option: Option) -> bool:
    """Whether the element goes on, on `line`; a type not known does if it may."""
    if count:
        return len(values) - 2 < count and (len(values) - 2) % FIRST_LINE == 0
    if (len(values) - 2) % FIRST_LINE:
        return False
    ahead = integers(line, option.layout)
    return len(ahead) < 2 or ahead[1] != values[1]
