"""What of a keyword deck becomes the waveform: which displacement, in which step, from where.

    *BOUNDARY, AMPLITUDE=PRESS
    PROBE, 2, 2, -0.05

A displacement is magnitude times amplitude: for a depth in the deck's unit, the
amplitude is the depth divided by the magnitude's size. Its sign, which says where
the skin is, stays the user's. A displacement without an amplitude, which solvers ramp,
or with one that other steps use too, gets an amplitude of its own.

Depth counts from where the steps before have put the probe.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain

import numpy as np

from decks.inp import Block, Deck, Row, node_sets, squeezed
from decks.own_model.request import Request
from fembridge.errors import DeckError

# The amplitude that we put in where the deck has none for the waveform alone.
OWN_AMPLITUDE = "FEMBRIDGE_WAVEFORM"
# Procedures that a waveform can run in.
MOVABLE = ("STATIC", "DYNAMIC", "VISCO")
# These lengthen the total time by their second number, or by 1 without one.
_TIMED = (
    *MOVABLE,
    "HEATTRANSFER",
    "COUPLEDTEMPERATURE-DISPLACEMENT",
    "UNCOUPLEDTEMPERATURE-DISPLACEMENT",
)
# Displacements along x, y, z.
_TRANSLATIONS = range(1, 4)
_SHOWN = 5  # displacements, of those to choose from
_LAST_DEGREE = 100  # far beyond what any solver has
# Degrees of freedom that Abaqus holds by a word.
_HELD = {"XSYMM": (1, 1), "YSYMM": (2, 2), "ZSYMM": (3, 3), "ENCASTRE": (1, 6), "PINNED": (1, 3)}
_LOADS = ("CLOAD", "DLOAD", "DSLOAD", "TEMPERATURE")
_DISPLACEMENT = ("", "DISPLACEMENT")
# What makes of a condition something else than magnitude times amplitude.
_FOREIGN = ("USER", "SUBMODEL", "FIXED", "MASSFLOW", "TIMEDELAY", "LOADCASE")
_SAME = 1e-9
# Options of *AMPLITUDE with the words that they may have; None: any.
_CURVE_OPTIONS = {
    "NAME": None,
    "TIME": ("STEPTIME", "TOTALTIME"),
    "DEFINITION": ("TABULAR",),
    "VALUE": ("RELATIVE",),
    "SMOOTH": None,
}


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """Step number `number`, from 1: its ``*STEP``, the blocks in it, its end."""

    number: int
    head: Block
    blocks: tuple[Block, ...]
    end: Block

    @property
    def name(self) -> str:
        """Number and, where it has one, name."""
        option = self.head.option("NAME")
        named = f" ({option.value})" if option is not None and option.value else ""
        return f"step {self.number}{named}, {self.head.where}"

    def of(self, *keywords: str) -> list[Block]:
        """The step's blocks that have one of `keywords`."""
        return [block for block in self.blocks if block.keyword in keywords]


@dataclass(frozen=True, slots=True, eq=False)
class Push:
    """A line `row` of `block` that prescribes `magnitude` along `axis` of a set or node.

    `turned` where the request gives the direction and the line another one, or none.
    """

    block: Block
    row: Row
    what: str
    axis: int
    magnitude: float
    turned: bool = False

    @property
    def where(self) -> str:
        """The line, as an error names it."""
        return self.row.where

    @property
    def name(self) -> str:
        """As ``--move`` names it."""
        return f"{self.what},{self.axis}"


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """What becomes the waveform, and the step that it runs in.

    `amplitude` is the deck's own for it, None where it gets one. `factor` is the size of
    the magnitudes that it is multiplied by, `stands` the depth in the deck's unit at
    which the step finds the probe. The step begins at `start_s` of total time; None where
    that is not known, which an amplitude that counts total time cannot do without.
    """

    amplitude: Block | None
    step: Step
    steps: tuple[Step, ...]
    push: tuple[Push, ...]
    factor: float
    stands: float
    total_time: bool
    start_s: float | None

    @property
    def where(self) -> str:
        """Where the waveform is put in."""
        return self.push[0].where if self.amplitude is None else self.amplitude.where


