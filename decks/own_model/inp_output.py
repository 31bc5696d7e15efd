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
nodes in one scope. What is missing, ambiguous or not to be kept is a DeckError with its line.
"""

import math
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass

from decks.inp import Block, Deck, Edit, Piece, Row, inserted, members, squeezed, without
from decks.keyword_deck import list_lines
from decks.own_model import Request
from decks.own_model.inp_drive import MOVABLE, Drive, Step
from fembridge.errors import DeckError

OUTPUT_SET = "FEMBRIDGE_OUTPUT"
# Of automatic increments: the samples, at which results are written.
TIMES = "FEMBRIDGE_TIMES"
_SET_NAME = re.compile(r"[A-Za-z0-9_-]+")
_OPENING = ("PART", "INSTANCE")
_NODE_MAKERS = ("NCOPY", "NFILL", "NGEN", "NMAP")
# Elements of a solid model, where z counts.
_SOLID = ("C3D", "M3D", "SC", "S3", "S4", "S6", "S8")
_SAMPLED = 20_000  # nodes that show how big a model is
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
    """A node `at` (x, y), in a solid model (x, y, z), in the deck's unit.

    `instance` is "" without instances.
    """

    node: int
    at: tuple[float, ...]
    instance: str
    where: str


@dataclass(frozen=True, slots=True, eq=False)
class Scope:
    """Blocks whose numbers count together: a part as an instance puts it, or all."""

    instance: str
    blocks: tuple[Block, ...]
    shift: tuple[float, ...] = (0.0, 0.0, 0.0)
    rotated: str = ""


def output_edits(
    deck: Deck,
    drive: Drive,
    scopes: list[Scope],
    places: Mapping[str, Place],
    request: Request,
    *,
    abaqus: bool,
    binary: bool,
) -> Change:
    """What is to be written at `places`, or at all nodes, with remarks on it."""
    on_set = bool(places) and not request.all_nodes
    automatic = request.increments == "automatic"
    what = f"the nodes of {', '.join(places)}" if on_set else "all nodes"
    edits, remarks = _sets(deck, drive, scopes, places, abaqus) if places else ([], [])
    for step in [drive.step] if abaqus else _steps_to_write(drive):
        if abaqus:
            gone, lines = _abaqus_requests(step), _abaqus_request(on_set, automatic)
        else:
            gone = step.of(*_CALCULIX_REQUESTS)
            lines = _calculix_request(drive, step, on_set, binary, automatic)
        every = "every time point" if automatic else "every increment"
        when = every if step is drive.step else "its last increment"
        edits += [edit for block in gone for edit in without(block)]
        edits.append(inserted(step.end.text, step.end.start, lines))
        removed = ", ".join(f"{block.title} ({block.where})" for block in gone)
        instead = f", in place of {removed}" if removed else ""
        remarks.append(f"{step.end.where}: U and S at {what}, {when}{instead}")
    return edits, remarks


# ---- CalculiX: the last request decides how often and whether binary, for all of them, so
# ours come last in their step. ccx writes nothing when a step begins: what a trace has at
# the waveform's start is the last increment of the step before.


def _calculix_request(
    drive: Drive, step: Step, on_set: bool, binary: bool, automatic: bool
) -> list[str]:
    """Request of U and S in `step`: every sample or, before the waveform's, its last."""
    stay = [block for block in step.blocks if block.keyword not in _CALCULIX_REQUESTS]
    timed = [block for block in stay if block.option("TIMEPOINTS") is not None]
    often = ", FREQUENCY=1"
    if step is not drive.step:  # points in time come before a number of increments
        often = "" if timed else f", FREQUENCY={_AT_END}"
    elif automatic:
        often = f", TIME POINTS={TIMES}"
    elif timed:
        raise timed[0].error(
            f"{timed[0].title}, TIME POINTS: ccx refuses it with fixed increments; take it "
            "out, or let increments be automatic"
        )
    nodes = f", NSET={OUTPUT_SET}{often}{_flat(drive, step)}" if on_set else often
    if binary:
        return [f"*NODE OUTPUT{nodes}, DOUBLE", "U", f"*ELEMENT OUTPUT{nodes}, DOUBLE", "S"]
    return [f"*NODE FILE{nodes}", "U", f"*EL FILE{nodes}", "S"]


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


