"""An own Marc deck with the waveform in it; all else is kept to the byte.

Changed are: the points of one table; the increments of the load case it drives; the
output request. The depth is put into the table so that what the table is multiplied by
becomes the probe's depth in the deck's unit of length; time is taken to be in s, and to
run on over load cases. Not run in Marc: the deck's grammar was learned from decks that
Mentat wrote.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

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
from decks.own_model import Edit, Rebased, Request, edited, too_far
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
    units = LENGTH_UNITS[request.length_unit or "mm"]
    own = _OwnDeck(read_marc_deck(data), motion, request)
    if units is not MM:
        own.remarks.append(f"one length unit of the deck is {units.length_mm:g} mm")
    mesh = own.deck.coordinates
    sides = np.ptp(mesh.position, axis=0) if mesh.position.size else np.zeros(3)
    own.remarks += too_far(motion, sides.max() * units.length_mm, units, by_heading=False)
    own.put_points(units.length_mm)
    own.put_increments()
    own.put_output(request.results)
    places, axes = {}, 3 if sides[2:3].any() else 2
    for name, node in request.afferents.items():
        place = mesh.of(node)
        if place is None or len(place) < 2:
            problem = f"afferent {name}: node {node} has no coordinates"
            raise DeckError(problem) if mesh.line is None else mesh.line.refuse(problem)
        places[name] = tuple((place[:axes] * units.length_mm).tolist())
    stands_mm = (own.stands or 0.0) * own.factor * units.length_mm
    deck = edited(data, own.edits)
    return Rebased(deck, tuple(own.remarks), places, (), own.start_s, stands_mm, units)


class _Use(NamedTuple):
    """A place where a table is used: `value` times it is what `what` says.

    `moves` says that this is a displacement; `condition` is the condition's name, empty
    for what always acts, and `where` the set it acts on.

    A fixed displacement and a rigid body under position control are their value times
    their table; |value| is the factor that turns the table into a depth. The sign is the
    user's: it says which way is into the skin.
    """

    table: int
    value: float
    what: str
    moves: bool
    line: Line
    condition: str = ""
    where: str = ""

    def acts_in(self, case: LoadCase) -> bool:
        """Whether it is there in a load case."""
        return not self.condition or self.condition in case.active


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
                yield _Use(table, value, what, moves, each.line, each.name, each.where)
    for body in deck.bodies():
        for row, (value, table) in enumerate(body.drives):
            if table and value:
                moves = body.control == POSITION and row < TRANSLATIONS
                what = f"contact body {body.name!r}"
                if not moves:
                    manner = "rotation" if row >= TRANSLATIONS else "velocity or load"
                    what = f"the {manner} of {what}"
                yield _Use(table, value, what, moves, body.line)


class _OwnDeck:
    """What of a deck is changed: a `table`, what it `drives`, and the load case `case`.

    `factor` turns the table into a depth; the load case starts at `start_s`, when the table
    has come to `stands`, None where it moved nothing before. `edits` and `remarks` grow.
    """

    def __init__(self, deck: MarcDeck, motion: Motion, request: Request) -> None:
        self.deck, self.motion = deck, motion
        self.edits = list[Edit]()
        self.table, uses = _driving_table(deck, request.amplitude)
        self.cases = deck.load_cases()
        self.case = _chosen_case(self.cases, request.step, uses)
        self.before = self.cases[: self.case.number - 1]
        self.start_s = 0.0
        for each in self.before:
            if each.period is None:
                words = f"load case {each.number} {each.name!r} comes before the waveform, but"
                words += " `auto load` or `auto step` does not say how long it takes"
                raise each.line.refuse(words)
            self.start_s += each.period
        self.drives = [use for use in uses if use.acts_in(self.case)]
        table, first = self.table, self.drives[0]
        self.factor = abs(first.value)
        for use in self.drives:
            words = f"table {table.name!r} drives {use.what} with factor {use.value:g}, but"
            words += f" {first.what} ({first.line.place}) with {first.value:g}: which is the probe?"
            use.line.check(abs(use.value) == self.factor, words)
        self.remarks = [*deck.remarks, f"{table.line.place}: table {table.name!r} is the waveform"]
        self.remarks += [
            f"{use.line.place}: it drives {use.what}, factor {use.value:g}" for use in self.drives
        ]
        if self.factor != 1.0:
            words = f"the table holds depth divided by {self.factor:g}"
            self.remarks.append(f"{first.line.place}: {words}")
        self.stands = self._standing()

    @property
    def words(self) -> str:
        """Number and name of the load case."""
        return f"load case {self.case.number}" + f" {self.case.name!r}" * bool(self.case.name)

    def _standing(self) -> float | None:
        """What the table has come to when the load case starts."""
        if any(use.acts_in(each) for each in self.before for use in self.drives):
            assert self.table.points is not None
            return float(np.interp(self.start_s, *self.table.points.T))
        active = {name for each in self.before for name in each.active}
        sets = {use.where for use in self.drives if use.where}
        for each in self.deck.conditions():
            if each.family == FIXED_DISPLACEMENT and each.name in active and each.where in sets:
                words = f"`{each.family}` {each.name!r} moves {each.where!r} in a load case before,"
                words += f" so where {self.words} finds it is not known; drive it by one table in "
                each.line.check(not any(value for value, _, _ in each.drives), f"{words}both")
        return None

    def put_points(self, length_mm: float) -> None:
        """Put time and depth into the table, from when the load case starts.

        Where the table moves something before, it stays as it was until then.
        """
        table, unit_mm, stands = self.table, length_mm * self.factor, self.stands
        times_s = (self.motion.time_s + self.start_s).tolist()
        depths = (self.motion.depth_mm / unit_mm + (stands or 0.0)).tolist()
        points = list(zip(times_s, depths, strict=True))
        if self.start_s > 0:
            before = [] if stands is None or table.points is None else table.points.tolist()
            before = [(t, v) for t, v in before if t < self.start_s] or [(0.0, depths[0])]
            points = [*before, *points]
            if stands:
                self.remarks.append(
                    f"{table.line.place}: the load cases before leave the probe "
                    f"{stands * unit_mm:g} mm deep; the waveform begins there"
                )
            words = f"the waveform starts at {self.start_s:g} s, when {self.words} does"
            self.remarks.append(f"{table.line.place}: {words}")
        after = next((each for each in self.cases[self.case.number :] if each.stepping), None)
        if after is not None:
            self.remarks.append(
                f"{after.line.place}: load case {after.number} follows: behind its last "
                "point the table goes on as its second line says"
            )
        _, counts, first, *others = table.rows
        free = table.rows[-1].free
        self._instead(counts, counts.with_integer(1, len(points)))
        self._instead(first, *(reals_line(each, first.layout, free=free) for each in points))
        for line in others:
            self._instead(line)

    def put_increments(self) -> None:
        """Make the load case `motion.increments` of `motion.dt_s`."""
        option, time_step, motion = self.case.stepping, self.case.time_step, self.motion
        assert option is not None
        counted = f"{motion.increments} increments of {motion.dt_s:g} s"
        option.head.check(
            option.keyword in (FIXED, ADAPTIVE),
            f"{self.words} steps by `{option.keyword}`, which is not changed here; "
            f"expected `{FIXED}` or `{ADAPTIVE}`",
        )
        first, *others = option.data
        added = ["time step", reals_line([motion.dt_s], first.layout, free=first.free)]
        if time_step is not None:
            self._instead(time_step.data[0], _with_first_real(time_step.data[0], motion.dt_s))
            added = []
        if option.keyword == FIXED:
            self._before(option.head, *added)
            self._instead(first, first.with_integer(0, motion.increments))
            self.remarks.append(f"{option.head.place}: {self.words}: {counted}")
        else:
            numbers = [motion.increments, 0, _CUT_BACKS]
            if (self.deck.version or 0) >= _NEWER_VERSION:
                numbers += [0, 0]
            lines = [FIXED, integers_line(numbers, first.layout, free=first.free), *added]
            if option.head.text.isupper():
                lines = [line.upper() for line in lines]
            self._instead(option.head, *lines)
            for line in (first, *others):
                self._instead(line)
            words = f"`{ADAPTIVE}` became `{FIXED}`, {counted}"
            self.remarks.append(f"{option.head.place}: {self.words}: {words}")
        # Let `control` allow all increments; whether it counts a case or all is open.
        needed = motion.increments + sum(each.increments or 0 for each in self.before)
        for line in self._first_lines("control", Section.MODEL, Section.HISTORY):
            (most,) = line.fields("i")
            if 0 < most < needed:
                self._instead(line, line.with_integer(0, _MANY_INCREMENTS))
                words = f"`control` allowed {most} increments, now {_MANY_INCREMENTS}"
                self.remarks.append(f"{line.place}: {words}")

    def put_output(self, results: str | None) -> None:
        """Ask for stress and von Mises stress at every increment of the load case.

        Other quantities stay as they are; so does the kind of results where it is None.
        """
        found = self.deck.post()
        if found is not None:
            self._change_post(
                found, found.head[POST_KIND] if results is None else POST_KINDS[results]
            )
        else:
            end = self.deck.find("end option")[0].head
            self._before(end, *post_lines(_WANTED, POST_KINDS[results or "binary"], end.layout))
            words = f"`post` put before it, with codes {VON_MISES}, {STRESS}"
            self.remarks.append(f"{end.place}: {words}")
        for line in self._first_lines("post increment", Section.HISTORY)[-1:]:
            if (count := line.first_integer()) not in (0, 1):
                self._instead(line, line.with_integer(0, 1))
                words = f"`post increment` every increment, not every {count}"
                self.remarks.append(f"{line.place}: {words}")

    def _change_post(self, found: Post, kind: int) -> None:
        line, head = found.line, found.head
        missing = [code for code in _WANTED if code not in found.codes]
        text, every = line.text, head[POST_EVERY]
        for row, new in (
            (POST_COUNT, len(found.codes) + len(missing)),
            (POST_KIND, kind),
            (POST_EVERY, 1),
        ):
            if new != head[row]:
                text = line._replace(text=text).with_integer(row, new)
        *_, last = (line, *found.code_lines)
        added = [integers_line((code, 0), line.layout, free=last.free) for code in missing]
        self._instead(line, text, *(added if last is line else ()))
        if last is not line:
            self._instead(last, last.text, *added)
        for changed, words in (
            (missing, f"`post` also asks for codes {', '.join(map(str, missing))}"),
            (every not in (0, 1), f"`post` every increment, not every {every}"),
            (
                head[POST_KIND] != kind,
                f"field 4 of `post`, the kind of results, is {kind}, was {head[POST_KIND]}",
            ),
        ):
            if changed:
                self.remarks.append(f"{line.place}: {words}")

    def _first_lines(self, keyword: str, *sections: Section) -> list[Line]:
        """The first data line of each such option up to the load case."""
        options = [option for each in sections for option in self.deck.find(keyword, each)]
        number = self.case.number
        return [option.data[0] for option in options if option.case <= number and option.data]

    def _instead(self, line: Line, *texts: str) -> None:
        """Put `texts`, each a line, in the place of `line`; none takes it out."""
        self._before(line, *texts)
        self.edits[-1] = self.edits[-1]._replace(stop=line.stop)

    def _before(self, line: Line, *texts: str) -> None:
        """Put lines before `line`, with the line end that it has."""
        end = "\r\n" if line.stop - line.start - len(line.text) == 2 else "\n"
        new = "".join(text + end for text in texts).encode("latin-1")
        self.edits.append(Edit(line.start, line.start, new))


def _driving_table(deck: MarcDeck, name: str | None) -> tuple[MarcTable, list[_Use]]:
    """The table that is named, or the only one that moves something, and its uses."""
    uses = list(_uses(deck))
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
    mine = [use for use in uses if use.table == table.number]
    for use in mine:
        words = f"table {table.name!r} ({table.line.place}) also drives {use.what}, which is no"
        use.line.check(use.moves, f"{words} displacement: give the motion a table of its own")
    whole = table.points is not None and table.points.size > 0 and table.variable == TIME
    table.line.check(
        bool(mine) and whole,
        f"table {table.name!r} is no waveform: expected points of time and value, in the deck "
        "itself, that drive a fixed displacement or a contact body",
    )
    return table, mine


def _names(tables: Sequence[MarcTable]) -> str:
    return ", ".join(f"{table.name} ({table.line.place})" for table in tables)


def _chosen_case(cases: Sequence[LoadCase], wanted: str | None, uses: Sequence[_Use]) -> LoadCase:
    """The load case that is wanted, or the only one in which there is motion."""
    moving = [case for case in cases if case.stepping and any(use.acts_in(case) for use in uses)]
    if wanted is not None:
        word = wanted.strip().lower()
        named = [case for case in moving if case.name.lower() == word]
        moving = named or [case for case in moving if str(case.number) == word]
    if len(moving) == 1:
        return moving[0]
    asked = "" if wanted is None else f" {wanted!r}"
    there = [f"{case.number} {case.name} ({case.line.place})" for case in moving or cases]
    problem = (
        f"{len(moving)} load cases{asked} with increments in which {uses[0].what} "
        f"({uses[0].line.place}) acts, expected one: --step names it; there: "
        f"{', '.join(there) or 'none'}"
    )
    at = moving[1:] or cases
    raise at[0].line.refuse(problem) if at else DeckError(problem)


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