def find_drive(deck: Deck, request: Request) -> Drive:
    """Find displacement and step that the request names, or the only ones that there can be.

    Raises
    ------
    DeckError
        There is none or more than one, or something about it that cannot be kept.
    """
    steps = _steps_of(deck)
    if not steps:
        raise DeckError(f"no *STEP in the deck{deck.unread}")
    if request.move:
        name = ""
    elif any(block.word("AMPLITUDE") == OWN_AMPLITUDE for block in deck.of("BOUNDARY")):
        name = OWN_AMPLITUDE  # a deck that has been here before
    else:
        name = squeezed(request.amplitude) if request.amplitude else _only_amplitude(deck)
    if name:
        chosen, push, curve = _by_amplitude(deck, steps, name, request.step)
    else:
        chosen, push, curve = _by_move(deck, steps, request)
    total = curve is not None and curve.word("TIME") == "TOTALTIME"
    try:
        start_s = sum(_periods_s(deck, steps[: chosen.number])[:-1])
    except DeckError:
        if total:
            raise
        start_s = None
    before = steps[: chosen.number - 1]
    stands = [np.sign(one.magnitude) * _standing(deck, before, one) for one in push]
    for one, place in zip(push, stands, strict=True):
        if abs(place - stands[0]) > _SAME * abs(place):
            raise DeckError(
                f"{one.where}: {one.name} stands {place:g} deep when its step begins, but "
                f"{push[0].name} {stands[0]:g}: one waveform cannot begin at both"
            )
    factor, first = abs(push[0].magnitude), float(stands[0])
    return Drive(curve, chosen, tuple(steps), push, factor, first, total, start_s)


def _by_amplitude(
    deck: Deck, steps: list[Step], name: str, step: str | None
) -> tuple[Step, tuple[Push, ...], Block | None]:
    """Step, displacements and curve of the amplitude `name`; no curve if others need it."""
    curve = _definition(deck, name)
    users = [block for block in deck.blocks if block.word("AMPLITUDE") == name]
    for block in users:
        if block.keyword not in ("BOUNDARY", "STEP"):
            raise block.error(
                f"{block.title} uses amplitude {name} too, and would follow the waveform; "
                "--move NSET,DOF gives the probe an amplitude of its own"
            )
        if block.keyword == "BOUNDARY" and not any(block in one.blocks for one in steps):
            raise block.error(
                f"*BOUNDARY with amplitude {name} is in no step; put it into the one that it "
                "belongs to"
            )
    mine = [one for one in steps if any(user in one.blocks for user in users)]
    if not mine:
        raise curve.error(f"no *BOUNDARY of a step uses amplitude {name}")
    chosen = _chosen(steps, mine, f"amplitude {name}", step)
    push = _pushes(f"amplitude {name}", [user for user in users if user in chosen.blocks])
    return chosen, push, None if len(mine) > 1 else curve


