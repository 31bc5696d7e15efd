"""Selection of nodes: by number, by set name, by position.

A Marc post file contains its sets. A ``.frd`` has none; its sets are read from the deck of
the same name in the same folder. The suffix gives the solver of a deck: ``.inp`` CalculiX or
Abaqus, ``.dat`` Marc. Positions are coordinates of the undeformed mesh in mm.
"""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from fembridge.errors import DeckError, ResultError, UsageError
from fembridge.results.fields import node_numbers
from fembridge.results.read_options import ReadOptions
from fembridge.results.readers import open_source
from fembridge.results.source import Source
from fembridge.typing import Table

_MAX_NODES = 2_000_000


def choose_nodes(
    source: Source,
    nodes: Sequence[int] = (),
    sets: Sequence[str] = (),
    near_mm: Sequence[Sequence[float]] = (),
    deck: Path | None = None,
) -> list[int]:
    """Numbers of the selected nodes, without duplicates; each set and position is logged.

    Parameters
    ----------
    source
        The open result file.
    nodes
        Node numbers.
    sets
        Names of node sets.
    near_mm
        Positions in mm: for each, the nearest node that has results.
    deck
        Deck that defines the sets. None: the result file itself if its format has sets, else
        the deck of the same name in its folder.
    """
    numbers, descriptions = node_numbers(nodes), []
    for name in sets:
        members, file = find_node_set(source, name, deck)
        numbers += members
        shown = ", ".join(map(str, members[:5])) + (", ..." if len(members) > 5 else "")
        count = f"{len(members)} node{'s' * (len(members) != 1)}"
        descriptions.append(f"set {name} of {file.name}: {count}, {shown}")
    for node, description in find_nearest_nodes(source, near_mm) if len(near_mm) else ():
        numbers.append(node)
        descriptions.append(description)
    for line in descriptions:
        source.options.note(line)
    return list(dict.fromkeys(numbers))


def find_node_set(source: Source, name: str, deck: Path | None) -> tuple[list[int], Path]:
    """Nodes of the set `name` (case and blanks do not matter), and the file that defines it."""
    missing = []
    for file, sets in _available_sets(source) if deck is None else [(deck, _read_sets(deck))]:
        for set_name, pieces in sets.items():
            if "".join(set_name.split()).casefold() == "".join(name.split()).casefold():
                if not 0 < (count := sum(map(len, pieces))) <= _MAX_NODES:
                    message = f"node set {name} has {count} nodes, expected 1 to {_MAX_NODES}"
                    raise ResultError(message, file)
                return list(dict.fromkeys(int(node) for piece in pieces for node in piece)), file
        missing.append(f"{file}: no node set {name!r}; the file has {', '.join(sets) or 'none'}")
    raise UsageError("; ".join(missing))


def describe_deck_sets(path: Path) -> list[Table]:
    """The node sets of the deck in the folder of a result file, for a description."""
    try:
        sets = read_node_sets(path.with_suffix(".inp"))
    except ResultError:
        return []
    return [
        {"name": name, "kind": "node", "members": sum(map(len, pieces))}
        for name, pieces in sets.items()
    ]


def shell_nodes(deck: Path, nodes: Collection[int]) -> set[int] | None:
    """Those of `nodes` that `deck` has in shells or membranes; None without a readable deck."""
    if not deck.is_file():
        return None
    from decks.inp import folder_resolver, read_inp
    from decks.own_model.inp_model import ModelScope, family_of

    try:
        scope = ModelScope(read_inp(_read_deck(deck), resolver=folder_resolver(deck)).blocks)
    except (DeckError, ResultError):
        return None
    return {
        node
        for node, elements in scope.elements_at(nodes).items()
        if any(family_of(element.kind) in ("shell", "membrane") for element in elements)
    }


def read_node_sets(deck: Path) -> dict[str, list[range]]:
    """The node sets of a CalculiX deck by name (in capitals), as ranges of node numbers."""
    from decks.inp import folder_resolver, node_sets, read_inp

    try:
        content = read_inp(_read_deck(deck), resolver=folder_resolver(deck))
        sets = node_sets(content)
    except DeckError as error:
        raise ResultError.from_error(error, deck) from error
    if content.unread:
        raise ResultError(f"the node sets are unknown{content.unread}", deck)
    return sets


