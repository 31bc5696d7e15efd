"""An own Marc deck with the waveform in it; all else is kept to the byte.

Changed are: the points of one table; the increments of the load case it drives; the
output request. The depth is put into the table so that what the table is multiplied by
becomes the probe's depth in the deck's unit of length; time is taken to be in s, and to
run on over load cases. Not run in Marc: the deck's grammar was learned from decks that
Mentat wrote.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from decks.marc.contents import (
    ADAPTIVE,
    FIXED,
    FIXED_DISPLACEMENT,
    POSITION,
    POST_COUNT,
    POST_EVERY,
    POST_KIND,
    POST_KINDS,
    STRESS,
    TIME,
    TRANSLATIONS,
    VON_MISES,
    LoadCase,
    MarcDeck,
    MarcTable,
    Post,
    post_lines,
    read_marc_deck,
)
from decks.marc.grammar import (
    Layout,
    Line,
    Section,
    format_free,
    format_real,
    integers_line,
    reals_line,
)
from decks.motion import Motion
from decks.own_model import Change, Edit, Rebased, Request, edited, too_far
from decks.unit_system import LENGTH_UNITS, MM
from fembridge.errors import DeckError

_WANTED = (VON_MISES, STRESS)
_MANY_INCREMENTS = 99999  # what Mentat writes as the largest count
_CUT_BACKS = 10  # how often an increment may be cut, Mentat's default
_NEWER_VERSION = 14  # of those seen, the first with five numbers in `auto load`


def rebase_marc(data: bytes, motion: Motion, request: Request) -> Rebased:
    """A Marc deck with `motion` in it.

    Raises
    ------
    DeckError
        What is asked for is missing from the deck or could be several things; the
        message names the lines.
    """
    if request.move is not None or request.increments != "fixed" or request.all_nodes:
        raise DeckError(
            "a Marc deck has its motion in a table (--amplitude names it), cuts an increment of "
            "`auto load` by itself where it must, and writes all nodes; --move, --increments and "
            "--frames are for CalculiX and Abaqus"
        )
    deck = read_marc_deck(data)
    units = LENGTH_UNITS[request.length_unit or "mm"]
    table, drives = _driving_table(deck, request.amplitude)
    chosen = _choose_case(deck, request.step, drives)
    drives = _acting(chosen.case, drives)
    factor = _one_factor(table, drives)
    edits: list[Edit] = []
    remarks = [*deck.remarks, f"{table.line.place}: table {table.name!r} is the waveform"]
    remarks += [f"{use.line.place}: it drives {use.what}, factor {use.value:g}" for use in drives]
    if factor != 1.0:
        remarks.append(f"{drives[0].line.place}: the table holds depth divided by {factor:g}")
    if units is not MM:
        remarks.append(f"one length unit of the deck is {units.length_mm:g} mm")
    position = deck.coordinates.position
    size = float(np.ptp(position, axis=0).max()) if position.size else 0.0
    remarks += too_far(motion, size * units.length_mm, units, by_heading=False)
    stands = _standing(deck, table, drives, chosen)
    for more_edits, more_remarks in (
        _point_edits(table, motion, chosen, units.length_mm * factor, stands),
        _increment_edits(deck, chosen, motion),
        _output_edits(deck, chosen.case.number, request.results),
    ):
        edits += more_edits
        remarks += more_remarks
    places = {}
    for name, node in request.afferents.items():
        place = deck.coordinates.of(node)
        if place is None or len(place) < 2:
            problem = f"afferent {name}: node {node} has no coordinates"
            line = deck.coordinates.line
            raise DeckError(problem) if line is None else line.refuse(problem)
        flat = position.shape[1] < 3 or not np.ptp(position[:, 2])
        places[name] = tuple(float(value) * units.length_mm for value in place[: 2 if flat else 3])
    deep_mm = (stands or 0.0) * factor * units.length_mm
    return Rebased(edited(data, edits), tuple(remarks), places, (), chosen.start_s, deep_mm, units)


# ---- The table

# A fixed displacement and a rigid body under position control are their value times
# their table; |value| is the factor that turns the table into a depth. The sign is the
# user's: it says which way is into the skin.


@dataclass(frozen=True, slots=True)
class _Use:
    """A place where a table is used: `value` times it is what `what` says.

    `moves` says that this is a displacement; `condition` is the condition's name, empty
    for what always acts, and `where` the set it acts on.
    """

    table: int
    value: float
    what: str
    moves: bool
    condition: str
    line: Line
    where: str = ""


_Uses = tuple[_Use, ...]


def _uses(deck: MarcDeck) -> Iterator[_Use]:
    """All uses of tables that the grammar can see."""
    for each in deck.conditions():
        displacement = each.family == FIXED_DISPLACEMENT
        for value, table, direction in each.drives:
            if table and (value or not displacement):
                what = f"`{each.family}` {each.name!r}"
                if turns := direction > TRANSLATIONS:
                    what = f"degree of freedom {direction} of {what}"
                moves = displacement and not turns
                yield _Use(table, value, what, moves, each.name, each.line, each.where)
    for body in deck.bodies():
        for row, (value, table) in enumerate(body.drives):
            if table and value:
                moves = body.control == POSITION and row < TRANSLATIONS
                what = f"contact body {body.name!r}"
                if not moves:
                    manner = "rotation" if row >= TRANSLATIONS else "velocity or load"
                    what = f"the {manner} of {what}"
                yield _Use(table, value, what, moves, "", body.line)


def _driving_table(deck: MarcDeck, name: str | None) -> tuple[MarcTable, _Uses]:
    """The table that is named, or the only one that moves something, and its uses."""
    uses = tuple(_uses(deck))
    if name is None:
        problem = "no table drives a fixed displacement or the position of a contact body"
        moving = {use.table for use in uses if use.moves}
        found = [table for table in deck.tables if table.number in moving]
    else:
        problem, wanted = f"no table {name!r}", name.strip()
        found = [table for table in deck.tables if table.name == wanted]
        found = found or [each for each in deck.tables if each.name.lower() == wanted.lower()]
    if not found:
        there = f"has tables {_names(deck.tables)}" if deck.tables else "has no tables"
        raise DeckError(f"{problem}; the deck {there}")
    if len(found) > 1:
        what = "drive a motion; name one" if name is None else f"are named {name!r}"
        raise found[1].line.refuse(f"{len(found)} tables {what}: {_names(found)}")
    (table,) = found
    same = [each for each in deck.tables if each.number == table.number]
    several = f"{len(same)} tables have number {table.number}: {_names(same)}"
    same[-1].line.check(len(same) == 1, several)
    mine = tuple(use for use in uses if use.table == table.number)
    for use in mine:
        words = f"table {table.name!r} ({table.line.place}) also drives {use.what}, which is no"
        use.line.check(use.moves, f"{words} displacement: give the motion a table of its own")
    table.line.check(
        bool(mine)
        and table.points is not None
        and table.points.size > 0
        and table.variable == TIME,
        f"table {table.name!r} is no waveform: expected points of time and value, in the deck "
        "itself, that drive a fixed displacement or a contact body",
    )
    return table, mine


def _one_factor(table: MarcTable, drives: _Uses) -> float:
    """The factor of all that the table drives, or it is not the same depth for all."""
    first = drives[0]
    for use in drives[1:]:
        words = f"table {table.name!r} drives {use.what} with factor {use.value:g}, but"
        words += f" {first.what} ({first.line.place}) with {first.value:g}: which is the probe?"
        use.line.check(abs(use.value) == abs(first.value), words)
    return abs(first.value)


def _names(tables: Sequence[MarcTable]) -> str:
    return ", ".join(f"{table.name} ({table.line.place})" for table in tables)


# ---- The load case


@dataclass(frozen=True, slots=True)
class _Chosen:
    """A load case, when it starts, in s, and what there is before and after."""

    case: LoadCase
    start_s: float
    before: Sequence[LoadCase]
    after: Sequence[LoadCase]

    @property
    def words(self) -> str:
        """Number and name of the load case."""
        named = f" {self.case.name!r}" if self.case.name else ""
        return f"load case {self.case.number}{named}"


def _choose_case(deck: MarcDeck, wanted: str | None, drives: _Uses) -> _Chosen:
    """The load case that is wanted, or the only one in which there is motion."""
    cases = deck.load_cases()
    moving = [case for case in cases if case.stepping is not None and _acting(case, drives)]
    if wanted is not None:
        word = wanted.strip().lower()
        named = [case for case in moving if case.name.lower() == word]
        moving = named or [case for case in moving if str(case.number) == word]
    if len(moving) != 1:
        asked = "" if wanted is None else f" {wanted!r}"
        problem = (
            f"{len(moving)} load cases{asked} with increments in which {drives[0].what} "
            f"({drives[0].line.place}) acts, expected one: --step names it; there: "
            f"{_listed_cases(moving or cases) or 'none'}"
        )
        at = moving[1:] or cases
        raise at[0].line.refuse(problem) if at else DeckError(problem)
    (case,) = moving
    start_s = 0.0
    before = cases[: case.number - 1]
    for each in before:
        if each.period is None:
            words = f"load case {each.number} {each.name!r} comes before the waveform, but"
            words += " `auto load` or `auto step` does not say how long it takes"
            raise each.line.refuse(words)
        start_s += each.period
    return _Chosen(case, start_s, before, cases[case.number :])


def _acting(case: LoadCase, drives: _Uses) -> _Uses:
    return tuple(use for use in drives if not use.condition or use.condition in case.active)


def _listed_cases(cases: Iterable[LoadCase]) -> str:
    return ", ".join(f"{case.number} {case.name} ({case.line.place})" for case in cases)


def _standing(deck: MarcDeck, table: MarcTable, drives: _Uses, chosen: _Chosen) -> float | None:
    """What the table has come to when the load case starts; None where it moved nothing before."""
    if any(_acting(each, drives) for each in chosen.before):
        assert table.points is not None
        return float(np.interp(chosen.start_s, *table.points.T))
    active = {name for each in chosen.before for name in each.active}
    sets = {use.where for use in drives if use.where}
    for each in deck.conditions():
        if each.family == FIXED_DISPLACEMENT and each.name in active and each.where in sets:
            words = f"`{each.family}` {each.name!r} moves {each.where!r} in a load case before, so "
            words += f"where {chosen.words} finds it is not known; drive it by one table in both"
            each.line.check(not any(value for value, _, _ in each.drives), words)
    return None


# ---- The changes


def _instead(line: Line, *texts: str) -> Edit:
    """`texts`, each a line, in the place of `line`; none takes it out."""
    return _before(line, *texts)._replace(stop=line.stop)


def _before(line: Line, *texts: str) -> Edit:
    """Lines before `line`, with the line end that it has."""
    end = "\r\n" if line.stop - line.start - len(line.text) == 2 else "\n"
    return Edit(line.start, line.start, "".join(text + end for text in texts).encode("latin-1"))


def _point_edits(
    table: MarcTable,
    motion: Motion,
    chosen: _Chosen,
    unit_mm: float,
    stands: float | None,
) -> Change:
    """Put time and depth into the table, from when the load case starts.

    Where the table moves something before, it stays as it was until then.
    """
    times_s = (motion.time_s + chosen.start_s).tolist()
    depths = (motion.depth_mm / unit_mm + (stands or 0.0)).tolist()
    points = list(zip(times_s, depths, strict=True))
    remarks = []
    if chosen.start_s > 0:
        before = [] if stands is None or table.points is None else table.points.tolist()
        before = [(t, v) for t, v in before if t < chosen.start_s] or [(0.0, depths[0])]
        points = [*before, *points]
        if stands:
            remarks.append(
                f"{table.line.place}: the load cases before leave the probe {stands * unit_mm:g} "
                "mm deep; the waveform begins there"
            )
        remarks.append(
            f"{table.line.place}: the waveform starts at {chosen.start_s:g} s, when "
            f"{chosen.words} does"
        )
    after = next((each for each in chosen.after if each.stepping), None)
    if after is not None:
        remarks.append(
            f"{after.line.place}: load case {after.number} follows: behind its last "
            "point the table goes on as its second line says"
        )
    _, counts, first, *others = table.rows
    free = table.rows[-1].free
    edits = [
        _instead(counts, counts.with_integer(1, len(points))),
        _instead(first, *(reals_line(each, first.layout, free=free) for each in points)),
        *map(_instead, others),
    ]
    return edits, remarks


def _increment_edits(deck: MarcDeck, chosen: _Chosen, motion: Motion) -> Change:
    """Make the load case `motion.increments` of `motion.dt_s`."""
    option, time_step = chosen.case.stepping, chosen.case.time_step
    assert option is not None
    counted = f"{motion.increments} increments of {motion.dt_s:g} s"
    option.head.check(
        option.keyword in (FIXED, ADAPTIVE),
        f"{chosen.words} steps by `{option.keyword}`, which is not changed here; "
        f"expected `{FIXED}` or `{ADAPTIVE}`",
    )
    first, *others = option.data
    added = ["time step", reals_line([motion.dt_s], first.layout, free=first.free)]
    edits = []
    if time_step is not None:
        line = time_step.data[0]
        edits.append(_instead(line, _with_first_real(line, motion.dt_s)))
        added = []
    if option.keyword == FIXED:
        edits.append(_before(option.head, *added))
        edits.append(_instead(first, first.with_integer(0, motion.increments)))
        remark = f"{option.head.place}: {chosen.words}: {counted}"
    else:
        numbers = [motion.increments, 0, _CUT_BACKS]
        if (deck.version or 0) >= _NEWER_VERSION:
            numbers += [0, 0]
        lines = [FIXED, integers_line(numbers, first.layout, free=first.free), *added]
        if option.head.text.isupper():
            lines = [line.upper() for line in lines]
        edits += [_instead(option.head, *lines), *map(_instead, (first, *others))]
        remark = f"{option.head.place}: {chosen.words}: `{ADAPTIVE}` became `{FIXED}`, {counted}"
    raised, remarks = _limit_edits(deck, chosen, motion)
    return [*edits, *raised], [remark, *remarks]


def _with_first_real(line: Line, value: float) -> str:
    """The text of a line of reals with `value` in its first field."""
    if line.free:
        return ",".join([format_free(value), *line.text.split(",")[1:]])
    rest = line.text[line.layout.real :]
    if line.layout is Layout.EXTENDED:
        return format_real(value) + rest
    words = f"{value!r} does not fit into ten columns; put a comma behind the number"
    line.check(not rest.strip(), words)
    return reals_line([value], line.layout)


def _limit_edits(deck: MarcDeck, chosen: _Chosen, motion: Motion) -> Change:
    """Let ``control`` allow all increments; whether it counts a case or all is open."""
    needed = motion.increments + sum(each.increments or 0 for each in chosen.before)
    edits, remarks = [], []
    for option in (*deck.find("control"), *deck.find("control", Section.HISTORY)):
        if option.case > chosen.case.number or not option.data:
            continue
        line = option.data[0]
        (most,) = line.fields("i")
        if 0 < most < needed:
            edits.append(_instead(line, line.with_integer(0, _MANY_INCREMENTS)))
            remarks.append(
                f"{line.place}: `control` allowed {most} increments, now {_MANY_INCREMENTS}"
            )
    return edits, remarks


def _output_edits(deck: MarcDeck, case: int, results: str | None) -> Change:
    """Ask for stress and von Mises stress at every increment of the load case `case`.

    Other quantities stay as they are; so does the kind of results where it is None.
    """
    found = deck.post()
    if found is not None:
        kind = found.head[POST_KIND] if results is None else POST_KINDS[results]
        edits, remarks = _post_edits(found, kind)
    else:
        end = deck.find("end option")[0].head
        lines = post_lines(_WANTED, POST_KINDS[results or "binary"], end.layout)
        edits = [_before(end, *lines)]
        remarks = [f"{end.place}: `post` put before it, with codes {VON_MISES}, {STRESS}"]
    every = deck.find("post increment", Section.HISTORY)
    every = [option for option in every if option.case <= case and option.data]
    if every and (count := every[-1].data[0].first_integer()) not in (0, 1):
        line = every[-1].data[0]
        edits.append(_instead(line, line.with_integer(0, 1)))
        remarks.append(f"{line.place}: `post increment` every increment, not every {count}")
    return edits, remarks


def _post_edits(found: Post, kind: int) -> Change:
    line, head = found.line, found.head
    missing = [code for code in _WANTED if code not in found.codes]
    text = line.text
    for row, new in (
        (POST_COUNT, len(found.codes) + len(missing)),
        (POST_KIND, kind),
        (POST_EVERY, 1),
    ):
        if new != head[row]:
            text = line._replace(text=text).with_integer(row, new)
    *_, last = (line, *found.code_lines)
    added = [integers_line((code, 0), line.layout, free=last.free) for code in missing]
    edits = [_instead(line, text, *(added if last is line else ()))]
    if last is not line:
        edits.append(_instead(last, last.text, *added))
    remarks = []
    if missing:
        remarks.append(f"{line.place}: `post` also asks for codes {', '.join(map(str, missing))}")
    if head[POST_EVERY] not in (0, 1):
        remarks.append(f"{line.place}: `post` every increment, not every {head[POST_EVERY]}")
    if head[POST_KIND] != kind:
        remarks.append(
            f"{line.place}: field 4 of `post`, the kind of results, is {kind}, "
            f"was {head[POST_KIND]}"
        )
    return edits, remarks
