"""Sets of nodes by name: in the result file, or in a deck beside it.

A Marc post file holds its own; a ``.frd`` has none, and its deck is asked. The deck's
suffix says whose it is: ``.inp`` CalculiX's (or Abaqus's), ``.dat`` Marc's.
"""

from pathlib import Path

from fembridge.errors import DeckError, ResultError, UsageError
from fembridge.results.deck_sets import deck_beside, read_node_set

_POST = (".t16", ".t19")


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
    return read_node_set(deck, name), deck


def _set_of_post(path: Path, name: str) -> tuple[list[int], Path]:
    from fembridge.results.marc_format.post_file import PostFile

    with PostFile(path) as post:
        sets = [one for one in post.meshes[0].sets if one.kind == "node"]
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
    from decks.marc_grammar.mesh import read_sets
    from decks.marc_grammar.reader import read_marc_deck

    try:
        options = read_marc_deck(_bytes(deck), deck).find("define")
        sets = {
            one.name.strip().casefold(): one
            for one in read_sets(options).values()
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
    from decks.marc_grammar.reader import looks_like_marc

    try:
        return looks_like_marc(_bytes(deck))
    except DeckError:
        return False


def _bytes(deck: Path) -> bytes:
    try:
        return deck.read_bytes()
    except OSError as error:
        raise ResultError(f"cannot be read: {error.strerror}", deck) from error
