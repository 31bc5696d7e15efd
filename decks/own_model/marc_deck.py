"""A Marc base deck with a new waveform; all other bytes are kept.

Changed are: the points of one table; the increments of the load case it drives; the
output request. The depth is put into the table so that what the table is multiplied by
becomes the probe's depth in the deck's unit of length; time is taken to be in s, and to
run on over load cases. Not run in Marc: the deck's grammar was learned from decks that
Mentat wrote.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from decks.marc.contents import (
    ADAPTIVE,
    DISTRIBUTED_LOAD,
    FIXED,
    FIXED_DISPLACEMENT,
    POINT_LOAD,
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
    FileSection,
    Layout,
    Line,
    format_free,
    format_real,
    integers_line,
    reals_line,
)
from decks.motion import Motion
from decks.own_model import (
    AfferentSite,
    Edit,
    Rebased,
    Request,
    apply_edits,
    size_warnings,
    units_per_mm,
)
from decks.unit_system import LENGTH_UNITS, MM
from fembridge.errors import DeckError

_REQUIRED_CODES = (VON_MISES, STRESS)
_MAX_INCREMENTS = 99999  # what Mentat writes as the largest count
# Options by which stress depends on time, or may depend on earlier depths.
_TIMED = {
    "creep": "creep depends on time",
    "dynamic": "inertia depends on acceleration",
    "dynamic ch": "inertia depends on acceleration",
    "viscelprop": "skin relaxes",
    "viscelmoon": "skin relaxes",
    "viscelogde": "skin relaxes",
}
_PATH_DEPENDENT = {
    "work hard": "yielding is permanent",
    "con intera": "contact may have friction",
    "damage": "damage is permanent",
}
_MAX_CUT_BACKS = 10  # how often an increment may be cut, Mentat's default
_NEWER_VERSION = 14  # of those seen, the first with five numbers in `auto load`


def rebase_marc(data: bytes, motion: Motion, request: Request) -> Rebased:
    """A Marc deck with `motion` in it.

    Raises
    ------
    DeckError
        A requested entry is missing or ambiguous; the message names the lines.
    """
    if request.move is not None or request.increments != "fixed" or request.all_nodes:
        argument = "move" if request.move is not None else "all_nodes"
        argument = "increments" if request.increments != "fixed" else argument
        raise DeckError(
            "is for CalculiX and Abaqus: a Marc deck has its motion in a table (--amplitude names "
            "it), cuts increments of `auto load` itself, and writes all nodes",
            argument=argument,
        )
    units = LENGTH_UNITS[request.length_unit or "mm"]
    editor = _DeckEditor(read_marc_deck(data), motion, request)
    if units is not MM:
        editor.remarks.append(f"one length unit of the deck is {units.length_mm:g} mm")
    mesh = editor.deck.coordinates
    sides = np.ptp(mesh.position, axis=0) if mesh.position.size else np.zeros(3)
    if request.load is None:
        size_mm = sides.max() * units.length_mm
        editor.remarks += size_warnings(motion, size_mm, units, by_heading=False)
    per_mm = units_per_mm(units, request.load)
    editor.write_points(per_mm)
    editor.write_increments()
    editor.write_output(request.results)
    sites, axes = {}, 3 if sides[2:3].any() else 2
    for name, node in request.afferents.items():
        position = mesh.position_of(node)
        if position is None or len(position) < 2:
            problem = f"afferent {name}: node {node} has no coordinates"
            raise DeckError(problem) if mesh.line is None else mesh.line.error(problem)
        numbers = materials_at(editor.deck, node)
        if len(numbers) > 1:
            names = {item.number: item.name for item in editor.deck.materials()}
            listed = " and ".join(names.get(number, str(number)) for number in numbers)
            raise DeckError(
                f"afferent {name}: node {node} is between the materials {listed}, whose stress "
                "differs; choose a node inside one"
            )
        sites[name] = AfferentSite(tuple((position[:axes] * units.length_mm).tolist()))
    stands_mm = (editor.start_value or 0.0) * editor.factor / per_mm
    deck = apply_edits(data, editor.edits)
    return Rebased(
        deck,
        tuple(editor.remarks),
        sites,
        (),
        editor.start_s,
        stands_mm,
        units,
        time_dependent=tuple(_options_in(editor.deck, _TIMED)),
        path_dependent=tuple(_options_in(editor.deck, _PATH_DEPENDENT)),
    )


def _options_in(deck: MarcDeck, keywords: Mapping[str, str]) -> list[str]:
    """The options of `keywords` in a deck, each with its line and meaning."""
    return [
        f"{option.head.location}: `{option.keyword}`: {keywords[option.keyword]}"
        for option in deck.options
        if option.keyword in keywords
    ]


def materials_at(deck: MarcDeck, node: int) -> list[int]:
    """Numbers of the materials of the elements at `node`, as far as the mesh states them."""
    numbers = (item.material for item in deck.elements if (item.node == node).any())
    return [number for number in dict.fromkeys(numbers) if number]


class TableUse(NamedTuple):
    """A use of a table: `value` times the table is the quantity `target`.

    `moves` says that this is a displacement; `condition` is the condition's name, empty
    for a body, which always acts, and `set_name` the set it acts on.

    A fixed displacement and a rigid body under position control are their value times
    their table; |value| is the factor that turns the table into a depth. The sign is the
    user's: it says which way is into the skin. `quantity` is displacement, force or pressure, ""
    of anything else; `axis` that of a force, from 0.
    """

    table: int
    value: float
    target: str
    moves: bool
    line: Line
    condition: str = ""
    set_name: str = ""
    quantity: str = ""
    axis: int = 0

    def acts_in(self, case: LoadCase) -> bool:
        """Whether it is there in a load case."""
        return not self.condition or self.condition in case.active


def table_uses(deck: MarcDeck) -> Iterator[TableUse]:
    """All uses of tables that the grammar can see."""
    for condition in deck.conditions():
        displacement = condition.family == FIXED_DISPLACEMENT
        for row, (value, table, direction) in enumerate(condition.drives):
            if table and (value or not displacement):
                target = f"`{condition.family}` {condition.name!r}"
                if rotates := direction > TRANSLATIONS:
                    target = f"degree of freedom {direction} of {target}"
                moves = displacement and not rotates
                quantity = "displacement" if moves else ""
                if condition.family == POINT_LOAD and row < TRANSLATIONS:
                    quantity = "force"
                elif condition.family == DISTRIBUTED_LOAD and condition.kind == 0 and row == 0:
                    quantity = "pressure"
                yield TableUse(
                    table,
                    value,
                    target,
                    moves,
                    condition.line,
                    condition.name,
                    condition.set_name,
                    quantity,
                    row,
                )
    for body in deck.bodies():
        for row, (value, table) in enumerate(body.drives):
            if table and value:
                moves = body.control == POSITION and row < TRANSLATIONS
                target = f"contact body {body.name!r}"
                if not moves:
                    quantity = "rotation" if row >= TRANSLATIONS else "velocity or load"
                    target = f"the {quantity} of {target}"
                quantity = "displacement" if moves else ""
                yield TableUse(table, value, target, moves, body.line, quantity=quantity)


class _DeckEditor:
    """Editor of a Marc deck: a `table`, its uses (`drives`), and the load case `case`.

    Depth is the table times `factor`. The load case starts at `start_s`, when the value of the
    table is `start_value`; None if the table moved nothing before. The editor collects `edits`
    and `remarks`.
    """

    def __init__(self, deck: MarcDeck, motion: Motion, request: Request) -> None:
        self.deck, self.motion = deck, motion
        self.edits = list[Edit]()
        self.load = request.load
        quantity = "displacement" if request.load is None else request.load.quantity
        self.table, uses = _driving_table(deck, request.amplitude, quantity)
        self.cases = deck.load_cases()
        self.case = _select_case(self.cases, request.step, uses)
        self.before = self.cases[: self.case.number - 1]
        self.start_s = 0.0
        for case in self.before:
            if case.period is None:
                message = f"load case {case.number} {case.name!r} comes before the waveform, but"
                message += " `auto load` or `auto step` does not say how long it takes"
                raise case.line.error(message)
            self.start_s += case.period
        self.drives = [use for use in uses if use.acts_in(self.case)]
        table, first = self.table, self.drives[0]
        self.factor = abs(first.value)
        if quantity == "force":
            self.factor = _total_force(deck, self.drives)
        for use in self.drives if quantity != "force" else ():
            message = f"table {table.name!r} drives {use.target} with factor {use.value:g}, but"
            message += (
                f" {first.target} ({first.line.location}) with {first.value:g}: which is the probe?"
            )
            use.line.check(abs(use.value) == self.factor, message)
        self.remarks = [
            *deck.remarks,
            f"{table.line.location}: table {table.name!r} is the waveform",
        ]
        self.remarks += [
            f"{use.line.location}: it drives {use.target}, factor {use.value:g}"
            for use in self.drives
        ]
        if self.load is not None:
            message = f"{quantity} of {self.factor:g} (of the deck) where the table is 1"
            scale = f"one um of the waveform is {self.load.per_um:g} {self.load.unit}"
            self.remarks.append(f"{first.line.location}: {message}; {scale}")
        elif self.factor != 1.0:
            message = f"the table holds depth divided by {self.factor:g}"
            self.remarks.append(f"{first.line.location}: {message}")
        self.start_value = self._start_value()

    @property
    def case_text(self) -> str:
        """Number and name of the load case."""
        return f"load case {self.case.number}" + f" {self.case.name!r}" * bool(self.case.name)

    def _start_value(self) -> float | None:
        """Value of the table when the load case starts; None if it moved nothing before."""
        if any(use.acts_in(item) for item in self.before for use in self.drives):
            assert self.table.points is not None
            return float(np.interp(self.start_s, *self.table.points.T))
        active = {name for item in self.before for name in item.active}
        sets = {use.set_name for use in self.drives if use.set_name}
        for item in self.deck.conditions():
            if item.family == FIXED_DISPLACEMENT and item.name in active and item.set_name in sets:
                message = (
                    f"`{item.family}` {item.name!r} moves {item.set_name!r} in a load case before,"
                )
                message += (
                    f" so where {self.case_text} finds it is not known; drive it by one table in "
                )
                item.line.check(not any(value for value, _, _ in item.drives), f"{message}both")
        return None

    def write_points(self, per_mm: float) -> None:
        """Put time and depth into the table, from when the load case starts.

        `per_mm` units of the deck are one mm of the waveform. Where the table moves something
        before, it stays as it was until then.
        """
        table, start_value = self.table, self.start_value
        times_s = (self.motion.time_s + self.start_s).tolist()
        depths = (self.motion.depth_mm * per_mm / self.factor + (start_value or 0.0)).tolist()
        points = list(zip(times_s, depths, strict=True))
        if self.start_s > 0:
            before = [] if start_value is None or table.points is None else table.points.tolist()
            before = [(t, v) for t, v in before if t < self.start_s] or [(0.0, depths[0])]
            points = [*before, *points]
            if start_value:
                left = f"the probe {start_value * self.factor / per_mm:g} mm deep"
                if self.load is not None:
                    left = f"the table at {start_value:g}"
                self.remarks.append(
                    f"{table.line.location}: the load cases before leave {left}; the waveform "
                    "begins there"
                )
            message = f"the waveform starts at {self.start_s:g} s, when {self.case_text} does"
            self.remarks.append(f"{table.line.location}: {message}")
        after = next((item for item in self.cases[self.case.number :] if item.stepping), None)
        if after is not None:
            self.remarks.append(
                f"{after.line.location}: load case {after.number} follows: behind its last "
                "point the table goes on as its second line says"
            )
        _, counts, first, *others = table.rows
        free = table.rows[-1].free
        self._replace_line(counts, counts.with_integer(1, len(points)))
        self._replace_line(first, *(reals_line(item, first.layout, free=free) for item in points))
        for line in others:
            self._replace_line(line)

    def write_increments(self) -> None:
        """Make the load case `motion.increments` of `motion.dt_s`."""
        option, time_step, motion = self.case.stepping, self.case.time_step, self.motion
        assert option is not None
        increments_text = f"{motion.increments} increments of {motion.dt_s:g} s"
        option.head.check(
            option.keyword in (FIXED, ADAPTIVE),
            f"{self.case_text} steps by `{option.keyword}`, which is not changed here; "
            f"expected `{FIXED}` or `{ADAPTIVE}`",
        )
        first, *others = option.data
        time_step_lines = ["time step", reals_line([motion.dt_s], first.layout, free=first.free)]
        if time_step is not None:
            self._replace_line(time_step.data[0], _with_first_real(time_step.data[0], motion.dt_s))
            time_step_lines = []
        if option.keyword == FIXED:
            self._insert_before(option.head, *time_step_lines)
            self._replace_line(first, first.with_integer(0, motion.increments))
            self.remarks.append(f"{option.head.location}: {self.case_text}: {increments_text}")
        else:
            numbers = [motion.increments, 0, _MAX_CUT_BACKS]
            if (self.deck.version or 0) >= _NEWER_VERSION:
                numbers += [0, 0]
            lines = [FIXED, integers_line(numbers, first.layout, free=first.free), *time_step_lines]
            if option.head.text.isupper():
                lines = [line.upper() for line in lines]
            self._replace_line(option.head, *lines)
            for line in (first, *others):
                self._replace_line(line)
            message = f"`{ADAPTIVE}` became `{FIXED}`, {increments_text}"
            self.remarks.append(f"{option.head.location}: {self.case_text}: {message}")
        # Let `control` allow all increments; whether it counts a case or all is open.
        needed = motion.increments + sum(case.increments or 0 for case in self.before)
        for line in self._first_lines("control", FileSection.MODEL, FileSection.HISTORY):
            (limit,) = line.fields("i")
            if 0 < limit < needed:
                self._replace_line(line, line.with_integer(0, _MAX_INCREMENTS))
                message = f"`control` allowed {limit} increments, now {_MAX_INCREMENTS}"
                self.remarks.append(f"{line.location}: {message}")

    def write_output(self, results: str | None) -> None:
        """Ask for stress and von Mises stress at every increment of the load case.

        Other quantities stay as they are; so does the kind of results where it is None.
        """
        post = self.deck.post()
        if post is not None:
            self._change_post(
                post, post.head[POST_KIND] if results is None else POST_KINDS[results]
            )
        else:
            end = self.deck.find("end option")[0].head
            self._insert_before(
                end, *post_lines(_REQUIRED_CODES, POST_KINDS[results or "binary"], end.layout)
            )
            message = f"`post` put before it, with codes {VON_MISES}, {STRESS}"
            self.remarks.append(f"{end.location}: {message}")
        for line in self._first_lines("post increment", FileSection.HISTORY)[-1:]:
            if (count := line.first_integer()) not in (0, 1):
                self._replace_line(line, line.with_integer(0, 1))
                message = f"`post increment` every increment, not every {count}"
                self.remarks.append(f"{line.location}: {message}")

    def _change_post(self, post: Post, kind: int) -> None:
        line, head = post.line, post.head
        missing = [code for code in _REQUIRED_CODES if code not in post.codes]
        text, interval = line.text, head[POST_EVERY]
        for row, value in (
            (POST_COUNT, len(post.codes) + len(missing)),
            (POST_KIND, kind),
            (POST_EVERY, 1),
        ):
            if value != head[row]:
                text = line._replace(text=text).with_integer(row, value)
        *_, last = (line, *post.code_lines)
        added = [integers_line((code, 0), line.layout, free=last.free) for code in missing]
        self._replace_line(line, text, *(added if last is line else ()))
        if last is not line:
            self._replace_line(last, last.text, *added)
        for changed, message in (
            (missing, f"`post` also asks for codes {', '.join(map(str, missing))}"),
            (interval not in (0, 1), f"`post` every increment, not every {interval}"),
            (
                head[POST_KIND] != kind,
                f"field 4 of `post`, the kind of results, is {kind}, was {head[POST_KIND]}",
            ),
        ):
            if changed:
                self.remarks.append(f"{line.location}: {message}")

    def _first_lines(self, keyword: str, *sections: FileSection) -> list[Line]:
        """The first data line of each such option up to the load case."""
        options = [option for section in sections for option in self.deck.find(keyword, section)]
        number = self.case.number
        return [option.data[0] for option in options if option.case <= number and option.data]

    def _replace_line(self, line: Line, *texts: str) -> None:
        """Replace `line` by the lines `texts`; without texts it is removed."""
        self._insert_before(line, *texts)
        self.edits[-1] = self.edits[-1]._replace(stop=line.stop)

    def _insert_before(self, line: Line, *texts: str) -> None:
        """Put lines before `line`, with the line end that it has."""
        end = "\r\n" if line.stop - line.start - len(line.text) == 2 else "\n"
        new = "".join(text + end for text in texts).encode("latin-1")
        self.edits.append(Edit(line.start, line.start, new))


def _total_force(deck: MarcDeck, uses: Sequence[TableUse]) -> float:
    """The size of the sum of point loads on all nodes of their sets, where the table is 1."""
    total, sets = np.zeros(TRANSLATIONS), deck.sets()
    for use in uses:
        count = sets[use.set_name].member.size if use.set_name in sets else 0
        use.line.check(count > 0, f"the set {use.set_name!r} of {use.target} has no nodes")
        total[use.axis] += use.value * count
    size = float(np.linalg.norm(total))
    uses[0].line.check(size > 0, "the point loads cancel, and no waveform can scale their sum")
    return size


_DRIVEN = {
    "displacement": "a fixed displacement or the position of a contact body",
    "force": "a point load",
    "pressure": "a distributed load that is a pressure",
}


def _driving_table(
    deck: MarcDeck, name: str | None, quantity: str
) -> tuple[MarcTable, list[TableUse]]:
    """The table `name`, or the only one that drives a `quantity`, and its uses."""
    uses = list(table_uses(deck))
    if name is None:
        problem = f"no table drives {_DRIVEN[quantity]}"
        moving = {use.table for use in uses if use.quantity == quantity}
        tables = [table for table in deck.tables if table.number in moving]
    else:
        problem, name_text = f"no table {name!r}", name.strip()
        tables = [table for table in deck.tables if table.name == name_text]
        tables = tables or [
            table for table in deck.tables if table.name.lower() == name_text.lower()
        ]
    if not tables:
        tables_text = f"has tables {_list_tables(deck.tables)}" if deck.tables else "has no tables"
        raise DeckError(f"{problem}; the deck {tables_text}{_load_hint(uses)}", found=name)
    if len(tables) > 1:
        problem_text = "drive a motion; name one" if name is None else f"are named {name!r}"
        raise tables[1].line.error(f"{len(tables)} tables {problem_text}: {_list_tables(tables)}")
    (table,) = tables
    same_number = [other for other in deck.tables if other.number == table.number]
    message = f"{len(same_number)} tables have number {table.number}: {_list_tables(same_number)}"
    same_number[-1].line.check(len(same_number) == 1, message)
    of_table = [use for use in uses if use.table == table.number]
    for use in of_table:
        message = (
            f"table {table.name!r} ({table.line.location}) also drives {use.target}, which is not a"
        )
        hint = "" if quantity != "displacement" else _load_hint([use])
        use.line.check(
            use.quantity == quantity,
            f"{message} {quantity}: give the waveform a table of its own{hint}",
        )
    is_waveform = table.points is not None and table.points.size > 0 and table.variable == TIME
    table.line.check(
        bool(of_table) and is_waveform,
        f"table {table.name!r} is not a waveform: expected points of time and value, in the deck "
        "itself, that drive a fixed displacement or a contact body",
    )
    return table, of_table


def _load_hint(uses: Sequence[TableUse]) -> str:
    """How a deck is driven by its load; "" without a load."""
    options = {"force": "--newton-per-um K", "pressure": "--mpa-per-um K"}
    for use in uses:
        if use.quantity in options:
            return f"; {use.target} takes the waveform by {options[use.quantity]}"
    return ""


def _list_tables(tables: Sequence[MarcTable]) -> str:
    return ", ".join(f"{table.name} ({table.line.location})" for table in tables)


def _select_case(
    cases: Sequence[LoadCase], requested: str | None, uses: Sequence[TableUse]
) -> LoadCase:
    """The requested load case, or the only one with motion."""
    moving = [case for case in cases if case.stepping and any(use.acts_in(case) for use in uses)]
    if requested is not None:
        name = requested.strip().lower()
        by_name = [case for case in moving if case.name.lower() == name]
        moving = by_name or [case for case in moving if str(case.number) == name]
    if len(moving) == 1:
        return moving[0]
    requested_text = "" if requested is None else f" {requested!r}"
    listed = [f"{case.number} {case.name} ({case.line.location})" for case in moving or cases]
    problem = (
        f"{len(moving)} load cases{requested_text} with increments in which {uses[0].target} "
        f"({uses[0].line.location}) acts, expected one: --step names it; there: "
        f"{', '.join(listed) or 'none'}"
    )
    lines = moving[1:] or cases
    raise lines[0].line.error(problem) if lines else DeckError(problem)


def _with_first_real(line: Line, value: float) -> str:
    """The text of a line of reals with `value` in its first field."""
    if line.free:
        return ",".join([format_free(value), *line.text.split(",")[1:]])
    rest = line.text[line.layout.real :]
    if line.layout is Layout.EXTENDED:
        return format_real(value) + rest
    message = f"{value!r} does not fit into ten columns; put a comma behind the number"
    line.check(not rest.strip(), message)
    return reals_line([value], line.layout)
