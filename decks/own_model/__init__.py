"""A base deck: kept to the byte except for waveform, increments and output.

This module has the request and the result; `inp` and `marc` edit the two kinds of deck.
"""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from decks.dialects import INCREMENTS, RESULTS, SHELL_FACES
from decks.inp import normalized_name
from decks.motion import Motion
from decks.unit_system import LENGTH_UNITS, MM, UnitSystem
from fembridge.errors import DeckError, UsageError

_MOVE = re.compile(r".*[^,\s].*,\s*[+-]?[123]\s*")
_MOVED_LOAD = re.compile(r".*[^,\s].*,\s*([123]|[Pp]\w*)\s*")

LOADS = {"force": "N", "pressure": "MPa"}
"""Quantities of a load, each with its unit."""


@dataclass(frozen=True, slots=True)
class LoadScale:
    """A load that a deck takes instead of a displacement: `per_um` for each um of a stimulus.

    Parameters
    ----------
    quantity
        ``"force"`` in N, all of it, or ``"pressure"`` in MPa.
    per_um
        N or MPa for each um, more than 0.

    Raises
    ------
    UsageError
        Another quantity, or a scale that is not more than 0.
    """

    quantity: str
    per_um: float

    def __post_init__(self) -> None:
        if self.quantity not in LOADS:
            expected = " or ".join(LOADS)
            raise UsageError(argument="quantity", found=self.quantity, expected=expected)
        if not (math.isfinite(self.per_um) and self.per_um > 0):
            raise UsageError(argument="per_um", found=self.per_um, expected="more than 0")

    @property
    def unit(self) -> str:
        """Unit of the load: N or MPa."""
        return LOADS[self.quantity]


@dataclass(frozen=True, slots=True)
class Request:
    """A request for changes of a base deck.

    Parameters
    ----------
    amplitude
        Name of the ``*AMPLITUDE`` or ``table`` that becomes the waveform; without
        one, the only one that drives a motion.
    step
        Load case by name, or step by number, that the waveform runs in; without
        one, the only one possible.
    afferents
        Node number of each afferent by `fembridge.trace.afferent_key`: ``SA``, or ``SA 12`` where
        a class has several units; may be empty.
    move
        ``NSET,DOF``: the displacement that becomes the waveform, whether it has an
        amplitude or not; a sign, ``PROBE,-2``, says which way is into the skin.
    length_unit
        One of `decks.unit_system.LENGTH_UNITS`; None: as the heading says, else mm.
    increments
        "fixed", one a sample, or "automatic": the solver may make them smaller.
    all_nodes
        Results at all nodes, not at those of the afferents alone.
    shell_face
        Of afferents in shells: "bottom", "middle" or "top", the layer whose stress is read.
    load
        Force or pressure that the waveform is, instead of a displacement: `move` is then
        ``NSET,DOF`` of a force, or ``SURFACE,P`` of a pressure.
    keeps_output
        Whether requests of results stay in the deck beside those of the afferents.
    results
        "binary", "text" or, of Marc, "both". None: a Marc deck's own way, of others
        binary.
    """

    amplitude: str | None = None
    step: str | None = None
    afferents: Mapping[str, int] = field(default_factory=dict)
    length_unit: str | None = None
    results: str | None = None
    move: str | None = None
    increments: str = "fixed"
    all_nodes: bool = False
    shell_face: str | None = None
    keeps_output: bool = False
    load: LoadScale | None = None

    def __post_init__(self) -> None:
        for name, choices in (
            ("length_unit", (None, *LENGTH_UNITS)),
            ("results", (None, *RESULTS)),
            ("increments", INCREMENTS),
            ("shell_face", (None, *SHELL_FACES)),
        ):
            if (value := getattr(self, name)) not in choices:
                expected = f"one of {', '.join(filter(None, choices))}"
                raise UsageError(argument=name, found=value, expected=expected)
        if self.move is not None and self.amplitude:
            raise UsageError("cannot be combined with an amplitude", argument="move")
        pattern = _MOVE if self.load is None else _MOVED_LOAD
        if self.move is not None and not pattern.fullmatch(self.move):
            expected = "NSET,DOF: PROBE,2, or PROBE,-2 for into the skin on the negative side"
            if self.load is not None:
                expected = "NSET,DOF of a force: TIP,2; or SURFACE,P of a pressure"
            raise UsageError(argument="move", found=self.move, expected=expected)
        for name, node in self.afferents.items():
            if node < 1:
                raise DeckError(
                    f"has node {node} for {name}, expected 1 or more",
                    argument="afferents",
                    found=node,
                    expected="1 or more",
                )

    @property
    def moved(self) -> tuple[str, int, int] | None:
        """Set or node, axis and sign of `move`; sign 0 where it says none."""
        if self.move is None or self.load is not None:
            return None
        target, degree = self.move.rsplit(",", 1)
        sign = {"-": -1, "+": 1}.get(degree.strip()[0], 0)
        return normalized_name(target), abs(int(degree)), sign

    @property
    def moved_load(self) -> tuple[str, str] | None:
        """Target and label of the load that `move` names."""
        if self.move is None or self.load is None:
            return None
        target, label = self.move.rsplit(",", 1)
        return normalized_name(target), normalized_name(label)


