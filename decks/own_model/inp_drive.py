"""The displacement of a keyword deck that becomes the waveform, its step and start depth.

    *BOUNDARY, AMPLITUDE=PRESS
    PROBE, 2, 2, -0.05

A displacement is magnitude times amplitude: for a depth in the deck's unit, the
amplitude is the depth divided by the magnitude's size. Its sign, which says where
the skin is, stays the user's. A displacement without an amplitude, which solvers ramp,
or with one that other steps use too, gets an amplitude of its own.

Depth is measured from the position of the probe after the earlier steps. A missing, ambiguous
or unusable entry is a DeckError with its line.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from decks.inp import Block, Deck, Row, node_sets, normalized_name
from decks.own_model import Request
from fembridge.errors import DeckError

# The amplitude that we put in where the deck has none for the waveform alone.
OWN_AMPLITUDE = "FEMBRIDGE_WAVEFORM"
# Amplitudes that keep the ramps of other loads; their names begin so.
OWN_RAMP = "FEMBRIDGE_RAMP"
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
_MAX_LISTED = 5  # displacements, of those to choose from
_LAST_DEGREE = 100  # far beyond what any solver has
# Degrees of freedom that Abaqus holds by a word.
_HELD_DEGREES = {
    "XSYMM": (1, 1),
    "YSYMM": (2, 2),
    "ZSYMM": (3, 3),
    "ENCASTRE": (1, 6),
    "PINNED": (1, 3),
}
_LOADS = ("CLOAD", "DLOAD", "DSLOAD", "TEMPERATURE")
_DISPLACEMENT = ("", "DISPLACEMENT")
# What makes of a condition something else than magnitude times amplitude.
_FOREIGN = ("USER", "SUBMODEL", "FIXED", "MASSFLOW", "TIMEDELAY", "LOADCASE")
_DEPTH_TOLERANCE = 1e-9
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

    def blocks_of(self, *keywords: str) -> list[Block]:
        """The step's blocks that have one of `keywords`."""
        return [block for block in self.blocks if block.keyword in keywords]


@dataclass(frozen=True, slots=True, eq=False)
class Push:
    """A line `row` of `block` that prescribes `magnitude` along `axis` of a set or node.

    `by_request` where the request gives the direction and the line another one, or none. Of a
    load `label` is its degree of freedom or kind, such as P.
    """

    block: Block
    row: Row
    target: str
    axis: int
    magnitude: float
    by_request: bool = False
    label: str = ""

    @property
    def where(self) -> str:
        """The line, as an error names it."""
        return self.row.where

    @property
    def name(self) -> str:
        """As ``--move`` names it."""
        return f"{self.target},{self.label or self.axis}"

    @property
    def amplitude(self) -> str:
        """The amplitude that it is multiplied by; "" for none."""
        return self.block.value_of("AMPLITUDE")


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """The displacements that become the waveform, and their step.

    `amplitude` is the deck's own for it, None where it gets one. `factor` is the size of
    the magnitudes that it is multiplied by, `start_depth` the depth in the deck's unit at
    which the step finds the probe. The step begins at `start_s` of total time; None where
    that is not known.
    """

    amplitude: Block | None
    step: Step
    steps: tuple[Step, ...]
    push: tuple[Push, ...]
    factor: float
    start_depth: float
    start_s: float | None

    @property
    def total_time(self) -> bool:
        """Whether the amplitude counts total time, not that of the step."""
        return self.amplitude is not None and _counts_total_time(self.amplitude)


