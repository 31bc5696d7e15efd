"""Afferents of a user's deck: nodes by class, as numbers, node sets or a table.

    {"SA": 461, "RA": [367, 370]}        nodes of each class
    {"SA": "MERKEL"}                     a node set of the deck
    "AFFERENT_SA"                        a node set whose name has the class
    "afferents.csv"                      afferent,node[,unit]

The result is by `fembridge.trace.afferent_key`: ``SA`` of a single node, ``SA 12`` where a class
has several units. A unit without a name is named after its node.
"""

import logging
import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from fembridge.errors import DeckError, UsageError
from fembridge.solver.build import BaseDeck
from fembridge.trace import AFFERENTS, UNIT_NAME, afferent_key

if TYPE_CHECKING:
    import pandas

_LOGGER = logging.getLogger(__name__)

Afferents: TypeAlias = (
    "Mapping[str, int | str | Sequence[int]] | str | PathLike[str] | pandas.DataFrame"
)
"""Nodes by class, the path of a table or a table."""

_COLUMNS = ("afferent", "node")
_MAX_LISTED = 8
_MARC_KINDS = ("node", "ndsq")
_TABLE_SUFFIXES = (".csv", ".txt", ".tsv")


def afferent_nodes(afferents: "Afferents | None", base: BaseDeck) -> dict[str, int]:
    """Node of each afferent of `afferents` in the deck `base`, by class and unit.

    Raises
    ------
    UsageError
        An unknown class, a node that is no number, a name of a unit that is there twice.
    DeckError
        The deck has no such node set.
    TableError
        A row of a table is no afferent.
    """
    if afferents is None:
        return {}
    rows: list[tuple[str, int, str]]
    if isinstance(afferents, Mapping):
        rows = list(chain.from_iterable(_rows_of(*item, base) for item in afferents.items()))
    elif isinstance(afferents, str) and not _is_file(afferents):
        names = filter(None, map(str.strip, afferents.split(",")))
        pairs = [(_class_in(name), name) for name in names]
        rows = list(chain.from_iterable(_rows_of(*item, base) for item in pairs))
    elif isinstance(afferents, str | PathLike) or hasattr(afferents, "columns"):
        rows = _table_rows(afferents)
    else:
        raise UsageError(
            argument="afferents",
            found=afferents,
            expected="a dict of nodes by class, a table afferent,node[,unit] or its path",
        )
    counts = [name for name, _, _ in rows]
    nodes: dict[str, int] = {}
    for name, node, unit in rows:
        key = afferent_key(name, unit or (str(node) if counts.count(name) > 1 else ""))
        if key in nodes:
            raise UsageError(f"names {key} twice", argument="afferents", found=key)
        nodes[key] = node
    return nodes


def _rows_of(
    name: object,
    value: object,
    base: BaseDeck,
) -> Iterable[tuple[str, int, str]]:
    """Class, node and unit of the nodes `value` of a class."""
    if name not in AFFERENTS:
        raise UsageError(
            argument="afferents", found=name, expected=f"one of {', '.join(AFFERENTS)}"
        )
    numbers = nodes_of_set(base, value) if isinstance(value, str) else value
    listed: list[Any] = list(numbers) if isinstance(numbers, Iterable) else [numbers]
    for number in listed:
        if isinstance(number, bool) or not hasattr(number, "__index__") or int(number) < 1:
            raise UsageError(
                argument="afferents", found=number, expected="numbers of nodes, 1 or more"
            )
    if not listed:
        raise UsageError(argument="afferents", found=value, expected=f"one node of {name} or more")
    return ((str(name), int(number), "") for number in listed)


def _is_file(text: str) -> bool:
    """Whether `text` is the path of a table, not the name of a set."""
    return Path(text).suffix.lower() in _TABLE_SUFFIXES or Path(text).is_file()


def _class_in(name: str) -> str:
    """The class that the name of a set has as one of its words."""
    parts = set(re.split("[^A-Z0-9]+", name.upper()))
    classes = [afferent for afferent in AFFERENTS if afferent in parts]
    if len(classes) != 1:
        expected = f"a table (.csv), or a set whose name has one of {', '.join(AFFERENTS)}"
        raise UsageError(
            f"is {name!r}, expected {expected} as a word; --afferent SA={name} names the class",
            argument="afferents",
            found=name,
            expected=expected,
        )
    return classes[0]


def _table_rows(source: Any) -> list[tuple[str, int, str]]:  # noqa: ANN401 - a table or its path
    """Class, node and unit of each row of a table."""
    from fembridge.io.text_table import read_table

    table = read_table(
        source if hasattr(source, "columns") else Path(source),
        _COLUMNS,
        ("unit",),
        unused=_LOGGER.info,
    )
    classes = table.choices("afferent", AFFERENTS)
    nodes = table.numbers("node", 1, int).tolist()
    units = list(table.column("unit")) if "unit" in table.header else [""] * len(nodes)
    for row, unit in enumerate(units):
        if unit and not UNIT_NAME.fullmatch(unit):
            expected = "letters, digits and . : _ -"
            raise table.error(row, f"unit is {unit!r}, expected {expected}")
    return list(zip(classes, nodes, units, strict=True))


def nodes_of_set(base: BaseDeck, name: str) -> list[int]:
    """Nodes of the node set `name` of a deck, in its order.

    Raises
    ------
    DeckError
        The deck has no such set, or its sets take more than reading.
    """
    sets = _marc_sets(base) if base.solver == "marc" else _keyword_sets(base)
    normalized = name.strip().upper()
    if normalized not in sets:
        listed = ", ".join(list(sets)[:_MAX_LISTED])
        more = f" and {len(sets) - _MAX_LISTED} more" if len(sets) > _MAX_LISTED else ""
        raise DeckError(
            f"has no node set {name!r}, its sets are {listed or 'none'}{more}",
            base.path,
            found=name,
            expected=listed,
        )
    return list(dict.fromkeys(sets[normalized]))


def _keyword_sets(base: BaseDeck) -> Mapping[str, Iterable[int]]:
    from decks.inp import folder_resolver, node_sets, read_inp

    deck = read_inp(base.data, abaqus=base.solver == "abaqus", resolver=folder_resolver(base.path))
    try:
        sets = node_sets(deck)
    except DeckError as error:
        raise DeckError.from_error(error, base.path) from error
    return {key: list(chain.from_iterable(runs)) for key, runs in sets.items()}


def _marc_sets(base: BaseDeck) -> Mapping[str, Iterable[int]]:
    from decks.marc.contents import read_marc_deck

    try:
        sets = read_marc_deck(base.data).sets()
    except DeckError as error:
        raise DeckError.from_error(error, base.path) from error
    return {
        key.upper(): item.member.ravel().tolist()
        for key, item in sets.items()
        if item.kind in _MARC_KINDS
    }