@dataclass(frozen=True, slots=True)
class AfferentSite:
    """What a rebased deck knows of an afferent's node.

    `position_mm` is undeformed, (x, y) or, in a solid model, (x, y, z). `start_stress_pa` is
    the stress at time 0 that the deck states, xx yy zz xy yz zx; () without initial stress.
    Of the bottom or top of a shell CalculiX writes the stress at another node: the one of
    `corner` (from 0) of `element` in its expanded mesh; `element` is 0 elsewhere. Where the
    material relaxes, its stress is the sum over `branches`, whose mean the solver writes.
    """

    position_mm: tuple[float, ...]
    start_stress_pa: tuple[float, ...] = ()
    element: int = 0
    corner: int = 0
    branches: int = 1


@dataclass(frozen=True, slots=True)
class Rebased:
    """A base deck that contains the waveform.

    `remarks` describe each choice and change, with its line, `doubts` what may be wrong.
    `sites` are the afferents' nodes. `at_rest` is False if the model holds stress at time 0
    that no output has. `needs` are the
    relative names of the files that the deck includes. `before_s` is the solver time at which
    the waveform begins, after the earlier steps, and `stands_mm` the depth of the probe at that
    time. `units` are those of the deck. `time_dependent` are reasons why stress depends on time
    as well as on depth, `path_dependent` reasons why it may depend on earlier depths.
    `is_whole_field` is True if CalculiX writes results at all nodes.
    """

    deck: bytes
    remarks: tuple[str, ...]
    sites: Mapping[str, AfferentSite]
    needs: tuple[str, ...] = ()
    before_s: float = 0.0
    stands_mm: float = 0.0
    units: UnitSystem = MM
    doubts: tuple[str, ...] = ()
    at_rest: bool = True
    time_dependent: tuple[str, ...] = ()
    path_dependent: tuple[str, ...] = ()
    is_whole_field: bool = False


def units_per_mm(units: UnitSystem, load: LoadScale | None) -> float:
    """What one mm of a stimulus is in the deck's unit of the driven quantity."""
    if load is None:
        return 1.0 / units.length_mm
    if load.quantity == "force":
        return 1.0e3 * load.per_um / units.force_n
    return 1.0e3 * load.per_um * 1.0e6 / units.stress_pa


class Edit(NamedTuple):
    """A replacement of the bytes of a deck from `start` to `stop` by `new`."""

    start: int
    stop: int
    new: bytes = b""


def apply_edits(data: bytes, edits: Iterable[Edit]) -> bytes:
    """`data` with all `edits` applied; edits at the same byte keep their order."""
    pieces, end = [], 0
    for edit in sorted(edits, key=lambda edit: edit[:2]):
        pieces += [data[end : edit.start], edit.new]
        end = edit.stop
    return b"".join([*pieces, data[end:]])


def size_warnings(motion: Motion, size_mm: float, units: UnitSystem, by_heading: bool) -> list[str]:
    """A warning if the waveform is larger than the model."""
    reach_mm = float(motion.depth_mm.max() - motion.depth_mm.min())
    if not 0 < size_mm < reach_mm:
        return []
    hint = "as its heading says" if by_heading else "--length-unit names it"
    return [
        f"the waveform moves {reach_mm:g} mm and the model is {size_mm:g} mm big: is its unit of "
        f"length {units.length_unit}? ({hint})"
    ]
