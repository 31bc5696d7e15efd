"""Contents of a Marc deck: mesh, sets, materials, tables, conditions, contact, load cases.

`read_marc_deck` reads mesh and tables immediately, since their counts show whether the deck
is complete; the methods of `MarcDeck` read the rest on demand. Numbers are in the
deck's own units. `describe_marc_deck` summarises all of it.
"""

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from decks.marc.grammar import (
    CONDITIONS,
    FileSection,
    Layout,
    Line,
    MarcOption,
    blocks,
    integers_line,
    names,
    read_list,
    read_options,
)
from fembridge.errors import DeckError, FembridgeError
from fembridge.host.store import MAX_DECK_BYTES, read_bytes
from fembridge.typing import FloatArray, IntArray, Table

# Nodes of an element by type, those of pressure included: the types of the decks
# tried, and those that third parties list from the element library, Volume B.
NODES = {
    **dict.fromkeys((9, 31, 52, 98), 2),
    **dict.fromkeys((2, 6, 138, 158, 201), 3),
    **dict.fromkeys((3, 10, 11, 18, 75, 114, 115, 116, 134, 135, 139, 140), 4),
    **dict.fromkeys((80, 82, 83, 118, 119, 157), 5),
    **dict.fromkeys((124, 125, 126, 128, 129, 136, 137, 200), 6),
    **dict.fromkeys((7, 22, 26, 27, 28, 30, 32, 33, 43, 53, 54, 55), 8),
    **dict.fromkeys((58, 59, 63, 66, 117, 123, 149), 8),
    **dict.fromkeys((84, 120), 9),
    **dict.fromkeys((34, 47, 60, 127, 130, 133), 10),
    **dict.fromkeys((202, 203), 15),
    **dict.fromkeys((21, 23, 35, 44, 57, 61, 150), 20),
}
_NODES_PER_LINE = 14  # nodes of an element
_MAX_COORDINATES = 6

# What makes nodes and elements that are on no line of their own.
_GENERATORS = names(
    "conn fill, conn gener, node circle, node fill, node generation, ufconn, ufxord"
)
_MENTAT = re.compile(r"\$\.+\s*MARC input file produced by (.*?)\s*\Z", re.IGNORECASE)

# Tables: type of variable, and the fifth number of the first line.
TIME = 1
POINTS, FORMULA = 2, 3

# Conditions and contact.
FIXED_DISPLACEMENT = "fixed disp"
POINT_LOAD, DISTRIBUTED_LOAD = "point load", "dist loads"
TRANSLATIONS = 3
"""The first numbers of a body's motion, and degrees of freedom of a node: x, y and z."""
BODY_KINDS = {1: "deformable", 2: "rigid", 3: "symmetry"}
POSITION = -1
"""How a rigid body is controlled: 0 is by velocity, above that by a load."""
_BEFORE_BODIES = 4  # lines

# Increments. What else can make them does not say how long they take.
FIXED, ADAPTIVE = "auto load", "auto step"
_OTHER_STEPPING = names("""
auto creep, auto increment, auto therm, auto time, buckle, creep increment,
dynamic change, harmonic, modal increment, modal shape, steady state, transient
""")
_AUTO_STEP = "rrrrrriiii"

# The first line of `post`, fields from 0, and codes of element quantities.
POST_COUNT, POST_KIND, POST_EVERY, POST_NODAL = 0, 3, 8, 12
STRESS, VON_MISES = 311, 17
POST_KINDS = {"binary": 0, "text": 1, "both": 2}
"""Field 4 of `post`: 0 was seen, 1 is documented by a reader of such decks; 2 for both is
inferred from Mentat's three choices."""

_Value = TypeVar("_Value")
_LISTED_IN_MATERIAL = 11  # the last input version, of those seen, with lists of elements there


# ---- Values


