"""What an own keyword deck asks its solver to write: displacement and stress.

    *NSET, NSET=AFFERENT_SA
    118,
    *NSET, NSET=FEMBRIDGE_OUTPUT
    118, 140, 163,

The requests of the waveform's step become one of every increment, on the afferents'
nodes or on all; in a deck for ccx, those of the step before it become one of its last
increment. A set of that name that the deck has already must hold the same, since
solvers add to a set that is defined again.

In Abaqus a node's number counts in its part alone, the part stands where its instance
puts it, and a set of the assembly names its instance. A deck without parts has all its
nodes in one scope.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from decks.inp import Block, Deck, Edit, Piece, Row, inserted, members, squeezed, without
from decks.keyword_deck import list_lines
from decks.own_model.inp_drive import MOVABLE, Drive, Step
from fembridge.errors import DeckError

OUTPUT_SET = "FEMBRIDGE_OUTPUT"
_SET_NAME = re.compile(r"[A-Za-z0-9_-]+")
_OPENING = ("PART", "INSTANCE")
_NODE_MAKERS = ("NCOPY", "NFILL", "NGEN", "NMAP")
_SAME = 1e-12
# What ccx takes for requests of results at nodes.
_CALCULIX_REQUESTS = ("NODEFILE", "ELFILE", "NODEOUTPUT", "ELEMENTOUTPUT")
# More increments than any step has: what is written is its last one.
_AT_END = 100000
# What belongs to Abaqus's *OUTPUT before it.
_ABAQUS_PARTS = (
    "CONTACTOUTPUT",
    "ELEMENTOUTPUT",
    "ENERGYOUTPUT",
    "INCREMENTATIONOUTPUT",
    "INTEGRATEDOUTPUT",
    "MODALOUTPUT",
    "NODEOUTPUT",
    "RADIATIONOUTPUT",
    "SURFACEOUTPUT",
)

Change = tuple[list[Edit], list[str]]
# Numbers by instance; "" where there are none.
Members = Mapping[str, list[int]]


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
    """Blocks whose numbers count together: a part as an instance puts it, or all."""

    instance: str
    blocks: tuple[Block, ...]
    shift: tuple[float, float] = (0.0, 0.0)
    turned: str = ""


def output_edits(
    deck: Deck,
    drive: Drive,
    scopes: list[Scope],
    places: Mapping[str, Place],
    *,
    abaqus: bool,
    binary: bool,
) -> Change:
    """The request that `places` need, or all nodes, with remarks on it.

    Raises
    ------
    DeckError
        A request cannot be taken out, a set cannot be added, or what stays in the
        step does not go with fixed increments or with a set of nodes.
    """
    on_set = bool(places)
    what = f"the nodes of {', '.join(places)}" if places else "all nodes"
    edits, remarks = _sets(deck, drive, scopes, places, abaqus) if places else ([], [])
    for step in [drive.step] if abaqus else _steps_to_write(drive):
        if abaqus:
            gone, request = _abaqus_requests(step), _abaqus_request(on_set)
        else:
            gone = step.of(*_CALCULIX_REQUESTS)
            request = _calculix_request(drive, step, on_set=on_set, binary=binary)
        when = "every increment" if step is drive.step else "its last increment"
        for block in (*gone, step.end):
            if not block.own:
                raise block.error(
                    f"{block.title} of {step.name} is in an included file, and its output "
                    "has to be changed; put it into the deck"
                )
        edits += [edit for block in gone for edit in without(block)]
        edits.append(inserted(step.end.text, step.end.start, request))
        removed = ", ".join(f"{block.title} ({block.where})" for block in gone)
        instead = f", in place of {removed}" if removed else ""
        remarks.append(f"{step.end.where}: U and S at {what}, {when}{instead}")
    return edits, remarks


# ---- CalculiX: the last request decides how often and whether binary, for all of them, so
# ours come last in their step. ccx writes nothing when a step begins: what a trace has at
# the waveform's start is the last increment of the step before.


def _calculix_request(drive: Drive, step: Step, *, on_set: bool, binary: bool) -> list[str]:
    """Request of U and S in `step`: every increment or, before the waveform's, its last."""
    stay = [block for block in step.blocks if block.keyword not in _CALCULIX_REQUESTS]
    timed = [block for block in stay if block.option("TIMEPOINTS") is not None]
    often = ", FREQUENCY=1"
    if step is not drive.step:  # points in time come before a number of increments
        often = "" if timed else f", FREQUENCY={_AT_END}"
    elif timed:
        raise timed[0].error(
            f"{timed[0].title}, TIME POINTS: ccx refuses it with fixed increments; take it out"
        )
    kind, double = ("OUTPUT", ", DOUBLE") if binary else ("FILE", "")
    nodes = f", NSET={OUTPUT_SET}" if on_set else ""
    flat = _flat(drive, step) if on_set else ""
    options = f"{nodes}{often}{flat}{double}"
    element = "ELEMENT" if binary else "EL"
    return [f"*NODE {kind}{options}", "U", f"*{element} {kind}{options}", "S"]