def _by_move(
    deck: Deck, steps: list[Step], request: Request
) -> tuple[Step, tuple[Push, ...], Block | None]:
    """Step and displacement that the request, or nothing else, can mean; a curve it has alone."""
    wanted = request.moved
    found = [
        (step, push)
        for step in steps
        for block in step.of("BOUNDARY")
        for push in _magnitudes(block, zero=wanted is not None)
        if push.axis in _TRANSLATIONS and block.word("TYPE") in _DISPLACEMENT
    ]
    moving = sorted((push for _, push in found), key=lambda push: push.magnitude == 0)
    names = list(dict.fromkeys(f"{push.name} ({push.where})" for push in moving))
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    known = "; ".join(names[:_SHOWN]) + more
    if wanted is not None:
        what, axis, sign = wanted
        found = [(s, p) for s, p in found if (squeezed(p.what), p.axis) == (what, axis)]
    if not found and wanted is not None:
        raise DeckError(f"no *BOUNDARY prescribes {request.move}; those there: {known or 'none'}")
    if not found:
        raise DeckError(
            f"no *BOUNDARY of a step moves anything (the deck has {_known(deck)}){deck.unread}; "
            "write the probe's displacement into its step, as PROBE, 2, 2, -0.1"
        )
    mine = [step for step in steps if any(step is one for one, _ in found)]
    last = mine[-1:] if request.step is None else mine
    chosen = _chosen(steps, last, request.move or "a displacement", request.step)
    pushes = [push for step, push in found if step is chosen]
    if len({push.name for push in pushes}) > 1:
        raise chosen.head.error(
            f"several displacements: {known}; name one: --move {pushes[0].name}"
        )
    push = pushes[-1]  # the last one counts
    _refuse_foreign(push.block, push.name)
    if wanted is not None and sign and sign != np.sign(push.magnitude):
        push = Push(push.block, push.row, push.what, push.axis, float(sign), turned=True)
    if push.magnitude == 0:
        raise DeckError(
            f"{push.where}: {push.name} is held at 0, which gives no direction; write "
            f"--move {push.what},-{push.axis} where the skin is on the negative side, or +"
        )
    if push.row.whole(1) != push.row.whole(2, blank=push.axis):
        raise DeckError(
            f"{push.where}: degrees of freedom {push.row.words[1]} to {push.row.words[2]} "
            f"in one line; give {push.axis} a line of its own"
        )
    name = push.block.word("AMPLITUDE")
    alone = [block for block in deck.blocks if name and block.word("AMPLITUDE") == name]
    others = [one for one in _magnitudes(push.block) if one.row.start != push.row.start]
    with suppress(DeckError):  # one that cannot hold a waveform: it gets its own
        if alone == [push.block] and not others:
            return chosen, (push,), _definition(deck, name)
    return chosen, (push,), None


def _steps_of(deck: Deck) -> list[Step]:
    steps: list[Step] = []
    head: Block | None = None
    inside: list[Block] = []
    for block in deck.blocks:
        if block.keyword == "STEP":
            if head is not None:
                raise block.error(f"*STEP inside the step of {head.where}")
            head, inside = block, []
        elif block.keyword == "ENDSTEP":
            if head is None:
                raise block.error("*END STEP without a *STEP")
            steps.append(Step(len(steps) + 1, head, tuple(inside), block))
            head = None
        elif head is not None:
            inside.append(block)
    if head is not None:
        raise head.error("this *STEP has no *END STEP")
    return steps


def _only_amplitude(deck: Deck) -> str:
    """The only amplitude that moves something; "" for none."""
    found: dict[str, str] = {}
    for block in deck.of("BOUNDARY"):
        name = block.word("AMPLITUDE")
        moves = any(push.axis in _TRANSLATIONS for push in _magnitudes(block))
        if name and moves and block.word("TYPE") in _DISPLACEMENT:
            found.setdefault(name, block.where)
    if len(found) > 1:
        listed = ", ".join(f"{name} ({where})" for name, where in found.items())
        raise DeckError(f"several amplitudes move something: {listed}; name one")
    return next(iter(found), "")


def _known(deck: Deck) -> str:
    names = [
        f"{block.word('NAME') or 'one without a name'} ({block.where})"
        for block in deck.of("AMPLITUDE")
    ]
    return f"the amplitudes {', '.join(names)}" if names else "no *AMPLITUDE"