@dataclass(frozen=True, slots=True, eq=False)
class Elements:
    """Elements of one type in one ``connectivity``: `number` ``(E,)``, `node` ``(E, k)``.

    `material` is 0 where the deck does not say it there.
    """

    kind: int
    number: IntArray
    node: IntArray
    material: int


@dataclass(frozen=True, slots=True, eq=False)
class Coordinates:
    """Nodes, `number` ``(N,)``, and where they lie, `position` ``(N, d)``.

    Pressure nodes of mixed elements have no coordinates. `line` is where the option
    starts, None without.
    """

    number: IntArray
    position: FloatArray
    line: Line | None

    def position_of(self, node: int) -> FloatArray | None:
        """Position of a node ``(d,)``; None if it has no coordinates."""
        rows = np.flatnonzero(self.number == node)
        if not rows.size:
            return None
        position: FloatArray = self.position[rows[-1]]  # the last one counts
        return position


@dataclass(frozen=True, slots=True, eq=False)
class NamedSet:
    """A set: `kind` is the deck's word, such as ``node``, ``element``, ``edgemt``.

    `member` ``(M,)`` are numbers; of edges and faces ``(M, 2)`` element and side.
    """

    name: str
    kind: str
    member: IntArray


@dataclass(frozen=True, slots=True, eq=False)
class MarcTable:
    """A table: `points` ``(P, 2)`` of one variable of type `variable`, None for others.

    `rows` are its lines without comments: two of numbers, then the points.
    """

    name: str
    number: int
    variable: int
    points: FloatArray | None
    line: Line
    rows: tuple[Line, ...]


@dataclass(frozen=True, slots=True)
class Isotropic:
    """A material: eight `values`, the first Young's modulus and Poisson's ratio.

    `elements` are those that the option lists, none where the mesh says them.
    """

    number: int
    name: str
    values: tuple[float, ...]
    elements: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Condition:
    """A boundary or initial condition: a value, its table (0 for none), its direction.

    Directions are degrees of freedom from 1, 0 but of fixed displacements. `set_name` is the
    set it acts on; `line` holds the values. `kind` of a distributed load is its type, 0 for
    pressure.
    """

    family: str
    name: str
    drives: tuple[tuple[float, int, int], ...]
    set_name: str
    line: Line
    kind: int = 0


@dataclass(frozen=True, slots=True)
class Body:
    """A contact body; its motion, on `line`: eight values and the table of each.

    Positions are relative to where the body was drawn: inferred from one deck whose
    author says what it does.
    """

    name: str
    kind: int
    control: int
    drives: tuple[tuple[float, int], ...]
    line: Line


@dataclass(frozen=True, slots=True)
class LoadCase:
    """A load case; `number` from 1, `name` as ``loadcase`` or ``title`` says it.

    `stepping` is the option that makes increments, None where there are none;
    `increments` is their count where it is fixed, `period` their time together, None
    where the deck does not say.
    """

    number: int
    name: str
    active: tuple[str, ...]
    stepping: MarcOption | None
    time_step: MarcOption | None
    increments: int | None
    period: float | None
    line: Line


@dataclass(frozen=True, slots=True)
class Post:
    """The post file asked for; `head` are the numbers of the first line, `line`.

    `codes` are element quantities, on `code_lines`.
    """

    codes: tuple[int, ...]
    nodal: tuple[int, ...]
    head: tuple[int, ...]
    line: Line
    code_lines: tuple[Line, ...]


# ---- The deck


