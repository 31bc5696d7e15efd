"""What a user wants changed in an own deck, and what came of it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from decks.dialects import RESULTS
from fembridge.errors import DeckError


@dataclass(frozen=True, slots=True)
class Request:
    """What is wanted of an own deck.

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
    length_mm
        One length unit of the deck in mm: 1 for mm, 1000 for m.
    results
        "binary", "text" or, of Marc, "both". None: a Marc deck's own way, of others
        binary.
    """

    amplitude: str | None = None
    step: str | None = None
    afferents: Mapping[str, int] = field(default_factory=dict)
    length_mm: float = 1.0
    results: str | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.length_mm) and self.length_mm > 0):
            raise DeckError(f"length_mm must be > 0, got {self.length_mm}")
        if self.results not in (None, *RESULTS):
            raise DeckError(f"results {self.results!r}, expected one of {', '.join(RESULTS)}")
        for name, node in self.afferents.items():
            if node < 1:
                raise DeckError(f"afferent {name}: a node is from 1, got {node}")


@dataclass(frozen=True, slots=True)
class Rebased:
    """An own deck with the waveform in it.

    `remarks` say what was chosen and changed, each with its line. `place_mm` is
    the undeformed (x, y) of each afferent's node. `needs` are the files that the
    deck includes, by the relative names it gives them. `before_s` is the solver's
    time at which the waveform begins: that of the steps before it.
    """

    deck: bytes
    remarks: tuple[str, ...]
    place_mm: Mapping[str, tuple[float, float]]
    needs: tuple[str, ...] = ()
    before_s: float = 0.0