def find_drive(deck: Deck, request: Request) -> Drive:
    """Find displacement and step that the request names, or the only ones that there can be.

    An amplitude means all that it moves in its step, ``--move`` the one displacement. An
    amplitude that something else needs too, or that cannot hold a waveform, stays as it is.
    """
    steps = steps_of(deck)
    candidates = [
        (step, push)
        for step in steps
        for block in step.blocks_of("BOUNDARY")
        for push in load_magnitudes(block, zero=request.move is not None)
        if push.axis in _TRANSLATIONS and block.value_of("TYPE") in _DISPLACEMENT
    ]
    name = "" if request.move else _amplitude_name(candidates, request)
    target, axis, sign = request.moved or ("", 0, 0)
    matches = [
        (step, push)
        for step, push in candidates
        if (not name or push.amplitude == name)
        and (not axis or (normalized_name(push.target), push.axis) == (target, axis))
    ]
    description = f"anything by amplitude {name}" if name else request.move or "anything"
    if not matches:
        raise DeckError(
            f"no *BOUNDARY of a step moves {description}; displacements: "
            f"{_list_displacements(candidates) or 'none'} (the deck has {list_amplitudes(deck)})"
            f"{deck.unread}; write the probe's displacement into its step, as PROBE, 2, 2, -0.1"
        )
    chosen_step = select_step(
        steps, [step for step, _ in matches], description, request.step, use_last=not name
    )
    pushes = [push for step, push in matches if step is chosen_step]
    if not name:
        pushes = [_single_displacement(chosen_step, pushes, candidates, sign)]
    first = pushes[0]
    if request.step is None:
        _refuse_later_motion(deck, steps[chosen_step.number :], pushes)
    for push in pushes:
        refuse_foreign(push.block, push.name)
        if abs(push.magnitude) != abs(first.magnitude):
            raise DeckError(
                f"{push.where}: magnitude {push.magnitude:g}, but {first.magnitude:g} at "
                f"{first.where}: one amplitude cannot give both the waveform's depth; --move "
                f"{push.name} gives it a separate one"
            )
    start_s = None
    with suppress(DeckError):
        start_s = sum(periods_s(deck, steps[: chosen_step.number])[:-1])
    before = steps[: chosen_step.number - 1]
    sets = node_sets_of(deck) if before else {}
    depths = [
        np.sign(push.magnitude) * _start_displacement(deck, before, push, sets) for push in pushes
    ]
    for push, depth in zip(pushes, depths, strict=True):
        if abs(depth - depths[0]) > _DEPTH_TOLERANCE * abs(depth):
            raise DeckError(
                f"{push.where}: {push.name} is {depth:g} deep when its step begins, but "
                f"{first.name} is {depths[0]:g} deep: one waveform cannot begin at both"
            )
    return Drive(
        amplitude=reusable_amplitude(deck, pushes, start_s),
        step=chosen_step,
        steps=tuple(steps),
        push=tuple(pushes),
        factor=abs(first.magnitude),
        start_depth=float(depths[0]),
        start_s=start_s,
    )


def _amplitude_name(candidates: list[tuple[Step, Push]], request: Request) -> str:
    """The requested amplitude, or the only one that moves something; "" if there is none."""
    amplitudes = {
        push.amplitude: push.block.where
        for _, push in reversed(candidates)
        if push.amplitude and not push.amplitude.startswith(OWN_RAMP)
    }
    if OWN_AMPLITUDE in amplitudes:
        return OWN_AMPLITUDE  # a deck that has been here before
    if request.amplitude:
        return normalized_name(request.amplitude)
    if len(amplitudes) > 1:
        listed = ", ".join(f"{name} ({where})" for name, where in reversed(amplitudes.items()))
        problem = f"several amplitudes move something: {listed}; --amplitude (amplitude) names one"
        raise DeckError(problem, expected=listed)
    return next(iter(amplitudes), "")


def _refuse_later_motion(deck: Deck, later: Sequence[Step], pushes: Sequence[Push]) -> None:
    """Refuse steps after the waveform's, which are left out, that prescribe what it moves."""
    sets = node_sets_of(deck) if later else {}
    for step in later:
        for block in step.blocks_of("BOUNDARY"):
            for push in pushes:
                if (line := _prescribing_line(block, push, sets)) is not None:
                    raise DeckError(
                        f"several steps move {push.name}: {push.where} and, in {step.name}, "
                        f"{line.where}; the run ends with the waveform's step: name it by --step"
                    )


def _single_displacement(
    step: Step, matches: list[Push], candidates: list[tuple[Step, Push]], sign: int
) -> Push:
    """The only displacement of `matches`, in the direction `sign` unless that is 0."""
    push = matches[-1]  # the last line counts
    if any(other.name != push.name for other in matches):
        raise step.head.error(
            f"several displacements: {_list_displacements(candidates)}; "
            f"name one: --move {matches[0].name}"
        )
    if sign and sign != np.sign(push.magnitude):
        push = replace(push, magnitude=float(sign), by_request=True)
    if push.magnitude == 0:
        raise DeckError(
            f"{push.where}: {push.name} is held at 0, which gives no direction; write "
            f"--move {push.target},-{push.axis} where the skin is on the negative side, or +"
        )
    if push.row.integer(1) != push.row.integer(2, blank=push.axis):
        raise DeckError(
            f"{push.where}: degrees of freedom {push.row.fields[1]} to {push.row.fields[2]} "
            f"in one line; give {push.axis} a line of its own"
        )
    return push