def _steps_to_write(drive: Drive) -> list[Step]:
    """The waveform's step and, where it has one before it in time, that one."""
    before = drive.steps[: drive.step.number - 1][-1:]
    return [*(step for step in before if step.of(*MOVABLE)), drive.step]


def _flat(drive: Drive, step: Step) -> str:
    """``OUTPUT=2D`` where something asks for 3D, which has no sets of nodes.

    Expanded nodes have numbers of their own, and results on a set of the deck's nodes
    are then empty. ccx 2.20 takes the word in the first step alone.
    """
    written = _steps_to_write(drive)
    for one in drive.steps[: drive.step.number]:
        for block in one.blocks:
            gone = one in written and block.keyword in _CALCULIX_REQUESTS
            if gone or block.word("OUTPUT") != "3D":
                continue
            if one.number > 1 or one not in written:
                raise block.error(
                    f"{block.title}, OUTPUT=3D: ccx then writes nothing for a set of "
                    "the deck's nodes; take it out"
                )
            return ", OUTPUT=2D" if step is one else ""
    return ""


# ---- Abaqus writes the state at the start of each step by itself. Positions ``NODES`` are
# values of each element by itself, so that nothing is averaged over layers.


def _abaqus_request(on_set: bool) -> list[str]:
    nodes, elements = "", ""
    if on_set:
        nodes, elements = f", NSET={OUTPUT_SET}", f", ELSET={OUTPUT_SET}"
    return [
        "*OUTPUT, FIELD, FREQUENCY=1",
        f"*NODE OUTPUT{nodes}",
        "U,",
        f"*ELEMENT OUTPUT{elements}, POSITION=NODES",
        "S,",
    ]


def _abaqus_requests(step: Step) -> list[Block]:
    """The field requests of nodes and elements, with an ``*OUTPUT`` left empty.

    History requests, contact and energy stay, and so do ``.fil`` and printed tables.
    """
    groups: list[list[Block]] = []
    for block in step.blocks:
        if block.keyword == "OUTPUT":
            groups.append([block])
        elif groups and block.keyword in _ABAQUS_PARTS:
            groups[-1].append(block)
    gone: list[Block] = []
    for group in groups:
        if group[0].option("FIELD") is not None:
            parts = [one for one in group if one.keyword in ("NODEOUTPUT", "ELEMENTOUTPUT")]
            gone += group if len(parts) == len(group) - 1 else parts
    return gone


# ---- Sets: one an afferent, one for all


def afferent_set(name: str) -> str:
    """Name of the node set of an afferent.

    Raises
    ------
    DeckError
        The afferent's name cannot be part of one.
    """
    if not _SET_NAME.fullmatch(name):
        raise DeckError(
            f"afferent {name!r}: its name becomes that of a set, and may have letters, "
            "digits, - and _"
        )
    return f"AFFERENT_{name.upper()}"


def _sets(
    deck: Deck, drive: Drive, scopes: list[Scope], places: Mapping[str, Place], abaqus: bool
) -> Change:
    """Those sets that the deck has not yet, before its first step."""
    outside = scopes[0].blocks
    if len({afferent_set(name) for name in places}) < len(places):
        raise DeckError(f"afferents {', '.join(places)}: two names of one set")
    lines: list[str] = []
    together: dict[str, list[int]] = {}
    for name, place in places.items():
        lines += _set_lines("NSET", afferent_set(name), {place.instance: [place.node]}, outside)
        numbers = together.setdefault(place.instance, [])
        if place.node not in numbers:
            numbers.append(place.node)
    lines += _set_lines("NSET", OUTPUT_SET, together, outside)
    if abaqus:
        around = _elements_around(scopes, places.values())
        lines += _set_lines("ELSET", OUTPUT_SET, around, outside)
    if not lines:
        return [], []
    before = _set_place(deck, drive, in_assembly=any(one.instance for one in places.values()))
    line = before.text.data.count(b"\n", 0, before.start) + 1
    # A node set and an element set may share a name.
    names = dict.fromkeys(each.split("=")[1].split(",")[0] for each in lines if "=" in each)
    remark = f"line {line}: before it, sets {', '.join(names)}"
    return [inserted(before.text, before.start, lines)], [remark]


def _set_lines(
    keyword: str, name: str, wanted: Members, outside: tuple[Block, ...]
) -> Iterator[str]:
    """Lines of a set, none where the deck has it as it should be."""
    makers = (keyword, "NODE", "ELEMENT")
    there = [one for one in outside if one.word(keyword) == name and one.keyword in makers]
    if not there:
        for instance, numbers in wanted.items():
            of = f", INSTANCE={instance}" if instance else ""
            yield f"*{keyword}, {keyword}={name}{of}"
            yield from list_lines(numbers)
    elif not _holds(there, wanted):
        raise there[0].error(
            f"set {name} is there already and holds something else than the output "
            "asked for; rename or remove it"
        )


