"""A base deck: kept to the byte except for waveform, increments and output.

This module has the request and the result; `inp` and `marc` edit the two kinds of deck.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from decks.dialects import INCREMENTS, RESULTS
from decks.inp import normalized_name
from decks.motion import Motion
from decks.unit_system import LENGTH_UNITS, MM, UnitSystem
from fembridge.errors import DeckError, UsageError

_MOVE = re.compile(r".*[^,\s].*,\s*[+-]?[123]\s*")
_BIG_MM = 1000.0


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
        Node number of each afferent; may be empty.
    move
        ``NSET,DOF``: the displacement that becomes the waveform, whether it has an
        amplitude or not; a sign, ``PROBE,-2``, says which way is into the skin.
    length_unit
        One of `decks.unit_system.LENGTH_UNITS`; None: as the heading says, else mm.
    increments
        "fixed", one a sample, or "automatic": the solver may make them smaller.
    all_nodes
        Results at all nodes, not at those of the afferents alone.
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

    def __post_init__(self) -> None:
        for name, choices in (
            ("length_unit", (None, *LENGTH_UNITS)),
            ("results", (None, *RESULTS)),
            ("increments", INCREMENTS),
        ):
            if (value := getattr(self, name)) not in choices:
                raise UsageError(f"{name} {value!r}, expected {', '.join(filter(None, choices))}")
        if self.move is not None and self.amplitude:
            raise UsageError("amplitude and move: one of them names the motion")
        if self.move is not None and not _MOVE.fullmatch(self.move):
            raise UsageError(
                f"move {self.move!r}, expected NSET,DOF: PROBE,2, or PROBE,-2 for into the skin "
                "on the negative side"
            )
        for name, node in self.afferents.items():
            if node < 1:
                raise DeckError(f"afferent {name}: a node is from 1, got {node}")

    @property
    def moved(self) -> tuple[str, int, int] | None:
        """Set or node, axis and sign of `move`; sign 0 where it says none."""
        if self.move is None:
            return None
        target, degree = self.move.rsplit(",", 1)
        sign = {"-": -1, "+": 1}.get(degree.strip()[0], 0)
        return normalized_name(target), abs(int(degree)), sign


@dataclass(frozen=True, slots=True)
class Rebased:
    """A base deck that contains the waveform.

    `remarks` describe each choice and change, with its line. `place_mm` is the undeformed
    position of each afferent's node, (x, y) or, in a solid model, (x, y, z). `needs` are the
    relative names of the files that the deck includes. `before_s` is the solver time at which
    the waveform begins, after the earlier steps, and `stands_mm` the depth of the probe at that
    time. `units` are those of the deck.
    """

    deck: bytes
    remarks: tuple[str, ...]
    place_mm: Mapping[str, tuple[float, ...]]
    needs: tuple[str, ...] = ()
    before_s: float = 0.0
    stands_mm: float = 0.0
    units: UnitSystem = MM


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
    """A warning if the waveform is larger than the model, or the model is implausibly large."""
    reach_mm = float(motion.depth_mm.max() - motion.depth_mm.min())
    if size_mm > 0 and reach_mm > size_mm:
        finding = f"the waveform moves {reach_mm:g} mm and the model is {size_mm:g} mm big"
    elif size_mm > _BIG_MM:
        finding = f"the model is {size_mm / _BIG_MM:g} m big"
    else:
        return []
    hint = "as its heading says" if by_heading else "--length-unit names it"
    return [f"{finding}: is its unit of length {units.length_unit}? ({hint})"]
