"""Boundary and initial conditions of a Marc deck: all in one shape.

    fixed disp

             1         0         0         0         1         0indent
     0.000000000000000+0-1.000000000000000+0      values
             0         1                          table of each value, 0 for none
             1         2                          degree of freedom of each value
             2                                    kind of list: 2 is a set of nodes
    indent_nodes

Other conditions lack the degrees of freedom or have other numbers there. A load case
names the conditions that act in it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from decks.marc_grammar.deck import MarcDeck
from decks.marc_grammar.keywords import CONDITIONS
from decks.marc_grammar.layout import Layout, cut, fields, integers, reals
from decks.marc_grammar.line import Line
from decks.marc_grammar.option import Option, Section, blocks

FIXED_DISPLACEMENT = "fixed disp"
_ID = "iiiiiit"


@dataclass(frozen=True, slots=True)
class Condition:
    """A condition: `values`, and the table that each is multiplied by, 0 for none.

    `directions` are degrees of freedom from 1, of fixed displacements alone. `where`
    is the set it acts on; `value_line` and `table_line` hold the numbers.
    """

    family: str
    name: str
    values: tuple[float, ...]
    tables: tuple[int, ...]
    directions: tuple[int, ...]
    list_kind: int
    where: str
    line: Line
    value_line: Line
    table_line: Line


def conditions(deck: MarcDeck) -> tuple[Condition, ...]:
    """Read all conditions of the model definition.

    Raises
    ------
    DeckError
        A condition in another shape, such as that of decks without tables.
    """
    return tuple(
        condition
        for option in deck.options
        if option.keyword in CONDITIONS and option.section is Section.MODEL
        for condition in _read(option)
    )


def _read(option: Option) -> Iterator[Condition]:
    rows = option.data
    while rows and rows[-1].blank:
        rows.pop()
    starts = [row for row in range(len(rows)) if _is_id(rows[row], option.layout)]
    if rows and (not starts or starts[0] > 1):
        raise option.head.refuse(
            f"`{option.keyword}` is not in the table-driven style, expected a line of "
            "six integers and a name"
        )
    for block in blocks(rows, starts):
        yield _condition(option, block)


def _is_id(line: Line, layout: Layout) -> bool:
    """Whether numbers and then a name stand on the line."""
    if line.lettered or line.blank:
        return False
    *numbers, name = cut(line.text, layout, _ID)
    return bool(name) and all(each.lstrip("+-").isdigit() for each in numbers)


def _condition(option: Option, rows: Sequence[Line]) -> Condition:
    layout = option.layout
    displacement = option.keyword == FIXED_DISPLACEMENT
    needed = 6 if displacement else 5
    if len(rows) < needed:
        raise rows[-1].refuse(
            f"`{option.keyword}` has {len(rows)} lines from {rows[0].place} on, "
            f"expected at least {needed}"
        )
    name = str(fields(rows[0], layout, _ID)[6])
    values = reals(rows[1], layout)
    tables = integers(rows[2], layout)
    if len(tables) > len(values):
        raise rows[2].refuse(f"{len(tables)} tables for {len(values)} values")
    tables += [0] * (len(values) - len(tables))
    directions: tuple[int, ...] = ()
    if displacement:
        directions = tuple(integers(rows[3], layout))
        if len(directions) != len(values):
            raise rows[3].refuse(f"{len(directions)} degrees of freedom for {len(values)} values")
        kind, where = rows[4], rows[5]
    else:
        # Kinds of loads differ in what stands between; a name is always last.
        last = next((row for row in range(4, len(rows)) if rows[row].lettered), 4)
        kind, where = rows[last - 1], rows[last]
    return Condition(
        option.keyword,
        name,
        tuple(values),
        tuple(tables),
        directions,
        (integers(kind, layout) or [0])[0],
        where.text.strip().rstrip(",").strip(),
        rows[0],
        rows[1],
        rows[2],
    )
