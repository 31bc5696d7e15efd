"""Fingerprint ridges as heights on the skin: straight lines, a loop or a whorl.

A pattern is a function that rises by 1 from one ridge to the next; the profile of a ridge is a
function of that. About sixteen ridges cross the diagonal of a square of 25 mm² on a fingertip
(Gutiérrez-Redomero et al. 2008, Forensic Sci. Int. 180:17), so that they are 0.44 mm apart. They
are about 0.1 mm high (Maeno, Kobayashi & Yamazaki 1998, JSME Int. J. C 41:94), a cosine as in
`decks.finger.Ridges`.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from fembridge.errors import UsageError
from fembridge.ranges import Range, check_range
from fembridge.touching.specification import from_specification
from fembridge.typing import FloatArray, Table

# Core of a loop or a whorl: so far from the middle of the pad at most, drawn by the seed.
_CORE_MM = 1.0
# A loop opens towards the base and this much to one side.
_LOOP_DEG = 25.0
# A whorl is longer along the finger than across it.
_WHORL_STRETCH = 1.3


@dataclass(frozen=True, slots=True)
class Fingerprint:
    """Ridges on the skin of a pad, for `touch`; `pattern` names their lines.

    Parameters
    ----------
    pattern
        ``loop``, ``whorl``, ``across`` (straight ridges across the finger) or ``along``. Default:
        ``loop``.
    period_mm
        Distance of two ridges in mm, 0.2 to 2. Default: 0.44.
    height_mm
        Depth of the furrows between them in mm, 0 to 1; 0: smooth skin. Default: 0.1.
    top_share
        Share of the period that is even, 0 to 0.9. Default: 0, a cosine.
    node_mm
        Distance of two nodes that may touch in mm, about; a whole part of that of the pad.
        Default: 0.125.
    seed
        Seed of the phase of the ridges and of the core. Default: 0.

    Raises
    ------
    UsageError
        An unknown pattern, a number out of range, or less than three nodes in a period.

    Examples
    --------
    >>> import fembridge as fb
    >>> fb.Fingerprint("whorl", seed=3).period_mm
    0.44
    """

    pattern: str = "loop"
    period_mm: float = 0.44
    height_mm: float = 0.1
    top_share: float = 0.0
    node_mm: float = 0.125
    seed: int = 0

    RANGES: ClassVar[Mapping[str, Range]] = {
        "period_mm": Range(0.2, 2.0),
        "height_mm": Range(0.0, 1.0),
        "top_share": Range(0.0, 0.9),
        "node_mm": Range(0.03, 0.25),
    }

    def __post_init__(self) -> None:
        if self.pattern not in PATTERNS:
            raise UsageError(
                argument="ridges", found=self.pattern, expected=", ".join((*PATTERNS, NONE))
            )
        for name, limits in self.RANGES.items():
            check_range(name, getattr(self, name), limits)
        check_range("seed", self.seed)
        if self.height_mm and 3 * self.node_mm > self.period_mm * (1 + 1e-9):
            raise UsageError(
                argument="node_mm",
                found=self.node_mm,
                expected=f"at most {self.period_mm / 3:.3g} mm, three nodes to a ridge",
            )

    def to_table(self) -> Table:
        """Pattern and sizes, for a record."""
        return {
            name: getattr(self, name)
            for name in ("pattern", "period_mm", "height_mm", "top_share", "node_mm", "seed")
        }

    def below_mm(self, arc_mm: FloatArray, z_mm: FloatArray) -> FloatArray:
        """Depth of the skin below the tops of the ridges in mm.

        Parameters
        ----------
        arc_mm, z_mm
            Positions along the skin across the finger, and along the finger, in mm, ``(P,)`` or any
            shapes that broadcast.
        """
        if not self.height_mm:
            return np.zeros(np.broadcast(arc_mm, z_mm).shape)
        turns = self._turns(arc_mm, z_mm)
        off_top = np.abs(turns - np.round(turns))
        half_top = 0.5 * self.top_share
        share = np.clip((off_top - half_top) / (0.5 - half_top), 0.0, 1.0)
        below: FloatArray = 0.5 * self.height_mm * (1 - np.cos(np.pi * share))
        return below

    def across(self, arc_mm: float, z_mm: float) -> tuple[float, float]:
        """Direction across the ridges at a position: a unit vector across and along the finger.

        In the middle of a core, where there is none, it is along the finger.

        Parameters
        ----------
        arc_mm, z_mm
            Position along the skin across the finger, and along the finger, in mm.
        """
        step_mm = 1e-4 * np.array([1.0, -1.0])
        slope = np.array(
            [
                np.diff(self._turns(arc_mm - step_mm, np.full(2, z_mm)))[0],
                np.diff(self._turns(np.full(2, arc_mm), z_mm - step_mm))[0],
            ]
        )
        length = float(np.hypot(*slope))
        return (float(slope[0] / length), float(slope[1] / length)) if length > 0 else (0.0, 1.0)

    @property
    def sizes(self) -> str:
        """Distance and height of the ridges, as a parameter set states them; ``none``: smooth."""
        if not self.height_mm:
            return NONE
        top = f", tops {self.top_share:g}" if self.top_share else ""
        return f"{self.period_mm:g} mm apart, {self.height_mm:g} mm high{top}"

    def _turns(self, arc_mm: FloatArray, z_mm: FloatArray) -> FloatArray:
        """Number of ridges from the core, whole on the tops."""
        phase, core_arc_mm, core_z_mm = np.random.default_rng(self.seed).uniform(-0.5, 0.5, 3)
        away_mm = _DISTANCES[self.pattern](
            arc_mm - 2 * _CORE_MM * core_arc_mm, z_mm - 2 * _CORE_MM * core_z_mm
        )
        return np.asarray(away_mm / self.period_mm + phase, dtype=np.float64)


def _loop_mm(arc_mm: FloatArray, z_mm: FloatArray) -> FloatArray:
    """Distance from a line from the core towards the base and to one side."""
    turn = math.radians(_LOOP_DEG)
    aside = math.cos(turn) * arc_mm + math.sin(turn) * z_mm
    ahead = -math.sin(turn) * arc_mm + math.cos(turn) * z_mm
    return np.hypot(aside, np.maximum(ahead, 0.0))


def _whorl_mm(arc_mm: FloatArray, z_mm: FloatArray) -> FloatArray:
    return np.hypot(arc_mm, z_mm / _WHORL_STRETCH)


def _across_mm(arc_mm: FloatArray, z_mm: FloatArray) -> FloatArray:
    return z_mm + 0.0 * arc_mm


def _along_mm(arc_mm: FloatArray, z_mm: FloatArray) -> FloatArray:
    return arc_mm + 0.0 * z_mm


_DISTANCES = {"loop": _loop_mm, "whorl": _whorl_mm, "across": _across_mm, "along": _along_mm}
PATTERNS, NONE = tuple(_DISTANCES), "none"
"""Names of the patterns, and of smooth skin on the nodes of the pad."""


def resolve_fingerprint(ridges: str | Fingerprint) -> Fingerprint | None:
    """The fingerprint of a specification such as ``whorl:seed=3``; None of ``none``.

    Parameters
    ----------
    ridges
        A specification, or a `Fingerprint`, which is returned unchanged.

    Raises
    ------
    UsageError
        No such pattern or size, with near names.
    """
    if isinstance(ridges, Fingerprint):
        return ridges
    if not isinstance(ridges, str):
        raise UsageError(argument="ridges", found=ridges, expected="a Fingerprint or a text")

    def maker(pattern: str) -> Any:  # noqa: ANN401
        def make(
            period_mm: float = 0.44,
            height_mm: float = 0.1,
            top_share: float = 0.0,
            node_mm: float = 0.125,
            seed: int = 0,
        ) -> Fingerprint:
            return Fingerprint(pattern, period_mm, height_mm, top_share, node_mm, seed)

        return make

    makers = {**{name: maker(name) for name in PATTERNS}, NONE: lambda: None}
    fingerprint: Fingerprint | None = from_specification(ridges, "ridges", makers)
    return fingerprint