def _abaqus_request(on_set: bool, automatic: bool) -> list[str]:
    often = f"TIME POINTS={TIMES}" if automatic else "FREQUENCY=1"
    nodes, elements = (f", {kind}={OUTPUT_SET}" if on_set else "" for kind in ("NSET", "ELSET"))
    return [
        f"*OUTPUT, FIELD, {often}",
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
    for head, *others in groups:
        parts = [one for one in others if one.keyword in ("NODEOUTPUT", "ELEMENTOUTPUT")]
        if head.option("FIELD") is not None:
            gone += [head, *others] if len(parts) == len(others) else parts
    return gone


# ---- Sets: one an afferent, one for all


def _sets(
    deck: Deck, drive: Drive, scopes: list[Scope], places: Mapping[str, Place], abaqus: bool
) -> Change:
    """Those sets that the deck has not yet, before its first step or the assembly's end."""
    wanted: dict[tuple[str, str], Members] = {}
    together: dict[str, dict[int, Place]] = {}
    for name, place in places.items():
        key = "NSET", f"AFFERENT_{name.upper()}"
        if not _SET_NAME.fullmatch(name) or key in wanted:
            raise DeckError(
                f"afferent {name!r}: its name becomes that of a set, and may have letters, "
                "digits, - and _, and be there once"
            )
        wanted[key] = {place.instance: [place.node]}
        together.setdefault(place.instance, {})[place.node] = place
    wanted["NSET", OUTPUT_SET] = {instance: list(some) for instance, some in together.items()}
    if abaqus:
        wanted["ELSET", OUTPUT_SET] = _elements_around(scopes, together)
    lines = []
    for (keyword, name), numbers in wanted.items():
        makers = (keyword, "NODE", "ELEMENT")
        outside = [one for one in scopes[0].blocks if one.keyword in makers]
        there = [one for one in outside if one.word(keyword) == name]
        if there and not _holds(there, numbers):
            raise there[0].error(
                f"set {name} is there already and holds something else than the output "
                "asked for; rename or remove it"
            )
        for instance, some in () if there else numbers.items():
            of = f", INSTANCE={instance}" if instance else ""
            lines += [f"*{keyword}, {keyword}={name}{of}", *list_lines(some).splitlines()]
    if not lines:
        return [], []
    ends = deck.of("ENDASSEMBLY") if any(together) else [drive.steps[0].head]
    if len(ends) != 1:
        raise DeckError(f"{len(ends)} *END ASSEMBLY, expected one to put sets before")
    text, start = ends[0].text, ends[0].start
    # A node set and an element set may share a name.
    names = dict.fromkeys(each.split("=")[1].split(",")[0] for each in lines if "=" in each)
    line = text.data.count(b"\n", 0, start) + 1
    return [inserted(text, start, lines)], [f"line {line}: before it, sets {', '.join(names)}"]


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


def _elements_around(scopes: list[Scope], nodes: Mapping[str, Mapping[int, Place]]) -> Members:
    """Numbers of the elements at `nodes`, by instance and in deck order."""
    found: dict[str, list[int]] = {}
    for scope in scopes:
        wanted = nodes.get(scope.instance, {})
        reached: set[int] = set()
        for block in scope.blocks if wanted else ():
            for number, corners in _elements(block) if block.keyword == "ELEMENT" else ():
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
    """The scopes of a deck: one, or the assembly's own and one an instance."""
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
    shift = tuple(rows[0].number(one, blank=0.0) for one in range(3)) if rows else (0.0,) * 3
    rotated = rows[1].where if len(rows) > 1 else ""
    return Scope(name, (*parts.get(part, ()), *own), shift, rotated)


def find_nodes(deck: Deck, scopes: list[Scope], nodes: list[int]) -> list[Place]:
    """Find each of `nodes`, in that order."""
    found: dict[int, list[Place]] = {node: [] for node in nodes}
    solid = any(block.word("TYPE").startswith(_SOLID) for block in deck.of("ELEMENT"))
    for scope in scopes:
        for node, place in _nodes_in(scope, nodes, 3 if solid else 2).items():
            found[node].append(place)
    for node, places in found.items():
        if not places:
            made = deck.of(*_NODE_MAKERS)
            hint = f"; {made[0].title}, {made[0].where}, is not followed" if made else ""
            raise DeckError(f"no *NODE of the deck defines node {node}{hint}{deck.unread}")
        if len(places) > 1:
            listed = ", ".join(f"{one.instance or 'the assembly'} ({one.where})" for one in places)
            raise DeckError(
                f"node {node} is in several instances: {listed}; give one of them another number"
            )
    return [found[node][0] for node in nodes]


def _nodes_in(scope: Scope, nodes: list[int], axes: int) -> dict[int, Place]:
    """Those of `nodes` that the scope defines."""
    found: dict[int, Place] = {}
    for block in scope.blocks:
        for row in _rows_of(block, nodes) if block.keyword == "NODE" else ():
            if block.word("SYSTEM") not in ("", "R"):
                raise block.error(
                    f"*NODE, SYSTEM={block.word('SYSTEM')}: node {row.words[0]} is not in "
                    "rectangular coordinates"
                )
            node = row.whole(0)
            at = tuple(row.number(1 + k, blank=0.0) + scope.shift[k] for k in range(axes))
            found[node] = Place(node, at, scope.instance, row.where)  # the last one counts
    moved = [block.where for block in scope.blocks if block.keyword == "SYSTEM"]
    if found and (moved or scope.rotated):
        raise DeckError(
            f"{(moved or [scope.rotated])[0]}: rotates or moves the nodes of "
            f"{scope.instance or 'the deck'}, and where they come to lie is not worked out; "
            "write them in global coordinates"
        )
    return found


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


def size_of(deck: Deck) -> float:
    """The longest side of the box around the nodes, in the deck's unit; of many, a sample."""
    lines = [
        line
        for block in deck.of("NODE")
        for piece in block.pieces
        for line in piece.text.data[piece.start : piece.stop].splitlines()
    ]
    box = [[math.inf, -math.inf] for _ in range(3)]
    for line in lines[:: len(lines) // _SAMPLED + 1]:
        for side, word in zip(box, line.split(b",")[1:4], strict=False):
            with suppress(ValueError):
                value = float(word)
                side[:] = min(side[0], value), max(side[1], value)
    return max(0.0, *(last - first for first, last in box))