@dataclass(frozen=True, slots=True, eq=False)
class MarcDeck:
    """All of a deck: every line is in one of `options`, in order.

    The methods raise DeckError, with the line, where an option is cut short, is in a
    shape that no real deck has, or holds less than it announces.
    """

    options: tuple[MarcOption, ...]
    elements: tuple[Elements, ...]
    coordinates: Coordinates
    tables: tuple[MarcTable, ...]

    def find(self, keyword: str, section: FileSection = FileSection.MODEL) -> list[MarcOption]:
        """The options of that keyword in one section."""
        options = self.options
        return [
            option for option in options if option.keyword == keyword and option.section is section
        ]

    @property
    def version(self) -> int | None:
        """The input version: 11 for Mentat 2014, 15 from 2020."""
        for option in self.find("version", FileSection.PARAMETER):
            return (option.numbers or [0])[0]
        return None

    @property
    def mentat(self) -> str | None:
        """The program that wrote the deck, as the deck says."""
        lines = (line for option in self.options for line in option.lines)
        matches = (_MENTAT.match(line.text) for line in lines if line.text.startswith("$"))
        return next((match[1] for match in matches if match), None)

    @property
    def sizes(self) -> tuple[int, int] | None:
        """Elements and nodes, pressure nodes too, that the deck says it has."""
        for option in self.find("sizing", FileSection.PARAMETER):
            numbers = option.numbers
            start = 1 if option.head.free else 2  # a workspace comes before
            if len(numbers) >= start + 2:
                return numbers[start], numbers[start + 1]
        return None

    @property
    def element_count(self) -> int:
        """How many elements are listed."""
        return sum(len(block.number) for block in self.elements)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on the deck for the user."""
        if self.sizes is None or self.element_count == self.sizes[0]:
            return ()
        return (f"{self.element_count} elements, while `sizing` has room for {self.sizes[0]}",)

    def sets(self) -> dict[str, NamedSet]:
        """Sets by name, of all sections."""
        sets: dict[str, NamedSet] = {}
        for option in (option for option in self.options if option.keyword == "define"):
            kind, name = _kind_and_name(option)
            paired = kind.startswith(("edge", "face"))
            members = read_list(option.data, paired=paired)
            shape = (len(members), 2) if paired else (len(members),)
            sets[name] = NamedSet(name, kind, np.array(members, dtype=np.int64).reshape(shape))
        return sets

    def materials(self) -> list[Isotropic]:
        """The isotropic materials."""
        listed = (self.version or 0) <= _LISTED_IN_MATERIAL
        driven = bool(self.find("table", FileSection.PARAMETER))
        return _read_all(self.find("isotropic"), lambda option: _materials(option, listed, driven))

    def conditions(self) -> list[Condition]:
        """All conditions of the model definition."""
        options = (option for option in self.options if option.section is FileSection.MODEL)
        return _read_all(
            (option for option in options if option.keyword in CONDITIONS), _conditions
        )

    def bodies(self) -> list[Body]:
        """The contact bodies, none of a deck without contact."""
        return _read_all(self.find("contact")[:1], _bodies)

    def load_cases(self) -> list[LoadCase]:
        """All load cases."""
        last = max((option.case for option in self.options), default=0)
        return [_load_case(self.options, number) for number in range(1, last + 1)]

    def post(self) -> Post | None:
        """The last ``post`` of the model definition; None of a deck without."""
        return next(iter(_read_all(self.find("post")[-1:], _post)), None)


def read_marc_deck(data: bytes) -> MarcDeck:
    """Read a Marc deck.

    Raises
    ------
    DeckError
        No Marc deck, cut short, one that includes files, or its counts do not agree; names
        the line.
    """
    options = read_options(data)
    model = [option for option in options if option.section is FileSection.MODEL]
    connectivity = [option for option in model if option.keyword == "connectivity"]
    deck = MarcDeck(
        tuple(options),
        tuple(_elements(connectivity)),
        _coordinates([option for option in model if option.keyword == "coordinates"]),
        tuple(_read_all((option for option in model if option.keyword == "table"), _table)),
    )
    generated = any(option.keyword in _GENERATORS for option in options)
    if deck.sizes is None or generated:
        return deck
    # Mentat says how many elements there are, others how much room is.
    count, announced = deck.element_count, deck.sizes[0]
    places = ", ".join(option.head.location for option in connectivity) or "without `connectivity`"
    deck.find("sizing", FileSection.PARAMETER)[0].head.check(
        count == announced or (count < announced and deck.mentat is None),
        f"`sizing` has {announced} elements, but the deck holds {count} ({places})",
    )
    return deck


def describe_marc_deck(path: Path) -> Table:
    """Contents of the deck at `path`, as a table.

    Parts that cannot be read are listed in ``remarks``, with their line.
    """
    data = read_bytes(path, MAX_DECK_BYTES, DeckError)
    try:
        deck = read_marc_deck(data)
    except DeckError as error:
        raise DeckError.from_error(error, path) from error
    remarks = list(deck.remarks)

    def read(view: Callable[[], Iterable[Any]], describe: Callable[[Any], Any]) -> list[Any]:
        try:
            return [describe(item) for item in view()]
        except DeckError as error:
            remarks.append(f"not read: {error}")
            return []

    kinds: Counter[int] = Counter()
    for item in deck.elements:
        kinds[item.kind] += len(item.number)
    tables = []
    for table in deck.tables:
        entry: Table = {"name": table.name, "number": table.number, "line": table.line.number}
        if table.points is not None and len(table.points):
            first, last = table.points[[0, -1]].tolist()
            entry |= {"points": len(table.points), "first": first, "last": last}
        tables.append(entry)
    sets = read(
        lambda: deck.sets().values(),
        lambda item: (item.name, {"kind": item.kind, "members": len(item.member)}),
    )
    post = read(
        lambda: filter(None, [deck.post()]),
        lambda post: {
            "codes": list(post.codes),
            "nodal_codes": list(post.nodal),
            "formatted": post.head[POST_KIND] == POST_KINDS["text"],
            "every": max(post.head[POST_EVERY], 1),
        },
    )
    return {
        "format": "marc-deck",
        "bytes": len(data),
        "lines": sum(len(option.lines) for option in deck.options),
        "version": deck.version,
        "written_by": deck.mentat,
        "elements": {str(kind): count for kind, count in sorted(kinds.items())},
        "nodes": len(deck.coordinates.number),
        "sets": dict(sets),
        "tables": tables,
        "conditions": read(
            deck.conditions,
            lambda item: {"family": item.family, "name": item.name, "on": item.set_name},
        ),
        "contact_bodies": read(
            deck.bodies,
            lambda item: {"name": item.name, "kind": BODY_KINDS.get(item.kind, str(item.kind))},
        ),
        "load_cases": read(
            deck.load_cases,
            lambda case: {
                "name": case.name,
                "stepping": case.stepping and case.stepping.keyword,
                "increments": case.increments,
                "period": case.period,
            },
        ),
        "post": post[0] if post else None,
        "sections": dict(Counter(o.keyword for o in deck.options if o.keyword)),
        "remarks": remarks,
    }


# ---- Options: each reads what it announces, as far as that is known


def _read_all(
    options: Iterable[MarcOption], read: Callable[[MarcOption], Iterable[_Value]]
) -> list[_Value]:
    """Values of all `options`; a malformed option is refused."""
    values = list[_Value]()
    for option in options:
        with _shape_errors(option):
            values += read(option)
    return values


@contextmanager
def _shape_errors(option: MarcOption) -> Iterator[None]:
    """One error for any malformed entry of an option."""
    try:
        yield
    except FembridgeError:
        raise
    except (IndexError, ValueError):
        named = f" {option.name!r}" if option.name else ""
        raise option.head.error(
            f"`{option.keyword}`{named} is cut short, holds less or more than it announces, or "
            "is in a shape that no deck read so far has"
        ) from None


# ---- Mesh and sets


def _elements(options: Sequence[MarcOption]) -> Iterator[Elements]:
    """All ``connectivity`` options, one value a type in each.

        connectivity
                 0         0         1         0         1         1         0         1
                 1       118       220       221      2589      2590      2591

    The first line's fifth, sixth and eighth field name geometry, material and contact
    body of all elements below, from input version 12 on. An element is its number, its
    type and its nodes: 14 of them on the first line, 14 on each further one.
    """
    line_of: dict[int, Line] = {}
    for option in options:
        rows = [line for line in option.data if not line.blank]
        head = rows[0].integers() + [0] * 9 if rows else []
        rows_by_kind: dict[int, list[list[int]]] = {}
        row = 1
        while row < len(rows):
            line = rows[row]
            values = line.integers()
            row += 1
            if len(values) < 3:
                raise line.error("expected an element: number, type, nodes")
            number, kind = values[:2]
            if number in line_of:
                raise line.error(f"element {number} again, first on {line_of[number].location}")
            line_of[number] = line
            same_kind = rows_by_kind.setdefault(kind, [])
            # Of a type that is not known all nodes are on the line, as of the first of it.
            expected = NODES.get(kind, len((same_kind or [values])[0]) - 2)
            while (
                row < len(rows)
                and expected > (nodes := len(values) - 2)
                and not nodes % _NODES_PER_LINE
            ):
                values += rows[row].integers()
                row += 1
            message = f"element {number} of type {kind} has {len(values) - 2} nodes"
            line.check(len(values) - 2 == expected, f"{message}, expected {expected}")
            same_kind.append(values)
        for kind, listed in rows_by_kind.items():
            table = np.array(listed, dtype=np.int64)
            yield Elements(kind, table[:, 0].copy(), table[:, 2:].copy(), head[5])


def _coordinates(options: Sequence[MarcOption]) -> Coordinates:
    """All ``coordinates`` options: reals per node, count of nodes, then the nodes."""
    numbers: list[int] = []
    node_coordinates: list[list[float]] = []
    for option in options:
        rows = [line for line in option.data if not line.blank]
        if not rows:
            continue
        width, count = ([*rows[0].integers(), 0, 0])[:2]
        width = width or 3
        message = f"{width} coordinates a node, expected 1 to {_MAX_COORDINATES}"
        rows[0].check(1 <= width <= _MAX_COORDINATES, message)
        for line in rows[1:]:
            number, *coordinates = line.fields("i" + "r" * width)
            numbers.append(number)
            node_coordinates.append(coordinates)
        message = f"{count} nodes announced, but {len(rows) - 1} lines of them"
        rows[0].check(count in (0, len(rows) - 1), message)
    position = np.zeros((len(node_coordinates), max(map(len, node_coordinates), default=3)))
    for row, coordinates in zip(position, node_coordinates, strict=True):
        row[: len(coordinates)] = coordinates
    head = options[0].head if options else None
    return Coordinates(np.array(numbers, dtype=np.int64), position, head)


def _kind_and_name(option: MarcOption) -> tuple[str, str]:
    """The words of ``define KIND set NAME``."""
    text, width = option.head.text, option.head.layout.real
    if option.head.free:
        fields = [field.strip() for field in text.split(",")]
        name = ",".join(fields[3:]).strip(",").strip()
    else:
        fields = [text[start : start + width].strip() for start in range(0, 3 * width, width)]
        name = text[3 * width :].strip()
        if not name:
            fields = text.split(maxsplit=3)
            name = fields[3].strip() if len(fields) > 3 else ""
    kind = fields[1].lower() if len(fields) > 1 else ""
    option.head.check(bool(kind and name), "expected `define`, what, `set` and a name")
    return kind, name


# ---- Materials and tables


def _materials(option: MarcOption, listed: bool, driven: bool) -> Iterator[Isotropic]:
    """Isotropic materials; up to input version 11 the list of its elements follows.

            1von mises           isotropic                   10         0         0
    E, Poisson's ratio, density, thermal expansion, yield stress, three more
            0         0 ...                      table of each of the eight
    """
    before_list = 3 if driven else 2  # decks without tables have none here
    starts = []
    for row, line in enumerate(rows := option.data):
        number, criterion = line.cut("iw")
        if number.isdigit() and criterion[:1].isalpha():
            starts.append(row)
    for block in blocks(rows, starts):
        number, _criterion, _hardening, *_, name = block[0].fields("iwwiiiit")
        young, poisson, *others = block[1].reals()
        members = [item for item in block[before_list:] if not item.blank] if listed else []
        elements = tuple(item for item in read_list(members) if isinstance(item, int))
        yield Isotropic(number, name, (young, poisson, *others), elements)


def _table(option: MarcOption) -> Iterator[MarcTable]:
    """A value against one or more variables.

        table               waveform
                 1         1         0         0         2
                 1       501         2         0         0         2 ...
         0.000000000000000+0 0.000000000000000+0

    The first line holds number, count of variables, and in its fifth field 2 where points
    follow, 3 for a formula. Of each variable follow its type, its points, and whether
    values beyond them are extrapolated.
    """
    rows, variable, points = option.filled, 0, None
    number, count, _, _, kind = (rows[0].integers() + [0] * 3)[:5]
    if kind != FORMULA and count >= 1:
        variable, expected = rows[1].integers()[:2]
        if count == 1 and kind == POINTS:
            pairs = [line.fields("rr") for line in rows[2:]]
            points = np.array(pairs, dtype=np.float64).reshape(expected, 2)
    yield MarcTable(option.name, number, variable, points, option.head, tuple(rows))


# ---- Conditions and contact


def _conditions(option: MarcOption) -> Iterator[Condition]:
    """Conditions of one option, all in one shape.

        fixed disp

                 1         0         0         0         1         0indent
         0.000000000000000+0-1.000000000000000+0      values
                 0         1                          table of each value, 0 for none
                 1         2                          degree of freedom of each value
                 2                                    kind of list: 2 is a set of nodes
        indent_nodes

    Other conditions lack the degrees of freedom or have other numbers there.
    """
    starts = []
    for row, line in enumerate(rows := option.filled):
        *numbers, name = line.cut("iiiiiit")
        if name and all(number.lstrip("+-").isdigit() for number in numbers):
            starts.append(row)
    option.head.check(
        not rows or starts[:1] in ([0], [1]),
        f"`{option.keyword}` is not in the table-driven style, expected a line of six integers "
        "and a name",
    )
    for block in blocks(rows, starts):
        name = block[0].fields("iiiiiit")[6]
        values, tables = block[1].reals(), block[2].integers()
        tables += [0] * (len(values) - len(tables))
        directions, kind = [0] * len(values), 0
        if option.keyword == FIXED_DISPLACEMENT:
            directions, set_line = block[3].integers(), block[5]
        else:
            # Kinds of loads differ in what comes between; a name is always last.
            set_line = next((line for line in reversed(block[4:]) if line.lettered), block[4])
            if option.keyword == DISTRIBUTED_LOAD:
                kind = block[3].first_integer()
        drives = tuple(zip(values, tables, directions, strict=True))
        yield Condition(option.keyword, name, drives, set_line.only_word, block[1], kind)


def _bodies(option: MarcOption) -> Iterator[Body]:
    """The bodies of ``contact``: numbers and a name, what it is, how it moves.

                 3         1         0         0         1        -1         0        -1load
                 2         0 ...                      1 deformable, 2 rigid, 3 symmetry
         centre of rotation (3), 0 0 0, 1             seven reals
         0 0 0 0                                      friction, old style
         x, y, z, ...                                 eight reals, times their tables
                 0         1 ...                      tables
                 0         0         0         0

    The sixth number is its control. A rigid body's curves or surfaces follow.
    """
    rows, starts = option.data, list[int]()
    for row, line in enumerate(rows[_BEFORE_BODIES:], start=_BEFORE_BODIES):
        # Their numbers rise from 1, a name is last.
        number, *_, name = line.cut("iiiiiiiit")
        if name.strip("+-.0123456789") and number == str(len(starts) + 1):
            starts.append(row)
    for block, _ in zip(blocks(rows, starts), range(rows[0].first_integer()), strict=True):
        *_, control, _, _, name = block[0].fields("iiiiiiiit")
        drives = tuple(zip(block[4].reals(), block[5].integers(), strict=True))
        yield Body(name, block[1].first_integer(), control, drives, block[4])


# ---- Load cases and output


def _load_case(all_options: Sequence[MarcOption], number: int) -> LoadCase:
    """A load case: what acts, in how many increments, for how long.

    loadcase            press
             2
    held
    indent
    auto load
           500         0        10         0         0
    time step
     5.000000000000000-4
    continue
    """
    options = [option for option in all_options if option.case == number]

    def find_options(*keywords: str) -> list[MarcOption]:
        return [option for option in options if option.keyword in keywords]

    case_options, times = find_options("loadcase"), find_options("time step")
    steps = find_options(FIXED, ADAPTIVE, *_OTHER_STEPPING)
    for other in steps[1:]:
        problem = f"beside `{steps[0].keyword}` on {steps[0].head.location}"
        raise other.head.error(f"a second way of stepping, `{other.keyword}`, {problem}")
    name = next((option.name for option in reversed(case_options or find_options("title"))), "")
    active = tuple(_read_all(case_options[-1:], _active_conditions))
    stepping, time_step = next(iter(steps), None), next(reversed(times), None)
    increments, period = _increments(stepping, time_step)
    return LoadCase(number, name, active, stepping, time_step, increments, period, options[0].head)


def _active_conditions(option: MarcOption) -> list[str]:
    """Names of the conditions that act, as many as the first line says."""
    rows = option.data
    return [rows[row + 1].only_word for row in range(rows[0].first_integer())] if rows else []


def _increments(
    stepping: MarcOption | None, time_step: MarcOption | None
) -> tuple[int | None, float | None]:
    """The count of a load case's increments, and their time together."""
    if stepping is None:
        return 0, 0.0
    with _shape_errors(stepping):
        first = stepping.data[0]
    if stepping.keyword == ADAPTIVE:
        return None, first.fields(_AUTO_STEP)[1]
    if stepping.keyword != FIXED:
        return None, None
    count = first.first_integer()
    if time_step is None:
        return count, None
    with _shape_errors(time_step):
        return count, count * time_step.data[0].fields("r")[0]


