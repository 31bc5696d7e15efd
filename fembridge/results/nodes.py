"""Which nodes to read: by number, by name of a set, by place.

Sets are in the result file, or in a deck beside it: a Marc post file has its own; a
``.frd`` has none, and its deck is asked. The deck's suffix says whose it is: ``.inp``
CalculiX's (or Abaqus's), ``.dat`` Marc's. Places are coordinates of the undeformed
mesh, as the file holds them: the deck's length unit, mm in ours.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fembridge.errors import DeckError, ResultError, UsageError
from fembridge.results.fields import open_source
from fembridge.results.read_options import ReadOptions

_POST = (".t16", ".t19")
_MOST_NODES = 2_000_000
_MOST_BYTES = 1 << 29  # of a deck, which is read at once


def choose_nodes(
    path: Path,
    nodes: Sequence[int] = (),
    sets: Sequence[str] = (),
    near_mm: Sequence[Sequence[float]] = (),
    deck: Path | None = None,
    log: Callable[[str], None] | None = None,
) -> list[int]:
    """Numbers of nodes, of the `sets` and near the places `near_mm`, each once.

    Parameters
    ----------
    path
        The result file.
    deck
        Holds the sets; None takes those of the result file where it has sets, else the
        deck with its stem beside it.
    log
        Gets what a set or place came to.

    Raises
    ------
    UsageError
        There is no deck, no such set, or a place is none.
    ResultError
        A set holds no nodes; the deck or the file cannot be read.
    """
    found, words = [int(node) for node in nodes], []
    for name in sets:
        members, place = node_set(path, name, deck)
        if not members:
            raise ResultError(f"set {name} holds no nodes", place)
        found += members
        shown = ", ".join(map(str, members[:5])) + (", ..." if len(members) > 5 else "")
        count = f"{len(members)} node{'s' * (len(members) != 1)}"
        words.append(f"set {name} of {place.name}: {count}, {shown}")
    if len(near_mm):
        near = near_nodes(path, near_mm)
        found += [one.node for one in near]
        words += map(str, near)
    if log is not None:
        for line in words:
            log(line)
    return list(dict.fromkeys(found))


def node_set(path: Path, name: str, deck: Path | None) -> tuple[list[int], Path]:
    """Nodes of the set `name`, case-blind, and the file that has it.

    `deck` None looks into the result file `path` where it has sets, else into the deck
    with its stem.
    """
    if deck is None and path.suffix.lower() in _POST:
        return _set_of_post(path, name)
    if deck is None:
        deck = deck_beside(path)
    if deck.suffix.lower() == ".dat":
        return _set_of_marc_deck(deck, name), deck
    return _set_of_deck(deck, name), deck


def deck_beside(result: Path) -> Path:
    """The deck with the stem of `result`, beside it.

    Raises
    ------
    UsageError
        There is none.
    """
    deck = result.with_suffix(".inp")
    if not deck.is_file():
        raise UsageError(f"{result}: no deck {deck.name} beside it; name one: --deck")
    return deck


def read_node_sets(deck: Path) -> dict[str, list[range]]:
    """The node sets of a CalculiX deck by name, in capitals, as runs of numbers.

    Raises
    ------
    ResultError
        There is no such deck, or a set in it cannot be read.
    """
    from decks.inp import node_sets, read_inp

    try:
        return node_sets(read_inp(_bytes(deck), resolver=lambda name: _bytes(deck.parent / name)))
    except DeckError as error:
        raise ResultError(str(error), deck) from error


def _set_of_deck(deck: Path, name: str) -> list[int]:
    found = read_node_sets(deck)
    nodes = found.get("".join(name.split()).upper())
    if nodes is None:
        raise UsageError(f"{deck}: no node set {name!r}; it has {', '.join(found) or 'none'}")
    if (count := sum(map(len, nodes))) > _MOST_NODES:
        raise ResultError(f"set {name} has {count} nodes, at most {_MOST_NODES} can be read", deck)
    return list(dict.fromkeys(node for run in nodes for node in run))


def _set_of_post(path: Path, name: str) -> tuple[list[int], Path]:
    from decks.marc.grammar import is_marc_deck
    from fembridge.results.marc_post import PostFile

    with PostFile(path) as post:
        sets = [one for one in post.mesh.sets if one.kind == "node"]
    held = {one.name.strip().casefold(): one for one in sets}
    found = held.get(name.strip().casefold())
    if found is not None:
        return list(dict.fromkeys(found.members.tolist())), path
    beside = path.with_suffix(".dat")
    words = ", ".join(one.name.strip() for one in sets) or "none"
    if is_marc_deck(beside):
        try:
            return _set_of_marc_deck(beside, name), beside
        except UsageError as error:
            words += f"; {error}"
    raise UsageError(f"{path}: no node set {name!r}; it has {words}")


def _set_of_marc_deck(deck: Path, name: str) -> list[int]:
    from decks.marc.contents import read_marc_deck

    try:
        sets = {
            one.name.strip().casefold(): one
            for one in read_marc_deck(_bytes(deck), deck).sets().values()
            if one.kind.startswith("node")
        }
    except DeckError as error:
        raise ResultError(f"sets cannot be read: {error}", deck) from error
    found = sets.get(name.strip().casefold())
    if found is None:
        words = ", ".join(one.name.strip() for one in sets.values()) or "none"
        raise UsageError(f"{deck}: no node set {name!r}; it has {words}")
    return list(dict.fromkeys(found.member.tolist()))


def _bytes(deck: Path) -> bytes:
    try:
        if (size := deck.stat().st_size) > _MOST_BYTES:
            raise ResultError(f"{size} bytes, expected a deck of at most {_MOST_BYTES}", deck)
        return deck.read_bytes()
    except OSError as error:
        raise ResultError(f"cannot be read: {error.strerror}", deck) from error


@dataclass(frozen=True, slots=True)
class NearNode:
    """The node taken for a place: where it is, and how far away.

    `nearer` is the node of the mesh that is nearer and has no results, if there
    is one: the output was restricted to a set.
    """

    node: int
    place_mm: tuple[float, ...]
    at_mm: tuple[float, ...]
    distance_mm: float
    nearer: int | None = None

    def __str__(self) -> str:
        place = ", ".join(f"{value:g}" for value in self.place_mm)
        at = ", ".join(f"{value:g}" for value in self.at_mm[: len(self.place_mm)])
        words = f"near {place}: node {self.node} at {at}, {self.distance_mm:.3g} mm away"
        if self.nearer is not None:
            words += f" (node {self.nearer} is nearer and has no results)"
        return words


def near_nodes(path: Path, places_mm: Sequence[Sequence[float]]) -> list[NearNode]:
    """The node nearest to each place that has a stress; of equals the lowest.

    A place is x, y or x, y, z. Without z the mesh has to be in one plane of z.

    Raises
    ------
    UsageError
        A place is not two or three finite numbers, or lacks the z it needs.
    ResultError
        The file has no nodes, or no stress; a coordinate is no number.
    """
    for place in places_mm:
        if len(place) not in (2, 3) or not all(map(math.isfinite, place)):
            words = ", ".join(map(str, place))
            raise UsageError(f"place {words}: expected x,y or x,y,z")
    with open_source(path, ReadOptions(partial=True)) as source:
        nodes, at_mm, held = map(np.concatenate, zip(*source.places(), strict=True))
    z_mm = at_mm[:, 2]
    lowest, highest = float(z_mm.min()), float(z_mm.max())
    flat = highest - lowest <= 1e-9 * max(1.0, abs(lowest), abs(highest))
    if not flat and any(len(place) == 2 for place in places_mm):
        raise UsageError(
            f"{path}: nodes have z from {lowest:g} to {highest:g}: name a place as x,y,z"
        )
    found = []
    for place in places_mm:
        with np.errstate(over="ignore"):  # a place out of reach is at infinity
            away_mm = np.linalg.norm(at_mm[:, : len(place)] - np.array(place), axis=1)
        mesh = int(np.lexsort((nodes, away_mm))[0])
        row = int(np.lexsort((nodes, away_mm, ~held))[0])
        if not (held[row] and math.isfinite(away_mm[row])):
            raise ResultError("no node of the mesh has a place and results", path)
        found.append(
            NearNode(
                node=int(nodes[row]),
                place_mm=tuple(map(float, place)),
                at_mm=tuple(at_mm[row].tolist()),
                distance_mm=float(away_mm[row]),
                nearer=int(nodes[mesh]) if away_mm[mesh] < away_mm[row] else None,
            )
        )
    return found