def _definition(deck: Deck, name: str) -> Block:
    """The amplitude `name`, of a kind that can hold a waveform."""
    found = [block for block in deck.of("AMPLITUDE") if block.word("NAME") == name]
    if len(found) != 1:
        there = " and ".join(block.where for block in found)
        problem = f"duplicate, at {there}" if found else f"it has {_known(deck)}{deck.unread}"
        raise DeckError(
            f"{len(found)} *AMPLITUDE, NAME={name} in the deck, expected one; {problem}"
        )
    (curve,) = found
    if not curve.own or curve.option("INPUT") is not None:
        raise curve.error(f"*AMPLITUDE, NAME={name}: its data is in another file; put it here")
    curve.own_rows()
    for option in curve.options:
        words = _CURVE_OPTIONS.get(option.name, ())
        if words is not None and option.word not in words:
            expected = f"expected {' or '.join(words)}" if words else "take it out"
            said = option.name if option.value is None else f"{option.name}={option.value}"
            raise curve.error(
                f"*AMPLITUDE with {said} may be no waveform; {expected}, or --move NSET,DOF gives "
                "the probe one of its own"
            )
    return curve


def _chosen(steps: list[Step], mine: list[Step], name: str, wanted: str | None) -> Step:
    """The step that is `wanted`, or the only one of `mine`, which have `name`."""
    if wanted is None:
        if len(mine) > 1:
            listed = "; ".join(step.name for step in mine)
            raise DeckError(f"several steps use {name}: {listed}; name one")
        return mine[0]
    named = [
        step
        for step in steps
        if wanted.strip() == str(step.number) or step.head.word("NAME") == squeezed(wanted) != ""
    ]
    if not named:
        known = "; ".join(step.name for step in steps)
        raise DeckError(f"no step {wanted!r} in the deck; it has: {known}")
    if named[0] not in mine:
        known = "; ".join(one.name for one in mine)
        raise named[0].head.error(f"no *BOUNDARY here uses {name}; those that have one: {known}")
    return named[0]


def _refuse_foreign(block: Block, name: str) -> None:
    foreign = [word for word in _FOREIGN if block.option(word) is not None]
    if block.word("TYPE") not in _DISPLACEMENT:
        foreign = [f"TYPE={block.word('TYPE')}"]
    if foreign:
        raise block.error(
            f"{block.title} with {foreign[0]} and {name}: it would not follow the "
            "waveform, a displacement"
        )


def _pushes(name: str, blocks: list[Block]) -> tuple[Push, ...]:
    """What the amplitude moves in its step: displacements of one size."""
    found: list[Push] = []
    for block in blocks:
        _refuse_foreign(block, name)
        found += _magnitudes(block)
    for push in found:
        if push.axis not in _TRANSLATIONS:
            raise DeckError(
                f"{push.where}: degree of freedom {push.axis} with {name} is no displacement"
            )
        if abs(push.magnitude) != abs(found[0].magnitude):
            raise DeckError(
                f"{push.where}: magnitude {push.magnitude:g}, but {found[0].magnitude:g} at "
                f"{found[0].where}: one amplitude cannot give both the waveform's depth; --move "
                f"{push.name} gives it one of its own"
            )
    if not found:
        raise blocks[0].error(f"the magnitudes with {name} are 0: nothing would move")
    return tuple(found)


def _magnitudes(block: Block, *, zero: bool = False) -> Iterator[Push]:
    """What a ``*BOUNDARY`` moves, with `zero` also what it holds."""
    for row in block.rows():
        what, first, *_ = (*row.words, "")
        if first.isascii() and first.isdigit():
            axis, magnitude = row.whole(1), row.number(3, blank=0.0)
            last = row.whole(2, blank=axis)
        else:
            axis, last = _HELD.get(squeezed(first), (1, 0))
            magnitude = 0.0
        if magnitude or zero:
            for one in range(axis, min(last, _LAST_DEGREE) + 1):
                yield Push(block, row, what, one, magnitude)


# ---- Where the steps before leave the probe