def _post(option: MarcOption) -> Iterator[Post]:
    """The post file asked for.

        post
                 1        16        17         0         0        19        20         0 ...
               311         0
        nodal                        1

    Fields of the first line: 1 element codes; 4 is 0 for binary, 1 for formatted; 9 every
    n-th increment; 13 nodal codes, where 0 stands for displacement and forces.
    """
    first, *rows = [line for line in option.data if not line.blank]
    head = first.integers()
    head += [0] * (POST_NODAL + 1 - len(head))
    codes = [line for line in rows if not line.lettered]
    codes = [codes[row] for row in range(head[POST_COUNT])]
    yield Post(
        tuple(line.fields("i")[0] for line in codes),
        tuple(line.fields("wi")[1] for line in rows if line.lettered),
        tuple(head),
        first,
        tuple(codes),
    )


def post_lines(codes: Sequence[int], kind: int, layout: Layout) -> list[str]:
    """``post`` of all layers and every increment; `kind` is one of `POST_KINDS`.

    The numbers after the kinds are units of the files as Mentat writes them.
    """
    head = [len(codes), 16, 17, kind, 0, 19, 20, 0, 1, 0, 0, 0, 0, 0, 0, 0]
    return ["post", *(integers_line(row, layout) for row in (head, *((code, 0) for code in codes)))]
