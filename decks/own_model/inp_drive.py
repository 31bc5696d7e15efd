"""What of a keyword deck becomes the waveform: which displacement, in which step, from where.

    *BOUNDARY, AMPLITUDE=PRESS
    PROBE, 2, 2, -0.05

A displacement is magnitude times amplitude: for a depth in the deck's unit, the
amplitude is the depth divided by the magnitude's size. Its sign, which says where
the skin is, stays the user's. A displacement without an amplitude, which solvers ramp,
or with one that other steps use too, gets an amplitude of its own.

Depth counts from where the steps before have put the probe. What is missing, ambiguous or
not to be kept is a DeckError with its line.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from decks.inp import Block, Deck, Row, node_sets, squeezed
from decks.own_model import Request
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

    `by_request` where the request gives the direction and the line another one, or none.
    """

    block: Block
    row: Row
    what: str
    axis: int
    magnitude: float
    by_request: bool = False

    @property
    def where(self) -> str:
        """The line, as an error names it."""
        return self.row.where

    @property
    def name(self) -> str:
        """As ``--move`` names it."""
        return f"{self.what},{self.axis}"

    @property
    def amplitude(self) -> str:
        """The amplitude that it is multiplied by; "" for none."""
        return self.block.word("AMPLITUDE")


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """What becomes the waveform, and the step that it runs in.

    `amplitude` is the deck's own for it, None where it gets one. `factor` is the size of
    the magnitudes that it is multiplied by, `stands` the depth in the deck's unit at
    which the step finds the probe. The step begins at `start_s` of total time; None where
    that is not known.
    """

    amplitude: Block | None
    step: Step
    steps: tuple[Step, ...]
    push: tuple[Push, ...]
    factor: float
    stands: float
    start_s: float | None

    @property
    def total_time(self) -> bool:
        """Whether the amplitude counts total time, not that of the step."""
        return self.amplitude is not None and _in_total(self.amplitude)


def find_drive(deck: Deck, request: Request) -> Drive:
    """Find displacement and step that the request names, or the only ones that there can be.

    An amplitude means all that it moves in its step, ``--move`` the one displacement. An
    amplitude that something else needs too, or that cannot hold a waveform, stays as it is.
    """
    steps = _steps_of(deck)
    able = [
        (step, push)
        for step in steps
        for block in step.of("BOUNDARY")
        for push in _magnitudes(block, zero=request.move is not None)
        if push.axis in _TRANSLATIONS and block.word("TYPE") in _DISPLACEMENT
    ]
    name = "" if request.move else _amplitude(able, request)
    what, axis, sign = request.moved or ("", 0, 0)
    mine = [
        (step, push)
        for step, push in able
        if (not name or push.amplitude == name)
        and (not axis or (squeezed(push.what), push.axis) == (what, axis))
    ]
    wanted = f"anything by amplitude {name}" if name else request.move or "anything"
    if not mine:
        raise DeckError(
            f"no *BOUNDARY of a step moves {wanted}; what moves there: {_listed(able) or 'nothing'}"
            f" (the deck has {_known(deck)}){deck.unread}; write the probe's displacement into "
            "its step, as PROBE, 2, 2, -0.1"
        )
    chosen = _chosen(steps, [step for step, _ in mine], wanted, request.step, last=not name)
    push = [push for step, push in mine if step is chosen]
    if not name:
        push = [_only_one(chosen, push, able, sign)]
    for one in push:
        _refuse_foreign(one.block, one.name)
        if abs(one.magnitude) != abs(push[0].magnitude):
            raise DeckError(
                f"{one.where}: magnitude {one.magnitude:g}, but {push[0].magnitude:g} at "
                f"{push[0].where}: one amplitude cannot give both the waveform's depth; --move "
                f"{one.name} gives it one of its own"
            )
    start_s = None
    with suppress(DeckError):
        start_s = sum(_periods_s(deck, steps[: chosen.number])[:-1])
    before = steps[: chosen.number - 1]
    sets = _sets(deck) if before else {}
    stands = [np.sign(one.magnitude) * _standing(deck, before, one, sets) for one in push]
    for one, place in zip(push, stands, strict=True):
        if abs(place - stands[0]) > _SAME * abs(place):
            raise DeckError(
                f"{one.where}: {one.name} stands {place:g} deep when its step begins, but "
                f"{push[0].name} {stands[0]:g}: one waveform cannot begin at both"
            )
    curve = _own_curve(deck, push, start_s)
    factor, first = abs(push[0].magnitude), float(stands[0])
    return Drive(curve, chosen, tuple(steps), tuple(push), factor, first, start_s)