Sets = Mapping[str, Sequence[Sequence[int]]]
"""Nodes of sets by name, in pieces."""


def _available_sets(source: Source) -> Iterator[tuple[Path, Sets]]:
    """Sets of the file itself if its format has sets, and of the deck in its folder."""
    file_sets, path = source.node_sets(), source.path
    if file_sets is not None:
        from decks.marc.grammar import is_marc_deck

        yield path, file_sets
        if is_marc_deck(path.with_suffix(".dat")):
            yield path.with_suffix(".dat"), _read_sets(path.with_suffix(".dat"))
        return
    deck = path.with_suffix(".inp")
    if not deck.is_file():
        raise UsageError(
            f"is missing, and this folder has no deck {deck.name}", path, argument="deck"
        )
    yield deck, _read_sets(deck)


def _read_sets(deck: Path) -> Sets:
    """The node sets of a deck or post file."""
    if deck.suffix.lower() in (".t16", ".t19"):
        with open_source(deck, ReadOptions()) as source:
            return source.node_sets() or {}
    if deck.suffix.lower() != ".dat":
        return read_node_sets(deck)
    from decks.marc.contents import read_marc_deck

    try:
        all_sets = read_marc_deck(_read_deck(deck)).sets().values()
    except DeckError as error:
        raise ResultError(f"cannot read the sets: {error}", deck) from error
    nodal_sets = [entry for entry in all_sets if entry.kind.startswith("node")]
    return {entry.name.strip(): [entry.member.tolist()] for entry in nodal_sets}


def _read_deck(deck: Path) -> bytes:
    from fembridge.host.store import MAX_DECK_BYTES, read_bytes

    return read_bytes(deck, MAX_DECK_BYTES, ResultError.at(deck))


def find_nearest_nodes(
    source: Source, positions_mm: Sequence[Sequence[float]]
) -> list[tuple[int, str]]:
    """The nearest node with results for each position, and a description of it.

    A position is (x, y) or (x, y, z) in mm; z may be omitted if all nodes have the same z. Of
    nodes at the same distance, the lowest number. The description has the coordinates of the
    node, its distance, and a nearer node without results, if the output was restricted to a set.
    """
    for position_mm in positions_mm:
        if len(position_mm) not in (2, 3) or not all(map(math.isfinite, position_mm)):
            values_text = ", ".join(map(str, position_mm))
            raise UsageError(f"is {values_text}, expected x,y or x,y,z", argument="near_mm")
    path, (nodes, coordinates_mm, has_results) = source.path, source.node_positions()
    lowest, highest = float(coordinates_mm[:, 2].min()), float(coordinates_mm[:, 2].max())
    flat = highest - lowest <= 1e-9 * max(1.0, abs(lowest), abs(highest))
    if not flat and any(len(position_mm) == 2 for position_mm in positions_mm):
        raise UsageError(
            f"lacks z: nodes have z from {lowest:g} to {highest:g} mm; expected x,y,z",
            path,
            argument="near_mm",
        )
    matches = []
    for position_mm in positions_mm:
        with np.errstate(over="ignore"):  # a huge coordinate has an infinite distance
            distances_mm = np.linalg.norm(
                coordinates_mm[:, : len(position_mm)] - np.array(position_mm), axis=1
            )
        nearest = int(np.lexsort((nodes, distances_mm))[0])
        row = int(np.lexsort((nodes, distances_mm, ~has_results))[0])
        if not (has_results[row] and math.isfinite(distances_mm[row])):
            raise ResultError("no node has both finite coordinates and results", path)
        requested_text, node_text = (
            ", ".join(f"{value:g}" for value in coordinates)
            for coordinates in (position_mm, coordinates_mm[row, : len(position_mm)])
        )
        distance_text = f"{distances_mm[row]:.3g} mm away"
        description = f"near {requested_text}: node {nodes[row]} at {node_text}, {distance_text}"
        if distances_mm[nearest] < distances_mm[row]:
            description += f" (node {nodes[nearest]} is nearer but has no results)"
        matches.append((int(nodes[row]), description))
    return matches