def reusable_amplitude(deck: Deck, push: list[Push], start_s: float | None) -> Block | None:
    """The amplitude of `push`, if it can hold a waveform and has no other user; else None."""
    name, waveform_lines = push[0].amplitude, {line.where for line in push}
    for block in deck.blocks:
        if block.value_of("AMPLITUDE") == name and block.keyword != "STEP":
            lines: Iterable[Push | Row | None] = [None]
            if block.keyword == "BOUNDARY":
                lines = load_magnitudes(block)
            elif block.keyword in _LOADS:
                lines = block.rows()
            if any(line is None or line.where not in waveform_lines for line in lines):
                return None
    with suppress(DeckError):
        curve = _definition(deck, name)
        texts = [curve.text, *(row.text for row in curve.rows())]
        if not any(text.name for text in texts) and not (
            _counts_total_time(curve) and start_s is None
        ):
            return curve
    return None


def _counts_total_time(curve: Block) -> bool:
    """Whether an amplitude counts total time, not that of the step."""
    return curve.value_of("TIME") == "TOTALTIME"


def steps_of(deck: Deck) -> list[Step]:
    """The steps of a deck; a DeckError without any, or for one that does not end."""
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


def _list_displacements(candidates: list[tuple[Step, Push]]) -> str:
    """The displacements to choose from, those that move first."""
    moving = sorted((push for _, push in candidates), key=lambda push: push.magnitude == 0)
    names = list(dict.fromkeys(f"{push.name} ({push.where})" for push in moving))
    more = f" and {len(names) - _MAX_LISTED} more" if len(names) > _MAX_LISTED else ""
    return "; ".join(names[:_MAX_LISTED]) + more


def list_amplitudes(deck: Deck) -> str:
    """The amplitudes of a deck with their lines, for a message."""
    names = [
        f"{block.value_of('NAME') or 'one without a name'} ({block.where})"
        for block in deck.blocks_of("AMPLITUDE")
    ]
    return f"the amplitudes {', '.join(names)}" if names else "no *AMPLITUDE"


def _definition(deck: Deck, name: str) -> Block:
    """The amplitude `name`, of a kind whose data are times and values, linear between them."""
    curves = [block for block in deck.blocks_of("AMPLITUDE") if block.value_of("NAME") == name]
    if len(curves) != 1:
        raise DeckError(
            f"{len(curves)} *AMPLITUDE, NAME={name}; the deck has {list_amplitudes(deck)}"
        )
    (curve,) = curves
    for option in curve.options:
        choices = _CURVE_OPTIONS.get(option.name, ())
        if choices is not None and option.normalized not in choices:
            option_text = option.name if option.value is None else f"{option.name}={option.value}"
            raise curve.error(f"*AMPLITUDE with {option_text}: its value at a time is not known")
    return curve


def select_step(
    steps: list[Step], candidates: list[Step], name: str, requested: str | None, *, use_last: bool
) -> Step:
    """The requested step, else the only one (or the last) of `candidates`, which move `name`."""
    candidates = list({step.number: step for step in candidates}.values())
    if requested is None:
        if len(candidates) > 1 and not use_last:
            listed = "; ".join(step.name for step in candidates)
            problem = f"several steps move {name}: {listed}; --step (step) names one"
            raise DeckError(problem, expected=listed)
        return candidates[-1]
    for step in steps:
        if (
            requested.strip() == str(step.number)
            or step.head.value_of("NAME") == normalized_name(requested) != ""
        ):
            if step in candidates:
                return step
            available = "; ".join(step.name for step in candidates)
            raise step.head.error(f"no *BOUNDARY here moves {name}; steps that do: {available}")
    names = "; ".join(step.name for step in steps)
    raise DeckError(argument="step", found=requested, expected=f"one of: {names}")


def refuse_foreign(block: Block, name: str) -> None:
    """Refuse a displacement or load `name` that is not its magnitude times its amplitude."""
    foreign = [name for name in _FOREIGN if block.option(name) is not None]
    if block.keyword == "BOUNDARY" and block.value_of("TYPE") not in _DISPLACEMENT:
        foreign = [f"TYPE={block.value_of('TYPE')}"]
    if foreign:
        raise block.error(
            f"{block.title} with {foreign[0]}: {name} would not follow the waveform, a displacement"
        )


def load_magnitudes(block: Block, *, zero: bool = False) -> Iterator[Push]:
    """Displacements that a ``*BOUNDARY`` prescribes; with `zero`, also those of 0."""
    for row in block.rows():
        target, first, *_ = (*row.fields, "")
        if first.isascii() and first.isdigit():
            axis, magnitude = row.integer(1), row.number(3, blank=0.0)
            last = row.integer(2, blank=axis)
        else:
            axis, last = _HELD_DEGREES.get(normalized_name(first), (1, 0))
            magnitude = 0.0
        if magnitude or zero:
            for degree in range(axis, min(last, _LAST_DEGREE) + 1):
                yield Push(block, row, target, degree, magnitude)


# ---- Where the steps before leave the probe


