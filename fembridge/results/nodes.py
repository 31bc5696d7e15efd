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
from fembridge.results.read_options import ReadOptions
from fembridge.results.source import open_source
from fembridge.store import MAX_DECK_BYTES, read_bytes

_POST = (".t16", ".t19")
_MOST_NODES = 2_000_000


def choose_nodes(
    path: Path,
    nodes: Sequence[int] = (),
    sets: Sequence[str] = (),
    near_mm: Sequence[Sequence[float]] = (),
    deck: Path | None = None,
    options: ReadOptions = ReadOptions(),  # noqa: B008 - frozen
) -> list[int]:
    """Numbers of nodes, of the `sets` and near the places `near_mm`, each once.

    Parameters
    ----------
    path
        The result file.
    deck
        Holds the sets; None takes those of the result file where it has sets, else the
        deck with its stem beside it.
    options
        Its unit of length, and who gets what a set or place came to.
    """
    found, words = [int(node) for node in nodes], []
    for name in sets:
        members, place = node_set(path, name, deck)
        found += members
        shown = ", ".join(map(str, members[:5])) + (", ..." if len(members) > 5 else "")
        count = f"{len(members)} node{'s' * (len(members) != 1)}"
        words.append(f"set {name} of {place.name}: {count}, {shown}")
    for node, said in near_nodes(path, near_mm, options) if len(near_mm) else ():
        found.append(node)
        words.append(said)
    for line in words:
        options.note(line)
    return list(dict.fromkeys(found))


def node_set(path: Path, name: str, deck: Path | None) -> tuple[list[int], Path]:
    """Nodes of the set `name`, case-blind and without blanks, and the file that has it.

    `deck` None looks into the result file `path` where it has sets, and into the deck
    with its stem.
    """
    missing = []
    for file in _files_with_sets(path) if deck is None else [deck]:
        sets = _sets_of(file)
        for one, pieces in sets.items():
            if "".join(one.split()).casefold() == "".join(name.split()).casefold():
                if not 0 < (count := sum(map(len, pieces))) <= _MOST_NODES:
                    words = f"set {name} has {count} nodes, expected 1 to {_MOST_NODES}"
                    raise ResultError(words, file)
                return list(dict.fromkeys(int(node) for piece in pieces for node in piece)), file
        missing.append(f"{file}: no node set {name!r}; it has {', '.join(sets) or 'none'}")
    raise UsageError("; ".join(missing))


def sets_beside(path: Path) -> dict[str, int]:
    """How many nodes each set has of the deck beside a result file; none without a deck."""
    try:
        sets = read_node_sets(path.with_suffix(".inp"))
    except ResultError:
        return {}
    return {name: sum(map(len, pieces)) for name, pieces in sets.items()}


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


def _files_with_sets(result: Path) -> Iterator[Path]:
    """`result` itself where its format has sets, and the deck with its stem."""
    if result.suffix.lower() in _POST:
        from decks.marc.grammar import is_marc_deck

        yield result
        if is_marc_deck(result.with_suffix(".dat")):
            yield result.with_suffix(".dat")
        return
    deck = result.with_suffix(".inp")
    if not deck.is_file():
        raise UsageError(f"{result}: no deck {deck.name} beside it; name one: --deck")
    yield deck


def _sets_of(file: Path) -> Mapping[str, Sequence[Sequence[int]]]:
    """The node sets of a deck or post file by name, in pieces."""
    if file.suffix.lower() in _POST:
        from fembridge.results.marc_post import PostFile

        with PostFile(file) as post:
            sets = post.mesh.sets
        return {one.name.strip(): [one.members.tolist()] for one in sets if one.kind == "node"}
    if file.suffix.lower() != ".dat":
        return read_node_sets(file)
    from decks.marc.contents import read_marc_deck

    try:
        held = read_marc_deck(_bytes(file)).sets().values()
    except DeckError as error:
        raise ResultError(f"sets cannot be read: {error}", file) from error
    nodal = [one for one in held if one.kind.startswith("node")]
    return {one.name.strip(): [one.member.tolist()] for one in nodal}


def _bytes(deck: Path) -> bytes:
    def failed(words: str) -> ResultError:
        return ResultError(words.removeprefix(f"{deck}: "), deck)

    return read_bytes(deck, MAX_DECK_BYTES, failed)


def near_nodes(
    path: Path,
    places_mm: Sequence[Sequence[float]],
    options: ReadOptions = ReadOptions(),  # noqa: B008 - frozen
) -> list[tuple[int, str]]:
    """The node nearest to each place that has a stress, of equals the lowest; and its words.

    A place is x, y or x, y, z. Without z the mesh has to be in one plane of z. The words
    say where the node is, how far away, and which is nearer and has no results, because
    the output was restricted to a set.
    """
    for place in places_mm:
        if len(place) not in (2, 3) or not all(map(math.isfinite, place)):
            raise UsageError(f"place {', '.join(map(str, place))}: expected x,y or x,y,z")
    lenient = ReadOptions(partial=True, length_unit=options.length_unit, columns=options.columns)
    with open_source(path, lenient) as source:
        nodes, at_mm, held = map(np.concatenate, zip(*source.places(), strict=True))
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
