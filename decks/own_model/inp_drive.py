"""Which ``*AMPLITUDE`` of a deck moves the probe, in which step, and by how much.

    *BOUNDARY, AMPLITUDE=PRESS
    PROBE, 2, 2, -0.05

A displacement is magnitude times amplitude: for a depth in the deck's unit, the
amplitude is the depth divided by the magnitude's size. Its sign, which says where
the skin is, stays the user's.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from decks.own_model.inp_blocks import Block, Blocks, place_of
from decks.own_model.inp_numbers import number, whole
from decks.own_model.inp_steps import Step, step_named, steps_of
from decks.own_model.inp_text import squeezed
from fembridge.errors import DeckError

# Displacements along x, y, z.
_TRANSLATIONS = range(1, 4)
_LAST_DEGREE = 100  # far beyond what any solver has
# What makes of a condition something else than magnitude times amplitude.
_FOREIGN = ("USER", "SUBMODEL", "FIXED", "MASSFLOW", "TIMEDELAY", "LOADCASE")


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


def find_drive(blocks: Blocks, amplitude: str | None, step: str | None) -> Drive:
    """Find the amplitude and the step; None: the only one that there can be.

    Raises
    ------
    DeckError
        There is none or more than one, or something about it that cannot be kept.
    """
    steps = steps_of(blocks)
    if not steps:
        raise DeckError(f"no *STEP in the deck{blocks.unread}")
    name = squeezed(amplitude) if amplitude else _only_amplitude(blocks)
    curve = _definition(blocks, name)
    _check_curve(curve)
    users = [block for block in blocks.block if block.word("AMPLITUDE") == name]
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
        start_s=_start_s(blocks, steps, chosen, needed=total),
    )


def _only_amplitude(blocks: Blocks) -> str:
    found: dict[str, str] = {}
    for block in blocks.of("BOUNDARY"):
        name = block.word("AMPLITUDE")
        moves = any(push.axis in _TRANSLATIONS for push in _magnitudes(block))
        if name and moves and _is_displacement(block):
            found.setdefault(name, block.where)
    if len(found) == 1:
        return next(iter(found))
    if not found:
        known = _known(blocks)
        raise DeckError(
            "no *BOUNDARY in a step moves anything by an AMPLITUDE; give the probe's "
            f"one (the deck has {known}){blocks.unread}"
        )
    listed = ", ".join(f"{name} ({where})" for name, where in found.items())
    raise DeckError(f"several amplitudes move something: {listed}; name one")


def _known(blocks: Blocks) -> str:
    names = [
        f"{block.word('NAME') or 'one without a name'} ({block.where})"
        for block in blocks.of("AMPLITUDE")
    ]
    return f"the amplitudes {', '.join(names)}" if names else "no *AMPLITUDE"


def _definition(blocks: Blocks, name: str) -> Block:
    found = [block for block in blocks.of("AMPLITUDE") if block.word("NAME") == name]
    if not found:
        raise DeckError(
            f"no *AMPLITUDE, NAME={name} in the deck; it has {_known(blocks)}{blocks.unread}"
        )
    if len(found) > 1:
        both = " and ".join(block.where for block in found)
        raise DeckError(f"*AMPLITUDE, NAME={name} stands at {both}; keep one")
    (curve,) = found
    if not curve.own:
        raise curve.error(f"*AMPLITUDE, NAME={name} is in an included file; put it into the deck")
    curve.rows()
    return curve


def _check_curve(curve: Block) -> None:
    allowed = {
        "NAME": None,
        "TIME": ("STEPTIME", "TOTALTIME"),
        "DEFINITION": ("TABULAR",),
        "VALUE": ("RELATIVE",),
        "SMOOTH": None,
    }
    for option in curve.card.options:
        if option.name == "INPUT":
            raise curve.error("its data is in another file; put it into the deck")
        if option.name not in allowed:
            raise curve.error(
                f"*AMPLITUDE with {option.name}: what it does to a waveform is not "
                "known here; take it out"
            )
        words = allowed[option.name]
        if words is not None and option.word not in words:
            expected = " or ".join(words)
            raise curve.error(f"*AMPLITUDE with {option.name}={option.value}, expected {expected}")


def _step_of(
    name: str, users: list[Block], steps: list[Step], wanted: str | None, curve: Block
) -> Step:
    mine = [step for step in steps if any(user in step.block for user in users)]
    outside = [user for user in users if user.keyword == "BOUNDARY"]
    outside = [user for user in outside if not any(user in one.block for one in steps)]
    if outside:
        raise outside[0].error(
            f"*BOUNDARY with amplitude {name} is in no step; put it into the one that it belongs to"
        )
    if not mine:
        raise curve.error(f"no *BOUNDARY of a step uses amplitude {name}")
    if wanted is not None:
        step = step_named(steps, wanted)
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
        where = next(user.where for user in users if user in step.block)
        raise DeckError(f"{where}: the magnitudes with amplitude {name} are 0: nothing would move")


def _is_displacement(block: Block) -> bool:
    return block.word("TYPE") in ("", "DISPLACEMENT")


def _magnitudes(block: Block) -> Iterator[Push]:
    """Give what a ``*BOUNDARY`` moves; zero magnitudes hold and do not move."""
    for text, row in block.placed_rows():
        what, first, last, size, *_ = (*row.words, "", "", "")
        if not (first.isascii() and first.isdigit()):  # ENCASTRE and the like
            continue
        magnitude = number(size, text, row.line, blank=0.0)
        if magnitude == 0:
            continue
        axis = whole(first, text, row.line)
        end = whole(last, text, row.line, blank=axis)
        where = place_of(text, row.line)
        for one in range(axis, min(end, _LAST_DEGREE) + 1):
            yield Push(magnitude, one, what, where)


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


def _start_s(blocks: Blocks, steps: list[Step], chosen: Step, *, needed: bool) -> float | None:
    try:
        for block in blocks.of("RESTART"):
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