def _standing(deck: Deck, steps: Sequence[Step], push: Push) -> float:
    """The displacement of what `push` moves at the end of `steps`, in the deck's unit.

    Raises
    ------
    DeckError
        It is free there while something acts, or follows what is no magnitude.
    """
    sets = _sets(deck) if steps else {}
    held: Push | None = None
    place = 0.0
    for block in deck.blocks:
        if block.keyword == "STEP":
            break
        if block.keyword == "BOUNDARY":
            held = _covering(block, push, sets) or held
    for step in steps:
        conditions = step.of("BOUNDARY")
        if any(block.word("OP") == "NEW" for block in conditions):
            held = None
        for block in conditions:
            held = _covering(block, push, sets) or held
        moving = chain.from_iterable(map(_magnitudes, conditions))
        if held is None:
            acting = [one.where for one in moving if one.axis in _TRANSLATIONS]
            if acting := acting or [one.where for one in step.of(*_LOADS)]:
                raise DeckError(
                    f"{push.where}: where {push.what} stands when its step begins is not known: "
                    f"step {step.number} ({acting[0]}) leaves its degree of freedom {push.axis} "
                    "free; prescribe it there"
                )
        elif held.block.option("FIXED") is None:
            place = _at_end(deck, steps[: step.number], held)
    return place


def _sets(deck: Deck) -> Mapping[str, list[range]]:
    """The node sets; none of a deck whose sets take more than reading (Abaqus's instances)."""
    try:
        return node_sets(deck)
    except DeckError:
        return {}


def _covering(block: Block, push: Push, sets: Mapping[str, list[range]]) -> Push | None:
    """The last line of `block` that prescribes what `push` moves, along its axis."""

    def nodes(what: str) -> set[int]:
        if what.isascii() and what.isdigit():
            return {int(what)}
        return set(chain.from_iterable(sets.get(squeezed(what), ())))

    found = None
    mine = nodes(push.what)
    for one in _magnitudes(block, zero=True):
        if one.axis != push.axis:
            continue
        theirs = nodes(one.what)
        if squeezed(one.what) == squeezed(push.what) or (mine and mine <= theirs):
            found = one
        elif mine & theirs:
            raise DeckError(
                f"{one.where}: prescribes a part of {push.what} ({push.where}) alone: where that "
                "stands when the waveform begins is not one depth"
            )
    return found


def _at_end(deck: Deck, steps: Sequence[Step], held: Push) -> float:
    """The displacement that `held` prescribes at the end of the last of `steps`."""
    _refuse_foreign(held.block, held.name)
    name = held.block.word("AMPLITUDE")
    if not name:
        return held.magnitude
    curve = _definition(deck, name)
    periods_s = _periods_s(deck, steps)
    end_s = sum(periods_s) if curve.word("TIME") == "TOTALTIME" else periods_s[-1]
    words = [(row, at) for row in curve.rows() for at, word in enumerate(row.words) if word]
    numbers = [row.number(at) for row, at in words]
    if not numbers or len(numbers) % 2:
        raise curve.error(f"amplitude {name} has {len(numbers)} numbers, expected pairs")
    return held.magnitude * float(np.interp(end_s, numbers[::2], numbers[1::2]))


def _periods_s(deck: Deck, steps: Sequence[Step]) -> list[float]:
    """How long each of `steps` takes, from total time 0 on."""
    clocks = [(one, "READ") for one in deck.of("RESTART")]
    periods_s = []
    for step in steps:
        procedures = step.of(*_TIMED)
        if len(procedures) != 1:
            raise step.head.error(
                "how long this step takes is not known (no *STATIC, *DYNAMIC, *VISCO), "
                "and the waveform's amplitude counts total time; let it count step time"
            )
        row = next(procedures[0].rows(), None)
        periods_s.append(1.0 if row is None else row.number(1, blank=0.0) or 1.0)
        clocks += [(procedures[0], name) for name in ("TIMERESET", "TOTALTIMEATSTART")]
    for block, name in clocks:
        if block.option(name) is not None:
            raise block.error(
                f"{name} sets the clock, and the waveform's amplitude counts total time; "
                "let it count step time"
            )
    return periods_s
