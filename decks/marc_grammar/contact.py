"""Contact bodies, interactions and contact tables of a Marc deck.

A body is numbers and a name, then what it is, where it turns, how it moves:

             3         1         0         0         1        -1         0        -1load
             2         0 ...                      1 deformable, 2 rigid, 3 symmetry
     centre of rotation (3), 0 0 0, 1             seven reals
     0 0 0 0                                      friction, old style
     x, y, z, ...                                 eight reals, times their tables
             0         1 ...                      tables
             0         0         0         0

The sixth number is its control: -1 position, 0 velocity, above load. A rigid body has
the curves or surfaces that its second number counts. Positions are relative to where
the body was drawn: inferred from one deck whose author tells what it does.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from decks.marc_grammar.contact_shape import Shape, read_shapes
from decks.marc_grammar.deck import MarcDeck
from decks.marc_grammar.layout import Layout, cut, fields, integers, reals
from decks.marc_grammar.line import Line
from decks.marc_grammar.option import Option, Section, blocks

DEFORMABLE, RIGID, SYMMETRY = 1, 2, 3
POSITION, VELOCITY = -1, 0
TRANSLATIONS = 3
"""The first numbers of a motion: along x, y and z."""
COULOMB_BILINEAR = 6
_ID = "iiiiiiiit"
_BEFORE_BODIES = 4  # lines: two of integers, two of reals
_BODY_LINES = 7
_FRICTION = 2  # row of the coefficient among an interaction's first reals


@dataclass(frozen=True, slots=True)
class Body:
    """A contact body; `motion` (8) is multiplied by the tables `motion_table` (8)."""

    number: int
    name: str
    kind: int
    control: int
    motion: tuple[float, ...]
    motion_table: tuple[int, ...]
    shapes: tuple[Shape, ...]
    line: Line
    motion_line: Line
    table_line: Line


@dataclass(frozen=True, slots=True)
class Contact:
    """All of ``contact``: its numbers in order, and the bodies."""

    friction_type: int
    settings: tuple[int, ...]
    switches: tuple[int, ...]
    tolerances: tuple[float, ...]
    bodies: tuple[Body, ...]
    line: Line


@dataclass(frozen=True, slots=True)
class Interaction:
    """How two bodies touch: `kinds` of the two, friction coefficient, its tables."""

    number: int
    name: str
    kinds: tuple[int, ...]
    friction: float
    tables: tuple[int, ...]
    line: Line


@dataclass(frozen=True, slots=True)
class ContactTable:
    """Which bodies may touch: (first body, second body, interaction) a row."""

    number: int
    name: str
    pairs: tuple[tuple[int, int, int], ...]
    line: Line


def contact(deck: MarcDeck) -> Contact | None:
    """Read ``contact``; None for a deck without.

    Raises
    ------
    DeckError
        Fewer bodies than it says, or a body cut short.
    """
    found = deck.find("contact", Section.MODEL)
    if not found:
        return None
    option, layout = found[0], found[0].layout
    rows = option.data
    if len(rows) < _BEFORE_BODIES:
        raise option.head.refuse(
            f"`contact` has {len(rows)} lines, expected {_BEFORE_BODIES} and bodies"
        )
    settings = integers(rows[0], layout)
    starts = _body_starts(rows, layout)
    if not settings or len(starts) != settings[0]:
        raise rows[0].refuse(
            f"{settings[0] if settings else 0} contact bodies announced, but {len(starts)} found"
        )
    return Contact(
        settings[3] if len(settings) > 3 else 0,
        tuple(settings),
        tuple(integers(rows[1], layout)),
        (*reals(rows[2], layout), *reals(rows[3], layout)),
        tuple(_body(option, block) for block in blocks(rows, starts)),
        option.head,
    )


def interactions(deck: MarcDeck) -> tuple[Interaction, ...]:
    """Read all ``con intera`` options.

    Raises
    ------
    DeckError
        One that is cut short.
    """
    return tuple(_interaction(option) for option in deck.find("con intera", Section.MODEL))


def contact_tables(deck: MarcDeck) -> tuple[ContactTable, ...]:
    """Read all ``con table`` options.

    Raises
    ------
    DeckError
        Fewer pairs than it says.
    """
    return tuple(_table(option) for option in deck.find("con table", Section.MODEL))


def _body_starts(rows: Sequence[Line], layout: Layout) -> list[int]:
    """Rows of the bodies' first lines: their numbers rise from 1, a name is last."""
    starts: list[int] = []
    for row in range(_BEFORE_BODIES, len(rows)):
        *numbers, name = cut(rows[row].text, layout, _ID)
        if name and not _is_number(name) and numbers[0] == str(len(starts) + 1):
            starts.append(row)
    return starts


def _is_number(text: str) -> bool:
    return text.replace(".", "").replace("+", "").replace("-", "").isdigit()


def _body(option: Option, rows: Sequence[Line]) -> Body:
    layout = option.layout
    if len(rows) < _BODY_LINES:
        raise rows[-1].refuse(
            f"a contact body of {len(rows)} lines from {rows[0].place} on, expected "
            f"at least {_BODY_LINES}"
        )
    number, count, _, _, _, control, _, _, name = fields(rows[0], layout, _ID)
    what = integers(rows[1], layout)
    motion, tables = reals(rows[4], layout), integers(rows[5], layout)
    if not what or len(motion) < TRANSLATIONS or len(tables) != len(motion):
        raise rows[4].refuse(
            f"a body's motion of {len(motion)} numbers and {len(tables)} tables, "
            f"expected as many of both, and {TRANSLATIONS} at least"
        )
    return Body(
        int(number),
        str(name),
        what[0],
        int(control),
        tuple(motion),
        tuple(tables),
        read_shapes(rows[_BODY_LINES:], int(count), layout),
        rows[0],
        rows[4],
        rows[5],
    )


def _interaction(option: Option) -> Interaction:
    rows, layout = option.data, option.layout
    if len(rows) < 7:
        raise option.head.refuse("a contact interaction cut short")
    number, _, name = fields(rows[0], layout, "iit")
    kinds = tuple((integers(each, layout) or [0])[0] for each in rows[1:3])
    pairs = rows[5:]
    values = reals(pairs[0], layout)
    tables = [each for row in pairs[1::2] for each in integers(row, layout)]
    friction = values[_FRICTION] if len(values) > _FRICTION else 0.0
    return Interaction(int(number), str(name), kinds, friction, tuple(tables), option.head)


def _table(option: Option) -> ContactTable:
    rows, layout = option.data, option.layout
    if not rows:
        raise option.head.refuse("a contact table without lines")
    number, count, _, name = fields(rows[0], layout, "iiit")
    each = 6  # lines a pair
    if len(rows) - 1 < int(count) * each:
        raise rows[0].refuse(
            f"{count} pairs of bodies announced, but {len(rows) - 1} lines of them"
        )
    pairs = []
    for row in range(int(count)):
        first, second, interaction = integers(rows[1 + row * each], layout)[:3]
        pairs.append((first, second, interaction))
    return ContactTable(int(number), str(name), tuple(pairs), option.head)
