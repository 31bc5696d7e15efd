"""Which table of a Marc deck drives a motion, and by what factor.

A fixed displacement and a rigid body under position control are their value times
their table; |value| is the factor that turns the table into a depth. The sign is the
user's: it says which way is into the skin.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from decks.marc_grammar.conditions import FIXED_DISPLACEMENT, conditions
from decks.marc_grammar.contact import POSITION, TRANSLATIONS, contact, interactions
from decks.marc_grammar.deck import MarcDeck
from decks.marc_grammar.line import Line
from decks.marc_grammar.material import isotropic
from decks.marc_grammar.table import TIME, Table
from fembridge.errors import DeckError


@dataclass(frozen=True, slots=True)
class Use:
    """A place where a table is used: `value` times it is what `what` says.

    `moves` tells that this is a displacement; `condition` is the condition's name,
    empty for what always acts.
    """

    table: int
    value: float
    what: str
    moves: bool
    condition: str
    line: Line


def uses(deck: MarcDeck) -> tuple[Use, ...]:
    """All uses of tables that this grammar can see."""
    return (*_condition_uses(deck), *_body_uses(deck), *_other_uses(deck))


def driving_table(deck: MarcDeck, name: str | None) -> tuple[Table, tuple[Use, ...]]:
    """Give the table that is named, or the only one that moves something.

    Raises
    ------
    DeckError
        There is none, several could be meant, or the table also drives what is no
        displacement; the message names their lines.
    """
    found = uses(deck)
    moving = {use.table for use in found if use.moves}
    if name is None:
        candidates = [table for table in deck.tables if table.number in moving]
        if len(candidates) != 1:
            raise _unclear(deck, candidates)
        table = candidates[0]
    else:
        table = _named(deck, name)
    same = [each for each in deck.tables if each.number == table.number]
    if len(same) > 1:
        raise same[1].line.refuse(
            f"table {same[1].name!r} has number {table.number}, as has "
            f"{same[0].name!r} on {same[0].line.place}"
        )
    mine = tuple(use for use in found if use.table == table.number)
    for use in mine:
        if not use.moves:
            raise use.line.refuse(
                f"table {table.name!r} ({table.line.place}) also drives {use.what}, "
                "which is no displacement: give the motion a table of its own"
            )
    if not mine:
        raise table.line.refuse(
            f"table {table.name!r} drives no fixed displacement and no contact body"
        )
    _check_kind(table)
    return table, mine


def one_factor(table: Table, drives: tuple[Use, ...]) -> float:
    """Give |value| of what the table drives.

    Raises
    ------
    DeckError
        They differ, so that no table makes all of them the same depth.
    """
    first = drives[0]
    for use in drives[1:]:
        if abs(use.value) != abs(first.value):
            raise use.line.refuse(
                f"table {table.name!r} drives {use.what} with factor {use.value:g}, "
                f"but {first.what} ({first.line.place}) with {first.value:g}: which "
                "is the probe?"
            )
    return abs(first.value)


def _condition_uses(deck: MarcDeck) -> Iterator[Use]:
    for each in conditions(deck):
        what = f"`{each.family}` {each.name!r}"
        moves = each.family == FIXED_DISPLACEMENT
        directions = each.directions or (0,) * len(each.values)
        for value, table, direction in zip(each.values, each.tables, directions, strict=True):
            if not table or (moves and not value):
                continue
            turns = direction > TRANSLATIONS
            told = f"degree of freedom {direction} of {what}" if turns else what
            shifts = moves and not turns
            yield Use(table, value, told, shifts, each.name, each.value_line)


def _body_uses(deck: MarcDeck) -> Iterator[Use]:
    found = contact(deck)
    for body in found.bodies if found is not None else ():
        for row, (value, table) in enumerate(zip(body.motion, body.motion_table, strict=True)):
            if not table or not value:
                continue
            moves = body.control == POSITION and row < TRANSLATIONS
            what = f"contact body {body.name!r}"
            if not moves:
                manner = "rotation" if row >= TRANSLATIONS else "velocity or load"
                what = f"the {manner} of {what}"
            yield Use(table, value, what, moves, "", body.motion_line)


def _other_uses(deck: MarcDeck) -> Iterator[Use]:
    for material in isotropic(deck):
        for table in filter(None, material.tables):
            what = f"material {material.name!r}"
            yield Use(table, 1.0, what, False, "", material.line)
    for each in interactions(deck):
        for table in filter(None, each.tables):
            what = f"contact interaction {each.name!r}"
            yield Use(table, 1.0, what, False, "", each.line)


def _named(deck: MarcDeck, name: str) -> Table:
    wanted = name.strip()
    found = [table for table in deck.tables if table.name == wanted]
    if not found:
        found = [t for t in deck.tables if t.name.lower() == wanted.lower()]
    if not found:
        raise _refuse(deck, f"no table {name!r}; {_listed(deck.tables)}")
    if len(found) > 1:
        raise found[1].line.refuse(
            f"a second table {name!r}; the first is on {found[0].line.place}"
        )
    return found[0]


def _unclear(deck: MarcDeck, candidates: list[Table]) -> DeckError:
    if not candidates:
        return _refuse(
            deck,
            "no table drives a fixed displacement or the position of a contact body; "
            f"{_listed(deck.tables)}",
        )
    return candidates[1].line.refuse(
        f"{len(candidates)} tables drive a motion; name one: {_names(candidates)}"
    )


def _check_kind(table: Table) -> None:
    if table.points is None or not len(table.points):
        raise table.line.refuse(
            f"table {table.name!r} is a formula or of several variables, or its points "
            "are in a file that was not read; expected points of time and value"
        )
    if table.variables[0] != TIME:
        raise table.rows[1].refuse(
            f"table {table.name!r} is of variable type {table.variables[0]}, expected {TIME}, time"
        )


def _refuse(deck: MarcDeck, problem: str) -> DeckError:
    return DeckError(problem if deck.path is None else f"{deck.path}: {problem}")


def _listed(tables: tuple[Table, ...]) -> str:
    return f"tables there: {_names(tables)}" if tables else "the deck has no tables"


def _names(tables: tuple[Table, ...] | list[Table]) -> str:
    return ", ".join(f"{table.name} ({table.line.place})" for table in tables)
