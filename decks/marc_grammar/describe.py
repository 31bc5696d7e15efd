"""What a Marc deck holds, in words and counts."""

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from decks.marc_grammar.conditions import conditions
from decks.marc_grammar.contact import Contact, contact
from decks.marc_grammar.deck import MarcDeck
from decks.marc_grammar.history import LoadCase, load_cases
from decks.marc_grammar.mesh import read_sets
from decks.marc_grammar.post import post
from decks.marc_grammar.reader import read_marc_deck
from decks.marc_grammar.table import Table as MarcTable
from fembridge.errors import DeckError
from fembridge.typing import Table

_Held = TypeVar("_Held")
_BODY_KINDS = {1: "deformable", 2: "rigid", 3: "symmetry"}


def describe_marc_deck(path: Path) -> Table:
    """Tell what the deck at `path` holds; included files are looked for beside it.

    What a view of the deck refuses stands in ``remarks``, with its line.

    Raises
    ------
    DeckError
        No Marc deck, cut short, or not readable as a file.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DeckError(f"{path}: {error.strerror or error}") from error
    deck = read_marc_deck(data, path, beside(path))
    remarks = list(deck.remarks)

    def told(view: Callable[[MarcDeck], _Held]) -> _Held | None:
        try:
            return view(deck)
        except DeckError as error:
            remarks.append(f"not read: {error}")
            return None

    held: Table = {
        "format": "marc-deck",
        "bytes": len(data),
        "lines": sum(len(option.lines) for option in deck.options),
        "version": deck.version,
        "written_by": deck.mentat,
        "elements": {str(kind): count for kind, count in _kinds(deck).items()},
        "nodes": len(deck.coordinates.number),
        "sets": told(_sets) or {},
        "tables": [_table(each) for each in deck.tables],
        "conditions": told(_conditions) or [],
        "contact_bodies": told(_bodies) or [],
        "load_cases": told(_cases) or [],
        "post": told(_post),
        "sections": dict(Counter(o.keyword for o in deck.options if o.keyword)),
    }
    held["remarks"] = remarks
    return held


def beside(path: Path) -> Callable[[str], bytes | None]:
    """Give what reads included files: by their names, from the folder of `path`."""

    def resolve(name: str) -> bytes | None:
        try:
            return (path.parent / name).read_bytes()
        except (OSError, ValueError):
            return None

    return resolve


def _kinds(deck: MarcDeck) -> dict[int, int]:
    found: Counter[int] = Counter()
    for each in deck.elements:
        found[each.kind] += len(each.number)
    return dict(sorted(found.items()))


def _sets(deck: MarcDeck) -> Table:
    sets = read_sets(deck.find("define"))
    return {name: {"kind": each.kind, "members": len(each.member)} for name, each in sets.items()}


def _table(table: MarcTable) -> Table:
    held: Table = {"name": table.name, "number": table.number, "line": table.line.number}
    if table.points is not None and len(table.points):
        first, last = table.points[0].tolist(), table.points[-1].tolist()
        held |= {"points": len(table.points), "first": first, "last": last}
    return held


def _conditions(deck: MarcDeck) -> list[Table]:
    return [
        {"family": each.family, "name": each.name, "on": each.where} for each in conditions(deck)
    ]


def _bodies(deck: MarcDeck) -> list[Table]:
    found: Contact | None = contact(deck)
    return [
        {"name": each.name, "kind": _BODY_KINDS.get(each.kind, str(each.kind))}
        for each in (found.bodies if found is not None else ())
    ]


def _cases(deck: MarcDeck) -> list[Table]:
    return [_case(each) for each in load_cases(deck)]


def _case(case: LoadCase) -> Table:
    stepping = None if case.stepping is None else case.stepping.keyword
    return {
        "name": case.name,
        "stepping": stepping,
        "increments": case.increments,
        "period": case.period,
    }


def _post(deck: MarcDeck) -> Table | None:
    found = post(deck)
    if found is None:
        return None
    return {
        "codes": [each.code for each in found.codes],
        "nodal_codes": list(found.nodal),
        "formatted": found.formatted,
        "every": found.every,
    }
