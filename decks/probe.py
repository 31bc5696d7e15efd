"""The probe: a rigid body of quadrilaterals whose every node has the same motion.

Its lower side is a polyline, fine compared with the elements of the skin; a single row of
quads behind it gives it a surface for the contact search of a solver.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from decks.finger import FINITE, NOT_NEGATIVE, Ranged
from decks.mesh import Mesh
from fembridge.errors import FingerError
from fembridge.typing import FloatArray, IntArray

SHAPES = ("cylinder", "flat")

# A cylinder is meshed up to this angle to both sides of its lowest point.
_HALF_OPENING_DEG = 80.0
_MIN_SEGMENTS = 64
_SEGMENT_MM = 0.02
_INNER_SHARE = 0.7
# Radius at the edges of a punch; a share of the width if the punch is narrow.
_FILLET_MM = 0.1
_FILLET_SHARE = 0.25
_MIN_FILLET_MM = 0.001
_FILLET_SEGMENTS = 16
# A narrower flat side is omitted.
_MIN_FLAT_MM = 1e-6
_SAME_HEIGHT_MM = 1e-6
_DIGITS = 9


@dataclass(frozen=True, slots=True)
class Probe(Ranged):
    """The rigid probe, in the cross-section of the finger.

    Parameters
    ----------
    shape
        ``"cylinder"``, or ``"flat"``, a flat punch. Default: ``"cylinder"``.
    diameter_mm
        Diameter of the cylinder or width of the punch in mm, 0.01 to 20. Default: 1, the
        indentor of Ishizuka et al., section 3.2.
    fillet_mm
        Radius in mm of the edges of a punch; 0 is a sharp edge, under which no stress is
        finite. Default: None, 0.1, or a quarter of the width of a narrow punch.
    x_mm
        Position of the middle of the probe in mm, across the finger from the middle of the
        pad. Default: 0.

    Raises
    ------
    FingerError
        An unknown shape, or a number outside its range.

    Examples
    --------
    >>> import fembridge as fb
    >>> fb.Probe("flat", diameter_mm=2.0).fillet_mm
    0.1
    """

    shape: str = "cylinder"
    diameter_mm: float = 1.0
    fillet_mm: float = None  # type: ignore[assignment] # a number once it is made
    x_mm: float = 0.0

    RANGES: ClassVar = {
        "shape": SHAPES,
        "diameter_mm": (0.01, 20.0),
        "fillet_mm": NOT_NEGATIVE,
        "x_mm": FINITE,
    }

    def __post_init__(self) -> None:
        if self.fillet_mm is None:
            widest_mm = _FILLET_SHARE * self.diameter_mm if self.shape == "flat" else _FILLET_MM
            object.__setattr__(self, "fillet_mm", min(_FILLET_MM, widest_mm))
        Ranged.__post_init__(self)
        fillet_fits = (
            self.fillet_mm == 0 or _MIN_FILLET_MM <= self.fillet_mm <= 0.5 * self.diameter_mm
        )
        if self.shape == "flat" and not fillet_fits:
            raise FingerError(
                argument="fillet_mm",
                found=self.fillet_mm,
                expected=f"0 (a sharp edge) or from {_MIN_FILLET_MM:g} mm to half the width, "
                f"{0.5 * self.diameter_mm:g} mm",
            )

    def lower_side(self) -> FloatArray:
        """Points ``(S, 2)`` from left to right; the lowest is at height 0."""
        radius_mm = 0.5 * self.diameter_mm
        if self.shape == "cylinder":
            opening = np.radians(_HALF_OPENING_DEG)
            segments = 2 * round(max(_MIN_SEGMENTS, 2 * radius_mm / _SEGMENT_MM) / 2)
            points = _arc(radius_mm, np.linspace(-opening, opening, segments + 1))
            points[segments // 2] = 0.0
            return np.round(points, _DIGITS) + 0.0
        half_flat_mm = radius_mm - self.fillet_mm
        floor = np.zeros((1, 2))
        if half_flat_mm > _MIN_FLAT_MM:
            count = 2 * max(1, round(half_flat_mm / _SEGMENT_MM))
            flat_mm = np.linspace(-half_flat_mm, half_flat_mm, count + 1)
            floor = np.stack([flat_mm, np.zeros_like(flat_mm)], -1)
        right = np.array([[radius_mm, 0.5 * radius_mm]])
        if self.fillet_mm > 0:
            right = _arc(self.fillet_mm, np.linspace(0.0, np.pi / 2, _FILLET_SEGMENTS + 1)[1:])
            right[:, 0] += half_flat_mm
        return np.round(np.concatenate([right[::-1] * [-1.0, 1.0], floor, right]), _DIGITS) + 0.0


def _arc(radius_mm: float, angle: FloatArray) -> FloatArray:
    """Points of a circle that touches the origin from above, at angles from there."""
    points: FloatArray = radius_mm * np.stack([np.sin(angle), 1 - np.cos(angle)], -1)
    return points


@dataclass(frozen=True, slots=True, eq=False)
class ProbeMesh:
    """`node_mm` ``(P, 2)`` and `quad` ``(Q, 4)``; face 0 of each quad faces the skin.

    The first ``Q + 1`` nodes are those of the lower side, from left to right.
    """

    node_mm: FloatArray
    quad: IntArray

    @property
    def lower_node(self) -> IntArray:
        """Rows of the nodes on the lower side, ``(Q + 1,)``."""
        return np.arange(len(self.quad) + 1)


def mesh_probe(
    probe: Probe, skin: Mesh, travel_mm: tuple[float, float] = (0.0, 0.0)
) -> tuple[ProbeMesh, int]:
    """Mesh of `probe` at first touch of `skin`, and the row of the node that it touches.

    Of several nodes at the same height, as under a flat punch, the node nearest to the middle
    of the probe is taken; if no node is under a narrow probe, the nearest node.

    Raises
    ------
    FingerError
        The probe reaches beyond the pad, at its position or within its travel along x,
        `travel_mm`.
    """
    outer = probe.lower_side() + np.array([probe.x_mm, 0.0])
    pad = skin.pad()
    pad_mm = skin.node_mm[pad]
    left_mm, right_mm = outer[0, 0] + travel_mm[0], outer[-1, 0] + travel_mm[1]
    if left_mm < pad_mm[0, 0] or right_mm > pad_mm[-1, 0]:
        raise FingerError(
            f"the probe spans x = {left_mm:g} to {right_mm:g} mm, expected inside the "
            f"pad, {pad_mm[0, 0]:g} to {pad_mm[-1, 0]:g} mm",
            found=(left_mm, right_mm),
            expected=f"inside {pad_mm[0, 0]:g} to {pad_mm[-1, 0]:g} mm",
        )
    over_skin_mm = outer[:, 1] - np.interp(outer[:, 0], pad_mm[:, 0], pad_mm[:, 1])
    over_mm = np.interp(pad_mm[:, 0], outer[:, 0], outer[:, 1], left=np.inf, right=np.inf)
    gap_mm = over_mm - pad_mm[:, 1]  # from each node up to the probe
    lowest_mm = min(over_skin_mm.min(), gap_mm.min())
    middle = np.array([probe.x_mm, 0.5 * probe.diameter_mm])
    count = len(outer)
    left = np.arange(count - 1)
    quad = np.stack([left, left + 1, left + 1 + count, left + count], -1)
    node_mm = np.concatenate([outer, middle + _INNER_SHARE * (outer - middle)])
    node_mm[:, 1] -= lowest_mm
    offset_mm = np.abs(pad_mm[:, 0] - 0.5 * (outer[0, 0] + outer[-1, 0]))
    if np.isfinite(gap_mm).any():
        offset_mm[gap_mm > gap_mm.min() + _SAME_HEIGHT_MM] = np.inf
    return ProbeMesh(np.round(node_mm, _DIGITS) + 0.0, quad), int(pad[offset_mm.argmin()])
