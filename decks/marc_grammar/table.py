"""Tables of a Marc deck: a value against one or more variables.

    table               waveform
             1         1         0         0         2
             1       501         2         0         0         2 ...
     0.000000000000000+0 0.000000000000000+0

The first line holds number, count of variables, and in its fifth field 2 where points
follow, 3 for a formula. Of each variable follow its type, its points, and whether
values beyond them are extrapolated. Conditions name tables by number.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from decks.marc_grammar.layout import at_least, fields, integers
from decks.marc_grammar.line import Line
from decks.marc_grammar.option import Option
from fembridge.typing import FloatArray

TIME = 1
"""Type of variable: time since the start of the job."""
POINTS = 2
FORMULA = 3
_PER_VARIABLE = 3


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """A table; `points` ``(P, 2)`` of one variable, None for other kinds.

    `variables` are types; `counts` their points. `rows` are the option's lines
    without comments: two of numbers, then the points.
    """

    name: str
    number: int
    variables: tuple[int, ...]
    counts: tuple[int, ...]
    kind: int
    points: FloatArray | None
    option: Option = field(repr=False)
    rows: tuple[Line, ...] = field(repr=False)

    @property
    def line(self) -> Line:
        """Where it starts."""
        return self.option.head


def read_tables(options: Iterable[Option]) -> tuple[Table, ...]:
    """Read all ``table`` options of the model definition.

    Raises
    ------
    DeckError
        A table of points has not as many as it says, or times that fall.
    """
    return tuple(_read(option) for option in options)


def _read(option: Option) -> Table:
    rows = option.data
    while rows and rows[-1].blank:
        rows.pop()
    if len(rows) < 2:
        raise option.head.refuse(f"table {option.name!r} has no lines of numbers")
    head = integers(rows[0], option.layout)
    at_least(rows[0], head, 2, "a table's number, count of variables")
    number, count = head[:2]
    kind = (head + [0] * 5)[4]
    if kind == FORMULA or not count >= 1:
        return Table(option.name, number, (), (), kind, None, option, tuple(rows))
    settings = integers(rows[1], option.layout)
    at_least(rows[1], settings, 2, "a variable's type, count of points")
    variables = tuple(settings[: _PER_VARIABLE * count : _PER_VARIABLE])
    counts = tuple(settings[1 : _PER_VARIABLE * count : _PER_VARIABLE])
    points = None
    if count == 1 and kind == POINTS:
        points = _points(option, rows, counts[0])
    return Table(option.name, number, variables, counts, kind, points, option, tuple(rows))


def _points(option: Option, rows: list[Line], count: int) -> FloatArray | None:
    """Read a variable and a value a line."""
    if any(line.lettered for line in rows):
        return None  # an included file that was not read
    if len(rows) - 2 != count:
        raise option.head.refuse(
            f"table {option.name!r} has {len(rows) - 2} lines of points, "
            f"while {rows[1].place} says {count}"
        )
    pairs = [fields(line, option.layout, "rr") for line in rows[2:]]
    return np.array(pairs, dtype=np.float64).reshape(count, 2)
