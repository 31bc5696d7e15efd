"""Sets of nodes by name: in the result file, or in a deck beside it.

A Marc post file holds its own; a ``.frd`` has none, and its deck is asked. The deck's
suffix says whose it is: ``.inp`` CalculiX's (or Abaqus's), ``.dat`` Marc's.
"""

from pathlib import Path

from fembridge.errors import DeckError, ResultError, UsageError

_POST = (".t16", ".t19")
_MOST_NODES = 2_000_000
_MOST_BYTES = 1 << 29  # of a deck, which is read at once


def node_set(path: Path, name: str, deck: Path | None) -> tuple[list[int], Path]:
    """Give the nodes of the set `name`, case-blind, and the file they stand in.

    Parameters
    ----------
    path
        The result file.
    deck
        Where to look; None looks into `path` where it has sets, else into the deck
        with its stem.

    Raises
    ------
    UsageError
        There is no such set, or no deck; the message names the sets there are.
    ResultError
        A file cannot be read.
    """
    post = path.suffix.lower() in _POST
    if deck is None and not post:
        deck = deck_beside(path)
    if deck is None:
        return _set_of_post(path, name)
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
    from fembridge.results.marc_post import PostFile

    with PostFile(path) as post:
        sets = [one for one in post.mesh(0).sets if one.kind == "node"]
    held = {one.name.strip().casefold(): one for one in sets}
    found = held.get(name.strip().casefold())
    if found is not None:
        return list(dict.fromkeys(found.members.tolist())), path
    beside = path.with_suffix(".dat")
    words = ", ".join(one.name.strip() for one in sets) or "none"
    if beside.is_file() and _is_marc(beside):
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


def _is_marc(deck: Path) -> bool:
    from decks.marc.grammar import looks_like_marc

    try:
        return looks_like_marc(_bytes(deck))
    except DeckError:
        return False


def _bytes(deck: Path) -> bytes:
    try:
        if (size := deck.stat().st_size) > _MOST_BYTES:
            raise ResultError(f"{size} bytes, expected a deck of at most {_MOST_BYTES}", deck)
        return deck.read_bytes()
    except OSError as error:
        raise ResultError(f"cannot be read: {error.strerror}", deck) from error