def _amplitude(able: list[tuple[Step, Push]], request: Request) -> str:
    """The amplitude that is asked for, or the only one that moves something; "" for none."""
    moving = {push.amplitude: push.block.where for _, push in reversed(able) if push.amplitude}
    if OWN_AMPLITUDE in moving:
        return OWN_AMPLITUDE  # a deck that has been here before
    if request.amplitude:
        return squeezed(request.amplitude)
    if len(moving) > 1:
        listed = ", ".join(f"{name} ({where})" for name, where in reversed(moving.items()))
        raise DeckError(f"several amplitudes move something: {listed}; name one")
    return next(iter(moving), "")


def _only_one(step: Step, found: list[Push], able: list[tuple[Step, Push]], sign: int) -> Push:
    """The only displacement of `found`, in the direction `sign` where that is not 0."""
    push = found[-1]  # the last line counts
    if any(other.name != push.name for other in found):
        raise step.head.error(
            f"several displacements: {_listed(able)}; name one: --move {found[0].name}"
        )
    if sign and sign != np.sign(push.magnitude):
        push = replace(push, magnitude=float(sign), by_request=True)
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
    return push


def _own_curve(deck: Deck, push: list[Push], start_s: float | None) -> Block | None:
    """The deck's amplitude of `push`, where it can hold a waveform and moves nothing else."""
    name, ours = push[0].amplitude, {one.where for one in push}
    for block in deck.blocks:
        if block.word("AMPLITUDE") == name and block.keyword != "STEP":
            moved = _magnitudes(block) if block.keyword == "BOUNDARY" else [None]
            if any(one is None or one.where not in ours for one in moved):
                return None
    with suppress(DeckError):
        curve = _definition(deck, name)
        texts = [curve.text, *(row.text for row in curve.rows())]
        if not any(text.name for text in texts) and not (_in_total(curve) and start_s is None):
            return curve
    return None


def _in_total(curve: Block) -> bool:
    """Whether an amplitude counts total time, not that of the step."""
    return curve.word("TIME") == "TOTALTIME"


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
    if not steps:
        raise DeckError(f"no *STEP in the deck{deck.unread}")
    return steps


def _listed(able: list[tuple[Step, Push]]) -> str:
    """The displacements to choose from, those that move first."""
    moving = sorted((push for _, push in able), key=lambda push: push.magnitude == 0)
    names = list(dict.fromkeys(f"{push.name} ({push.where})" for push in moving))
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return "; ".join(names[:_SHOWN]) + more


def _known(deck: Deck) -> str:
    names = [
        f"{block.word('NAME') or 'one without a name'} ({block.where})"
        for block in deck.of("AMPLITUDE")
    ]
    return f"the amplitudes {', '.join(names)}" if names else "no *AMPLITUDE"


def _definition(deck: Deck, name: str) -> Block:
    """The amplitude `name`, of a kind whose data are times and values, linear between them."""
    found = [block for block in deck.of("AMPLITUDE") if block.word("NAME") == name]
    if len(found) != 1:
        raise DeckError(f"{len(found)} *AMPLITUDE, NAME={name}; the deck has {_known(deck)}")
    (curve,) = found
    for option in curve.options:
        words = _CURVE_OPTIONS.get(option.name, ())
        if words is not None and option.word not in words:
            said = option.name if option.value is None else f"{option.name}={option.value}"
            raise curve.error(f"*AMPLITUDE with {said}: its value at a time is not known")
    return curve


def _chosen(
    steps: list[Step], mine: list[Step], name: str, wanted: str | None, *, last: bool
) -> Step:
    """The step that is `wanted`, else the only one of `mine`, which have `name`, or the last."""
    mine = list({step.number: step for step in mine}.values())
    if wanted is None:
        if len(mine) > 1 and not last:
            listed = "; ".join(step.name for step in mine)
            raise DeckError(f"several steps move {name}: {listed}; name one")
        return mine[-1]
    for step in steps:
        if wanted.strip() == str(step.number) or step.head.word("NAME") == squeezed(wanted) != "":
            if step in mine:
                return step
            there = "; ".join(one.name for one in mine)
            raise step.head.error(f"no *BOUNDARY here moves {name}; steps that do: {there}")
    known = "; ".join(step.name for step in steps)
    raise DeckError(f"no step {wanted!r} in the deck; it has: {known}")


def _refuse_foreign(block: Block, name: str) -> None:
    foreign = [word for word in _FOREIGN if block.option(word) is not None]
    if block.word("TYPE") not in _DISPLACEMENT:
        foreign = [f"TYPE={block.word('TYPE')}"]
    if foreign:
        raise block.error(
            f"{block.title} with {foreign[0]}: {name} would not follow the waveform, a displacement"
        )


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


def _standing(
    deck: Deck, steps: Sequence[Step], push: Push, sets: Mapping[str, list[range]]
) -> float:
    """The displacement of what `push` moves at the end of `steps`, in the deck's unit."""
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
    end_s = sum(periods_s) if _in_total(curve) else periods_s[-1]
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
