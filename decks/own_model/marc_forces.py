"""A Marc deck with small forces on nodes, one after the other, about its state after load cases.

Marc has no linear response about a loaded state, so each force is an increment of its own: a pulse
of a table, from 0 to the force and back. The load cases before stay; those after are removed.
Tables of time keep their value of that moment. Increments without force come first, in which the
residual of the state fades, and last, to show what the forces left behind. Some forces come again
with the other sign: the sum of both responses is what is not linear in them. Not run in Marc.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from decks.marc.contents import (
    ADAPTIVE,
    FIXED,
    POINTS,
    POSITION,
    POST_KINDS,
    TIME,
    TRANSLATIONS,
    Body,
    LoadCase,
    MarcDeck,
    MarcTable,
    post_lines,
)
from decks.marc.grammar import FileSection, Layout, Line, MarcOption, integers_line, reals_line
from decks.marc.solid_model import held_names
from decks.own_model import Edit, apply_edits
from fembridge.errors import DeckError
from fembridge.typing import FloatArray, IntArray

SETTLING = 3
"""Increments without force at the beginning; the last of them is the reference."""
STEP_S = 1.0
"""Time of an increment in s."""
CASE_NAME = "fembridge_forces"
_CAUCHY_STRESS, _STRESS, _DISPLACEMENT = 341, 311, 1
_TOLERANCE = 1e-3
_MAX_CUT_BACKS = 10
_MAX_INCREMENTS = 99999
_NEWER_VERSION = 14
_NODAL_FIELD = 12
_SIXTEEN_FROM = 15  # input version with 16 integers in the second line of a table, else 12
# Options by which a state depends on its past, or on time.
_REFUSED = {
    "creep": "creep depends on time",
    "dynamic": "inertia depends on acceleration",
    "dynamic ch": "inertia depends on acceleration",
    "viscelprop": "skin relaxes",
    "viscelmoon": "skin relaxes",
    "viscelogde": "skin relaxes",
    "work hard": "yielding is permanent",
    "damage": "damage is permanent",
    "orientatio": "stress is along axes of the material",
    "orientation": "stress is along axes of the material",
}
# Options of a load case that are written anew.
_OWN_OF_A_CASE = (
    "title", "loadcase", "post increment", "continue", FIXED, ADAPTIVE, "time step",
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class MarcState:
    """A deck after load case `after_case` (0: undeformed), which ends at `start_s`.

    `active` are the names of the conditions that act there; `case` is the load case whose options
    the forces take, None in a deck without.
    """

    deck: MarcDeck
    after_case: int
    start_s: float
    active: tuple[str, ...]
    case: LoadCase | None


def marc_state(deck: MarcDeck, after_case: int) -> MarcState:
    """The state of a deck after load case `after_case`, from 1; 0: the undeformed model.

    Raises
    ------
    DeckError
        No such load case, one of unknown length, or an option by which the state depends on its
        past or on time.
    """
    for option in deck.options:
        if option.keyword in _REFUSED:
            reason = _REFUSED[option.keyword]
            raise option.head.error(f"`{option.keyword}`: {reason}, which is not linearised")
    cases = deck.load_cases()
    if not 0 <= after_case <= len(cases):
        problem = f"is {after_case}, but the deck has {len(cases)} load cases"
        raise DeckError(problem, argument="after_step", found=after_case)
    start_s = 0.0
    for kept in cases[:after_case]:
        if kept.period is None:
            raise kept.line.error(f"load case {kept.number} {kept.name!r} does not say how long")
        start_s += kept.period
    case = cases[max(after_case, 1) - 1] if cases else None
    active = case.active if case is not None and after_case else tuple(held_names(deck, case))
    return MarcState(deck, after_case, start_s, active, case)


def pulse_times_s(state: MarcState, count: int) -> FloatArray:
    """Times of the reference, of `count` forces, and of the last increment: ``(count + 2,)``."""
    return state.start_s + STEP_S * (SETTLING + np.arange(count + 2, dtype=np.float64))


def marc_force_deck(data: bytes, state: MarcState, forces: IntArray, force: FloatArray) -> bytes:
    """A deck for Marc with the `forces` in turn.

    Parameters
    ----------
    data
        The user's deck.
    state
        Its state.
    forces
        Node and axis (1 to 3) of each, ``(K, 2)``; a node and axis may come again.
    force
        Size of each in the deck's unit, with sign, ``(K,)``.

    Raises
    ------
    DeckError
        A condition or contact body whose table cannot be held.
    """
    writer = _Writer(state, forces, force)
    return apply_edits(data, writer.edits())


class _Writer:
    """Edits of a deck: tables and conditions of the forces, and their load case."""

    def __init__(self, state: MarcState, forces: IntArray, force: FloatArray) -> None:
        self._state, self._deck = state, state.deck
        self._layout = next(
            (Layout.EXTENDED for o in self._deck.options if o.keyword == "extended"), Layout.FIXED
        )
        self._times_s = pulse_times_s(state, len(forces))
        self._scale = float(np.abs(force).max())
        self._pulses: dict[int, dict[int, list[tuple[float, float]]]] = {}
        for (node, axis), size, time_s in zip(
            forces.tolist(), force.tolist(), self._times_s[1:-1].tolist(), strict=True
        ):
            by_axis = self._pulses.setdefault(node, {})
            by_axis.setdefault(axis, []).append((time_s, size / self._scale))

    def edits(self) -> list[Edit]:
        """All edits."""
        deck, state = self._deck, self._state
        edits = [edit for table in deck.tables for edit in self._held_table(table)]
        if not state.after_case:
            edits += self._zeroed_displacements()
        for option in deck.find("post"):
            edits.append(_removed(option))
        end = deck.find("end option")[0].head
        edits.append(_before(end, [*self._conditions(), *self._post()]))
        for option in deck.find("control"):
            line = option.data[0]
            edits.append(_replaced(line, [_with_most_increments(line)]))
        for body in deck.bodies():
            self._check_body(body)
        later = [
            option
            for option in deck.options
            if option.section is FileSection.HISTORY and option.case > state.after_case
        ]
        case_lines = list(self._load_case())
        if later:
            start = later[0].lines[0].start
            text = _encoded(case_lines, end)
            edits.append(Edit(start, later[-1].lines[-1].stop, text))
        else:
            last = deck.options[-1].lines[-1]
            edits.append(Edit(last.stop, last.stop, _encoded(case_lines, end)))
        return edits

    def _held_table(self, table: MarcTable) -> Iterator[Edit]:
        """Edits that keep the value of a table of time from the state on."""
        uses = [item.name for item in self._acting() if table.number in item.tables]
        if not uses:
            return
        if table.variable != TIME or table.points is None:
            raise table.line.error(
                f"table {table.name!r} drives {uses[0]!r}, expected points of time and value"
            )
        start_s = self._state.start_s
        value = float(np.interp(start_s, *table.points.T))
        points = [(t, v) for t, v in table.points.tolist() if t < start_s]
        points += [(start_s, value), (start_s + STEP_S, value)]
        _, counts, first, *others = table.rows
        yield _replaced(counts, [counts.with_integer(1, len(points))])
        free = table.rows[-1].free
        yield _replaced(first, [reals_line(point, first.layout, free=free) for point in points])
        for line in others:
            yield _replaced(line, [])

    def _acting(self) -> "Iterator[_Driven]":
        """Conditions and bodies that act during the forces, and their tables."""
        for condition in self._deck.conditions():
            if condition.name in self._state.active:
                yield _Driven(condition.name, {table for _, table, _ in condition.drives if table})
        for body in self._deck.bodies():
            yield _Driven(body.name, {table for value, table in body.drives if table and value})

    def _check_body(self, body: Body) -> None:
        """Refuse a rigid body that does not stand still after the state."""
        moving = [value for value, _ in body.drives[:TRANSLATIONS] if value]
        body.line.check(
            not moving or body.control == POSITION,
            f"contact body {body.name!r} moves by a velocity or load, expected its position",
        )

    def _zeroed_displacements(self) -> Iterator[Edit]:
        """Edits by which displacements of the undeformed model are held at 0."""
        for condition in self._deck.conditions():
            if condition.name in self._state.active and any(v for v, _, _ in condition.drives):
                line = condition.line
                zeros = [0.0] * len(condition.drives)
                yield _replaced(line, [reals_line(zeros, line.layout, free=line.free)])

    def _conditions(self) -> Iterator[str]:
        """Sets, tables and point loads of the forces."""
        layout = self._layout
        number = max((table.number for table in self._deck.tables), default=0)
        loads: list[str] = []
        for node, by_axis in self._pulses.items():
            yield _keyword("define", "node", "set", _set_name(node), layout=layout)
            yield f"{node:12d}"
            tables = [0] * TRANSLATIONS
            for axis, pulses in by_axis.items():
                number += 1
                tables[axis - 1] = number
                yield from self._table(number, f"pulse_{node}_{axis}", pulses)
            values = [self._scale if table else 0.0 for table in tables]
            loads += [
                integers_line([1, 0, 0, 0, 0, 0], layout) + _load_name(node),
                reals_line(values, layout),
                integers_line(tables, layout),
                integers_line([2], layout),
                _set_name(node),
            ]
        yield from ["point load", "", *loads]

    def _table(
        self, number: int, name: str, pulses: Sequence[tuple[float, float]]
    ) -> Iterator[str]:
        corners = {0.0: 0.0, float(self._times_s[-1]): 0.0}
        for time_s, _ in pulses:
            corners |= {time_s - STEP_S: 0.0, time_s + STEP_S: 0.0}
        corners |= dict(pulses)
        points = sorted(corners.items())
        counts = [TIME, len(points), 2, *(0, 0, 2) * 3]
        if (self._deck.version or 0) >= _SIXTEEN_FROM:
            counts += [0] * 4
        yield _keyword("table", name, layout=self._layout)
        yield integers_line([number, 1, 0, 0, POINTS], self._layout)
        yield integers_line(counts, self._layout)
        for point in points:
            yield reals_line(point, self._layout)

    def _post(self) -> list[str]:
        """Request of displacement and stress at every increment."""
        code = _CAUCHY_STRESS if self._state.after_case else _STRESS
        keyword, head, *codes = post_lines([code], POST_KINDS["binary"], self._layout)
        line = Line(0, head, layout=self._layout)
        return [
            keyword,
            line.with_integer(_NODAL_FIELD, 1),
            *codes,
            _keyword("nodal", layout=self._layout) + integers_line([_DISPLACEMENT], self._layout),
        ]

    def _load_case(self) -> Iterator[str]:
        """The load case of the forces, with the other options of the last one before."""
        layout, state = self._layout, self._state
        names = [*state.active, *map(_load_name, self._pulses)]
        count = SETTLING + len(self._times_s) - 1
        yield _keyword("title", CASE_NAME, layout=layout)
        yield _keyword("loadcase", CASE_NAME, layout=layout)
        yield integers_line([len(names)], layout)
        yield from names
        number = 0 if state.case is None else state.case.number
        for option in self._deck.options:
            is_kept = number and option.case == number and option.keyword not in _OWN_OF_A_CASE
            if is_kept and option.keyword:
                yield from _with_tolerance(option)
        increments = [count, 0, _MAX_CUT_BACKS]
        increments += [0, 0] * ((self._deck.version or 0) >= _NEWER_VERSION)
        yield from [FIXED, integers_line(increments, layout)]
        yield from ["time step", reals_line([STEP_S], layout), "continue"]


@dataclass(frozen=True, slots=True)
class _Driven:
    name: str
    tables: set[int]


def _with_most_increments(line: Line) -> str:
    """The first line of ``control`` with as many increments as Mentat writes at most.

    Whether it counts those of a load case or all is open.
    """
    return line.with_integer(0, _MAX_INCREMENTS) if line.first_integer() > 0 else line.text


def _with_tolerance(option: MarcOption) -> list[str]:
    """Lines of an option; ``control`` allows all increments and a smaller residual."""
    lines = [line.text for line in option.lines]
    if option.keyword == "control" and len(option.data) > 1:
        first, second = option.data[:2]
        at = {line.number: row for row, line in enumerate(option.lines)}
        lines[at[first.number]] = _with_most_increments(first)
        reals = second.reals()
        if reals and reals[0] > _TOLERANCE:
            changed = [_TOLERANCE, *reals[1:]]
            lines[at[second.number]] = reals_line(changed, second.layout, free=second.free)
    return lines


def linear_checks(count: int, most: int) -> list[int]:
    """Rows of forces, of `count`, that come again with the other sign, over all of them."""
    return sorted({round(row) for row in np.linspace(0, count - 1, min(most, count)).tolist()})


def _keyword(*parts: str, layout: Layout) -> str:
    *aligned, last = parts
    width = layout.real
    if not aligned:
        return last.ljust(width)
    return "".join(part.ljust(width) for part in aligned) + last


def _set_name(node: int) -> str:
    return f"fembridge_node_{node}"


def _load_name(node: int) -> str:
    return f"fembridge_force_{node}"


def _encoded(lines: Sequence[str], like: Line) -> bytes:
    """Lines with the line end that `like` has."""
    end = "\r\n" if like.stop - like.start - len(like.text) == 2 else "\n"
    return "".join(text + end for text in lines).encode("latin-1")


def _before(line: Line, texts: Sequence[str]) -> Edit:
    return Edit(line.start, line.start, _encoded(texts, line))


def _replaced(line: Line, texts: Sequence[str]) -> Edit:
    return Edit(line.start, line.stop, _encoded(texts, line))


def _removed(option: MarcOption) -> Edit:
    return Edit(option.lines[0].start, option.lines[-1].stop)
