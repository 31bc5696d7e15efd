"""Where an own deck has a node, and in which part instance of Abaqus's.

A node's number counts in its part alone, and the part stands where its instance
puts it. A deck without parts has all its nodes in one place.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from decks.own_model.inp_blocks import Block, Blocks, place_of
from decks.own_model.inp_numbers import number, whole
from decks.own_model.inp_text import InpText, Row
from fembridge.errors import DeckError

_OPENING = ("PART", "INSTANCE")
_MAKERS = ("NCOPY", "NFILL", "NGEN", "NMAP")
_SAME = 1e-12


@dataclass(frozen=True, slots=True)
class Place:
    """A node at (`x`, `y`) in the deck's unit; `instance` is "" without instances."""

    node: int
    x: float
    y: float
    instance: str
    where: str


@dataclass(frozen=True, slots=True, eq=False)
class Scope:
    """Cards whose numbers count together: a part as an instance puts it, or all."""

    instance: str
    block: tuple[Block, ...]
    shift: tuple[float, float] = (0.0, 0.0)
    turned: str = ""


def scopes_of(blocks: Blocks) -> list[Scope]:
    """Give the scopes of a deck: one, or the assembly's own and one an instance.

    Raises
    ------
    DeckError
        An instance of a part that is not there, a part or instance without an end.
    """
    parts: dict[str, list[Block]] = {}
    scopes: list[Scope] = []
    outside: list[Block] = []
    inside: list[Block] = []
    opened: Block | None = None
    for block in blocks.block:
        if opened is not None and block.keyword in (*_OPENING, "ENDASSEMBLY", "STEP"):
            raise opened.error(f"this {opened.title} has no *END {opened.card.title}")
        if block.keyword in _OPENING:
            opened, inside = block, []
        elif opened is not None and block.keyword == f"END{opened.keyword}":
            if opened.keyword == "PART":
                parts[opened.word("NAME")] = inside
            else:
                scopes.append(_instance(opened, parts, inside))
            opened = None
        else:
            (outside if opened is None else inside).append(block)
    return [Scope("", tuple(outside)), *scopes]


def _instance(block: Block, parts: dict[str, list[Block]], own: list[Block]) -> Scope:
    part = block.word("PART")
    if part and part not in parts:
        raise block.error(f"*INSTANCE of part {part}, which stands nowhere before it")
    rows = list(block.placed_rows())
    shift = (0.0, 0.0)
    if rows:
        text, row = rows[0]
        words = (*row.words, "", "")
        shift = (
            number(words[0], text, row.line, blank=0.0),
            number(words[1], text, row.line, blank=0.0),
        )
    turned = place_of(rows[1][0], rows[1][1].line) if len(rows) > 1 else ""
    return Scope(_as_written(block, "NAME"), (*parts.get(part, ()), *own), shift, turned)


def _as_written(block: Block, name: str) -> str:
    """Give an option's value with its case and quotes, which Abaqus heeds together."""
    option = block.option(name)
    if option is None:
        raise block.error(f"{block.title} without {name}=")
    said = block.text.data[option.start : option.stop].partition(b"=")[2]
    return said.strip().decode("latin-1")


def find_nodes(blocks: Blocks, scopes: list[Scope], nodes: list[int]) -> list[Place]:
    """Find each of `nodes`, in that order.

    Raises
    ------
    DeckError
        One is nowhere, in several instances, or its place is not known.
    """
    found: dict[int, list[Place]] = {node: [] for node in nodes}
    for scope in scopes:
        for place in _nodes_in(scope, nodes):
            found[place.node].append(place)
    for node, places in found.items():
        if not places:
            made = blocks.of(*_MAKERS)
            hint = f"; {made[0].title}, {made[0].where}, is not followed" if made else ""
            raise DeckError(f"no *NODE of the deck defines node {node}{hint}{blocks.unread}")
        if len(places) > 1:
            listed = ", ".join(
                f"{place.instance or 'the assembly'} ({place.where})" for place in places
            )
            raise DeckError(
                f"node {node} is in several instances: {listed}; give one of them another number"
            )
    return [found[node][0] for node in nodes]


def _nodes_in(scope: Scope, nodes: list[int]) -> Iterator[Place]:
    """Give those of `nodes` that the scope defines, each once."""
    found: dict[int, Place] = {}
    for block in scope.block:
        if block.keyword != "NODE":
            continue
        for place in _defined(block, nodes):
            before = found.get(place.node)
            if before is not None and max(
                abs(before.x - place.x), abs(before.y - place.y)
            ) > _SAME * (abs(place.x) + abs(place.y)):
                raise DeckError(
                    f"{place.where}: node {place.node} again, elsewhere than at {before.where}"
                )
            found[place.node] = place
    system = [block for block in scope.block if block.keyword == "SYSTEM"]
    if found and system:
        raise system[0].error(
            "*SYSTEM moves the nodes after it, which is not followed; write the "
            "afferents' nodes in global coordinates"
        )
    if found and scope.turned:
        raise DeckError(
            f"{scope.turned}: instance {scope.instance} is turned, and where its nodes "
            "come to lie is not worked out; turn the part"
        )
    for place in found.values():
        x, y = place.x + scope.shift[0], place.y + scope.shift[1]
        yield Place(place.node, x, y, scope.instance, place.where)


def _defined(block: Block, nodes: list[int]) -> Iterator[Place]:
    numbers = "|".join(map(str, nodes)).encode()
    wanted = re.compile(rb"^[ \t]*0*(?:" + numbers + rb")[ \t]*[,\r\n]", re.MULTILINE)
    for piece in block.pieces:
        data = piece.text.data
        for match in wanted.finditer(data, piece.start, piece.stop):
            line = piece.line + data.count(b"\n", piece.start, match.start())
            end = data.find(b"\n", match.start(), piece.stop) + 1 or piece.stop
            (row,) = piece.text.rows(match.start(), end, line)
            system = block.word("SYSTEM")
            if system not in ("", "R"):
                raise block.error(
                    f"*NODE, SYSTEM={system}: node {row.words[0]} is not in rectangular coordinates"
                )
            yield _place(piece.text, row)


def _place(text: InpText, row: Row) -> Place:
    words = (*row.words, "", "")
    x, y = (number(word, text, row.line, blank=0.0) for word in words[1:3])
    return Place(whole(row.words[0], text, row.line), x, y, "", place_of(text, row.line))
