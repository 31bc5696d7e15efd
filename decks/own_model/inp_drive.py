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
_DISPLACEMENT = ("", "DISPLACEMENT")
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
        if block.keyword == "BOUNDARY" and not any(block in one.blocks for one in steps):
            raise block.error(
                f"*BOUNDARY with amplitude {name} is in no step; put it into the one that it "
                "belongs to"
            )
    mine = [one for one in steps if any(user in one.blocks for user in users)]
    if not mine:
        raise curve.error(f"no *BOUNDARY of a step uses amplitude {name}")
    chosen = _chosen(steps, mine, name, step)
    push = _pushes(name, [block for block in users if block in chosen.blocks])
    total = curve.word("TIME") == "TOTALTIME"
    try:
        start_s = _start_s(deck, steps[: chosen.number])
    except DeckError:
        if total:
            raise
        start_s = None
    return Drive(curve, chosen, tuple(steps), push, abs(push[0].magnitude), total, start_s)


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
        if name and moves and block.word("TYPE") in _DISPLACEMENT:
            found.setdefault(name, block.where)
    if not found:
        raise DeckError(
            "no *BOUNDARY in a step moves anything by an AMPLITUDE; give the probe's "
            f"one (the deck has {_known(deck)}){deck.unread}"
        )
    if len(found) > 1:
        listed = ", ".join(f"{name} ({where})" for name, where in found.items())
        raise DeckError(f"several amplitudes move something: {listed}; name one")
    return next(iter(found))


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
            raise curve.error(f"*AMPLITUDE with {said} may be no waveform; {expected}")
    return curve


def _chosen(steps: list[Step], mine: list[Step], name: str, wanted: str | None) -> Step:
    """The step that is `wanted`, or the only one of `mine`, which use the amplitude."""
    if wanted is None:
        if len(mine) > 1:
            listed = "; ".join(step.name for step in mine)
            raise DeckError(f"several steps use amplitude {name}: {listed}; name one")
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
        raise named[0].head.error(
            f"no *BOUNDARY here uses amplitude {name}; those that have one: {known}"
        )
    return named[0]


def _pushes(name: str, blocks: list[Block]) -> tuple[Push, ...]:
    """What the amplitude moves in its step: displacements of one size."""
    found: list[Push] = []
    for block in blocks:
        foreign = [word for word in _FOREIGN if block.option(word) is not None]
        if block.word("TYPE") not in _DISPLACEMENT:
            foreign = [f"TYPE={block.word('TYPE')}"]
        if foreign:
            raise block.error(
                f"{block.title} with {foreign[0]} and amplitude {name}: it would not follow the "
                "waveform, a displacement"
            )
        found += _magnitudes(block)
    for push in found:
        if push.axis not in _TRANSLATIONS:
            raise DeckError(
                f"{push.where}: degree of freedom {push.axis} with amplitude {name} is no "
                "displacement"
            )
        if abs(push.magnitude) != abs(found[0].magnitude):
            raise DeckError(
                f"{push.where}: magnitude {push.magnitude:g}, but {found[0].magnitude:g} at "
                f"{found[0].where}: one amplitude cannot give both the waveform's depth"
            )
    if not found:
        raise blocks[0].error(f"the magnitudes with amplitude {name} are 0: nothing would move")
    return tuple(found)


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


def _start_s(deck: Deck, steps: list[Step]) -> float:
    """Total time at which the last of `steps` begins."""
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
    return sum(periods_s[:-1])
