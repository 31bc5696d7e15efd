"""Elements of an own deck around nodes: where an afferent's stress is worked out."""

from collections.abc import Iterable, Iterator, Mapping

from decks.own_model.inp_blocks import Block
from decks.own_model.inp_nodes import Place, Scope
from fembridge.errors import DeckError


def elements_around(scopes: list[Scope], places: Iterable[Place]) -> Mapping[str, list[int]]:
    """Give the numbers of the elements at `places`, by instance and in deck order.

    Raises
    ------
    DeckError
        A node belongs to no element that the deck lists.
    """
    nodes: dict[str, dict[int, Place]] = {}
    for place in places:
        nodes.setdefault(place.instance, {})[place.node] = place
    found: dict[str, list[int]] = {}
    for scope in scopes:
        wanted = nodes.get(scope.instance)
        if not wanted:
            continue
        reached: set[int] = set()
        for block in scope.block:
            if block.keyword == "ELEMENT":
                for number, corners in _elements(block):
                    if here := wanted.keys() & corners:
                        found.setdefault(scope.instance, []).append(number)
                        reached |= here
        for node in wanted.keys() - reached:
            raise DeckError(
                f"{wanted[node].where}: no *ELEMENT of the deck has node {node}, so it "
                "has no stress"
            )
    return found


def _elements(block: Block) -> Iterator[tuple[int, set[int]]]:
    """Give number and nodes of each element; a line ending in a comma goes on."""
    held: list[str] = []
    for _, row in block.placed_rows():
        held += row.words
        if held[-1]:
            yield from _one(held)
            held = []
        else:
            held.pop()
    yield from _one(held)


def _one(words: list[str]) -> Iterator[tuple[int, set[int]]]:
    # In an assembly a node may be named with its instance; such an element is no skin.
    if words and all(word.isascii() and word.isdigit() for word in words):
        yield int(words[0]), set(map(int, words[1:]))
