"""Which nodes to read: by number, by set of the deck, by place."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from fembridge.errors import ResultError


@dataclass(frozen=True, slots=True)
class NodeChoice:
    """Nodes by number, by name of a set, and by place, in that order.

    `deck` holds the sets; None takes those of the result file where it has sets, else
    the deck with its stem beside it. A place is x, y or x, y, z in mm.
    """

    nodes: Sequence[int] = ()
    sets: Sequence[str] = ()
    places_mm: Sequence[Sequence[float]] = ()
    deck: Path | None = None

    def __bool__(self) -> bool:
        return bool(len(self.nodes) or self.sets or len(self.places_mm))

    def resolve(self, path: Path, tell: Callable[[str], None] | None = None) -> list[int]:
        """Give the numbers, each once; `tell` hears what a set or place came to.

        Raises
        ------
        UsageError
            There is no deck, no such set, or a place is none.
        ResultError
            A set holds no nodes; the deck or the file cannot be read.
        """
        found = [int(node) for node in self.nodes]
        words = []
        if self.sets:
            from fembridge.results.node_sets import node_set

            for name in self.sets:
                nodes, place = node_set(path, name, self.deck)
                if not nodes:
                    raise ResultError(f"set {name} holds no nodes", place)
                found += nodes
                words.append(f"set {name} of {place.name}: {_listed(nodes)}")
        if len(self.places_mm):
            from fembridge.results.near_node import near_nodes

            near = near_nodes(path, self.places_mm)
            found += [one.node for one in near]
            words += map(str, near)
        if tell is not None:
            for line in words:
                tell(line)
        return list(dict.fromkeys(found))


def _listed(nodes: Sequence[int]) -> str:
    shown = ", ".join(map(str, nodes[:5]))
    count = f"{len(nodes)} node{'s' * (len(nodes) != 1)}"
    return f"{count}, {shown}{', ...' if len(nodes) > 5 else ''}"
