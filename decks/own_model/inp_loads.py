"""Other loads of the waveform's step: their course over time, and the state at time 0.

Without an amplitude a static step ramps a load over its own length, from where the step before
left it to its magnitude:

    *STATIC
    0.1, 1.
    *DLOAD
    EALL, GRAV, 9810., 0., 0., -1.       full after 1 s

The waveform gives the step another length, so such a load gets an amplitude that keeps its ramp.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from decks.inp import Block, Deck, Row, normalized_name
from decks.own_model.inp_drive import (
    Drive,
    Push,
    Step,
    amplitude_value,
    load_magnitudes,
    node_sets_of,
)
from decks.own_model.inp_model import element_sets
from fembridge.errors import DeckError

# Keywords of loads, each with the field of its label (a degree of freedom, GRAV, P1) and that of
# its magnitude; a displacement has a reader of its own.
_FIELDS = {"CLOAD": (1, 2), "DLOAD": (1, 2), "DSLOAD": (1, 2), "TEMPERATURE": (None, 1)}
LOADS = ("BOUNDARY", *_FIELDS)
_RAMPED = ("STATIC", "VISCO")
_NEGLIGIBLE = 1e-9  # a force that moves nothing, as our own decks have one
# Materials that keep a strain.
_YIELDING = (
    *("PLASTIC", "CYCLICHARDENING", "DRUCKERPRAGER", "MOHRCOULOMB", "CAPPLASTICITY"),
    *("CASTIRONPLASTICITY", "DAMAGEEVOLUTION", "MULLINSEFFECT"),
)
_ROUNDING = 1e-6  # of an amplitude's values, relative
_SETTLE = (
    "put it into a *STATIC step of its own before the waveform's, in which the model settles: the "
    "end of that step is then the first row of a trace"
)


@dataclass(frozen=True, slots=True, eq=False)
class Load:
    """A line `row` of `block`: `magnitude` on `target`; `label` is its direction or kind."""

    block: Block
    row: Row
    target: str
    label: str
    magnitude: float

    @property
    def where(self) -> str:
        """File and line."""
        return self.row.where

    @property
    def name(self) -> str:
        """The load as its line names it."""
        return ", ".join(filter(None, (self.block.title, self.target, self.label)))

    @property
    def amplitude(self) -> str:
        """Name of its amplitude; "" without one."""
        return self.block.value_of("AMPLITUDE")


@dataclass(frozen=True, slots=True, eq=False)
class Ramp:
    """Rows of `block` that a step ramps from `start` times their magnitude to all of it."""

    block: Block
    loads: tuple[Load, ...]
    start: float


def loads_in(block: Block) -> Iterator[Load]:
    """The loads of a block, displacements of 0 included."""
    if block.keyword == "BOUNDARY":
        for push in load_magnitudes(block, zero=True):
            yield Load(block, push.row, push.target, str(push.axis), push.magnitude)
        return
    if block.keyword == "INITIALCONDITIONS":  # of temperature, from which a step starts
        label, value = None, 1
    else:
        label, value = _FIELDS[block.keyword]
    for row in block.rows():
        text = "" if label is None or len(row.fields) <= label else row.fields[label]
        yield Load(block, row, row.fields[0], normalized_name(text), row.number(value, blank=0.0))


def ramps(deck: Deck, drive: Drive, *, abaqus: bool) -> list[Ramp]:
    """Other loads that the waveform's step ramps.

    Raises
    ------
    DeckError
        A load whose value at the start of the step is not known, or that is ramped to 0.
    """
    if not _is_ramped(drive.step, abaqus=abaqus):
        return []
    driven = {push.row.start for push in drive.push}
    before = drive.steps[: drive.step.number - 1]
    sets = TargetSets(deck)
    ramped: list[Ramp] = []
    for block in drive.step.blocks_of(*LOADS):
        if block.value_of("AMPLITUDE") or block.value_of("TYPE") not in ("", "DISPLACEMENT"):
            continue
        if block.option("USER") is not None:
            continue  # a subroutine knows the time by itself
        if block.option("FILE") is not None:
            raise block.error(
                f"{block.title}, FILE: how it goes over the waveform's step is not known"
            )
        by_start: dict[float, list[Load]] = {}
        for load in loads_in(block):
            if load.row.start in driven:
                continue
            start = value_before(deck, before, load, sets)
            if start == load.magnitude or abs(load.magnitude - start) < _NEGLIGIBLE:
                continue
            if load.magnitude == 0:
                raise DeckError(
                    f"{load.where}: {load.name} goes from {start:g} to 0 over the step, whose "
                    "length becomes the waveform's; give it an amplitude and a magnitude"
                )
            by_start.setdefault(start / load.magnitude, []).append(load)
        ramped += [Ramp(block, tuple(loads), start) for start, loads in by_start.items()]
    return ramped


def _is_ramped(step: Step, *, abaqus: bool) -> bool:
    """Whether loads without an amplitude are ramped over a step, not applied at once."""
    if stated := step.head.value_of("AMPLITUDE"):
        return stated == "RAMP"
    ramped = _RAMPED[:1] if abaqus else _RAMPED  # in Abaqus *VISCO applies them at once
    return bool(step.blocks_of(*ramped))


class TargetSets:
    """The nodes and elements that the targets of loads share."""

    def __init__(self, deck: Deck) -> None:
        self._sets = {"": node_sets_of(deck), "D": element_sets(deck.blocks)}

    def overlap(self, load: Load, other: Load) -> str:
        """Share of the target of `load` on which `other` acts too: all, part or none.

        Two surfaces of different names count as none, other sets that are not known as part.
        """
        if normalized_name(load.target) == normalized_name(other.target):
            return "all"
        if load.block.keyword == "DSLOAD":
            return "none"
        first, second = (self._members(item) for item in (load, other))
        if not first or not second:
            return "part"
        if first.isdisjoint(second):
            return "none"
        return "all" if first <= second else "part"

    def _members(self, load: Load) -> set[int]:
        if load.target.isascii() and load.target.isdigit():
            return {int(load.target)}
        kind = "D" if load.block.keyword == "DLOAD" else ""
        return set(chain.from_iterable(self._sets[kind].get(normalized_name(load.target), ())))


def value_before(deck: Deck, before: Sequence[Step], load: Load, sets: TargetSets) -> float:
    """The magnitude that the steps `before` leave on the target of `load`; 0 for none."""
    keyword = load.block.keyword
    value = 0.0
    initial = [
        block
        for block in deck.blocks_of("INITIALCONDITIONS")
        if keyword == "TEMPERATURE" and block.value_of("TYPE") == "TEMPERATURE"
    ]
    stages: list[tuple[Sequence[Step], list[Block]]] = [(before[:0], initial)]
    stages += [(before[: step.number], step.blocks_of(keyword)) for step in before]
    for steps, blocks in stages:
        if any(block.value_of("OP") == "NEW" for block in blocks):
            value = 0.0
        for earlier in chain.from_iterable(map(loads_in, blocks)):
            if earlier.label != load.label:
                continue
            overlap = sets.overlap(load, earlier)
            if overlap == "none":
                continue
            if overlap == "part":
                if load.magnitude == 0 or earlier.magnitude in (0, load.magnitude):
                    continue
                raise DeckError(
                    f"{load.where}: {load.name} has no amplitude, and from which value its step "
                    f"ramps it is not known ({earlier.where} acts on {earlier.target}); give it "
                    "an amplitude, or the same set"
                )
            value = earlier.magnitude
            if earlier.amplitude:
                value *= amplitude_value(deck, earlier.amplitude, steps)
    return value


def acts_at_start(deck: Deck, drive: Drive) -> list[str]:
    """Why the model may hold stress at time 0 that no output of CalculiX has; with lines.

    For a waveform in the first step. Initial stress is not in it (see `initial_stress`).
    """
    step = drive.step
    reasons = [
        f"{block.where}: {block.title}, READ starts from the state of another run; {_SETTLE}"
        for block in deck.blocks_of("RESTART")
        if block.option("READ") is not None
    ]
    reasons += [
        f"{block.where}: {block.title}, TYPE={block.value_of('TYPE')}: which stress the model "
        f"holds at time 0 is not known; {_SETTLE}"
        for block in deck.blocks_of("INITIALCONDITIONS")
        if block.value_of("TYPE") == "PLASTICSTRAIN"
    ]
    if step.blocks_of("DYNAMIC"):  # inertia: nothing has moved yet
        return reasons
    at_once = step.head.value_of("AMPLITUDE") == "STEP"
    driven = {push.row.start for push in drive.push}
    sets = TargetSets(deck)
    for block in step.blocks_of(*LOADS):
        name = block.value_of("AMPLITUDE")
        if not name and not at_once:
            continue
        for load in loads_in(block):
            if load.row.start in driven or load.magnitude == 0:
                continue
            factor = amplitude_value(deck, name, ()) if name else 1.0
            at_rest = value_before(deck, (), load, sets)
            if abs(load.magnitude * factor - at_rest) > _ROUNDING * abs(load.magnitude):
                reasons.append(
                    f"{load.where}: {load.name} acts at time 0 already, with {factor:g} of its "
                    f"magnitude, and CalculiX writes no output there; {_SETTLE}"
                )
    return reasons


def time_dependence(deck: Deck, drive: Drive) -> list[str]:
    """Why stress depends on time as well as on depth in the waveform's step; with lines.

    What the step ramps is not in it (see `ramps`).
    """
    step = drive.step
    reasons = [
        f"{block.where}: *DYNAMIC has inertia: stress depends on acceleration"
        for block in step.blocks_of("DYNAMIC")
    ]
    reasons += [
        f"{block.where}: *VISCO solves creep and viscosity: stress depends on time"
        for block in step.blocks_of("VISCO")
    ]
    driven = {push.row.start for push in drive.push}
    for block in step.blocks_of(*LOADS):
        name = block.value_of("AMPLITUDE")
        if not name or all(
            load.row.start in driven or not load.magnitude for load in loads_in(block)
        ):
            continue
        if not is_constant(deck, name):
            reasons.append(
                f"{block.where}: {block.title} follows amplitude {name} beside the waveform"
            )
    return reasons


def is_constant(deck: Deck, name: str) -> bool:
    """Whether an amplitude is known to have one value at all times."""
    curves = [block for block in deck.blocks_of("AMPLITUDE") if block.value_of("NAME") == name]
    values: list[str] = []
    for curve in curves:
        for row in curve.rows():
            values += row.fields[1::2]
    return len(curves) == 1 and len({float(value) for value in values if value}) == 1


def path_dependence(deck: Deck, *, abaqus: bool) -> list[str]:
    """Why stress may depend on earlier depths, not on the present one alone; with lines."""
    reasons = [
        f"{block.where}: {block.title}, TYPE={block.value_of('TYPE')} is path-dependent in "
        "CalculiX (TYPE=NODE TO SURFACE is not)"
        for block in deck.blocks_of("CONTACTPAIR")
        if block.value_of("TYPE") == "SURFACETOSURFACE" and not abaqus
    ]
    reasons += [
        f"{block.where}: {block.title}: skin may slip under the probe"
        for block in deck.blocks_of("FRICTION")
    ]
    reasons += [
        f"{block.where}: {block.title}: yielding is permanent"
        for block in deck.blocks_of(*_YIELDING)
    ]
    reasons += [
        f"{block.where}: {block.title}, TYPE=STRESS: stress that is not in equilibrium at time 0 "
        "changes in the first increment; put a *STATIC step that holds the probe before"
        for block in deck.blocks_of("INITIALCONDITIONS")
        if block.value_of("TYPE") == "STRESS"
    ]
    reasons += [
        f"{block.where}: {block.title}: a material of your own may keep a state"
        for block in deck.blocks_of("USERMATERIAL")
    ]
    return reasons


def initial_stress(deck: Deck) -> tuple[dict[int, tuple[float, ...]], set[int]] | None:
    """Stress by element that the model starts with, xx yy zz xy yz zx, in the deck's unit.

    Of a deck for CalculiX. The second value has the elements in which it varies, or that have
    several values; None without initial stress.

    Raises
    ------
    DeckError
        The stress is in a subroutine, or a line is not one.
    """
    blocks = [
        block for block in deck.blocks_of("INITIALCONDITIONS") if block.value_of("TYPE") == "STRESS"
    ]
    if not blocks:
        return None
    stress: dict[int, tuple[float, ...]] = {}
    uneven: set[int] = set()
    for block in blocks:
        if block.option("USER") is not None:
            raise block.error(f"{block.title}, TYPE=STRESS, USER: its values are not in the deck")
        for row in block.rows():
            xx, yy, zz, xy, xz, yz = (row.number(index, blank=0.0) for index in range(2, 8))
            element, tensor = row.integer(0), (xx, yy, zz, xy, yz, xz)
            if stress.setdefault(element, tensor) != tensor:
                uneven.add(element)
    return stress, uneven


def mean_stress(
    elements: Sequence[int], stress: Mapping[int, tuple[float, ...]]
) -> tuple[float, ...]:
    """Mean over `elements`, as CalculiX writes it at their common node."""
    tensors = np.array([stress.get(element, (0.0,) * 6) for element in elements])
    return tuple(tensors.mean(axis=0).tolist())


def direction_text(deck: Deck, push: Push) -> str:
    """Where a displacement of positive sign leads: +x, or the axis of a ``*TRANSFORM``.

    The nodes of a ``*TRANSFORM`` have axes of their own: of TYPE=R the first goes through its
    point a, and point b is in the plane of the first two; of TYPE=C they are the radius, the
    angle and the axis from a to b.
    """
    sign = 1.0 if push.magnitude > 0 else -1.0
    block = _transform_of(deck, push)
    if block is None:
        return f"{'+' if sign > 0 else '-'}{' xyz'[push.axis]}"
    row = next(block.rows(), None)
    if row is None:
        raise block.error("*TRANSFORM without its two points")
    point_a, point_b = (
        np.array([row.number(index, blank=0.0) for index in numbers])
        for numbers in (range(3), range(3, 6))
    )
    if block.value_of("TYPE") == "C":
        if push.axis < 3:
            name = ("radius", "angle")[push.axis - 1]
            return f"{'+' if sign > 0 else '-'}{name} of *TRANSFORM ({block.where})"
        direction = point_b - point_a
    else:
        third = np.cross(point_a, point_b)
        direction = (point_a, np.cross(third, point_a), third)[push.axis - 1]
    size = np.linalg.norm(direction)
    if not size:
        return f"degree of freedom {push.axis} of *TRANSFORM ({block.where})"
    direction = sign * direction / size
    axis = int(np.abs(direction).argmax())
    if abs(abs(direction[axis]) - 1.0) < 1e-6:
        name = f"{'+' if direction[axis] > 0 else '-'}{'xyz'[axis]}"
    else:
        name = f"({', '.join(f'{value:.3g}' for value in direction + 0.0)})"
    return f"{name}, degree of freedom {push.axis} of *TRANSFORM ({block.where})"


def _transform_of(deck: Deck, push: Push) -> Block | None:
    """The last ``*TRANSFORM`` whose set has the nodes that `push` moves."""
    transforms = deck.blocks_of("TRANSFORM")
    if not transforms:
        return None
    sets = node_sets_of(deck)

    def nodes(target: str) -> set[int]:
        if target.isascii() and target.isdigit():
            return {int(target)}
        return set(chain.from_iterable(sets.get(normalized_name(target), ())))

    moved = nodes(push.target)
    for block in reversed(transforms):
        name = block.value_of("NSET")
        if name == normalized_name(push.target) or (moved and moved <= nodes(name)):
            return block
    return None
