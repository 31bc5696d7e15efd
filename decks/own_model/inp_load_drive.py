"""The load of a keyword deck that becomes the waveform: forces at nodes, or pressure on a surface.

    *CLOAD, AMPLITUDE=PRESS                *DSLOAD
    TIP, 2, -0.01                          SKIN, P, 0.02

The lines of one load belong together: all that have one amplitude, or all without one, of the step.
Their shares stay. A force is the sum of the vectors on all nodes of the lines at amplitude 1, a
pressure their common magnitude. The amplitude is the waveform divided by that size, so the signs of
the deck say which way is into the skin.
"""

from collections.abc import Sequence
from contextlib import suppress
from itertools import chain

import numpy as np

from decks.inp import Block, Deck, members, normalized_name
from decks.own_model import LoadScale, Request
from decks.own_model.inp_drive import (
    OWN_AMPLITUDE,
    OWN_RAMP,
    Drive,
    Push,
    Step,
    find_drive,
    node_sets_of,
    periods_s,
    refuse_foreign,
    reusable_amplitude,
    select_step,
    steps_of,
)
from decks.own_model.inp_loads import Load, TargetSets, loads_in, value_before
from fembridge.errors import DeckError

_KEYWORDS = {"force": ("CLOAD",), "pressure": ("DLOAD", "DSLOAD")}
_TRANSLATIONS = ("1", "2", "3")
_MAX_LISTED = 5
_RATIO_TOLERANCE = 1e-9
_NEGLIGIBLE = 1e-12  # of the sum of magnitudes: forces that cancel


def drive_of(deck: Deck, request: Request) -> Drive:
    """What becomes the waveform: a load where the request has a scale, else a displacement.

    Raises
    ------
    DeckError
        There is none, or several could be meant.
    """
    if request.load is not None:
        return _find_load(deck, request, request.load)
    try:
        return find_drive(deck, request)
    except DeckError as error:
        if request.move is None and request.amplitude is None and (hint := _hint(deck)):
            error.problem += hint
            error.args = (error.problem, *error.args[1:])
        raise


def _hint(deck: Deck) -> str:
    """How a deck without a displacement is driven by its load; "" without a load."""
    with suppress(DeckError):
        for quantity, option in (("force", "--newton-per-um K"), ("pressure", "--mpa-per-um K")):
            for load in _candidates(steps_of(deck), quantity):
                return f"; {load[1].name} ({load[1].where}) takes the waveform by {option}"
    return ""


def _candidates(steps: Sequence[Step], quantity: str) -> list[tuple[Step, Load]]:
    """The loads of a quantity in all steps."""
    return [
        (step, load)
        for step in steps
        for block in step.blocks_of(*_KEYWORDS[quantity])
        for load in loads_in(block)
        if load.magnitude
        and (load.label in _TRANSLATIONS if quantity == "force" else load.label.startswith("P"))
    ]