def _start_displacement(
    deck: Deck, steps: Sequence[Step], push: Push, sets: Mapping[str, list[range]]
) -> float:
    """The displacement of what `push` moves at the end of `steps`, in the deck's unit."""
    prescribed: Push | None = None
    displacement = 0.0
    for block in deck.blocks:
        if block.keyword == "STEP":
            break
        if block.keyword == "BOUNDARY":
            prescribed = _prescribing_line(block, push, sets) or prescribed
    for step in steps:
        conditions = step.blocks_of("BOUNDARY")
        if any(block.value_of("OP") == "NEW" for block in conditions):
            prescribed = None
        for block in conditions:
            prescribed = _prescribing_line(block, push, sets) or prescribed
        moving = chain.from_iterable(map(load_magnitudes, conditions))
        if prescribed is None:
            acting = [line.where for line in moving if line.axis in _TRANSLATIONS]
            if acting := acting or [line.where for line in step.blocks_of(*_LOADS)]:
                raise DeckError(
                    f"{push.where}: where {push.target} stands when its step begins is not known: "
                    f"step {step.number} ({acting[0]}) leaves its degree of freedom {push.axis} "
                    "free; prescribe it there"
                )
        elif prescribed.block.option("FIXED") is None:
            displacement = _end_displacement(deck, steps[: step.number], prescribed)
    return displacement


def node_sets_of(deck: Deck) -> Mapping[str, list[range]]:
    """The node sets; none of a deck whose sets take more than reading (Abaqus's instances)."""
    try:
        return node_sets(deck)
    except DeckError:
        return {}


def _prescribing_line(block: Block, push: Push, sets: Mapping[str, list[range]]) -> Push | None:
    """The last line of `block` that prescribes what `push` moves, along its axis."""

    def nodes(target: str) -> set[int]:
        if target.isascii() and target.isdigit():
            return {int(target)}
        return set(chain.from_iterable(sets.get(normalized_name(target), ())))

    match = None
    own_nodes = nodes(push.target)
    for line in load_magnitudes(block, zero=True):
        if line.axis != push.axis:
            continue
        line_nodes = nodes(line.target)
        if normalized_name(line.target) == normalized_name(push.target) or (
            own_nodes and own_nodes <= line_nodes
        ):
            match = line
        elif own_nodes & line_nodes:
            raise DeckError(
                f"{line.where}: prescribes only a part of {push.target} ({push.where}), which "
                "is then at more than one depth when the waveform begins"
            )
    return match


def _end_displacement(deck: Deck, steps: Sequence[Step], prescribed: Push) -> float:
    """The displacement that `held` prescribes at the end of the last of `steps`."""
    refuse_foreign(prescribed.block, prescribed.name)
    name = prescribed.block.value_of("AMPLITUDE")
    if not name:
        return prescribed.magnitude
    return prescribed.magnitude * amplitude_value(deck, name, steps)


def amplitude_value(deck: Deck, name: str, steps: Sequence[Step]) -> float:
    """The amplitude `name` at the end of the last of `steps`; at time 0 without steps.

    Raises
    ------
    DeckError
        The amplitude has no points in time, or a time that is not known.
    """
    curve = _definition(deck, name)
    step_s = periods_s(deck, steps)
    end_s = sum(step_s) if _counts_total_time(curve) else sum(step_s[-1:])
    cells = [
        (row, index) for row in curve.rows() for index, field in enumerate(row.fields) if field
    ]
    numbers = [row.number(index) for row, index in cells]
    if not numbers or len(numbers) % 2:
        raise curve.error(f"amplitude {name} has {len(numbers)} numbers, expected pairs")
    return float(np.interp(end_s, numbers[::2], numbers[1::2]))


def periods_s(deck: Deck, steps: Sequence[Step]) -> list[float]:
    """How long each of `steps` takes, from total time 0 on."""
    clocks = [(block, "READ") for block in deck.blocks_of("RESTART")]
    step_s = []
    for step in steps:
        procedures = step.blocks_of(*_TIMED)
        if len(procedures) != 1:
            raise step.head.error(
                "how long this step takes is not known (no *STATIC, *DYNAMIC, *VISCO), "
                "and the waveform's amplitude counts total time; let it count step time"
            )
        step_s.append(period_s(procedures[0]))
        clocks += [(procedures[0], name) for name in ("TIMERESET", "TOTALTIMEATSTART")]
    for block, name in clocks:
        if block.option(name) is not None:
            raise block.error(
                f"{name} sets the clock, and the waveform's amplitude counts total time; "
                "let it count step time"
            )
    return step_s


def period_s(procedure: Block) -> float:
    """How long the step of a procedure takes; solvers take 1 s where it is not stated."""
    row = next(procedure.rows(), None)
    return 1.0 if row is None else row.number(1, blank=0.0) or 1.0
