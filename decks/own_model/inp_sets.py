"""The sets that an own deck needs for its output: one a afferent, one for all.

    *NSET, NSET=AFFERENT_SA
    118,
    *NSET, NSET=FEMBRIDGE_OUTPUT
    118, 140, 163,

A set of that name that the deck has already must hold the same, since solvers add
to a set that is defined again. In an assembly of Abaqus's a set names its instance.
"""

import re
from collections.abc import Mapping

from decks.inp.lines import list_lines
from decks.own_model.inp_blocks import Block, Blocks
from decks.own_model.inp_nodes import Place
from decks.own_model.inp_text import InpText, squeezed
from fembridge.errors import DeckError

OUTPUT_SET = "FEMBRIDGE_OUTPUT"
_NAME = re.compile(r"[A-Za-z0-9_-]+")

# Numbers by instance; "" where there are none.
Members = Mapping[str, list[int]]


def afferent_set(name: str) -> str:
    """Name the node set of an afferent.

    Raises
    ------
    DeckError
        The afferent's name cannot be part of one.
    """
    if not _NAME.fullmatch(name):
        raise DeckError(
            f"afferent {name!r}: its name becomes that of a set, and may have letters, "
            "digits, - and _"
        )
    return f"AFFERENT_{name.upper()}"


def node_set_lines(outside: tuple[Block, ...], places: Mapping[str, Place]) -> list[str]:
    """Give the cards of those sets that are not there yet.

    `outside` are the cards beyond all parts and instances, `places` the node of
    each afferent.

    Raises
    ------
    DeckError
        A set of that name holds something else.
    """
    lines: list[str] = []
    if len({afferent_set(name) for name in places}) < len(places):
        raise DeckError(f"afferents {', '.join(places)}: two names of one set")
    for name, place in places.items():
        one = {place.instance: [place.node]}
        lines += set_lines("NSET", afferent_set(name), one, outside)
    return lines + set_lines("NSET", OUTPUT_SET, _by_instance(places), outside)


def set_lines(keyword: str, name: str, members: Members, outside: tuple[Block, ...]) -> list[str]:
    """Give the cards of a set, none where the deck has it as it should be."""
    there = [block for block in outside if block.word(keyword) == name]
    there = [block for block in there if block.keyword != "ELEMENTOUTPUT"]
    there = [b for b in there if b.keyword in (keyword, "NODE", "ELEMENT")]
    if there:
        wanted = {
            (squeezed(instance), number) for instance, some in members.items() for number in some
        }
        if _held(keyword, there) != wanted:
            raise there[0].error(
                f"set {name} is there already and holds something else than the output "
                "asked for; rename or remove it"
            )
        return []
    lines = []
    for instance, numbers in members.items():
        of = f", INSTANCE={instance}" if instance else ""
        lines += [f"*{keyword}, {keyword}={name}{of}", *list_lines(numbers)]
    return lines


def set_place(blocks: Blocks, step: Block, in_assembly: bool) -> tuple[InpText, int]:
    """Give the byte before which sets are to stand: that of the first step's card.

    In an assembly it is that of its end. Raises a `DeckError` where that is in an
    included file.
    """
    before = step
    if in_assembly:
        ends = blocks.of("ENDASSEMBLY")
        if len(ends) != 1:
            raise DeckError(f"{len(ends)} *END ASSEMBLY in the deck, expected one")
        (before,) = ends
    if not before.own:
        raise before.error(
            f"{before.title} is in an included file, and sets have to be put before "
            "it; put it into the deck itself"
        )
    return before.text, before.card.start


def _by_instance(places: Mapping[str, Place]) -> Members:
    found: dict[str, list[int]] = {}
    for place in places.values():
        numbers = found.setdefault(place.instance, [])
        if place.node not in numbers:
            numbers.append(place.node)
    return found


def _held(keyword: str, blocks: list[Block]) -> set[tuple[str, int]] | None:
    """Give what a set holds, by instance; None where that takes more than reading."""
    held: set[tuple[str, int]] = set()
    for block in blocks:
        instance = block.word("INSTANCE")
        for _, row in block.placed_rows():
            words = row.words[:1] if block.keyword != keyword else row.words
            words = tuple(word for word in words if word)
            if not all(word.isascii() and word.isdigit() for word in words):
                return None
            numbers = list(map(int, words))
            if block.option("GENERATE") is not None:
                first, last, step = (*numbers, 1)[:3]
                numbers = list(range(first, last + 1, step or 1))
            held.update((instance, number) for number in numbers)
    return held
