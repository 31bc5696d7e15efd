"""The probe: a rigid body of quadrilaterals whose every node is moved alike.

Its lower side is a polyline, fine beside the skin's elements; towards the inside
a single row of quads gives it a surface that a solver can find.
"""

from dataclasses import dataclass

import numpy as np

from decks.checks import finite, not_negative, positive
from decks.mesh import Mesh
from fembridge.errors import FingerError
from fembridge.typing import FloatArray, IntArray

SHAPES = ("cylinder", "flat")

# A cylinder is meshed this far to both sides of its lowest point.
_HALF_OPENING_DEG = 80.0
_MIN_SEGMENTS = 64
_SEGMENT_MM = 0.02
_INNER_SHARE = 0.7
_DIGITS = 9


@dataclass(frozen=True, slots=True)
class Probe:
    """A cylinder of `diameter_mm`, or a flat punch of that width.

    `fillet_mm` rounds the punch's edges (a sharp edge has no finite stress
    under it). `x_mm` is where the probe's middle stands. 1 mm: the indentor of
    Ishizuka et al., section 3.2.
    """

    shape: str = "cylinder"
    diameter_mm: float = 1.0
    fillet_mm: float = 0.1
    x_mm: float = 0.0

    def __post_init__(self) -> None:
        if self.shape not in SHAPES:
            raise FingerError(
                f"probe shape {self.shape!r}, expected one of {', '.join(SHAPES)}"
            )
        positive(self, "diameter_mm")
        not_negative(self, "fillet_mm")
        finite(self, "x_mm")
        if not 0.01 <= self.diameter_mm <= 20:
            raise FingerError(
                f"probe diameter {self.diameter_mm:g} mm, expected 0.01 to 20 mm"
            )
        if self.shape == "flat" and not self.fillet_mm <= 0.5 * self.diameter_mm:
            raise FingerError(
                f"fillet {self.fillet_mm:g} mm, expected at most half the "
                f"width, {0.5 * self.diameter_mm:g} mm"
            )

    def lower_side(self) -> FloatArray:
        """Points ``(S, 2)`` from left to right; the lowest is at height 0."""
        radius = 0.5 * self.diameter_mm
        if self.shape == "cylinder":
            opening = np.radians(_HALF_OPENING_DEG)
            segments = 2 * round(max(_MIN_SEGMENTS, 2 * radius / _SEGMENT_MM) / 2)
            angle = np.linspace(-opening, opening, segments + 1)
            points = radius * np.stack([np.sin(angle), 1 - np.cos(angle)], -1)
            points[segments // 2] = 0.0
            return np.round(points, _DIGITS) + 0.0
        half_flat = radius - self.fillet_mm
        angle = np.linspace(0.0, np.pi / 2, 17)[1:]
        corner = self.fillet_mm * np.stack([np.sin(angle), 1 - np.cos(angle)], -1)
        corner[:, 0] += half_flat
        count = 2 * max(1, round(half_flat / _SEGMENT_MM))
        flat = np.linspace(-half_flat, half_flat, count + 1)
        floor = np.stack([flat, np.zeros_like(flat)], -1)
        right = corner if self.fillet_mm > 0 else np.array([[radius, 0.5 * radius]])
        floor = floor if half_flat > 0 else np.zeros((1, 2))
        left = right[::-1] * [-1.0, 1.0]
        return np.round(np.concatenate([left, floor, right]), _DIGITS) + 0.0


@dataclass(frozen=True, slots=True, eq=False)
class ProbeMesh:
    """`node_mm` ``(P, 2)`` and `quad` ``(Q, 4)``; face 0 of each quad is the skin's.

    The first ``Q + 1`` nodes are those of the lower side, from left to right.
    """

    node_mm: FloatArray
    quad: IntArray

    @property
    def lower_node(self) -> IntArray:
        """Rows of the nodes on the lower side, ``(Q + 1,)``."""
        return np.arange(len(self.quad) + 1)


def mesh_probe(probe: Probe, skin: Mesh) -> ProbeMesh:
    """Mesh `probe` and set it on `skin`: at first touch, nothing pressed.

    Raises
    ------
    FingerError
        The probe stands beside the skin.
    """
    outer = probe.lower_side() + [probe.x_mm, 0.0]
    middle = np.array([probe.x_mm, 0.5 * probe.diameter_mm])
    inner = middle + _INNER_SHARE * (outer - middle)
    count = len(outer)
    left = np.arange(count - 1)
    quad = np.stack([left, left + 1, left + 1 + count, left + count], -1)
    node_mm = np.concatenate([outer, inner])
    node_mm[:, 1] += _touching_height_mm(outer, skin)
    return ProbeMesh(np.round(node_mm, _DIGITS) + 0.0, quad)


def _touching_height_mm(lower_mm: FloatArray, skin: Mesh) -> float:
    """Height of the lowest point of the probe at which it first touches."""
    edges, _, _ = skin.outline()
    pad = skin.node_mm[np.unique(edges)]
    pad = pad[pad[:, 1] > 0.5 * skin.node_mm[:, 1].min()]
    pad = pad[np.argsort(pad[:, 0], kind="stable")]
    ends = lower_mm[0, 0], lower_mm[-1, 0]
    if ends[0] < pad[0, 0] or ends[1] > pad[-1, 0]:
        raise FingerError(
            f"the probe spans x = {ends[0]:g} to {ends[1]:g} mm, expected inside the "
            f"pad, {pad[0, 0]:g} to {pad[-1, 0]:g} mm"
        )
    at_skin = pad[(pad[:, 0] >= ends[0]) & (pad[:, 0] <= ends[1])]
    gaps = np.interp(at_skin[:, 0], lower_mm[:, 0], lower_mm[:, 1]) - at_skin[:, 1]
    below = lower_mm[:, 1] - np.interp(lower_mm[:, 0], pad[:, 0], pad[:, 1])
    lowest = min(below.min(), gaps.min() if gaps.size else np.inf)
    return -float(lowest) + 0.0