def _holds(blocks: list[Block], wanted: Members) -> bool:
    """Whether a set holds just that; not where that takes more than reading."""
    expected = {(squeezed(name), number) for name, some in wanted.items() for number in some}
    found: set[tuple[str, int]] = set()
    try:
        for block in blocks:
            for run in members(block, {}):
                if len(run) > len(expected):
                    return False
                found.update((block.word("INSTANCE"), number) for number in run)
    except DeckError:
        return False
    return found == expected


def _set_place(deck: Deck, drive: Drive, *, in_assembly: bool) -> Block:
    """The block before which sets go: the first step or, in an assembly, its end."""
    before = drive.steps[0].head
    if in_assembly:
        ends = deck.of("ENDASSEMBLY")
        if len(ends) != 1:
            raise DeckError(f"{len(ends)} *END ASSEMBLY in the deck, expected one")
        (before,) = ends
    if not before.own:
        raise before.error(
            f"{before.title} is in an included file, and sets have to be put before "
            "it; put it into the deck itself"
        )
    return before


def _elements_around(scopes: list[Scope], places: Iterable[Place]) -> Members:
    """Numbers of the elements at `places`, by instance and in deck order."""
    nodes: dict[str, dict[int, Place]] = {}
    for place in places:
        nodes.setdefault(place.instance, {})[place.node] = place
    found: dict[str, list[int]] = {}
    for scope in scopes:
        wanted = nodes.get(scope.instance)
        if not wanted:
            continue
        reached: set[int] = set()
        for block in scope.blocks:
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
    """Number and nodes of each element; a line ending in a comma goes on."""
    words: list[str] = []
    for row in (*block.rows(), None):
        if row is not None:
            words += row.words
            if not words[-1]:
                words.pop()
                continue
        # In an assembly a node may be named with its instance; such an element is no skin.
        if words and all(word.isascii() and word.isdigit() for word in words):
            yield int(words[0]), set(map(int, words[1:]))
        words = []


# ---- Nodes


def scopes_of(deck: Deck) -> list[Scope]:
    """The scopes of a deck: one, or the assembly's own and one an instance.

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
    for block in deck.blocks:
        if opened is not None and block.keyword in (*_OPENING, "ENDASSEMBLY", "STEP"):
            raise opened.error(f"this {opened.title} has no *END {opened.title[1:]}")
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
        raise block.error(f"*INSTANCE of part {part}, which is nowhere before it")
    option = block.option("NAME")
    if option is None:
        raise block.error(f"{block.title} without NAME=")
    # With its case and quotes, which Abaqus heeds together.
    said = block.text.data[option.start : option.stop].partition(b"=")[2]
    name = said.strip().decode("latin-1")
    rows = list(block.rows())
    shift = (rows[0].number(0, blank=0.0), rows[0].number(1, blank=0.0)) if rows else (0.0, 0.0)
    turned = rows[1].where if len(rows) > 1 else ""
    return Scope(name, (*parts.get(part, ()), *own), shift, turned)


def find_nodes(deck: Deck, scopes: list[Scope], nodes: list[int]) -> list[Place]:
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
            made = deck.of(*_NODE_MAKERS)
            hint = f"; {made[0].title}, {made[0].where}, is not followed" if made else ""
            raise DeckError(f"no *NODE of the deck defines node {node}{hint}{deck.unread}")
        if len(places) > 1:
            listed = ", ".join(
                f"{place.instance or 'the assembly'} ({place.where})" for place in places
            )
            raise DeckError(
                f"node {node} is in several instances: {listed}; give one of them another number"
            )
    return [found[node][0] for node in nodes]


def _nodes_in(scope: Scope, nodes: list[int]) -> Iterator[Place]:
    """Those of `nodes` that the scope defines, each once."""
    found: dict[int, Place] = {}
    for block in scope.blocks:
        if block.keyword != "NODE":
            continue
        for row in _rows_of(block, nodes):
            if block.word("SYSTEM") not in ("", "R"):
                raise block.error(
                    f"*NODE, SYSTEM={block.word('SYSTEM')}: node {row.words[0]} is not in "
                    "rectangular coordinates"
                )
            node, x, y = row.whole(0), row.number(1, blank=0.0), row.number(2, blank=0.0)
            before = found.get(node)
            if before is not None and max(abs(before.x - x), abs(before.y - y)) > _SAME * (
                abs(x) + abs(y)
            ):
                raise DeckError(f"{row.where}: node {node} again, elsewhere than at {before.where}")
            found[node] = Place(node, x, y, scope.instance, row.where)
    system = [block for block in scope.blocks if block.keyword == "SYSTEM"]
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


def _rows_of(block: Block, nodes: list[int]) -> Iterator[Row]:
    """Data lines that begin with one of `nodes`: found by a search of the bytes."""
    numbers = "|".join(map(str, nodes)).encode()
    wanted = re.compile(rb"^[ \t]*0*(?:" + numbers + rb")[ \t]*[,\r\n]", re.MULTILINE)
    for piece in block.pieces:
        data = piece.text.data
        for match in wanted.finditer(data, piece.start, piece.stop):
            line = piece.line + data.count(b"\n", piece.start, match.start())
            end = data.find(b"\n", match.start(), piece.stop) + 1 or piece.stop
            yield from Piece(piece.text, match.start(), end, line).rows()