def _find_load(deck: Deck, request: Request, scale: LoadScale) -> Drive:
    steps = steps_of(deck)
    candidates = _candidates(steps, scale.quantity)
    listed = "; ".join(f"{load.name} ({load.where})" for _, load in candidates[:_MAX_LISTED])
    cards = " or ".join(f"*{keyword}" for keyword in _KEYWORDS[scale.quantity])
    if not candidates:
        raise DeckError(f"no {cards} in a step, expected a {scale.quantity}{deck.unread}")
    matches, description = candidates, f"a {scale.quantity}"
    if request.moved_load is not None:
        target, label = request.moved_load
        description = request.move or ""
        matches = [
            (step, load)
            for step, load in candidates
            if (normalized_name(load.target), load.label) == (target, label)
        ]
    else:
        names = {
            load.amplitude: load.where
            for _, load in reversed(candidates)
            if not load.amplitude.startswith(OWN_RAMP)
        }
        name = OWN_AMPLITUDE if OWN_AMPLITUDE in names else ""
        name = name or normalized_name(request.amplitude or "")
        if not name and len(names) > 1:
            options = ", ".join(
                f"{key or 'none'} ({where})" for key, where in reversed(names.items())
            )
            problem = f"several loads: {listed}, of amplitudes {options}; name one by --amplitude "
            raise DeckError(f"{problem}(amplitude), or by --move TARGET,LABEL", expected=options)
        name = name or next(iter(names))
        description = f"a {scale.quantity} by amplitude {name}" if name else description
        matches = [(step, load) for step, load in candidates if load.amplitude == name]
    if not matches:
        raise DeckError(
            f"no {cards} of a step is {description}; loads: {listed}{deck.unread}", expected=listed
        )
    step = select_step(
        steps, [step for step, _ in matches], description, request.step, use_last=True
    )
    loads = [load for at, load in matches if at is step]
    for load in loads:
        refuse_foreign(load.block, load.name)
    factor = _force(deck, loads) if scale.quantity == "force" else _pressure(loads)
    start_s = None
    with suppress(DeckError):
        start_s = sum(periods_s(deck, steps[: step.number])[:-1])
    before = steps[: step.number - 1]
    pushes = [
        Push(
            load.block,
            load.row,
            load.target,
            int(load.label) if load.label in _TRANSLATIONS else 0,
            load.magnitude,
            label=load.label,
        )
        for load in loads
    ]
    return Drive(
        amplitude=reusable_amplitude(deck, pushes, start_s),
        step=step,
        steps=tuple(steps),
        push=tuple(pushes),
        factor=factor,
        start_depth=factor * _start_share(deck, before, loads),
        start_s=start_s,
    )


def _start_share(deck: Deck, before: Sequence[Step], loads: Sequence[Load]) -> float:
    """The share of the loads that the steps `before` leave; the same of each."""
    sets = TargetSets(deck)
    shares = [value_before(deck, before, load, sets) / load.magnitude for load in loads]
    for load, share in zip(loads, shares, strict=True):
        if abs(share - shares[0]) > _RATIO_TOLERANCE * max(1.0, abs(share)):
            raise DeckError(
                f"{load.where}: {load.name} has {share:g} of its size when its step begins, "
                f"{loads[0].where} {shares[0]:g}: one waveform cannot begin at both"
            )
    return shares[0]


def _pressure(loads: Sequence[Load]) -> float:
    """The size of the pressure of all `loads`."""
    first = loads[0]
    for load in loads:
        if abs(load.magnitude) != abs(first.magnitude):
            raise DeckError(
                f"{load.where}: pressure {load.magnitude:g}, but {first.magnitude:g} at "
                f"{first.where}: one amplitude cannot give both the waveform; --move "
                f"{load.target},{load.label} gives it a separate one"
            )
    return abs(first.magnitude)


def _force(deck: Deck, loads: Sequence[Load]) -> float:
    """The size of the sum of the forces of `loads` on all their nodes."""
    total, sizes = np.zeros(3), 0.0
    for load in loads:
        force = load.magnitude * _node_count(deck, load)
        total[int(load.label) - 1] += force
        sizes += abs(force)
    factor = float(np.linalg.norm(total))
    if factor <= _NEGLIGIBLE * sizes:
        raise DeckError(
            f"{loads[0].where}: the forces cancel: their sum is {factor:g}, which no waveform can "
            "scale; name a part of them by --move NSET,DOF"
        )
    return factor


def _node_count(deck: Deck, load: Load) -> int:
    """How many nodes a line of forces acts on, each with all of its magnitude."""
    if load.target.isascii() and load.target.replace(".", "").isdigit():
        return 1
    name = normalized_name(load.target)
    runs = node_sets_of(deck).get(name)
    numbers = set(chain.from_iterable(runs)) if runs is not None else _nodes_listed(deck, name)
    if not numbers:
        raise DeckError(
            f"{load.where}: how many nodes {load.target} has is not known, and each takes "
            f"{load.magnitude:g}{deck.unread}; list them in an *NSET of numbers"
        )
    return len(numbers)


def _nodes_listed(deck: Deck, name: str) -> set[tuple[str, int]]:
    """Instance and number of the nodes that the blocks of a set list; none if one is a name."""
    blocks: list[Block] = [
        block for block in deck.blocks_of("NSET") if block.value_of("NSET") == name
    ]
    try:
        return {
            (block.value_of("INSTANCE"), number)
            for block in blocks
            for run in members(block, {})
            for number in run
        }
    except DeckError:
        return set()
