"""Which ``*AMPLITUDE`` of a keyword deck moves the probe, in which step, and by how much.

    *BOUNDARY, AMPLITUDE=PRESS
    PROBE, 2, 2, -0.05

A displacement is magnitude times amplitude: for a depth in the deck's unit, the
amplitude is the depth divided by the magnitude's size. Its sign, which says where
the skin is, stays the user's.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from decks.inp import Block, Deck, squeezed
from fembridge.errors import DeckError

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
_LAST_DEGREE = 100  # far beyond what any solver has
# What makes of a condition something else than magnitude times amplitude.
_FOREIGN = ("USER", "SUBMODEL", "FIXED", "MASSFLOW", "TIMEDELAY", "LOADCASE")
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

    def period_s(self) -> float:
        """What the step adds to the total time.

        Raises
        ------
        DeckError
            It is no step in time, or sets the clock.
        """
        procedures = self.of(*_TIMED)
        if len(procedures) != 1:
            raise self.head.error(
                "how long this step takes is not known (no *STATIC, *DYNAMIC, *VISCO), "
                "and the waveform's amplitude counts total time; let it count step time"
            )
        (procedure,) = procedures
        for name in ("TIMERESET", "TOTALTIMEATSTART"):
            if procedure.option(name) is not None:
                raise procedure.error(
                    f"{name} sets the clock, and the waveform's amplitude counts "
                    "total time; let it count step time"
                )
        row = next(procedure.rows(), None)
        return 1.0 if row is None else row.number(1, blank=0.0) or 1.0


@dataclass(frozen=True, slots=True)
class Push:
    """One prescribed displacement: `magnitude` along `axis` of a set or node."""

    magnitude: float
    axis: int
    what: str
    where: str


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """The amplitude that becomes the waveform, and the step that it runs in.

    `factor` is the size of the magnitudes that it is multiplied by. The step begins
    at `start_s` of total time; None where that is not known, which an amplitude that
    counts total time cannot do without.
    """

    amplitude: Block
    step: Step
    steps: tuple[Step, ...]
    push: tuple[Push, ...]
    factor: float
    total_time: bool
    start_s: float | None


def find_drive(deck: Deck, amplitude: str | None, step: str | None) -> Drive:
    """Find the amplitude and the step; None: the only one that there can be.

    Raises
    ------
    DeckError
        There is none or more than one, or something about it that cannot be kept.
    """
    steps = _steps_of(deck)
    if not steps:
        raise DeckError(f"no *STEP in the deck{deck.unread}")
    name = squeezed(amplitude) if amplitude else _only_amplitude(deck)
    curve = _definition(deck, name)
    users = [block for block in deck.blocks if block.word("AMPLITUDE") == name]
    for block in users:
        if block.keyword not in ("BOUNDARY", "STEP"):
            raise block.error(
                f"{block.title} uses amplitude {name} too, and would follow the "
                "waveform; give it an amplitude of its own"
            )
    chosen = _step_of(name, users, steps, step, curve)
    push = tuple(_pushes(name, chosen, users))
    total = curve.word("TIME") == "TOTALTIME"
    return Drive(
        amplitude=curve,
        step=chosen,
        steps=tuple(steps),
        push=push,
        factor=_factor(push),
        total_time=total,
        start_s=_start_s(deck, steps, chosen, needed=total),
    )


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
    found: dict[str, str] = {}
    for block in deck.of("BOUNDARY"):
        name = block.word("AMPLITUDE")
        moves = any(push.axis in _TRANSLATIONS for push in _magnitudes(block))
        if name and moves and _is_displacement(block):
            found.setdefault(name, block.where)
    if len(found) == 1:
        return next(iter(found))
    if not found:
        raise DeckError(
            "no *BOUNDARY in a step moves anything by an AMPLITUDE; give the probe's "
            f"one (the deck has {_known(deck)}){deck.unread}"
        )
    listed = ", ".join(f"{name} ({where})" for name, where in found.items())
    raise DeckError(f"several amplitudes move something: {listed}; name one")


def _known(deck: Deck) -> str:
    names = [
        f"{block.word('NAME') or 'one without a name'} ({block.where})"
        for block in deck.of("AMPLITUDE")
    ]
    return f"the amplitudes {', '.join(names)}" if names else "no *AMPLITUDE"


def _definition(deck: Deck, name: str) -> Block:
    """The amplitude `name`, of a kind that can hold a waveform."""
    found = [block for block in deck.of("AMPLITUDE") if block.word("NAME") == name]
    if not found:
        raise DeckError(
            f"no *AMPLITUDE, NAME={name} in the deck; it has {_known(deck)}{deck.unread}"
        )
    if len(found) > 1:
        both = " and ".join(block.where for block in found)
        raise DeckError(f"*AMPLITUDE, NAME={name}: duplicate, at {both}; keep one")
    (curve,) = found
    if not curve.own:
        raise curve.error(f"*AMPLITUDE, NAME={name} is in an included file; put it into the deck")
    curve.own_rows()
    for option in curve.options:
        if option.name == "INPUT":
            raise curve.error("its data is in another file; put it into the deck")
        if option.name not in _CURVE_OPTIONS:
            raise curve.error(
                f"*AMPLITUDE with {option.name}: what it does to a waveform is not "
                "known here; take it out"
            )
        words = _CURVE_OPTIONS[option.name]
        if words is not None and option.word not in words:
            expected = " or ".join(words)
            raise curve.error(f"*AMPLITUDE with {option.name}={option.value}, expected {expected}")
    return curve


def _step_of(
    name: str, users: list[Block], steps: list[Step], wanted: str | None, curve: Block
) -> Step:
    mine = [step for step in steps if any(user in step.blocks for user in users)]
    for user in users:
        if user.keyword == "BOUNDARY" and not any(user in one.blocks for one in steps):
            raise user.error(
                f"*BOUNDARY with amplitude {name} is in no step; put it into the one that it "
                "belongs to"
            )
    if not mine:
        raise curve.error(f"no *BOUNDARY of a step uses amplitude {name}")
    if wanted is not None:
        step = _step_named(steps, wanted)
        if step not in mine:
            known = "; ".join(one.name for one in mine)
            raise step.head.error(
                f"no *BOUNDARY here uses amplitude {name}; those that have one: {known}"
            )
        return step
    if len(mine) > 1:
        listed = "; ".join(step.name for step in mine)
        raise DeckError(f"several steps use amplitude {name}: {listed}; name one")
    return mine[0]


def _step_named(steps: list[Step], wanted: str) -> Step:
    for step in steps:
        if wanted.strip() == str(step.number):
            return step
        if (word := step.head.word("NAME")) and word == squeezed(wanted):
            return step
    known = "; ".join(step.name for step in steps)
    raise DeckError(f"no step {wanted!r} in the deck; it has: {known}")


def _pushes(name: str, step: Step, users: list[Block]) -> Iterator[Push]:
    found = False
    for block in step.of("BOUNDARY"):
        if block not in users:
            continue
        if not _is_displacement(block):
            raise block.error(
                f"*BOUNDARY, TYPE={block.word('TYPE')} with amplitude {name}: the "
                "waveform is a displacement"
            )
        for foreign in _FOREIGN:
            if block.option(foreign) is not None:
                raise block.error(
                    f"*BOUNDARY with {foreign} and amplitude {name}: it would not "
                    "follow the waveform"
                )
        for push in _magnitudes(block):
            if push.axis not in _TRANSLATIONS:
                raise DeckError(
                    f"{push.where}: degree of freedom {push.axis} with amplitude "
                    f"{name} is no displacement"
                )
            found = True
            yield push
    if not found:
        where = next(user.where for user in users if user in step.blocks)
        raise DeckError(f"{where}: the magnitudes with amplitude {name} are 0: nothing would move")


def _is_displacement(block: Block) -> bool:
    return block.word("TYPE") in ("", "DISPLACEMENT")


def _magnitudes(block: Block) -> Iterator[Push]:
    """What a ``*BOUNDARY`` moves; zero magnitudes fix and do not move."""
    for row in block.rows():
        what, first, *_ = (*row.words, "")
        if not (first.isascii() and first.isdigit()):  # ENCASTRE and the like
            continue
        magnitude = row.number(3, blank=0.0)
        if magnitude == 0:
            continue
        axis = row.whole(1)
        for one in range(axis, min(row.whole(2, blank=axis), _LAST_DEGREE) + 1):
            yield Push(magnitude, one, what, row.where)


def _factor(push: tuple[Push, ...]) -> float:
    first = push[0]
    for other in push:
        if abs(other.magnitude) != abs(first.magnitude):
            raise DeckError(
                f"{other.where}: magnitude {other.magnitude:g}, but "
                f"{first.magnitude:g} at {first.where}: one amplitude cannot give both "
                "the waveform's depth"
            )
    return abs(first.magnitude)


def _start_s(deck: Deck, steps: list[Step], chosen: Step, *, needed: bool) -> float | None:
    try:
        for block in deck.of("RESTART"):
            if block.option("READ") is not None:
                raise block.error(
                    "*RESTART, READ: the total time at the start is not known, and the "
                    "waveform's amplitude counts it; let it count step time"
                )
        *before, _ = [step.period_s() for step in steps[: chosen.number]]
    except DeckError:
        if needed:
            raise
        return None
    return sum(before)
