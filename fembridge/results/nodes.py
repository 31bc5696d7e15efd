"""Which nodes to read: by number, by name of a set, by place.

Sets are in the result file, or in a deck beside it: a Marc post file has its own; a
``.frd`` has none, and its deck is asked. The deck's suffix says whose it is: ``.inp``
CalculiX's (or Abaqus's), ``.dat`` Marc's. Places are coordinates of the undeformed
mesh in mm.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from fembridge.errors import DeckError, ResultError, UsageError
from fembridge.results.fields import node_numbers
from fembridge.results.read_options import ReadOptions
from fembridge.results.readers import open_source
from fembridge.results.source import Source
from fembridge.store import MAX_DECK_BYTES, read_bytes
from fembridge.typing import Table

_MOST_NODES = 2_000_000


def choose_nodes(
    source: Source,
    nodes: Sequence[int] = (),
    sets: Sequence[str] = (),
    near_mm: Sequence[Sequence[float]] = (),
    deck: Path | None = None,
) -> list[int]:
    """Numbers of nodes, of the `sets` and near the places `near_mm`, each once.

    `deck` holds the sets; None takes those of the result file where it has sets, else the
    deck with its stem beside it. What a set or place came to is noted.
    """
    found, words = node_numbers(nodes), []
    for name in sets:
        members, place = node_set(source, name, deck)
        found += members
        shown = ", ".join(map(str, members[:5])) + (", ..." if len(members) > 5 else "")
        count = f"{len(members)} node{'s' * (len(members) != 1)}"
        words.append(f"set {name} of {place.name}: {count}, {shown}")
    for node, said in near_nodes(source, near_mm) if len(near_mm) else ():
        found.append(node)
        words.append(said)
    for line in words:
        source.options.note(line)
    return list(dict.fromkeys(found))


def node_set(source: Source, name: str, deck: Path | None) -> tuple[list[int], Path]:
    """Nodes of the set `name`, case-blind and without blanks, and the file that has it."""
    missing = []
    for file, sets in _sets_of(source) if deck is None else [(deck, _sets_in(deck))]:
        for one, pieces in sets.items():
            if "".join(one.split()).casefold() == "".join(name.split()).casefold():
                if not 0 < (count := sum(map(len, pieces))) <= _MOST_NODES:
                    words = f"set {name} has {count} nodes, expected 1 to {_MOST_NODES}"
                    raise ResultError(words, file)
                return list(dict.fromkeys(int(node) for piece in pieces for node in piece)), file
        missing.append(f"{file}: no node set {name!r}; it has {', '.join(sets) or 'none'}")
    raise UsageError("; ".join(missing))


def sets_beside(path: Path) -> list[Table]:
    """The node sets of the deck beside a result file, as a description has them."""
    try:
        sets = read_node_sets(path.with_suffix(".inp"))
    except ResultError:
        return []
    return [
        {"name": name, "kind": "node", "members": sum(map(len, pieces))}
        for name, pieces in sets.items()
    ]


def read_node_sets(deck: Path) -> dict[str, list[range]]:
    """The node sets of a CalculiX deck by name, in capitals, as runs of numbers."""
    from decks.inp import beside, node_sets, read_inp

    try:
        held = read_inp(_bytes(deck), resolver=beside(deck))
        sets = node_sets(held)
    except DeckError as error:
        raise ResultError(str(error), deck) from error
    if held.unread:
        raise ResultError(f"its sets are not known{held.unread}", deck)
    return sets


Sets = Mapping[str, Sequence[Sequence[int]]]
"""Nodes of sets by name, in pieces."""


def _sets_of(source: Source) -> Iterator[tuple[Path, Sets]]:
    """Those of the file itself where its format has sets, and those of the deck beside it."""
    held, path = source.node_sets(), source.path
    if held is not None:
        from decks.marc.grammar import is_marc_deck

        yield path, held
        if is_marc_deck(path.with_suffix(".dat")):
            yield path.with_suffix(".dat"), _sets_in(path.with_suffix(".dat"))
        return
    deck = path.with_suffix(".inp")
    if not deck.is_file():
        raise UsageError(f"{path}: no deck {deck.name} beside it; name one: --deck")
    yield deck, _sets_in(deck)


def _sets_in(deck: Path) -> Sets:
    """The node sets of a deck or post file."""
    if deck.suffix.lower() in (".t16", ".t19"):
        with open_source(deck, ReadOptions()) as source:
            return source.node_sets() or {}
    if deck.suffix.lower() != ".dat":
        return read_node_sets(deck)
    from decks.marc.contents import read_marc_deck

    try:
        held = read_marc_deck(_bytes(deck)).sets().values()
    except DeckError as error:
        raise ResultError(f"sets cannot be read: {error}", deck) from error
    nodal = [one for one in held if one.kind.startswith("node")]
    return {one.name.strip(): [one.member.tolist()] for one in nodal}


def _bytes(deck: Path) -> bytes:
    return read_bytes(deck, MAX_DECK_BYTES, ResultError.at(deck))


def near_nodes(source: Source, places_mm: Sequence[Sequence[float]]) -> list[tuple[int, str]]:
    """The node nearest to each place that has a stress, of equals the lowest; and its words.

    A place is x, y or x, y, z. Without z the mesh has to be in one plane of z. The words
    say where the node is, how far away, and which is nearer and has no results, because
    the output was restricted to a set.
    """
    for place in places_mm:
        if len(place) not in (2, 3) or not all(map(math.isfinite, place)):
            raise UsageError(f"place {', '.join(map(str, place))}: expected x,y or x,y,z")
    path, (nodes, at_mm, held) = source.path, source.places()
    lowest, highest = float(at_mm[:, 2].min()), float(at_mm[:, 2].max())
    flat = highest - lowest <= 1e-9 * max(1.0, abs(lowest), abs(highest))
    if not flat and any(len(place) == 2 for place in places_mm):
        raise UsageError(
            f"{path}: nodes have z from {lowest:g} to {highest:g}: name a place as x,y,z"
        )
    found = []
    for place in places_mm:
        with np.errstate(over="ignore"):  # a place out of reach is at infinity
            away_mm = np.linalg.norm(at_mm[:, : len(place)] - np.array(place), axis=1)
        nearest = int(np.lexsort((nodes, away_mm))[0])
        row = int(np.lexsort((nodes, away_mm, ~held))[0])
        if not (held[row] and math.isfinite(away_mm[row])):
            raise ResultError("no node of the mesh has a place and results", path)
        asked, at = (
            ", ".join(f"{value:g}" for value in one) for one in (place, at_mm[row, : len(place)])
        )
        words = f"near {asked}: node {nodes[row]} at {at}, {away_mm[row]:.3g} mm away"
        if away_mm[nearest] < away_mm[row]:
            words += f" (node {nodes[nearest]} is nearer and has no results)"
        found.append((int(nodes[row]), words))
    return found
